"""Movement primitives as the dictionaries that published scripts have, made into trajectories."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from google.protobuf.message import Message

from frankapy import proto
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.validation import number, numbers, vector

KEYS = ("tau", "alpha", "beta", "num_basis", "num_sensors", "mu", "h", "weights")
_QUATERNION_TYPED = 0.05  # by which the norm of one that was typed in may differ from 1


def joint_dmp(info: Mapping[str, Any], duration: Any, sensor_values: Any) -> proto.JointDmp:
    """Return the trajectory of execute_joint_dmp."""
    return proto.JointDmp(
        **checked_fields("joint_dmp_info", info, 7),
        initial_sensor_values=_sensor_values(sensor_values, info, 1),
        duration=number("duration", duration),
    )


def pose_dmp(
    info: Mapping[str, Any],
    duration: Any,
    sensor_values: Any,
    use_goal_formulation: bool,
    orientation_only: bool,
    position_only: bool,
    ee_frame: bool,
) -> Message:
    """Return the trajectory of execute_pose_dmp."""
    dimensions = 3 if orientation_only or position_only else 6
    kind = proto.GoalPoseDmp if use_goal_formulation else proto.PoseDmp
    return kind(
        **checked_fields("pose_dmp_info", info, dimensions),
        initial_sensor_values=_sensor_values(sensor_values, info, dimensions),
        duration=number("duration", duration),
        position_only=position_only,
        orientation_only=orientation_only,
        ee_frame=ee_frame,
    )


def quaternion_pose_dmp(
    position_info: Mapping[str, Any],
    quat_info: Mapping[str, Any],
    duration: Any,
    goal_quat: Any,
    goal_quat_time: Any,
    sensor_values: Any,
    ee_frame: bool,
) -> proto.QuaternionPoseDmp:
    """Return the trajectory of execute_quaternion_pose_dmp."""
    goal = vector("goal_quat", goal_quat, 4)
    norm = float(np.linalg.norm(goal))
    if abs(norm - 1) > _QUATERNION_TYPED:
        raise FrankaArmArgumentError(f"goal_quat has the norm {norm:.6g}: expected w, x, y, z of a unit quaternion")
    quat = checked_fields("quat_dmp_info", quat_info, 3)
    del quat["tau"]
    return proto.QuaternionPoseDmp(
        **{f"position_{key}": value for key, value in checked_fields("position_dmp_info", position_info, 3).items()},
        **{f"quat_{key}": value for key, value in quat.items()},
        initial_sensor_values=_sensor_values(sensor_values, position_info, 3),
        goal_quat=goal / norm,
        goal_quat_time=number("goal_quat_time", goal_quat_time),
        duration=number("duration", duration),
        ee_frame=ee_frame,
    )


def checked_fields(name: str, info: Mapping[str, Any], dimensions: int) -> dict[str, Any]:
    """Return the fields of a dictionary, of which sizes agree."""
    if not isinstance(info, Mapping):
        raise FrankaArmArgumentError(f"{name} is a {type(info).__name__}: expected a dictionary with {', '.join(KEYS)}")
    missing = [key for key in KEYS if key not in info]
    if missing:
        raise FrankaArmArgumentError(f"{name} has no {missing[0]}: expected {', '.join(KEYS)}")
    basis, sensors = (number(f"{name}[{key!r}]", info[key]) for key in ("num_basis", "num_sensors"))
    only = " (3 with position_only or orientation_only)" if dimensions == 6 else ""
    fields: dict[str, Any] = {key: number(f"{name}[{key!r}]", info[key]) for key in ("tau", "alpha", "beta")}
    for key, size, of in [
        ("mu", basis, "num_basis"),
        ("h", basis, "num_basis"),
        ("weights", dimensions * basis * sensors, f"{dimensions} dimensions{only} times num_basis times num_sensors"),
    ]:
        fields[key] = numbers(f"{name}[{key!r}]", info[key])
        if len(fields[key]) != size:
            raise FrankaArmArgumentError(f"{name}[{key!r}] has {len(fields[key])} elements: expected {size:g}, {of}")
    return fields


def _sensor_values(values: Any, info: Mapping[str, Any], dimensions: int) -> np.ndarray | None:
    if values is None:
        return None
    return vector("initial_sensor_values", numbers("initial_sensor_values", values), dimensions * int(info["num_sensors"]))
