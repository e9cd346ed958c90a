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

}  // namespace realtime
