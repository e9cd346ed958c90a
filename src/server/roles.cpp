#include "server/roles.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>

#include "server/refused.hpp"

namespace server {
namespace {

std::string role_name(proto::Role role) {
  std::string name = proto::Role_Name(role);
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
  return name;
}

std::string name_of_call(const proto::Request& request) {
  const auto* calls = proto::Request::descriptor()->FindOneofByName("call");
  const auto* call = request.GetReflection()->GetOneofFieldDescriptor(request, calls);
  return call == nullptr ? "it" : call->message_type()->name();
}

bool protects(const proto::ChangeWalls& change) {
  return std::any_of(change.put().begin(), change.put().end(), [](const proto::Wall& wall) { return wall.fixed(); });
}

}  // namespace

proto::Role needed(const proto::Request& request) {
  switch (request.call_case()) {
    case proto::Request::kStopSkill: return proto::NOBODY;  // from everybody who is connected
    case proto::Request::kHello:
    case proto::Request::kGetState:
    case proto::Request::kSkillStatus:
    case proto::Request::kCheckSkill:
    case proto::Request::kListArms:
    case proto::Request::kListTopics:
    case proto::Request::kGetServerStatus:
    case proto::Request::kAlive:
    case proto::Request::kGoodbye:
    case proto::Request::CALL_NOT_SET: return proto::READ;
    case proto::Request::kGripper: return request.gripper().has_stop() ? proto::NOBODY : proto::USER;
    case proto::Request::kRecord: return request.record().has_on() ? proto::USER : proto::READ;
    case proto::Request::kStartSkill:
    case proto::Request::kChangeSkill:
    case proto::Request::kRecover: return proto::USER;
    case proto::Request::kChangeWalls: {  // those that are protected: WallStore
      const auto& change = request.change_walls();
      if (protects(change)) return proto::LAB;
      return change.put().empty() && change.remove().empty() ? proto::READ : proto::USER;
    }
    case proto::Request::kChangeLimits: {
      const auto& change = request.change_limits();
      if (change.has_most()) return proto::LAB;
      return change.has_limits() || change.reset() ? proto::USER : proto::READ;
    }
  }
  return proto::LAB;  // a call that this table lacks
}

std::string explain_role(const Keys::Client& client, const std::string& what, proto::Role role) {
  if (client.key.empty()) {
    return fmt::format("{} needs the role {}, which nobody has where a server has no keys: `frankapy keys new` and `frankapy keys "
                       "add NAME --role {}` make them (docs/keys.md)",
                       what, role_name(role), role_name(role));
  }
  if (client.role == proto::NOBODY) {
    return fmt::format("{} is refused: the key of this connection was removed from the server's. Whoever runs the server makes "
                       "another (`frankapy keys add`)",
                       what);
  }
  return fmt::format("{} needs the role {}, and the key \"{}\" has {}. Whoever runs the server makes one that has it (`frankapy keys "
                     "add NAME --role {}`)",
                     what, role_name(role), client.name, role_name(client.role), role_name(role));
}

void require_role(const Keys::Client& client, const proto::Request& request) {
  const proto::Role role = needed(request);
  if (client.role >= role) return;
  throw Refused(proto::Error::NOT_PERMITTED, explain_role(client, name_of_call(request), role));
}

}  // namespace server
