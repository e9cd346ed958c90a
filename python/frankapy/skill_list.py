"""Skill of the published interface: what a skill is made of, by numbers and by messages as bytes.

Nothing here runs one: `fa.run` runs skills of frankapy.parts. What scripts made of it, they make and look into.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from frankapy import proto
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.franka_constants import FrankaConstants as FC
from frankapy.franka_interface_common_definitions import FeedbackControllerType, MetaSkillType, TerminationHandlerType
from frankapy.rigid_transform import RigidTransform
from frankapy.ros_messages import ExecuteSkillGoal
from frankapy.utils import transform_to_list
from frankapy.validation import number, numbers, vector

_TRAJECTORY, _CONTROLLER, _TERMINATION = "trajectory_generator", "feedback_controller", "termination_handler"

# Methods which put their arguments into a message as they are: "name" is a number of at least 0, "name:bool" a flag, "name[7]" a
# vector, "name[7?]" one that may be [].
_ADD = {
    "add_run_time": (_TRAJECTORY, "RunTimeMessage", "run_time"),
    "add_goal_joints": (_TRAJECTORY, "JointTrajectoryGeneratorMessage", "run_time joints[7]"),
    "add_goal_joint_velocities": (
        _TRAJECTORY, "JointVelocityTrajectoryGeneratorMessage", "run_time joint_velocities[7] joint_accelerations[7]",
    ),
    "add_goal_cartesian_velocities": (
        _TRAJECTORY, "CartesianVelocityTrajectoryGeneratorMessage", "run_time cartesian_velocities[6] cartesian_accelerations[6]",
    ),
    "add_gripper_params": (_TRAJECTORY, "GripperTrajectoryGeneratorMessage", "grasp:bool width speed force"),
    "add_impulse_params": (
        _TRAJECTORY, "ImpulseTrajectoryGeneratorMessage", "run_time acc_time max_trans max_rot forces[3] torques[3]",
    ),
    "add_force_axis_params": (
        _CONTROLLER, "ForceAxisFeedbackControllerMessage", "translational_stiffness rotational_stiffness axis[3]",
    ),
    "add_internal_impedances": (
        _CONTROLLER, "InternalImpedanceFeedbackControllerMessage", "cartesian_impedances[6?] joint_impedances[7?]",
    ),
    "add_joint_torques": (
        _CONTROLLER, "JointTorqueFeedbackControllerMessage",
        "joint_torques[7] selection[7] remove_gravity[7] k_gains[7] d_gains[7]",
    ),
    "add_force_position_params": (
        _CONTROLLER, "ForcePositionFeedbackControllerMessage",
        "position_kps_cart[6] force_kps_cart[6] position_kps_joint[7] force_kps_joint[7] S[6] use_cartesian_gains:bool",
    ),
    "add_joint_gains": (_CONTROLLER, "JointImpedanceFeedbackControllerMessage", "k_gains[7] d_gains[7]"),
    "add_contact_termination_params": (
        _TERMINATION, "ContactTerminationHandlerMessage", "buffer_time force_thresholds[6?] torque_thresholds[7?]",
    ),
    "add_joint_threshold_params": (_TERMINATION, "JointThresholdMessage", "buffer_time joint_thresholds[7?]"),
    "add_time_termination_params": (_TERMINATION, "TimeTerminationHandlerMessage", "buffer_time"),
}  # fmt: skip


class Skill:
    """What a skill is made of; `create_goal` gives it as ROS sent it. The arguments of the methods are those of FrankaArm's.

    Sizes and values are checked when they are added; FrankaArmArgumentError names what is wrong.
    """

    def __init__(
        self, skill_type: int, trajectory_generator_type: int,
        feedback_controller_type: int = FeedbackControllerType.NoopFeedbackController,
        termination_handler_type: int = TerminationHandlerType.NoopTerminationHandler,
        meta_skill_type: int = MetaSkillType.BaseMetaSkill, meta_skill_id: int = 0,
        sensor_topics: Sequence[str] | None = None, timer_type: int = 1, skill_desc: str = "",
    ) -> None:  # fmt: skip
        """Take the kinds: numbers of frankapy.franka_interface_common_definitions."""
        self._goal = ExecuteSkillGoal(
            skill_type=skill_type, skill_description=skill_desc, meta_skill_type=meta_skill_type, meta_skill_id=meta_skill_id,
            sensor_topics=[""] if sensor_topics is None else list(sensor_topics),
            trajectory_generator_type=trajectory_generator_type, feedback_controller_type=feedback_controller_type,
            termination_handler_type=termination_handler_type, timer_type=timer_type,
        )  # fmt: skip

    def create_goal(self) -> ExecuteSkillGoal:
        """Return the message."""
        return self._goal

    def feedback_callback(self, feedback: Any) -> None:
        """Do nothing with what ROS told of a skill on its way."""

    def set_meta_skill_type(self, meta_skill_type: int) -> None:
        """Set a number of MetaSkillType."""
        self._goal.meta_skill_type = meta_skill_type

    def set_meta_skill_id(self, meta_skill_id: int) -> None:
        """Set the number of the meta skill that this belongs to."""
        self._goal.meta_skill_id = meta_skill_id

    def add_initial_sensor_values(self, values: Any) -> None:
        """Set the values of sensors at the start."""
        self._goal.initial_sensor_values = numbers("values", values).tolist()
        self._goal.sensor_value_sizes = [len(self._goal.initial_sensor_values)]

    def add_timer_params(self, params: Any) -> None:
        """Set the parameters of the timer."""
        self._goal.timer_params = numbers("params", params).tolist()
        self._goal.num_timer_params = len(self._goal.timer_params)

    def add_trajectory_params(self, params: bytes) -> None:
        """Set the parameters of the trajectory generator: a message of frankapy.proto as bytes."""
        self._add(_TRAJECTORY, params)

    def add_feedback_controller_params(self, params: bytes) -> None:
        """Set the parameters of the feedback controller: a message of frankapy.proto as bytes."""
        self._add(_CONTROLLER, params)

    def add_termination_params(self, params: bytes) -> None:
        """Set the parameters of the termination handler: a message of frankapy.proto as bytes."""
        self._add(_TERMINATION, params)

    def _add(self, part: str, params: bytes) -> None:
        setattr(self._goal, f"{part}_param_data", params)
        setattr(self._goal, f"{part}_param_data_size", len(params))

    def _put(self, part: str, kind: str, **fields: Any) -> None:
        self._add(part, getattr(proto, kind)(**fields).SerializeToString())

    def add_goal_pose(self, run_time: float, goal_pose: RigidTransform) -> None:
        """Set a goal for the tool base, in s."""
        self._put(
            _TRAJECTORY, "PoseTrajectoryGeneratorMessage",
            run_time=_positive("run_time", run_time), position=goal_pose.translation, quaternion=goal_pose.quaternion,
            pose=transform_to_list(goal_pose),
        )  # fmt: skip

    def add_joint_dmp_params(self, run_time: float, joint_dmp_info: Mapping[str, Any], initial_sensor_values: Any) -> None:
        """Set a movement primitive of the joints."""
        self._put(
            _TRAJECTORY, "JointDMPTrajectoryGeneratorMessage",
            run_time=_positive("run_time", run_time), **_dmp(joint_dmp_info, 7),
            initial_sensor_values=_sensors(initial_sensor_values, joint_dmp_info, 1),
        )  # fmt: skip

    def add_pose_dmp_params(
        self, orientation_only: bool, position_only: bool, ee_frame: bool, run_time: float, pose_dmp_info: Mapping[str, Any],
        initial_sensor_values: Any,
    ) -> None:  # fmt: skip
        """Set a movement primitive of the tool."""
        dimensions = 3 if orientation_only or position_only else 6
        self._put(
            _TRAJECTORY, "PoseDMPTrajectoryGeneratorMessage",
            orientation_only=bool(orientation_only), position_only=bool(position_only), ee_frame=bool(ee_frame),
            run_time=_positive("run_time", run_time), **_dmp(pose_dmp_info, dimensions),
            initial_sensor_values=_sensors(initial_sensor_values, pose_dmp_info, dimensions),
        )  # fmt: skip

    def add_quaternion_pose_dmp_params(
        self, ee_frame: bool, run_time: float, position_dmp_info: Mapping[str, Any], quat_dmp_info: Mapping[str, Any],
        initial_sensor_values: Any, goal_quat: Any, goal_quat_time: float,
    ) -> None:  # fmt: skip
        """Set a movement primitive of the tool's position and one of its orientation."""
        fields: dict[str, Any] = {}
        for short, info in (("pos", position_dmp_info), ("quat", quat_dmp_info)):
            for name, value in _dmp(info, 3).items():
                fields[f"{short}_{name}" if name in ("basis_mean", "basis_std", "weights") else f"{name}_{short}"] = value
            fields[f"{short}_initial_sensor_values"] = _sensors(initial_sensor_values, position_dmp_info, 3)
        fields |= {f"goal_quat_{axis}": value for axis, value in zip("wxyz", vector("goal_quat", goal_quat, 4), strict=True)}
        self._put(
            _TRAJECTORY, "QuaternionPoseDMPTrajectoryGeneratorMessage",
            ee_frame=bool(ee_frame), run_time=_positive("run_time", run_time), **fields,
            goal_time_quat=_positive("goal_quat_time", goal_quat_time),
        )  # fmt: skip

    def add_cartesian_impedances(self, cartesian_impedances: Any) -> None:
        """Set the stiffness of the tool, 3 N/m and 3 Nm/rad."""
        stiffness = vector("cartesian_impedances", cartesian_impedances, 6)
        self._put(
            _CONTROLLER, "CartesianImpedanceFeedbackControllerMessage",
            translational_stiffnesses=stiffness[:3], rotational_stiffnesses=stiffness[3:],
        )  # fmt: skip

    def set_cartesian_impedances(self, use_impedance: bool, cartesian_impedances: Any, joint_impedances: Any) -> None:
        """Set the stiffness of a motion of the tool, None: the usual."""
        if use_impedance:
            usual = FC.DEFAULT_TRANSLATIONAL_STIFFNESSES + FC.DEFAULT_ROTATIONAL_STIFFNESSES
            self.add_cartesian_impedances(usual if cartesian_impedances is None else cartesian_impedances)
        elif joint_impedances is None and cartesian_impedances is not None:
            _call(self, "add_internal_impedances", cartesian_impedances, [])
        else:
            joints = FC.DEFAULT_JOINT_IMPEDANCES if joint_impedances is None else joint_impedances
            _call(self, "add_internal_impedances", [], joints)

    def set_joint_impedances(
        self, use_impedance: bool, cartesian_impedances: Any, joint_impedances: Any, k_gains: Any, d_gains: Any
    ) -> None:
        """Set the stiffness of a motion of the joints, None: the usual; gains are given both, or neither."""
        if not use_impedance:
            self.set_cartesian_impedances(False, cartesian_impedances, joint_impedances)
        elif k_gains is None or d_gains is None:
            _call(self, "add_joint_gains", FC.DEFAULT_K_GAINS, FC.DEFAULT_D_GAINS)
        else:
            _call(self, "add_joint_gains", k_gains, d_gains)

    def add_pose_threshold_params(self, buffer_time: float, pose_thresholds: Any) -> None:
        """Let the tool's nearness to the goal end it, m and rad (6,), or []."""
        thresholds = _vector("pose_thresholds", pose_thresholds, "6?")
        time = _positive("buffer_time", buffer_time)
        self._put(
            _TERMINATION, "PoseThresholdMessage",
            buffer_time=time, position_thresholds=thresholds[:3], orientation_thresholds=thresholds[3:],
        )  # fmt: skip

    def check_for_contact_params(self, buffer_time: float, force_thresholds: Any, torque_thresholds: Any) -> bool:
        """Let contact end it where one of the thresholds is given; return whether."""
        if force_thresholds is None and torque_thresholds is None:
            return False
        self._goal.termination_handler_type = TerminationHandlerType.ContactTerminationHandler
        forces, torques = ([] if value is None else value for value in (force_thresholds, torque_thresholds))
        _call(self, "add_contact_termination_params", buffer_time, forces, torques)
        return True


