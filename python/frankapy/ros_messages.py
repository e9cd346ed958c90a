"""The messages of franka_interface_msgs and sensor_msgs that published scripts use, without ROS."""

from __future__ import annotations

import dataclasses
from typing import Any

from frankapy import proto


@dataclasses.dataclass
class Header:
    """When (rospy.Time), and in which frame."""

    seq: int = 0
    stamp: Any = None
    frame_id: str = ""


@dataclasses.dataclass
class SensorData:
    """A sensor message as bytes; `type` is one of SensorDataMessageType."""

    type: int = 0
    info: str = ""
    size: int = 0
    sensorData: bytes = b""  # noqa: N815
    header: Header = dataclasses.field(default_factory=Header)


@dataclasses.dataclass
class SensorDataGroup:
    """Up to three sensor messages, for the parts of a skill."""

    has_trajectory_generator_sensor_data: bool = False
    trajectoryGeneratorSensorData: SensorData = dataclasses.field(default_factory=SensorData)  # noqa: N815
    has_feedback_controller_sensor_data: bool = False
    feedbackControllerSensorData: SensorData = dataclasses.field(default_factory=SensorData)  # noqa: N815
    has_termination_handler_sensor_data: bool = False
    terminationHandlerSensorData: SensorData = dataclasses.field(default_factory=SensorData)  # noqa: N815
    header: Header = dataclasses.field(default_factory=Header)


@dataclasses.dataclass
class ExecuteSkillGoal:
    """A skill as the published client sent it; kinds are numbers of frankapy.franka_interface_common_definitions."""

    skill_type: int = 0
    skill_description: str = ""
    meta_skill_type: int = 0
    meta_skill_id: int = 0
    sensor_topics: list[str] = dataclasses.field(default_factory=list)
    initial_sensor_values: list[float] = dataclasses.field(default_factory=list)
    sensor_value_sizes: list[int] = dataclasses.field(default_factory=list)
    trajectory_generator_type: int = 0
    trajectory_generator_param_data: bytes = b""
    trajectory_generator_param_data_size: int = 0
    feedback_controller_type: int = 0
    feedback_controller_param_data: bytes = b""
    feedback_controller_param_data_size: int = 0
    termination_handler_type: int = 0
    termination_handler_param_data: bytes = b""
    termination_handler_param_data_size: int = 0
    timer_type: int = 1
    timer_params: list[float] = dataclasses.field(default_factory=list)
    num_timer_params: int = 0


@dataclasses.dataclass
class JointState:
    """Names, positions (rad, or m), velocities and efforts of joints."""

    header: Header = dataclasses.field(default_factory=Header)
    name: list[str] = dataclasses.field(default_factory=list)
    position: list[float] = dataclasses.field(default_factory=list)
    velocity: list[float] = dataclasses.field(default_factory=list)
    effort: list[float] = dataclasses.field(default_factory=list)


class Errors:
    """Which errors the robot has: an attribute for each, by libfranka's name."""

    def __init__(self, names: Any = ()) -> None:
        self.names = frozenset(names)

    def __getattr__(self, name: str) -> bool:
        if name.startswith("_") or name == "names":
            raise AttributeError(name)
        return name in self.names

    def __repr__(self) -> str:
        return f"Errors({', '.join(sorted(self.names))})"


class RobotState:
    """The state of arm and hand; the robot's own fields in libfranka's symbols, in any case of letters (q, O_T_EE, o_t_ee).

    SI units, poses column by column, as tuples.
    """

    _FIELDS = {field.name.lower(): field for field in proto.RobotState.DESCRIPTOR.fields}

    def __init__(self, state: proto.ArmState | None = None, stamp: Any = None) -> None:
        """Take what a server's state has; None: a state of nothing."""
        state = state or proto.ArmState()
        self._robot = state.robot
        self.header = Header(state.robot.message_id, stamp)
        self.pose_desired = tuple(state.robot.O_T_EE_d)
        self.robot_mode = int(state.robot.robot_mode)
        self.robot_time = 1e-3 * state.robot.message_id
        self.current_errors = Errors(state.robot.errors)
        self.last_motion_errors = Errors(state.robot.reflex_reason)
        self.gripper_width = state.gripper.width
        self.gripper_max_width = state.gripper.max_width
        self.gripper_is_grasped = state.gripper.is_grasped
        self.gripper_temperature = state.gripper.temperature
        self.gripper_time = self.robot_time
        self.is_fresh = state.age < 0.1

    def __getattr__(self, name: str) -> Any:
        field = self._FIELDS.get(name.lower())
        if name.startswith("_") or field is None:
            raise AttributeError(f"RobotState has no {name!r}")
        value = getattr(self._robot, field.name)
        return value if isinstance(value, (int, float, str)) else tuple(value)
