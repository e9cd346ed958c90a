"""Ctrl-C, and a terminal that is closed, stop arms and hands that this program moves, also where nobody waits for them."""

from __future__ import annotations

import signal
import threading
import weakref
from types import FrameType
from typing import Protocol


class Stoppable(Protocol):
    """What is stopped: a connection with its arm and hand."""

    def stop_commands(self) -> None:
        """Stop what is under way, from within a signal handler; wait for nothing."""


_stoppable: weakref.WeakSet[Stoppable] = weakref.WeakSet()
_count = 0


def stop_on_interrupt(stoppable: Stoppable) -> None:
    """Let Ctrl-C and SIGHUP stop what is under way.

    Only where they would end the program: handlers of the script's own stay, and so does what `nohup` has set. Threads cannot
    set any.
    """
    _stoppable.add(stoppable)
    if threading.current_thread() is not threading.main_thread():
        return
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupted)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_DFL:
        signal.signal(signal.SIGHUP, _hung_up)


def count() -> int:
    """Return how often this program was interrupted: a command that was on its way meanwhile is to be stopped too."""
    return _count


def _stop_all() -> None:
    global _count
    _count += 1
    for each in list(_stoppable):
        each.stop_commands()


def _interrupted(signum: int, frame: FrameType | None) -> None:
    _stop_all()
    signal.default_int_handler(signum, frame)


def _hung_up(signum: int, frame: FrameType | None) -> None:
    _stop_all()
    raise SystemExit(128 + signum)
