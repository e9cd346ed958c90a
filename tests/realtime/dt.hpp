#pragma once

constexpr double kDt = 0.001;  // s, of a cycle
