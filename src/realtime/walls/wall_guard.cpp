#include "realtime/walls/wall_guard.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "realtime/tick.hpp"
#include "realtime/walls/self_distance.hpp"

namespace realtime {
namespace {

constexpr double kRoom = 0.0005;       // m more than the clearance, to which a motion is led that slides along a wall
constexpr double kNear = 0.08;         // m that a capsule comes nearer on such a step, about
constexpr double kDetour = 1.5;        // times the way between its ends, that a capsule may be away from them
constexpr double kSlack = 0.005;       // m, the same
constexpr double kRounding = 1e-9;     // m
constexpr double kApart = 1e-4;        // m from a wall, below which rounding turns the normal
constexpr int kPasses = 10;            // through the barriers, as each changes the others

// Torque.
constexpr double kStiffness = 5000;    // N/m, of the spring before a wall: 50 N before the wall itself is touched
constexpr double kQuickest = 50;       // rad/s, at which no more than that is felt may swing on it
constexpr double kHorizon = 1.1;       // m from a wall at which it is looked at, at most: of 3 m/s that is the way to brake
constexpr double kSelfHorizon = 0.1;   // m likewise between links: of 0.7 m/s that is the way to brake
constexpr double kSelfRoom = 0.002;    // m before kSelfClearance where their spring begins, as torque comes late
constexpr double kAlike = 0.02;        // m that the end of a capsule may be farther from a wall and is looked at too
constexpr double kBrake = 4;           // m/s² that braking counts on: 0.5 m/s in 34 mm
constexpr double kSettle = 25;         // 1/s, at which the last of the way is gone, where that is slower
constexpr double kLast = kBrake / (2 * kSettle * kSettle);  // m, that so become more
constexpr double kApproach = 60;       // 1/s, at which a capsule may come near to its greatest speed, and falls back to it
constexpr double kDeep = 0.02;         // m, from where on the spring grows no more: an arm that is farther inside was not pushed there
constexpr double kAway = 0.1;          // m/s, at which an arm that yields to the spring is pushed no more
constexpr double kRise = 0.2;          // s, in which the spring of a wall that has come rises
constexpr double kFarFrom = 0.4;       // of that speed: below it nothing is done, but on the last of the way
constexpr double kNothing = -1e6;      // m/s², that are asked for by what is far: the farther it is, the sooner it gives way
constexpr double kLate = 0.002;        // s until a torque acts, and for which it does before it changes

// At that way from where a spring begins (m), m/s.
double greatest_speed(double way) {
  const double left = std::max(way, 0.);
  return left < 2 * kLast ? kSettle * left : std::sqrt(2 * kBrake * (left - kLast));
}

// Whether nothing is done about what nears at that speed (m/s), that way (m) from where a spring begins.
bool is_slow(double way, double speed) { return way > 2 * kLast && speed <= kFarFrom * greatest_speed(way); }

}  // namespace

WallGuard::~WallGuard() { delete walls_; }

Walls* WallGuard::change(Walls* walls) noexcept {
  barrier_count_ = 0;
  q_.fill(std::numeric_limits<double>::quiet_NaN());
  for (auto& of_capsule : pairs_) {
    for (Pair& pair : of_capsule) pair.height = kUnknown;
  }
  const auto before = known_;
  const std::size_t count = walls_ != nullptr ? walls_->walls.size() : 0;
  for (std::size_t k = 0; walls != nullptr && k < walls->walls.size(); ++k) {
    const Wall& wall = walls->walls[k];
    reach_[k] = reach(wall.shape);
    const auto* const end = before.data() + count;
    const auto* const same = std::find_if(before.data(), end, [&](const Known& each) { return each.id == wall.id; });
    known_[k] = same != end ? *same : Known{.id = wall.id};
  }
  if (walls_ == nullptr || walls == nullptr || walls_->arm.all() != walls->arm.all()) itself_ = {};
  return std::exchange(walls_, walls);
}

void WallGuard::begin() noexcept {
  for (Known& known : known_) known = Known{.id = known.id};
  itself_ = {};
}

void WallGuard::Known::look(double now) noexcept {
  inside = now > 0 && (inside || (now > kDeep && now > depth + kDeep));  // no arm goes so far in a cycle
  depth = now;
  share = std::min(share + kTick / kRise, 1.);
}

void WallGuard::Pair::keep(const Nearest& found) noexcept {
  if (found.distance < kApart) return;
  normal = found.normal;
  height = normal.dot(found.point) - found.distance;
}

bool WallGuard::is_far(int capsule, int wall, const ArmCapsules::Place& place, double clearance) const noexcept {
  const Vector3 half = (place.b[capsule] - place.a[capsule]) / 2, middle = place.a[capsule] + half;
  const double least = clearance + walls_->arm.all()[capsule].radius, both = least + half.norm() + reach_[wall];
  return (middle - walls_->walls[wall].shape.O_T_S.translation()).squaredNorm() > both * both ||
         pairs_[capsule][wall].at_least(place.a[capsule], place.b[capsule]) > least;
}

const Nearest& WallGuard::nearest_here(int capsule, int wall) noexcept {
  Pair& pair = pairs_[capsule][wall];
  if (pair.posture != posture_) {
    pair.nearest = nearest(walls_->walls[wall].shape, here_.a[capsule], here_.b[capsule]);
    pair.posture = posture_;
    pair.keep(pair.nearest);
  }
  return pair.nearest;
}

bool WallGuard::clear(const Vector7& q, std::span<const Vector7> way, double clearance, bool or_so) noexcept {
  const ArmCapsules& arm = walls_->arm;
  arm.place(q, here_);
  if (q != q_) ++posture_;
  q_ = q;
  clearance_ = clearance;
  const std::size_t steps = std::min<std::size_t>(way.size(), kMostOnWay);
  for (std::size_t k = 0; k < steps; ++k) arm.place(way[k], places_[k]);
  bool all_clear = true;
  for (int capsule = 0; capsule < static_cast<int>(arm.all().size()); ++capsule) {
    // None of its points goes farther than an end.
    std::array<double, kMostOnWay> gone;  // m
    double reach = kNear;
    for (std::size_t k = 0; k < steps; ++k) {
      gone[k] = std::sqrt(std::max((places_[k].a[capsule] - here_.a[capsule]).squaredNorm(),
                                   (places_[k].b[capsule] - here_.b[capsule]).squaredNorm()));
      reach = std::max(reach, kDetour * gone[k] + kSlack);
    }
    const double radius = arm.all()[capsule].radius;
    for (int wall = 0; wall < static_cast<int>(walls_->walls.size()); ++wall) {
      Pair& pair = pairs_[capsule][wall];
      pair.in_the_way = false;
      if (is_far(capsule, wall, here_, clearance + reach)) continue;
      const auto is_clear_by_now = [&](std::size_t k, double least, double enough) {
        return least - gone[k] > enough || pair.at_least(places_[k].a[capsule], places_[k].b[capsule]) - radius > enough;
      };
      // The plane that was there tells most of them.
      const double least = pair.at_least(here_.a[capsule], here_.b[capsule]) - radius;
      std::size_t next = 0;
      if (least > clearance) {
        while (next < steps && is_clear_by_now(next, least, clearance)) ++next;
        if (next == steps) continue;
      }
      const Nearest& now = nearest_here(capsule, wall);
      const double enough = (or_so ? std::min(clearance, now.distance - radius) : clearance) - kRounding;
      bool clear = true;
      for (; next < steps && clear; ++next) {
        if (is_clear_by_now(next, now.distance - radius, enough)) continue;
        clear = is_clear(walls_->walls[wall].shape, places_[next].a[capsule], places_[next].b[capsule], enough + radius);
      }
      if (clear) continue;
      pair.in_the_way = true;
      wall_ = walls_->walls[wall].id;
      all_clear = false;
    }
  }
  return all_clear;
}

// Not only of what is in the way: a step past that must not lead to another.
std::span<const JointBound> WallGuard::bounds(Bounds& out) noexcept {
  const ArmCapsules& arm = walls_->arm;
  std::size_t count = 0;
  for (int capsule = 0; capsule < static_cast<int>(arm.all().size()); ++capsule) {
    for (int wall = 0; wall < static_cast<int>(walls_->walls.size()) && count < kMostBounds; ++wall) {
      const bool in_the_way = pairs_[capsule][wall].in_the_way;
      if (!in_the_way && is_far(capsule, wall, here_, clearance_ + kNear)) continue;
      const Nearest& now = nearest_here(capsule, wall);
      const double distance = now.distance - arm.all()[capsule].radius;
      if (!in_the_way && distance >= clearance_ + kNear) continue;
      out[count++] = {arm.gradient(here_, capsule, now.point, now.normal), kClearance + kRoom - distance};
    }
  }
  return {out.data(), count};
}

// Where there is no room for all, the one that asks for least gives way.
void WallGuard::keep(const Barrier& barrier) noexcept {
  if (barrier_count_ < kMostContacts) {
    barriers_[barrier_count_++] = barrier;
    return;
  }
  const auto least = std::min_element(barriers_.begin(), barriers_.end(),
                                      [](const Barrier& a, const Barrier& b) { return a.least < b.least; });
  if (least->least < barrier.least) *least = barrier;
}

void WallGuard::look(const Vector7& q, const Vector7& dq, const Vector7& dq_to_come) noexcept {
  const ArmCapsules& arm = walls_->arm;
  arm.place(q, here_);
  barrier_count_ = 0;
  near_ = HeldBy::kNothing;
  // Returns whether it pushes, or brakes whatever is asked for.
  const auto look_at = [&](double way, const Vector7& gradient, int wall) {
    const double speed = -gradient.dot(dq), greatest = greatest_speed(way);
    double least = kNothing * (1 + way);
    if (!is_slow(way, speed)) {
      const double falls = way < 2 * kLast ? kSettle : kBrake / greatest;  // as the way does
      least = kApproach * (speed - greatest) + falls * speed;
    }
    keep({gradient, way, least, wall});
    return way < 0 || least > 0;
  };
  std::array<SelfContact, kMostContacts / 2> own;
  const std::size_t pairs = self_contacts(arm, here_, kSelfHorizon, own);
  double least_way = kSelfHorizon;
  for (std::size_t k = 0; k < pairs; ++k) {
    const double way = own[k].distance - kSelfClearance - kSelfRoom;
    least_way = std::min(least_way, way);
    look_at(way, own[k].gradient, -1);
  }
  near_ |= when(least_way < 0, HeldBy::kItself);
  itself_.look(-least_way);
  std::array<double, Walls::kMost> deepest;  // m
  deepest.fill(-kHorizon);
  for (int capsule = 0; capsule < static_cast<int>(arm.all().size()); ++capsule) {
    // None of its points is faster than an end.
    Vector3 a = Vector3::Zero(), b = Vector3::Zero(), a_to_come = Vector3::Zero(), b_to_come = Vector3::Zero();
    for (int i = 0; i < std::min(arm.all()[capsule].link, models::kJoints); ++i) {
      const Vector3 a_moves = here_.axis[i].cross(here_.a[capsule] - here_.origin[i]);
      const Vector3 b_moves = here_.axis[i].cross(here_.b[capsule] - here_.origin[i]);
      a += dq[i] * a_moves;
      b += dq[i] * b_moves;
      a_to_come += dq_to_come[i] * a_moves;
      b_to_come += dq_to_come[i] * b_moves;
    }
    const double fast =
        std::max({a.squaredNorm(), b.squaredNorm(), a_to_come.squaredNorm(), b_to_come.squaredNorm()}) / (kFarFrom * kFarFrom);
    const double horizon = std::min(kClearance + fast / (2 * kBrake), kHorizon);
    const double radius = arm.all()[capsule].radius;
    for (int wall = 0; wall < static_cast<int>(walls_->walls.size()); ++wall) {
      if (is_far(capsule, wall, here_, horizon)) continue;
      Pair& pair = pairs_[capsule][wall];
      // Nor by far as fast as it could still be braked before a plane that the wall is behind.
      const double way = pair.at_least(here_.a[capsule], here_.b[capsule]) - radius - kClearance;
      const double speed = -std::min({pair.normal.dot(a), pair.normal.dot(b), pair.normal.dot(a_to_come), pair.normal.dot(b_to_come)});
      if (is_slow(way, speed)) continue;
      const Shape& shape = walls_->walls[wall].shape;
      const Nearest found = nearest(shape, here_.a[capsule], here_.b[capsule]);
      pair.keep(found);
      const auto look = [&](const Nearest& at) {
        const double near = at.distance - radius;
        deepest[wall] = std::max(deepest[wall], kClearance - near);
        if (near < kClearance) near_ |= HeldBy::kWall;
        if (look_at(near - kClearance, arm.gradient(here_, capsule, at.point, at.normal), wall)) wall_ = walls_->walls[wall].id;
      };
      look(found);
      // The nearest place of a capsule that lies along a wall leaps from one end to the other when it tilts.
      for (const Vector3& end : {here_.a[capsule], here_.b[capsule]}) {
        if (end == found.point || pair.at_least(end, end) >= found.distance + kAlike) continue;
        const Distance own = distance(shape, end);
        if (own.distance < found.distance + kAlike) look({own, end});
      }
    }
  }
  for (std::size_t wall = 0; wall < walls_->walls.size(); ++wall) known_[wall].look(deepest[wall]);
}

HeldBy WallGuard::add(const Vector7& dq, const Matrix7& mobility, const Vector7& c, Vector7& tau_J_d) noexcept {
  HeldBy needed = near_;
  if (barrier_count_ == 0) return needed;
  struct Answer {
    Vector7 response;  // of the joints to a force along the gradient
    double mobility, force = 0;
  };
  std::array<Answer, kMostContacts> answers;
  Vector7 ddq = mobility * (tau_J_d - c);
  for (int k = 0; k < barrier_count_; ++k) {
    answers[k].response = mobility * barriers_[k].gradient;
    answers[k].mobility = std::max(barriers_[k].gradient.dot(answers[k].response), 1e-6);
    barriers_[k].brake = kBrake / answers[k].mobility * barriers_[k].gradient;
  }
  for (int pass = 0; pass < kPasses; ++pass) {
    for (int k = 0; k < barrier_count_; ++k) {
      Answer& answer = answers[k];
      const double lack = barriers_[k].least - barriers_[k].gradient.dot(ddq);
      const double force = std::max(answer.force + lack / answer.mobility, 0.);
      ddq += (force - answer.force) * answer.response;
      answer.force = force;
    }
  }
  for (int k = 0; k < barrier_count_; ++k) {
    const Barrier& barrier = barriers_[k];
    double spring = 0;  // N
    if (barrier.way < 0) {
      const double stiffness = std::min(kStiffness, kQuickest * kQuickest / answers[k].mobility);
      const double yields = std::clamp(barrier.gradient.dot(dq) / kAway, 0., 1.);
      const Known& known = barrier.wall < 0 ? itself_ : known_[barrier.wall];
      spring = stiffness * std::min(-barrier.way, kDeep) * (1 - yields) * known.pushes();
    }
    tau_J_d += (answers[k].force + spring) * barrier.gradient;
    needed |= when(answers[k].force > 0, barrier.wall < 0 ? HeldBy::kItself : HeldBy::kWall);
  }
  return needed;
}

// With a jerk that is constant meanwhile.
double WallGuard::too_fast(const Barrier& barrier, const Vector7& dq, const Vector7& ddq, const Vector7& rate,
                           const Vector7& tau) noexcept {
  const double v = -barrier.gradient.dot(dq), a = -barrier.gradient.dot(ddq);
  const double T = (tau - barrier.brake).cwiseAbs().cwiseQuotient(rate).maxCoeff() + kLate;
  const double then = v + (a - kBrake) * T / 2, gone = v * T + (2 * a - kBrake) * T * T / 6;
  return then > 0 ? then - greatest_speed(barrier.way - gone) : 0;
}

double WallGuard::too_fast(const Vector7& dq, const Matrix7& mobility, const Vector7& rate, const Vector7& tau) const noexcept {
  const Vector7 ddq = mobility * tau;
  double most = 0;
  for (int k = 0; k < barrier_count_; ++k) most = std::max(most, too_fast(barriers_[k], dq, ddq, rate, tau));
  return most;
}

bool WallGuard::brake_too_fast(const Vector7& dq, const Matrix7& mobility, const Vector7& rate, const Vector7& tau) noexcept {
  const Vector7 ddq = mobility * tau;
  bool any = false;
  for (int k = 0; k < barrier_count_; ++k) {
    Barrier& barrier = barriers_[k];
    if (too_fast(barrier, dq, ddq, rate, tau) <= 0) continue;
    barrier.least = std::max(barrier.least, kBrake);
    any = true;
  }
  return any;
}

}  // namespace realtime
