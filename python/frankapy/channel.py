"""The socket to an arm's process, in a thread of its own: requests and their answers.

The thread alone touches the socket. Callers hand it requests through a deque and a pipe (both safe in signal
handlers) and wait on events. While this client commands the arm or records, the thread says so every 0.2 s, whatever the script
is doing.
"""

from __future__ import annotations

import collections
import itertools
import os
import threading
import time
import weakref
from collections.abc import Callable

import zmq
from google.protobuf.message import DecodeError

from frankapy import proto
from frankapy.client_key import ClientKey
from frankapy.exceptions import (
    FrankaArmArgumentError,
    FrankaArmBusyException,
    FrankaArmCommException,
    FrankaArmException,
    FrankaArmFrankaInterfaceNotReadyException,
    FrankaArmNotPermittedException,
)

SILENCE = 3.0  # s without an answer after which the server is taken for gone
_SLOWEST_NETWORK = 250e3  # bytes/s that a request may need to arrive
# Of a socket: that no connection came about.
HANDSHAKE_FAILURES = (
    zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
)
_COROUTINE_TICK = 0.002  # s
_ALIVE_PERIOD = 0.2  # s; the server frees the lease of a client that is silent for much longer

_EXCEPTIONS = {
    proto.Error.INVALID_ARGUMENT: FrankaArmArgumentError,
    proto.Error.NOT_READY: FrankaArmFrankaInterfaceNotReadyException,
    proto.Error.BUSY: FrankaArmBusyException,
    proto.Error.INCOMPATIBLE_VERSION: FrankaArmCommException,
    proto.Error.INTERNAL: FrankaArmException,
    proto.Error.UNKNOWN_CLIENT: FrankaArmCommException,
    proto.Error.NOT_PERMITTED: FrankaArmNotPermittedException,
}
# Answers after which another of the same request follows.
_PRELIMINARY = ("skill_started", "gripper_started")
# Requests that take the arm for this client, or need it; those that also read, where one of these fields is there.
_COMMANDS: dict[str, tuple[str, ...]] = {
    "start_skill": (),
    "change_skill": (),
    "gripper": (),
    "recover": (),
    "change_walls": ("remove", "put"),
    "change_limits": ("limits", "reset", "most"),
}
# The server's texts are for clients in any language: how what they advise is called here.
_ADVICE = [
    ("then recover", "fa.recover()"),
    ("preempt", "fa.wait_for_skill(), fa.stop_skill(), fa.run(..., preempt=True), or both motions in fa.sequence()"),
]


def is_command(request: proto.Request) -> bool:
    """Whether a request takes the arm for this client, or needs it."""
    kind = str(request.WhichOneof("call"))
    if not (changes := _COMMANDS.get(kind)):
        return kind in _COMMANDS
    return any(field.name in changes and value is not False for field, value in getattr(request, kind).ListFields())


def raise_error(reply: proto.Reply) -> None:
    """Raise the exception of an answer that is an error."""
    if reply.WhichOneof("answer") == "error":
        raise _EXCEPTIONS.get(reply.error.code, FrankaArmException)(advised(reply.error.message))


def advised(text: str) -> str:
    """Return what a server says with the names of the calls that do what it advises."""
    advice = next((calls for words, calls in _ADVICE if words in text), None)
    return f"{text} (in Python: {advice})" if advice else text


def is_unknown_key(monitor: zmq.Socket[bytes]) -> bool:
    """Whether the event that waits there says that a server does not take this client's key."""
    from zmq.utils.monitor import recv_monitor_message  # which imports asyncio, and that takes its time

    return bool(recv_monitor_message(monitor)["event"] == zmq.EVENT_HANDSHAKE_FAILED_AUTH)


def unknown_key(address: str, key: ClientKey | None) -> str:
    """Return what is said where a server does not know a key."""
    return (
        f"The server at {address} does not know {key}: was it removed? Whoever runs the server makes another one (`frankapy keys "
        "add`)."
    )


def parse_reply(data: bytes) -> proto.Reply | None:
    """Return an answer; None for bytes that are none."""
    try:
        return proto.Reply.FromString(data)
    except DecodeError:
        return None


async def answered(call: Callable[[], object], stop: Callable[[], object]) -> None:
    """Wait in a coroutine until a call returns something, or raises what an answer stands for.

    Where the coroutine is cancelled, `stop` is called.
    """
    import asyncio  # which takes its time

    try:
        while call() is None:
            await asyncio.sleep(_COROUTINE_TICK)
    except asyncio.CancelledError:
        stop()
        raise
    except FrankaArmException:
        pass  # the caller finds it again


