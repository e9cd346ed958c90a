// The layouts against those of the vendor's compiled headers (data/layout-v5.csv, data/layout-v10.csv),
// field by field and in both directions.

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <random>
#include <sstream>

#include "wire/fci/gripper.hpp"
#include "wire/fci/robot_command.hpp"
#include "wire/fci/service.hpp"

namespace fci {
namespace {

struct Measured {
  std::size_t offset = 0, size = 0, count = 1;
  bool operator==(const Measured&) const = default;
};
using Struct = std::map<std::string, Measured>;  // by field; "(total)" has the size alone

std::ostream& operator<<(std::ostream& out, const Measured& m) {
  return out << "{offset " << m.offset << ", size " << m.size << ", count " << m.count << "}";
}

std::map<std::string, Struct> vendor(int version) {
  std::ifstream file(std::string(REPOSITORY_DIR) + "/tests/wire/data/layout-v" + std::to_string(version) + ".csv");
  EXPECT_TRUE(file) << "no layout of version " << version;
  std::map<std::string, Struct> structs;
  std::string line;
  std::getline(file, line);
  while (std::getline(file, line)) {
    std::istringstream row(line);
    std::string name, field, offset, size, type, count;
    std::getline(row, name, ',');
    std::getline(row, field, ',');
    std::getline(row, offset, ',');
    std::getline(row, size, ',');
    std::getline(row, type, ',');
    std::getline(row, count, ',');
    structs[name][field] = field == "(total)" ? Measured{0, std::stoul(offset), 1}
                                              : Measured{std::stoul(offset), std::stoul(size), std::stoul(count)};
  }
  return structs;
}

template <class T>
Struct ours(Version version) {
  Lister lister(version);
  T value{};
  walk(lister, value);
  Struct fields;
  for (const Field& field : lister.fields) fields[field.name] = {field.offset, field.size, field.count};
  fields["(total)"] = {0, lister.total, 1};
  return fields;
}

std::map<std::string, Struct> all_of_ours(Version version) {
  std::map<std::string, Struct> structs;
  structs["robot.RobotState"] = ours<RobotState>(version);
  structs["robot.RobotCommand"] = ours<RobotCommand>(version);
  structs["robot.CommandHeader"] = ours<Header>(version);
  structs["robot.Connect.Request"] = ours<Connect>(version);
  structs["robot.Connect.Response"] = ours<ConnectResponse>(version);
  structs["robot.Move.Request"] = ours<Move>(version);
  structs["robot.SetCollisionBehavior.Request"] = ours<SetCollisionBehavior>(version);
  structs["robot.SetJointImpedance.Request"] = ours<SetJointImpedance>(version);
  structs["robot.SetCartesianImpedance.Request"] = ours<SetCartesianImpedance>(version);
  structs["robot.SetGuidingMode.Request"] = ours<SetGuidingMode>(version);
  structs["robot.SetEEToK.Request"] = ours<SetEEToK>(version);
  structs["robot.SetNEToEE.Request"] = ours<SetNEToEE>(version);
  structs["robot.SetLoad.Request"] = ours<SetLoad>(version);
  if (command_id(version, Command::kGetCartesianLimit)) {
    structs["robot.GetCartesianLimit.Request"] = ours<GetCartesianLimit>(version);
    structs["robot.GetCartesianLimit.Response"] = ours<GetCartesianLimitResponse>(version);
  }
  if (command_id(version, Command::kSetFilters)) structs["robot.SetFilters.Request"] = ours<SetFilters>(version);
  if (command_id(version, Command::kLoadModelLibrary)) {
    structs["robot.LoadModelLibrary.Request"] = ours<LoadModelLibrary>(version);
  }
  structs["gripper.GripperState"] = ours<gripper::State>(version);
  structs["gripper.CommandHeader"] = ours<gripper::Header>(version);
  structs["gripper.Connect.Request"] = ours<gripper::Connect>(version);
  structs["gripper.Connect.Response"] = ours<gripper::ConnectResponse>(version);
  structs["gripper.Grasp.Request"] = ours<gripper::Grasp>(version);
  structs["gripper.Move.Request"] = ours<gripper::Move>(version);
  return structs;
}

class Layout : public testing::TestWithParam<int> {};

TEST_P(Layout, HasEveryFieldOfTheVendorsHeadersWhereItIsThere) {
  const auto theirs = vendor(GetParam());
  auto mine = all_of_ours(static_cast<Version>(GetParam()));
  for (const auto& [name, fields] : theirs) {
    // Bodies without a field (the response of Move) have nothing to compare.
    if (fields.size() == 1 && fields.at("(total)").size == 0) continue;
    ASSERT_TRUE(mine.contains(name)) << name;
    for (const auto& [field, measured] : fields) {
      ASSERT_TRUE(mine[name].contains(field)) << name << "." << field;
      EXPECT_EQ(mine[name][field], measured) << name << "." << field;
    }
  }
}

TEST_P(Layout, HasNoFieldThatTheVendorsHeadersLack) {
  const auto theirs = vendor(GetParam());
  for (const auto& [name, fields] : all_of_ours(static_cast<Version>(GetParam()))) {
    ASSERT_TRUE(theirs.contains(name)) << name;
    for (const auto& [field, measured] : fields) {
      EXPECT_TRUE(theirs.at(name).contains(field)) << name << "." << field;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Versions, Layout, testing::Values(5, 10));

// Which member a field of the table is.
class MembersOf : public Visitor<MembersOf> {
 public:
  explicit MembersOf(Version version) : Visitor(version) {}
  template <class Wire, class T>
  void field(const char* name, T& member) {
    of[name] = &member;
  }
  std::map<std::string, const void*> of;
};

// Client and simulated arm share the table: two members that had changed places in it would be seen by others alone.
TEST(Members, EachFieldIsTheMemberOfItsName) {
  RobotState s;
  RobotCommand c;
  MembersOf state(kNewestVersion), command(kNewestVersion);
  walk(state, s);
  walk(command, c);
#define STATE(name) {#name, &s.name}
  const std::map<std::string, const void*> members = {
      STATE(message_id), STATE(O_T_EE), STATE(O_T_EE_d), STATE(F_T_EE), STATE(EE_T_K), STATE(F_T_NE), STATE(NE_T_EE),
      STATE(m_ee), STATE(I_ee), STATE(F_x_Cee), STATE(m_load), STATE(I_load), STATE(F_x_Cload), STATE(elbow), STATE(elbow_d),
      STATE(tau_J), STATE(tau_J_d), STATE(dtau_J), STATE(q), STATE(q_d), STATE(dq), STATE(dq_d), STATE(ddq_d),
      STATE(joint_contact), STATE(cartesian_contact), STATE(joint_collision), STATE(cartesian_collision),
      STATE(tau_ext_hat_filtered), STATE(O_F_ext_hat_K), STATE(K_F_ext_hat_K), STATE(O_dP_EE_d), STATE(O_ddP_O),
      STATE(elbow_c), STATE(delbow_c), STATE(ddelbow_c), STATE(O_T_EE_c), STATE(O_dP_EE_c), STATE(O_ddP_EE_c), STATE(theta),
      STATE(dtheta), STATE(accelerometer_top), STATE(accelerometer_bottom), STATE(motion_generator_mode),
      STATE(controller_mode), STATE(errors), STATE(reflex_reason), STATE(robot_mode), STATE(control_command_success_rate)};
  EXPECT_EQ(state.of, members);
#define COMMAND(group, name) {#group "." #name, &c.name}
  const std::map<std::string, const void*> of_command = {
      {"message_id", &c.message_id}, COMMAND(motion, q_c), COMMAND(motion, dq_c), COMMAND(motion, O_T_EE_c),
      COMMAND(motion, O_dP_EE_c), COMMAND(motion, elbow_c), COMMAND(motion, valid_elbow),
      COMMAND(motion, motion_generation_finished), COMMAND(control, tau_J_d), COMMAND(control, torque_command_finished)};
  EXPECT_EQ(command.of, of_command);
}

class EveryVersion : public testing::TestWithParam<int> {
 protected:
  Version version() const { return static_cast<Version>(GetParam()); }
};

// Fills every byte of a T with noise, reads it, writes it again.
template <class T>
void comes_back(Version version, std::mt19937& random) {
  const std::size_t size = size_of<T>(version);
  Lister lister(version);
  T value{};
  walk(lister, value);
  std::vector<std::byte> bytes(size);
  for (const Field& field : lister.fields) {
    const std::size_t element = field.size / field.count;
    for (std::size_t i = 0; i < field.count; ++i) {
      std::byte* at = bytes.data() + field.offset + i * element;
      const double real = std::uniform_real_distribution(-100.0, 100.0)(random);
      const float rounded = static_cast<float>(real);
      const bool bit = real > 0;
      if (element == 1) std::memcpy(at, &bit, 1);
      else if (element == 4) std::memcpy(at, &rounded, 4);
      else if (element == 8) std::memcpy(at, &real, 8);
    }
  }
  ASSERT_TRUE(read(version, bytes, value));
  std::vector<std::byte> again(size);
  EXPECT_EQ(write(version, value, again), size);
  EXPECT_EQ(again, bytes);
  EXPECT_FALSE(read(version, std::span<const std::byte>(bytes).first(size - 1), value));
}

TEST_P(EveryVersion, StatesCommandsAndSettersComeBackAsTheyWent) {
  std::mt19937 random(7);
  for (int k = 0; k < 20; ++k) {
    comes_back<RobotState>(version(), random);
    comes_back<RobotCommand>(version(), random);
    comes_back<SetCollisionBehavior>(version(), random);
    comes_back<SetLoad>(version(), random);
    comes_back<SetGuidingMode>(version(), random);
    comes_back<gripper::Grasp>(version(), random);
  }
}

TEST_P(EveryVersion, NoStateOrCommandOrRequestIsLargerThanTheRoomForIt) {
  EXPECT_LE(size_of<RobotState>(version()), kMaxStateSize);
  EXPECT_LE(size_of<RobotCommand>(version()), kMaxCommandSize);
  EXPECT_LE(kHeaderSize + size_of<SetCollisionBehavior>(version()), kMaxRequestSize);
}

TEST_P(EveryVersion, MoveCountsItsMotionGeneratorsFromJointPosition) {
  std::array<std::byte, kMaxRequestSize> bytes{};
  for (auto generator : {MotionGeneratorMode::kJointPosition, MotionGeneratorMode::kJointVelocity,
                         MotionGeneratorMode::kCartesianPosition, MotionGeneratorMode::kCartesianVelocity,
                         MotionGeneratorMode::kNone}) {
    Move move;
    move.controller_mode = ControllerMode::kExternal;
    move.motion_generator_mode = generator;
    const std::size_t size = write_request(version(), 3, move, bytes);
    EXPECT_EQ(size, kHeaderSize + size_of<Move>(version()));
    std::uint32_t on_wire = 99;
    std::memcpy(&on_wire, bytes.data() + kHeaderSize + 4, 4);
    EXPECT_EQ(on_wire, static_cast<std::uint32_t>(generator) - 1);
    Move back;
    ASSERT_TRUE(read(version(), std::span<const std::byte>(bytes).subspan(kHeaderSize), back));
    EXPECT_EQ(back.motion_generator_mode, generator);
    EXPECT_EQ(back.controller_mode, ControllerMode::kExternal);
  }
}

TEST_P(EveryVersion, AModeThatThereIsNotIsReadAsNone) {
  for (std::uint32_t bad : {5u, 77u, 0xFFFFFFFFu}) {
    std::vector<std::byte> bytes(size_of<Move>(version()));
    std::memcpy(bytes.data(), &bad, 4);
    std::memcpy(bytes.data() + 4, &bad, 4);
    Move move;
    ASSERT_TRUE(read(version(), bytes, move));
    EXPECT_GT(static_cast<int>(move.controller_mode), static_cast<int>(ControllerMode::kOther));
    EXPECT_GT(static_cast<int>(move.motion_generator_mode), static_cast<int>(MotionGeneratorMode::kNone));
  }
}

INSTANTIATE_TEST_SUITE_P(Versions, EveryVersion, testing::Range(int{kOldestVersion}, kNewestVersion + 1));

}  // namespace
}  // namespace fci
