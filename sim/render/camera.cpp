#include "sim/render/camera.hpp"

#include <GL/osmesa.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <mutex>
#include <stdexcept>

namespace sim {
namespace {

constexpr int kSamples = 2;  // drawn pixels per pixel, each way, against jagged edges

// MuJoCo finds OpenGL's functions once for all threads.
std::mutex& drawing() {
  static std::mutex mutex;
  return mutex;
}

// An OpenGL context in memory.
class OffScreen {
 public:
  OffScreen(int width, int height) : width_(width), height_(height), buffer_(4u * width * height) {
    context_ = OSMesaCreateContextExt(OSMESA_RGBA, 24, 8, 8, nullptr);
    if (!context_ || !enter()) {
      throw std::runtime_error("OSMesa gives no context to draw " + std::to_string(width) + " x " +
                               std::to_string(height) + " pixels in");
    }
  }
  ~OffScreen() { OSMesaDestroyContext(context_); }
  bool enter() { return OSMesaMakeCurrent(context_, buffer_.data(), GL_UNSIGNED_BYTE, width_, height_); }

 private:
  int width_, height_;
  std::vector<unsigned char> buffer_;
  OSMesaContext context_ = nullptr;
};

void light(mjVisual& visual, int width, int height) {
  for (int i = 0; i < 3; ++i) {
    visual.headlight.ambient[i] = 0.36f;
    visual.headlight.diffuse[i] = 0.22f;
    visual.headlight.specular[i] = 0.05f;
  }
  visual.quality.shadowsize = 2048;
  visual.global.offwidth = width;
  visual.global.offheight = height;
  visual.global.fovy = 38;
}

// The arm, or the arms, as a visitor sees them.
mjvCamera overview(const mjModel* model) {
  mjvCamera camera;
  mjv_defaultCamera(&camera);
  double middle[3] = {};
  int arms = 0;
  for (int site = 0; site < model->nsite; ++site) {
    const char* name = mj_id2name(model, mjOBJ_SITE, site);
    const std::string text = name ? name : "";
    if (!text.starts_with(kArmSite) || text.find('/') != std::string::npos) continue;
    mju_addTo3(middle, model->site_pos + 3 * site);
    ++arms;
  }
  mju_addToScl3(camera.lookat, middle, 1.0 / std::max(arms, 1));
  camera.lookat[0] += 0.27;
  camera.lookat[2] += 0.28;
  camera.distance = arms > 1 ? 2.6 : 1.7;
  camera.azimuth = 138;
  camera.elevation = -20;
  return camera;
}

}  // namespace

struct Camera::Impl {
  ModelPtr model;
  DataPtr data;
  int width, height;
  std::unique_ptr<OffScreen> screen;
  mjvScene scene;
  mjrContext context;
  mjvOption option;
};

std::string meshes_folder() {
  const char* named = std::getenv("FRANKA_MESHES");
  const std::string folder = named ? named : FRANKA_MESHES;
  return std::filesystem::is_directory(folder) ? folder : "";
}

Camera::Camera(ModelPtr model, bool meshes, int width, int height) : impl_(std::make_unique<Impl>()) {
  const std::lock_guard lock(drawing());
  Impl& c = *impl_;
  c.model = std::move(model);
  c.data.reset(mj_makeData(c.model.get()));
  c.width = width;
  c.height = height;
  light(c.model->vis, width * kSamples, height * kSamples);
  c.model->vis.map.znear = static_cast<float>(0.01 / c.model->stat.extent);  // m
  c.screen = std::make_unique<OffScreen>(width * kSamples, height * kSamples);
  mjv_defaultScene(&c.scene);
  mjv_makeScene(c.model.get(), &c.scene, 2000);
  mjr_defaultContext(&c.context);
  mjr_makeContext(c.model.get(), &c.context, mjFONTSCALE_100);
  mjr_setBuffer(mjFB_OFFSCREEN, &c.context);
  mjv_defaultOption(&c.option);
  c.option.geomgroup[kVisualGroup] = 1;
  c.option.geomgroup[kCollisionGroup] = !meshes;
  std::fill(std::begin(c.option.sitegroup), std::end(c.option.sitegroup), mjtByte{0});
}

Camera::~Camera() {
  const std::lock_guard lock(drawing());
  if (impl_->screen) impl_->screen->enter();
  mjr_freeContext(&impl_->context);
  mjv_freeScene(&impl_->scene);
}

const mjModel* Camera::model() const { return impl_->model.get(); }
int Camera::width() const { return impl_->width; }
int Camera::height() const { return impl_->height; }

Picture Camera::take(std::span<const double> qpos, int camera) {
  const std::lock_guard lock(drawing());
  Impl& c = *impl_;
  mjModel* m = c.model.get();
  std::copy(qpos.begin(), qpos.end(), c.data->qpos);
  mj_forward(m, c.data.get());
  mjvCamera view = overview(m);
  if (camera < 0) camera = mj_name2id(m, mjOBJ_CAMERA, "overview");
  if (camera >= 0) {
    view.type = mjCAMERA_FIXED;
    view.fixedcamid = camera;
  }
  c.screen->enter();
  const int w = c.width * kSamples, h = c.height * kSamples;
  std::vector<unsigned char> rgb(3u * w * h);
  std::vector<float> depth(static_cast<std::size_t>(w) * h);
  mjv_updateScene(m, c.data.get(), &c.option, nullptr, &view, mjCAT_ALL, &c.scene);
  mjr_render({0, 0, w, h}, &c.scene, &c.context);
  mjr_readPixels(rgb.data(), depth.data(), {0, 0, w, h}, &c.context);  // rows from the bottom

  const double near = m->vis.map.znear * m->stat.extent, far = m->vis.map.zfar * m->stat.extent;
  Picture picture{c.width, c.height, {}, {}};
  picture.rgb.resize(3u * c.width * c.height);
  picture.depth.resize(static_cast<std::size_t>(c.width) * c.height);
  for (int y = 0; y < c.height; ++y) {
    for (int x = 0; x < c.width; ++x) {
      const int at = y * c.width + x;
      int sum[3] = {};
      for (int sy = 0; sy < kSamples; ++sy) {
        for (int sx = 0; sx < kSamples; ++sx) {
          const int from = (h - 1 - (y * kSamples + sy)) * w + x * kSamples + sx;
          for (int k = 0; k < 3; ++k) sum[k] += rgb[3 * from + k];
        }
      }
      for (int k = 0; k < 3; ++k) picture.rgb[3 * at + k] = static_cast<unsigned char>(sum[k] / (kSamples * kSamples));
      const float z = depth[(h - 1 - y * kSamples) * w + x * kSamples];
      picture.depth[at] = z < 1 ? static_cast<float>(near * far / (far - z * (far - near)))
                                : std::numeric_limits<float>::infinity();
    }
  }
  return picture;
}

}  // namespace sim
