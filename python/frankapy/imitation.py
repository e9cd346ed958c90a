"""Imitation: an arm that does what it has learned."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from frankapy import proto
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.rigid_transform import RigidTransform
from frankapy.validation import vector, whole

if TYPE_CHECKING:
    from frankapy.dmp import Primitive
    from frankapy.franka_arm import FrankaArm

_SPEED = 0.2  # of the limits, to where a motion begins


def begin(fa: FrankaArm, primitive: Primitive, start: Any = None) -> tuple[np.ndarray, np.ndarray]:
    """Return where a motion begins, rad (7,) or m (3,), and the joints there, rad (7,).

    At `start`; None: where the primitive was learned, or where the arm is if it does not say. Raises
    FrankaArmArgumentError where no joints bring the tool there.
    """
    start = primitive.start if start is None else vector("start", start, len(primitive.weights))
    joints = fa.get_joints()
    if primitive.kind == "joint":
        return (joints, joints) if start is None else (start, start)
    pose = fa.get_pose(include_tool_offset=False)
    if primitive.start_orientation is not None:
        pose.rotation = RigidTransform.rotation_from_quaternion(primitive.start_orientation)
    if start is None and primitive.start_orientation is None:
        return pose.translation, joints
    if start is not None:
        pose.translation = start
    return pose.translation, fa.ik(pose * fa.get_tool_base_pose(), near=joints)


def imitate(
    fa: FrankaArm, primitive: Primitive, start: Any, changed: dict[str, Any], loops: int, skill_desc: str
) -> list[proto.SkillResult]:  # fmt: skip
    """Do what was learned, `changed` being arguments of its part; the work of FrankaArm.imitate."""
    from frankapy.dmp import Primitive

    if not isinstance(primitive, Primitive):
        raise FrankaArmArgumentError(f"primitive is a {type(primitive).__name__}: expected a Primitive of frankapy.dmp")
    loops = whole("loops", loops)
    start, joints = begin(fa, primitive, start)
    there = proto.TimeOptimalJoint(q=joints, speed=_SPEED)
    trajectory = primitive.part(start=start, **changed)
    fa.check(there)
    fa.check(trajectory, joints=joints)
    results = []
    for _ in range(loops):
        fa.run(there, skill_desc=f"{skill_desc}: to its start")
        result = fa.run(trajectory, skill_desc=skill_desc)
        if result is not None:
            results.append(result)
    return results
