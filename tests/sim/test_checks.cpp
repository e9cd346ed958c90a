// The robot's motion checks over the wire: for each error a stream of commands that just exceeds a limit, and its twin
// that just does not.

#include <cmath>
#include <functional>

#include "models/arm.hpp"
#include "raw_client.hpp"
#include "sim/robot/dt.hpp"
#include "thresholds.hpp"

namespace {

using namespace testing_tools;
using fci::ControllerMode;
using fci::Error;
using fci::RobotMode;
using fci::Status;
using Mode = fci::MotionGeneratorMode;

using sim::kDt;
constexpr double kOver = 1.03, kUnder = 0.97;
constexpr int kSettle = 5;  // cycles before a profile begins: the start is known in float32

// Displacements of a motion from rest to rest, cycle by cycle, whose backward differences reach these figures exactly:
// jerk at its ends, acceleration in its ramps, velocity between them. In any unit.
std::vector<double> profile(double jerk, double acceleration, int hold, int coast = 10) {
  std::vector<double> a;
  const int ramp = static_cast<int>(std::ceil(acceleration / (jerk * kDt) - 1e-9));
  for (int k = 1; k <= ramp; ++k) a.push_back(std::min(k * jerk * kDt, acceleration));
  a.insert(a.end(), hold, acceleration);
  for (int k = ramp - 1; k >= 1; --k) a.push_back(k * jerk * kDt);
  const std::vector<double> up = a;
  a.insert(a.end(), coast, 0.);
  for (double x : up) a.push_back(-x);
  std::vector<double> way(kSettle, 0.);
  double v = 0, s = 0;
  for (double x : a) {
    v += kDt * x;
    s += kDt * v;
    way.push_back(s);
  }
  way.insert(way.end(), 30, s);
  return way;
}

// The same with this velocity; jerk and acceleration at most as given.
std::vector<double> profile_of_velocity(double jerk, double acceleration, double velocity, int coast = 10) {
  const int hold = static_cast<int>(std::ceil(velocity / (acceleration * kDt)));
  auto way = profile(jerk, acceleration, hold, coast);
  double v = 0;
  for (std::size_t i = 1; i < way.size(); ++i) v = std::max(v, (way[i] - way[i - 1]) / kDt);
  for (double& s : way) s *= velocity / v;
  return way;
}

using Stream = std::function<fci::RobotCommand(const fci::RobotState& start, const fci::RobotState& now, int cycle)>;

struct System {
  std::string robot;
  int version;
};
void PrintTo(const System& system, std::ostream* out) { *out << system.robot << " " << system.version; }

class OfSystem : public testing::TestWithParam<System> {
 protected:
  OfSystem()
      : arm(GetParam().robot, lockstep(true)),
        client(arm, static_cast<fci::Version>(GetParam().version)),
        limits(models::limits(models::arm(GetParam().robot), static_cast<std::uint16_t>(GetParam().version))) {
    // Contact is another test's subject.
    EXPECT_EQ(client.ask(thresholds(1000, 1000)), Status::kSuccess);
  }

  // Runs a motion of so many cycles. The errors that ended it, with all that belongs to one; or the motion is finished
  // and there are none.
  std::string run(const fci::Move& move, int cycles, const Stream& stream, Status status = Status::kReflexAborted) {
    client.start(move);
    start = client.state;
    for (int i = 0; i < cycles; ++i) {
      before = client.state;
      client.send(stream(start, client.state, i));
      client.receive();
      if (client.state.robot_mode != RobotMode::kMove) break;
    }
    if (client.state.robot_mode == RobotMode::kMove) {
      EXPECT_EQ(client.finish(stream(start, client.state, cycles)), Status::kSuccess);
      EXPECT_FALSE(fci::any(client.state.errors)) << fci::names(client.state.errors);
      return "";
    }
    EXPECT_EQ(client.state.robot_mode, RobotMode::kReflex);
    EXPECT_EQ(client.state.motion_generator_mode, Mode::kIdle);
    EXPECT_NE(client.state.controller_mode, ControllerMode::kExternal);
    EXPECT_EQ(client.state.errors, client.state.reflex_reason);
    EXPECT_EQ(client.state.control_command_success_rate, 0);
    EXPECT_EQ(client.answer(client.move_id), status);
    const std::string errors = fci::names(client.state.errors);
    expect_smooth_stop();
    EXPECT_EQ(client.ask(fci::AutomaticErrorRecovery{}), recovery);
    EXPECT_EQ(RawClient::idle(client.fresh()), recovery == Status::kSuccess);
    return errors;
  }

