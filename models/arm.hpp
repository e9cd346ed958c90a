#pragma once

// The figures of the arms: kinematics, inertia, collision capsules, limits. One place for each;
// what the robot itself says at run time (its URDF) goes before these.

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace models {

inline constexpr int kJoints = 7;
using Vector3 = std::array<double, 3>;
using Vector7 = std::array<double, 7>;

// Frame of a joint in the frame before it: translation, then rotation about fixed axes x, y, z
// (URDF convention). The joint turns about its z axis.
struct JointFrame {
  Vector3 xyz;  // m
  Vector3 rpy;  // rad
};

// Inertia about the centre of mass, in the axes of the link's frame.
struct Link {
  double mass;                    // kg
  Vector3 com;                    // m
  std::array<double, 6> inertia;  // ixx, iyy, izz, ixy, ixz, iyz; kg m²
};

// A capsule of the vendor's self-collision model, in a link's frame, without margin.
struct Capsule {
  int link;        // 0 to 7; 8 is the hand
  Vector3 centre;  // m
  char axis;       // 'x', 'y' or 'z'
  double radius;   // m
  double length;   // m, of the cylinder, without the caps
};
inline constexpr double kCapsuleMargin = 0.03;  // m, the vendor's default

// Limits of commanded motion. Sources: Franka's documentation ("Robot and interface specifications").
struct Limits {
  Vector7 q_min, q_max;  // rad
  Vector7 dq_max;        // rad/s
  Vector7 ddq_max;       // rad/s²
  Vector7 dddq_max;      // rad/s³
  Vector7 tau_max;       // N m
  Vector7 dtau_max;      // N m/s

  // FR3: |dq| towards the end of a joint's range is also at most max(0, sqrt(2 * deceleration * distance) - offset);
  // the distance is to the ends given here. All zero where the arm has no such envelope.
  Vector7 envelope_deceleration;       // rad/s²
  Vector7 envelope_offset;             // rad/s
  Vector7 envelope_min, envelope_max;  // rad

  struct Rates {
    double velocity, acceleration, jerk;  // m/s or rad/s, and its derivatives
  };
  Rates translation;
  Rates rotation;
  Rates elbow;

  // Bounds of the velocity of joint i at q, envelope included; rad/s, lower <= 0 <= upper.
  double dq_lower(int i, double q) const;
  double dq_upper(int i, double q) const;
};

// Sign of the elbow: +1 when q4 is above this angle, else -1; rad.
inline constexpr double kElbowFlip = -0.467002423653011;

struct Arm {
  std::string_view name;   // "fer", "fr3", "fr3v2"
  std::string_view title;  // for people
  // Of the wire protocol: what the systems of this arm have spoken, of the versions that we speak.
  std::uint16_t oldest_version, newest_version;
  std::array<JointFrame, 8> joints;  // joint1..joint7, then the fixed flange (joint8)
  std::array<Link, 8> links;         // link0..link7
};

std::span<const Arm> arms();

// The arm of that name; throws std::invalid_argument which lists the names there are.
const Arm& arm(std::string_view name);

// Limits of an arm whose server speaks protocol `version`: version 10 is system 5.9, which widened FR3's joint ranges
// and changed its velocity envelope.
const Limits& limits(const Arm& arm, std::uint16_t version);

std::span<const Capsule> capsules();

// Around all of the hand without its fingers: the least capsule along y about the corners of the vendor's collision mesh of it, of
// which the capsules of the self-collision model leave out up to 36 mm.
inline constexpr Capsule kHandHull = {8, {0, 0, 0.0225}, 'y', 0.049, 0.155};

// The Franka hand: its frame on the flange is turned by -45° about z.
namespace hand {
inline constexpr double kYaw = -0.785398163397448279;  // rad, about the flange's z
inline constexpr double kTcp = 0.1034;                 // m, flange to tool centre along z
inline constexpr double kFingerZ = 0.0584;             // m, flange to finger frames along z
inline constexpr double kMaxWidth = 0.08;              // m, between the fingers
inline constexpr double kMaxSpeed = 0.1;               // m/s, of the width (each finger does half)
inline constexpr double kMaxForce = 70;                // N, continuous
inline constexpr Link kHand = {0.6544, {-0.0000376, 0.0119128, 0.0207260},
                               {0.00186, 0.0003, 0.00174, 0.0, 0.0, -2e-05}};
inline constexpr Link kFinger = {0.0291, {0, 0.0152850, 0.0219675},
                                 {8.49e-06, 8.53e-06, 1.77e-06, 0.0, 0.0, -1.06e-06}};
}  // namespace hand

// The home posture of Franka's examples; rad.
inline constexpr Vector7 kHome = {0, -0.785398163397448279, 0, -2.35619449019234484,
                                  0, 1.57079632679489656,   0.785398163397448279};

// URDF of the arm (link0 to link8, no hand) with the elements that libfranka reads: <limit> and
// <position_based_velocity_limits> in each of joint1..joint7, flange link8.
std::string urdf(const Arm& arm, std::uint16_t version);

}  // namespace models
