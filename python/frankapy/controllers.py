"""What follows a motion of the published interface: its gains as a controller of the server's, or of the robot's own."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from google.protobuf.message import Message

from frankapy import proto
from frankapy.validation import vector

logger = logging.getLogger("frankapy")


def of_joints(use_impedance: bool, cartesian_impedances: Any, joint_impedances: Any, k_gains: Any, d_gains: Any) -> Message:
    """Return the server's joint impedance with `use_impedance`, else the robot's own; what is of the other is warned of."""
    if not use_impedance:
        _warn_of_unused("use_impedance=False", "the server's controller", k_gains=k_gains, d_gains=d_gains)
        return of_robot(cartesian_impedances, joint_impedances)
    _warn_of_unused("use_impedance=True", "the robot's own controller", joint_impedances=joint_impedances,
                    cartesian_impedances=cartesian_impedances)  # fmt: skip
    return proto.JointImpedance(stiffness=given("k_gains", k_gains, 7), damping=given("d_gains", d_gains, 7))


def of_pose(use_impedance: bool, cartesian_impedances: Any, joint_impedances: Any, topic: str | None = None) -> Message:
    """Return the server's Cartesian impedance with `use_impedance`, else the robot's own; what is of the other is warned of.

    `topic`: over which messages set the stiffness of the server's anew.
    """
    if not use_impedance:
        return of_robot(cartesian_impedances, joint_impedances)
    _warn_of_unused("use_impedance=True", "the robot's own controller", joint_impedances=joint_impedances)
    controller = proto.CartesianImpedance(topic=topic)
    stiffness = given("cartesian_impedances", cartesian_impedances, 6)
    if stiffness is not None:
        controller.translational_stiffness.extend(stiffness[:3])
        controller.rotational_stiffness.extend(stiffness[3:])
    return controller


def of_robot(cartesian_impedances: Any, joint_impedances: Any) -> proto.InternalImpedance:
    """Return the robot's own impedance: of the joints where that is given, else of the tool."""
    if joint_impedances is not None:
        return proto.InternalImpedance(K_theta=vector("joint_impedances", joint_impedances, 7))
    return proto.InternalImpedance(K_x=given("cartesian_impedances", cartesian_impedances, 6))


def given(name: str, value: Any, size: int) -> np.ndarray | None:
    """Return a vector, or None where none is given."""
    return None if value is None else vector(name, value, size)


def _warn_of_unused(when: str, whose: str, **arguments: Any) -> None:
    for name, value in arguments.items():
        if value is not None:
            logger.warning("%s means nothing with %s: it is of %s.", name, when, whose)
