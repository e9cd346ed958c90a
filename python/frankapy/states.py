"""The states of an arm as its server publishes them, one for each cycle of 1 ms."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from types import TracebackType

import zmq
from google.protobuf.field_mask_pb2 import FieldMask

from frankapy import proto
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.sockets import owned_socket

_RATE = 1000  # Hz, of the arm
_ALL = b"1\0"  # the subscription to all of every state


class NewestState:
    """The newest state of an arm, at hand without a question to its server: ZeroMQ's own thread keeps it."""

    def __init__(self, endpoint: str) -> None:
        """Subscribe at `endpoint` (Welcome.state_endpoint)."""
        self._lock = threading.Lock()
        self._state: proto.ArmState | None = None
        self._socket, self._close = owned_socket(self, zmq.SUB)
        self._socket.conflate = True
        self._socket.subscribe(_ALL)
        self._socket.connect(endpoint)

    def read(self) -> proto.ArmState | None:
        """Return it; None before the first has come, and after the end."""
        with self._lock:
            if not self._close.alive:
                return None
            try:
                self._state = proto.ArmState.FromString(self._socket.recv(zmq.NOBLOCK)[len(_ALL) :])
            except zmq.Again:
                pass
            return self._state

    def close(self) -> None:
        """End the subscription."""
        with self._lock:
            self._close()


class StateStream:
    """Iterates over the states of an arm from now on; each is a proto.ArmState.

    For a reader that is slower than the arm they wait, 10 s long and more; then those are lost that come while that many wait.
    Use it with `with`, or close it.
    """

    def __init__(self, endpoint: str, timeout: float = 5.0, rate: float = 1000, fields: Sequence[str] = ()) -> None:
        """Subscribe at `endpoint` (Welcome.state_endpoint).

        Iteration ends after `timeout` (s) without a state. `rate` (1/s) is 1000, or that divided by a whole number; `fields`
        are those that are sent ("robot.q", "phase"), none: all. Raises FrankaArmArgumentError for others.
        """
        every = round(_RATE / rate) if 0 < rate <= _RATE else 0
        if every == 0 or abs(_RATE / every - rate) > 1e-3 * rate:
            raise FrankaArmArgumentError(f"rate is {rate:g} Hz: expected {_RATE}, or that divided by a whole number")
        mask = FieldMask(paths=fields)
        for field in fields:
            if not FieldMask(paths=[field]).IsValidForDescriptor(proto.ArmState.DESCRIPTOR):  # type: ignore[arg-type]
                raise FrankaArmArgumentError(f"fields has {field!r}: expected fields of ArmState, such as 'robot.q' or 'phase'")
        topic = str(every) + (f" {','.join(mask.paths)}" if fields else "")
        self._topic = topic.encode() + b"\0"
        self._socket, self._close = owned_socket(self, zmq.SUB)
        self._socket.rcvhwm = 10_000
        self._socket.rcvtimeo = int(1000 * timeout)
        self._socket.subscribe(self._topic)
        self._socket.connect(endpoint)

    def __iter__(self) -> Iterator[proto.ArmState]:
        while (state := self.receive()) is not None:
            yield state

    def receive(self) -> proto.ArmState | None:
        """Wait for the next state; None when there is none within the timeout."""
        try:
            return proto.ArmState.FromString(self._socket.recv()[len(self._topic) :])
        except zmq.Again:
            return None

    def close(self) -> None:
        """End the subscription."""
        self._close()

    def __enter__(self) -> StateStream:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
