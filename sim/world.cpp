#include "sim/world.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "sim/joint_figures.hpp"

namespace sim {
namespace {

using Eigen::Vector3d;

std::string text(double value) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.17g", value);
  return buffer;
}

template <class Values>
std::string text_of(const Values& values) {
  std::string all;
  for (double value : values) all += (all.empty() ? "" : " ") + text(value);
  return all;
}

std::string quaternion(const models::Vector3& rpy) {
  const Eigen::Quaterniond q = Eigen::AngleAxisd(rpy[2], Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(rpy[1], Vector3d::UnitY()) *
                               Eigen::AngleAxisd(rpy[0], Vector3d::UnitX());
  return text_of(std::array{q.w(), q.x(), q.y(), q.z()});
}

std::string inertial(const models::Link& link) {
  return "<inertial pos='" + text_of(link.com) + "' mass='" + text(link.mass) + "' fullinertia='" +
         text_of(link.inertia) + "'/>";
}

// Arm links are in collision group 1: they meet the scene, not each other (the robot stops itself
// before that; self-collision is a check of the controller).
std::string capsules(int link) {
  std::string geoms;
  for (const models::Capsule& capsule : models::capsules()) {
    if (capsule.link != link) continue;
    const Vector3d z = capsule.axis == 'x' ? Vector3d::UnitX()
                       : capsule.axis == 'y' ? Vector3d::UnitY() : Vector3d::UnitZ();
    geoms += "<geom class='arm' type='capsule' pos='" + text_of(capsule.centre) + "' zaxis='" +
             text_of(z) + "' size='" + text(capsule.radius) + " " + text(capsule.length / 2) + "'/>";
  }
  return geoms;
}

std::string finger(const char* side, const models::Link& link, double yaw) {
  // Pads of the finger's inner face: 2 cm wide and high, up to the tool centre.
  return std::string("<body name='") + side + "finger' pos='0 0 " + text(models::hand::kFingerZ) +
         "' euler='0 0 " + text(yaw) + "'><joint name='" + side +
         "finger' type='slide' axis='0 1 0' range='0 " + text(models::hand::kMaxWidth / 2) +
         "' limited='true' armature='0.1' damping='8'/>" + inertial(link) +
         "<geom class='finger' pos='0 0.0105 0.0445' size='0.0105 0.0105 0.0095'/>"
         "<geom class='finger' pos='0 0.019 0.018' size='0.0105 0.006 0.018'/></body>";
}

std::string arm_mjcf(const World::Options& options) {
  const models::Arm& arm = *options.arm;
  const models::Limits& limits = models::limits(arm, 10);
  std::string xml =
      "<body name='link0' childclass='robot'>" + inertial(arm.links[0]) + capsules(0);
  std::string tail = "</body>";
  for (int i = 0; i < models::kJoints; ++i) {
    const std::string n = std::to_string(i + 1);
    // Mechanical stops lie a little beyond the widest documented range.
    constexpr double kBeyond = 0.03;  // rad
    xml += "<body name='link" + n + "' pos='" + text_of(arm.joints[i].xyz) + "' quat='" +
           quaternion(arm.joints[i].rpy) + "'>" + inertial(arm.links[i + 1]) + "<joint name='joint" + n +
           "' axis='0 0 1' limited='true' range='" + text(limits.q_min[i] - kBeyond) + " " +
           text(limits.q_max[i] + kBeyond) + "' armature='" + text(kRotorInertia) + "'" +
           (options.ideal ? ""
                          : " frictionloss='" + text(kCoulombFriction) + "' damping='" +
                                text(kViscousFriction) + "'") +
           "/>" + capsules(i + 1);
    tail += "</body>";
  }
  xml += "<body name='flange' pos='" + text_of(arm.joints[7].xyz) + "' quat='" +
         quaternion(arm.joints[7].rpy) + "'><site name='flange'/>";
  if (options.hand) {
    xml += "<body name='hand' euler='0 0 " + text(models::hand::kYaw) + "'>" +
           inertial(models::hand::kHand) +
           "<geom class='hand' pos='0 0 0.033' size='0.031 0.1 0.033'/>" +
           finger("left", models::hand::kFinger, 0) + finger("right", models::hand::kFinger, M_PI) +
           "</body>";
  }
  return xml + "</body>" + tail;
}

std::string world_mjcf(const World::Options& options) {
  std::string scene = "<worldbody><geom name='floor' type='plane' size='2 2 0.1' rgba='.8 .8 .78 1'/>"
                      "<light pos='1 -1 2.5' dir='-0.4 0.4 -1'/></worldbody>";
  std::string folder;
  if (!options.scene.empty()) {
    const auto file = std::filesystem::absolute(options.scene);
    scene = "<include file='" + file.string() + "'/>";
    folder = file.parent_path().string();
  }
  return "<mujoco model='" + std::string(options.arm->name) +
         "'>"
         "<compiler angle='radian' autolimits='true' meshdir='" + folder + "' texturedir='" + folder +
         "'/>"
         "<option timestep='0.001' integrator='implicitfast' cone='elliptic' impratio='10' "
         "iterations='20' ls_iterations='10' tolerance='1e-8'/>" + scene +
         "<default><default class='robot'>"
         "<default class='arm'><geom contype='2' conaffinity='1' mass='0' group='3' rgba='.9 .9 .9 1'/></default>"
         "<default class='hand'><geom type='box' contype='2' conaffinity='1' mass='0' group='3' rgba='.9 .9 .9 1'/></default>"
         "<default class='finger'><geom type='box' contype='4' conaffinity='1' mass='0' condim='4' "
         "friction='1.2 0.02 0.001' solref='0.004 1' solimp='0.95 0.99 0.001' group='3' rgba='.3 .3 .3 1'/></default>"
         "</default></default>"
         "<worldbody>" + arm_mjcf(options) + "</worldbody></mujoco>";
}

}  // namespace

struct World::Impl {
  mjModel* model = nullptr;
  mjData* data = nullptr;
  Truth truth;
  std::array<int, 7> q{}, v{};        // addresses of the arm's joints in qpos and qvel
  std::array<int, 2> finger_q{}, finger_v{};
  bool hand = true;
  int flange = 0;                     // site
  std::vector<int> objects;           // bodies
  std::vector<bool> gripping;         // by body: hand or finger
  std::array<int, 2> finger_body{};
  Vector6 push{};

