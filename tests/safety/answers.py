"""How long servers take to answer, in time that this process has lived: a computer that stands still is no server that is slow."""

import threading
import time
from collections.abc import Callable

from frankapy import proto
from frankapy.connection import Connection

LATE = 1.0  # s
TICK, MOST = 0.01, 0.03  # s between looks at the clock, and as how much a pause between them counts at most
RECOVERS = "recover"  # is answered when the arm has recovered


class Answers:
    """Of all connections of this process, from now on."""

    def __init__(self, late: Callable[[str, float], None]) -> None:
        """`late`: called with the kind of a request that was answered late, and after how many s."""
        self.number = 0
        self.longest = 0.0  # s
        self.counts = True  # not while a server is killed
        self._lived = 0.0
        threading.Thread(target=self._live, daemon=True).start()
        answered = Connection._answered

        def timed(connection: Connection, request: proto.Request) -> object:
            begin = self._lived
            try:
                return answered(connection, request)
            finally:
                kind = str(request.WhichOneof("call"))
                if self.counts and kind != RECOVERS:
                    took = self._lived - begin
                    self.number += 1
                    self.longest = max(self.longest, took)
                    if took > LATE:
                        late(kind, took)

        Connection._answered = timed

    def _live(self) -> None:
        before = time.monotonic()
        while True:
            time.sleep(TICK)
            now = time.monotonic()
            self._lived += min(now - before, MOST)
            before = now
