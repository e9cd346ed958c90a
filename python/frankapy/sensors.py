"""Sensor messages into running skills, from any process."""

from __future__ import annotations

import itertools
import os
import secrets
import time
import weakref
from types import TracebackType

import zmq
from google.protobuf.message import Message

from frankapy import proto
from frankapy.connection import find_arm, find_server, way_to
from frankapy.exceptions import FrankaArmArgumentError, FrankaArmCommException
from frankapy.sockets import owned_socket
from frankapy.validation import text, validate

_MAX_MESSAGE = (1 << 16) - 64  # bytes; a longer one would end its connection (kMaxSensorMessage of src/server/sensor_hub.cpp; less for encryption)
_LINGER = 1000  # ms that an ending script waits for what it has just published


class SensorPublisher:
    """Sends messages over a topic into the skills of an arm that listen to it.

    It needs no FrankaArm, and does not disturb the one that commands the arm. What is published is sent at once, waits while
    the server is being reached, and is sent still when the script ends right afterwards. It finds a server again that was started
    anew, and goes on in a process that was forked. It serves one thread.

    Example:
        >>> fa.run(StreamJoint("policy"), JointImpedance(), Time(10), block=False)
        >>> with SensorPublisher("policy") as publisher:
        ...     publisher.publish(proto.JointPositionSensorMessage(joints=q))
    """

    _socket: zmq.Socket[bytes]
    _close: weakref.finalize[..., object]
    _monitor: zmq.Socket[bytes]  # tells when the connection is lost

    def __init__(
        self, topic: str, robot_num: int = 1, server: str | None = None, key: str | os.PathLike[str] | None = None
    ) -> None:
        """Find the arm; `server` and `key` are those of FrankaArm.

        Raises FrankaArmCommException when there is no server, FrankaArmArgumentError for a bad name.
        """
        if not text("topic", topic, 256):
            raise FrankaArmArgumentError("topic is '': expected a name of 1 to 256 bytes")
        self.topic = topic
        self._robot_num, self._server, self._key_file = robot_num, server, key
        self._where = (0, "")  # the process that has the socket, and the endpoint
        self._is_lost = False
        self._open()

    def _open(self) -> None:
        """Find the arm, and connect where it is not where it was."""
        found = find_server(self._server, self._key_file)
        where = os.getpid(), find_arm(found, self._robot_num).sensor_endpoint
        if not where[1]:
            raise FrankaArmCommException("The arm's process is not ready: `frankapy status` tells why.")
        self._is_lost = False
        if where == self._where:
            return  # ZeroMQ connects again
        if where[0] == self._where[0]:
            self._close()
        self._where = where
        self._way_ns = round(1e9 * way_to(found))
        self._id = secrets.randbits(63)
        self._sequence = itertools.count(1)
        self._socket, self._close = owned_socket(self, zmq.PUSH, _LINGER)
        self._socket.sndhwm = 10_000
        self._monitor = self._socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        if found.key is not None:
            found.key.use_for(self._socket)
        self._socket.connect(where[1])

    def __repr__(self) -> str:
        return f"SensorPublisher({self.topic!r})"

    def publish(self, message: Message) -> None:
        """Send a message of wire/proto/sensors.proto, or of a part of your own.

        Raises FrankaArmArgumentError for a field against its rule, FrankaArmCommException when the server takes nothing, or is gone.
        """
        if not isinstance(message, Message):
            raise FrankaArmArgumentError(f"publish got {message!r}: expected a message, such as JointPositionSensorMessage")
        validate(message)
        if self._close.alive:
            while os.getpid() == self._where[0] and self._monitor.poll(0):
                self._monitor.recv_multipart()
                self._is_lost = True
            if self._is_lost or os.getpid() != self._where[0]:
                self._open()
        envelope = proto.SensorMessage(
            topic=self.topic, publisher=self._id, sequence=next(self._sequence), sent_ns=time.time_ns(), way_ns=self._way_ns
        )
        envelope.message.Pack(message)
        if (size := envelope.ByteSize()) > _MAX_MESSAGE:
            raise FrankaArmArgumentError(
                f"{message.DESCRIPTOR.name} has {size} bytes with its envelope: expected at most {_MAX_MESSAGE}. Send less at a time."
            )
        try:
            self._socket.send(envelope.SerializeToString(), zmq.NOBLOCK)
        except zmq.Again:
            raise FrankaArmCommException("The server takes no sensor messages: is it still there?") from None
        except zmq.ZMQError as error:
            raise FrankaArmCommException(f"Not published: {error}. Was this SensorPublisher closed?") from None

    def close(self) -> None:
        """Send what is left, for at most a second."""
        self._close()

    def __enter__(self) -> SensorPublisher:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
