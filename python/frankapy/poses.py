"""Poses of the published interface: the frames that they are between, checks of them, and the arm's own."""

from __future__ import annotations

from typing import Any

import numpy as np

from frankapy import kinematics
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.rigid_transform import RigidTransform

TOOL, TOOL_BASE, WORLD = "franka_tool", "franka_tool_base", "world"
_LINKS = [*(f"panda_link{i}" for i in range(1, 9)), "panda_hand", TOOL_BASE, TOOL]


def check(name: str, pose: Any, *frames: tuple[str, str]) -> None:
    """Raise FrankaArmArgumentError unless `pose` is one, finite, and between one of these pairs of frames."""
    try:
        matrix = np.asarray(pose.matrix, dtype=float)
        given = (pose.from_frame, pose.to_frame)
    except (AttributeError, TypeError, ValueError):
        raise FrankaArmArgumentError(f"{name} is a {type(pose).__name__}: expected a RigidTransform") from None
    if given not in frames:
        expected = " or ".join(f"{a} to {b}" for a, b in frames)
        raise FrankaArmArgumentError(f"{name} has the frames {given[0]} to {given[1]}: expected {expected}")
    if not np.isfinite(matrix).all():
        raise FrankaArmArgumentError(f"{name} is not finite: translation {pose.translation}, rotation {pose.rotation}")
    rotation = matrix[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
        raise FrankaArmArgumentError(f"{name}.rotation is no rotation matrix:\n{rotation}")


def in_world(matrix: np.ndarray, name: str) -> RigidTransform:
    """Return the pose of a named frame from its matrix (4, 4) in the base."""
    return RigidTransform(matrix[:3, :3], matrix[:3, 3], name, WORLD)


def quaternion(matrix: np.ndarray) -> np.ndarray:
    """Return w, x, y, z of the rotation in a matrix (4, 4)."""
    return RigidTransform(matrix[:3, :3], np.zeros(3)).quaternion


def tool_frames(joints: np.ndarray, on_flange: np.ndarray, tool: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the frames of kinematics.link_frames at `joints` (rad, (7,)), and those of tool base and tool as get_pose has them.

    `on_flange`: pose of the tool base there (F_T_EE), (4, 4); `tool`: that of the tool on the tool base, (4, 4).
    """
    frames = kinematics.link_frames(joints)
    base = frames[8] @ on_flange
    return frames, base, base @ tool


def of_links(joints: np.ndarray, on_flange: np.ndarray, tool: np.ndarray) -> list[RigidTransform]:
    """Return panda_link1 to panda_link8, panda_hand, franka_tool_base, franka_tool, the last three with the hand's axes."""
    frames, base, moved = tool_frames(joints, on_flange, tool)
    hand = kinematics.turned_about_z(frames[8], kinematics.HAND_YAW)
    return [in_world(matrix, name) for matrix, name in zip([*frames[1:9], hand, base, moved], _LINKS, strict=True)]


def link_matrices(joints: np.ndarray, on_flange: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Return base, joints 1 to 7, flange, twice the tool base, tool, (12, 4, 4); the last three turned back as a hand is turned."""
    frames, base, moved = tool_frames(joints, on_flange, tool)
    turned_back = [kinematics.turned_about_z(matrix, -kinematics.HAND_YAW) for matrix in (base, base, moved)]
    return np.concatenate([frames[:9], turned_back])


def of_fingers(tool: np.ndarray, width: float) -> tuple[RigidTransform, RigidTransform]:
    """Return finger_left and finger_right of a tool (4, 4) that are `width` (m) apart, along its y."""
    left, right = tool.copy(), tool.copy()
    left[:3, 3] += width / 2 * tool[:3, 1]
    right[:3, 3] -= width / 2 * tool[:3, 1]
    return in_world(left, "finger_left"), in_world(right, "finger_right")
