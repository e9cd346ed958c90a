"""Forward kinematics of the arm in the client: frames of the links, Jacobian. All models share it.

Modified Denavit-Hartenberg parameters after Craig, "Introduction to Robotics"; figures of the vendor.
"""

from __future__ import annotations

import numpy as np

from frankapy.rigid_transform import RigidTransform

# a (m), d (m), alpha (rad), offset of theta (rad): joints 1 to 7, flange, tool centre of the Franka hand.
DH_PARAMS = np.array(
    [
        [0, 0.333, 0, 0],
        [0, 0, -np.pi / 2, 0],
        [0, 0.316, np.pi / 2, 0],
        [0.0825, 0, np.pi / 2, 0],
        [-0.0825, 0.384, -np.pi / 2, 0],
        [0, 0, np.pi / 2, 0],
        [0.088, 0, np.pi / 2, 0],
        [0, 0.107, 0, 0],
        [0, 0.1034, 0, 0],
    ]
)
_A, _D, _COS, _SIN = DH_PARAMS[:, 0], DH_PARAMS[:, 1], np.cos(DH_PARAMS[:, 2]), np.sin(DH_PARAMS[:, 2])
REACHED = 1e-6  # m and rad, from a pose that is reached
_ARM = 0.5  # m per rad, to compare distances and angles
_NEARLY = 0.05  # m and rad
_ATTEMPTS, _STEPS = 30, 200
_ENOUGH = 4  # that reach the pose, to take the nearest of
HAND_YAW = -np.pi / 4  # rad, of the hand about the flange's z


def link_frames(joints: np.ndarray) -> np.ndarray:
    """Return the frames in the base: the base itself, joints 1 to 7, flange, tool centre; (10, 4, 4).

    The last one is not turned as the hand is; `joints` in rad, (7,).
    """
    theta = np.append(joints, [0.0, 0.0]) + DH_PARAMS[:, 3]
    ct, st, zero = np.cos(theta), np.sin(theta), np.zeros(9)
    rows = [[ct, -st, zero, _A], [st * _COS, ct * _COS, -_SIN, -_D * _SIN], [st * _SIN, ct * _SIN, _COS, _D * _COS]]
    frames = np.zeros((10, 4, 4))
    frames[0] = np.eye(4)
    frames[1:, :3] = np.moveaxis(np.array(rows), 2, 0)
    frames[1:, 3, 3] = 1
    for i in range(9):
        frames[i + 1] = frames[i] @ frames[i + 1]
    return frames


def turned_about_z(matrix: np.ndarray, angle: float) -> np.ndarray:
    """Return a (4, 4) frame turned about its own z by `angle` (rad)."""
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return matrix @ turn


def jacobian(joints: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Return the geometric Jacobian in base axes of the origin of a frame fixed to the flange; (6, 7), linear over angular.

    `tool`: that frame on the flange, (4, 4).
    """
    frames = link_frames(joints)
    point = (frames[8] @ tool[:, 3])[:3]
    axes = frames[1:8, :3, 2]
    return np.vstack([np.cross(axes, point - frames[1:8, :3, 3]).T, axes.T])


def inverse(flange: np.ndarray, near: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Return joints inside their limits that bring the flange to a pose, the nearest to `near` that a descent finds.

    Damped least squares (damping after Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt
    method", 2011), the redundant motion towards `near`; first from there, and where that does not do, from other postures.

    Args:
        flange: in the base, (4, 4).
        near: rad, (7,).
        lower: limits, rad, (7,).
        upper: limits, rad, (7,).

    Returns joints (rad, (7,)), and how far from the pose they are, in m and rad: both are tiny where it can be reached.
    """
    random = np.random.default_rng(0)
    tried: list[tuple[np.ndarray, float, float]] = []
    reached: list[tuple[np.ndarray, float, float]] = []
    for attempt in range(_ATTEMPTS):
        start = near if attempt == 0 else random.uniform(lower, upper)
        joints, error = _descend(flange, np.clip(start, lower, upper), near, lower, upper)
        tried.append((joints, float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))))
        if max(tried[-1][1:]) < REACHED:
            reached.append(tried[-1])
            if attempt == 0 or len(reached) == _ENOUGH:
                break
    if reached:
        return min(reached, key=lambda each: float(np.linalg.norm(each[0] - near)))
    return min(tried, key=lambda each: each[1] + _ARM * each[2])


def _descend(
    flange: np.ndarray, joints: np.ndarray, near: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    error = np.zeros(6)
    for _ in range(_STEPS):
        frames = link_frames(joints)
        error = np.append(flange[:3, 3] - frames[8, :3, 3], _rotation_vector(flange[:3, :3] @ frames[8, :3, :3].T))
        axes = frames[1:8, :3, 2]
        J = np.vstack([np.cross(axes, frames[8, :3, 3] - frames[1:8, :3, 3]).T, axes.T])
        free = np.ones(7, dtype=bool)
        for _ in range(7):  # joints that would leave their range stay
            J_free = J * free
            pseudo = J_free.T @ np.linalg.inv(J_free @ J_free.T + (error @ error / 2 + 1e-9) * np.eye(6))
            step = pseudo @ error
            if error @ error < _NEARLY**2:  # while the damping is strong this would lead astray
                step += free * ((near - joints) - pseudo @ (J_free @ (near - joints))) * 0.5
            stuck = free & (((joints >= upper) & (step > 0)) | ((joints <= lower) & (step < 0)))
            if not stuck.any():
                break
            free &= ~stuck
        step *= min(1.0, 0.5 / max(float(np.linalg.norm(step)), 1e-12))
        joints = np.clip(joints + step, lower, upper)
        if np.linalg.norm(step) < 1e-9:
            break
    return joints, error


def _rotation_vector(rotation: np.ndarray) -> np.ndarray:
    w, *xyz = RigidTransform(rotation).quaternion  # w >= 0
    length = float(np.linalg.norm(xyz))
    return np.array(xyz) * (2 * np.arctan2(length, w) / length if length > 1e-12 else 2)
