#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

// The value that this share of them does not exceed; of at least one.
template <class Value>
Value percentile(std::vector<Value> values, double share) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}
