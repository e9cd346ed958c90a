// Takes the place of src/server/recovery.cpp in a server that recovers from nothing, whoever asks: what tests/safety has to find
// then.
// Each of its functions, so that the linker takes none from the library.

#include "server/recovery.hpp"

#include <utility>

#include "server/refused.hpp"

namespace server {
namespace {

proto::Recovery only_said(const realtime::Record& record) {
  proto::Recovery out;
  const bool well = record.phase != realtime::Phase::kError && record.phase != realtime::Phase::kConnecting;
  out.set_recovered(well);
  if (!well) out.set_obstacle(proto::IN_REFLEX);
  return out;
}

}  // namespace

Recovery::Recovery(realtime::Door& door, const ConnectedArm& arm, const RecoveryConfig& lab, MoveBack move_back)
    : door_(door), arm_(arm), lab_(lab), move_back_(std::move(move_back)) {}

void Recovery::after_error(const realtime::SkillResult&, const realtime::Record& record, const proto::RecoveryPolicy&,
                           Answer answer) {
  answer(only_said(record));
}
void Recovery::after(realtime::Ending) {}
void Recovery::ask(const proto::Recover&, bool, const realtime::Record& now, Answer answer) { answer(only_said(now)); }
void Recovery::take_results() {}
void Recovery::stop() {}
void Recovery::abandon(const std::string&) {}

}  // namespace server
