#pragma once

#include <mujoco/mujoco.h>

#include <memory>
#include <string>
#include <vector>

#include "models/arm.hpp"

namespace sim {

struct DeleteSpec {
  void operator()(mjSpec* spec) const { mj_deleteSpec(spec); }
};
struct DeleteModel {
  void operator()(mjModel* model) const { mj_deleteModel(model); }
};
struct DeleteData {
  void operator()(mjData* data) const { mj_deleteData(data); }
};
using SpecPtr = std::unique_ptr<mjSpec, DeleteSpec>;
using ModelPtr = std::unique_ptr<mjModel, DeleteModel>;
using DataPtr = std::unique_ptr<mjData, DeleteData>;

// Name of the site in a scene's worldbody where the arm's base stands; its z points up. Where several arms stand, the
// sites are arm1, arm2 and so on.
inline constexpr const char* kArmSite = "arm";

// Before the names of everything that belongs to an arm in the compiled model is its site and a slash: arm/link0 to
// arm/link7, arm/joint1 to arm/joint7, arm/hand, arm/tcp (site), arm/wrist (camera), arm/finger1, arm/finger2 (bodies
// and joints).
std::string arm_prefix(std::size_t index, std::size_t count);

struct Scene {
  SpecPtr spec;  // what the model was compiled from
  ModelPtr model;
};

// Arms (with their hands, if asked for) in a scene: an MJCF file, the name of one of ours, or a bare floor when empty.
// The scene's physics options (time step, solver, gravity) are replaced by ours; timestep in s. Throws
// std::runtime_error which names the file and what is missing or wrong in it.
Scene build_scene(const std::vector<const models::Arm*>& arms, bool hand, const std::string& scene,
                  double timestep = 1e-3);

// How many arms share a scene: 1 with the site arm, N with the sites arm1 to armN. Throws like build_scene.
std::size_t arms_in_scene(const std::string& scene);

// Compiles again what the spec has become, and keeps the state. Throws std::runtime_error with MuJoCo's words; model and
// data are then as they were.
void recompile(mjSpec* spec, const std::vector<const models::Arm*>& arms, mjModel* model, mjData* data);

// The same scene with FR3's visual meshes on its arms, for pictures; `meshes` is their folder (link0_0_vis.obj and so
// on). Throws std::runtime_error.
ModelPtr with_meshes(const mjSpec* spec, std::size_t arms, const std::string& meshes);

// How the arm's geoms touch: stiff, and with friction about the normal.
void set_arm_contact(mjsGeom* geom);

// Groups of the arm's geoms.
inline constexpr int kCollisionGroup = 3, kVisualGroup = 2;

}  // namespace sim
