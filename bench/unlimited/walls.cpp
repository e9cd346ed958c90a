// Takes the place of src/realtime/walls/wall_guard.cpp in a server whose loop minds no walls: what tests/safety has to find then.
// Each of its functions, so that the linker takes none from the library.

#include <utility>

#include "realtime/walls/wall_guard.hpp"

namespace realtime {

WallGuard::~WallGuard() { delete walls_; }

Walls* WallGuard::change(Walls* walls) noexcept { return std::exchange(walls_, walls); }
bool WallGuard::clear(const Vector7&, std::span<const Vector7>, double, bool) noexcept { return true; }
std::span<const JointBound> WallGuard::bounds(Bounds&) noexcept { return {}; }
void WallGuard::look(const Vector7&, const Vector7&, const Vector7&) noexcept {}
void WallGuard::begin() noexcept {}
HeldBy WallGuard::add(const Vector7&, const Matrix7&, const Vector7&, Vector7&) noexcept { return HeldBy::kNothing; }
double WallGuard::too_fast(const Vector7&, const Matrix7&, const Vector7&, const Vector7&) const noexcept { return 0; }
bool WallGuard::brake_too_fast(const Vector7&, const Matrix7&, const Vector7&, const Vector7&) noexcept { return false; }

}  // namespace realtime
