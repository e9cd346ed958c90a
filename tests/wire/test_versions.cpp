// What changes between protocol versions: sizes, ids of commands, bytes of statuses. The expectations are
// figures of the vendor's headers, version by version.

#include <gtest/gtest.h>

#include "wire/fci/robot_command.hpp"
#include "wire/fci/service.hpp"

namespace fci {
namespace {

struct Sizes {
  Version version;
  std::size_t state, command, move;  // bytes
};

TEST(Versions, HaveStatesAndCommandsOfTheseSizes) {
  for (const Sizes& sizes : {Sizes{5, 2373, 370, 56}, {6, 2373, 370, 56}, {7, 2373, 371, 56}, {8, 2373, 371, 56},
                             {9, 2373, 371, 56}, {10, 1377, 371, 113}}) {
    SCOPED_TRACE(sizes.version);
    EXPECT_EQ(size_of<RobotState>(sizes.version), sizes.state);
    EXPECT_EQ(size_of<RobotCommand>(sizes.version), sizes.command);
    EXPECT_EQ(size_of<Move>(sizes.version), sizes.move);
  }
}

constexpr int kNone = -1;

// Ids of Connect, Move, StopMove, GetCartesianLimit, SetCollisionBehavior, SetJointImpedance,
// SetCartesianImpedance, SetGuidingMode, SetEEToK, SetNEToEE, SetLoad, SetFilters, AutomaticErrorRecovery,
// LoadModelLibrary, GetRobotModel.
struct Ids {
  Version version;
  std::array<int, 15> ids;
};

TEST(Versions, GiveEachCommandThisId) {
  for (const Ids& expected : {Ids{5, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, kNone}},
                              {6, {0, 1, 2, kNone, 3, 4, 5, 6, 7, 8, 9, kNone, 10, 11, kNone}},
                              {7, {0, 1, 2, kNone, 3, 4, 5, 6, 7, 8, 9, kNone, 10, 11, kNone}},
                              {8, {0, 1, 2, kNone, 3, 4, 5, 6, 7, 8, 9, kNone, 10, 11, 12}},
                              {9, {0, 1, 2, kNone, 3, 4, 5, 6, 7, 8, 9, kNone, 10, 11, 12}},
                              {10, {0, 1, 2, kNone, 3, 4, 5, 6, 7, 8, 9, kNone, 10, kNone, 11}}}) {
    int count = 0;
    for (std::size_t i = 0; i < expected.ids.size(); ++i) {
      const auto command = static_cast<Command>(i);
      const auto id = command_id(expected.version, command);
      SCOPED_TRACE(std::string(name(command)) + " in version " + std::to_string(expected.version));
      EXPECT_EQ(id ? static_cast<int>(*id) : kNone, expected.ids[i]);
      if (!id) continue;
      ++count;
      EXPECT_EQ(command_of(expected.version, *id), command);
    }
    EXPECT_EQ(commands(expected.version).size(), count);
    EXPECT_FALSE(command_of(expected.version, static_cast<std::uint32_t>(count)));
    EXPECT_FALSE(command_of(expected.version, 0xFFFFFFFF));
  }
}

struct Answer {
  Command command;
  Status status;
  int to_5, from_6;  // bytes; kNone: there is no such answer
};

TEST(Versions, GiveEachStatusThisByte) {
  constexpr auto kMove = Command::kMove;
  constexpr auto kStop = Command::kStopMove;
  constexpr auto kRecover = Command::kAutomaticErrorRecovery;
  constexpr auto kSet = Command::kSetLoad;
  for (const Answer& answer : {
           Answer{kMove, Status::kSuccess, 0, 0},
           {kMove, Status::kMotionStarted, 1, 1},
           {kMove, Status::kPreempted, 2, 2},
           {kMove, Status::kPreemptedDueToActivatedSafetyFunctions, kNone, 3},
           {kMove, Status::kRejectedDueToActivatedSafetyFunctions, kNone, 4},
           {kMove, Status::kNotPossible, 3, 5},
           {kMove, Status::kStartAtSingularPose, 4, 6},
           {kMove, Status::kInvalidArgument, 5, 7},
           {kMove, Status::kReflexAborted, 6, 8},
           {kMove, Status::kEmergencyAborted, 7, 9},
           {kMove, Status::kInputErrorAborted, 8, 10},
           {kMove, Status::kAborted, 9, 11},
           {kStop, Status::kSuccess, 0, 0},
           {kStop, Status::kNotPossible, 1, 1},
           {kStop, Status::kRejectedDueToActivatedSafetyFunctions, kNone, 2},
           {kStop, Status::kEmergencyAborted, 2, 3},
           {kStop, Status::kReflexAborted, 3, 4},
           {kStop, Status::kAborted, 4, 5},
           {kRecover, Status::kSuccess, 0, 0},
           {kRecover, Status::kNotPossible, 1, 1},
           {kRecover, Status::kRejectedDueToActivatedSafetyFunctions, kNone, 2},
           {kRecover, Status::kManualErrorRecoveryRequired, 2, 3},
           {kRecover, Status::kReflexAborted, 3, 4},
           {kRecover, Status::kEmergencyAborted, 4, 5},
           {kRecover, Status::kAborted, 5, 6},
           {kSet, Status::kSuccess, 0, 0},
           {kSet, Status::kNotPossible, 1, 1},
           {kSet, Status::kInvalidArgument, 2, 2},
           {kSet, Status::kRejectedDueToActivatedSafetyFunctions, kNone, 3},
       }) {
    for (Version version = kOldestVersion; version <= kNewestVersion; ++version) {
      SCOPED_TRACE(std::string(name(answer.command)) + ", " + std::string(name(answer.status)) + ", version " +
                   std::to_string(version));
      const int expected = version <= 5 ? answer.to_5 : answer.from_6;
      const auto byte = status_byte(version, answer.command, answer.status);
      EXPECT_EQ(byte ? static_cast<int>(*byte) : kNone, expected);
      if (byte) {
        EXPECT_EQ(status_of(version, answer.command, *byte), answer.status);
      }
      EXPECT_FALSE(status_of(version, answer.command, 200));
    }
  }
}

TEST(Versions, NameTheErrorsAsLibfrankaDoes) {
  EXPECT_EQ(kErrorNames.size(), 41u);
  EXPECT_EQ(name(Error::kJointVelocityDiscontinuity), "joint_motion_generator_velocity_discontinuity");
  EXPECT_EQ(name(Error::kCommunicationConstraints), "communication_constraints_violation");
  EXPECT_EQ(name(Error::kControllerTorqueDiscontinuity), "controller_torque_discontinuity");
  Errors errors{};
  EXPECT_FALSE(any(errors));
  errors[6] = errors[25] = true;
  EXPECT_EQ(names(errors), "joint_reflex, communication_constraints_violation");
}

}  // namespace
}  // namespace fci