  // From the reflex's first state on: the desired motion goes on and each joint brakes as hard as it may.
  void expect_smooth_stop() {
    fci::RobotState last = client.state;
    const double rounding = 1e-3;  // of a velocity by differences of float32
    for (int i = 0; i < 1000; ++i) {
      client.receive();
      const auto& now = client.state;
      double fastest = 0;
      if (now.message_id == last.message_id + 1) {
        for (int j = 0; j < 7; ++j) {
          EXPECT_LE(std::abs(now.dq_d[j] - last.dq_d[j]), limits.ddq_max[j] * kDt * 1.001) << "joint " << j + 1;
          EXPECT_NEAR((now.q_d[j] - last.q_d[j]) / kDt, now.dq_d[j], rounding);
          EXPECT_LT(std::abs(now.q_d[j] - now.q[j]), 0.06);
          fastest = std::max(fastest, std::abs(now.dq_d[j]));
        }
        if (fastest == 0) return;
      }
      last = now;
    }
    ADD_FAILURE() << "the arm does not come to rest";
  }

  // Commanded joints outside their range have one name since system 5.7.2.
  static Error range(Error before) { return GetParam().version >= 9 ? Error::kJointPositionLimits : before; }

  void go(const fci::Vector7& goal, double speed = 1) {
    const auto from = client.newest().q_d;
    double way = 0.01;
    for (int i = 0; i < 7; ++i) way = std::max(way, std::abs(goal[i] - from[i]));
    const int n = static_cast<int>(1000 * std::max(1.9 * way / speed, 1.3 * std::sqrt(way))) + 100;
    EXPECT_EQ(run({}, n + 20,
                  [&](const auto& begin, const auto&, int cycle) {
                    const double s = std::clamp(double(cycle - kSettle) / n, 0., 1.);
                    const double share = s * s * s * (10 - 15 * s + 6 * s * s);
                    fci::RobotCommand command;
                    for (int i = 0; i < 7; ++i) command.q_c[i] = begin.q_d[i] + share * (goal[i] - begin.q_d[i]);
                    return command;
                  }),
              "");
  }

  // One joint along a profile, towards the middle of its range, by positions or velocities.
  std::string move_joint(int joint, const std::vector<double>& way, Mode mode = Mode::kJointPosition, int sign = 0) {
    const fci::Move move{.motion_generator_mode = mode};
    return run(move, static_cast<int>(way.size()), [&](const auto& begin, const auto&, int cycle) {
      const double middle = (limits.q_min[joint] + limits.q_max[joint]) / 2;
      const double direction = sign != 0 ? sign : begin.q_d[joint] < middle ? 1 : -1;
      const auto at = std::min<std::size_t>(cycle, way.size() - 1);
      fci::RobotCommand command;
      command.q_c = begin.q_d;
      command.q_c[joint] += direction * way[at];
      command.dq_c[joint] = direction * (at == 0 ? 0 : way[at] - way[at - 1]) / kDt;
      return command;
    });
  }

