#include "sim/world/world.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "models/joint_figures.hpp"
#include "sim/world/joint_friction.hpp"

namespace sim {
namespace {

constexpr double kCycle = 1e-3;  // s

// The fingers' gear (assumed): a spring and a damper between them, and friction of the drive which only damps.
constexpr double kGearStiffness = 4e4;  // N/m
constexpr double kGearDamping = 50;     // N s/m
constexpr double kFingerDamping = 10;   // N s/m, also in an ideal arm
constexpr double kFingerStart = 0.039;  // m, just off the stop

constexpr int kMostAdded = 200;  // objects

// Somebody's force on a link.
struct Grip {
  double time = 0, duration = -1;  // s
  int body = -1;
  Vector3 point{};  // in the body
  bool goes_on() const { return time < duration - 0.5 * kCycle; }
};

// One arm of the model: where it is in MuJoCo's arrays, and what of it MuJoCo does not know.
struct Limb {
  std::string prefix;
  std::array<int, 7> q_at, dq_at;                // of the arm's joints in qpos and qvel
  std::array<int, 2> finger_q_at, finger_dq_at;  // of the fingers' joints
  std::array<int, 9> bodies;                     // link0 to link7, hand
  int tool_body = -1;
  Vector3 tool_p{};         // TCP in tool_body
  Vector3 base_p;           // of O in the world
  std::array<double, 9> base_R;

  std::array<JointFriction, 7> friction;
  Grip push, pull;
  Vector6 wrench{};   // of the push
  VirtualHand hand;   // of the pull; the path begins where the arm's point was
  Vector7 friction_sum{};  // N m, over the cycle's steps
  Truth truth;
};

// How a geom touches others.
struct Touch {
  double friction;
  int priority, condim;
  std::array<double, mjNREF> solref;
  std::array<double, mjNIMP> solimp;

  bool operator==(const Touch&) const = default;
};

}  // namespace

struct World::Moment {
  int changes;
  std::vector<Touch> touches;  // of all geoms
  std::vector<double> state;
  std::vector<Limb> limbs;
};

struct World::Impl {
  std::vector<const models::Arm*> arms;
  Scene scene;
  mjModel* model;
  DataPtr data;
  bool hand;
  int substeps;
  int changes = 0;
  bool touched = false;  // qfrc_applied holds more than torques of the arms' own joints
  std::vector<Limb> limbs;
  std::vector<signed char> owner;    // per body: limb whose tool it is part of, or -1
  std::vector<signed char> tool_part;  // per body: 0 not a hand's, 1 hand, 2 and 3 fingers
  std::vector<int> objects;          // bodies of the scene with joints
  std::vector<std::string> object_names;

