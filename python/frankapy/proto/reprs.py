"""How states and results show themselves, as in a notebook: a line with units. `print` shows all of their fields."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from frankapy.digits import digits
from frankapy.proto import service_pb2, skill_pb2, state_pb2


def _robot(robot: Any) -> list[str]:
    words = []
    if len(robot.q):
        words.append(f"joints {digits(robot.q)} rad")
    if len(robot.O_T_EE) == 16:
        words.append(f"tool at {digits(robot.O_T_EE[12:15])} m")
    if len(robot.O_F_ext_hat_K) == 6:
        words.append(f"{np.linalg.norm(robot.O_F_ext_hat_K[:3]):.1f} N and {np.linalg.norm(robot.O_F_ext_hat_K[3:]):.1f} Nm on it")
    if errors := list(robot.errors):
        words.append(f"errors {', '.join(errors)}")
    return words


def _hand(hand: Any) -> str:
    return f"{1e3 * hand.width:.1f} mm open{', holds something' if hand.is_grasped else ''}"


def _robot_state(state: Any) -> list[str]:
    return [*_named(state_pb2.RobotMode, state, "robot_mode"), *_robot(state)]


def _arm_state(state: Any) -> list[str]:
    words = _named(state_pb2.Phase, state, "phase")
    if state.skill_id:
        words.append(f"skill {state.skill_description or state.skill_id!r} since {state.skill_time:.2f} s")
    words += _robot(state.robot)
    if state.HasField("gripper"):
        words.append(f"hand {_hand(state.gripper)}")
    if state.HasField("age"):
        words.append(f"{1e3 * state.age:.1f} ms old")
    return words


def _skill_result(result: Any) -> list[str]:
    if not result.HasField("ending"):
        return []
    by = f" by {result.termination}" if result.termination else ""
    words = [f"{_named(skill_pb2.Ending, result, 'ending')[0]}{by} after {result.time:.3f} s"]
    for after in _named(skill_pb2.AfterContact, result, "after_contact"):
        words.append(f"{after} {1e3 * result.backed_off:.1f} mm" if result.HasField("backed_off") else after)
    if result.stretch > 1.001:
        words.append(f"{result.stretch:.2f} times as long as asked for")
    if held := [name.lower().replace("_", " ") for name, bit in state_pb2.HeldBy.items() if result.held_by & bit]:
        words.append(f"held back by {', '.join(held)}{f' {result.wall!r}' if result.wall else ''}")
    for field, scale, unit in (("joints_left", 1, "rad"), ("position_left", 1e3, "mm"), ("angle_left", 1, "rad")):
        if result.HasField(field):
            words.append(f"{scale * getattr(result, field):.3g} {unit} left")
    return [*words, *result.errors, *([result.message] if result.message else [])]


def _named(enum: Any, message: Any, field: str) -> list[str]:
    return [enum.Name(getattr(message, field)).lower().replace("_", " ")] if message.HasField(field) else []


def _limits(limits: Any) -> list[str]:
    return [
        f"{words} {digits(values)} {unit}"
        for words, values, unit in (
            ("from", limits.q_min, "rad"), ("to", limits.q_max, "rad"), ("rests from", limits.rest_min, "rad"),
            ("to", limits.rest_max, "rad"), ("up to", limits.dq_max, "rad/s"),
        )
        if len(values)
    ]  # fmt: skip


def _recording(status: Any) -> list[str]:
    words = [f"{status.file}{'' if status.open else ' (closed)'}"] if status.file else []
    words.append(f"{status.time:.1f} s, {status.states} states, {status.bytes / 1e6:.1f} MB, {status.lost} lost")
    return [*words, *([status.error] if status.error else [])]


def _topic(topic: Any) -> list[str]:
    words = [f"{topic.topic!r} of {topic.message or 'nothing yet'}: {topic.received} received"]
    for field in ("lost", "out_of_order", "late", "stale", "refused", "overrun", "silences"):
        if count := getattr(topic, field):
            words.append(f"{count} {field.replace('_', ' ')}")
    if topic.HasField("age"):
        words.append(f"newest {topic.age:.3f} s ago")
    return [*words, *([topic.why_refused] if topic.why_refused else [])]


def _gripper_result(result: Any) -> list[str]:
    return ["success" if result.success else f"no success: {result.message or 'no reason given'}"]


def _shown(words_of: Callable[[Any], list[str]]) -> Callable[[Any], str]:
    return lambda message: f"{message.DESCRIPTOR.name}({'; '.join(words_of(message))})"


_LINES: dict[type, Callable[[Any], list[str]]] = {
    state_pb2.ArmState: _arm_state,
    state_pb2.RobotState: _robot_state,
    state_pb2.GripperState: lambda hand: [_hand(hand)],
    skill_pb2.SkillResult: _skill_result,
    service_pb2.GripperResult: _gripper_result,
    service_pb2.JointLimits: _limits,
    service_pb2.RecordingStatus: _recording,
    service_pb2.Topics.Topic: _topic,
}
for _kind, _words in _LINES.items():
    setattr(_kind, "__repr__", _shown(_words))  # noqa: B010
