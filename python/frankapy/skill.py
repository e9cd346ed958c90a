"""Skills from parts: the messages of frankapy.proto are the parts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from google.protobuf import descriptor_pool, message_factory
from google.protobuf.message import Message

from frankapy import parts, proto
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.validation import number, text, validate

_LONGEST_DESCRIPTION = 1000  # bytes; it goes with every state


def any_of(until: Message | Sequence[Message]) -> list[Message]:
    """Return terminations as the server takes them: any of them."""
    terminations: list[Message] = []
    if not isinstance(until, (Message, Iterable)):
        raise FrankaArmArgumentError(f"until is {until!r}: expected terminations, such as Time(4)")
    for end in [until] if isinstance(until, Message) else list(until):
        if isinstance(end, proto.AnyOf):
            terminations += [_unpacked(part) for part in end.of]
        else:
            terminations.append(end)
    return terminations


def check_part(role: str, part: Any) -> None:
    """Raise FrankaArmArgumentError for what is no part of a skill, or one that breaks a rule."""
    if not isinstance(part, Message):
        raise FrankaArmArgumentError(f"{role} is {part!r}: expected a part of a skill, such as those of frankapy.parts")
    validate(part)


def _unpacked(part: Any) -> Message:
    try:
        kind = descriptor_pool.Default().FindMessageTypeByName(part.TypeName())
    except KeyError:
        raise FrankaArmArgumentError(f"AnyOf has a {part.TypeName()!r}: import its messages first") from None
    message: Message = message_factory.GetMessageClass(kind)()
    part.Unpack(message)
    return message


def make_skill(
    trajectory: Message,
    controller: Message,
    terminations: Sequence[Message] = (),
    description: str = "",
    robot_controller: str = "auto",
    speed: float = 1,
    start_time: float | None = None,
    publishers: Mapping[str, Sequence[str]] | None = None,
    recovery: proto.RecoveryPolicy | None = None,
) -> proto.Skill:
    """Put one trajectory, one controller and any number of terminations into a skill, after checking each.

    Raises FrankaArmArgumentError which names the field that breaks its rule, or what does not fit and what would.
    """
    for role, part in [("trajectory", trajectory), ("controller", controller), *(("until", end) for end in terminations)]:
        check_part(role, part)
    names = proto.RobotController.keys()
    if not isinstance(robot_controller, str) or robot_controller.upper() not in names:
        raise FrankaArmArgumentError(
            f"robot_controller is {robot_controller!r}: expected one of {', '.join(names).lower()}"
        )
    parts.check_fit(trajectory, controller, robot_controller)
    skill = proto.Skill(
        description=text("skill_desc", description, _LONGEST_DESCRIPTION),
        robot_controller=robot_controller.upper(),
        speed=number("speed", speed),
        recovery=recovery,
    )
    if start_time is not None:
        skill.start_time = number("start_time", start_time)
    if publishers is not None and not isinstance(publishers, Mapping):
        raise FrankaArmArgumentError(f"publishers is {publishers!r}: expected topics with names of keys, such as {{'goal': ['anna']}}")
    for topic, keys in (publishers or {}).items():
        if isinstance(keys, str) or not isinstance(keys, Iterable):
            raise FrankaArmArgumentError(f"publishers[{topic!r}] is {keys!r}: expected names of keys, such as ['anna']")
        skill.publishers.add(topic=text("topic", topic, 256), names=[text("name", name, 100) for name in keys])
    validate(skill)
    skill.trajectory.Pack(trajectory)
    skill.controller.Pack(controller)
    for termination in terminations:
        skill.terminations.add().Pack(termination)
    return skill
