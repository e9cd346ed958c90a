"""Guidance: an arm that yields to a hand, and what the hand has shown it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from google.protobuf.message import Message

from frankapy import controllers, proto
from frankapy.demonstration import Demonstration
from frankapy.exceptions import FrankaArmException
from frankapy.motions import Motion
from frankapy.progress import progress
from frankapy.states import StateStream
from frankapy.validation import number

_LEFT = 1.0  # s, for what came before a stop
_LONGEST = 1e6  # s, of a stay; scripts write more where they mean for ever
FIELDS = ["robot.message_id", "robot.q", "robot.O_T_EE", "skill_id"]  # of the states that a demonstration is made of


def stay(duration: Any) -> proto.StayJoint:
    """Return the trajectory of joints that stay for `duration` (s)."""
    return proto.StayJoint(duration=min(number("duration", duration), _LONGEST))


def held(
    duration: Any,
    use_joints: bool,
    use_impedance: bool,
    use_ee_frame: bool,
    cartesian_impedances: Any,
    joint_impedances: Any,
    k_gains: Any,
    d_gains: Any,
) -> tuple[Message, Message]:
    """Return trajectory and controller of selective_guidance_mode."""
    staying = stay(duration)
    if use_joints:
        controller = controllers.of_joints(use_impedance, cartesian_impedances, joint_impedances, k_gains, d_gains)
        return staying, controller
    controller = controllers.of_pose(use_impedance, cartesian_impedances, joint_impedances)
    if use_ee_frame and isinstance(controller, proto.CartesianImpedance):
        controller.frame = proto.CartesianImpedance.END_EFFECTOR
    return proto.StayPose(duration=staying.duration), controller


def shown(states: StateStream, motion: Motion | None, duration: float, stop: Callable[[], None]) -> list[proto.ArmState]:
    """Return the states of a motion until its end; Ctrl-C ends it by `stop`, and what has come until then is read still."""
    if motion is None:
        raise FrankaArmException("Nothing runs in which the arm could be led.")
    rows: list[proto.ArmState] = []

    def read(until: float = math.inf) -> Iterator[proto.ArmState]:
        for state in states:
            if state.skill_id == motion.id:
                rows.append(state)
                yield state
            elif rows or time.monotonic() > until:  # or it was stopped before there was any
                return
            elif until == math.inf and motion.result(timeout=0) is not None:  # or was over
                until = time.monotonic() + _LEFT

    try:
        with progress(duration, "demonstrate", unit="s") as bar:
            for _ in read():
                bar.update(0.001)
    except KeyboardInterrupt:
        stop()
        for _ in read(until=time.monotonic() + _LEFT):
            pass
    return rows


def demonstration_of(rows: Sequence[proto.ArmState]) -> Demonstration:
    """Return what states have shown. Raises FrankaArmException where there are none."""
    if len(rows) < 2:
        raise FrankaArmException("No states have come: `frankapy status` tells why.")
    return Demonstration.of_states(
        np.array([state.robot.message_id for state in rows]) * 1e-3,
        np.array([state.robot.q for state in rows]),
        np.array([state.robot.O_T_EE for state in rows]),
    )
