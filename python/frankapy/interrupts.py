"""Ctrl-C, and a terminal that is closed, stop arms and hands that this program moves, also where nobody waits for them."""

from __future__ import annotations

import signal
import threading
import weakref
from types import FrameType

from frankapy.connection import Connection

_connections: weakref.WeakSet[Connection] = weakref.WeakSet()
_count = 0


def stop_on_interrupt(connection: Connection) -> None:
    """Let Ctrl-C and SIGHUP stop what is under way over a connection.

    Only where they would end the program: handlers of the script's own stay, and so does what `nohup` has set. Threads cannot
    set any.
    """
    _connections.add(connection)
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
    for connection in list(_connections):
        connection.stop_commands()


def _interrupted(signum: int, frame: FrameType | None) -> None:
    _stop_all()
    signal.default_int_handler(signum, frame)


def _hung_up(signum: int, frame: FrameType | None) -> None:
    _stop_all()
    raise SystemExit(128 + signum)
