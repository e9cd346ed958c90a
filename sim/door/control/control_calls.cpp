#include "sim/door/control/control_calls.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "wire/proto/validation.hpp"

namespace sim {
namespace {

namespace proto = frankapy::proto;
using proto::SimulationCall;
using proto::SimulationReply;

[[noreturn]] void refuse(const std::string& text) { throw wire::Invalid(text); }

template <std::size_t n, class Values>
std::array<double, n> array(const Values& values) {
  std::array<double, n> out;
  std::copy(values.begin(), values.end(), out.begin());
  return out;
}

template <class Message>
std::array<double, 7> pose_of(const Message& message) {
  std::array<double, 7> pose;
  std::copy(message.position().begin(), message.position().end(), pose.begin());
  std::copy(message.quaternion().begin(), message.quaternion().end(), pose.begin() + 3);
  return pose;
}

Hold hold(const proto::Hold& message) {
  Hold at;
  if (message.has_link()) at.link = static_cast<int>(message.link());
  if (message.point_size() > 0) at.point = array<3>(message.point());
  return at;
}

VirtualHand virtual_hand(const proto::Pull& pull) {
  if (pull.positions_size() != 3 * pull.times_size()) {
    refuse(fmt::format("Pull.positions has {} elements for {} times: expected 3 for each", pull.positions_size(),
                       pull.times_size()));
  }
  VirtualHand hand{{}, pull.stiffness(), pull.damping(), pull.max_force()};
  for (int i = 0; i < pull.times_size(); ++i) {
    if (i > 0 && pull.times(i) <= pull.times(i - 1)) {
      refuse(fmt::format("Pull.times[{}] is {} s after {} s: expected times that grow", i, pull.times(i), pull.times(i - 1)));
    }
    hand.path.push_back({pull.times(i), {pull.positions(3 * i), pull.positions(3 * i + 1), pull.positions(3 * i + 2)}});
  }
  return hand;
}

Object object(const proto::AddObject& add) {
  constexpr int kSizes[] = {3, 1, 2, 2};
  if (add.size_size() != kSizes[add.shape()]) {
    refuse(fmt::format("AddObject.size has {} elements: a {} has {}", add.size_size(),
                       proto::AddObject::Shape_Name(add.shape()), kSizes[add.shape()]));
  }
  const std::string& name = add.name();
  if (name.empty() || name.size() > 100 || !std::all_of(name.begin(), name.end(), [](unsigned char c) {
        return std::isalnum(c) || c == '_' || c == '-';
      })) {
    refuse("AddObject.name is \"" + name + "\": expected letters, digits, _ and -, 1 to 100");
  }
  Object object;
  object.name = name;
  object.shape = static_cast<Object::Shape>(add.shape());
  std::copy(add.size().begin(), add.size().end(), object.size.begin());
  object.mass = add.mass();
  object.pose = pose_of(add);
  object.friction = add.friction();
  std::copy(add.colour().begin(), add.colour().end(), object.colour.begin());
  return object;
}

Network::Way way(const proto::SetNetwork::Way& way) {
  return {way.loss(), way.delayed(), static_cast<std::int64_t>(1e9 * way.delay())};
}

fci::Error error_of(const std::string& name) {
  const auto found = std::find(fci::kErrorNames.begin(), fci::kErrorNames.end(), name);
  if (found == fci::kErrorNames.end()) {
    refuse(fmt::format("no error is called \"{}\"; there are {}", name, fmt::join(fci::kErrorNames, ", ")));
  }
  return static_cast<fci::Error>(found - fci::kErrorNames.begin());
}

}  // namespace

ControlCalls::ControlCalls(Cell& cell, std::size_t arm) : cell_(cell), arm_(arm) {}

std::string ControlCalls::answer(std::span<const std::byte> bytes) {
  SimulationReply reply;
  SimulationCall call;
  if (call.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
    reply = answer(call);
  } else {
    reply.set_error(fmt::format("{} bytes that are no SimulationCall: expected one in one frame", bytes.size()));
  }
  return reply.SerializeAsString();
}

SimulationReply ControlCalls::answer(SimulationCall& call) {
  SimulationReply reply;
  const auto ask = [this](auto&& task) { cell_.ask(std::forward<decltype(task)>(task)); };
  try {
    wire::validate(call);
    World& world = cell_.world();
    Robot& robot = cell_.robot(arm_);
    switch (call.call_case()) {
      case SimulationCall::CALL_NOT_SET: refuse("SimulationCall has no call");
      case SimulationCall::kGetTruth: break;
      case SimulationCall::kPush:
        ask([&] {
          const proto::Push& push = call.push();
          world.push(array<6>(push.wrench()), push.duration(), arm_, hold(push.at()));
        });
        break;
      case SimulationCall::kPull: {
        const VirtualHand hand = virtual_hand(call.pull());
        ask([&] { world.pull(hand, call.pull().duration(), arm_, hold(call.pull().at())); });
        break;
      }
      case SimulationCall::kMoveObject:
        ask([&] { world.move_object(call.move_object().name(), pose_of(call.move_object()), arm_); });
        break;
      case SimulationCall::kAddObject: {
        const Object added = object(call.add_object());
        ask([&] { world.add_object(added, arm_); });
        break;
      }
      case SimulationCall::kSetFriction:
        ask([&] { world.set_friction(call.set_friction().name(), call.set_friction().friction()); });
        break;
      case SimulationCall::kTakeImage: put_image(call.take_image(), *reply.mutable_image()); return reply;
      case SimulationCall::kPressButton:
        ask([&] {
          const bool pressed = call.press_button().pressed();
          switch (call.press_button().button()) {
            case proto::PressButton::USER_STOP: return robot.user_stop(pressed);
            case proto::PressButton::ENABLING_DEVICE: return robot.enabling_device(pressed);
            case proto::PressButton::GUIDING: return robot.guide(pressed);
            case proto::PressButton::JOINT_LOCK:
              if (pressed && (robot.moving() || robot.state().robot_mode == fci::RobotMode::kGuiding)) {
                refuse("the arm moves, or is being guided: its joints are locked when it rests");
              }
              return robot.lock(pressed);
          }
        });
        break;
      case SimulationCall::kInjectError: {
        const fci::Error error = error_of(call.inject_error().name());
        ask([&] { robot.inject(error); });
        break;
      }
      case SimulationCall::kSetVirtualWall: {
        const proto::SetVirtualWall& set = call.set_virtual_wall();
        const std::array<double, 7> at = pose_of(set);
        VirtualWall wall{Eigen::Vector3d(set.size(0), set.size(1), set.size(2)), Eigen::Isometry3d::Identity(), set.active()};
        wall.frame.translate(Eigen::Vector3d(at[0], at[1], at[2])).rotate(Eigen::Quaterniond(at[3], at[4], at[5], at[6]));
        ask([&] { robot.set_virtual_wall(static_cast<int>(set.id()), wall); });
        break;
      }
      case SimulationCall::kSetNetwork:
        ask([&] {
          const proto::SetNetwork& network = call.set_network();
          cell_.network(arm_).set(way(network.to_arm()), way(network.from_arm()), network.seed());
        });
        break;
      case SimulationCall::kPause:
        ask([&] {
          cell_.set_time(call.pause().kind() == proto::Pause::ALL ? Cell::Time::kPaused
                                                                  : Cell::Time::kBetweenMotionsPaused);
        });
        break;
      case SimulationCall::kStep: step(call.step().cycles()); break;
      case SimulationCall::kResume: ask([&] { cell_.set_time(Cell::Time::kRuns); }); break;
      case SimulationCall::kSave:
        ask([&] { reply.set_moment(cell_.save()); });
        return reply;
      case SimulationCall::kRestore: ask([&] { cell_.restore(call.restore().moment()); }); break;
      case SimulationCall::kForget: ask([&] { cell_.forget(call.forget().moment()); }); break;
    }
    ask([&] { put_truth(*reply.mutable_truth()); });
  } catch (const std::exception& error) {
    reply.set_error(error.what());
  }
  return reply;
}

void ControlCalls::step(std::uint64_t cycles) {
  cell_.ask([&] { cell_.step(cycles); });
  for (std::uint64_t left = cycles; left > 0;) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    cell_.ask([&] { left = cell_.steps_left(); });
  }
}

