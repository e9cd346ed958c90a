#include "sim/world/scene.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <stdexcept>

#include "models/joint_figures.hpp"
#include "wire/fci/layout.hpp"

namespace sim {
namespace {

constexpr const char* kFloorOnly = R"(
<mujoco model="floor">
  <worldbody>
    <light pos="0.5 -1 3" dir="-0.1 0.3 -1" type="directional"/>
    <geom name="floor" type="plane" size="3 3 0.1" rgba="0.86 0.87 0.89 1"/>
    <site name="arm"/>
  </worldbody>
</mujoco>)";

// The arm touches its surroundings and other arms, and not itself: parts of it that cross are the business of the
// robot's self-collision avoidance, and neighbouring capsules overlap by design. Each arm has a bit of its own, to which
// the others answer; the first bit is the scenes' default.
constexpr int kSceneBit = 1;
int bit_of(std::size_t arm) { return 2 << arm; }
int bits_of_others(std::size_t arm, std::size_t count) { return ((2 << count) - 2) & ~bit_of(arm); }

// Contacts of the arm are stiff: a time constant of four cycles is some 10^5 N/m at the hand. Rubber on the fingertips;
// condim 4 adds friction against turning about the normal, since a flat pad is more than points.
constexpr std::array<double, mjNREF> kSolref = {0.004, 1};
constexpr std::array<double, mjNIMP> kSolimp = {0.95, 0.99, 0.001, 0.5, 2};
constexpr std::array<double, 3> kMetalFriction = {0.4, 0.005, 0.0001};
constexpr std::array<double, 3> kRubberFriction = {1.0, 0.01, 0.0001};

// Mechanical stops this far beyond the widest range that may be commanded (assumed: Franka gives none).
constexpr double kStopMargin = 0.05;  // rad

// The drive of a finger as seen at it (assumed): much more than the finger's own 0.03 kg.
constexpr double kFingerArmature = 0.2;  // kg

template <std::size_t n, class T>
void set(T (&to)[n], const std::array<double, n>& from) {
  std::copy(from.begin(), from.end(), to);
}

void set_inertia(mjsBody* body, const models::Link& link) {
  body->explicitinertial = 1;
  body->mass = link.mass;
  set(body->ipos, link.com);
  set(body->fullinertia, link.inertia);
}

// Rotation of fixed-axis roll, pitch, yaw.
void set_rotation(double (&quat)[4], const models::Vector3& rpy) {
  mju_euler2Quat(quat, rpy.data(), "XYZ");
}

}  // namespace

void set_arm_contact(mjsGeom* geom) {
  geom->condim = 4;
  set(geom->solref, kSolref);
  set(geom->solimp, kSolimp);
}

