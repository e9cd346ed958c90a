"""The states of an arm as its server publishes them, one for each cycle of 1 ms."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Any

import numpy as np
import zmq
from google.protobuf.field_mask_pb2 import FieldMask

from frankapy import kinematics, proto
from frankapy.client_key import ClientKey
from frankapy.connection import Connection
from frankapy.exceptions import FrankaArmArgumentError, FrankaArmCommException
from frankapy.sockets import owned_socket
from frankapy.utils import franka_pose_to_rigid_transform

_RATE = 1000  # Hz, of the arm
_ALL = b"1\0"  # the subscription to all of every state
_NEW = 0.003  # s, of a published state that counts as now
_PATIENCE = 5.0  # s without a state, after which none is waited for
_LEAST_PATIENCE = 1.0  # s: a computer that stands still for less is no server that has gone
_BEGIN = 2.0  # s, to wait at most for the first of the states that are asked for
_SOON = 0.05  # s, between reads for which states are listened to
_CARTESIAN_MODES = (3, 4)  # of RobotState.motion_generator_mode: pose and velocity


class NewestState:
    """The newest state of an arm, at hand without a question to its server: ZeroMQ's own thread keeps it."""

    def __init__(self, endpoint: str, key: ClientKey | None = None) -> None:
        """Subscribe at `endpoint` (Welcome.state_endpoint) of a server that has keys, or None."""
        self._lock = threading.Lock()
        self._state: bytes | None = None
        self._came = -math.inf  # by time.monotonic(), when it was read first
        self._socket, self._close = owned_socket(self, zmq.SUB)
        self._socket.conflate = True
        self._socket.subscribe(_ALL)
        if key is not None:
            key.use_for(self._socket)
        self._socket.connect(endpoint)

    def read(self) -> proto.ArmState | None:
        """Return it, each time as a message of its own; None before the first has come, after the end, and where no more come."""
        with self._lock:
            if not self._close.alive:
                return None
            try:
                self._state = self._socket.recv(zmq.NOBLOCK)[len(_ALL) :]
                self._came = time.monotonic()
            except zmq.Again:
                if time.monotonic() - self._came > _NEW:  # there is one for each cycle, whatever clocks say
                    return None
            return None if self._state is None else proto.ArmState.FromString(self._state)

    def close(self) -> None:
        """End the subscription."""
        with self._lock:
            self._close()


class StateStream:
    """Iterates over the states of an arm from now on; each is a proto.ArmState.

    For a reader that is slower than the arm they wait, 10 s long and more; then those are lost that come while that many wait.
    Use it with `with`, or close it.
    """

    def __init__(
        self, endpoint: str, timeout: float = _PATIENCE, rate: float = 1000, fields: Sequence[str] = (), key: ClientKey | None = None
    ) -> None:
        """Subscribe at `endpoint` (Welcome.state_endpoint), with the key of the connection.

        Iteration ends after `timeout` (s) without a state, or where that is longer two of them at that rate. `rate` (1/s) is
        1000, or that divided by a whole number; `fields` are those that are sent ("robot.q", "phase"), none: all. Raises
        FrankaArmArgumentError for others.
        """
        every = round(_RATE / rate) if 0 < rate <= _RATE else 0
        if every == 0 or abs(_RATE / every - rate) > 1e-3 * rate:
            raise FrankaArmArgumentError(f"rate is {rate:g} Hz: expected {_RATE}, or that divided by a whole number")
        if isinstance(fields, str):
            raise FrankaArmArgumentError(f"fields is {fields!r}: expected a list of them, such as ['robot.q', 'phase']")
        mask = FieldMask(paths=[str(field) for field in fields])
        for field in mask.paths:
            if not FieldMask(paths=[field]).IsValidForDescriptor(proto.ArmState.DESCRIPTOR):  # type: ignore[arg-type]
                raise FrankaArmArgumentError(f"fields has {field!r}: expected fields of ArmState, such as 'robot.q' or 'phase'")
        topic = str(every) + (f" {','.join(mask.paths)}" if fields else "")
        self._topic = topic.encode() + b"\0"
        self._socket, self._close = owned_socket(self, zmq.SUB)
        self._socket.rcvhwm = 10_000
        self._socket.rcvtimeo = int(1000 * max(timeout, 2 / rate))
        self._pid = os.getpid()
        self._socket.subscribe(self._topic)
        if key is not None:
            key.use_for(self._socket)
        self._socket.connect(endpoint)
        self._socket.poll(int(1000 * min(timeout, _BEGIN)))  # from now on: what is done next is seen

    def __iter__(self) -> Iterator[proto.ArmState]:
        while (state := self.receive()) is not None:
            yield state

    def receive(self) -> proto.ArmState | None:
        """Wait for the next state; None when there is none within the timeout."""
        if os.getpid() != self._pid:
            raise FrankaArmCommException("These states come to the process that has asked for them: ask again in the one that was forked.")
        try:
            return proto.ArmState.FromString(self._socket.recv()[len(self._topic) :])
        except zmq.Again:
            return None
        except zmq.ZMQError as error:
            raise FrankaArmCommException(f"No state: {error}. Were these states closed?") from None

    def close(self) -> None:
        """End the subscription."""
        self._close()

    def __enter__(self) -> StateStream:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class StateReader:
    """Reads the newest state: of the server, or where reads follow each other within 50 ms of what it publishes."""

    def __init__(self, server: Connection | None) -> None:
        """Read over `server`; None: states of nothing but zeros."""
        self._server = server
        self._newest: tuple[int, str, NewestState] | None = None  # of this process, at this endpoint
        self._read_time = -math.inf  # of the last read

    def read(self, after_ns: int) -> proto.ArmState:
        """Return the newest state, with its age (s); it is not older than one that reached the server at `after_ns`."""
        if self._server is None:
            return _zeros()
        before, self._read_time = self._read_time, time.monotonic()
        if self._read_time - before > _SOON:
            self.stop_listening()
        elif (state := self._listen(self._server, after_ns)) is not None:
            return state
        return self._server.state()

    def _listen(self, server: Connection, after_ns: int) -> proto.ArmState | None:
        """Return the newest published state if it is new enough; the first call subscribes."""
        endpoint = server.welcome.state_endpoint
        if not endpoint:
            return None
        newest = self._newest
        if newest is None or newest[:2] != (os.getpid(), endpoint):
            self.stop_listening()
            self._newest = (os.getpid(), endpoint, NewestState(endpoint, server.key))
            return None
        state = newest[2].read()
        if state is None:
            return None
        # Clocks are never quite the same.
        state.age = max(0.0, time.time() + server.clock_difference[0] - state.time_ns * 1e-9)
        return state if state.age <= _NEW and state.time_ns >= after_ns else None

    def stop_listening(self) -> None:
        """Listen to published states no longer: each costs the server, the network and this computer something."""
        newest, self._newest = self._newest, None
        if newest is not None and newest[0] == os.getpid():
            newest[2].close()


