#pragma once

#include <mujoco/mujoco.h>

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "sim/world/scene.hpp"

namespace sim {

// Rows from the top.
struct Picture {
  int width = 0, height = 0;
  std::vector<unsigned char> rgb;
  std::vector<float> depth;  // m along the camera's axis; infinite where nothing is
};

// Folder of FR3's visual meshes: $FRANKA_MESHES, or where it was at build time; empty when there is none.
std::string meshes_folder();

// Takes pictures of a scene off screen, without display or GPU, through OSMesa. Of one thread.
class Camera {
 public:
  // `meshes`: the model has them, so collision geometry is hidden. Sizes in pixels. Throws std::runtime_error.
  Camera(ModelPtr model, bool meshes, int width, int height);
  ~Camera();

  // From a camera of the model; -1: the scene's "overview", or a view of the whole arm. The joints' positions may be fewer than the model's.
  Picture take(std::span<const double> qpos, int camera = -1);
  const mjModel* model() const;
  int width() const;
  int height() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace sim