void ControlCalls::put_truth(proto::SimulationTruth& message) {
  const World& world = cell_.world();
  const Truth& truth = world.truth(arm_);
  message.set_cycle(cell_.cycle());
  message.set_message_id(cell_.robot(arm_).state().message_id);
  message.set_time(truth.time);
  message.set_moving(cell_.robot(arm_).moving());
  const auto put = [](const auto& from, auto* to) { to->Assign(from.begin(), from.end()); };
  put(truth.q, message.mutable_q());
  put(truth.dq, message.mutable_dq());
  put(truth.ddq, message.mutable_ddq());
  put(truth.tau_motor, message.mutable_tau_motor());
  put(truth.tau_J, message.mutable_tau_j());
  put(truth.finger, message.mutable_finger());
  put(truth.finger_force, message.mutable_finger_force());
  put(truth.O_T_TCP, message.mutable_o_t_tcp());
  put(truth.contact_wrench, message.mutable_contact_wrench());
  put(truth.push, message.mutable_push());
  for (std::size_t i = 0; i < world.objects().size(); ++i) {
    auto& object = *message.add_objects();
    object.set_name(world.objects()[i]);
    put(world.object_pose(i, arm_), object.mutable_pose());
  }
  if (cell_.time() != Cell::Time::kRuns) {
    message.set_paused(cell_.time() == Cell::Time::kPaused ? proto::Pause::ALL : proto::Pause::BETWEEN_MOTIONS);
  }
  message.set_late_cycles(cell_.pace().late());
  message.set_worst_delay(cell_.pace().worst_delay());
}

