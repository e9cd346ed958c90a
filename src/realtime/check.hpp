#pragma once

#include <string>

namespace realtime {

// For constructors of components: throws std::invalid_argument which names field, value and bounds
// unless min <= value <= max (NaN is refused). `index` is the element of a list, or -1.
void require_within(const std::string& field, int index, double value, double min, double max, const std::string& unit);

// The same for the name of a topic: 1 to 256 bytes. Returns it.
const std::string& require_topic(const std::string& topic);

}  // namespace realtime
