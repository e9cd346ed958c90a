#include "frankapy/proto/endings.pb.h"
#include "realtime/controllers/joint_impedance.hpp"
#include "server/kinds/kind.hpp"

namespace server {

std::vector<Kind<realtime::SoftEnding>>& endings() {
  using realtime::AfterContact;
  using realtime::SoftEnding;
  static std::vector<Kind<SoftEnding>> kinds = {
      kind<SoftEnding, proto::Comply>([](const auto& m, const auto& arm) {
        const realtime::JointImpedance::Parameters soft{vector<7>(m.stiffness()), realtime::Vector7::Zero(), m.damping_ratio()};
        return new SoftEnding{AfterContact::kComplied, std::make_unique<realtime::JointImpedance>(soft, arm.model.mass())};
      }),
      kind<SoftEnding, proto::BackOff>([](const auto& m, const auto&) {
        return new SoftEnding{AfterContact::kBackedOff, nullptr, m.distance(), m.speed()};
      }),
  };
  return kinds;
}

}  // namespace server
