"""Sensor messages of published scripts: packed into groups, and taken out again."""

from __future__ import annotations

from google.protobuf.message import DecodeError, Message

from frankapy import proto
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.franka_interface_common_definitions import SensorDataMessageType
from frankapy.ros_messages import SensorData, SensorDataGroup

_MESSAGES: dict[int, type[Message]] = {
    SensorDataMessageType.BOUNDING_BOX: proto.BoundingBox,
    SensorDataMessageType.CARTESIAN_IMPEDANCE: proto.CartesianImpedanceSensorMessage,
    SensorDataMessageType.CARTESIAN_VELOCITY: proto.CartesianVelocitySensorMessage,
    SensorDataMessageType.FORCE_POSITION: proto.ForcePositionSensorMessage,
    SensorDataMessageType.FORCE_POSITION_GAINS: proto.ForcePositionControllerSensorMessage,
    SensorDataMessageType.JOINT_POSITION_VELOCITY: proto.JointPositionVelocitySensorMessage,
    SensorDataMessageType.JOINT_POSITION: proto.JointPositionSensorMessage,
    SensorDataMessageType.JOINT_VELOCITY: proto.JointVelocitySensorMessage,
    SensorDataMessageType.JOINT_TORQUE: proto.JointTorqueControllerSensorMessage,
    SensorDataMessageType.POSE_POSITION_VELOCITY: proto.PosePositionVelocitySensorMessage,
    SensorDataMessageType.POSE_POSITION: proto.PosePositionSensorMessage,
    SensorDataMessageType.SHOULD_TERMINATE: proto.ShouldTerminateSensorMessage,
}


def sensor_proto2ros_msg(sensor_proto_msg: Message, sensor_data_type: int, info: str = "") -> SensorData:
    """Pack a message; `sensor_data_type` is its number in SensorDataMessageType."""
    kind = _MESSAGES.get(sensor_data_type)
    if kind is None or not isinstance(sensor_proto_msg, kind):
        raise FrankaArmArgumentError(
            f"sensor_proto2ros_msg got a {type(sensor_proto_msg).__name__} as type {sensor_data_type}: expected "
            f"{kind.__name__ if kind else 'one of SensorDataMessageType'}"
        )
    data = sensor_proto_msg.SerializeToString()
    return SensorData(sensor_data_type, info, len(data), data)


def make_sensor_group_msg(
    trajectory_generator_sensor_msg: SensorData | None = None,
    feedback_controller_sensor_msg: SensorData | None = None,
    termination_handler_sensor_msg: SensorData | None = None,
) -> SensorDataGroup:
    """Put packed messages for the parts of a skill into one."""
    group = SensorDataGroup()
    for part, data in (
        ("trajectory_generator", trajectory_generator_sensor_msg),
        ("feedback_controller", feedback_controller_sensor_msg),
        ("termination_handler", termination_handler_sensor_msg),
    ):
        if data is not None:
            setattr(group, f"has_{part}_sensor_data", True)
            setattr(group, f"{_camel(part)}SensorData", data)
    return group


def messages_of(group: SensorDataGroup) -> list[Message]:
    """Return what a group holds. Raises FrankaArmArgumentError where bytes and type do not agree."""
    messages = []
    for part in ("trajectory_generator", "feedback_controller", "termination_handler"):
        if not getattr(group, f"has_{part}_sensor_data", False):
            continue
        data = getattr(group, f"{_camel(part)}SensorData")
        kind = _MESSAGES.get(data.type)
        try:
            if kind is None:
                raise DecodeError("there is no such type")
            messages.append(kind.FromString(bytes(data.sensorData)))
        except DecodeError as error:
            raise FrankaArmArgumentError(
                f"The {part.replace('_', ' ')}'s sensor data is of type {data.type} and has {len(data.sensorData)} bytes: "
                f"{error}"
            ) from None
    return messages


def _camel(name: str) -> str:
    first, second = name.split("_")
    return first + second.capitalize()