  int id(const Limb& limb, mjtObj type, const std::string& name) const {
    return mj_name2id(model, type, (limb.prefix + name).c_str());
  }
  void find_everything(const std::string& title);
  void tcp(const Limb& limb, double p[3], double R[9]) const;
  void tool_wrench(const Limb& limb, const double f[3], const double n[3], const double at[3], double weight,
                   Vector6& sum) const;
  void apply_people(Limb& limb);
  void apply_drive(Limb& limb, const Drive& drive);
  void read_contacts(double weight);
  void read_joints(Limb& limb);
  void read_pose(Limb& limb);
  Grip grip(const Limb& limb, const Hold& at, double duration) const;
  void grip_position(const Grip& grip, double p[3]) const;
  void to_world(const Limb& limb, const double O_p[3], double p[3]) const;
  void set_pose(int body, const std::array<double, 7>& pose, const Limb& limb);
  void wake();
  Touch touch(int geom) const;
  void take_touch(const mjsGeom* spec, int geom);
};

// Everything that sleeps, as MuJoCo does where somebody pulls at it.
void World::Impl::wake() {
  for (int body = 1; body < model->nbody; ++body) data->xfrc_applied[6 * body] = std::numeric_limits<double>::min();
  mj_step1(model, data.get());
  mju_zero(data->xfrc_applied, 6 * model->nbody);
}

Touch World::Impl::touch(int geom) const {
  Touch touch{model->geom_friction[3 * geom], model->geom_priority[geom], model->geom_condim[geom], {}, {}};
  mju_copy(touch.solref.data(), model->geom_solref + mjNREF * geom, mjNREF);
  mju_copy(touch.solimp.data(), model->geom_solimp + mjNIMP * geom, mjNIMP);
  return touch;
}

void World::Impl::take_touch(const mjsGeom* spec, int geom) {
  model->geom_friction[3 * geom] = spec->friction[0];
  model->geom_priority[geom] = spec->priority;
  model->geom_condim[geom] = spec->condim;
  mju_copy(model->geom_solref + mjNREF * geom, spec->solref, mjNREF);
  mju_copy(model->geom_solimp + mjNIMP * geom, spec->solimp, mjNIMP);
}

void World::Impl::to_world(const Limb& limb, const double O_p[3], double p[3]) const {
  mju_mulMatVec3(p, limb.base_R.data(), O_p);
  mju_addTo3(p, limb.base_p.data());
}

// Pose of the TCP in the world; its axes are the tool body's.
void World::Impl::tcp(const Limb& limb, double p[3], double R[9]) const {
  mju_copy(R, data->xmat + 9 * limb.tool_body, 9);
  mju_mulMatVec3(p, R, limb.tool_p.data());
  mju_addTo3(p, data->xpos + 3 * limb.tool_body);
}

// Indices by name, anew after the model was.
void World::Impl::find_everything(const std::string& title) {
  const mjModel* m = model;
  owner.assign(m->nbody, -1);
  tool_part.assign(m->nbody, 0);
  for (std::size_t n = 0; n < limbs.size(); ++n) {
    Limb& limb = limbs[n];
    for (int i = 0; i < 7; ++i) {
      const int joint = id(limb, mjOBJ_JOINT, "joint" + std::to_string(i + 1));
      limb.q_at[i] = m->jnt_qposadr[joint];
      limb.dq_at[i] = m->jnt_dofadr[joint];
    }
    for (int i = 0; i <= 7; ++i) limb.bodies[i] = id(limb, mjOBJ_BODY, "link" + std::to_string(i));
    limb.bodies[Hold::kHand] = limb.tool_body = hand ? id(limb, mjOBJ_BODY, "hand") : limb.bodies[7];
    limb.tool_p = hand ? Vector3{0, 0, models::hand::kTcp} : arms[n]->joints[7].xyz;
    if (!hand) continue;
    const auto part = [&](int body, int kind) {
      owner[body] = static_cast<signed char>(n);
      tool_part[body] = static_cast<signed char>(kind);
    };
    part(limb.tool_body, 1);
    for (int i = 0; i < 2; ++i) {
      const std::string name = "finger" + std::to_string(i + 1);
      const int joint = id(limb, mjOBJ_JOINT, name);
      limb.finger_q_at[i] = m->jnt_qposadr[joint];
      limb.finger_dq_at[i] = m->jnt_dofadr[joint];
      part(id(limb, mjOBJ_BODY, name), 2 + i);
    }
  }
  objects.clear();
  object_names.clear();
  for (int body = 1; body < m->nbody; ++body) {
    if (m->body_jntnum[body] == 0) continue;
    const char* name = mj_id2name(m, mjOBJ_BODY, body);
    if (!name) throw std::runtime_error("scene " + title + ": a body that moves has no name; expected <body name=\"...\">");
    if (std::any_of(limbs.begin(), limbs.end(), [&](const Limb& l) { return std::string_view(name).starts_with(l.prefix); })) {
      continue;
    }
    objects.push_back(body);
    object_names.emplace_back(name);
  }
}

World::World(const Options& options) : impl_(std::make_unique<Impl>()) {
  Impl& w = *impl_;
  w.arms = options.more_arms;
  w.arms.insert(w.arms.begin(), options.arm);
  w.scene = build_scene(w.arms, options.hand, options.scene, options.timestep);
  w.model = w.scene.model.get();
  w.data.reset(mj_makeData(w.model));
  w.hand = options.hand;
  w.substeps = static_cast<int>(std::lround(kCycle / options.timestep));
  w.limbs.resize(w.arms.size());
  for (std::size_t n = 0; n < w.limbs.size(); ++n) w.limbs[n].prefix = arm_prefix(n, w.limbs.size());
  w.find_everything(options.scene);

  for (Limb& limb : w.limbs) {
    for (int i = 0; i < 7; ++i) {
      w.data->qpos[limb.q_at[i]] = options.q[i];
      if (options.ideal) continue;
      limb.friction[i].sticking = models::kStickingShare * models::kFrictionHeight[i];
      limb.friction[i].rising = models::kFrictionHeight[i] / 2 - limb.friction[i].sticking;
      limb.friction[i].rise = models::kFrictionRise[i];
    }
    if (!w.hand) continue;
    for (int at : limb.finger_q_at) w.data->qpos[at] = kFingerStart;
  }
  mj_step1(w.model, w.data.get());
  for (Limb& limb : w.limbs) {
    mju_copy3(limb.base_p.data(), w.data->xpos + 3 * limb.bodies[0]);
    mju_copy(limb.base_R.data(), w.data->xmat + 9 * limb.bodies[0], 9);
    w.read_joints(limb);
    w.read_pose(limb);
    for (int i = 0; i < 7; ++i) limb.truth.tau_motor[i] = limb.truth.tau_J[i] = w.data->qfrc_bias[limb.dq_at[i]];  // it hangs from them
  }
}

World::~World() = default;

// --- the cycle ------------------------------------------------------------------------------------------------

// Adds force and moment (of the world's axes, at a point of the world) to a wrench at the TCP in O.
void World::Impl::tool_wrench(const Limb& limb, const double f[3], const double n[3], const double at[3],
                              double weight, Vector6& sum) const {
  double p[3], R[9], arm[3], moment[3], out[3];
  tcp(limb, p, R);
  mju_sub3(arm, at, p);
  mju_cross(moment, arm, f);
  mju_addTo3(moment, n);
  mju_mulMatTVec3(out, limb.base_R.data(), f);
  mju_addToScl3(sum.data(), out, weight);
  mju_mulMatTVec3(out, limb.base_R.data(), moment);
  mju_addToScl3(sum.data() + 3, out, weight);
}

void World::Impl::grip_position(const Grip& grip, double p[3]) const {
  mju_mulMatVec3(p, data->xmat + 9 * grip.body, grip.point.data());
  mju_addTo3(p, data->xpos + 3 * grip.body);
}

void World::Impl::apply_people(Limb& limb) {
  const auto apply = [&](const Grip& grip, const double f[3], const double n[3], const double p[3]) {
    mj_applyFT(model, data.get(), f, n, p, grip.body, data->qfrc_applied);
    tool_wrench(limb, f, n, p, 1.0 / substeps, limb.truth.push);
    touched = true;
  };
  double p[3], f[3], n[3] = {};
  if (limb.push.goes_on()) {
    grip_position(limb.push, p);
    mju_mulMatVec3(f, limb.base_R.data(), limb.wrench.data());
    mju_mulMatVec3(n, limb.base_R.data(), limb.wrench.data() + 3);
    apply(limb.push, f, n, p);
    mju_zero3(n);
  }
  if (limb.pull.goes_on()) {
    grip_position(limb.pull, p);
    const auto& path = limb.hand.path;
    const auto after = std::find_if(path.begin(), path.end(),
                                    [&](const auto& waypoint) { return waypoint.time > limb.pull.time; });
    Vector3 goal = path.back().position, velocity{};
    if (after != path.begin() && after != path.end()) {
      const auto before = after - 1;
      const double span = after->time - before->time, share = (limb.pull.time - before->time) / span;
      for (int i = 0; i < 3; ++i) {
        velocity[i] = (after->position[i] - before->position[i]) / span;
        goal[i] = before->position[i] + share * (after->position[i] - before->position[i]);
      }
    }
    double moved[6], arm[3], turned[3], target[3], target_v[3];
    mj_objectVelocity(model, data.get(), mjOBJ_XBODY, limb.pull.body, moved, 0);  // rotation first
    mju_sub3(arm, p, data->xpos + 3 * limb.pull.body);
    mju_cross(turned, moved, arm);
    to_world(limb, goal.data(), target);
    mju_mulMatVec3(target_v, limb.base_R.data(), velocity.data());
    for (int i = 0; i < 3; ++i) {
      f[i] = limb.hand.stiffness * (target[i] - p[i]) + limb.hand.damping * (target_v[i] - moved[3 + i] - turned[i]);
    }
    const double size = mju_norm3(f);
    if (size > limb.hand.max_force) mju_scl3(f, f, limb.hand.max_force / size);
    apply(limb.pull, f, n, p);
  }
}

void World::Impl::apply_drive(Limb& limb, const Drive& drive) {
  double* force = data->qfrc_applied;
  const double* dq = data->qvel;
  const double dt = model->opt.timestep;
  for (int i = 0; i < 7; ++i) {
    const double tau_f = limb.friction[i].step(dq[limb.dq_at[i]], dt);
    force[limb.dq_at[i]] += drive.tau_motor[i] - tau_f;
    limb.friction_sum[i] += tau_f;
  }
  if (!hand) return;
  // The gear bears what of weight and inertia would move both fingers to one side; spring and damper the rest.
  const double* bias = data->qfrc_bias;
  const auto& at = limb.finger_dq_at;
  const double gear = 0.5 * (bias[at[0]] - bias[at[1]]) +
                      kGearStiffness * (data->qpos[limb.finger_q_at[1]] - data->qpos[limb.finger_q_at[0]]) +
                      kGearDamping * (dq[at[1]] - dq[at[0]]);
  for (int i = 0; i < 2; ++i) force[at[i]] = drive.finger_force[i] - kFingerDamping * dq[at[i]] + (i == 0 ? gear : -gear);
}

// Adds what the contacts of the last step did to hands and fingers.
void World::Impl::read_contacts(double weight) {
  if (data->ncon == 0 || !hand) return;
  for (int i = 0; i < data->ncon; ++i) {
    const mjContact& contact = data->contact[i];
    if (contact.efc_address < 0 || contact.geom[0] < 0 || contact.geom[1] < 0) continue;
    const int bodies[] = {model->geom_bodyid[contact.geom[0]], model->geom_bodyid[contact.geom[1]]};
    const int owners[] = {owner[bodies[0]], owner[bodies[1]]};
    if (owners[0] == owners[1]) continue;

    double wrench[6], f[3], n[3];
    mj_contactForce(model, data.get(), i, wrench);  // on the second geom, axes of the contact
    mju_mulMatTVec3(f, contact.frame, wrench);
    mju_mulMatTVec3(n, contact.frame, wrench + 3);
    for (int side = 0; side < 2; ++side) {
      if (owners[side] < 0) continue;
      Limb& limb = limbs[owners[side]];
      const double sign = side == 1 ? weight : -weight;
      tool_wrench(limb, f, n, contact.pos, sign, limb.truth.contact_wrench);
      const int part = tool_part[bodies[side]];
      if (part < 2) continue;
      // The first finger opens along the hand's y, the second against it.
      const double* R = data->xmat + 9 * limb.tool_body;
      const double along_y = sign * (f[0] * R[1] + f[1] * R[4] + f[2] * R[7]);
      limb.truth.finger_force[part - 2] += part == 2 ? along_y : -along_y;
    }
  }
}

void World::Impl::read_joints(Limb& limb) {
  Truth& truth = limb.truth;
  for (int i = 0; i < 7; ++i) {
    truth.q[i] = data->qpos[limb.q_at[i]];
    truth.dq[i] = data->qvel[limb.dq_at[i]];
  }
  if (hand) {
    for (int i = 0; i < 2; ++i) truth.finger[i] = data->qpos[limb.finger_q_at[i]];
  }
}

void World::Impl::read_pose(Limb& limb) {
  Truth& truth = limb.truth;
  double p[3], R[9], O_p[3], O_R[9];
  tcp(limb, p, R);
  mju_subFrom3(p, limb.base_p.data());
  mju_mulMatTVec3(O_p, limb.base_R.data(), p);
  mju_mulMatTMat(O_R, limb.base_R.data(), R, 3, 3, 3);
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) truth.O_T_TCP[4 * column + row] = O_R[3 * row + column];
    truth.O_T_TCP[12 + column] = O_p[column];
  }
  truth.O_T_TCP[15] = 1;
}