  // The tool, moved from where it is desired to be along or about an axis of O.
  static fci::RobotCommand moved(const fci::RobotState& begin, int axis, double by) {
    fci::RobotCommand command;
    command.O_T_EE_c = begin.O_T_EE_c;
    if (axis < 3) {
      command.O_T_EE_c[12 + axis] += by;
      return command;
    }
    const int u = (axis - 2) % 3, v = (axis - 1) % 3;
    for (int column = 0; column < 3; ++column) {
      const double a = begin.O_T_EE_c[4 * column + u], b = begin.O_T_EE_c[4 * column + v];
      command.O_T_EE_c[4 * column + u] = std::cos(by) * a - std::sin(by) * b;
      command.O_T_EE_c[4 * column + v] = std::sin(by) * a + std::cos(by) * b;
    }
    return command;
  }
  std::string move_tool(int axis, const std::vector<double>& way,
                        ControllerMode controller = ControllerMode::kCartesianImpedance) {
    return run({.controller_mode = controller, .motion_generator_mode = Mode::kCartesianPosition},
               static_cast<int>(way.size()), [&](const auto& begin, const auto&, int cycle) {
                 return moved(begin, axis, way[std::min<std::size_t>(cycle, way.size() - 1)]);
               });
  }
  // The elbow alone.
  std::string move_elbow(const std::vector<double>& way) {
    return run({.motion_generator_mode = Mode::kCartesianPosition}, static_cast<int>(way.size()),
               [&](const auto& begin, const auto&, int cycle) {
                 fci::RobotCommand command = moved(begin, 0, 0);
                 command.valid_elbow = true;
                 command.elbow_c = begin.elbow_c;
                 command.elbow_c[0] += way[std::min<std::size_t>(cycle, way.size() - 1)];
                 return command;
               });
  }
  // Torques that make the joints follow velocities, from the start on.
  std::string drive_torques(int cycles, double gain,
                            const std::function<fci::Vector7(const fci::RobotState&, int)>& velocity,
                            Status status = Status::kReflexAborted) {
    const Mode alone = GetParam().version >= 7 ? Mode::kNone : Mode::kJointVelocity;
    fci::Vector7 last{};
    return run(
        {.controller_mode = ControllerMode::kExternal, .motion_generator_mode = alone}, cycles,
        [&](const auto&, const auto& now, int cycle) {
          fci::RobotCommand command;
          const auto wanted = velocity(now, cycle);
          for (int i = 0; i < 7; ++i) {
            const double tau = gain * (i < 4 ? 20 : 4) * (wanted[i] - now.dq[i]);
            last[i] = command.tau_J_d[i] = std::clamp(tau, last[i] - 0.95, last[i] + 0.95);
          }
          return command;
        },
        status);
  }