namespace {

mjsGeom* add_geom(mjsBody* body, mjtGeom type, const models::Vector3& pos, const models::Vector3& size,
                  const std::array<double, 3>& friction) {
  mjsGeom* geom = mjs_addGeom(body, nullptr);
  geom->type = type;
  set(geom->pos, pos);
  set(geom->size, size);
  geom->contype = kSceneBit;
  geom->priority = 1;  // before the default of scenes; a scene's soft surface takes 2
  set_arm_contact(geom);
  set(geom->friction, friction);
  geom->mass = 0;
  geom->group = kCollisionGroup;
  constexpr std::array<float, 4> kWhite = {0.93f, 0.94f, 0.95f, 1};
  std::copy(kWhite.begin(), kWhite.end(), geom->rgba);
  return geom;
}

mjsGeom* add_capsule(mjsBody* body, const models::Capsule& capsule) {
  mjsGeom* geom =
      add_geom(body, mjGEOM_CAPSULE, capsule.centre, {capsule.radius, capsule.length / 2, 0}, kMetalFriction);
  constexpr double kHalfPi = 1.57079632679489662;
  if (capsule.axis == 'x') set_rotation(geom->quat, {0, kHalfPi, 0});
  if (capsule.axis == 'y') set_rotation(geom->quat, {kHalfPi, 0, 0});
  return geom;
}

mjsBody* add_body(mjsBody* parent, const std::string& name) {
  mjsBody* body = mjs_addBody(parent, nullptr);
  mjs_setName(body->element, name.c_str());
  return body;
}

mjsJoint* add_joint(mjsBody* body, mjtJoint type, const std::string& name, const models::Vector3& axis, double lower,
                    double upper, double armature) {
  mjsJoint* joint = mjs_addJoint(body, nullptr);
  mjs_setName(joint->element, name.c_str());
  joint->type = type;
  set(joint->axis, axis);
  joint->limited = mjLIMITED_TRUE;
  joint->range[0] = lower;
  joint->range[1] = upper;
  set(joint->solref_limit, kSolref);
  joint->armature = armature;
  return joint;
}

// Dimensions of hand and fingers from Franka's drawings, rounded; in the hand's and the finger's frame.
void add_hand(mjsBody* flange, models::Vector3 flange_xyz) {
  mjsBody* hand = add_body(flange, "hand");
  set(hand->pos, flange_xyz);
  set_rotation(hand->quat, {0, 0, models::hand::kYaw});
  set_inertia(hand, models::hand::kHand);
  // Its body, with round ends: it lies inside of models::kHandHull.
  add_geom(hand, mjGEOM_BOX, {0, 0, 0.033}, {0.0185, 0.083, 0.033}, kMetalFriction);
  for (const double side : {-1, 1}) {
    add_geom(hand, mjGEOM_CAPSULE, {0, side * 0.083, 0.033}, {0.0205, 0.0125, 0}, kMetalFriction);
  }

  mjsSite* tcp = mjs_addSite(hand, nullptr);
  mjs_setName(tcp->element, "tcp");
  tcp->pos[2] = models::hand::kTcp;
  tcp->group = kCollisionGroup;

  // Beside the fingers and turned towards them by 15°: they come into the picture from below.
  mjsCamera* wrist = mjs_addCamera(hand, nullptr);
  mjs_setName(wrist->element, "wrist");
  set(wrist->pos, models::Vector3{0.07, 0, 0.01});
  set(wrist->quat, std::array<double, 4>{0.0923, 0.7010, 0.7010, 0.0923});
  wrist->fovy = 60;  // degrees

  for (int i = 1; i <= 2; ++i) {
    const std::string name = "finger" + std::to_string(i);
    mjsBody* finger = add_body(hand, name);
    finger->pos[2] = models::hand::kFingerZ;
    if (i == 2) set_rotation(finger->quat, {0, 0, 3.14159265358979324});
    set_inertia(finger, models::hand::kFinger);
    add_joint(finger, mjJNT_SLIDE, name, {0, 1, 0}, 0, models::hand::kMaxWidth / 2, kFingerArmature);
    add_geom(finger, mjGEOM_BOX, {0, 0.014, 0.018}, {0.0105, 0.008, 0.018}, kMetalFriction);
    add_geom(finger, mjGEOM_BOX, {0, 0.004, 0.045}, {0.010, 0.004, 0.009}, kRubberFriction);
    // Just beyond the pad's end: what the finger presses on is met in one point, not in the four corners of a box.
    add_geom(finger, mjGEOM_SPHERE, {0, 0.004, 0.0505}, {0.004, 0, 0}, kRubberFriction);
  }
}

SpecPtr arm_spec(const models::Arm& arm, bool with_hand, std::size_t index, std::size_t count) {
  SpecPtr spec(mj_makeSpec());
  spec->compiler.degree = 0;
  spec->compiler.balanceinertia = 1;  // see restore_inertia()
  mjsBody* body = add_body(mjs_findBody(spec.get(), "world"), "link0");
  set_inertia(body, arm.links[0]);
  const models::Limits& limits = models::limits(arm, fci::kNewestVersion);
  for (int i = 0; i <= 7; ++i) {
    if (i > 0) {
      body = add_body(body, "link" + std::to_string(i));
      if (i == 1) body->sleep = mjSLEEP_NEVER;  // for all that hangs on it
      set(body->pos, arm.joints[i - 1].xyz);
      set_rotation(body->quat, arm.joints[i - 1].rpy);
      set_inertia(body, arm.links[i]);
      add_joint(body, mjJNT_HINGE, "joint" + std::to_string(i), {0, 0, 1}, limits.q_min[i - 1] - kStopMargin,
                limits.q_max[i - 1] + kStopMargin, models::kMotorInertia[i - 1]);
    }
    for (const models::Capsule& capsule : models::capsules()) {
      if (capsule.link != i) continue;
      mjsGeom* geom = add_capsule(body, capsule);
      if (i <= 1) geom->contype = 0;  // the base and the column that turns in place reach into what they stand on
    }
  }
  if (with_hand) add_hand(body, arm.joints[7].xyz);
  for (mjsElement* e = mjs_firstElement(spec.get(), mjOBJ_GEOM); e; e = mjs_nextElement(spec.get(), e)) {
    mjsGeom* geom = mjs_asGeom(e);
    if (geom->contype != 0) geom->contype |= bit_of(index);
    geom->conaffinity = bits_of_others(index, count);
  }
  return spec;
}

// MuJoCo's messages have several lines.
std::string one_line(std::string text) {
  while (!text.empty() && text.back() == '\n') text.pop_back();
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

// Ours lie beside the programs, and are asked for by name.
std::string file_of(const std::string& scene) {
  if (scene.find('/') != std::string::npos || scene.ends_with(".xml")) return scene;
  const auto folder = std::filesystem::canonical("/proc/self/exe").parent_path() / "../share/fci-sim/scenes";
  const auto file = folder / (scene + ".xml");
  if (std::filesystem::is_regular_file(file)) return file.lexically_normal().string();
  std::vector<std::string> names;
  std::error_code none;
  for (const auto& entry : std::filesystem::directory_iterator(folder, none)) {
    if (entry.path().extension() == ".xml") names.push_back(entry.path().stem());
  }
  std::sort(names.begin(), names.end());
  std::string list;
  for (const auto& name : names) list += (list.empty() ? "" : ", ") + name;
  throw std::runtime_error("scene " + scene + ": there is none of this name; expected an MJCF file (NAME.xml), or one of " +
                           list);
}

SpecPtr read_scene(const std::string& scene) {
  char error[1000] = "";
  if (scene.empty()) return SpecPtr(mj_parseXMLString(kFloorOnly, nullptr, error, sizeof error));
  const std::string file = file_of(scene);
  if (!std::filesystem::is_regular_file(file)) {
    throw std::runtime_error("scene " + file + ": no such file; expected an MJCF file");
  }
  SpecPtr spec(mj_parseXML(file.c_str(), nullptr, error, sizeof error));
  if (!spec) throw std::runtime_error("scene " + file + " is not MJCF that MuJoCo reads: " + one_line(error));
  return spec;
}

// Semi-implicit Euler: nothing of ours has stiff damping of MuJoCo's kind, and it costs least. Elliptic cones with
// impratio let a grasped thing creep so little that it stays. Things at rest sleep, which takes no time, until they are
// touched. No reset to the start when the physics breaks down.
void set_physics(mjOption& option, double timestep) {
  mj_defaultOption(&option);
  option.timestep = timestep;
  option.integrator = mjINT_EULER;
  option.cone = mjCONE_ELLIPTIC;
  option.impratio = 10;
  option.iterations = 20;
  option.ls_iterations = 20;
  option.disableflags = mjDSBL_AUTORESET;
  option.enableflags = mjENBL_SLEEP;
}

struct Colour {
  const char* name;
  std::array<float, 3> rgb;
  float specular, shininess;
};
constexpr std::array<Colour, 7> kColours = {{{"white", {0.95f, 0.95f, 0.95f}, 0.35f, 0.6f},
                                             {"black", {0.13f, 0.13f, 0.14f}, 0.35f, 0.5f},
                                             {"grey", {0.70f, 0.71f, 0.72f}, 0.35f, 0.5f},
                                             {"steel", {0.85f, 0.87f, 0.88f}, 0.50f, 0.7f},
                                             {"red", {0.85f, 0.10f, 0.07f}, 0.35f, 0.5f},
                                             {"green", {0.15f, 0.65f, 0.20f}, 0.35f, 0.5f},
                                             {"blue", {0.05f, 0.45f, 0.75f}, 0.35f, 0.5f}}};

// Before the names of what pictures alone need.
const std::string kMeshPrefix = "arm/";

// Parts of FR3's visual meshes: file without _vis.obj, body, colour.
struct Part {
  const char* file;
  const char* body;
  const char* colour;
};
constexpr std::array<Part, 37> kParts = {{
    {"link0_0", "link0", "black"},  {"link0_1", "link0", "white"},   {"link0_2", "link0", "white"},
    {"link0_3", "link0", "white"},  {"link0_4", "link0", "white"},   {"link0_5", "link0", "red"},
    {"link0_6", "link0", "black"},  {"link1", "link1", "white"},     {"link2", "link2", "white"},
    {"link3_0", "link3", "white"},  {"link3_1", "link3", "black"},   {"link4_0", "link4", "white"},
    {"link4_1", "link4", "black"},  {"link5_0", "link5", "white"},   {"link5_1", "link5", "white"},
    {"link5_2", "link5", "black"},  {"link6_0", "link6", "green"},   {"link6_1", "link6", "white"},
    {"link6_2", "link6", "white"},  {"link6_3", "link6", "grey"},    {"link6_4", "link6", "red"},
    {"link6_5", "link6", "white"},  {"link6_6", "link6", "black"},   {"link6_7", "link6", "blue"},
    {"link7_0", "link7", "black"},  {"link7_1", "link7", "white"},   {"link7_2", "link7", "white"},
    {"link7_3", "link7", "black"},  {"hand_0", "hand", "steel"},     {"hand_1", "hand", "black"},
    {"hand_2", "hand", "black"},    {"hand_3", "hand", "white"},     {"hand_4", "hand", "steel"},
    {"finger_0", "finger1", "steel"}, {"finger_1", "finger1", "black"}, {"finger_0", "finger2", "steel"},
    {"finger_1", "finger2", "black"},
}};

// Colours and meshes are shared by the arms, and lie in the spec once.
void add_meshes(mjSpec* spec, const std::string& prefix, const std::string& folder) {
  for (const Colour& colour : kColours) {
    if (mjs_findElement(spec, mjOBJ_MATERIAL, (kMeshPrefix + colour.name).c_str())) continue;
    mjsMaterial* material = mjs_addMaterial(spec, nullptr);
    mjs_setName(material->element, (kMeshPrefix + colour.name).c_str());
    std::copy(colour.rgb.begin(), colour.rgb.end(), material->rgba);
    material->specular = colour.specular;
    material->shininess = colour.shininess;
  }
  for (const Part& part : kParts) {
    mjsBody* body = mjs_findBody(spec, (prefix + part.body).c_str());
    if (!body) continue;  // without a hand
    const std::string name = kMeshPrefix + part.file;
    if (!mjs_findElement(spec, mjOBJ_MESH, name.c_str())) {
      mjsMesh* mesh = mjs_addMesh(spec, nullptr);
      mjs_setName(mesh->element, name.c_str());
      mjs_setString(mesh->file, (std::filesystem::absolute(folder) / (std::string(part.file) + "_vis.obj")).c_str());
    }
    mjsGeom* geom = mjs_addGeom(body, nullptr);
    geom->type = mjGEOM_MESH;
    mjs_setString(geom->meshname, name.c_str());
    mjs_setString(geom->material, (kMeshPrefix + part.colour).c_str());
    geom->contype = geom->conaffinity = 0;
    geom->mass = 0;
    geom->group = kVisualGroup;
  }
}

// The compiler refuses, or changes, an inertia whose principal moments no distribution of mass has (A + B < C), as that of
// FER's identified link4. Puts the figures back: the arm is to move as its own model says.
void restore_inertia(mjModel* model, const std::vector<const models::Arm*>& arms) {
  for (std::size_t index = 0; index < arms.size(); ++index) {
    for (int i = 0; i <= 7; ++i) {
      const std::string name = arm_prefix(index, arms.size()) + "link" + std::to_string(i);
      const int body = mj_name2id(model, mjOBJ_BODY, name.c_str());
      const auto& I = arms[index]->links[i].inertia;
      const double full[9] = {I[0], I[3], I[4], I[3], I[1], I[5], I[4], I[5], I[2]};
      double axes[9];
      mju_eig3(model->body_inertia + 3 * body, axes, model->body_iquat + 4 * body, full);
    }
  }
  DataPtr data(mj_makeData(model));
  mj_setConst(model, data.get());
}

// MuJoCo reads "nan" and "inf" as numbers, and a world with one in it moves nowhere and collides with nothing.
void require_numbers(const mjModel& m, const std::string& title) {
  struct Values {
    mjtObj kind;
    const char* name;
    const mjtNum* values;
    mjtSize count;
    int width;
  };
  const std::array<Values, 19> all = {{
      {mjOBJ_BODY, "pos of body", m.body_pos, m.nbody, 3},
      {mjOBJ_BODY, "orientation of body", m.body_quat, m.nbody, 4},
      {mjOBJ_BODY, "centre of mass of body", m.body_ipos, m.nbody, 3},
      {mjOBJ_BODY, "axes of inertia of body", m.body_iquat, m.nbody, 4},
      {mjOBJ_BODY, "mass of body", m.body_mass, m.nbody, 1},
      {mjOBJ_BODY, "inertia of body", m.body_inertia, m.nbody, 3},
      {mjOBJ_JOINT, "pos of joint", m.jnt_pos, m.njnt, 3},
      {mjOBJ_JOINT, "axis of joint", m.jnt_axis, m.njnt, 3},
      {mjOBJ_JOINT, "range of joint", m.jnt_range, m.njnt, 2},
      {mjOBJ_JOINT, "stiffness of joint", m.jnt_stiffness, m.njnt, 1},
      {mjOBJ_GEOM, "pos of geom", m.geom_pos, m.ngeom, 3},
      {mjOBJ_GEOM, "orientation of geom", m.geom_quat, m.ngeom, 4},
      {mjOBJ_GEOM, "size of geom", m.geom_size, m.ngeom, 3},
      {mjOBJ_GEOM, "friction of geom", m.geom_friction, m.ngeom, 3},
      {mjOBJ_SITE, "pos of site", m.site_pos, m.nsite, 3},
      {mjOBJ_SITE, "orientation of site", m.site_quat, m.nsite, 4},
      {mjOBJ_UNKNOWN, "damping of a joint", m.dof_damping, m.nv, 1},
      {mjOBJ_UNKNOWN, "armature of a joint", m.dof_armature, m.nv, 1},
      {mjOBJ_UNKNOWN, "friction of a joint", m.dof_frictionloss, m.nv, 1},
  }};
  for (const auto& [kind, what, values, count, width] : all) {
    for (mjtSize i = 0; i < count * width; ++i) {
      if (std::isfinite(values[i])) continue;
      const char* name = kind == mjOBJ_UNKNOWN ? nullptr : mj_id2name(&m, kind, static_cast<int>(i / width));
      throw std::runtime_error(title + ": " + what + (name ? " \"" + std::string(name) + "\"" : "") + " is " +
                               std::to_string(values[i]) + "; expected a number");
    }
  }
}

std::string title_of(const std::string& scene) { return scene.empty() ? "floor" : "scene " + scene; }

// nullptr where the worldbody has none.
mjsElement* find_site(mjSpec* spec, const std::string& name) {
  mjsElement* site = mjs_findElement(spec, mjOBJ_SITE, name.c_str());
  return site && mjs_getParent(site) == mjs_findBody(spec, "world") ? site : nullptr;
}

std::size_t count_arms(mjSpec* spec, const std::string& scene) {
  if (find_site(spec, kArmSite)) return 1;
  std::size_t count = 0;
  while (find_site(spec, kArmSite + std::to_string(count + 1))) ++count;
  if (count >= 2) return count;
  throw std::runtime_error(title_of(scene) + " has no place for the arm: expected <site name=\"" + kArmSite +
                           "\" pos=\"x y z\"/> in its worldbody, where the base is to stand (several arms: \"" +
                           kArmSite + "1\", \"" + kArmSite + "2\" and so on)");
}

}  // namespace

std::string arm_prefix(std::size_t index, std::size_t count) {
  return count == 1 ? std::string(kArmSite) + "/" : kArmSite + std::to_string(index + 1) + "/";
}

std::size_t arms_in_scene(const std::string& scene) { return count_arms(read_scene(scene).get(), scene); }

Scene build_scene(const std::vector<const models::Arm*>& arms, bool hand, const std::string& scene, double timestep) {
  SpecPtr spec = read_scene(scene);
  const std::string title = title_of(scene);
  const std::size_t places = count_arms(spec.get(), scene);
  if (arms.size() != places) {
    throw std::runtime_error(title + " has places for " + std::to_string(places) + " arms, and " +
                             std::to_string(arms.size()) + " are to stand in it");
  }
  for (std::size_t i = 0; i < arms.size(); ++i) {
    const std::string prefix = arm_prefix(i, places), site = prefix.substr(0, prefix.size() - 1);
    SpecPtr child = arm_spec(*arms[i], hand, i, places);
    if (!mjs_attach(find_site(spec.get(), site), mjs_findBody(child.get(), "link0")->element, prefix.c_str(), "")) {
      throw std::runtime_error(title + ": the arm could not be placed in it: " + one_line(mjs_getError(spec.get())));
    }
  }
  set_physics(spec->option, timestep);

  ModelPtr model(mj_compile(spec.get(), nullptr));
  if (!model) throw std::runtime_error(title + " does not compile with the arm in it: " + one_line(mjs_getError(spec.get())));
  require_numbers(*model, title);
  restore_inertia(model.get(), arms);

  // Gravity compensation and the estimates of the state take the base for upright.
  for (std::size_t i = 0; i < arms.size(); ++i) {
    const std::string prefix = arm_prefix(i, places), site = prefix.substr(0, prefix.size() - 1);
    double R[9];
    mju_quat2Mat(R, model->site_quat + 4 * mj_name2id(model.get(), mjOBJ_SITE, site.c_str()));
    if (R[8] < 1 - 1e-9) {
      throw std::runtime_error(title + ": the site \"" + site + "\" is tilted; its z axis must point up");
    }
  }
  return {std::move(spec), std::move(model)};
}

void recompile(mjSpec* spec, const std::vector<const models::Arm*>& arms, mjModel* model, mjData* data) {
  // Where it does not compile mj_recompile() leaves neither model nor data: tried first, with a copy, since a spec knows
  // from its last compilation where its state is.
  const SpecPtr trial(mj_copySpec(spec));
  if (!ModelPtr(mj_compile(trial.get(), nullptr))) throw std::runtime_error(one_line(mjs_getError(trial.get())));
  if (mj_recompile(spec, nullptr, model, data) != 0) throw std::runtime_error(one_line(mjs_getError(spec)));
  restore_inertia(model, arms);
}

ModelPtr with_meshes(const mjSpec* spec, std::size_t arms, const std::string& meshes) {
  SpecPtr copy(mj_copySpec(spec));
  if (!meshes.empty()) {
    for (std::size_t i = 0; i < arms; ++i) add_meshes(copy.get(), arm_prefix(i, arms), meshes);
  }
  ModelPtr model(mj_compile(copy.get(), nullptr));
  if (!model) throw std::runtime_error("the arm's meshes in " + meshes + ": " + one_line(mjs_getError(copy.get())));
  return model;
}

}  // namespace sim
