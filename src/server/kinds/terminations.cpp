#include <utility>

#include "frankapy/proto/terminations.pb.h"
#include "realtime/terminations/composite.hpp"
#include "realtime/terminations/contact.hpp"
#include "realtime/terminations/final_joint.hpp"
#include "realtime/terminations/final_pose.hpp"
#include "realtime/terminations/moved.hpp"
#include "realtime/terminations/never.hpp"
#include "realtime/terminations/outside_box.hpp"
#include "realtime/terminations/sensor_says.hpp"
#include "realtime/terminations/silence.hpp"
#include "realtime/terminations/time.hpp"
#include "realtime/terminations/velocity_below.hpp"
#include "realtime/terminations/wrench_above.hpp"
#include "server/kinds/kind.hpp"
#include "server/registry.hpp"

namespace server {
namespace {

using realtime::SoftEnding;

template <class Message, class Make>
auto termination(Make make) {
  return kind<realtime::Termination, Message>(make);
}

template <class Message>
realtime::WrenchAbove* wrench_above(realtime::WrenchAbove::Part part, const Message& m) {
  using Frame = realtime::WrenchAbove::Frame;
  return new realtime::WrenchAbove({part, m.threshold(), given<3>(m.axis()),
                                    m.frame() == proto::ForceAbove::BASE ? Frame::kBase : Frame::kStiffness, m.relative()});
}

template <class Message>
realtime::Judged judged(const Message& m) {
  return m.judged() == proto::FinalJoint::ARM ? realtime::Judged::kArm : realtime::Judged::kReference;
}

template <class Composite>
Composite* composite(const google::protobuf::RepeatedPtrField<google::protobuf::Any>& of, const realtime::Arm& arm) {
  if (of.empty()) throw std::invalid_argument("of is empty: expected at least one termination");
  realtime::Terminations parts;
  std::vector<std::uint16_t> numbers;
  for (const auto& each : of) {
    parts.push_back(make_termination(each, arm));
    numbers.push_back(number_of(kind_of(each)));
    if (SoftEnding* then = parts.back()->then(); then != nullptr && then->what != realtime::AfterContact::kHeld) {
      throw std::invalid_argument(kind_of(each) + ".then is looked at only where it ends the skill by itself: give it beside this one");
    }
  }
  return new Composite(std::move(parts), std::move(numbers));
}

}  // namespace

std::vector<Kind<realtime::Termination>>& terminations() {
  static std::vector<Kind<realtime::Termination>> kinds = {
      termination<proto::Time>([](const auto& m, const auto&) {
        return new realtime::Time(
            {given(m.has_seconds(), m.seconds()), given(m.has_after_trajectory(), m.after_trajectory())});
      }),
      termination<proto::FinalJoint>([](const auto& m, const auto&) {
        return new realtime::FinalJoint({vector<7>(m.threshold()), judged(m)});
      }),
      termination<proto::FinalPose>([](const auto& m, const auto&) {
        return new realtime::FinalPose({vector<3>(m.position_threshold()), m.orientation_threshold(), judged(m)});
      }),
      termination<proto::Contact>([](const auto& m, const auto& arm) {
        SoftEnding then;
        if (m.has_then()) then = std::move(*make_ending(m.then(), arm));
        using Estimate = realtime::Contact::Estimate;
        return new realtime::Contact({m.cartesian(), m.joint(), given<6>(m.force_thresholds()), given<7>(m.torque_thresholds()),
                                      m.estimate() == proto::Contact::OBSERVER ? Estimate::kObserver : Estimate::kRobot},
                                     std::move(then), arm.reflex);
      }),
      termination<proto::ForceAbove>([](const auto& m, const auto&) {
        return wrench_above(realtime::WrenchAbove::Part::kForce, m);
      }),
      termination<proto::TorqueAbove>([](const auto& m, const auto&) {
        return wrench_above(realtime::WrenchAbove::Part::kTorque, m);
      }),
      termination<proto::Moved>([](const auto& m, const auto&) {
        return new realtime::Moved({given(m.has_distance(), m.distance()), given(m.has_angle(), m.angle())});
      }),
      termination<proto::OutsideBox>([](const auto& m, const auto&) {
        return new realtime::OutsideBox({vector<3>(m.lower()), vector<3>(m.upper())});
      }),
      termination<proto::VelocityBelow>([](const auto& m, const auto&) {
        return new realtime::VelocityBelow({m.threshold(), m.duration(), m.after()});
      }),
      termination<proto::Never>([](const auto&, const auto&) { return new realtime::Never; }),
      termination<proto::AnyOf>([](const auto& m, const auto& arm) {
        return composite<realtime::AnyOf>(m.of(), arm);
      }),
      termination<proto::AllOf>([](const auto& m, const auto& arm) {
        return composite<realtime::AllOf>(m.of(), arm);
      }),
      termination<proto::SensorSays>([](const auto& m, const auto&) { return new realtime::SensorSays(m.topic()); }),
      termination<proto::Silence>([](const auto& m, const auto&) { return new realtime::Silence(m.topic(), m.seconds()); }),
  };
  return kinds;
}

}  // namespace server
