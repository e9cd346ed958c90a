"""How long servers take to answer, in time that this process has lived: a computer that stands still is no server that is slow."""

import threading
import time
from collections.abc import Callable

from frankapy import proto
from frankapy.connection import Connection

TICK, MOST = 0.01, 0.03  # s between looks at the clock, and as how much a pause between them counts at most


def time_answers(answered: Callable[[str, float], None]) -> None:
    """Have `answered` called with the kind of each request of this process, from now on, and how long its answer took, s."""
    lived = 0.0
    ask = Connection._answered

    def live() -> None:
        nonlocal lived
        before = time.monotonic()
        while True:
            time.sleep(TICK)
            now = time.monotonic()
            lived += min(now - before, MOST)
            before = now

    def timed(connection: Connection, request: proto.Request) -> object:
        begin = lived
        try:
            return ask(connection, request)
        finally:
            answered(str(request.WhichOneof("call")), lived - begin)

    threading.Thread(target=live, daemon=True).start()
    Connection._answered = timed
