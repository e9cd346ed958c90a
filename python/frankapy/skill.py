"""Skills from parts: the messages of frankapy.proto are the parts."""

from __future__ import annotations

from collections.abc import Sequence

from google.protobuf.message import Message

from frankapy import parts, proto
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.validation import number, validate


def make_skill(
    trajectory: Message,
    controller: Message,
    terminations: Sequence[Message] = (),
    description: str = "",
    robot_controller: str = "auto",
    speed: float = 1,
    start_time: float | None = None,
) -> proto.Skill:
    """Put one trajectory, one controller and any number of terminations into a skill, after checking each.

    Raises FrankaArmArgumentError which names the field that breaks its rule, or what does not fit and what would.
    """
    for role, part in [("trajectory", trajectory), ("controller", controller), *(("until", end) for end in terminations)]:
        if not isinstance(part, Message):
            raise FrankaArmArgumentError(f"{role} is {part!r}: expected a part of a skill, such as those of frankapy.parts")
    names = proto.RobotController.keys()
    if not isinstance(robot_controller, str) or robot_controller.upper() not in names:
        raise FrankaArmArgumentError(
            f"robot_controller is {robot_controller!r}: expected one of {', '.join(names).lower()}"
        )
    parts.check_fit(trajectory, controller, robot_controller)
    skill = proto.Skill(
        description=description,
        robot_controller=robot_controller.upper(),
        speed=number("speed", speed),
    )
    if start_time is not None:
        skill.start_time = number("start_time", start_time)
    validate(skill)
    validate(trajectory)
    skill.trajectory.Pack(trajectory)
    validate(controller)
    skill.controller.Pack(controller)
    for termination in terminations:
        validate(termination)
        skill.terminations.add().Pack(termination)
    return skill
