#pragma once

// For libraries of one's own parts (docs/your-own-part.md): what such a library includes and exports.

#include <Eigen/Core>
#include <string>
#include <type_traits>
#include <vector>

#include "server/abi.hpp"  // made by the build: versions, and a hash of the headers that a part is compiled with
#include "server/kinds/kind.hpp"

namespace server {

// The kinds that a library brings.
class Parts {
 public:
  // A kind named by Message, made as Part(const Message&, const realtime::Arm&), which may throw std::invalid_argument.
  template <class Part, class Message>
  void add() {
    const auto make = [](const Message& message, const realtime::Arm& arm) { return new Part(message, arm); };
    if constexpr (std::is_base_of_v<realtime::TrajectoryGenerator, Part>) {
      trajectories.push_back(kind<realtime::TrajectoryGenerator, Message>(make));
    } else if constexpr (std::is_base_of_v<realtime::Controller, Part>) {
      controllers.push_back(kind<realtime::Controller, Message>(make));
    } else {
      static_assert(std::is_base_of_v<realtime::Termination, Part>,
                    "a part is a realtime::TrajectoryGenerator, Controller or Termination");
      terminations.push_back(kind<realtime::Termination, Message>(make));
    }
  }

  std::vector<Kind<realtime::TrajectoryGenerator>> trajectories;
  std::vector<Kind<realtime::Controller>> controllers;
  std::vector<Kind<realtime::Termination>> terminations;
};

// What server and library must have in common for one to call the other. Of internal linkage: a library must tell its own,
// and not find the server's under the same name.
static inline std::string abi() {
  std::string sizes;
  for (const std::size_t size : {sizeof(Parts), sizeof(realtime::Cycle), sizeof(realtime::Reference), sizeof(realtime::Arm),
                                 sizeof(robot::Settings), sizeof(models::Limits), sizeof(std::string)}) {
    sizes += " " + std::to_string(size);
  }
  return std::string(FRANKA_INTERFACE_ABI) + ", compiler " __VERSION__ ", C++ library " + std::to_string(_GLIBCXX_USE_CXX11_ABI) +
         ", protobuf " + std::to_string(GOOGLE_PROTOBUF_VERSION) + ", Eigen " + std::to_string(EIGEN_WORLD_VERSION) + "." +
         std::to_string(EIGEN_MAJOR_VERSION) + "." + std::to_string(EIGEN_MINOR_VERSION) + " aligned to " +
         std::to_string(EIGEN_MAX_ALIGN_BYTES) + ", sizes" + sizes;
}

}  // namespace server

// Once in a library, followed by a body that adds to `parts`:
//   FRANKA_INTERFACE_PARTS(parts) { parts.add<Lqr, lqr::Lqr>(); }
#define FRANKA_INTERFACE_PARTS(parts)                                                      \
  extern "C" __attribute__((visibility("default"))) const char* franka_interface_abi() { \
    static const std::string text = server::abi();                                        \
    return text.c_str();                                                                   \
  }                                                                                        \
  extern "C" __attribute__((visibility("default"))) void franka_interface_parts(server::Parts& parts)
