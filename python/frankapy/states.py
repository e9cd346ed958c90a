"""The states of an arm as its server publishes them, one for each cycle of 1 ms."""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType

import zmq

from frankapy import proto


class StateStream:
    """Iterates over the states of an arm from now on; each is a proto.ArmState.

    A reader that is slower than the arm loses the oldest when a few thousand wait. Use it with `with`, or close it.
    """

    def __init__(self, endpoint: str, timeout: float = 1.0) -> None:
        """Subscribe at `endpoint` (Welcome.state_endpoint).

        Iteration ends after `timeout` (s) without a state.
        """
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        self._socket.rcvhwm = 10_000
        self._socket.rcvtimeo = int(1000 * timeout)
        self._socket.subscribe(b"")
        self._socket.connect(endpoint)

    def __iter__(self) -> Iterator[proto.ArmState]:
        while (state := self.receive()) is not None:
            yield state

    def receive(self) -> proto.ArmState | None:
        """Wait for the next state; None when there is none within the timeout."""
        try:
            return proto.ArmState.FromString(self._socket.recv())
        except zmq.Again:
            return None

    def close(self) -> None:
        """End the subscription."""
        self._context.destroy(linger=0)

    def __enter__(self) -> StateStream:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