  DrivenArm arm;
  RawClient client;
  const models::Limits& limits;
  Status recovery = Status::kSuccess;  // what the answer to it must be
  fci::RobotState start, before;       // of the motion that ran last: its first state, and the last that was answered
};

std::vector<System> systems() { return {{"fer", 5}, {"fr3", 6}, {"fr3", 10}, {"fr3v2", 10}}; }
INSTANTIATE_TEST_SUITE_P(Systems, OfSystem, testing::ValuesIn(systems()), [](const auto& info) {
  return info.param.robot + "Version" + std::to_string(info.param.version);
});

std::string list(std::initializer_list<Error> errors) {
  fci::Errors bits{};
  for (Error error : errors) bits[static_cast<std::size_t>(error)] = true;
  return fci::names(bits);
}

constexpr fci::Vector7 kHome = models::kHome;

// --- joints ----------------------------------------------------------------------------------------------------------

TEST_P(OfSystem, HoldsEachJointToItsJerkAndAcceleration) {
  const auto jerk = list({Error::kJointAccelerationDiscontinuity});
  const auto acceleration = list({Error::kJointVelocityDiscontinuity});
  for (int i = 0; i < 7; ++i) {
    for (const Mode mode : {Mode::kJointPosition, Mode::kJointVelocity}) {
      const double J = limits.dddq_max[i], A = limits.ddq_max[i];
      EXPECT_EQ(move_joint(i, profile(kOver * J, 0.9 * A, 2), mode), jerk) << "joint " << i + 1;
      EXPECT_EQ(move_joint(i, profile(kUnder * J, 0.9 * A, 2), mode), "") << "joint " << i + 1;
      EXPECT_EQ(move_joint(i, profile(0.9 * J, kOver * A, 2), mode), acceleration) << "joint " << i + 1;
      EXPECT_EQ(move_joint(i, profile(0.9 * J, kUnder * A, 2), mode), "") << "joint " << i + 1;
    }
  }
}

TEST_P(OfSystem, HoldsJointsToTheirVelocity) {
  auto q = kHome;
  q[0] = -0.6;
  for (const int i : {0, 5}) {
    go(q);
    const double J = 0.9 * limits.dddq_max[i], A = 0.9 * limits.ddq_max[i];
    // From where it is to where FR3's envelope has not begun.
    const double V = std::min(limits.dq_max[i], 2.6);
    EXPECT_EQ(move_joint(i, profile_of_velocity(J, A, kUnder * V), Mode::kJointVelocity), "") << "joint " << i + 1;
    if (V < limits.dq_max[i]) continue;
    go(q);
    EXPECT_EQ(move_joint(i, profile_of_velocity(J, A, kOver * V), Mode::kJointVelocity),
              list({Error::kJointVelocityLimitsCommanded}));
  }
}

TEST_P(OfSystem, OpensItsVelocityEnvelopeWithTheDistanceToTheLimit) {
  if (limits.envelope_deceleration[0] == 0) GTEST_SKIP() << "this model has none";
  auto q = kHome;
  q[0] = 1.6;
  go(q);
  constexpr double kSpeed = 1.2;
  const auto way = profile_of_velocity(0.9 * limits.dddq_max[0], 0.9 * limits.ddq_max[0], kSpeed, 2000);
  EXPECT_EQ(move_joint(0, way, Mode::kJointPosition, +1), list({Error::kJointVelocityLimitsCommanded}));
  EXPECT_NEAR(limits.dq_upper(0, before.q_d[0]), kSpeed, 0.02);
}

TEST_P(OfSystem, KeepsJointsInTheirRange) {
  auto q = kHome;
  q[3] = limits.q_max[3] - 0.15;
  q[2] = limits.q_max[2] - 0.15;
  go(q);
  const bool envelope = limits.envelope_deceleration[0] != 0;
  // FR3's envelope closes before the range ends; a creeping joint is stopped by it.
  const auto slow = profile_of_velocity(500, 1, 0.05, 4000);
  EXPECT_EQ(move_joint(3, slow, Mode::kJointPosition, +1),
            list({envelope ? Error::kJointVelocityLimitsCommanded : range(Error::kJointPositionLimitsCommanded)}));
  EXPECT_NEAR(before.q_d[3], limits.q_max[3], envelope ? 0.03 : 1e-4);
  EXPECT_EQ(move_joint(3, profile(500, 1, 100), Mode::kJointPosition, -1), "") << "there is a way back";
  // All that a jump breaks is raised together.
  EXPECT_EQ(run({}, 10,
                [&](const auto& begin, const auto&, int cycle) {
                  fci::RobotCommand command;
                  command.q_c = begin.q_d;
                  if (cycle > 3) command.q_c[2] += 0.16;
                  return command;
                }),
            list({range(Error::kJointPositionLimitsCommanded), Error::kJointVelocityLimitsCommanded,
                  Error::kJointVelocityDiscontinuity, Error::kJointAccelerationDiscontinuity}));
}

TEST_P(OfSystem, StartsWhereItIs) {
  const auto first = [&](double by) {
    return run({}, 5, [&](const auto& begin, const auto&, int) {
      fci::RobotCommand command;
      command.q_c = begin.q_d;
      command.q_c[4] += by;
      return command;
    });
  };
  EXPECT_EQ(first(0.11), list({Error::kJointStartPoseInvalid}));
  EXPECT_EQ(first(0.09), list({Error::kJointVelocityLimitsCommanded, Error::kJointVelocityDiscontinuity,
                               Error::kJointAccelerationDiscontinuity}));
  EXPECT_EQ(first(0.5e-6 * limits.dddq_max[4] * kDt), "");
}

// --- poses -----------------------------------------------------------------------------------------------------------

TEST_P(OfSystem, StartsAtThePoseAndWithTheElbowThatItHas) {
  const fci::Move move{.motion_generator_mode = Mode::kCartesianPosition};
  const auto pose = [&](int axis, double by) {
    return run(move, 5, [&](const auto& begin, const auto&, int) { return moved(begin, axis, by); });
  };
  const auto rates = list({Error::kCartesianVelocityLimits, Error::kCartesianVelocityDiscontinuity,
                           Error::kCartesianAccelerationDiscontinuity});
  EXPECT_EQ(pose(1, 0.051), list({Error::kCartesianStartPoseInvalid}));
  EXPECT_EQ(pose(1, 0.049), rates);
  EXPECT_EQ(pose(4, -0.21), list({Error::kCartesianStartPoseInvalid}));
  EXPECT_EQ(pose(4, -0.19), rates);
  EXPECT_EQ(pose(2, 1e-9), "");

  for (const Mode mode : {Mode::kCartesianPosition, Mode::kCartesianVelocity}) {
    const auto elbow = [&](double by, double sign) {
      return run({.motion_generator_mode = mode}, 5, [&](const auto& begin, const auto&, int) {
        fci::RobotCommand command = moved(begin, 0, 0);
        command.valid_elbow = true;
        command.elbow_c = {begin.elbow_c[0] + by, sign * begin.elbow_c[1]};
        return command;
      });
    };
    EXPECT_EQ(elbow(0, 1), "");
    EXPECT_EQ(elbow(0.11, 1), list({Error::kCartesianStartElbowInvalid}));
    EXPECT_EQ(elbow(0, -1), list({Error::kCartesianElbowSignInconsistent}));
    EXPECT_EQ(elbow(-0.09, 1), rates);
  }
}

TEST_P(OfSystem, HoldsPosesToTheirVelocityAndJerk) {
  // About the tool's own axis the last joint turns alone, and the pose's limits are met before the joint's.
  const double J = 0.5 * limits.dddq_max[6], A = 0.8 * limits.ddq_max[6], V = limits.rotation.velocity;
  for (const auto controller : {ControllerMode::kJointImpedance, ControllerMode::kCartesianImpedance}) {
    go(kHome);
    EXPECT_EQ(move_tool(5, profile_of_velocity(J, A, kUnder * V), controller), "");
    go(kHome);
    EXPECT_EQ(move_tool(5, profile_of_velocity(J, A, kOver * V), controller), list({Error::kCartesianVelocityLimits}));
  }
  // A step of the acceleration: with less the joints' own jerk is met.
  go(kHome);
  for (const int axis : {1, 5}) {
    const auto& rates = axis < 3 ? limits.translation : limits.rotation;
    const auto step = [&](double jerk) { return move_tool(axis, profile(jerk, jerk * kDt, 0, 0)); };
    EXPECT_EQ(step(kOver * rates.jerk), list({Error::kCartesianAccelerationDiscontinuity}));
    EXPECT_EQ(step(kUnder * rates.jerk).find("cartesian_motion_generator_acceleration"), std::string::npos);
    const auto jump = profile(kOver * rates.acceleration / kDt, kOver * rates.acceleration, 3);
    EXPECT_EQ(move_tool(axis, jump),
              list({Error::kCartesianVelocityDiscontinuity, Error::kCartesianAccelerationDiscontinuity}));
  }
}

TEST_P(OfSystem, HoldsTheElbow) {
  const double J = limits.elbow.jerk, A = limits.elbow.acceleration;
  EXPECT_EQ(move_elbow(profile(0.3 * J, 0.2 * A, 50)), "");
  EXPECT_EQ(move_elbow(profile(kOver * J, 0.9 * A, 0)), list({Error::kCartesianAccelerationDiscontinuity}));
  const auto flip = [&](int at) {
    return run({.motion_generator_mode = Mode::kCartesianPosition}, 10, [&](const auto& begin, const auto&, int cycle) {
      fci::RobotCommand command = moved(begin, 0, 0);
      command.valid_elbow = true;
      command.elbow_c = {begin.elbow_c[0], cycle < at ? begin.elbow_c[1] : -begin.elbow_c[1]};
      return command;
    });
  };
  EXPECT_EQ(flip(5), list({Error::kCartesianElbowSignInconsistent}));
  EXPECT_EQ(flip(100), "");
  EXPECT_EQ(run({.motion_generator_mode = Mode::kCartesianPosition}, 10,
                [&](const auto& begin, const auto&, int cycle) {
                  fci::RobotCommand command = moved(begin, 0, 0);
                  command.valid_elbow = true;
                  command.elbow_c = {cycle < 5 ? begin.elbow_c[0] : limits.q_max[2] + 1e-3, begin.elbow_c[1]};
                  return command;
                }),
            list({Error::kCartesianElbowLimit}));
}

TEST_P(OfSystem, TellsTheSideOfTheElbowByTheFourthJoint) {
  for (const double offset : {-0.01, 0.01}) {
    auto q = kHome;
    q[3] = models::kElbowFlip + offset;
    go(q);
    EXPECT_EQ(client.newest().elbow_d[1], offset < 0 ? -1 : 1);
    EXPECT_EQ(client.state.elbow[1], offset < 0 ? -1 : 1);
  }
}

TEST_P(OfSystem, HoldsTheJointsOfAPoseToTheirLimits) {
  // Jerk and acceleration: a step of the pose's acceleration that is within its own limits.
  EXPECT_EQ(move_tool(2, profile(0.4 * limits.translation.jerk, 0.4 * limits.translation.jerk * kDt, 0, 0)),
            list({Error::kCartesianJointAccelerationDiscontinuity}));
  EXPECT_EQ(move_tool(2, profile(0.05 * limits.translation.jerk, 0.9 * limits.translation.acceleration, 60)),
            list({Error::kCartesianJointVelocityDiscontinuity}));
  EXPECT_EQ(move_tool(2, profile(0.05 * limits.translation.jerk, 0.05 * limits.translation.acceleration, 60)), "");
  // Position: the tool turns until its joint is at the end of its range.
  auto q = kHome;
  q[6] = limits.q_min[6] + 0.2;
  go(q);
  const bool envelope = limits.envelope_deceleration[0] != 0;
  EXPECT_EQ(move_tool(5, profile_of_velocity(500, 1, 0.2, 2000)),
            list({envelope ? Error::kCartesianJointVelocityLimits : range(Error::kCartesianJointPositionLimits)}));
  // All at once.
  go(kHome);
  q = kHome;
  q[6] = limits.q_min[6] + 0.001 + (envelope ? 0.05 : 0);
  go(q, 0.5);
  EXPECT_NE(move_tool(5, profile(0.9 * limits.rotation.jerk, 0.9 * limits.rotation.jerk * kDt, 10))
                .find("cartesian_motion_generator_joint_"),
            std::string::npos);
}

TEST_P(OfSystem, RefusesPosesThatAreNone) {
  const fci::Move move{.motion_generator_mode = Mode::kCartesianPosition};
  EXPECT_EQ(run(
                move, 5,
                [&](const auto& begin, const auto&, int cycle) {
                  fci::RobotCommand command = moved(begin, 0, 0);
                  for (int i = 0; cycle > 2 && i < 3; ++i) command.O_T_EE_c[i] *= -1;  // left-handed
                  return command;
                },
                Status::kInputErrorAborted),
            list({Error::kCartesianInvalidFrame}));
}

// --- torques and the arm itself --------------------------------------------------------------------------------------

TEST_P(OfSystem, HoldsTorquesToTheirRate) {
  const Mode alone = GetParam().version >= 7 ? Mode::kNone : Mode::kJointVelocity;
  for (int i = 0; i < 7; ++i) {
    for (const double share : {kUnder, kOver}) {
      const auto zigzag = [&](const auto&, const auto&, int cycle) {
        fci::RobotCommand command;
        command.tau_J_d[i] = (cycle % 2 != 0 ? 0.5 : -0.5) * share * kDt * limits.dtau_max[i];
        return command;
      };
      EXPECT_EQ(run({.controller_mode = ControllerMode::kExternal, .motion_generator_mode = alone}, 20, zigzag),
                share > 1 ? list({Error::kControllerTorqueDiscontinuity}) : "")
          << "joint " << i + 1;
    }
  }
}

TEST_P(OfSystem, StopsAnArmThatIsTooFast) {
  const auto spin = [&](double share) {
    go(kHome);
    const double V = share * limits.dq_max[6];
    return drive_torques(900, 1, [=](const auto&, int cycle) {
      return fci::Vector7{0, 0, 0, 0, 0, 0, -V * std::clamp(std::min(cycle, 600 - cycle) / 300., 0., 1.)};
    });
  };
  EXPECT_EQ(spin(0.9), "");
  EXPECT_EQ(spin(1.3), list({Error::kJointVelocity}));
}

// As a hand does with an arm in free drive: beyond the deviation that every libfranka asks for.
TEST_P(OfSystem, LetsTorquesTurnTheToolAroundAndEndThere) {
  auto q = kHome;
  q[6] = -1.7;
  go(q);
  const double way = 3.3;  // rad
  EXPECT_EQ(drive_torques(4500, 1, [&](const auto& now, int) {
              return fci::Vector7{0, 0, 0, 0, 0, 0, std::clamp(4 * (q[6] + way - now.q[6]), 0., 1.)};
            }), "");
  EXPECT_GT(client.newest().q[6] - q[6], 3.14);
}

TEST_P(OfSystem, StopsAToolThatIsTooFast) {
  fci::Pose long_tool = fci::kIdentityPose;
  long_tool[14] = 0.6;
  const auto swing = [&](double speed) {
    go({-1.2, -0.69, 0, -1.99, 0, 1.23, models::kHome[6]});
    EXPECT_EQ(client.ask(fci::SetNEToEE{long_tool}), Status::kSuccess);
    const auto way = profile_of_velocity(0.5 * limits.dddq_max[1], 0.9 * limits.ddq_max[1], speed, 100);
    return run({.motion_generator_mode = Mode::kJointVelocity}, static_cast<int>(way.size()),
               [&](const auto&, const auto&, int cycle) {
                 const auto at = std::min<std::size_t>(std::max(cycle, 1), way.size() - 1);
                 const double v = (way[at] - way[at - 1]) / kDt;
                 return fci::RobotCommand{.dq_c = {v, -v, 0, v, 0, v, 0}};
               });
  };
  const auto speed = [&] { return std::hypot(before.O_dP_EE_d[0], before.O_dP_EE_d[1], before.O_dP_EE_d[2]); };
  EXPECT_EQ(swing(0.4), "");
  EXPECT_EQ(swing(2.1), list({Error::kCartesianVelocity}));
  EXPECT_NEAR(speed() / limits.translation.velocity, 1.1, 0.05);
}

TEST_P(OfSystem, StopsAnArmThatUsesTooMuchPowerOrTorque) {
  const fci::Vector7 crouched = {-1.5, -1, 0, -2.2, 0, 1.6, models::kHome[6]};
  const auto all_at_once = [&](double speed) {
    go(crouched);
    return drive_torques(400, 10, [=](const auto&, int cycle) {
      const double v = cycle < 200 ? speed : 0;
      return fci::Vector7{v, v, 0, v, 0, 0, 0};
    });
  };
  EXPECT_EQ(all_at_once(0.2), "");
  EXPECT_EQ(all_at_once(4), list({Error::kPowerLimit}));

  const fci::Vector7 stretched = {0, 1.2, 0, -0.4, 0, 1.8, models::kHome[6]};
  const auto lift = [&](double speed) {
    go(stretched);
    return drive_torques(
        400, 1, [=](const auto&, int cycle) { return fci::Vector7{0, cycle < 200 ? -speed : 0, 0, 0, 0, 0, 0}; });
  };
  EXPECT_EQ(lift(0.3), "");
  EXPECT_EQ(lift(4), list({Error::kTauJRange}));
}

TEST_P(OfSystem, StopsAnArmThatLeavesItsRangeAndWantsItToBeGuidedBack) {
  auto q = kHome;
  q[6] = limits.q_max[6] - 0.15;
  go(q);
  const auto creep = [&](double beyond) {
    return drive_torques(2500, 0.5, [&, beyond](const auto& now, int) {
      return fci::Vector7{0, 0, 0, 0, 0, 0, std::clamp(4 * (limits.q_max[6] + beyond - now.q[6]), -0.2, 0.2)};
    });
  };
  EXPECT_EQ(creep(0.005), "") << "a little beyond is still tolerated";
  go(q);
  recovery = Status::kManualErrorRecoveryRequired;
  EXPECT_EQ(creep(0.05), list({Error::kJointPositionLimits}));
  EXPECT_NEAR(client.state.q[6], limits.q_max[6] + 0.01, 0.01);
}

TEST_P(OfSystem, StopsBeforeItMeetsItself) {
  const auto turn = [&](double way) {
    go({0, -0.5, 0, -2.7, 0, 1.4, models::kHome[6]});
    const int coast = static_cast<int>(way / 0.3 / kDt);
    return move_joint(5, profile_of_velocity(0.5 * limits.dddq_max[5], 0.5 * limits.ddq_max[5], 0.3, coast),
                      Mode::kJointPosition, -1);
  };
  EXPECT_EQ(turn(0.4), "");
  EXPECT_EQ(turn(0.6), list({Error::kSelfCollisionAvoidance}));
  // There the hand's fingers are models::kCapsuleMargin from the shoulder, by another program's reckoning.
  EXPECT_NEAR(before.q_d[5], 0.937, 0.002);
  EXPECT_EQ(turn(0.1), "") << "the way out is open";
}

// --- what only this client can say: libfranka always asks for deviations that never are ------------------------------

struct OwnClient : testing::Test {
  DrivenArm arm{"fr3", lockstep()};
  RawClient client{arm, 10};