class Call:
    """A request on its way: its first answer, and its last."""

    def __init__(self, request: proto.Request) -> None:
        self.request = request
        self._first = threading.Event()
        self._last = threading.Event()
        self._first_reply: proto.Reply | None = None
        self._last_reply: proto.Reply | None = None
        self._failure: str | None = None
        self.sent = 0.0  # by time.perf_counter()
        self.size = 0  # bytes, once it was sent
        self._pid = os.getpid()

    def first(self) -> proto.Reply:
        """Wait for the first answer; raises what an error stands for, FrankaArmCommException when nobody is there."""
        self._check_process()
        self._first.wait()
        return self._checked(self._first_reply)

    @property
    def kind(self) -> str:
        """Which request this is: the name of its field in proto.Request."""
        return str(self.request.WhichOneof("call"))

    @property
    def is_answered(self) -> bool:
        """Whether its first answer has come, or none will."""
        return self._first.is_set()

    @property
    def was_lost(self) -> bool:
        """Whether the connection ended before its first answer."""
        return self._first.is_set() and self._first_reply is None

    @property
    def was_unknown(self) -> bool:
        """Whether the server refused it because this client has to say Hello again."""
        reply = self._first_reply
        return (
            reply is not None
            and reply.WhichOneof("answer") == "error"
            and reply.error.code == proto.Error.UNKNOWN_CLIENT
        )

    def last(self, timeout: float) -> proto.Reply | None:
        """Wait for the last answer; None when it has not come after `timeout` (s). Raises as `first` does."""
        self._check_process()
        return self.final() if self._last.wait(timeout) else None

    def final(self) -> proto.Reply:
        """Wait for the last answer, however long. Raises as `first` does."""
        self._check_process()
        self._last.wait()
        return self._checked(self._last_reply)

    def _check_process(self) -> None:
        if os.getpid() != self._pid:
            raise FrankaArmCommException(
                "This was asked for before the program forked, and the answer comes to the process that asked: wait for it there."
            )

    def _checked(self, reply: proto.Reply | None) -> proto.Reply:
        if reply is None:
            raise FrankaArmCommException(self._failure or "")
        raise_error(reply)
        return reply

    # From the channel's thread:

    def answer(self, reply: proto.Reply) -> bool:
        """Take an answer; return whether it is the last."""
        is_last = reply.WhichOneof("answer") not in _PRELIMINARY
        if not self._first.is_set():
            self._first_reply = reply
            self._first.set()
        if is_last:
            self._last_reply = reply
            self._last.set()
        return is_last

    def fail(self, reason: str) -> None:
        """Nothing more will come."""
        self._failure = reason
        self._first.set()
        self._last.set()


