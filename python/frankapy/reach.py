"""What the joints reach: where motions of them may end, and which of them bring the tool to a pose."""

from __future__ import annotations

import math

import numpy as np

from frankapy import kinematics, proto
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.franka_constants import FrankaConstants as FC

_INSIDE = 1e-6  # rad, so that joints at the end of their range may be gone to


def rest_range(limits: proto.JointLimits | None) -> tuple[np.ndarray, np.ndarray]:
    """Return where motions of the joints may end, rad: of the connected arm, without one of the FER."""
    if limits is None or len(limits.rest_min) != 7:
        return np.array(FC.JOINT_LIMITS_MIN), np.array(FC.JOINT_LIMITS_MAX)
    return np.array(limits.rest_min), np.array(limits.rest_max)


def check(joints: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
    """Raise FrankaArmArgumentError for joints (rad, (7,)) outside their range."""
    for i, (value, least, most) in enumerate(zip(joints.tolist(), lower.tolist(), upper.tolist(), strict=True)):
        if not least < value < most:
            raise FrankaArmArgumentError(
                f"Joints not reachable! joints[{i}] is {value:.4f} rad: expected between {least:.4f} and "
                f"{most:.4f}, where joint {i + 1} of this arm may come to rest"
            )


def joints_for(flange: np.ndarray, near: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Return joints inside their range, near to `near` (rad, (7,)), with the flange at a pose (4, 4) in the base.

    Raises FrankaArmArgumentError where there are none, with how near they come.
    """
    joints, distance, angle = kinematics.inverse(flange, near, lower + _INSIDE, upper - _INSIDE)
    if max(distance, angle) > kinematics.REACHED:
        raise FrankaArmArgumentError(
            f"Target pose not reachable! The joints come as near as {1e3 * distance:.1f} mm and "
            f"{math.degrees(angle):.2f} degrees: choose a pose nearer to the arm or another orientation"
        )
    return joints


def offline_tool() -> np.ndarray:
    """Return the tool base of the Franka hand on the flange, (4, 4)."""
    tool = kinematics.turned_about_z(np.eye(4), kinematics.HAND_YAW)
    tool[2, 3] = kinematics.DH_PARAMS[8, 1]
    return tool
