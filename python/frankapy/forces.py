"""Forces and torques of the published interface: as trajectories, and as what follows them."""

from __future__ import annotations

from typing import Any

import numpy as np

from frankapy import proto
from frankapy.controllers import given
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.franka_constants import FrankaConstants as FC
from frankapy.validation import number, numbers, vector


def anywhere(
    run_duration: Any, acc_duration: Any, max_translation: Any, max_rotation: Any, forces: Any, torques: Any
) -> tuple[proto.Impulse, proto.PassThrough]:
    """Return trajectory and controller of apply_effector_forces_torques."""
    force, torque = (
        np.zeros(3) if value is None else vector(name, value, 3) for name, value in (("forces", forces), ("torques", torques))
    )
    impulse = _impulse(run_duration, acc_duration, force, FC.MAX_LIN_MOMENTUM)
    _within_momentum("torques", torque, impulse.duration, FC.MAX_ANG_MOMENTUM)
    impulse.torque.extend(torque)
    return impulse, proto.PassThrough(
        max_translation=number("max_translation", max_translation), max_rotation=number("max_rotation", max_rotation)
    )


def on_a_line(
    run_duration: Any, acc_duration: Any, max_translation: Any, forces: Any
) -> tuple[proto.Impulse, proto.ForceAxisImpedance]:
    """Return trajectory and controller of apply_effector_forces_along_axis."""
    force = vector("forces", forces, 3)
    if not force.any():
        raise FrankaArmArgumentError("forces is 0 along every axis: expected a force, as the arm is held on its line")
    impulse = _impulse(run_duration, acc_duration, force, FC.MAX_LIN_MOMENTUM_CONSTRAINED)
    return impulse, proto.ForceAxisImpedance(axis=force, max_translation=number("max_translation", max_translation))


def _impulse(run_duration: Any, acc_duration: Any, force: np.ndarray, most: float) -> proto.Impulse:
    duration, rise = number("run_duration", run_duration), number("acc_duration", acc_duration)
    if rise > duration / 2:
        raise FrankaArmArgumentError(
            f"acc_duration is {rise:g} s: expected at most half of run_duration, which is {duration:g} s"
        )
    _within_momentum("forces", force, duration, most)
    return proto.Impulse(force=force, acc_duration=rise, duration=duration)


def _within_momentum(what: str, vector: np.ndarray, duration: float, most: float) -> None:
    strength = float(np.linalg.norm(vector))
    if strength * duration > most:
        raise FrankaArmArgumentError(
            f"{what} of {strength:.3g} for run_duration {duration:g} s make {strength * duration:.4g}: expected at most {most:g}"
        )


def of_joints(
    joint_torques: Any, selection: Any, remove_gravity: Any, k_gains: Any, d_gains: Any, dynamic: bool
) -> proto.PassThroughJointTorque:
    """Return the controller of execute_joint_torques."""
    return proto.PassThroughJointTorque(
        torque=vector("joint_torques", joint_torques, 7),
        selection=vector("selection", selection, 7),
        remove_gravity=vector("remove_gravity", remove_gravity, 7),
        stiffness=given("k_gains", k_gains, 7),
        damping=given("d_gains", d_gains, 7),
        topic=FC.DEFAULT_SENSOR_PUBLISHER_TOPIC if dynamic else None,
        timeout=0,  # as ever, the last torque stays
    )


def beside_poses(
    position_kps_cart: Any, force_kps_cart: Any, position_kps_joint: Any, force_kps_joint: Any, S: Any, use_cartesian_gains: bool
) -> proto.ForcePosition:
    """Return the controller of run_dynamic_force_position."""
    per_joint = numbers("force_kps_joint", force_kps_joint)
    if len(per_joint) == 6:  # the default of published scripts
        per_joint = np.append(per_joint, per_joint[-1])
    return proto.ForcePosition(
        selection=vector("S", S, 6),
        use_cartesian_gains=use_cartesian_gains,
        position_kps_cart=vector("position_kps_cart", position_kps_cart, 6),
        force_kps_cart=vector("force_kps_cart", force_kps_cart, 6),
        position_kps_joint=vector("position_kps_joint", position_kps_joint, 7),
        force_kps_joint=vector("force_kps_joint", per_joint, 7),
        topic=FC.DEFAULT_SENSOR_PUBLISHER_TOPIC,
    )
