#include "realtime/terminations/outside_box.hpp"

#include "realtime/check.hpp"

namespace realtime {

OutsideBox::OutsideBox(const Parameters& parameters) : parameters_(parameters) {
  constexpr double kFar = 10;  // m
  for (int i = 0; i < 3; ++i) {
    require_within("lower", i, parameters.lower[i], -kFar, kFar, "m");
    require_within("upper", i, parameters.upper[i], parameters.lower[i], kFar, "m");
  }
}

bool OutsideBox::step(const Cycle& cycle, const Progress&) noexcept {
  const Vector3 p = cycle.O_T_EE.translation();
  return (p.array() < parameters_.lower.array()).any() || (p.array() > parameters_.upper.array()).any();
}

}  // namespace realtime
