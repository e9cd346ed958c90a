#include "realtime/terminations/wrench_above.hpp"

#include <cmath>

#include "realtime/check.hpp"

namespace realtime {

WrenchAbove::WrenchAbove(const Parameters& parameters) : parameters_(parameters) {
  const bool force = parameters.part == Part::kForce;
  require_within("threshold", -1, parameters.threshold, 0, force ? 1000 : 300, force ? "N" : "N m");
  if (!parameters.axis) return;
  require_within("norm of axis", -1, parameters.axis->norm(), 1e-6, 1e6, "");
  parameters_.axis = parameters.axis->normalized();
}

bool WrenchAbove::step(const Cycle& cycle, const Progress&) noexcept {
  const auto& wrench = parameters_.frame == Frame::kBase ? cycle.state.O_F_ext_hat_K : cycle.state.K_F_ext_hat_K;
  const Vector3 now = Vector3::Map(wrench.data() + (parameters_.part == Part::kForce ? 0 : 3));
  if (!begun_) bias_ = parameters_.relative ? now : Vector3(Vector3::Zero());
  begun_ = true;
  const Vector3 felt = now - bias_;
  return (parameters_.axis ? std::abs(felt.dot(*parameters_.axis)) : felt.norm()) > parameters_.threshold;
}

}  // namespace realtime
