"""The server's recorder, switched on and off."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

from frankapy import proto
from frankapy.connection import Connection
from frankapy.exceptions import FrankaArmException

_PATIENCE = 5.0  # s for the server to begin or to end a file


@contextlib.contextmanager
def recording(server: Connection) -> Iterator[Callable[[], proto.RecordingStatus]]:
    """Record what happens inside; gives a function that tells what there is.

    Raises FrankaArmException where the server cannot write.
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
    before = ask(on=True).states
    try:
        wait(lambda status: status.open and status.states != before)
        yield lambda: ask(on=inside or None)  # asked again: this client may have had to connect anew
    finally:
        inside = False
        ask(on=False)
        wait(lambda status: not status.open)
