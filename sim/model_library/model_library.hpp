#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "wire/fci/service.hpp"

namespace sim {

// The bytes of the shared library (franka_model.h) that the arm of that name gives its clients. Empty
// when there is none for the client's architecture and system: they are built for this machine's only.
std::span<const std::byte> model_library(std::string_view arm, const fci::LoadModelLibrary& request);

}  // namespace sim