  std::string move(const fci::Move& request, double share_of_stiffness) {
    fci::SetJointImpedance soft{{3000, 3000, 3000, 2500, 2500, 2000, 2000}};
    for (double& stiffness : soft.K_theta) stiffness *= share_of_stiffness;
    EXPECT_EQ(client.ask(soft), Status::kSuccess);
    client.start(request);
    const auto begin = client.state;
    const auto way = profile_of_velocity(1000, 2, 0.5, 100);
    const auto make = [&](int cycle) {
      fci::RobotCommand command;
      command.q_c = begin.q_d;
      command.q_c[0] += way[std::min<std::size_t>(cycle, way.size() - 1)];
      return command;
    };
    const int cycles = static_cast<int>(way.size()) + 300;
    for (int i = 0; i < cycles && client.state.robot_mode == RobotMode::kMove; ++i) {
      client.send(make(i));
      client.receive();
    }
    if (client.state.robot_mode == RobotMode::kMove) client.finish(make(cycles));
    return fci::names(client.state.reflex_reason);
  }
};

TEST_F(OwnClient, max_path_pose_deviation_violation) {
  EXPECT_EQ(move({.maximum_path_deviation = {.translation = 0.03}}, 1), "");
  EXPECT_EQ(move({.maximum_path_deviation = {.translation = 0.0003}}, 0.02), list({Error::kMaxPathPoseDeviation}));
}

TEST_F(OwnClient, max_goal_pose_deviation_violation) {
  EXPECT_EQ(move({.maximum_goal_pose_deviation = {.translation = 0.01}}, 1), "");
  EXPECT_EQ(move({.maximum_goal_pose_deviation = {.translation = 1e-6}}, 0.1), list({Error::kMaxGoalPoseDeviation}));
}

}  // namespace
