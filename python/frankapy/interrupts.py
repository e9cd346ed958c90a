"""Ctrl-C, and a terminal that is closed, stop arms and hands that this program moves, also where nobody waits for them."""

from __future__ import annotations

import signal
import threading
import weakref
from collections.abc import Callable
from types import FrameType
from typing import Protocol


class Stoppable(Protocol):
    """What is stopped: a connection with its arm and hand."""

    def stop_commands(self) -> None:
        """Stop what is under way, from within a signal handler; wait for nothing."""


_FRAMEWORKS = ("asyncio", "rospy")  # whose own handlers know nothing of arms

_stoppable: weakref.WeakSet[Stoppable] = weakref.WeakSet()
_count = 0
_before: Callable[[int, FrameType | None], object] = signal.default_int_handler  # what Ctrl-C did, and then does too


def stop_on_interrupt(stoppable: Stoppable) -> None:
    """Let Ctrl-C and SIGHUP stop what is under way.

    Only where they would end the program, or asyncio's loop, or ROS: handlers of the script's own stay, and so does what `nohup`
    has set. Threads cannot set any.
    """
    _stoppable.add(stoppable)
    watch()


def watch() -> None:
    """Set the handlers anew: before each command, as a notebook sets its own in each cell, and asyncio in each of its loops."""
    global _before
    if threading.current_thread() is not threading.main_thread():
        return
    now = signal.getsignal(signal.SIGINT)
    if callable(now) and (now is signal.default_int_handler or _is_of_framework(now)):
        _before = now
        signal.signal(signal.SIGINT, _interrupted)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_DFL:
        signal.signal(signal.SIGHUP, _hung_up)


def count() -> int:
    """Return how often this program was interrupted: a command that was on its way meanwhile is to be stopped too."""
    return _count


def _is_of_framework(handler: Callable[[int, FrameType | None], object]) -> bool:
    function = getattr(handler, "func", handler)  # asyncio's is a partial one
    return str(getattr(function, "__module__", "")).partition(".")[0] in _FRAMEWORKS


def _stop_all() -> None:
    global _count
    _count += 1
    for each in list(_stoppable):
        each.stop_commands()


def _interrupted(signum: int, frame: FrameType | None) -> None:
    global _before
    _stop_all()
    before, _before = _before, signal.default_int_handler  # ROS calls the one before its own, which may be this
    try:
        before(signum, frame)
    finally:
        _before = before


def _hung_up(signum: int, frame: FrameType | None) -> None:
    _stop_all()
    raise SystemExit(128 + signum)
