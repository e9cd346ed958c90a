#pragma once

#include <functional>
#include <stdexcept>
#include <string>

// What a part says that is not made, or "accepted".
inline std::string refusal(const std::function<void()>& make) {
  try {
    make();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}
