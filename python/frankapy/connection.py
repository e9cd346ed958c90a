"""The way to an arm: the supervisor tells where its process is, and a client of that finds it again when it is another one."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import getpass
import os
import socket
import sys
import time

import zmq

from frankapy import channel as channels
from frankapy import proto
from frankapy.channel import Call, Channel, is_command, parse_reply, raise_error
from frankapy.client_key import KEY_VARIABLE, ClientKey, find_key, usual_file
from frankapy.exceptions import (
    FrankaArmArgumentError,
    FrankaArmBusyException,
    FrankaArmCommException,
    FrankaArmException,
    FrankaArmFrankaInterfaceNotReadyException,
)
from frankapy.fork import Lock
from frankapy.franka_constants import FrankaConstants as FC
from frankapy.recovery import WAITS_FOR_PEOPLE
from frankapy.validation import whole

SERVER_VARIABLE = "FRANKA_INTERFACE_SERVER"
DEFAULT_PORT = 5757
DEFAULT_SERVER = f"127.0.0.1:{DEFAULT_PORT}"


_ASK_AGAIN = 0.5  # s
_START_TIME = 10.0  # s that an arm's process may need to be ready
_CLOCK_QUESTIONS = 10
_CLOCK_TIME = 10.0  # s that what was found of the clocks holds: they drift, and are set
_FAILURES = 3  # handshakes in a row after which it is believed that they fail
_ROUND_TRIPS = 5
# What a ZMTP 3 peer says first, and how long that is with what follows: mechanism (20 bytes), whether it is the server, filler.
# A server that hears of another mechanism than its own hangs up before it has named that.
_SIGNATURE_AND_VERSION = b"\xff" + bytes(8) + b"\x7f\x03\x00"
_GREETING_SIZE = 64  # bytes
_NO_ANSWER = (
    "Something listens at {} but does not answer as franka-interface does: is it another program, or another version of it?"
)
_LEASE_TICK = 0.05  # s
_LEASE_TIME = 1.0  # s after which the lease of a client that was killed has fallen free
_END_TIME = 1.0  # s that the supervisor may need to say how an arm's process ended, or to be there again
_SHORT = 16 << 10  # bytes of a request that a server reads at once (kShort of src/server/inbox.cpp)
_MAX_REQUEST = 8 << 20  # bytes; a longer one would end its connection (kMaxMessage of src/server/transport.cpp)

# Requests that take a server a while: of one client it takes one at a time.
_ONE_AT_A_TIME = ("start_skill", "change_skill", "check_skill", "change_walls")
# Requests that may come twice: where the arm's process ended before its answer, its successor is asked.
_REPEATABLE = ("get_state", "get_server_status", "list_topics", "skill_status", "stop_skill")


def server_address(server: str | None = None) -> tuple[str, int]:
    """Return host and port of the supervisor: of the argument, else of $FRANKA_INTERFACE_SERVER, else the default."""
    if server is not None and not isinstance(server, str):
        raise FrankaArmArgumentError(f"server is {server!r}: expected host or host:port, as in {DEFAULT_SERVER!r}")
    name = "server" if server else f"${SERVER_VARIABLE}"
    text = server or os.environ.get(SERVER_VARIABLE) or DEFAULT_SERVER
    host, colon, port = text.removeprefix("tcp://").rpartition(":")
    if not colon:
        host, port = port, str(DEFAULT_PORT)
    if not _is_host(host) or not port.isdecimal() or not 0 < int(port) < 65536:
        raise FrankaArmArgumentError(f"{name} is {text!r}: expected host or host:port, as in {DEFAULT_SERVER!r}")
    return host, int(port)


def _is_host(name: str) -> bool:
    try:
        name.encode("idna")  # as sockets do with it
    except UnicodeError:  # an empty part, or one of more than 63 letters
        return False
    return name != ""


@dataclasses.dataclass(frozen=True)
class Server:
    """A server, and the key with which one connects to it (None: it has no keys)."""

    host: str
    port: int
    key: ClientKey | None

    @property
    def address(self) -> str:
        """Return host:port."""
        return f"{self.host}:{self.port}"

    def connect(self, socket: zmq.Socket[bytes]) -> None:
        """Connect a socket to the supervisor."""
        if self.key is not None:
            self.key.use_for(socket)
        socket.connect(f"tcp://{self.address}")


def find_server(server: str | None = None, key: str | os.PathLike[str] | None = None) -> Server:
    """Look for a server, and find the key for it: of that file, else of $FRANKAPY_KEY, else of the usual one.

    Raises FrankaArmCommException when nobody listens there, or where only one of both has a key. A key that was not named for this
    server is left out on this computer, where a server has none: a simulated arm beside the arms of a lab.
    """
    host, port = server_address(server)
    own = find_key(key)
    mechanism = _mechanism(host, port)
    if mechanism == "CURVE" and own is None:
        raise FrankaArmCommException(
            f"The server at {host}:{port} takes only clients with a key, and there is none here: whoever runs it makes one (`frankapy keys "
            f"add`). Then FrankaArm(key=FILE), {KEY_VARIABLE}=FILE, or the file as {usual_file()}."
        )
    if mechanism == "NULL" and own is not None:
        if own.named or not _is_this_computer(host):
            raise FrankaArmCommException(
                f"The server at {host}:{port} has no keys, and {own} is for one that has: is it the right server? Nothing was sent to it."
            )
        own = None
    return Server(host, port, own)


def _mechanism(host: str, port: int) -> str:
    """Return how a server lets clients in, "CURVE" or "NULL": it says so in the greeting of its protocol (ZMTP 3)."""
    deadline = time.monotonic() + channels.SILENCE
    while (rest := deadline - time.monotonic()) > 0:  # one that was about to end may have closed the connection
        greeting = b""
        try:
            # ZeroMQ would try for ever; a refusal is known at once.
            probe = socket.create_connection((host, port), timeout=rest)
        except OSError as error:
            reason = error.strerror or "timed out"
            raise FrankaArmCommException(
                f"No server at {host}:{port} ({reason}). `frankapy sim` starts one with a simulated arm, "
                f"`franka-interface --robot ADDRESS` one for a real arm; where it runs elsewhere, name it: "
                f"FrankaArm(server='host:port') or {SERVER_VARIABLE}=host:port."
            ) from None
        with probe, contextlib.suppress(OSError):
            probe.sendall(_SIGNATURE_AND_VERSION)
            while len(greeting) < _GREETING_SIZE and (more := probe.recv(_GREETING_SIZE - len(greeting))):
                greeting += more
        if len(greeting) == _GREETING_SIZE:
            return greeting[12:32].rstrip(b"\0").decode("ascii", "replace")
        time.sleep(0.02)
    raise FrankaArmCommException(_NO_ANSWER.format(f"{host}:{port}"))


def _is_this_computer(host: str) -> bool:
    return host == "localhost" or host.startswith("127.")


def arms_of(server: Server) -> proto.Arms:
    """Ask the supervisor for its arms, in the order of robot_num; endpoints are as seen from here.

    Raises FrankaArmCommException when it does not answer, does not know the key, has another one, or speaks another version.
    """
    context = zmq.Context()
    dealer = context.socket(zmq.DEALER)
    try:
        dealer.linger = 0
        monitor = dealer.get_monitor_socket(channels.HANDSHAKE_FAILURES)
        server.connect(dealer)
        deadline = time.monotonic() + channels.SILENCE
        failures = 0
        answered = False
        while not answered and failures < _FAILURES and time.monotonic() < deadline:  # a server that was about to end may have taken a question with it
            dealer.send(proto.Request(request_id=1, list_arms=proto.ListArms()).SerializeToString())
            again = time.monotonic() + _ASK_AGAIN
            while not answered and failures < _FAILURES and (rest := again - time.monotonic()) > 0:
                ready = zmq.select([dealer, monitor], [], [], rest)[0]
                answered = dealer in ready
                if not answered and monitor in ready:
                    failures += 1
                    if channels.is_unknown_key(monitor):
                        raise FrankaArmCommException(channels.unknown_key(server.address, server.key))
            if not answered:
                _mechanism(server.host, server.port)  # which knows at once where nobody listens any more
        if failures and not answered and server.key is not None:
            raise FrankaArmCommException(
                f"The server at {server.address} is not the one that {server.key} is for: were its keys made anew (then this client needs a "
                f"new one), or is it another server?"
            )
        if not answered:
            raise FrankaArmCommException(_NO_ANSWER.format(server.address))
        reply = parse_reply(dealer.recv())
    finally:
        dealer.disable_monitor()
        context.destroy(linger=0)
    if reply is None or reply.WhichOneof("answer") not in ("arms", "error"):
        raise FrankaArmCommException(f"What answers at {server.address} is no franka-interface.")
    raise_error(reply)
    check_version(reply.arms.version, server.address)
    for arm in reply.arms.arms:
        arm.endpoint = reachable(arm.endpoint, server.host)
        arm.state_endpoint = reachable(arm.state_endpoint, server.host)
        arm.sensor_endpoint = reachable(arm.sensor_endpoint, server.host)
    return reply.arms


def list_arms(server: str | None = None, key: str | os.PathLike[str] | None = None) -> list[proto.Arms.Arm]:
    """Find a server and return its arms; raises as `find_server` and `arms_of`."""
    return list(arms_of(find_server(server, key)).arms)


def find_arm(server: Server, robot_num: int) -> proto.Arms.Arm:
    """Return the arm of that number, from 1; raises as `arms_of`, FrankaArmArgumentError when there is none."""
    robot_num = whole("robot_num", robot_num)
    arms = arms_of(server).arms
    if not 1 <= robot_num <= len(arms):
        there = ", ".join(f"{i} ({arm.name})" for i, arm in enumerate(arms, 1)) or "none"
        raise FrankaArmArgumentError(f"robot_num is {robot_num}: the arms of the server are {there}")
    return arms[robot_num - 1]


def way_to(server: Server) -> float:
    """Return how long (s) a message to a server takes at least: half of the shortest round trip; 0 where none was made."""
    question = proto.Request(request_id=1, list_arms=proto.ListArms()).SerializeToString()
    trips = []
    with zmq.Context() as context, context.socket(zmq.DEALER) as dealer:
        dealer.linger = 0
        server.connect(dealer)
        for _ in range(_ROUND_TRIPS):
            begin = time.perf_counter()
            dealer.send(question)
            if not dealer.poll(int(1000 * _ASK_AGAIN)):
                break
            dealer.recv()
            trips.append(time.perf_counter() - begin)
    return min(trips, default=0.0) / 2


def check_version(theirs: int, where: str) -> None:
    """Raise FrankaArmCommException when a server speaks another version than this package."""
    if theirs != proto.CURRENT:
        raise FrankaArmCommException(
            f"The server at {where} speaks version {theirs}, this frankapy version {proto.CURRENT}: install the same "
            f"version of both."
        )


def reachable(endpoint: str, host: str) -> str:
    """Return a server's endpoint as seen from here: 0.0.0.0 stands for the host under which it was reached."""
    return endpoint.replace("://0.0.0.0:", f"://{host}:").replace("://*:", f"://{host}:")