void World::step(std::span<const Drive> drives) {
  move(drives);
  settle();
}

void World::move(std::span<const Drive> drives) {
  Impl& w = *impl_;
  const mjModel* m = w.model;
  mjData* d = w.data.get();
  for (Limb& limb : w.limbs) {
    limb.truth.contact_wrench = {};
    limb.truth.finger_force = {};
    limb.truth.push = {};
    limb.friction_sum = {};
  }
  for (int i = 0; i < w.substeps; ++i) {
    if (i > 0) mj_step1(m, d);
    if (w.touched) mju_zero(d->qfrc_applied, m->nv);
    w.touched = false;
    for (Limb& limb : w.limbs) {
      for (int at : limb.dq_at) d->qfrc_applied[at] = 0;
      w.apply_people(limb);
    }
    for (std::size_t n = 0; n < w.limbs.size(); ++n) w.apply_drive(w.limbs[n], drives[n]);
    mj_step2(m, d);
    w.read_contacts(1.0 / w.substeps);
  }
  for (std::size_t n = 0; n < w.limbs.size(); ++n) {
    Limb& limb = w.limbs[n];
    Truth& truth = limb.truth;
    const Vector7 dq_before = truth.dq;
    w.read_joints(limb);
    truth.time = d->time;
    truth.tau_motor = drives[n].tau_motor;
    for (int i = 0; i < 7; ++i) {
      truth.ddq[i] = (truth.dq[i] - dq_before[i]) / kCycle;
      truth.tau_J[i] = truth.tau_motor[i] - limb.friction_sum[i] / w.substeps - models::kMotorInertia[i] * truth.ddq[i];
    }
    limb.push.time += kCycle;
    limb.pull.time += kCycle;
  }
}