  ~Impl() {
    mj_deleteData(data);
    mj_deleteModel(model);
  }

  int joint(const std::string& name) const {
    return mj_name2id(model, mjOBJ_JOINT, name.c_str());
  }

  void observe(const Vector7& tau_motor);
};

World::World(const Options& options) : impl_(std::make_unique<Impl>()) {
  const std::string source = options.scene.empty() ? "the empty scene" : options.scene;
  if (!options.scene.empty() && !std::ifstream(options.scene)) {
    throw std::runtime_error("cannot read the scene " + options.scene);
  }
  char error[1000] = "";
  mjSpec* spec = mj_parseXMLString(world_mjcf(options).c_str(), nullptr, error, sizeof error);
  if (spec != nullptr) {
    impl_->model = mj_compile(spec, nullptr);
    if (impl_->model == nullptr) std::snprintf(error, sizeof error, "%s", mjs_getError(spec));
    mj_deleteSpec(spec);
  }
  if (impl_->model == nullptr) {
    throw std::runtime_error("the scene " + source + " is no MJCF that the arm can stand in: " + error);
  }
  Impl& m = *impl_;
  m.data = mj_makeData(m.model);
  m.hand = options.hand;
  for (int i = 0; i < 7; ++i) {
    const int id = m.joint("joint" + std::to_string(i + 1));
    m.q[i] = m.model->jnt_qposadr[id];
    m.v[i] = m.model->jnt_dofadr[id];
    m.data->qpos[m.q[i]] = options.q[i];
  }
  m.gripping.assign(m.model->nbody, false);
  if (m.hand) {
    const std::array<std::string, 2> names = {"leftfinger", "rightfinger"};
    for (int i = 0; i < 2; ++i) {
      const int id = m.joint(names[i]);
      m.finger_q[i] = m.model->jnt_qposadr[id];
      m.finger_v[i] = m.model->jnt_dofadr[id];
      m.finger_body[i] = m.model->jnt_bodyid[id];
      m.gripping[m.finger_body[i]] = true;
    }
    m.gripping[mj_name2id(m.model, mjOBJ_BODY, "hand")] = true;
  }
  m.flange = mj_name2id(m.model, mjOBJ_SITE, "flange");
  for (int id = 0; id < m.model->njnt; ++id) {
    if (m.model->jnt_type[id] == mjJNT_FREE) m.objects.push_back(m.model->jnt_bodyid[id]);
  }
  mj_step1(m.model, m.data);
  m.observe({});
}

World::~World() = default;

void World::step(const Vector7& tau_motor, const std::array<double, 2>& finger_force) {
  Impl& m = *impl_;
  for (int i = 0; i < 7; ++i) m.data->qfrc_applied[m.v[i]] = tau_motor[i];
  if (m.hand) {
    for (int i = 0; i < 2; ++i) m.data->qfrc_applied[m.finger_v[i]] = finger_force[i];
  }
  if (std::any_of(m.push.begin(), m.push.end(), [](double x) { return x != 0; })) {
    const auto& T = m.truth.O_T_TCP;
    const mjtNum point[3] = {T[12], T[13], T[14]};
    const int body = m.model->site_bodyid[m.flange];
    mj_applyFT(m.model, m.data, m.push.data(), m.push.data() + 3, point, body, m.data->qfrc_applied);
  }
  mj_step2(m.model, m.data);
  mj_step1(m.model, m.data);
  m.observe(tau_motor);
}

void World::push(const Vector6& wrench) { impl_->push = wrench; }

void World::Impl::observe(const Vector7& tau_motor) {
  const mjData& d = *data;
  truth.time = d.time;
  truth.tau_motor = tau_motor;
  Vector7 friction{};
  for (int row = 0; row < d.nefc; ++row) {
    if (d.efc_type[row] != mjCNSTR_FRICTION_DOF) continue;
    for (int i = 0; i < 7; ++i) {
      if (d.efc_id[row] == v[i]) friction[i] = d.efc_force[row];
    }
  }
  for (int i = 0; i < 7; ++i) {
    truth.q[i] = d.qpos[q[i]];
    truth.dq[i] = d.qvel[v[i]];
    truth.ddq[i] = d.qacc[v[i]];
    truth.tau_J[i] = tau_motor[i] + friction[i] + d.qfrc_passive[v[i]] - kRotorInertia * d.qacc[v[i]];
  }
  const mjtNum* R = d.site_xmat + 9 * flange;
  const mjtNum* p = d.site_xpos + 3 * flange;
  const double c = std::cos(models::hand::kYaw), s = std::sin(models::hand::kYaw);
  for (int row = 0; row < 3; ++row) {
    truth.O_T_TCP[row] = c * R[3 * row] + s * R[3 * row + 1];
    truth.O_T_TCP[4 + row] = c * R[3 * row + 1] - s * R[3 * row];
    truth.O_T_TCP[8 + row] = R[3 * row + 2];
    truth.O_T_TCP[12 + row] = p[row] + models::hand::kTcp * R[3 * row + 2];
  }
  truth.O_T_TCP[15] = 1;

  truth.contact_wrench = {};
  truth.finger_force = {};
  const Vector3d tcp(truth.O_T_TCP[12], truth.O_T_TCP[13], truth.O_T_TCP[14]);
  for (int i = 0; i < d.ncon; ++i) {
    const mjContact& contact = d.contact[i];
    const int body1 = model->geom_bodyid[contact.geom[0]];
    const int body2 = model->geom_bodyid[contact.geom[1]];
    if (gripping[body1] == gripping[body2]) continue;
    mjtNum local[6];
    mj_contactForce(model, data, i, local);
    // The contact's frame has its axes in rows; its force acts on the second geom.
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> frame(contact.frame);
    const double sign = gripping[body2] ? 1 : -1;
    const Vector3d force = sign * (frame.transpose() * Eigen::Map<const Vector3d>(local));
    const Vector3d moment = sign * (frame.transpose() * Eigen::Map<const Vector3d>(local + 3)) +
                            (Eigen::Map<const Vector3d>(contact.pos) - tcp).cross(force);
    for (int k = 0; k < 3; ++k) {
      truth.contact_wrench[k] += force[k];
      truth.contact_wrench[3 + k] += moment[k];
    }
    const int body = gripping[body2] ? body2 : body1;
    for (int k = 0; hand && k < 2; ++k) {
      if (body == finger_body[k]) truth.finger_force[k] += std::abs(local[0]);
    }
  }
  for (int i = 0; hand && i < 2; ++i) truth.finger[i] = d.qpos[finger_q[i]];
}

const Truth& World::truth() const { return impl_->truth; }

std::vector<std::string> World::objects() const {
  std::vector<std::string> names;
  for (int body : impl_->objects) {
    const char* name = mj_id2name(impl_->model, mjOBJ_BODY, body);
    names.push_back(name != nullptr ? name : "body" + std::to_string(body));
  }
  return names;
}

std::array<double, 7> World::object_pose(std::size_t index) const {
  const int body = impl_->objects.at(index);
  std::array<double, 7> pose;
  std::copy_n(impl_->data->qpos + impl_->model->jnt_qposadr[impl_->model->body_jntadr[body]], 7,
              pose.begin());
  return pose;
}

std::vector<double> World::qpos() const {
  return {impl_->data->qpos, impl_->data->qpos + impl_->model->nq};
}

}  // namespace sim
