#include "server/self_collision.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <vector>

#include "realtime/walls/shape.hpp"
#include "server/refused.hpp"
#include "server/wall_store.hpp"

namespace server {
namespace {

using realtime::ArmCapsules;
using realtime::Vector3;

constexpr double kOwnMargin = 0.001;  // m
constexpr int kNeighbours = 3;        // links nearer to each other cannot meet, or always overlap
constexpr double kNearing = 1e-4;     // m that is no nearer
constexpr double kReach = 1.3;        // m/rad: no point of the arm moves farther by any of its joints

realtime::Shape shape(const Vector3& a, const Vector3& b, double radius) {
  realtime::Shape out;
  out.kind = realtime::Shape::Kind::kCapsule;
  out.size = {radius, (b - a).norm() / 2, 0};
  out.O_T_S.linear() = Eigen::Quaterniond::FromTwoVectors(Vector3::UnitZ(), b - a).toRotationMatrix();
  out.O_T_S.translation() = (a + b) / 2;
  return out;
}

struct Nearness {
  double distance = 1e9;  // m
  int links[2] = {};
};

// The two links that are nearest to each other.
Nearness nearness(const ArmCapsules& arm, const realtime::Vector7& q) {
  ArmCapsules::Place place;
  arm.place(q, place);
  std::vector<ArmCapsules::Capsule> all = arm.fixed();
  for (std::size_t i = 0; i < arm.own(); ++i) {
    all.push_back({arm.all()[i].link, place.a[i], place.b[i], arm.all()[i].radius});
  }
  Nearness nearest;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const realtime::Shape one = shape(all[i].a, all[i].b, all[i].radius);
    for (std::size_t j = i + 1; j < all.size(); ++j) {
      if (all[j].link - all[i].link < kNeighbours) continue;
      const double distance = realtime::nearest(one, all[j].a, all[j].b).distance - all[j].radius;
      if (distance < nearest.distance) nearest = {distance, {all[i].link, all[j].link}};
    }
  }
  return nearest;
}

}  // namespace

void check_self_collision(const ArmCapsules& arm, std::span<const realtime::Vector7> way, const std::string& what) {
  constexpr double kMargin = models::kCapsuleMargin + kOwnMargin;
  if (way.empty()) return;
  double distance = nearness(arm, way[0]).distance;
  const double least = std::min(kMargin, distance - kNearing);
  double moved = 0;  // at most, m, since distance was found
  for (std::size_t k = 1; k < way.size(); ++k) {
    moved += kReach * (way[k] - way[k - 1]).lpNorm<1>();
    if (moved < distance - least) continue;
    const Nearness found = nearness(arm, way[k]);
    distance = found.distance;
    moved = 0;
    if (distance >= least) continue;
    const bool goal = k + 1 == way.size();
    throw Refused(frankapy::proto::Error::INVALID_ARGUMENT,
                  fmt::format("{}: {} would come within {:.0f} mm of {} of the arm itself {}: the robot stops at {:.0f} mm, and motions "
                              "keep {:.0f} mm. Choose another {}",
                              what, name_of_link(found.links[1]), 1e3 * std::max(found.distance, 0.), name_of_link(found.links[0]),
                              goal ? "at its goal" : fmt::format("at {:.0f} % of its way", 100. * k / (way.size() - 1)),
                              1e3 * models::kCapsuleMargin, 1e3 * kMargin, goal ? "goal" : "way, such as by a posture between"));
  }
}

}  // namespace server