def _method(name: str) -> Callable[..., None]:
    part, kind, fields = _ADD[name]
    names = [field.split(":")[0].split("[")[0] for field in fields.split()]
    arguments = [inspect.Parameter(each, inspect.Parameter.POSITIONAL_OR_KEYWORD) for each in ["self", *names]]
    signature = inspect.Signature(arguments)

    def add(*given: Any, **named: Any) -> None:
        bound = signature.bind(*given, **named).arguments
        values: dict[str, Any] = {}
        for field, each in zip(fields.split(), names, strict=True):
            target = "selection" if each == "S" else each
            if "[" in field:
                values[target] = _vector(each, bound[each], field.split("[")[1].rstrip("]"))
            else:
                values[target] = bool(bound[each]) if field.endswith(":bool") else _positive(each, bound[each])
        bound["self"]._put(part, kind, **values)

    add.__name__, add.__qualname__, add.__doc__ = name, f"Skill.{name}", f"Set {', '.join(names)}: a {kind}."
    add.__signature__ = signature  # type: ignore[attr-defined]
    return add


for _name in _ADD:
    setattr(Skill, _name, _method(_name))


def _call(skill: Skill, name: str, *arguments: Any) -> None:
    getattr(skill, name)(*arguments)


def _positive(name: str, value: Any) -> float:
    figure = number(name, value)
    if figure < 0:
        raise FrankaArmArgumentError(f"{name} is {figure:g}: expected at least 0")
    return figure


def _vector(name: str, value: Any, size: str) -> np.ndarray:
    return np.zeros(0) if size.endswith("?") and np.size(value) == 0 else vector(name, value, int(size.rstrip("?")))


def _dmp(info: Mapping[str, Any], dimensions: int) -> dict[str, Any]:
    weights = vector("weights", numbers("weights", info["weights"]), dimensions * int(info["num_basis"]) * int(info["num_sensors"]))
    fields = {name: info[name] for name in ("tau", "alpha", "beta", "num_basis")}
    return fields | {"num_sensor_values": info["num_sensors"], "basis_mean": info["mu"], "basis_std": info["h"], "weights": weights}


def _sensors(values: Any, info: Mapping[str, Any], dimensions: int) -> np.ndarray:
    return vector("initial_sensor_values", values, dimensions * int(info["num_sensors"]))
