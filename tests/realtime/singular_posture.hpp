#pragma once

#include "realtime/reference.hpp"

// Where the joints but the third hardly move EE about one axis: the determinant of their Jacobian is 8e-5, 0.037 at home. Rad.
inline realtime::Vector7 singular_posture() { return {-0.265707, -0.928602, 0.530178, -1.765450, 1.137567, 2.075235, 1.223018}; }
