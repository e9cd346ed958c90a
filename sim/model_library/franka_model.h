#pragma once

// The shared library which an arm of protocol 3 to 9 hands to its clients (LoadModelLibrary): 30
// functions that they look up by name and call for kinematics and dynamics.
//
// Matrices are column-major. Frames: O base; J1 to J7 the joints, each turned by its q; J8 the
// flange F; J9 the end effector EE, which F_T_EE places on the flange. Vectors that are not named q or
// dq are results, written whole. Nothing is checked; nothing can fail.
//
// O_T_Jn   pose of frame n in O (4x4; m).
// O_J_Jn   Jacobian of frame n (6x7; rows: linear, then angular): velocity in the axes of O.
// Ji_J_Jn  the same velocity in the axes of frame n. Columns of joints behind the frame are zero.
// M_NE     mass matrix (7x7; kg m²).
// c_NE     C(q, dq) dq: Coriolis and centrifugal torques (N m).
// g_NE     torques which hold the arm still where a free body would accelerate with g_earth (m/s²,
//          axes of O; (0, 0, -9.81) for an upright arm).
// The dynamics include what is fixed to the flange, end effector and load together: I_total (3x3;
// kg m², about their common centre of mass, axes of F), m_total (kg), F_x_Ctotal (centre of mass, m).

#ifdef __cplusplus
extern "C" {
#endif

void O_T_J1(const double q[7], double O_T_J1[16]);
void O_T_J2(const double q[7], double O_T_J2[16]);
void O_T_J3(const double q[7], double O_T_J3[16]);
void O_T_J4(const double q[7], double O_T_J4[16]);
void O_T_J5(const double q[7], double O_T_J5[16]);
void O_T_J6(const double q[7], double O_T_J6[16]);
void O_T_J7(const double q[7], double O_T_J7[16]);
void O_T_J8(const double q[7], double O_T_J8[16]);
void O_T_J9(const double q[7], const double F_T_EE[16], double O_T_J9[16]);

void O_J_J1(double O_J_J1[42]);  // the first joint's frame moves with no q but its own
void O_J_J2(const double q[7], double O_J_J2[42]);
void O_J_J3(const double q[7], double O_J_J3[42]);
void O_J_J4(const double q[7], double O_J_J4[42]);
void O_J_J5(const double q[7], double O_J_J5[42]);
void O_J_J6(const double q[7], double O_J_J6[42]);
void O_J_J7(const double q[7], double O_J_J7[42]);
void O_J_J8(const double q[7], double O_J_J8[42]);
void O_J_J9(const double q[7], const double F_T_EE[16], double O_J_J9[42]);

void Ji_J_J1(double Ji_J_J1[42]);
void Ji_J_J2(const double q[7], double Ji_J_J2[42]);
void Ji_J_J3(const double q[7], double Ji_J_J3[42]);
void Ji_J_J4(const double q[7], double Ji_J_J4[42]);
void Ji_J_J5(const double q[7], double Ji_J_J5[42]);
void Ji_J_J6(const double q[7], double Ji_J_J6[42]);
void Ji_J_J7(const double q[7], double Ji_J_J7[42]);
void Ji_J_J8(const double q[7], double Ji_J_J8[42]);
void Ji_J_J9(const double q[7], const double F_T_EE[16], double Ji_J_J9[42]);

void M_NE(const double q[7], const double I_total[9], double m_total, const double F_x_Ctotal[3], double M_NE[49]);
void c_NE(const double q[7], const double dq[7], const double I_total[9], double m_total, const double F_x_Ctotal[3],
          double c_NE[7]);
void g_NE(const double q[7], const double g_earth[3], double m_total, const double F_x_Ctotal[3], double g_NE[7]);

#ifdef __cplusplus
}
#endif