def _zeros() -> proto.ArmState:
    zeros, identity = [0.0] * 7, np.eye(4).flatten()
    robot = proto.RobotState(
        O_T_EE=identity, O_T_EE_d=identity, F_T_EE=identity, q=zeros, q_d=zeros, dq=zeros, tau_J=zeros, dtau_J=zeros,
        O_F_ext_hat_K=zeros[:6], O_dP_EE_c=zeros[:6],
    )  # fmt: skip
    return proto.ArmState(robot=robot, gripper=proto.GripperState(width=0, is_grasped=False))


def wait_for(
    endpoint: str, condition: Callable[[proto.ArmState], bool], timeout: float | None, key: ClientKey | None = None
) -> proto.ArmState:
    """Return the first state published at `endpoint` that fulfils a condition.

    Raises FrankaArmCommException when none does within `timeout` (s; None: any time), or when no states come.
    """
    if not callable(condition):
        raise FrankaArmArgumentError(f"condition is {condition!r}: expected a function of a state that returns True or False")
    deadline = math.inf if timeout is None else time.monotonic() + timeout
    patience = _PATIENCE if timeout is None else min(_PATIENCE, max(timeout, _LEAST_PATIENCE))
    with StateStream(endpoint, patience, key=key) as states:
        for state in states:
            if condition(state):
                return state
            if time.monotonic() > deadline:
                raise FrankaArmCommException(f"In {timeout:g} s no state fulfilled the condition.")
    raise FrankaArmCommException(f"No states have come for {patience:g} s: `frankapy status` tells why.")


class RobotState(dict[str, Any]):
    """A state as the dictionary of the published interface; see FrankaArm.get_robot_state.

    age: how long ago the server had it from the robot when it was read, s.
    """

    age: float


def as_dictionary(state: proto.ArmState) -> RobotState:
    """Return a state as the dictionary of the published interface; see FrankaArm.get_robot_state."""
    robot = state.robot
    has_hand = state.HasField("gripper")
    if robot.motion_generator_mode in _CARTESIAN_MODES:
        twist = np.array(robot.O_dP_EE_c)
    else:  # the robot is commanded none
        twist = kinematics.jacobian(np.array(robot.q), np.reshape(robot.F_T_EE, (4, 4)).T) @ np.array(robot.dq)
    values: dict[str, Any] = {
        "cartesian_velocities": twist,
        "pose": franka_pose_to_rigid_transform(robot.O_T_EE),
        "pose_desired": franka_pose_to_rigid_transform(robot.O_T_EE_d),
        "joint_torques": np.array(robot.tau_J),
        "joint_torques_derivative": np.array(robot.dtau_J),
        "joints": np.array(robot.q),
        "joints_desired": np.array(robot.q_d),
        "joint_velocities": np.array(robot.dq),
        "gripper_width": state.gripper.width if has_hand else math.nan,
        "gripper_is_grasped": state.gripper.is_grasped if has_hand else False,
        "ee_force_torque": np.array(robot.O_F_ext_hat_K),
    }
    dictionary = RobotState(values)
    dictionary.age = state.age
    return dictionary