class Channel:
    """The socket to one arm's process, and its thread. Ends for good when the server is gone."""

    def __init__(self, endpoint: str, how_it_ended: Callable[[], str], key: ClientKey | None = None) -> None:
        self.endpoint = endpoint
        self._key = key
        self.lost: str | None = None  # why, once it is
        self._ids = itertools.count(1)
        self._outgoing: collections.deque[Call | None] = collections.deque()
        # Of which the last answer has not come. Written down before they are sent, so that a signal handler finds them.
        self._pending: dict[int, Call] = {}
        self._wake_read, self._wake_write = os.pipe()
        os.set_blocking(self._wake_write, False)
        # When nobody has this channel any more, neither its thread nor who writes: their numbers may then be of other files.
        weakref.finalize(self, _close, os.getpid(), self._wake_read, self._wake_write).atexit = False
        self._context = zmq.Context()
        # The thread alone holds how_it_ended, which leads back to the channel's owner.
        self._thread = threading.Thread(target=self._run, args=(how_it_ended,), name=f"frankapy {endpoint}", daemon=True)
        self._thread.start()

    def send(self, request: proto.Request) -> Call:
        """Send a request. Safe in a signal handler."""
        request.request_id = next(self._ids)
        call = Call(request)
        self._pending[request.request_id] = call
        if self.lost is None:
            self._outgoing.append(call)
            self._wake()
        if self.lost is not None:  # also in between: the thread may have ended without having seen it
            self._pending.pop(request.request_id, None)
            call.fail(self.lost)
        return call

    def stop_commands(self, recovering: bool = False) -> None:
        """Ask for a stop of motions and gripper commands that are under way. Safe in a signal handler; waits for nothing.

        `recovering`: that of the arm is waited for; it may be moved back for it.
        """
        under_way = {call.kind: call for call in list(self._pending.values())}
        if recovering or "start_skill" in under_way or "recover" in under_way:
            self.send(proto.Request(stop_skill=proto.StopSkill()))
        if "gripper" in under_way and not under_way["gripper"].request.gripper.HasField("stop"):
            self.send(proto.Request(gripper=proto.GripperCommand(stop=proto.GripperCommand.StopGripper())))

    def close(self) -> None:
        """Say Goodbye, and end."""
        self._outgoing.append(None)
        self._wake()
        self._thread.join(timeout=1.0)

    def _time_on_the_way(self) -> float:
        """How long (s) what the server has not answered yet takes on a slow network; what is asked for later waits behind it."""
        return sum(call.size for call in list(self._pending.values()) if not call.is_answered) / _SLOWEST_NETWORK

    def _wake(self) -> None:
        try:
            os.write(self._wake_write, b"\0")
        except BlockingIOError:  # full: it is awake, or has ended
            pass

    def _run(self, how_it_ended: Callable[[], str]) -> None:
        dealer = self._context.socket(zmq.DEALER)
        dealer.linger = 200  # ms, for Goodbye
        monitor = dealer.get_monitor_socket(zmq.EVENT_DISCONNECTED | zmq.EVENT_HANDSHAKE_FAILED_AUTH)
        if self._key is not None:
            self._key.use_for(dealer)
        dealer.connect(self.endpoint)
        pending = self._pending
        heard = False  # whether this client may have the lease, or wants a recording
        shortest_trip = 0.0  # s; 0: none yet
        unanswered_since: float | None = None
        next_alive = 0.0
        reason = ""
        poller = zmq.Poller()
        poller.register(dealer, zmq.POLLIN)
        poller.register(self._wake_read, zmq.POLLIN)
        poller.register(monitor, zmq.POLLIN)

        def transmit(call: Call) -> None:
            nonlocal unanswered_since
            pending[call.request.request_id] = call  # those of this thread too
            call.sent = time.perf_counter()
            call.request.sent_ns, call.request.way_ns = time.time_ns(), round(shortest_trip * 1e9 / 2)
            message = call.request.SerializeToString()
            call.size = len(message)
            dealer.send(message)
            if unanswered_since is None:
                unanswered_since = time.monotonic()

        while not reason:
            now = time.monotonic()
            wait = max(0.0, next_alive - now) if heard or pending else None
            ready = dict(poller.poll(None if wait is None else int(1000 * wait) + 1))
            if self._wake_read in ready:
                os.read(self._wake_read, 4096)
            while self._outgoing:
                call = self._outgoing.popleft()
                if call is None:
                    dealer.send(proto.Request(request_id=0, goodbye=proto.Goodbye()).SerializeToString())
                    reason = "This connection was closed."
                    break
                heard = heard or is_command(call.request) or call.request.record.on
                transmit(call)
            while dealer.poll(0):
                reply = parse_reply(dealer.recv())
                if reply is None:
                    continue
                unanswered_since = None
                if reply.WhichOneof("answer") == "error" and reply.error.code == proto.Error.UNKNOWN_CLIENT:
                    reason = f"The arm's process does not know this client: {reply.error.message}"
                    self.lost = reason  # before the caller hears of it, who then sends over a new channel
                call = pending.get(reply.request_id)
                if call is not None:
                    trip = time.perf_counter() - call.sent
                    shortest_trip = min(shortest_trip or trip, trip)
                if call is not None and call.answer(reply):
                    pending.pop(reply.request_id, None)
            if monitor in ready and not reason:
                if is_unknown_key(monitor):
                    reason = unknown_key(self.endpoint, self._key)
                    continue
                how = how_it_ended()
                reason = (
                    f"The arm's process at {self.endpoint} {how}; it is started again within 2 s. The server's log may say "
                    f"more."
                    if how
                    else f"The arm's process at {self.endpoint} has ended. Is the server still there? `frankapy status` "
                    f"tells; an arm's process that crashed is started again within 2 s."
                )
            now = time.monotonic()
            if (heard or pending) and now >= next_alive:
                next_alive = now + _ALIVE_PERIOD
                alive = proto.Request(request_id=next(self._ids), alive=proto.Alive())
                transmit(Call(alive))
            if unanswered_since is not None and now - unanswered_since > SILENCE + self._time_on_the_way():
                reason = (
                    f"The arm's process at {self.endpoint} has not answered for {now - unanswered_since:.0f} s: has the server been "
                    f"stopped, or the network been cut? `frankapy status` tells what is there."
                )

        self.lost = reason
        while pending:
            pending.popitem()[1].fail(reason)
        dealer.disable_monitor()
        monitor.close(linger=0)
        dealer.close()
        self._context.term()


def _close(process: int, *files: int) -> None:
    if os.getpid() == process:  # one that was forked may have closed all that it inherited, and opened others
        for file in files:
            os.close(file)
