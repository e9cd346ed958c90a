#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "robot/driver.hpp"
#include "robot/mode.hpp"

namespace realtime {

// The robot's own settings: which are in force, as far as known, and the requests by which a motion gets those that it needs.
class RobotSettings {
 public:
  // `base`: for each motion, unless its skill says otherwise.
  explicit RobotSettings(const robot::Settings& base) : base_(base) {}

  // Whether a skill with these needs no request.
  bool in_force(const robot::Settings& skill) const noexcept;

  // What one of them will be in a motion of this skill; none: not known.
  template <class Setting>
  const std::optional<Setting>& to_be(std::optional<Setting> robot::Settings::* setting,
                                      const robot::Settings& skill) const noexcept {
    const auto& wanted = skill.*setting ? skill.*setting : base_.*setting;
    return wanted ? wanted : in_force_.*setting;
  }

  // From now on asks for all that is not in force: post() in each cycle, until answered().
  void ask(const robot::Settings& skill) noexcept;
  bool asked() const noexcept { return asked_; }  // ever
  void post(robot::Driver& driver) noexcept;
  // True if it is the answer to one of these requests.
  bool take(const robot::Answer& answer) noexcept;
  bool answered() const noexcept;
  // The first that is not.
  fci::Command silent() const noexcept;

 private:
  struct Setter {
    robot::Request request;
    std::optional<std::uint32_t> id;  // none: not sent yet
    bool answered = false;
  };

  const robot::Settings base_;
  robot::Settings in_force_;
  std::array<Setter, 6> setters_;
  std::size_t count_ = 0;
  bool asked_ = false;
};

}  // namespace realtime