// Drawn here, from a copy: the loop gives away its joints' positions, and its scene when that has changed.
void ControlCalls::put_image(const proto::TakeImage& request, proto::Image& image) {
  const int width = static_cast<int>(request.width()), height = static_cast<int>(request.height());
  std::vector<double> qpos;
  SpecPtr spec;
  int changes = 0;
  std::size_t arms = 0;
  const bool fits = camera_ && camera_->width() == width && camera_->height() == height;
  cell_.ask([&] {
    const World& world = cell_.world();
    qpos.assign(world.qpos().begin(), world.qpos().end());
    changes = world.changes();
    arms = world.arms();
    if (!fits || changes != camera_changes_) spec = world.spec();
    image.set_cycle(cell_.cycle());
  });
  if (spec) {
    camera_.reset();
    const std::string meshes = meshes_folder();
    camera_ = std::make_unique<Camera>(with_meshes(spec.get(), arms, meshes), !meshes.empty(), width, height);
    camera_changes_ = changes;
  }
  int id = -1;
  if (request.has_camera()) {
    const mjModel* model = camera_->model();
    id = mj_name2id(model, mjOBJ_CAMERA, request.camera().c_str());
    if (id < 0) id = mj_name2id(model, mjOBJ_CAMERA, (arm_prefix(arm_, arms) + request.camera()).c_str());
    if (id < 0) {
      std::string names;
      for (int i = 0; i < model->ncam; ++i) {
        const char* name = mj_id2name(model, mjOBJ_CAMERA, i);
        if (name) names += std::string(names.empty() ? "" : ", ") + name;
      }
      refuse("no camera is called \"" + request.camera() + "\"; there are " + names);
    }
  }
  const Picture picture = camera_->take(qpos, id);
  image.set_width(request.width());
  image.set_height(request.height());
  image.set_colour(picture.rgb.data(), picture.rgb.size());
  image.set_depth(picture.depth.data(), picture.depth.size() * sizeof(float));
}

}  // namespace sim
