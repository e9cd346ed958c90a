#include "sim/world.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "sim/joint_figures.hpp"
#include "sim/joint_friction.hpp"
#include "sim/scene.hpp"

namespace sim {
namespace {

constexpr double kCycle = 1e-3;  // s

// The fingers' gear (assumed): a spring and a damper between them, and friction of the drive which only damps.
constexpr double kGearStiffness = 4e4;  // N/m
constexpr double kGearDamping = 50;     // N s/m
constexpr double kFingerDamping = 10;   // N s/m, also in an ideal arm
constexpr double kFingerStart = 0.039;  // m, just off the stop

}  // namespace

struct World::Impl {
  ModelPtr model;
  DataPtr data;
  Truth truth;
  bool hand;
  int substeps;
  std::array<int, 7> q_at, dq_at;                 // of the arm's joints in qpos and qvel
  std::array<int, 2> finger_q_at, finger_dq_at;   // of the fingers' joints
  int tool_body = -1;                             // where pushes act
  std::array<double, 3> tool_p{};                 // TCP in tool_body
  std::array<double, 9> tool_R{};                 // axes of the TCP in tool_body, row-major
  std::vector<int> tool_part;                     // per body: 0 not the hand's, 1 hand, 2 and 3 fingers
  std::array<JointFriction, 7> friction;
  Vector6 push{};
  bool pushed = false;
  std::array<double, 3> base_p;  // of O in the world
  std::array<double, 9> base_R;
  std::vector<int> objects;      // bodies with a free joint

  int id(mjtObj type, const std::string& name) const {
    return mj_name2id(model.get(), type, (kArmPrefix + name).c_str());
  }
  void to_base(double out[3], const double world[3]) const { mju_mulMatTVec3(out, base_R.data(), world); }
  void tcp(double p[3], double R[9]) const;
  void apply_forces(const Vector7& tau_motor, const std::array<double, 2>& finger_force, Vector7& friction_sum);
  void read_contacts(double weight);
  void read_state();
};

// Pose of the TCP in the world.
void World::Impl::tcp(double p[3], double R[9]) const {
  const double* body_R = data->xmat + 9 * tool_body;
  mju_mulMatVec3(p, body_R, tool_p.data());
  mju_addTo3(p, data->xpos + 3 * tool_body);
  mju_mulMatMat(R, body_R, tool_R.data(), 3, 3, 3);
}

World::World(const Options& options) : impl_(std::make_unique<Impl>()) {
  Impl& w = *impl_;
  w.model = build_scene(*options.arm, options.hand, options.scene, options.timestep);
  w.data.reset(mj_makeData(w.model.get()));
  w.hand = options.hand;
  w.substeps = static_cast<int>(std::lround(kCycle / options.timestep));
  const mjModel* m = w.model.get();

  for (int i = 0; i < 7; ++i) {
    const int joint = w.id(mjOBJ_JOINT, "joint" + std::to_string(i + 1));
    w.q_at[i] = m->jnt_qposadr[joint];
    w.dq_at[i] = m->jnt_dofadr[joint];
    w.data->qpos[w.q_at[i]] = options.q[i];
    if (!options.ideal) {
      w.friction[i].sticking = kStickingShare * kFrictionHeight[i];
      w.friction[i].rising = kFrictionHeight[i] / 2 - w.friction[i].sticking;
      w.friction[i].rise = kFrictionRise[i];
    }
  }

  w.tool_part.assign(m->nbody, 0);
  w.tool_R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  if (options.hand) {
    w.tool_body = w.id(mjOBJ_BODY, "hand");
    w.tool_part[w.tool_body] = 1;
    w.tool_p = {0, 0, models::hand::kTcp};
    for (int i = 0; i < 2; ++i) {
      const std::string name = "finger" + std::to_string(i + 1);
      const int joint = w.id(mjOBJ_JOINT, name);
      w.finger_q_at[i] = m->jnt_qposadr[joint];
      w.finger_dq_at[i] = m->jnt_dofadr[joint];
      w.data->qpos[w.finger_q_at[i]] = kFingerStart;
      w.tool_part[w.id(mjOBJ_BODY, name)] = 2 + i;
    }
  } else {
    w.tool_body = w.id(mjOBJ_BODY, "link7");
    w.tool_p = options.arm->joints[7].xyz;
  }

  const int base = w.id(mjOBJ_BODY, "link0");
  for (int body = 1; body < m->nbody; ++body) {
    const int joint = m->body_jntadr[body];
    if (joint < 0 || m->jnt_type[joint] != mjJNT_FREE) continue;
    if (!mj_id2name(m, mjOBJ_BODY, body)) {
      throw std::runtime_error("scene " + options.scene + ": a free body has no name; expected <body name=\"...\">");
    }
    w.objects.push_back(body);
  }

  mj_step1(m, w.data.get());
  mju_copy3(w.base_p.data(), w.data->xpos + 3 * base);
  mju_copy(w.base_R.data(), w.data->xmat + 9 * base, 9);
  w.read_state();
}

World::~World() = default;

void World::Impl::apply_forces(const Vector7& tau_motor, const std::array<double, 2>& finger_force,
                               Vector7& friction_sum) {
  double* force = data->qfrc_applied;
  const double* dq = data->qvel;
  const double dt = model->opt.timestep;
  if (pushed) {
    mju_zero(force, model->nv);
    double p[3], R[9], f[3], n[3];
    tcp(p, R);
    mju_mulMatVec3(f, base_R.data(), push.data());
    mju_mulMatVec3(n, base_R.data(), push.data() + 3);
    mj_applyFT(model.get(), data.get(), f, n, p, tool_body, force);
  } else {
    for (int at : dq_at) force[at] = 0;
  }
  for (int i = 0; i < 7; ++i) {
    const double tau_f = friction[i].step(dq[dq_at[i]], dt);
    force[dq_at[i]] += tau_motor[i] - tau_f;
    friction_sum[i] += tau_f;
  }
  if (!hand) return;
  // The gear bears what of weight and inertia would move both fingers to one side; spring and damper the rest.
  const double* bias = data->qfrc_bias;
  const double gear = 0.5 * (bias[finger_dq_at[0]] - bias[finger_dq_at[1]]) +
                      kGearStiffness * (data->qpos[finger_q_at[1]] - data->qpos[finger_q_at[0]]) +
                      kGearDamping * (dq[finger_dq_at[1]] - dq[finger_dq_at[0]]);
  for (int i = 0; i < 2; ++i) {
    const int at = finger_dq_at[i];
    force[at] = finger_force[i] - kFingerDamping * dq[at] + (i == 0 ? gear : -gear);
  }
}

// Adds what the contacts of the last step did to hand and fingers.
void World::Impl::read_contacts(double weight) {
  if (data->ncon == 0 || !hand) return;
  double p[3], R[9];
  tcp(p, R);
  for (int i = 0; i < data->ncon; ++i) {
    const mjContact& contact = data->contact[i];
    if (contact.efc_address < 0 || contact.geom[0] < 0 || contact.geom[1] < 0) continue;
    const int part0 = tool_part[model->geom_bodyid[contact.geom[0]]];
    const int part1 = tool_part[model->geom_bodyid[contact.geom[1]]];
    if ((part0 == 0) == (part1 == 0)) continue;

    double wrench[6], f[3], n[3], arm[3], moment[3], out[3];
    mj_contactForce(model.get(), data.get(), i, wrench);  // on the second geom, axes of the contact
    mju_mulMatTVec3(f, contact.frame, wrench);
    mju_mulMatTVec3(n, contact.frame, wrench + 3);
    const double sign = part1 ? weight : -weight;
    mju_scl3(f, f, sign);
    mju_sub3(arm, contact.pos, p);
    mju_cross(moment, arm, f);
    mju_addToScl3(moment, n, sign);
    to_base(out, f);
    for (int k = 0; k < 3; ++k) truth.contact_wrench[k] += out[k];
    to_base(out, moment);
    for (int k = 0; k < 3; ++k) truth.contact_wrench[3 + k] += out[k];

    const int part = std::max(part0, part1);
    if (part >= 2) {
      // The first finger opens along the hand's y, the second against it.
      const double along_y = f[0] * R[1] + f[1] * R[4] + f[2] * R[7];
      truth.finger_force[part - 2] += part == 2 ? along_y : -along_y;
    }
  }
}

void World::Impl::read_state() {
  for (int i = 0; i < 7; ++i) {
    truth.q[i] = data->qpos[q_at[i]];
    truth.dq[i] = data->qvel[dq_at[i]];
  }
  if (hand) {
    for (int i = 0; i < 2; ++i) truth.finger[i] = data->qpos[finger_q_at[i]];
  }
  double p[3], R[9], O_p[3], O_R[9];
  tcp(p, R);
  mju_subFrom3(p, base_p.data());
  to_base(O_p, p);
  mju_mulMatTMat(O_R, base_R.data(), R, 3, 3, 3);
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) truth.O_T_TCP[4 * column + row] = O_R[3 * row + column];
    truth.O_T_TCP[12 + column] = O_p[column];
  }
  truth.O_T_TCP[15] = 1;
}

