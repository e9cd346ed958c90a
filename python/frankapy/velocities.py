"""Motions of constant velocity, or of velocities that messages bring."""

from __future__ import annotations

from typing import Any

import numpy as np
from google.protobuf.message import Message

from frankapy import proto
from frankapy.franka_constants import FrankaConstants as FC
from frankapy.validation import number, vector


def of_joints(joint_velocities: Any, joint_accelerations: Any, duration: Any, dynamic: bool) -> Message:
    """Return the trajectory of execute_joint_velocities."""
    dq = vector("joint_velocities", joint_velocities, 7)
    ddq = _accelerations("joint_accelerations", joint_accelerations, dq)
    if dynamic:
        return proto.StreamJointVelocity(topic=FC.DEFAULT_SENSOR_PUBLISHER_TOPIC)
    return proto.JointVelocity(dq=dq, ddq=ddq, duration=number("duration", duration))


def of_tool(cartesian_velocities: Any, cartesian_accelerations: Any, duration: Any, dynamic: bool) -> Message:
    """Return the trajectory of execute_cartesian_velocities."""
    twist = vector("cartesian_velocities", cartesian_velocities, 6)
    acceleration = _accelerations("cartesian_accelerations", cartesian_accelerations, twist)
    if dynamic:
        return proto.StreamCartesianVelocity(topic=FC.DEFAULT_SENSOR_PUBLISHER_TOPIC)
    return proto.CartesianVelocity(O_dP_EE=twist, O_ddP_EE=acceleration, duration=number("duration", duration))


def _accelerations(name: str, values: Any, velocities: np.ndarray) -> np.ndarray | None:
    """Return what a constant velocity takes: none given where there is nothing but zeros, and any where nothing moves."""
    accelerations = vector(name, values, len(velocities))
    if not accelerations.any():
        return None
    return np.where((accelerations == 0) & (velocities == 0), 1.0, accelerations)
