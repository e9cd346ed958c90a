// What virtual walls cost, with 20 boxes of which 5 are within 0.1 m of the arm.
//   safety_us_p50, _p99   of WallGuard in a cycle of torque control: the way to rest, what leads past the walls where that is
//                         not clear, the way to rest again, and the torque; at random postures and speeds about home

#include <array>
#include <chrono>
#include <cstdio>
#include <random>
#include <vector>

#include "bench/boxes.hpp"
#include "bench/percentile.hpp"
#include "models/arm.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/model.hpp"
#include "realtime/walls/wall_guard.hpp"

namespace {

using namespace realtime;

constexpr int kCycles = 50'000;
constexpr double kBrake = 5;  // rad/s²

}  // namespace

int main() {
  std::mt19937 random(1);
  const auto uniform = [&](double size) { return std::uniform_real_distribution<>(-size, size)(random); };
  Model model(models::urdf(models::arm("fr3"), 10));
  WallGuard guard;
  guard.change(boxes_about(models::arm("fr3")).release());
  std::vector<double> us;
  std::array<Vector7, WallGuard::kMostOnWay> way;
  int held = 0;
  for (int n = 0; n < kCycles; ++n) {
    Vector7 q = Vector7::Map(models::kHome.data()), dq, tau = Vector7::Zero();
    for (int i = 0; i < 7; ++i) q[i] += uniform(0.2), dq[i] = uniform(0.5);
    model.update(q, dq);
    // Each joint to rest at a constant rate.
    for (std::size_t k = 0; k < way.size(); ++k) {
      const double s = static_cast<double>(k + 1) / static_cast<double>(way.size());
      way[k] = q + dq.cwiseProduct(dq.cwiseAbs()) / (2 * kBrake) * (2 * s - s * s);
    }
    const Matrix7 mobility = joint_mobility(model.mass());  // is there in any case
    const auto begin = std::chrono::steady_clock::now();
    const bool clear = guard.clear(q, way, WallGuard::kClearance);
    if (!clear) {
      const Vector7 past = guard.past(0.001 * dq);
      for (Vector7& place : way) place += 0.001 * past;
      guard.clear(q, way, WallGuard::kClearance);
    }
    guard.look(q, dq);
    guard.add(dq, mobility, model.coriolis(), tau);
    us.push_back(1e-3 * static_cast<double>((std::chrono::steady_clock::now() - begin).count()));
    held += !clear;
  }
  std::fprintf(stderr, "%.0f %% of %d cycles with a wall in the way\n", 100. * held / kCycles, kCycles);
  std::printf("{\"safety_us_p50\": %.3f, \"safety_us_p99\": %.3f}\n", percentile(us, 0.5), percentile(us, 0.99));
}