void World::settle() {
  Impl& w = *impl_;
  mj_step1(w.model, w.data.get());
  for (Limb& limb : w.limbs) w.read_pose(limb);
}

std::size_t World::arms() const { return impl_->limbs.size(); }
const Truth& World::truth(std::size_t arm) const { return impl_->limbs[arm].truth; }

// --- people ---------------------------------------------------------------------------------------------------

Grip World::Impl::grip(const Limb& limb, const Hold& at, double duration) const {
  Grip grip;
  grip.duration = duration;
  grip.body = limb.bodies.at(at.link);
  if (at.point) {
    double p[3];
    to_world(limb, at.point->data(), p);
    mju_subFrom3(p, data->xpos + 3 * grip.body);
    mju_mulMatTVec3(grip.point.data(), data->xmat + 9 * grip.body, p);
  } else if (at.link == Hold::kHand) {
    grip.point = limb.tool_p;
  }
  return grip;
}

void World::push(const Vector6& wrench, double duration, std::size_t arm, const Hold& at) {
  Limb& limb = impl_->limbs[arm];
  limb.wrench = wrench;
  limb.push = impl_->grip(limb, at, wrench == Vector6{} ? 0 : duration);
}

void World::pull(const VirtualHand& hand, double duration, std::size_t arm, const Hold& at) {
  Impl& w = *impl_;
  Limb& limb = w.limbs[arm];
  limb.hand = hand;
  limb.pull = w.grip(limb, at, hand.path.empty() ? 0 : duration);
  double p[3];
  VirtualHand::Waypoint here{0, {}};
  w.grip_position(limb.pull, p);
  mju_subFrom3(p, limb.base_p.data());
  mju_mulMatTVec3(here.position.data(), limb.base_R.data(), p);
  limb.hand.path.insert(limb.hand.path.begin(), here);
}

