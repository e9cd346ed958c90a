#pragma once

#include <cmath>

namespace sim {

// Gain of y += gain (x - y) at 1 kHz, a low pass of first order; frequency in Hz.
inline double low_pass_gain(double frequency) { return 1 / (1 + 1000 / (2 * M_PI * frequency)); }

}  // namespace sim