void World::step(const Vector7& tau_motor, const std::array<double, 2>& finger_force) {
  Impl& w = *impl_;
  const mjModel* m = w.model.get();
  mjData* d = w.data.get();
  const Vector7 dq_before = w.truth.dq;
  Vector7 friction{};
  w.truth.contact_wrench = {};
  w.truth.finger_force = {};
  for (int i = 0; i < w.substeps; ++i) {
    w.apply_forces(tau_motor, finger_force, friction);
    mj_step2(m, d);
    w.read_contacts(1.0 / w.substeps);
    mj_step1(m, d);  // so that poses belong to the new positions
  }
  w.read_state();
  w.truth.time = d->time;
  w.truth.tau_motor = tau_motor;
  for (int i = 0; i < 7; ++i) {
    w.truth.ddq[i] = (w.truth.dq[i] - dq_before[i]) / kCycle;
    w.truth.tau_J[i] = tau_motor[i] - friction[i] / w.substeps - kMotorInertia[i] * w.truth.ddq[i];
  }
}

void World::push(const Vector6& wrench) {
  impl_->push = wrench;
  impl_->pushed = wrench != Vector6{};
  if (!impl_->pushed) mju_zero(impl_->data->qfrc_applied, impl_->model->nv);
}

const Truth& World::truth() const { return impl_->truth; }

std::vector<std::string> World::objects() const {
  std::vector<std::string> names;
  for (int body : impl_->objects) names.emplace_back(mj_id2name(impl_->model.get(), mjOBJ_BODY, body));
  return names;
}

std::array<double, 7> World::object_pose(std::size_t index) const {
  const Impl& w = *impl_;
  const int body = w.objects.at(index);
  double world[3], base_quat[4], inverse[4];
  std::array<double, 7> pose;
  mju_sub3(world, w.data->xpos + 3 * body, w.base_p.data());
  w.to_base(pose.data(), world);
  mju_mat2Quat(base_quat, w.base_R.data());
  mju_negQuat(inverse, base_quat);
  mju_mulQuat(pose.data() + 3, inverse, w.data->xquat + 4 * body);
  return pose;
}

std::vector<double> World::qpos() const {
  return {impl_->data->qpos, impl_->data->qpos + impl_->model->nq};
}

}  // namespace sim