// At rest, where the pose in O says.
void World::Impl::set_pose(int body, const std::array<double, 7>& pose, const Limb& limb) {
  const int joint = model->body_jntadr[body];
  double* q = data->qpos + model->jnt_qposadr[joint];
  double base_quat[4];
  to_world(limb, pose.data(), q);
  mju_mat2Quat(base_quat, limb.base_R.data());
  mju_mulQuat(q + 3, base_quat, pose.data() + 3);
  mju_normalize4(q + 3);
  mju_zero(data->qvel + model->jnt_dofadr[joint], 6);
  mj_step1(model, data.get());
}

void World::move_object(const std::string& name, const std::array<double, 7>& pose, std::size_t arm) {
  Impl& w = *impl_;
  std::string names;
  for (std::size_t i = 0; i < w.objects.size(); ++i) {
    const int body = w.objects[i];
    if (w.model->jnt_type[w.model->body_jntadr[body]] != mjJNT_FREE) continue;
    if (w.object_names[i] == name) return w.set_pose(body, pose, w.limbs[arm]);
    names += (names.empty() ? "" : ", ") + w.object_names[i];
  }
  throw std::runtime_error("no object is called \"" + name + "\" that can be moved; there " +
                           (names.empty() ? "is none" : "are " + names));
}

void World::add_object(const Object& object, std::size_t arm) {
  Impl& w = *impl_;
  if (mj_name2id(w.model, mjOBJ_BODY, object.name.c_str()) >= 0) {
    throw std::runtime_error("something is called \"" + object.name + "\" already");
  }
  if (w.changes >= kMostAdded) {
    throw std::runtime_error(std::to_string(kMostAdded) + " objects were added already, which is all there is room for: move "
                             "one of them where it is needed");
  }
  const Limb& limb = w.limbs[arm];
  mjsBody* body = mjs_addBody(mjs_findBody(w.scene.spec.get(), "world"), nullptr);
  mjs_setName(body->element, object.name.c_str());
  double base_quat[4];
  w.to_world(limb, object.pose.data(), body->pos);
  mju_mat2Quat(base_quat, limb.base_R.data());
  mju_mulQuat(body->quat, base_quat, object.pose.data() + 3);
  if (object.mass > 0) mjs_addFreeJoint(body);
  mjsGeom* geom = mjs_addGeom(body, nullptr);
  mjs_setName(geom->element, object.name.c_str());
  constexpr mjtGeom kShapes[] = {mjGEOM_BOX, mjGEOM_SPHERE, mjGEOM_CYLINDER, mjGEOM_CAPSULE};
  geom->type = kShapes[static_cast<int>(object.shape)];
  const bool box = object.shape == Object::Shape::kBox;
  for (int i = 0; i < 3; ++i) geom->size[i] = box || i == 1 ? object.size[i] / 2 : object.size[i];
  geom->mass = object.mass;
  geom->friction[0] = object.friction;
  for (int i = 0; i < 3; ++i) geom->rgba[i] = object.colour[i];
  try {
    recompile(w.scene.spec.get(), w.arms, w.model, w.data.get());
  } catch (const std::runtime_error& error) {
    mjs_delete(w.scene.spec.get(), body->element);
    throw std::runtime_error("\"" + object.name + "\" cannot be added: " + error.what());
  }
  w.find_everything("");
  ++w.changes;
  mj_step1(w.model, w.data.get());
}

