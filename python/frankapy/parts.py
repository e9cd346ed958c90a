"""Parts of skills, by name: trajectory generators, feedback controllers, terminations, and what contact ends softly with.

Each kind of wire/proto is a function of this module that returns its message, checked. What it takes are the message's
fields, in their order or by name, in the units of `frankapy kinds`:

    MinJerkPose(goal, 3.0)                      a RigidTransform stands for position and quaternion
    JointWaypoints(q, times=[1, 2, 4])          q is an array (3, 7); a list of RigidTransforms is one of poses
    CartesianImpedance(600, 50)                 one number stands for all elements of a field that may be left out
    ForceAbove(10, axis="z", frame="base")      x, y and z are axes; enums are named in either case
    AnyOf(FinalPose(1e-3), Time(4))             parts in a part
    Contact(then=BackOff(0.01))                 what the arm does after a contact
"""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable
from typing import Any

from google.protobuf.descriptor import Descriptor
from google.protobuf.message import Message

from frankapy.kinds import Kind, Pose, check_fit, describe, holds_parts, kinds, make, robot_controllers, text_of


def _function(role: str, descriptor: Descriptor) -> Callable[..., Message]:
    def part(*arguments: Any, **named: Any) -> Message:
        return make(descriptor.name, *arguments, **named)

    fields = list(descriptor.fields)
    lines = [f"    {field.name}: {text_of(field)}" for field in fields]
    part.__name__ = part.__qualname__ = descriptor.name
    part.__doc__ = "\n".join([f"{descriptor.name}, a kind of {role}.", *(["", "Args:", *lines] if lines else [])])
    if not (fields and holds_parts(fields[0])):
        kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
        part.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
            [inspect.Parameter(field.name, kind, default=None) for field in fields]
        )
    return part


globals().update({descriptor.name: _function(role, descriptor) for role, descriptor in kinds()})
__all__ = [
    "Kind", "Pose", "check_fit", "describe", "kinds", "make", "robot_controllers", "text_of",
    *(descriptor.name for _, descriptor in kinds()),
]  # fmt: skip


def __getattr__(name: str) -> types.FunctionType:
    """Say which kinds there are."""
    raise AttributeError(f"frankapy.parts has no {name}: kinds are {', '.join(d.name for _, d in kinds())}")
