"""What ends a motion of the published interface: its goal, its time, contact, and whatever it is, a message."""

from __future__ import annotations

from collections.abc import Sized
from typing import Any

from google.protobuf.message import Message

from frankapy import proto
from frankapy.franka_constants import FrankaConstants as FC
from frankapy.validation import number, vector

_LONGEST = 1e9  # s, of Time; scripts write more where they mean for ever
_SAID = proto.SensorSays(topic=FC.DEFAULT_SENSOR_PUBLISHER_TOPIC)  # ends whatever runs


def at_goal(goal: Message, buffer_time: Any, force_thresholds: Any, torque_thresholds: Any) -> list[Message]:
    """Return the goal, or contact in its place where thresholds are given, and `buffer_time` (s) after the trajectory."""
    return [*(_contact(force_thresholds, torque_thresholds) or [goal]), _time_after(buffer_time), _SAID]


def in_time(buffer_time: Any, force_thresholds: Any, torque_thresholds: Any) -> list[Message]:
    """Return `buffer_time` (s) after the trajectory, and contact where thresholds are given."""
    return [_time_after(buffer_time), _SAID, *_contact(force_thresholds, torque_thresholds)]


def of_time(duration: Any, buffer_time: Any, force_thresholds: Any, torque_thresholds: Any) -> list[Message]:
    """Return the time of a motion that waits for nothing (s), and contact where thresholds are given."""
    seconds = number("duration", duration) + number("buffer_time", buffer_time)
    return [proto.Time(seconds=min(seconds, _LONGEST)), _SAID, *_contact(force_thresholds, torque_thresholds)]


def streamed_or_in_time(
    dynamic: bool, duration: Any, buffer_time: Any, force_thresholds: Any, torque_thresholds: Any
) -> list[Message]:
    """Return `of_time` with `dynamic`, else `in_time`."""
    if dynamic:
        return of_time(duration, buffer_time, force_thresholds, torque_thresholds)
    return in_time(buffer_time, force_thresholds, torque_thresholds)


def _time_after(buffer_time: Any) -> proto.Time:
    return proto.Time(after_trajectory=min(number("buffer_time", buffer_time), _LONGEST))


def _contact(force_thresholds: Any, torque_thresholds: Any) -> list[Message]:
    """Return contact of the tool; [] stands for thresholds of the server, None for none."""
    if force_thresholds is None and torque_thresholds is None:
        return []
    thresholds = {"force_thresholds": (force_thresholds, 6), "torque_thresholds": (torque_thresholds, 7)}
    given: dict[str, Any] = {
        name: vector(name, each, size)
        for name, (each, size) in thresholds.items()
        if each is not None and not (isinstance(each, Sized) and len(each) == 0)
    }
    return [proto.Contact(**given)]
