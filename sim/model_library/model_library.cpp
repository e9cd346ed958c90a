#include "sim/model_library/model_library.hpp"

// The libraries' files as constants of this object; the build gives the directory.
// clang-format off
#define EMBED(name)                                     \
  asm(".pushsection .rodata\n"                          \
      ".balign 16\n"                                    \
      #name "_begin:\n"                                 \
      ".incbin \"" FRANKA_MODEL_DIR "/" #name ".so\"\n" \
      #name "_end:\n"                                   \
      ".popsection");                                   \
  extern "C" const std::byte name##_begin[], name##_end[];
// clang-format on

EMBED(franka_model_fer)
EMBED(franka_model_fr3)
EMBED(franka_model_fr3v2)

namespace sim {
namespace {

#if defined(__x86_64__)
constexpr std::uint8_t kArchitecture = 0;
#elif defined(__aarch64__)
constexpr std::uint8_t kArchitecture = 3;
#else
#error "the protocol knows no number for this architecture"
#endif
constexpr std::uint8_t kLinux = 0;

}  // namespace

std::span<const std::byte> model_library(std::string_view arm, const fci::LoadModelLibrary& request) {
  if (request.architecture != kArchitecture || request.system != kLinux) return {};
  if (arm == "fer") return {franka_model_fer_begin, franka_model_fer_end};
  if (arm == "fr3") return {franka_model_fr3_begin, franka_model_fr3_end};
  if (arm == "fr3v2") return {franka_model_fr3v2_begin, franka_model_fr3v2_end};
  return {};
}

}  // namespace sim
