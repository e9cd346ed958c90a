#include "realtime/check.hpp"

#include <sstream>
#include <stdexcept>

namespace realtime {

void require_within(const std::string& field, int index, double value, double min, double max,
                    const std::string& unit) {
  if (value >= min && value <= max) return;
  std::ostringstream text;
  text << field;
  if (index >= 0) text << "[" << index << "]";
  text << " is " << value << ", and should lie within " << min << " and " << max;
  if (!unit.empty()) text << " " << unit;
  throw std::invalid_argument(text.str());
}

const std::string& require_topic(const std::string& topic) {
  if (!topic.empty() && topic.size() <= 256) return topic;
  throw std::invalid_argument("topic has " + std::to_string(topic.size()) + " bytes: expected the name of a topic, 1 to 256");
}

}  // namespace realtime