void World::set_friction(const std::string& name, double friction) {
  Impl& w = *impl_;
  const int body = mj_name2id(w.model, mjOBJ_BODY, name.c_str()), geom = mj_name2id(w.model, mjOBJ_GEOM, name.c_str());
  const bool arms_own = name.find('/') != std::string::npos;
  if ((body < 0 && geom < 0) || arms_own) {
    throw std::runtime_error("no body or geom of the scene is called \"" + name + "\"");
  }
  // In the spec as well, from which the model is made anew when something is added.
  const auto change = [&](mjsGeom* spec, int id) {
    spec->friction[0] = friction;
    if (spec->priority < 2) {
      // Before the arm's own figures, which therefore come with it.
      spec->priority = 2;
      set_arm_contact(spec);
    }
    w.take_touch(spec, id);
  };
  mjSpec* spec = w.scene.spec.get();
  if (body >= 0) {
    mjsBody* found = mjs_findBody(spec, name.c_str());
    for (mjsElement* e = mjs_firstChild(found, mjOBJ_GEOM, 0); e; e = mjs_nextChild(found, e, 0)) {
      change(mjs_asGeom(e), mjs_getId(e));
    }
  } else {
    mjsElement* found = mjs_findElement(spec, mjOBJ_GEOM, name.c_str());
    change(mjs_asGeom(found), geom);
  }
  w.wake();
}

