"""Topics: sensor messages to the arms, their states and those of their hands from them; all others within this program."""

from __future__ import annotations

import collections
import re
import threading
import time
from collections.abc import Callable
from typing import Any

from frankapy import proto
from frankapy.connection import Connection
from frankapy.exceptions import FrankaArmCommException, FrankaArmException
from frankapy.franka_constants import FrankaConstants
from frankapy.proto_utils import messages_of
from frankapy.ros_messages import Header, JointState, RobotState
from frankapy.sensors import SensorPublisher
from frankapy.states import StateStream

from .node import ROSException, is_shutdown, logerr, logwarn
from .rostime import Duration, Time

_SENSOR = re.compile(r"/franka_ros_interface(?:_(\d+))?/sensor")
_ROBOT_STATE = re.compile(r"/robot_state_publisher_node_(\d+)/robot_state")
_JOINT_STATES = re.compile(r"/franka_gripper_(\d+)/joint_states")
_RATE = 100  # Hz, of states
_AGAIN = 1.0  # s without states, after which the server is looked for again

_subscribers: dict[str, list[Subscriber]] = collections.defaultdict(list)
_latched: dict[str, tuple[Publisher, Any]] = {}  # the last message of those who let it wait for who subscribes later


def _full(name: str) -> str:
    return "/" + name.lstrip("/~")


class Publisher:
    """Sends messages over a topic."""

    def __init__(self, name: str, data_class: type, queue_size: int | None = None, latch: bool = False, **_: Any) -> None:
        """Begin; a sensor topic looks for its arm. Raises ROSException when there is none.

        With `latch` the last message is given to subscribers of this program that come later; an arm has what was sent.
        """
        self.name, self.resolved_name, self.data_class = name, _full(name), data_class
        self._lock, self._latch = threading.Lock(), latch
        self._arm: SensorPublisher | None = None
        if (match := _SENSOR.fullmatch(self.resolved_name)) is not None:
            try:
                self._arm = SensorPublisher(FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC, int(match[1] or 1))
            except FrankaArmException as error:
                raise ROSException(str(error)) from error

    def publish(self, *arguments: Any, **keywords: Any) -> None:
        """Send a message, or what makes one."""
        whole = len(arguments) == 1 and not keywords and isinstance(arguments[0], self.data_class)
        message = arguments[0] if whole else self.data_class(*arguments, **keywords)
        if self._arm is not None:
            with self._lock:
                for sensor_message in messages_of(message):
                    self._arm.publish(sensor_message)
        if self._latch:
            _latched[self.resolved_name] = self, message
        for subscriber in list(_subscribers[self.resolved_name]):
            subscriber.take(message)

    def get_num_connections(self) -> int:
        """Return how many listen: the arm, and subscribers of this program."""
        return (self._arm is not None) + len(_subscribers[self.resolved_name])

    def unregister(self) -> None:
        """Send what is left, and end; what waits for later subscribers goes."""
        if _latched.get(self.resolved_name, (None,))[0] is self:
            del _latched[self.resolved_name]
        if self._arm is not None:
            self._arm.close()


class Subscriber:
    """Calls a function with each message of a topic, in a thread of its own."""

    def __init__(
        self, name: str, data_class: type, callback: Callable[..., Any] | None = None, callback_args: Any = None,
        queue_size: int | None = None, **_: Any
    ) -> None:  # fmt: skip
        """Begin to listen. Raises ROSException where the topic is an arm's, and there is none."""
        self.name, self.resolved_name, self.data_class = name, _full(name), data_class
        self._callback = callback
        self._extra = () if callback_args is None else (callback_args,)
        self._ended = threading.Event()
        self._messages: collections.deque[Any] = collections.deque(maxlen=queue_size)
        self._there = threading.Event()
        states = _states_of(self.resolved_name)
        if states is None:
            _subscribers[self.resolved_name].append(self)
            if self.resolved_name in _latched:
                self.take(_latched[self.resolved_name][1])
            if not name.startswith(("/franka", "franka")):
                logwarn("%s: there is no ROS here, so that only this program's own messages arrive", self.resolved_name)
            self._thread = threading.Thread(target=self._call, daemon=True)
        else:
            self._thread = threading.Thread(target=self._listen, args=states, daemon=True)
        self._thread.start()

    def take(self, message: Any) -> None:
        """Receive a message of this program's own."""
        self._messages.append(message)
        self._there.set()

    def unregister(self) -> None:
        """Listen no more."""
        self._ended.set()
        if self in _subscribers[self.resolved_name]:
            _subscribers[self.resolved_name].remove(self)

    def _is_over(self) -> bool:
        return self._ended.is_set() or is_shutdown()

    def _call(self) -> None:
        while not self._is_over():
            self._there.wait(0.1)
            self._there.clear()
            while self._messages:
                self._deliver(self._messages.popleft())

    def _listen(self, connection: Connection, convert: Callable[[proto.ArmState], Any]) -> None:
        while not self._is_over():
            try:
                # A server that was started again may have other ports.
                endpoint = connection.current_welcome().state_endpoint
                with StateStream(endpoint, _AGAIN, _RATE, key=connection.key) as states:
                    states._close.atexit = False  # the program's end would close it under this thread
                    for state in states:
                        if self._is_over():
                            break
                        self._deliver(convert(state))
            except FrankaArmCommException:
                self._ended.wait(_AGAIN)
        connection.close()

    def _deliver(self, message: Any) -> None:
        try:
            if self._callback is not None:
                self._callback(message, *self._extra)
        except Exception as error:  # as rospy does: a callback that fails ends nothing
            logerr("bad callback: %s\n%s: %s", self._callback, type(error).__name__, error)


def wait_for_message(topic: str, topic_type: type, timeout: float | Duration | None = None) -> Any:
    """Return the next message of a topic. Raises ROSException when none comes within `timeout` (s)."""
    seconds = timeout.to_sec() if isinstance(timeout, Duration) else timeout
    got: list[Any] = []
    came = threading.Event()

    def take(message: Any) -> None:
        got.append(message)
        came.set()

    subscriber = Subscriber(topic, topic_type, take)
    try:
        deadline = None if seconds is None else time.monotonic() + seconds
        while not came.wait(0.01 if deadline is None else max(0.0, min(0.01, deadline - time.monotonic()))):
            if is_shutdown():
                raise ROSException("rospy shutdown")
            if deadline is not None and time.monotonic() > deadline:
                raise ROSException(f"timeout exceeded while waiting for message on topic {_full(topic)}")
    finally:
        subscriber.unregister()
    return got[0]


def _states_of(name: str) -> tuple[Connection, Callable[[proto.ArmState], Any]] | None:
    """Return the connection to an arm, and what makes messages of its states, of a topic that stands for these; None for any other.

    Raises ROSException when there is no such arm.
    """
    for pattern, convert in ((_ROBOT_STATE, _robot_state), (_JOINT_STATES, _fingers)):
        if (match := pattern.fullmatch(name)) is not None:
            try:
                return Connection(None, int(match[1])), convert
            except FrankaArmException as error:
                raise ROSException(str(error)) from error
    return None


def _robot_state(state: proto.ArmState) -> RobotState:
    return RobotState(state, Time(0, state.time_ns))


def _fingers(state: proto.ArmState) -> JointState:
    names = FrankaConstants.JOINT_NAMES[7:]
    return JointState(Header(state.robot.message_id, Time(0, state.time_ns)), names, [state.gripper.width / 2] * 2, [0.0] * 2, [0.0] * 2)
