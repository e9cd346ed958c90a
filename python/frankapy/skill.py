"""Skills from parts: the messages of frankapy.proto are the parts."""

from __future__ import annotations

from collections.abc import Sequence

from google.protobuf.message import Message

from frankapy import proto
from frankapy.validation import validate


def make_skill(
    trajectory: Message, controller: Message, terminations: Sequence[Message] = (), description: str = ""
) -> proto.Skill:
    """Put one trajectory, one controller and any number of terminations into a skill, after checking each.

    Raises FrankaArmArgumentError which names the field that breaks its rule.
    """
    skill = proto.Skill(description=description)
    validate(trajectory)
    skill.trajectory.Pack(trajectory)
    validate(controller)
    skill.controller.Pack(controller)
    for termination in terminations:
        validate(termination)
        skill.terminations.add().Pack(termination)
    return skill
