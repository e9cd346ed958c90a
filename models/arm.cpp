#include "models/arm.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace models {
namespace {

constexpr double kHalfPi = 1.57079632679489662;

// All models have the same kinematics.
constexpr std::array<JointFrame, 8> kJointFrames = {{
    {{0, 0, 0.333}, {0, 0, 0}},
    {{0, 0, 0}, {-kHalfPi, 0, 0}},
    {{0, -0.316, 0}, {kHalfPi, 0, 0}},
    {{0.0825, 0, 0}, {kHalfPi, 0, 0}},
    {{-0.0825, 0.384, 0}, {-kHalfPi, 0, 0}},
    {{0, 0, 0}, {kHalfPi, 0, 0}},
    {{0.088, 0, 0}, {kHalfPi, 0, 0}},
    {{0, 0, 0.107}, {0, 0, 0}},
}};

// FR3's and FR3v2's inertias are those of franka_description 1.0.1; FER's were identified on the arm by Gaz, Cognetti,
// Oliva, Robuffo Giordano, De Luca, Dynamic identification of the Franka Emika Panda robot, RA-L 4(4), 2019.
constexpr std::array<Arm, 3> kArms = {{
    Arm{
        .name = "fer",
        .title = "Franka Emika Robot (Panda)",
        .oldest_version = 5,
        .newest_version = 5,
        .joints = kJointFrames,
        .links = {{
            {0.629769,
             {-0.041018, -0.00014, 0.049974},
             {0.00315, 0.00388, 0.004285, 8.2904e-07, 0.00015, 8.2299e-06}},
            {4.970684,
             {0.003875, 0.002081, -0.04762},
             {0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169}},
            {0.646926,
             {-0.003141, -0.02872, 0.003495},
             {0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704}},
            {3.228604,
             {0.027518, 0.039252, -0.066502},
             {0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805}},
            {3.587895,
             {-0.05317, 0.104419, 0.027454},
             {0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641}},
            {1.225946,
             {-0.011953, 0.041065, -0.038437},
             {0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229}},
            {1.666555,
             {0.060149, -0.014117, -0.010517},
             {0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341}},
            {0.735522,
             {0.010517, -0.004252, 0.061597},
             {0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741}},
        }},
    },
    Arm{
        .name = "fr3",
        .title = "Franka Research 3",
        .oldest_version = 6,
        .newest_version = 10,
        .joints = kJointFrames,
        .links = {{
            {2.3966,
             {-0.0172, 0.0004, 0.0745},
             {0.009, 0.0115, 0.0085, 0.0, 0.002, 0.0}},
            {2.9274653454,
             {0.0000004128, -0.0181251324, -0.0386035970},
             {0.023927316485107913, 0.0224821613275756, 0.006350098258530016, 1.3317903455714081e-05, -0.00011404774918616684, -0.0019950320628240115}},
            {2.9355370338,
             {0.0031828864, -0.0743221644, 0.0088146084},
             {0.041938946257609425, 0.02514514885014724, 0.06170214472888839, 0.00020257331521090626, 0.004077784227179924, -0.0042252158006570156}},
            {2.2449013699,
             {0.0407015686, -0.0048200565, -0.0289730823},
             {0.02410142547240885, 0.01974053266708178, 0.019044494482244823, 0.002404694559042109, -0.002856269270114313, -0.002104212683891874}},
            {2.6155955791,
             {-0.0459100965, 0.0630492960, -0.0085187868},
             {0.03452998321913202, 0.028881621933049058, 0.04125471171146641, 0.01322552265982813, 0.01015142998484113, -0.0009762833870704552}},
            {2.3271207594,
             {-0.0016039605, 0.0292536262, -0.0972965990},
             {0.051610278463662895, 0.04787729713371481, 0.016423625579357254, -0.005715173387783472, -0.0035673167625872135, 0.010673985108535986}},
            {1.8170376524,
             {0.0597131221, -0.0410294666, -0.0101692726},
             {0.005412333594383447, 0.014058329545509979, 0.016080817924212554, 0.006193456360285834, 0.0014219289306117652, -0.0013140753741120031}},
            {0.6271432862,
             {0.0045225817, 0.0086261921, -0.0161633251},
             {0.00021092389150104718, 0.00017718568002411474, 5.993190599659971e-05, -2.433299114461931e-05, 4.564480393778983e-05, 8.744070223226438e-05}},
        }},
    },
    Arm{
        .name = "fr3v2",
        .title = "Franka Research 3, second version",
        .oldest_version = 6,
        .newest_version = 10,
        .joints = kJointFrames,
        .links = {{
            {3.85,
             {-0.017200, 0.000400, 0.074500},
             {0.009, 0.0115, 0.0085, 0.0, 0.002, 0.0}},
            {2.4377,
             {-0.004580, 0.027016, -0.061800},
             {0.02324, 0.02146, 0.0055, 0.000333, -0.000676, 0.003739}},
            {2.2375,
             {-0.003473, -0.168509, -0.010479},
             {0.019026, 0.00566, 0.017114, 0.001241, 0.000499, -0.001804}},
            {2.185794,
             {0.092968, 0.018010, 0.033533},
             {0.010225, 0.012398, 0.006877, 0.001144, 0.003497, 0.002156}},
            {2.175867,
             {-0.068745, 0.092947, 0.011195},
             {0.008878, 0.007628, 0.010295, -0.003749, 0.001139, -0.00046}},
            {2.174817,
             {-0.004197, 0.010257, -0.058103},
             {0.031874, 0.029674, 0.004751, 0.000134, -0.000265, -0.004734}},
            {1.567617,
             {0.070958, -0.014137, -0.035324},
             {0.00286, 0.00391, 0.00453, -0.000553, -0.000638, -0.00024}},
            {0.682876,
             {0.008204, 0.001156, 0.061016},
             {0.000899, 0.001099, 0.000702, 0.0, -1.3e-05, -2.2e-05}},
        }},
    },
}};

constexpr std::array<Capsule, 12> kCapsules = {{
    {0, {-0.075, 0, 0.06}, 'x', 0.06, 0.03},
    {1, {0, 0, -0.1915}, 'z', 0.06, 0.283},
    {2, {0, 0, 0}, 'z', 0.06, 0.12},
    {3, {0, 0, -0.145}, 'z', 0.06, 0.15},
    {4, {0, 0, 0}, 'z', 0.06, 0.12},
    {5, {0, 0, -0.26}, 'z', 0.06, 0.10},
    {5, {0, 0.08, -0.13}, 'z', 0.025, 0.14},
    {6, {0, 0, -0.03}, 'z', 0.05, 0.08},
    {7, {0, 0, 0.01}, 'z', 0.04, 0.14},
    {7, {0.06, 0, 0.082}, 'x', 0.03, 0.01},
    {8, {0, 0, 0.04}, 'y', 0.04, 0.1},
    {8, {0, 0, 0.10}, 'y', 0.02, 0.1},
}};

constexpr Vector7 kTauMax = {87, 87, 87, 87, 12, 12, 12};
constexpr Vector7 kDtauMax = {1000, 1000, 1000, 1000, 1000, 1000, 1000};

constexpr Limits kFer = {
    .q_min = {-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973},
    .q_max = {2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973},
    .dq_max = {2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61},
    .ddq_max = {15, 7.5, 10, 12.5, 15, 20, 20},
    .dddq_max = {7500, 3750, 5000, 6250, 7500, 10000, 10000},
    .tau_max = kTauMax,
    .dtau_max = kDtauMax,
    .envelope_deceleration = {},
    .envelope_offset = {},
    .envelope_min = {},
    .envelope_max = {},
    .translation = {1.7, 13, 6500},
    .rotation = {2.5, 25, 12500},
    .elbow = {2.175, 10, 5000},
};

constexpr Vector7 kFr3Min = {-2.9007, -1.8361, -2.9007, -3.0770, -2.8763, 0.4398, -3.0508};
constexpr Vector7 kFr3Max = {2.9007, 1.8361, 2.9007, -0.1169, 2.8763, 4.6216, 3.0508};

constexpr Limits kFr3 = {
    .q_min = kFr3Min,
    .q_max = kFr3Max,
    .dq_max = {2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26},
    .ddq_max = {10, 10, 10, 10, 10, 10, 10},
    .dddq_max = {5000, 5000, 5000, 5000, 5000, 5000, 5000},
    .tau_max = kTauMax,
    .dtau_max = kDtauMax,
    .envelope_deceleration = {6, 2.585, 3.5, 4, 17, 5.5, 17},
    .envelope_offset = {0.6599, 0.2517, 0.2, 0.3533, 0.5757, 0.4878, 0.4628},
    .envelope_min = kFr3Min,
    .envelope_max = kFr3Max,
    .translation = {3, 9, 4500},
    .rotation = {2.5, 17, 8500},
    // The documentation says 2.62 rad/s, libfranka's limiter 1.5: the smaller is safe under both.
    .elbow = {1.5, 10, 5000},
};

constexpr Limits before_5_9(Limits limits) {
  limits.q_min = {-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159};
  limits.q_max = {2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159};
  // As libfranka 0.10 to 0.13 has it; the ends are a little wider than the ranges.
  limits.envelope_offset = {0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35};
  limits.envelope_min = {-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196};
  limits.envelope_max = {2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196};
  return limits;
}
constexpr Limits kFr3Before59 = before_5_9(kFr3);

constexpr std::uint16_t kVersionOf59 = 10;

double envelope(const Limits& limits, int i, double distance) {
  if (limits.envelope_deceleration[i] == 0) return limits.dq_max[i];
  const double reachable = std::sqrt(2 * limits.envelope_deceleration[i] * std::max(distance, 0.0));
  return std::clamp(reachable - limits.envelope_offset[i], 0.0, limits.dq_max[i]);
}

}  // namespace

double Limits::dq_lower(int i, double q) const { return -envelope(*this, i, q - envelope_min[i]); }
double Limits::dq_upper(int i, double q) const { return envelope(*this, i, envelope_max[i] - q); }

std::span<const Arm> arms() { return kArms; }

const Arm& arm(std::string_view name) {
  std::string known;
  for (const Arm& arm : kArms) {
    if (arm.name == name) return arm;
    known += known.empty() ? "" : ", ";
    known += arm.name;
  }
  throw std::invalid_argument("unknown arm model \"" + std::string(name) + "\"; known are " + known);
}

const Limits& limits(const Arm& arm, std::uint16_t version) {
  if (arm.name == "fer") return kFer;
  return version >= kVersionOf59 ? kFr3 : kFr3Before59;
}

std::span<const Capsule> capsules() { return kCapsules; }

}  // namespace models
