#include "sim/door/network.hpp"

namespace sim {

void Network::set(const Way& to_arm, const Way& from_arm, std::uint64_t seed) {
  to_arm_ = to_arm;
  from_arm_ = from_arm;
  random_.seed(seed);
}

std::optional<std::int64_t> Network::fate(const Way& way) {
  if (way.loss == 0 && way.delayed == 0) return 0;
  const auto draw = [this] { return static_cast<double>(random_() >> 11) * 0x1p-53; };  // [0, 1)
  if (draw() < way.loss) return std::nullopt;
  return draw() < way.delayed ? way.delay : 0;
}

}  // namespace sim
