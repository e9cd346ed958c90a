#include "server/wall_store.hpp"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "realtime/walls/mesh.hpp"
#include "server/kept.hpp"
#include "server/refused.hpp"
#include "server/roles.hpp"
#include "wire/proto/validation.hpp"

namespace server {
namespace {

namespace proto = frankapy::proto;
using realtime::Shape;
using realtime::Vector3;

constexpr std::size_t kLongestName = 100;

template <int N>
Eigen::Matrix<double, N, 1> numbers(const google::protobuf::RepeatedField<double>& values) {
  return Eigen::Map<const Eigen::Matrix<double, N, 1>>(values.data());
}

// About `middle`, m. Throws std::invalid_argument, as Mesh.
std::shared_ptr<const realtime::Mesh> mesh_of(const proto::Wall::Mesh& mesh, const Vector3& middle) {
  std::vector<Vector3> corners;
  for (int i = 0; i < mesh.corners_size(); i += 3) corners.push_back(Vector3::Map(mesh.corners().data() + i) - middle);
  std::vector<std::array<std::uint32_t, 3>> triangles;
  for (int i = 0; i < mesh.triangles_size(); i += 3) {
    triangles.push_back({mesh.triangles(i), mesh.triangles(i + 1), mesh.triangles(i + 2)});
  }
  return std::make_shared<realtime::Mesh>(corners, triangles);
}

Eigen::Matrix3Xd corners_of(const proto::Wall::Mesh& mesh) {
  return Eigen::Map<const Eigen::Matrix3Xd>(mesh.corners().data(), 3, mesh.corners_size() / 3);
}

// In the frame that the message gives it in.
Shape shape_of(const proto::Wall& wall) {
  Shape shape;
  Vector3 middle = Vector3::Zero();  // in the frame of the wall
  switch (wall.shape_case()) {
    case proto::Wall::kBox:
      shape.kind = Shape::Kind::kBox;
      shape.size = numbers<3>(wall.box().size()) / 2;
      break;
    case proto::Wall::kSphere:
      shape.kind = Shape::Kind::kCapsule;
      shape.size = {wall.sphere().radius(), 0, 0};
      break;
    case proto::Wall::kCylinder:
      shape.kind = Shape::Kind::kCylinder;
      shape.size = {wall.cylinder().radius(), wall.cylinder().length() / 2, 0};
      break;
    case proto::Wall::kCapsule:
      shape.kind = Shape::Kind::kCapsule;
      shape.size = {wall.capsule().radius(), wall.capsule().length() / 2, 0};
      break;
    case proto::Wall::kMesh: {
      const Eigen::Matrix3Xd corners = corners_of(wall.mesh());
      const Vector3 low = corners.rowwise().minCoeff(), high = corners.rowwise().maxCoeff();
      middle = (low + high) / 2;
      shape.kind = Shape::Kind::kMesh;
      shape.size = (high - low) / 2;
      shape.mesh = mesh_of(wall.mesh(), middle);
      break;
    }
    case proto::Wall::kPlane:
    case proto::Wall::SHAPE_NOT_SET: break;
  }
  const Eigen::Vector4d q = numbers<4>(wall.orientation());
  shape.O_T_S.linear() = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  shape.O_T_S.translation() = numbers<3>(wall.position()) + shape.O_T_S.linear() * middle;
  return shape;
}

// The capsule around a body that is held: about its longest axis.
bool hold(realtime::ArmCapsules& arm, const Shape& shape) {
  const Vector3& size = shape.size;
  int axis = 2;
  double half = size[1], radius = size[0];
  if (shape.kind == Shape::Kind::kBox || shape.kind == Shape::Kind::kMesh) {
    half = size.maxCoeff(&axis);
    radius = std::hypot(size[(axis + 1) % 3], size[(axis + 2) % 3]);
  }
  constexpr double kShortest = 1e-6;  // m: the axis of a ball too is no point
  const Vector3 way = std::max(half, kShortest) * Vector3::Unit(axis);
  return arm.hold(shape.O_T_S * Vector3(-way), shape.O_T_S * way, radius);
}

// Between a wall and a capsule of the arm where that is placed, m; below 0 inside.
double distance(const realtime::Wall& wall, const realtime::ArmCapsules& arm, const realtime::ArmCapsules::Place& place, std::size_t capsule) {
  return realtime::nearest(wall.shape, place.a[capsule], place.b[capsule]).distance - arm.all()[capsule].radius;
}

}  // namespace

std::string name_of_link(int link) {
  return link == realtime::ArmCapsules::kFlange ? "the hand or what it holds" : fmt::format("link {}", link);
}

proto::Walls kept_walls(const std::string& file) {
  proto::Walls kept;
  if (load(file, kept)) return kept;
  throw std::runtime_error(fmt::format("{}: the walls that were to be kept cannot be read. Bring the file back, or remove it and add "
                                       "them anew (frankapy walls add ... --keep)",
                                       file));
}

WallStore::WallStore(const std::vector<proto::Wall>& fixed, int fd, std::string file) : fd_(fd), file_(std::move(file)) {
  for (proto::Wall wall : fixed) {
    wall.set_fixed(true);
    put(wall, entries_, ++last_id_);
    entries_[wall.name()].configured = true;
    configured_.insert(wall.name());
  }
  check_numbers(entries_);
  const proto::Walls kept = kept_walls(file_);
  for (const proto::Wall& wall : kept.walls()) {
    if (configured_.contains(wall.name())) {
      spdlog::warn("a wall that was kept is left out: the configuration has a wall \"{}\"", wall.name());
    } else {
      take_again(wall);
    }
  }
  proto::ChangeWalls changes;
  if (!load(fd_, changes)) spdlog::error("the walls of clients could not be read again and are gone: add them anew");
  for (const std::string& name : changes.remove()) entries_.erase(name);
  for (const proto::Wall& wall : changes.put()) take_again(wall);
}

// One that the configuration has no place for any more stays out.
void WallStore::take_again(const proto::Wall& wall) {
  proto::ChangeWalls change;
  *change.add_put() = wall;
  try {
    apply(change, {"", "", proto::LAB});
  } catch (const Refused& refused) {
    spdlog::warn("a wall that was kept is left out: {}", refused.what());
  }
}

// That the loop can look at all of them in a cycle.
void WallStore::check_numbers(const std::map<std::string, Entry>& entries) {
  const auto held = std::count_if(entries.begin(), entries.end(), [](const auto& each) { return each.second.wall.held(); });
  constexpr int kMostHeld = realtime::ArmCapsules::kMostHeld;
  if (held > kMostHeld) refuse(fmt::format("{} bodies would be held: expected at most {}", held, kMostHeld));
  if (const auto walls = static_cast<long>(entries.size()) - held; walls > realtime::Walls::kMost) {
    refuse(fmt::format("there would be {} walls: expected at most {}, which is what the 1 kHz loop can look at in a cycle", walls,
                       realtime::Walls::kMost));
  }
  int triangles = 0;
  for (const auto& [name, entry] : entries) triangles += entry.wall.held() ? 0 : entry.wall.mesh().triangles_size() / 3;
  if (triangles > realtime::Walls::kMostTriangles) {
    refuse(fmt::format("the meshes would have {} triangles: expected at most {} in all, which is what the 1 kHz loop can look at in a "
                       "cycle. Make them simpler",
                       triangles, realtime::Walls::kMostTriangles));
  }
}

void WallStore::put(proto::Wall wall, std::map<std::string, Entry>& into, std::uint32_t id) {
  if (wall.name().size() > kLongestName) {
    refuse(fmt::format("Wall.name has {} bytes: expected at most {}", wall.name().size(), kLongestName));
  }
  if (wall.shape_case() == proto::Wall::SHAPE_NOT_SET) {
    refuse(fmt::format("Wall \"{}\" has no shape: expected plane, box, sphere, cylinder, capsule or mesh", wall.name()));
  }
  if (wall.held() && wall.has_plane()) {
    refuse(fmt::format("Wall \"{}\" is held and a plane: expected a body of finite size", wall.name()));
  }
  try {
    wire::validate(wall);  // a file may hold anything
    shape_of(wall);
  } catch (const wire::Invalid& wrong) {
    refuse(wrong.what());
  } catch (const std::invalid_argument& wrong) {
    refuse(fmt::format("Wall \"{}\" {}", wall.name(), wrong.what()));
  }
  into[wall.name()] = {id, wall};
}

std::optional<proto::Walls> WallStore::kept_after(const proto::ChangeWalls& change, const Keys::Client& who) const {
  WallStore after = *this;
  after.apply(change, who);
  proto::Walls keep = after.to_keep();
  if (file_.empty() || keep.SerializeAsString() == to_keep().SerializeAsString()) return std::nullopt;
  return keep;
}

void WallStore::change(const proto::ChangeWalls& change, const Keys::Client& who) {
  const auto entries = entries_;
  apply(change, who);
  try {
    save(fd_, changes());
  } catch (...) {
    entries_ = entries;
    throw;
  }
}

proto::Walls WallStore::to_keep() const {
  proto::Walls walls;
  for (const auto& [name, entry] : entries_) {
    if (!entry.configured && entry.wall.keep()) *walls.add_walls() = entry.wall;
  }
  return walls;
}

// What makes of the configuration what there is.
proto::ChangeWalls WallStore::changes() const {
  proto::ChangeWalls changes;
  for (const auto& [name, entry] : entries_) {
    if (!entry.configured) *changes.add_put() = entry.wall;
  }
  for (const std::string& name : configured_) {
    if (const auto found = entries_.find(name); found == entries_.end() || !found->second.configured) changes.add_remove(name);
  }
  return changes;
}

void WallStore::apply(const proto::ChangeWalls& change, const Keys::Client& who) {
  // Before any of them is looked at: that takes its time.
  if (constexpr int kMost = realtime::Walls::kMost + realtime::ArmCapsules::kMostHeld; change.put_size() > kMost) {
    refuse(fmt::format("the change has {} walls: expected at most {}, which is what the 1 kHz loop can look at in a cycle, and {} "
                       "bodies that are held",
                       change.put_size(), realtime::Walls::kMost, realtime::ArmCapsules::kMostHeld));
  }
  auto entries = entries_;
  auto id = last_id_;
  const bool lab = who.role == proto::LAB;
  const auto keep_fixed = [&](const std::string& name) {
    const auto found = entries.find(name);
    if (found != entries.end() && found->second.wall.fixed() && !lab) {
      const std::string of = found->second.configured ? "of the server's configuration" : "protected";
      throw Refused(proto::Error::NOT_PERMITTED, explain_role(who, fmt::format("wall \"{}\" is {}: to change it", name, of), proto::LAB));
    }
    return found;
  };
  for (const std::string& name : change.remove()) {
    const auto found = keep_fixed(name);
    if (found == entries.end()) refuse(fmt::format("there is no wall \"{}\"", name));
    entries.erase(found);
  }
  for (proto::Wall wall : change.put()) {
    const auto found = keep_fixed(wall.name());
    if (!lab) wall.clear_fixed();
    put(wall, entries, found != entries.end() ? found->second.id : ++id);  // one that moves stays itself
  }
  check_numbers(entries);
  entries_ = std::move(entries);
  last_id_ = id;
}

proto::Walls WallStore::list() const {
  proto::Walls out;
  for (const auto& [name, entry] : entries_) *out.add_walls() = entry.wall;
  return out;
}

std::unique_ptr<realtime::Walls> WallStore::make(const models::Arm& arm, bool hand) const {
  auto out = std::make_unique<realtime::Walls>(realtime::Walls{realtime::ArmCapsules(arm, hand), {}});
  for (const auto& [name, entry] : entries_) {
    const Shape shape = shape_of(entry.wall);
    if (entry.wall.held()) {
      hold(out->arm, shape);
    } else {
      out->walls.push_back({entry.id, shape});
    }
  }
  return out;
}

std::string WallStore::name(std::uint32_t id) const {
  for (const auto& [name, entry] : entries_) {
    if (entry.id == id) return name;
  }
  return {};
}

void tell_nearer(const realtime::Walls& walls, const WallStore& names, const realtime::Vector7& q, proto::Walls& out) {
  const auto& capsules = walls.arm.all();
  realtime::ArmCapsules::Place place;
  walls.arm.place(q, place);
  for (const auto& wall : walls.walls) {
    double least = realtime::WallGuard::kClearance;
    int link = 0;
    for (std::size_t c = 0; c < capsules.size(); ++c) {
      const double here = distance(wall, walls.arm, place, c);
      if (here >= least) continue;
      least = here;
      link = capsules[c].link;
    }
    if (least >= realtime::WallGuard::kClearance) continue;
    auto& nearer = *out.add_nearer();
    nearer.set_wall(names.name(wall.id));
    nearer.set_link(name_of_link(link));
    nearer.set_distance(least);
  }
}

void check_walls(const realtime::Walls& walls, const WallStore& names, std::span<const realtime::Vector7> way,
                 const std::string& what) {
  if (walls.walls.empty() || way.empty()) return;
  struct Pair {
    const realtime::Wall* wall;
    std::size_t capsule;
    double least = 0;  // distance that there may be, m
    double due = 0;    // how far the arm has gone, at most, where it may be there, m
  };
  const auto& capsules = walls.arm.all();
  realtime::ArmCapsules::Place place;
  const auto look = [&](Pair& pair, double gone, double share) {
    const double there = distance(*pair.wall, walls.arm, place, pair.capsule);
    if (there < pair.least) {
      refuse(fmt::format("{}: {} would come {} wall \"{}\" {}: motions keep {:.0f} mm away from it. Choose another goal or way, or "
                         "change the wall (fa.walls)",
                         what, name_of_link(capsules[pair.capsule].link),
                         there < 0 ? fmt::format("{:.0f} mm into", -1e3 * there) : fmt::format("within {:.1f} mm of", std::floor(1e4 * there) / 10),
                         names.name(pair.wall->id), share == 1 ? "at its goal" : fmt::format("at {:.0f} % of its way", 100 * share),
                         1e3 * realtime::WallGuard::kClearance));
    }
    pair.due = gone + there - pair.least;
  };
  std::vector<Pair> pairs;
  walls.arm.place(way[0], place);
  for (std::size_t c = 0; c < capsules.size(); ++c) {
    for (const auto& wall : walls.walls) {
      Pair& pair = pairs.emplace_back(Pair{&wall, c});
      pair.least = std::min(distance(wall, walls.arm, place, c) - 1e-4, realtime::WallGuard::kClearance);
      look(pair, 0, 0);
    }
  }
  const auto next_due = [&] { return std::ranges::min_element(pairs, {}, &Pair::due)->due; };
  double gone = 0, next = next_due();
  for (std::size_t k = 1; k < way.size(); ++k) {
    const realtime::Vector7 step = way[k] - way[k - 1];
    const double length = walls.arm.reach() * step.lpNorm<1>(), from = gone;
    gone += length;
    if (gone < next) continue;
    // As finely as that nothing thin is on one side of a thin wall and then on the other.
    const double parts = std::max(std::ceil(length / realtime::WallGuard::kClearance), 1.);
    for (double part = 1; part <= parts; ++part) {
      const double on = part / parts, here = from + on * length;
      if (here < next) continue;
      const double share = (static_cast<double>(k - 1) + on) / static_cast<double>(way.size() - 1);
      walls.arm.place(way[k - 1] + on * step, place);
      for (Pair& pair : pairs) {
        if (here >= pair.due) look(pair, here, share);
      }
      next = next_due();
    }
  }
}

}  // namespace server