// --- everything -----------------------------------------------------------------------------------------------

std::shared_ptr<const World::Moment> World::save() {
  Impl& w = *impl_;
  w.wake();  // as restore() does, so that what follows is the same
  auto moment = std::make_shared<Moment>();
  moment->changes = w.changes;
  for (int geom = 0; geom < w.model->ngeom; ++geom) moment->touches.push_back(w.touch(geom));
  moment->limbs = w.limbs;
  moment->state.resize(mj_stateSize(w.model, mjSTATE_INTEGRATION));
  mj_getState(w.model, w.data.get(), moment->state.data(), mjSTATE_INTEGRATION);
  return moment;
}

void World::restore(const Moment& moment) {
  Impl& w = *impl_;
  if (moment.changes != w.changes) throw std::runtime_error("objects were added since that moment was saved");
  for (mjsElement* e = mjs_firstElement(w.scene.spec.get(), mjOBJ_GEOM); e; e = mjs_nextElement(w.scene.spec.get(), e)) {
    const int id = mjs_getId(e);
    const Touch& touch = moment.touches.at(id);
    if (w.touch(id) == touch) continue;
    mjsGeom* geom = mjs_asGeom(e);
    geom->friction[0] = touch.friction;
    geom->priority = touch.priority;
    geom->condim = touch.condim;
    mju_copy(geom->solref, touch.solref.data(), mjNREF);
    mju_copy(geom->solimp, touch.solimp.data(), mjNIMP);
    w.take_touch(geom, id);
  }
  w.limbs = moment.limbs;
  w.touched = true;
  mj_setState(w.model, w.data.get(), moment.state.data(), mjSTATE_INTEGRATION);
  w.wake();
}

const std::vector<std::string>& World::objects() const { return impl_->object_names; }

std::array<double, 7> World::object_pose(std::size_t index, std::size_t arm) const {
  const Impl& w = *impl_;
  const Limb& limb = w.limbs[arm];
  const int body = w.objects.at(index);
  double world[3], base_quat[4], inverse[4];
  std::array<double, 7> pose;
  mju_sub3(world, w.data->xpos + 3 * body, limb.base_p.data());
  mju_mulMatTVec3(pose.data(), limb.base_R.data(), world);
  mju_mat2Quat(base_quat, limb.base_R.data());
  mju_negQuat(inverse, base_quat);
  mju_mulQuat(pose.data() + 3, inverse, w.data->xquat + 4 * body);
  return pose;
}

std::span<const double> World::qpos() const { return {impl_->data->qpos, static_cast<std::size_t>(impl_->model->nq)}; }

int World::changes() const { return impl_->changes; }
SpecPtr World::spec() const { return SpecPtr(mj_copySpec(impl_->scene.spec.get())); }

}  // namespace sim
