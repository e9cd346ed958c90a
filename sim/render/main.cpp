// fci-render: pictures of a run, from its truth file, as one strip. Draws off screen, without display or GPU.

#include <png.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <regex>
#include <stdexcept>
#include <vector>

#include "sim/render/camera.hpp"

namespace sim {
namespace {

constexpr int kGap = 6;  // pixels between two pictures

struct Run {
  std::vector<double> time;  // s
  std::vector<double> qpos;  // rows of nq
  std::vector<bool> moves;
  std::size_t nq = 0;

  std::size_t row_at(double t) const {
    const auto at = std::lower_bound(time.begin(), time.end(), t);
    return std::min<std::size_t>(at - time.begin(), time.size() - 1);
  }
};

// Reads what TruthFile writes.
Run read_truth(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read the truth file " + path);
  char start[10] = {};
  file.read(start, sizeof start);
  if (!file || std::memcmp(start, "\x93NUMPY\x01\x00", 8) != 0) {
    throw std::runtime_error(path + " is not a NumPy file of version 1.0, as fci-sim --truth writes");
  }
  std::uint16_t size;
  std::memcpy(&size, start + 8, sizeof size);
  std::string header(size, ' ');
  file.read(header.data(), size);

  std::size_t row = 0;  // values of 8 bytes
  std::size_t time_at = 0, dq_at = 0, qpos_at = 0;
  Run run;
  const std::regex field(R"re(\('([^']+)', '<[uf]8'(?:, \((\d+),\))?\))re");
  for (std::sregex_iterator it(header.begin(), header.end(), field), end; it != end; ++it) {
    const std::size_t count = (*it)[2].matched ? std::stoul((*it)[2]) : 1;
    if ((*it)[1] == "time") time_at = row;
    if ((*it)[1] == "dq") dq_at = row;
    if ((*it)[1] == "qpos") {
      qpos_at = row;
      run.nq = count;
    }
    row += count;
  }
  std::smatch shape;
  if (run.nq == 0 || !std::regex_search(header, shape, std::regex(R"('shape': \((\d+) *,\))"))) {
    throw std::runtime_error(path + " has no field qpos; expected a file that fci-sim --truth wrote");
  }
  std::vector<double> values(row);
  for (std::size_t i = std::stoul(shape[1]); i > 0; --i) {
    file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(8 * row));
    if (!file) throw std::runtime_error(path + " ends before the " + shape[1].str() + " cycles that its header promises");
    run.time.push_back(values[time_at]);
    run.qpos.insert(run.qpos.end(), values.begin() + qpos_at, values.begin() + qpos_at + run.nq);
    run.moves.push_back(
        std::any_of(values.begin() + dq_at, values.begin() + dq_at + 7, [](double dq) { return std::abs(dq) > 0.02; }));
  }
  if (run.time.empty()) throw std::runtime_error(path + " holds no cycle");
  return run;
}

// Evenly from the first to the last cycle in which the arm moves.
std::vector<double> moments(const Run& run, int count) {
  const auto first = std::find(run.moves.begin(), run.moves.end(), true);
  const auto last = std::find(run.moves.rbegin(), run.moves.rend(), true);
  double begin = run.time.front(), end = run.time.back();
  if (first != run.moves.end()) {
    begin = run.time[first - run.moves.begin()];
    end = run.time[run.moves.rend() - last - 1];
  }
  std::vector<double> times;
  for (int i = 0; i < count; ++i) times.push_back(begin + (end - begin) * i / std::max(count - 1, 1));
  return times;
}

void write_png(const std::string& path, const Picture& picture) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(picture.width);
  image.height = static_cast<png_uint_32>(picture.height);
  image.format = PNG_FORMAT_RGB;
  if (!png_image_write_to_file(&image, path.c_str(), 0, picture.rgb.data(), 0, nullptr)) {
    throw std::runtime_error("cannot write the picture " + path + ": " + image.message);
  }
}

Picture draw(Camera& camera, const Run& run, const std::vector<double>& times, int width, int height) {
  const int count = static_cast<int>(times.size());
  Picture strip{count * width + (count - 1) * kGap, height, {}, {}};
  strip.rgb.assign(3u * strip.width * height, 255);
  for (int i = 0; i < count; ++i) {
    const std::size_t row = run.row_at(times[i]);
    const Picture picture = camera.take(std::span(run.qpos).subspan(row * run.nq, run.nq));
    for (int y = 0; y < height; ++y) {
      std::copy_n(picture.rgb.begin() + 3 * y * width, 3 * width,
                  strip.rgb.begin() + 3 * (y * strip.width + i * (width + kGap)));
    }
  }
  return strip;
}

}  // namespace
}  // namespace sim

int main(int argc, char** argv) {
  CLI::App app("Draws a run of the simulated arm, from the file that fci-sim --truth wrote, as a strip of pictures.");
  app.footer("Looks for FR3's meshes in $FRANKA_MESHES; without them the arm is drawn as capsules.");
  std::string robot = "fr3", scene, truth, output = "arm.png";
  std::vector<double> times;
  int width = 420, height = 460;
  app.add_option("--truth,truth", truth, "what to draw")->required();
  app.add_option("--robot", robot, "as given to fci-sim")->capture_default_str();
  app.add_option("--scene", scene, "as given to fci-sim");
  app.add_option("--times", times, "moments, s of the run; six from the first to the last movement otherwise")
      ->delimiter(',')
      ->allow_extra_args(false);
  app.add_option("--out,--output", output, "PNG file to write")->capture_default_str();
  app.add_option("--width", width, "pixels of one picture")->check(CLI::Range(16, 4096))->capture_default_str();
  app.add_option("--height", height, "pixels of one picture")->check(CLI::Range(16, 4096))->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    const std::string meshes = sim::meshes_folder();
    const sim::Run run = sim::read_truth(truth);
    const std::vector<const models::Arm*> arms(sim::arms_in_scene(scene), &models::arm(robot));
    sim::ModelPtr model = sim::with_meshes(sim::build_scene(arms, true, scene).spec.get(), arms.size(), meshes);
    if (static_cast<std::size_t>(model->nq) != run.nq) {
      throw std::runtime_error(truth + " has " + std::to_string(run.nq) + " joint coordinates, this arm and scene " +
                               std::to_string(model->nq) + ": give --robot and --scene as they were given to fci-sim");
    }
    if (times.empty()) times = sim::moments(run, 6);
    sim::Camera camera(std::move(model), !meshes.empty(), width, height);
    sim::write_png(output, sim::draw(camera, run, times, width, height));
  } catch (const std::exception& error) {
    std::cerr << "fci-render: " << error.what() << '\n';
    return 1;
  }
  return 0;
}
