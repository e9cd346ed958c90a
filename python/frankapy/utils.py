"""Small helpers of the published interface: minimum-jerk curves, poses as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from frankapy.rigid_transform import RigidTransform
from frankapy.validation import vector


def min_jerk_weight(t: Any, T: float) -> Any:
    """Return how much of a minimum-jerk motion of length `T` is done at time `t`: 0 to 1."""
    r = t / T
    return r**3 * (10 - 15 * r + 6 * r**2)


def min_jerk(xi: Any, xf: Any, t: Any, T: float) -> Any:
    """Return the point at time `t` of a minimum-jerk motion from `xi` to `xf` of length `T`."""
    return xi + (xf - xi) * min_jerk_weight(t, T)


def min_jerk_delta(xi: Any, xf: Any, t: Any, T: float, dt: float) -> Any:
    """Return velocity times `dt` at time `t` of a minimum-jerk motion from `xi` to `xf` of length `T`."""
    r = t / T
    return (xf - xi) * 30 * r**2 * (1 - r) ** 2 / T * dt


def transform_to_list(T: RigidTransform) -> list[float]:
    """Return the 16 numbers of a pose's matrix, column by column."""
    return T.matrix.T.flatten().tolist()


def convert_rigid_transform_to_array(rigid_tf: RigidTransform) -> np.ndarray:
    """Return the 16 numbers of a pose's matrix, row by row."""
    return rigid_tf.matrix.reshape(-1)


def convert_array_to_rigid_transform(
    tf_array: Any, from_frame: str = "franka_tool", to_frame: str = "world"
) -> RigidTransform:
    """Return the pose whose matrix has these 16 numbers, row by row."""
    matrix = vector("tf_array", tf_array, 16).reshape(4, 4)
    return RigidTransform(matrix[:3, :3], matrix[:3, 3], from_frame, to_frame)


def franka_pose_to_rigid_transform(
    franka_pose: Any, from_frame: str = "franka_tool_base", to_frame: str = "world"
) -> RigidTransform:
    """Return the pose of 16 numbers column by column, as the robot writes it."""
    matrix = vector("franka_pose", franka_pose, 16).reshape(4, 4).T
    return RigidTransform(matrix[:3, :3], matrix[:3, 3], from_frame, to_frame)
