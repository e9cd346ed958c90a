#include "server/registry.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>

#include "frankapy/proto/terminations.pb.h"
#include "server/kinds/kind.hpp"
#include "server/part_record.hpp"
#include "server/refused.hpp"
#include "wire/proto/validation.hpp"

namespace server {
namespace {

using google::protobuf::Any;

constexpr int kMaxDepth = 4;          // of AnyOf and AllOf in each other
constexpr int kMostParts = 32;  // in one

template <class Base>
std::vector<std::string> names(const std::vector<Kind<Base>>& kinds) {
  std::vector<std::string> names;
  for (const auto& each : kinds) names.push_back(each.name);
  return names;
}

template <class Base>
std::unique_ptr<Base> make(const std::vector<Kind<Base>>& kinds, const std::string& what, const Any& any,
                           const realtime::Arm& arm) {
  const std::string name = kind_of(any);
  for (const auto& each : kinds) {
    if (each.name != name) continue;
    try {
      const InPart in_part(number_of(name));
      return each.make(any, arm);
    } catch (const wire::Invalid& error) {
      refuse(error.what());
    } catch (const Refused&) {
      throw;
    } catch (const std::exception& error) {
      refuse(name + ": " + error.what());
    } catch (...) {  // a part of somebody's own may throw anything
      refuse(name + " threw what is no std::exception as it was made: its constructor may throw std::invalid_argument");
    }
  }
  refuse(fmt::format("{} is no {} that this server knows; known are {}. Is the client newer than the server?",
                     name.empty() ? "\"" + any.type_url() + "\"" : name, what, fmt::join(names(kinds), ", ")));
}

// Those of which `fits` is true when they are made of their defaults.
template <class Base, class Fits>
std::string that_fit(const std::vector<Kind<Base>>& kinds, const realtime::Arm& arm, Fits fits) {
  std::string names;
  for (const auto& each : kinds) {
    try {
      Any any;
      const bool own = each.name.find('.') == std::string::npos;
      any.set_type_url(fmt::format("type.googleapis.com/{}{}", own ? "frankapy.proto." : "", each.name));
      if (!fits(*each.make(any, arm))) continue;
    } catch (const std::exception&) {
      continue;  // has no defaults to be made of
    }
    names += (names.empty() ? "" : ", ") + each.name;
  }
  return names.empty() ? "another kind" : names;
}

// Terminations in a termination, itself included: all of them are asked in every cycle. They may be nested `depth` deep.
int count(const Any& any, int depth) {
  proto::AnyOf composite;  // AllOf has the same fields
  const std::string name = kind_of(any);
  if (name != "AnyOf" && name != "AllOf") return 1;
  if (depth == 0) refuse(fmt::format("{} is nested more than {} deep", name, kMaxDepth));
  if (!composite.ParseFromString(any.value())) return 1;  // make() says so
  int sum = 1;
  for (const Any& each : composite.of()) sum += count(each, depth - 1);
  return sum;
}

// The file behind those that it imports, unless clients have it.
void describe(const google::protobuf::FileDescriptor& file, std::set<const google::protobuf::FileDescriptor*>& described,
              proto::LoadedKinds& out) {
  const std::string name(file.name());
  if (name.starts_with("frankapy/proto/") || name.starts_with("google/protobuf/") || !described.insert(&file).second) return;
  for (int i = 0; i < file.dependency_count(); ++i) describe(*file.dependency(i), described, out);
  file.CopyTo(out.add_files());
}

}  // namespace

std::unique_ptr<realtime::TrajectoryGenerator> make_trajectory(const Any& any, const realtime::Arm& arm) {
  return make(trajectories(), "trajectory", any, arm);
}
std::unique_ptr<realtime::Controller> make_controller(const Any& any, const realtime::Arm& arm) {
  return make(controllers(), "controller", any, arm);
}
std::unique_ptr<realtime::Termination> make_termination(const Any& any, const realtime::Arm& arm) {
  if (const int number = count(any, kMaxDepth); number > kMostParts) {
    refuse(fmt::format("{} has {} terminations in it: expected at most {}", kind_of(any), number, kMostParts));
  }
  return make(terminations(), "termination", any, arm);
}

std::unique_ptr<realtime::SoftEnding> make_ending(const Any& any, const realtime::Arm& arm) {
  return make(endings(), "soft ending", any, arm);
}

std::vector<std::string> trajectory_kinds() { return names(trajectories()); }
std::vector<std::string> controller_kinds() { return names(controllers()); }
std::vector<std::string> termination_kinds() { return names(terminations()); }
std::vector<std::string> ending_kinds() { return names(endings()); }

std::string controllers_that_take(realtime::Channels channels, const realtime::Arm& arm) {
  return that_fit(controllers(), arm, [&](const realtime::Controller& controller) { return has(controller.takes(), channels); });
}
std::string terminations_that_judge(realtime::Channels channels, const realtime::Arm& arm) {
  return that_fit(terminations(), arm, [&](const realtime::Termination& termination) { return has(channels, termination.judges()); });
}

std::string kind_of(const Any& any) {
  return kind_name(any.type_url().substr(any.type_url().rfind('/') + 1));
}

std::uint16_t number_of(const std::string& kind) {
  std::uint16_t number = 0;
  const auto is_in = [&](const auto& kinds) {
    return std::any_of(kinds.begin(), kinds.end(), [&](const auto& each) { return ++number, each.name == kind; });
  };
  return is_in(trajectories()) || is_in(controllers()) || is_in(terminations()) ? number : 0;
}

std::vector<std::string> titles_of_kinds() {
  std::vector<std::string> titles;
  for (const auto& each : trajectories()) titles.push_back("trajectory " + each.name);
  for (const auto& each : controllers()) titles.push_back("controller " + each.name);
  for (const auto& each : terminations()) titles.push_back("termination " + each.name);
  return titles;
}

proto::LoadedKinds loaded_kinds() {
  proto::LoadedKinds loaded;
  std::set<const google::protobuf::FileDescriptor*> described;
  const auto add = [&](const char* role, const auto& kinds) {
    for (const auto& each : kinds) {
      if (each.name.find('.') == std::string::npos) continue;
      auto& kind = *loaded.add_kinds();
      kind.set_role(role);
      kind.set_name(each.name);
      describe(*each.message->file(), described, loaded);
    }
  };
  add("trajectory", trajectories());
  add("controller", controllers());
  add("termination", terminations());
  return loaded;
}

}  // namespace server
