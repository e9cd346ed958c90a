"""The server's recorder, switched on and off."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

from frankapy import proto
from frankapy.connection import Connection
from frankapy.exceptions import FrankaArmException
from frankapy.fork import Lock

_PATIENCE = 5.0  # s for the server to begin or to end a file

_count_lock = Lock()


@contextlib.contextmanager
def recording(server: Connection) -> Iterator[Callable[[], proto.RecordingStatus]]:
    """Record what happens inside; gives a function that tells what there is. Inside of another it is a part of that one.

    Raises FrankaArmException where the server cannot write, or has not until the end.
    """

    def ask(on: bool | None = None) -> proto.RecordingStatus:
        record = proto.Record() if on is None else proto.Record(on=on)
        return server.ask(proto.Request(record=record)).recording

    def wait(so: Callable[[proto.RecordingStatus], bool]) -> None:
        deadline = time.monotonic() + _PATIENCE
        while not so(status := ask()):
            if status.error:
                raise FrankaArmException(f"The server does not record: {status.error}")
            if time.monotonic() > deadline:
                return  # one that records all the time does not end
            time.sleep(0.01)

    inside = True
    before = ask()
    with _count_lock:
        server.recordings += 1
    try:
        ask(on=True)
        wait(lambda status: status.open and status.states != before.states)
        yield lambda: ask(on=inside or None)  # asked again: this client may have had to connect anew
        status = ask()
        error = "" if before.open and status.error == before.error else status.error  # of what others recorded before
        if error or not status.open:
            raise FrankaArmException(
                f"Not all was recorded: {error or 'the server has heard nothing of this program for a while'}. What there is, is "
                f"in {status.file}"
            )
    finally:
        inside = False
        with _count_lock:
            server.recordings -= 1
        if not server.recordings:
            ask(on=False)
            if not before.open:  # by somebody else
                wait(lambda status: not status.open)
