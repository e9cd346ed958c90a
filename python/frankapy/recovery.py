"""Who brings the arm back after an error of the robot: the words for it, and the messages."""

from __future__ import annotations

from frankapy import proto
from frankapy.exceptions import FrankaArmArgumentError

# What waiting may change: people at the robot do something.
WAITS_FOR_PEOPLE = (proto.HELD_BY_HAND, proto.STOPPED_BY_USER, proto.NOT_ACTIVE, proto.IN_REFLEX)

_MOST_TIMES = 1000  # RecoveryPolicy.times
_WORDS = {
    "itself": proto.RecoveryPolicy.ITSELF,
    "ask": proto.RecoveryPolicy.ASK,
    "never": proto.RecoveryPolicy.NEVER,
}


def policy(recover: str | int) -> proto.RecoveryPolicy:
    """Return what a word stands for: "itself", how often in a row the arm may recover by itself, "ask", or "never".

    Raises FrankaArmArgumentError for anything else.
    """
    if isinstance(recover, int) and not isinstance(recover, bool):
        if not 1 <= recover <= _MOST_TIMES:
            raise FrankaArmArgumentError(f"recover is {recover}: expected 1 to {_MOST_TIMES} times in a row")
        return proto.RecoveryPolicy(who=proto.RecoveryPolicy.ITSELF, times=recover)
    if not isinstance(recover, str) or recover not in _WORDS:
        words = ", ".join(repr(word) for word in _WORDS)
        raise FrankaArmArgumentError(f"recover is {recover!r}: expected {words}, or how often in a row the arm may do it by itself")
    return proto.RecoveryPolicy(who=_WORDS[recover])


def told(recovery: proto.Recovery) -> str:
    """Return what came of an arm that was asked to recover, in words."""
    if not recovery.recovered:
        return f"not recovered: {recovery.message}"
    text = f"the arm is ready after {1e3 * recovery.time:.0f} ms"
    if recovery.moved_back:
        text += f"; back inside their range: joint {', '.join(map(str, recovery.moved_back))}"
    return text
