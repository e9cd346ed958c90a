#pragma once

#include "models/joint_figures.hpp"
#include "realtime/reference.hpp"

inline realtime::Vector7 home() { return realtime::Vector7::Map(models::kHome.data()); }
