#pragma once

#include <mujoco/mujoco.h>

#include <memory>
#include <string>

#include "models/arm.hpp"

namespace sim {

struct DeleteModel {
  void operator()(mjModel* model) const { mj_deleteModel(model); }
};
struct DeleteData {
  void operator()(mjData* data) const { mj_deleteData(data); }
};
using ModelPtr = std::unique_ptr<mjModel, DeleteModel>;
using DataPtr = std::unique_ptr<mjData, DeleteData>;

// Name of the site in a scene's worldbody where the arm's base stands; its z points up.
inline constexpr const char* kArmSite = "arm";
// Before the names of everything that belongs to the arm in the compiled model: arm/link0 to arm/link7, arm/joint1 to
// arm/joint7, arm/hand, arm/tcp (site), arm/finger1, arm/finger2 (bodies and joints).
inline constexpr const char* kArmPrefix = "arm/";

// The arm (with its hand, if asked for) in a scene: an MJCF file, or a bare floor when the name is empty. The scene's
// physics options (time step, solver, gravity) are replaced by ours; timestep in s. `meshes`: folder of FR3's visual
// meshes (link0_0_vis.obj and so on), for pictures; without it the arm looks like its collision geometry. Throws
// std::runtime_error which names the file and what is missing or wrong in it.
ModelPtr build_scene(const models::Arm& arm, bool hand, const std::string& scene, double timestep = 1e-3,
                     const std::string& meshes = "");

// Groups of the arm's geoms.
inline constexpr int kCollisionGroup = 3, kVisualGroup = 2;

}  // namespace sim