class Connection:
    """One client of one arm.

    Finds the arm's process through the supervisor, and again after it was restarted or after a fork.
    """

    def __init__(self, server: str | None = None, robot_num: int = 1, key: str | os.PathLike[str] | None = None) -> None:
        """Connect, with the key of that file (None: as `find_server`), and say Hello.

        Raises FrankaArmCommException: nobody there, no such arm, not ready within 10 s, another version, a wrong key.
        """
        self._server = server
        self._key_file = key
        self.key: ClientKey | None = None
        self._robot_num = robot_num
        self._lock = Lock()  # of opening
        self._building = Lock()  # from what the server takes one at a time to its first answer
        self._closed = False
        self.recordings = 0  # that are asked for
        self._has_commanded = False
        self._recovering = False  # whether it waits for the arm to recover
        self._clock: tuple[float, tuple[float, float]] | None = None  # when the clocks were compared, and what came of it
        self._pid = os.getpid()
        self.welcome = proto.Welcome()
        self._channel = self._open()

    def send(self, request: proto.Request) -> Call:
        """Send a request, over a new connection where the old one is gone.

        Raises FrankaArmArgumentError for one that is too long for the server.
        """
        if (size := request.ByteSize()) > _MAX_REQUEST:
            raise FrankaArmArgumentError(f"{request.WhichOneof('call')} has {size} bytes: expected at most {_MAX_REQUEST}")
        return self._open_channel().send(request)

    def current_welcome(self) -> proto.Welcome:
        """Return what the arm's process said when it was met, after meeting it again where the connection was lost."""
        self._open_channel()
        return self.welcome

    def _open_channel(self) -> Channel:
        channel = self._channel
        if self._closed:
            raise FrankaArmCommException("This FrankaArm was closed; make a new one.")
        if channel.lost is not None or self._pid != os.getpid():
            with self._lock:
                if self._channel is channel:
                    self._channel = self._open()
                    self._pid = os.getpid()
                channel = self._channel
        return channel

    def start(self, request: proto.Request) -> Call:
        """Send a request and wait for its first answer.

        Sent once more when the arm's process does not know this client, and what may come twice when that process has ended. A
        first command is sent again for a second while another client has the arm: one that was killed has it for a moment still.
        Threads whose requests the server takes one at a time wait for each other, at most until that first answer.

        Raises what an error stands for, FrankaArmCommException when the arm's process is gone.
        """
        deadline = time.monotonic() + _LEASE_TIME
        while True:
            try:
                call = self._start(request)
            except FrankaArmBusyException:
                if self._has_commanded or time.monotonic() > deadline:
                    raise
                time.sleep(_LEASE_TICK)
            else:
                self._has_commanded |= is_command(request)
                return call

    def _start(self, request: proto.Request) -> Call:
        call = request.WhichOneof("call")
        reads_walls = call == "change_walls" and not is_command(request)
        if (call in _ONE_AT_A_TIME and not reads_walls) or request.ByteSize() > _SHORT:
            with self._building:
                return self._answered(request)
        return self._answered(request)

    def _answered(self, request: proto.Request) -> Call:
        call = self.send(request)
        try:
            call.first()
        except FrankaArmCommException:
            # Nothing else is sent twice: a motion might be made twice.
            if not (call.was_unknown or (call.was_lost and call.kind in _REPEATABLE)):
                raise
            call = self._send_to_the_next(request)
            call.first()
        return call

    def _send_to_the_next(self, request: proto.Request) -> Call:
        # Between two servers there may be a moment without any.
        deadline = time.monotonic() + _END_TIME
        while True:
            try:
                return self.send(request)
            except FrankaArmCommException:
                if self._closed or time.monotonic() > deadline:
                    raise
            time.sleep(0.05)

    def ask(self, request: proto.Request) -> proto.Reply:
        """Return the first answer to a request; see `start`."""
        return self.start(request).first()

    def state(self) -> proto.ArmState:
        """Return the newest state that the arm's process knows."""
        return self.ask(proto.Request(get_state=proto.GetState())).state

    def recover(self, under: proto.RecoveryPolicy | None = None) -> proto.Recovery:
        """Ask for recovery from an error or a user stop; of a program `under` says how far it may go without a person."""
        return self.ask(proto.Request(recover=proto.Recover(under=under))).recovery

    def wait_until_ready(self, timeout: float | None = None, under: proto.RecoveryPolicy | None = None) -> None:
        """Wait until the arm can move; one in error recovers under this policy, or (None) is taken as it is.

        Raises FrankaArmFrankaInterfaceNotReadyException when a person has to look first, FrankaArmCommException when the arm cannot
        move after `timeout` (s; None: DEFAULT_FRANKA_INTERFACE_TIMEOUT of FrankaConstants), with the reason.
        """
        timeout = FC.DEFAULT_FRANKA_INTERFACE_TIMEOUT if timeout is None else timeout
        self._recovering = under is not None
        try:
            self._wait_until_ready(timeout, under)
        finally:
            self._recovering = False

    def _wait_until_ready(self, timeout: float, under: proto.RecoveryPolicy | None) -> None:
        deadline = time.monotonic() + timeout
        while True:
            try:
                phase = self.state().phase
                reason = f"its phase is {proto.Phase.Name(phase)}"
                if phase == proto.ERROR and under is not None:
                    recovery = self.recover(under)
                    if recovery.recovered:
                        return
                    reason = channels.advised(recovery.message)
                    if recovery.who != proto.RecoveryPolicy.ITSELF or recovery.obstacle not in WAITS_FOR_PEOPLE:
                        raise FrankaArmFrankaInterfaceNotReadyException(f"The arm is not ready: {reason}", recovery=recovery)
                elif phase != proto.CONNECTING and not (phase == proto.RECOVERING and under is not None):
                    return
            except FrankaArmFrankaInterfaceNotReadyException as error:
                if error.recovery is not None:
                    raise
                reason = error.message
            except FrankaArmCommException as error:  # a server that is started again
                if self._closed or time.monotonic() > deadline:
                    raise
                reason = error.message
            if time.monotonic() > deadline:
                raise FrankaArmCommException(f"The arm is not ready after {timeout:g} s: {reason}")
            time.sleep(0.01)

    def stop_commands(self) -> None:
        """Ask for a stop of what this client has under way, arm and hand. Safe in a signal handler; waits for nothing."""
        if not self._closed and self._pid == os.getpid():
            self._channel.stop_commands(self._recovering)

    @property
    def clock_difference(self) -> tuple[float, float]:
        """What the clock of the server's computer is before that of this one, and how uncertain that is, s; as it was 10 s ago at most.

        The answer whose way was the shortest tells: it was given at some time between request and arrival.
        """
        if self._clock is None or time.monotonic() > self._clock[0] + _CLOCK_TIME:
            self._clock = time.monotonic(), self._compare_clocks()
        return self._clock[1]

    def _compare_clocks(self) -> tuple[float, float]:
        estimates = []
        for _ in range(_CLOCK_QUESTIONS):
            sent = time.time()
            state = self.state()
            back = time.time()
            theirs = state.time_ns * 1e-9 + state.age
            estimates.append(((back - sent) / 2, theirs - (sent + back) / 2))
        uncertain, difference = min(estimates)
        return difference, uncertain

    def close(self) -> None:
        """Say Goodbye, which frees the arm for others."""
        if not self._closed and self._pid == os.getpid():
            self._closed = True
            self._channel.close()

    def _open(self) -> Channel:
        deadline = time.monotonic() + _START_TIME
        while True:
            server = find_server(self._server, self._key_file)
            self.key = server.key
            arm = find_arm(server, self._robot_num)
            reason = arm.status or "it is starting"
            if arm.endpoint:
                channel = Channel(arm.endpoint, functools.partial(self._how_it_ended, arm.starts), self.key)
                try:
                    self.welcome = self._hello(channel)
                    return channel
                except FrankaArmFrankaInterfaceNotReadyException as error:
                    channel.close()
                    reason = error.message
                except BaseException:
                    channel.close()
                    raise
            if time.monotonic() > deadline:
                raise FrankaArmCommException(
                    f"The arm {arm.name} ({arm.address}) is not ready after {_START_TIME:.0f} s: {reason}"
                )
            time.sleep(0.1)

    def _how_it_ended(self, starts: int) -> str:
        """Ask the supervisor how the arm's process that was started for the `starts`-th time ended; empty: nobody knows."""
        deadline = time.monotonic() + _END_TIME
        while time.monotonic() < deadline:
            try:
                arm = find_arm(find_server(self._server, self._key_file), self._robot_num)
            except FrankaArmException:
                break
            if arm.starts != starts or not arm.endpoint:
                return arm.ended
            time.sleep(0.02)
        return ""

    @staticmethod
    def _hello(channel: Channel) -> proto.Welcome:
        hello = proto.Hello(version=proto.CURRENT, client=_name_of_this_client())
        welcome = channel.send(proto.Request(hello=hello)).first().welcome
        check_version(welcome.version, channel.endpoint)
        host = channel.endpoint.removeprefix("tcp://").rpartition(":")[0]
        welcome.state_endpoint = reachable(welcome.state_endpoint, host)
        return welcome


class Connected:
    """Something of a client that commands over a connection; offline there is none."""

    _connection: Connection | None

    @property
    def _server(self) -> Connection:
        if self._connection is None:
            raise FrankaArmException("This needs a server, and this FrankaArm is offline.")
        return self._connection


def _name_of_this_client() -> str:
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # a user id without a name, as in containers
        user = str(os.getuid())
    program = os.path.basename(sys.argv[0]) if sys.argv and sys.argv[0] else "python"
    return f"{user}@{socket.gethostname()} {program} (pid {os.getpid()})"
