"""Forward kinematics of the arm in the client: frames of the links, Jacobian. All models share it.

Modified Denavit-Hartenberg parameters after Craig, "Introduction to Robotics"; figures of the vendor.
"""

from __future__ import annotations

import numpy as np

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
HAND_YAW = -np.pi / 4  # rad, of the hand about the flange's z


def link_frames(joints: np.ndarray) -> np.ndarray:
    """Return the frames in the base: the base itself, joints 1 to 7, flange, tool centre; (10, 4, 4).

    The last one is not turned as the hand is; `joints` in rad, (7,).
    """
    theta = np.append(joints, [0.0, 0.0]) + DH_PARAMS[:, 3]
    frames = np.empty((10, 4, 4))
    frames[0] = np.eye(4)
    for i, ((a, d, alpha, _), angle) in enumerate(zip(DH_PARAMS, theta, strict=True)):
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(angle), np.sin(angle)
        step = [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]]
        frames[i + 1] = frames[i] @ np.array(step)
    return frames


def turned_about_z(matrix: np.ndarray, angle: float) -> np.ndarray:
    """Return a (4, 4) frame turned about its own z by `angle` (rad)."""
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return matrix @ turn


def jacobian(joints: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Return the geometric Jacobian in base axes of a point fixed to the hand; (6, 7), linear over angular.

    `tool`: the point in the frame of the hand's tool centre, m, (3,).
    """
    frames = link_frames(joints)
    point = (turned_about_z(frames[9], HAND_YAW) @ np.append(tool, 1.0))[:3]
    axes = frames[1:8, :3, 2]
    return np.vstack([np.cross(axes, point - frames[1:8, :3, 3]).T, axes.T])
