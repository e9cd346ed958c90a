"""FrankaArm: one arm, commanded through franka-interface."""

from __future__ import annotations

import logging
import os
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from google.protobuf.message import Message

from frankapy import (
    collision_boxes,
    controllers,
    dmp_dictionaries,
    endings,
    hand,
    imitation,
    kinematics,
    poses,
    proto,
    reach,
    recorder,
    ros_utils,
    states,
    velocities,
)
from frankapy import forces as _forces
from frankapy import guidance as _guidance
from frankapy.channel import advised
from frankapy.connection import Connected, Connection
from frankapy.demonstration import Demonstration
from frankapy.exceptions import FrankaArmArgumentError, FrankaArmException, FrankaArmFrankaInterfaceNotReadyException
from frankapy.franka_constants import FrankaConstants as FC
from frankapy.hand import Hand
from frankapy.interrupts import stop_on_interrupt
from frankapy.kinds import Kind, describe
from frankapy.limits import Limits
from frankapy.motions import Motions
from frankapy.poses import TOOL, TOOL_BASE, WORLD
from frankapy.proto_utils import messages_of
from frankapy.recovery import policy
from frankapy.rigid_transform import RigidTransform
from frankapy.ros_messages import SensorDataGroup
from frankapy.sensors import SensorPublisher
from frankapy.skill import any_of, make_skill
from frankapy.states import RobotState, StateReader, StateStream
from frankapy.utils import franka_pose_to_rigid_transform
from frankapy.validation import checks_flags, number, text, validate, vector, whole
from frankapy.walls import Walls

if TYPE_CHECKING:
    from frankapy.dmp import Primitive

logger = logging.getLogger("frankapy")

Numbers: TypeAlias = Sequence[float] | np.ndarray
_SENSOR_TOPIC = FC.DEFAULT_SENSOR_PUBLISHER_TOPIC
_BUFFER_TIME = FC.DEFAULT_TERM_BUFFER_TIME  # s
_IN_TOOL, _IN_WORLD = proto.RelativeMinJerkPose.END_EFFECTOR, proto.RelativeMinJerkPose.BASE


class FrankaArm(Connected):
    """One Franka arm with its hand.

    Poses are RigidTransforms in metres; `franka_tool` is the point that is moved, `franka_tool_base` the robot's
    end-effector frame, `world` the base of the arm. Arrays may be lists, tuples or ndarrays. A motion that is refused
    raises FrankaArmArgumentError (a ValueError) before anything moves. One client commands an arm at a time, the
    others may read, and stop it. A ShouldTerminateSensorMessage over FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC ends any
    motion but those of `run`, which have their own terminations.

    Example:
        >>> from frankapy import FrankaArm
        >>> fa = FrankaArm()
        >>> fa.reset_joints()
        >>> pose = fa.get_pose()
        >>> pose.translation[2] -= 0.1
        >>> fa.goto_pose(pose, duration=2)
    """

    def __init__(
        self, rosnode_name: str = "franka_arm_client", ros_log_level: int = 2, robot_num: int = 1,
        with_gripper: bool = True, old_gripper: bool = False, offline: bool = False, init_node: bool = True,
        *, server: str | None = None, node_name: str | None = None, init_rclpy: bool = True,
        key: str | os.PathLike[str] | None = None,
    ) -> None:  # fmt: skip
        """Connect to the server of an arm and wait until it is there, at most 10 s.

        `robot_num` is the number of the arm in the server's configuration, from 1. `server` is host or host:port of
        franka-interface; without it the environment variable FRANKA_INTERFACE_SERVER, then 127.0.0.1:5757. `key` is the file of this
        client's key where the server has keys (docs/keys.md); without it FRANKAPY_KEY, then frankapy/key.json in the user's
        configuration.
        `with_gripper=False` is for an arm without a hand. `offline=True` needs no server: reads give zeros, motions are
        checked and not made. The names of nodes, their log level and `old_gripper` are accepted and mean nothing here.

        Raises FrankaArmCommException when there is no server, no arm, another version, or not the right key.
        """
        self._tool_delta_pose = RigidTransform(np.eye(3), np.zeros(3), from_frame=TOOL, to_frame=TOOL_BASE)
        self._speed = 1.0
        self._recovery: str | int | None = None
        self._sensors: SensorPublisher | None = None
        self._server_name, self._robot_num, self._key_file = server, whole("robot_num", robot_num), key
        self._connection = None if offline else Connection(server, self._robot_num, key)
        self._motions, self._hand = Motions(self._connection), Hand(self._connection, wanted=bool(with_gripper))
        self._reader = StateReader(self._connection)
        if self._connection is None:
            logger.warning("FrankaArm is offline: reads give zeros, and nothing moves.")
            return
        self._finalizer = weakref.finalize(self, self._connection.close)
        stop_on_interrupt(self._connection)
        self._connection.wait_until_ready()
        self.walls.warn_of_near()

    def __repr__(self) -> str:
        if self._connection is None:
            return "FrankaArm(offline)"
        arm = self._connection.welcome
        return f"FrankaArm({arm.arm}: {arm.model.upper()} at {arm.address}, protocol version {arm.protocol_version})"

    def close(self) -> None:
        """Leave the arm to others. A skill that still runs goes on to its own end."""
        self._reader.stop_listening()
        if self._sensors is not None:
            self._sensors.close()
        if self._connection is not None:
            self._connection.close()

    def __enter__(self) -> FrankaArm:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    # --- speed ---------------------------------------------------------------------------------------------------

    @property
    def speed(self) -> float:
        """Of the clock of all motions that are called for from now on, 0.01 to 1: at 0.2 each takes five times as long.

        Those that follow messages (`dynamic`, `run_dynamic_force_position`), exert forces or torques, or are led by hand
        (`run_guide_mode`, `selective_guidance_mode`) keep their own time, and so do terminations that name one, as `Time(4)`.
        """
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        speed = number("speed", speed)
        validate(proto.Skill(speed=speed))
        self._speed = speed

    def set_speed(self, speed: float) -> None:
        """Set `speed`."""
        self.speed = speed

    def get_speed(self, speed: Any = None) -> float:
        """Return `speed`; what is given means nothing."""
        return self.speed

    # --- waiting and stopping ------------------------------------------------------------------------------------

    def wait_for_franka_interface(self, timeout: float | None = None) -> None:
        """Wait until the arm can move; an arm in error recovers by itself, where `recovery` and the lab's file let it.

        `timeout` in s; None is 10 s. Raises FrankaArmCommException when it cannot move by then, with the reason, and
        FrankaArmFrankaInterfaceNotReadyException when a person has to look at it first (`recover`).
        """
        timeout = None if timeout is None else number("timeout", timeout)
        if self._connection is not None:
            self._connection.wait_until_ready(timeout, self._policy(None, ignore_errors=True))

    @property
    def recovery(self) -> str | int | None:
        """Who brings the arm back after an error of the robot in a motion that is called for from now on.

        "itself": the server, at once, ten times in a row (without a motion between that ends by itself); a number: so many times.
        "ask": a person who has looked at the arm, by `recover`. "never": only people at the robot. None: "itself" where errors
        are ignored, as the published methods do by default, and "ask" where they are raised, as `run` does. The lab's file
        (arm.recovery of the server's configuration) says what is allowed at most: by default nobody recovers from a collision or
        a user stop but a person.
        """
        return self._recovery

    @recovery.setter
    def recovery(self, recovery: str | int | None) -> None:
        if recovery is not None:
            policy(recovery)
        self._recovery = recovery

    def recover(self) -> proto.Recovery:
        """Bring the arm back after an error or a user stop: for a person, who has looked at it.

        The robot recovers; then joints that are outside their range are moved back inside, slowly. Returns when the arm is ready,
        at once where nothing is wrong.

        Raises FrankaArmFrankaInterfaceNotReadyException where it is not: its `recovery` says what stands in the way (`obstacle`,
        `message`), such as a user stop that is pressed.
        """
        recovery = self._server.recover()
        if not recovery.recovered:
            raise FrankaArmFrankaInterfaceNotReadyException(f"The arm is not ready: {advised(recovery.message)}", recovery=recovery)
        return recovery

    def wait_for_skill(self) -> None:
        """Return when the skill that was last sent has ended, however it ended."""
        self._motions.wait_for_last()

    @checks_flags
    async def finished(self, ignore_errors: bool = False) -> proto.SkillResult:
        """Wait in a coroutine for the end of the skill that was last sent; return its result.

        Where the coroutine is cancelled the arm is stopped. Raises FrankaArmException for a skill that failed, where errors are
        not ignored.

        Example:
            >>> import asyncio
            >>> async def there_and_back():
            ...     fa.goto_joints([0, -0.7, 0, -2.3, 0, 1.6, 0.8], duration=1, block=False)
            ...     print((await fa.finished()).time)
            >>> asyncio.run(there_and_back())
        """
        return await self._motions.finished(ignore_errors)

    @checks_flags
    def is_skill_done(self, ignore_errors: bool = True) -> bool:
        """Return whether the skill that was last sent has ended; True when there is none.

        With `ignore_errors=False` a skill that failed raises FrankaArmException. Where the connection was lost meanwhile this
        raises FrankaArmCommException, once.
        """
        return self._motions.is_done(ignore_errors)

    def stop_skill(self) -> None:
        """Bring the arm to rest, whoever moves it, and wait until the skill of this client has ended."""
        self._motions.stop()

    def wait_for_gripper(self) -> None:
        """Return when the gripper command that was last sent has ended."""
        self._hand.wait()

    @checks_flags
    async def gripper_finished(self, ignore_errors: bool = False) -> None:
        """Wait in a coroutine for the end of the gripper command that was last sent.

        Where the coroutine is cancelled the hand is stopped. Raises FrankaArmException for a command that failed, where
        errors are not ignored.

        Example:
            >>> import asyncio
            >>> async def open_on_the_way():
            ...     fa.goto_joints([0, -0.7, 0, -2.3, 0, 1.6, 0.8], duration=1, block=False)
            ...     fa.open_gripper(block=False)
            ...     await asyncio.gather(fa.finished(), fa.gripper_finished())
            >>> asyncio.run(open_on_the_way())
        """
        await self._hand.finished(ignore_errors)

    def is_gripper_skill_done(self) -> bool:
        """Return whether the gripper command that was last sent has ended."""
        return self._hand.is_done()

    # --- motions -------------------------------------------------------------------------------------------------

    @checks_flags
    def goto_joints(
        self, joints: Numbers, duration: float = 5, use_impedance: bool = False, dynamic: bool = False,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        cartesian_impedances: Numbers | None = None, joint_impedances: Numbers | None = None,
        k_gains: Numbers | None = None, d_gains: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, ignore_virtual_walls: bool = False, skill_desc: str = "GoToJoints",
    ) -> None:  # fmt: skip
        """Move the joints along minimum-jerk curves.

        Returns when the commanded joints are there (with `block=False` when the server has taken the skill).

        Args:
            joints: goal, rad, (7,).
            duration: s; a motion that is too fast for the arm takes longer.
            use_impedance: False: the robot's own joint impedance holds the arm to the curve. True: the server's.
            dynamic: go where messages lead that are published over FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC while
                this runs: JointPositionSensorMessage, JointChunk and the like (see `publisher`). The goal is checked, and then
                not gone to; the skill is not waited for, and ends after `duration` and `buffer_time`.
            buffer_time: s after the end of the curve at which the skill ends in any case.
            force_thresholds: external forces and torques on the tool, N and N m (6,), at one of which the motion ends where
                it is. Then the goal being reached no longer ends it: `duration` and `buffer_time` do. From the upper
                thresholds of the robot's own collision behaviour on (arm.collision of the server's configuration; 120 N) it
                is a reflex.
            torque_thresholds: external torques of the joints, N m (7,). As ever only forces on the tool end the motion: with
                these alone, 20 N and 25 N m.
            cartesian_impedances: of the robot's own controller, 3 N/m and 3 Nm/rad; without `use_impedance`.
            joint_impedances: of the robot's own controller, Nm/rad, (7,); without `use_impedance`; goes before
                `cartesian_impedances`.
            k_gains: stiffness of the server's controller, Nm/rad, (7,); with `use_impedance`.
            d_gains: damping of the server's controller, Nms/rad, (7,); with `use_impedance`.
            block: whether to wait for the end.
            ignore_errors: True: a failure is logged and recovered from. False: it raises FrankaArmException.
            ignore_virtual_walls: do not refuse goals where a box of the arm or the tool touches FrankaConstants.WORKSPACE_WALLS
                or is behind one.
            skill_desc: goes into states and logs.

        Example:
            >>> fa.goto_joints([0, -0.785, 0, -2.356, 0, 1.571, 0.6], duration=2)
        """
        joints = vector("joints", joints, 7)
        reach.check(joints, *self._rest_range())
        if not ignore_virtual_walls:
            self._check_walls_at("goto_joints", joints)
        controller = controllers.of_joints(dynamic or use_impedance, cartesian_impedances, joint_impedances, k_gains, d_gains)
        if dynamic:
            ends = endings.of_time(duration, buffer_time, force_thresholds, torque_thresholds)
            self._run(proto.StreamJoint(topic=_SENSOR_TOPIC), controller, ends, skill_desc, False, ignore_errors, speed=1)
        else:
            ends = endings.at_goal(proto.FinalJoint(), buffer_time, force_thresholds, torque_thresholds)
            trajectory = proto.MinJerkJoint(q=joints, duration=number("duration", duration))
            self._run(trajectory, controller, ends, skill_desc, block, ignore_errors)

    @checks_flags
    def goto_pose(
        self, tool_pose: RigidTransform, duration: float = 3, use_impedance: bool = True, dynamic: bool = False,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        cartesian_impedances: Numbers | None = None, joint_impedances: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, ignore_virtual_walls: bool = False, skill_desc: str = "GoToPose",
    ) -> None:  # fmt: skip
        """Move the tool to a pose: minimum-jerk along a line, with the shortest rotation.

        Returns when the measured pose is within 0.1 mm and 0.1 mrad of the goal, or `buffer_time` after the end of the
        curve (with `block=False` when the server has taken the skill).

        Args:
            tool_pose: goal, from franka_tool to world.
            use_impedance: True: a spring between tool and curve, 600 N/m and 50 Nm/rad, by the server. False: the
                robot's own impedance control.
            dynamic: as there, by PosePositionSensorMessage of the tool base, PoseChunk and the like;
                CartesianImpedanceSensorMessage sets the spring anew.
            cartesian_impedances: 3 N/m and 3 Nm/rad, of whichever controller.
            ignore_virtual_walls: do not refuse goals where tool base or tool is behind FrankaConstants.WORKSPACE_WALLS.

        The other arguments are those of `goto_joints`.

        Example:
            >>> pose = fa.get_pose()
            >>> pose.translation[0] += 0.05
            >>> fa.goto_pose(pose, duration=2)
        """
        poses.check("tool_pose", tool_pose, (TOOL, WORLD))
        goal = tool_pose.matrix @ self._tool_delta_pose.inverse().matrix
        if not ignore_virtual_walls:
            self._check_walls("goto_pose", tool_base=goal[None, :3, 3], tool=tool_pose.matrix[None, :3, 3])
        if dynamic:
            controller = controllers.of_pose(True, cartesian_impedances, joint_impedances, topic=_SENSOR_TOPIC)
            ends = endings.of_time(duration, buffer_time, force_thresholds, torque_thresholds)
            self._run(proto.StreamPose(topic=_SENSOR_TOPIC), controller, ends, skill_desc, False, ignore_errors, speed=1)
        else:
            controller = controllers.of_pose(use_impedance, cartesian_impedances, joint_impedances)
            ends = endings.at_goal(proto.FinalPose(judged=proto.FinalJoint.ARM), buffer_time, force_thresholds, torque_thresholds)
            trajectory = proto.MinJerkPose(
                position=goal[:3, 3], quaternion=poses.quaternion(goal), duration=number("duration", duration)
            )
            self._run(trajectory, controller, ends, skill_desc, block, ignore_errors)

    @checks_flags
    def goto_pose_by_joints(
        self, tool_pose: RigidTransform, duration: float | None = None, near: Numbers | None = None, use_impedance: bool = False,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        cartesian_impedances: Numbers | None = None, joint_impedances: Numbers | None = None,
        k_gains: Numbers | None = None, d_gains: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, ignore_virtual_walls: bool = False,
        skill_desc: str = "GoToPoseByJoints",
    ) -> None:  # fmt: skip
        """Move the tool to a pose by the shortest way of the joints, along which the tool goes wherever they take it.

        So also where the line of `goto_pose` would lead past a singular posture, the end of a joint's range or through the base.
        Returns when each measured joint is within 0.1 mrad of those that `ik` found, or `buffer_time` after the end of the
        motion (with `block=False` when the server has taken the skill).

        Args:
            tool_pose: goal, from franka_tool to world. One that no joints bring the tool to raises FrankaArmArgumentError.
            duration: s, along minimum-jerk curves; None: as fast as half of the arm's limits allow, times `speed`.
            near: posture near which the joints of the pose are to be, rad, (7,), so which way the elbow points; None: where the
                arm is now.

        The other arguments are those of `goto_joints`.

        Example:
            >>> pose = fa.get_pose()
            >>> pose.translation = [0.45, 0.25, 0.4]
            >>> fa.goto_pose_by_joints(pose)
        """
        joints = self.ik(tool_pose, near)
        if not ignore_virtual_walls:
            self._check_walls_at("goto_pose_by_joints", joints)
        trajectory = (
            proto.TimeOptimalJoint(q=joints)
            if duration is None
            else proto.MinJerkJoint(q=joints, duration=number("duration", duration))
        )
        controller = controllers.of_joints(use_impedance, cartesian_impedances, joint_impedances, k_gains, d_gains)
        ends = endings.at_goal(proto.FinalJoint(judged=proto.FinalJoint.ARM), buffer_time, force_thresholds, torque_thresholds)
        self._run(trajectory, controller, ends, skill_desc, block, ignore_errors)

    @checks_flags
    def goto_pose_delta(
        self, delta_tool_pose: RigidTransform, duration: float = 3, use_impedance: bool = True,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        cartesian_impedances: Numbers | None = None, joint_impedances: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, ignore_virtual_walls: bool = False, skill_desc: str = "GoToPoseDelta",
    ) -> None:  # fmt: skip
        """Move the tool by a difference from where it is; in a sequence, from where the motion before ends.

        Arguments, return and errors are those of `goto_pose`, but for:

        Args:
            delta_tool_pose: from franka_tool to franka_tool: along and about the axes of the tool. From world to world:
                the translation is along the axes of the base; the rotation is still about the axes of the robot's
                end-effector frame, without the tool's offset.

        Example:
            >>> from frankapy import RigidTransform
            >>> delta = RigidTransform(translation=[0, 0, 0.03], from_frame='franka_tool', to_frame='franka_tool')
            >>> fa.goto_pose_delta(delta, duration=1)
        """
        poses.check("delta_tool_pose", delta_tool_pose, (TOOL, TOOL), (WORLD, WORLD))
        tool, delta, in_tool = self._tool_delta_pose.matrix, delta_tool_pose.matrix, delta_tool_pose.from_frame == TOOL
        if in_tool:
            delta = tool @ delta @ np.linalg.inv(tool)
        if not ignore_virtual_walls and self._connection is not None:
            start = self._start_of_next()
            goal = start @ delta
            if not in_tool:
                goal[:3, 3] = start[:3, 3] + delta[:3, 3]
            self._check_walls("goto_pose_delta", tool_base=goal[None, :3, 3], tool=(goal @ tool)[None, :3, 3])
        self._run(
            proto.RelativeMinJerkPose(
                translation=delta[:3, 3],
                quaternion=poses.quaternion(delta),
                frame=_IN_TOOL if in_tool else _IN_WORLD,
                duration=number("duration", duration),
            ),
            controllers.of_pose(use_impedance, cartesian_impedances, joint_impedances),
            endings.at_goal(proto.FinalPose(judged=proto.FinalJoint.ARM), buffer_time, force_thresholds, torque_thresholds),
            skill_desc,
            block,
            ignore_errors,
        )

    @checks_flags
    def reset_joints(self, duration: float = 5, block: bool = True, ignore_errors: bool = True, skill_desc: str = "") -> None:
        """Move to FrankaConstants.HOME_JOINTS, as `goto_joints` does."""
        self.goto_joints(FC.HOME_JOINTS, duration=duration, block=block, ignore_errors=ignore_errors, skill_desc=skill_desc)

    @checks_flags
    def reset_pose(self, duration: float = 5, block: bool = True, ignore_errors: bool = True, skill_desc: str = "") -> None:
        """Move to FrankaConstants.HOME_POSE, as `goto_pose` does."""
        self.goto_pose(FC.HOME_POSE, duration=duration, block=block, ignore_errors=ignore_errors, skill_desc=skill_desc)

    @checks_flags
    def execute_joint_dmp(
        self, joint_dmp_info: Mapping[str, Any], duration: float, initial_sensor_values: Any = None, use_impedance: bool = False,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        cartesian_impedances: Numbers | None = None, joint_impedances: Numbers | None = None,
        k_gains: Numbers | None = None, d_gains: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, skill_desc: str = "JointDmp",
    ) -> None:  # fmt: skip
        """Move the joints along a dynamic movement primitive from where they are.

        Returns `buffer_time` after its end, or at a contact (with `block=False` when the server has taken the skill). A
        motion that is too fast for the arm takes longer; one that leaves the joints' range is refused.

        Args:
            joint_dmp_info: tau (1/s), alpha, beta, num_basis, num_sensors, mu and h (num_basis each), and weights, in any
                shape: of each joint, in it of each sensor, in it of each basis function, of which the first is a
                minimum-jerk rise in 1/(2 tau) seconds.
            duration: s, up to 120.
            initial_sensor_values: num_sensors; None: ones.

        The other arguments are those of `goto_joints`.

        Example:
            >>> import numpy as np
            >>> weights = np.zeros((7, 1, 2))
            >>> weights[0, 0, 0] = 0.2
            >>> dmp = dict(tau=0.25, alpha=60, beta=15, num_basis=2, num_sensors=1, mu=[1, 0.8], h=[50, 50], weights=weights)
            >>> fa.execute_joint_dmp(dmp, duration=3)
        """
        trajectory = dmp_dictionaries.joint_dmp(joint_dmp_info, duration, initial_sensor_values)
        controller = controllers.of_joints(use_impedance, cartesian_impedances, joint_impedances, k_gains, d_gains)
        ends = endings.in_time(buffer_time, force_thresholds, torque_thresholds)
        self._run(trajectory, controller, ends, skill_desc, block, ignore_errors)

    @checks_flags
    def execute_pose_dmp(
        self, pose_dmp_info: Mapping[str, Any], duration: float, use_goal_formulation: bool = False,
        initial_sensor_values: Any = None, orientation_only: bool = False, position_only: bool = False, ee_frame: bool = False,
        use_impedance: bool = True,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        cartesian_impedances: Numbers | None = None, joint_impedances: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, skill_desc: str = "PoseDmp",
    ) -> None:  # fmt: skip
        """Move the end effector along a dynamic movement primitive from where it is.

        Its dimensions are x, y and z in the base frame (m), and the intrinsic XYZ Euler angles (rad). Returns as
        `execute_joint_dmp`.

        Args:
            pose_dmp_info: as of `execute_joint_dmp`, of six dimensions, or three.
            duration: s, up to 120.
            use_goal_formulation: the first basis function is 1 from the beginning, instead of rising.
            initial_sensor_values: of each dimension num_sensors; None: ones.
            orientation_only: of the three Euler angles alone.
            position_only: of x, y and z alone.
            ee_frame: x, y and z are along the axes that the end effector has at the start.

        The other arguments are those of `goto_pose`.
        """
        trajectory = dmp_dictionaries.pose_dmp(
            pose_dmp_info, duration, initial_sensor_values, use_goal_formulation, orientation_only, position_only, ee_frame
        )
        controller = controllers.of_pose(use_impedance, cartesian_impedances, joint_impedances)
        ends = endings.in_time(buffer_time, force_thresholds, torque_thresholds)
        self._run(trajectory, controller, ends, skill_desc, block, ignore_errors)

    @checks_flags
    def execute_quaternion_pose_dmp(
        self, position_dmp_info: Mapping[str, Any], quat_dmp_info: Mapping[str, Any], duration: float,
        goal_quat: Numbers, goal_quat_time: float, use_goal_formulation: bool = False,
        initial_sensor_values: Any = None, ee_frame: bool = False, use_impedance: bool = True,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        cartesian_impedances: Numbers | None = None, joint_impedances: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, skill_desc: str = "QuaternionPoseDmp",
    ) -> None:  # fmt: skip
        """Move the end effector along a movement primitive of its position, and one of its orientation that has a goal.

        Returns as `execute_joint_dmp`.

        Args:
            position_dmp_info: as of `execute_joint_dmp`, of x, y and z.
            quat_dmp_info: the same keys; all basis functions are Gaussians there, weights are for the axes of the base,
                and tau is not used.
            duration: s, up to 120.
            goal_quat: w, x, y, z in the base frame.
            goal_quat_time: s that it takes to the goal, less than `duration`.
            use_goal_formulation: means nothing here.
            initial_sensor_values: of the position, of each dimension num_sensors; None: ones.
            ee_frame: x, y and z are along the axes that the end effector has at the start.

        The other arguments are those of `goto_pose`.
        """
        trajectory = dmp_dictionaries.quaternion_pose_dmp(
            position_dmp_info, quat_dmp_info, duration, goal_quat, goal_quat_time, initial_sensor_values, ee_frame
        )
        controller = controllers.of_pose(use_impedance, cartesian_impedances, joint_impedances)
        ends = endings.in_time(buffer_time, force_thresholds, torque_thresholds)
        self._run(trajectory, controller, ends, skill_desc, block, ignore_errors)

    @checks_flags
    def run_guide_mode(self, duration: float = 10, block: bool = True, skill_desc: str = "GuideMode") -> None:
        """Let the arm be led by hand for `duration` (s): gravity is compensated, a little dry friction holds what nobody leads.

        Ends early by `stop_skill`. The arm then holds itself where it is.
        """
        # The duration is the person's, whatever the speed of motions.
        ends = endings.in_time(0, None, None)
        self._run(_guidance.stay(duration), proto.FreeDrive(), ends, skill_desc, block, ignore_errors=True, speed=1)

    @checks_flags
    def selective_guidance_mode(
        self, duration: float = 5, use_joints: bool = False, use_impedance: bool = False, use_ee_frame: bool = False,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        cartesian_impedances: Numbers | None = None, joint_impedances: Numbers | None = None,
        k_gains: Numbers | None = None, d_gains: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, ignore_virtual_walls: bool = False, skill_desc: str = "SelectiveGuidance",
    ) -> None:  # fmt: skip
        """Hold the arm where it is with the stiffness that is given for `duration` (s), so that it yields where that is low.

        Args:
            duration: s.
            use_joints: hold the joints; else the pose of the end effector.
            use_impedance: by the server's controllers; else by the robot's own.
            use_ee_frame: the Cartesian stiffness is along and about the axes of the end effector; else of the base. With
                `use_impedance`, without `use_joints`.
            ignore_virtual_walls: means nothing here.

        The other arguments are those of `goto_joints` and `goto_pose`.

        Example:
            >>> fa.selective_guidance_mode(20, use_impedance=True, cartesian_impedances=[600, 600, 0, 50, 50, 50])
        """
        stay, controller = _guidance.held(
            duration, use_joints, use_impedance, use_ee_frame, cartesian_impedances, joint_impedances, k_gains, d_gains
        )
        ends = endings.of_time(duration, buffer_time, force_thresholds, torque_thresholds)
        self._run(stay, controller, ends, skill_desc, block, ignore_errors, speed=1, led=True)

    def demonstrate(self, duration: float, skill_desc: str = "Demonstration", **guidance: Any) -> Demonstration:
        """Let somebody lead the arm by hand, and return what they did; Ctrl-C ends it sooner.

        Args:
            duration: s.
            skill_desc: goes into states and logs.
            guidance: arguments of `selective_guidance_mode`, for an arm that yields along some axes; none: it floats.

        Example:
            >>> demonstration = fa.demonstrate(20, use_impedance=True, cartesian_impedances=[0, 0, 600, 50, 50, 50])
        """
        duration = number("duration", duration)
        with self.states(fields=_guidance.FIELDS) as published:
            published.receive()  # the server knows of this reader: from here on none is missed
            guide = self.selective_guidance_mode if guidance else self.run_guide_mode
            guide(duration, block=False, skill_desc=skill_desc, **guidance)
            rows = _guidance.shown(published, self._motions.running, duration, self.stop_skill)
        self.wait_for_skill()
        return _guidance.demonstration_of(rows)

    def imitate(
        self, primitive: Primitive, duration: float | None = None, start: Numbers | None = None,
        goal: Numbers | None = None, goal_orientation: Numbers | None = None, sensor_values: Any = None,
        topic: str | None = None, loops: int = 1, skill_desc: str = "Imitation",
    ) -> list[proto.SkillResult]:  # fmt: skip
        """Go to where a primitive begins and do what it has learned; return how that ended, a result of each time.

        The way there and the motion are looked at by the server before anything moves.

        Args:
            primitive: of frankapy.dmp.
            start: where it begins, rad (7,), or m (3,) of the end-effector frame in the base; None: where it was
                learned, or where the arm is if the primitive does not say.
            duration, goal, goal_orientation, sensor_values, topic: as of the primitive's `part`.
            loops: how often, each time from its start; 0: it is only looked at.
            skill_desc: goes into states and logs.

        Raises FrankaArmArgumentError, with what is in the way and where, for a motion that the arm cannot make,
        FrankaArmException where the robot reports an error.

        Example:
            >>> import numpy as np
            >>> from frankapy import dmp
            >>> from frankapy.demonstration import Demonstration
            >>> turned = fa.get_joints() + np.outer(np.linspace(0, 1, 100), [0, 0, 0, 0, 0, 0, 0.3])
            >>> primitive = dmp.fit(Demonstration(np.linspace(0, 2, 100), turned).smooth(0.2))
            >>> fa.imitate(primitive, loops=2, duration=3)
        """
        changed = dict(
            duration=duration, goal=goal, goal_orientation=goal_orientation, sensor_values=sensor_values, topic=topic
        )  # fmt: skip
        return imitation.imitate(self, primitive, start, changed, loops, skill_desc)

    @checks_flags
    def execute_joint_velocities(
        self, joint_velocities: Numbers, joint_accelerations: Numbers, duration: float = 5, dynamic: bool = False,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        cartesian_impedances: Numbers | None = None, joint_impedances: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, ignore_virtual_walls: bool = False,
        skill_desc: str = "ExecuteJointVelocities",
    ) -> None:  # fmt: skip
        """Turn the joints with constant velocities for `duration`, from rest to rest, under the robot's own impedance control.

        Args:
            joint_velocities: rad/s (7,).
            joint_accelerations: rad/s² (7,), at both ends; all 0: half of what the arm can do.
            duration: s, with both ends.
            dynamic: follow the JointVelocitySensorMessages that are published over
                FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC while this runs, and nothing else. The skill is not waited for,
                and ends after `duration` and `buffer_time`. Where messages cease for 0.2 s the arm stops.
            ignore_virtual_walls: means nothing here.

        The other arguments are those of `goto_joints`.
        """
        trajectory = velocities.of_joints(joint_velocities, joint_accelerations, duration, dynamic)
        controller = controllers.of_robot(cartesian_impedances, joint_impedances)
        ends = endings.streamed_or_in_time(dynamic, duration, buffer_time, force_thresholds, torque_thresholds)
        speed = 1 if dynamic else None
        self._run(trajectory, controller, ends, skill_desc, block and not dynamic, ignore_errors, speed=speed)

    @checks_flags
    def execute_cartesian_velocities(
        self, cartesian_velocities: Numbers, cartesian_accelerations: Numbers, duration: float = 5, dynamic: bool = False,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        cartesian_impedances: Numbers | None = None, joint_impedances: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, ignore_virtual_walls: bool = False,
        skill_desc: str = "ExecutecartesianVelocities",
    ) -> None:  # fmt: skip
        """Move the end effector with a constant velocity, as `execute_joint_velocities` turns the joints.

        Args:
            cartesian_velocities: along and about the axes of the base, m/s and rad/s (6,).
            cartesian_accelerations: m/s² and rad/s² (6,), at both ends; all 0: half of what the arm can do.
            duration: s, with both ends.
            dynamic: as there, by CartesianVelocitySensorMessages.
            ignore_virtual_walls: means nothing here.

        The other arguments are those of `goto_pose`.
        """
        trajectory = velocities.of_tool(cartesian_velocities, cartesian_accelerations, duration, dynamic)
        controller = controllers.of_robot(cartesian_impedances, joint_impedances)
        ends = endings.streamed_or_in_time(dynamic, duration, buffer_time, force_thresholds, torque_thresholds)
        speed = 1 if dynamic else None
        self._run(trajectory, controller, ends, skill_desc, block and not dynamic, ignore_errors, speed=speed)

    @checks_flags
    def apply_effector_forces_torques(
        self, run_duration: float, acc_duration: float, max_translation: float, max_rotation: float,
        forces: Numbers | None = None, torques: Numbers | None = None,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, skill_desc: str = "ForceTorque",
    ) -> None:  # fmt: skip
        """Let the end effector exert a force and a torque for `run_duration`, and hold nothing meanwhile.

        In free space the arm goes where it is pulled. It then comes to rest and holds itself where it is.

        Args:
            run_duration: s, with rise and fall.
            acc_duration: s in which force and torque rise, and fall at the end; at most half of `run_duration`.
            max_translation: m from the start at which they have faded away; 0: no matter how far.
            max_rotation: rad, as max_translation.
            forces: N (3,), along the axes of the base; its norm times run_duration at most
                FrankaConstants.MAX_LIN_MOMENTUM. None: 0.
            torques: N m (3,), about the axes of the base; likewise FrankaConstants.MAX_ANG_MOMENTUM. None: 0.

        The other arguments are those of `goto_pose`.

        Example:
            >>> fa.apply_effector_forces_torques(2, 0.5, 0.05, 0.2, forces=[0, 0, -4])
        """
        impulse, controller = _forces.anywhere(run_duration, acc_duration, max_translation, max_rotation, forces, torques)
        ends = endings.in_time(buffer_time, force_thresholds, torque_thresholds)
        self._run(impulse, controller, ends, skill_desc, block, ignore_errors, speed=1)

    @checks_flags
    def apply_effector_forces_along_axis(
        self, run_duration: float, acc_duration: float, max_translation: float, forces: Numbers,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, skill_desc: str = "ForcesAlongAxis",
    ) -> None:  # fmt: skip
        """Let the end effector exert a force, and hold it on the line of that force with springs (600 N/m, 20 Nm/rad).

        Args:
            forces: N (3,), not all 0, along the axes of the base; its norm times run_duration at most
                FrankaConstants.MAX_LIN_MOMENTUM_CONSTRAINED.

        The other arguments are those of `apply_effector_forces_torques`.
        """
        impulse, controller = _forces.on_a_line(run_duration, acc_duration, max_translation, forces)
        ends = endings.in_time(buffer_time, force_thresholds, torque_thresholds)
        self._run(impulse, controller, ends, skill_desc, block, ignore_errors, speed=1)

    @checks_flags
    def execute_joint_torques(
        self, joint_torques: Numbers, selection: Numbers = (0,) * 7, remove_gravity: Numbers = (0,) * 7,
        duration: float = 5, dynamic: bool = False,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        k_gains: Numbers | None = None, d_gains: Numbers | None = None,
        block: bool = True, ignore_errors: bool = True, ignore_virtual_walls: bool = False,
        skill_desc: str = "ExecuteJointTorques",
    ) -> None:  # fmt: skip
        """Give some joints a torque and hold the others where they are, for `duration` and `buffer_time`.

        The arm then comes to rest and holds itself where it is. Under a constant torque nothing but the arm's own barrier
        limits how fast a joint becomes.

        Args:
            joint_torques: N m (7,), beside gravity, which the robot compensates.
            selection: of each joint 1 for its torque, 0 to be held at the angle where it starts.
            remove_gravity: of each joint 1 to let it feel gravity, by subtracting the torque that compensates it.
            duration: s.
            dynamic: take torques, selection and gains from JointTorqueControllerSensorMessages that are published over
                FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC while this runs (see `publisher`): torques at once, the rest
                in 0.1 s. The skill is not waited for.
            k_gains: stiffness of the joints that are held, Nm/rad, (7,).
            d_gains: damping of the joints that are held, Nms/rad, (7,).
            ignore_virtual_walls: means nothing here.

        The other arguments are those of `goto_joints`.

        Example:
            >>> fa.execute_joint_torques([0, 0, 0, 0, 0, 0, 0.4], selection=[0, 0, 0, 0, 0, 0, 1], duration=0.5)
        """
        controller = _forces.of_joints(joint_torques, selection, remove_gravity, k_gains, d_gains, dynamic)
        ends = endings.streamed_or_in_time(dynamic, duration, buffer_time, force_thresholds, torque_thresholds)
        self._run(_guidance.stay(duration), controller, ends, skill_desc, block and not dynamic, ignore_errors, speed=1)

    @checks_flags
    def apply_joint_torques(self, torques: Numbers, duration: float, ignore_errors: bool = True, skill_desc: str = "") -> None:
        """Move nothing, as ever: scripts that call it never met an arm whose joints nobody holds.

        `execute_joint_torques` applies torques.
        """
        vector("torques", torques, 7)
        logger.warning("apply_joint_torques moves nothing, as in frankapy; execute_joint_torques applies torques")

    @checks_flags
    def run_dynamic_force_position(
        self, duration: float = 3,
        buffer_time: float = _BUFFER_TIME, force_thresholds: Numbers | None = None, torque_thresholds: Numbers | None = None,
        position_kps_cart: Numbers = (600, 600, 600, 50, 50, 50), force_kps_cart: Numbers = (0.1,) * 6,
        position_kps_joint: Numbers = (600, 600, 600, 600, 250, 150, 50), force_kps_joint: Numbers = (0.1,) * 7,
        S: Numbers = (1,) * 6, interpolate: bool = False, use_cartesian_gains: bool = True,
        ignore_errors: bool = True, ignore_virtual_walls: bool = False, skill_desc: str = "",
    ) -> None:  # fmt: skip
        """Follow poses and exert forces that are published while this runs; return when the server has taken the skill.

        Poses and forces come as ForcePositionSensorMessages, other gains as ForcePositionControllerSensorMessages, over
        FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC (see `publisher`). Until the first comes the arm stays where it is and
        exerts nothing. It ends after `duration` and `buffer_time`.

        Args:
            duration: s.
            buffer_time: s.
            position_kps_cart: stiffness of EE, 3 N/m and 3 Nm/rad, with `use_cartesian_gains`.
            force_kps_cart: share of the force that is missing which is added to the force wanted, (6,), 0 to 2.
            position_kps_joint: stiffness of the joints, Nm/rad, (7,), without `use_cartesian_gains`.
            force_kps_joint: as force_kps_cart, of the joints' torques, (7,); of 6 the last stands for joint 7 too.
            S: of each axis of the base 1 to follow the pose, 0 to exert the force, or a part of both, (6,).
            interpolate: True: poses are passed on a spline, later by twice the time between them. False: each is gone to at
                once, as fast as 0.3 of the arm's limits allow.
            use_cartesian_gains: gains of EE, else of the joints.
            ignore_virtual_walls: means nothing here.

        The other arguments are those of `goto_pose`.

        Example:
            >>> from frankapy import FrankaConstants, proto
            >>> fa.run_dynamic_force_position(10, S=[1, 1, 0, 1, 1, 1])
            >>> with fa.publisher(FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC) as publisher:
            ...     pose = fa.get_pose().matrix.T.ravel()
            ...     publisher.publish(proto.ForcePositionSensorMessage(pose=pose, force=[0, 0, -5, 0, 0, 0]))
            >>> fa.stop_skill()
        """
        stream = proto.StreamForcePosition(topic=_SENSOR_TOPIC, delay=None if interpolate else 0)
        controller = _forces.beside_poses(
            position_kps_cart, force_kps_cart, position_kps_joint, force_kps_joint, S, use_cartesian_gains
        )
        ends = endings.of_time(duration, buffer_time, force_thresholds, torque_thresholds)
        self._run(stream, controller, ends, skill_desc, False, ignore_errors, speed=1)

    @checks_flags
    def run(
        self, trajectory: Message, controller: Message | None = None, until: Message | Sequence[Message] = (),
        *, robot_controller: str = "auto", speed: float | None = None, start_time: float | None = None, preempt: bool = False,
        block: bool = True, ignore_errors: bool = False, recover: str | int | None = None, skill_desc: str = "",
        publishers: Mapping[str, Sequence[str]] | None = None,
    ) -> proto.SkillResult | None:  # fmt: skip
        """Run a skill of any parts; `frankapy.parts` has them, and `frankapy kinds` lists them.

            fa.run(MinJerkPose(goal, 3), CartesianImpedance(600, 50), AnyOf(FinalPose(1e-3), ForceAbove(10, axis="z")))

        Poses are those of the end-effector frame that the robot is set to, in the base frame.

        Args:
            trajectory: where the arm goes.
            controller: how it follows; None: the robot's own joint impedance.
            until: what ends the skill, any of several; nothing: the end of the trajectory. Of the result, `termination` is
                the kind of the one that ended it, `termination_index` its place.
            robot_controller: what the robot is commanded in: "torque"; "joint_position", "joint_velocity",
                "cartesian_pose" or "cartesian_velocity", which its own impedance follows; "torque_and_" any of these;
                or "auto" for the first that fits.
            speed: of the trajectory's clock, 0.01 to 1; None: `fa.speed`.
            start_time: when the trajectory begins, in the server's `time.time()`, at most a minute ahead; until then the arm
                rests, or the skill before goes on. Skills of several arms with one start time begin together.
            preempt: take over from the skill of this client that still runs, without a stop where both run on one robot
                controller.
            block: wait for the end; its result is returned.
            ignore_errors: where the robot reports an error, log it and recover, instead of raising.
            recover: who brings the arm back after an error: "itself", a number of times by itself, "ask" or "never", as in
                `recovery`; None: as `recovery` says. Whoever it is, the skill has failed, and is not made again.
            skill_desc: goes with the skill's states.
            publishers: by topic, the names of the keys whose sensor messages the skill takes ({"policy": ["anna"]}), where the
                server has keys; of other topics, this client's own.

        Raises FrankaArmArgumentError for values against their rules and for parts that do not fit each other, with those
        that would; FrankaArmException where the robot reports an error.
        """
        controller = proto.InternalImpedance() if controller is None else controller
        return self._run(
            trajectory, controller, any_of(until), skill_desc, block, ignore_errors, robot_controller, preempt, speed, start_time,
            publishers=publishers,
            recover=recover,
        )  # fmt: skip

    def check(
        self, trajectory: Message, controller: Message | None = None, until: Message | Sequence[Message] = (),
        *, robot_controller: str = "auto", speed: float | None = None, joints: Numbers | None = None,
    ) -> proto.SkillChecked:  # fmt: skip
        """Return what `fa.run` would make of a skill, without moving: its `duration` (s) and `stretch` (>= 1) within the limits.

        The whole way is looked at: joints and poses out of reach, walls, the arm itself. It needs no lease: another client may
        command the arm meanwhile.

        Args:
            trajectory, controller, until, robot_controller, speed: as of `run`.
            joints: where the motion begins (rad); None: where the arm is now.

        Raises FrankaArmArgumentError as `run`, with what is in the way, and where.
        """
        controller = proto.InternalImpedance() if controller is None else controller
        speed = self.speed if speed is None else number("speed", speed)
        skill = make_skill(trajectory, controller, any_of(until), "", robot_controller, speed)
        check = proto.CheckSkill(skill=skill, joints=None if joints is None else vector("joints", joints, 7))
        return self._server.ask(proto.Request(check_skill=check)).skill_checked

    def change(
        self, trajectory: Message | None = None, controller: Message | None = None, until: Message | Sequence[Message] = ()
    ) -> None:
        """Give the skill that runs other parts, without a gap and without a step in torque; returns when it has them.

            fa.run(MinJerkPose(goal, 5), CartesianImpedance(600, 50), block=False)
            fa.change(controller=CartesianImpedance(200, 20))

        What is not given stays. A new trajectory begins at the reference as it then is; a new controller has the torque of the
        one before and comes to its own within 0.1 s. The robot controller stays, and so do the robot's own settings.

        Raises FrankaArmArgumentError for parts that do not fit, FrankaArmFrankaInterfaceNotReadyException when the skill does
        not run at that moment, FrankaArmException when there is none.
        """
        self._motions.change(trajectory, controller, until)

    def kinds(self, role: str | None = None) -> list[Kind]:
        """Return what skills are made of: every kind with its fields, their units and defaults, and what it fits.

        Those that the server has loaded from libraries are marked (`loaded`), and have the full names of their messages.

        Args:
            role: "trajectory", "controller", "termination", "ending" (what the arm does after a contact), or None for all.

        Example:
            >>> for kind in fa.kinds("controller"):
            ...     print(kind.name, list(kind.fits))
        """
        if role is not None and text("role", role, 100) not in ("trajectory", "controller", "termination", "ending"):
            raise FrankaArmArgumentError(f"role is {role!r}: expected trajectory, controller, termination, ending or None")
        return describe(role, None if self._connection is None else self._connection.current_welcome().loaded)

    def publisher(self, topic: str) -> SensorPublisher:
        """Return a publisher of sensor messages over a topic of this arm."""
        return SensorPublisher(topic, self._robot_num, self._server_name, self._key_file)

    @property
    def walls(self) -> Walls:
        """What this arm must not touch, by name; see frankapy.walls."""

        def change(walls: proto.ChangeWalls) -> proto.Walls:
            return self._server.ask(proto.Request(change_walls=walls)).walls

        return Walls(change, self._tool_base_on_flange)

    @property
    def obstacles(self) -> Walls:
        """The same as `walls`."""
        return self.walls

    def topics(self) -> dict[str, proto.Topics.Topic]:
        """Return what came over each topic since the arm's process began, and what skills that are there listen to.

        Of each: how many were `received`, `lost`, `out_of_order`, `late` (by 20 ms to 0.5 s), `stale` (by more, or by more
        than the timeout of the part that listens, and then dropped), `refused` and `why_refused`, `overrun`; how often nothing
        came for that timeout (`silences`); `age` (s) of the newest (absent before one came), `period` (s) between the newest,
        and the `skills` that listen.
        """
        return {topic.topic: topic for topic in self._server.ask(proto.Request(list_topics=proto.ListTopics())).topics.topics}

    def server_status(self) -> proto.ServerStatus:
        """Return what the arm's process does: who commands the arm, how many clients there are, how many cycles came late."""
        return self._server.ask(proto.Request(get_server_status=proto.GetServerStatus())).server_status

    def recording(self) -> AbstractContextManager[Callable[[], proto.RecordingStatus]]:
        """Record everything that happens inside, on the server's computer; `frankapy.recording` reads it.

        Gives a function that tells what there is: `file`, `time` (s), `states`, `bytes`, `lost`.

            with fa.recording() as status:
                fa.goto_pose(pose)
            print(status().file)

        Raises FrankaArmException where the server cannot write there.
        """
        return recorder.recording(self._server)

    def sequence(self, blend: float = 0) -> AbstractContextManager[list[proto.SkillResult]]:
        """Queue the motions that are called for inside, and wait for all of them at the end.

            with fa.sequence(blend=0.3) as results:
                fa.goto_pose(above, 2)
                fa.goto_pose(below, 2)

        Each begins when the one before has ended, without a gap; where one does not end by itself, those after it are
        cancelled. A motion is checked from the goal of the one before; a relative goal counts from where the reference is
        when it begins, which with `blend` is short of that.

        Args:
            blend: s before the end of a trajectory at which the next begins, from its motion, where both run on one robot
                controller; 0: each comes to rest.

        Yields the list of their results, which is complete afterwards. Raises FrankaArmException for the first that failed,
        unless it was called with ignore_errors; an exception inside stops the arm.
        """
        return self._motions.in_sequence(blend)

    # --- gripper -------------------------------------------------------------------------------------------------

    @checks_flags
    def goto_gripper(
        self, width: float, grasp: bool = False, speed: float = 0.04, force: float = 0.0,
        epsilon_inner: float = 0.08, epsilon_outer: float = 0.08,
        block: bool = True, ignore_errors: bool = True, skill_desc: str = "GoToGripper",
    ) -> None:  # fmt: skip
        """Move the fingers, or grasp with them.

        Returns when they are there, or when the object is held (with `block=False` at once; see `wait_for_gripper`).

        Args:
            width: between the fingers, 0 to 0.08 m.
            grasp: False: go there. True: close until the force is met.
            speed: m/s.
            force: of a grasp, N, up to 140; 0: the usual one of `close_gripper`, 60.
            epsilon_inner: a grasp succeeds when the width is at most this much smaller, m.
            epsilon_outer: and at most this much larger, m.
            block: whether to wait for the end.
            ignore_errors: True: a failure is logged. False: it raises FrankaArmException.
            skill_desc: of the published interface; not used.

        Example:
            >>> fa.goto_gripper(0.04)
        """
        command = hand.grasp(width, speed, force, epsilon_inner, epsilon_outer) if grasp else hand.move(width, speed)
        self._hand.command(command, block, ignore_errors)

    @checks_flags
    def open_gripper(self, block: bool = True, skill_desc: str = "OpenGripper") -> None:
        """Open the fingers to 0.08 m."""
        self.goto_gripper(FC.GRIPPER_WIDTH_MAX, block=block, skill_desc=skill_desc)

    @checks_flags
    def close_gripper(self, grasp: bool = True, block: bool = True, skill_desc: str = "CloseGripper") -> None:
        """Close the fingers: with `grasp` until 60 N are met, else to width 0."""
        self.goto_gripper(FC.GRIPPER_WIDTH_MIN, grasp=grasp, force=FC.GRIPPER_MAX_FORCE, block=block, skill_desc=skill_desc)

    @checks_flags
    def home_gripper(self, block: bool = True, skill_desc: str = "HomeGripper") -> None:
        """Let the hand find its largest width; after fingers were changed."""
        self._hand.command(hand.HOMING, block, ignore_errors=True)

    @checks_flags
    def stop_gripper(self, block: bool = True, skill_desc: str = "StopGripper") -> None:
        """Stop the fingers where they are; what they hold they press no longer."""
        self._hand.command(hand.STOP, block, ignore_errors=True)

    # --- reads ---------------------------------------------------------------------------------------------------

    def get_arm_state(self) -> proto.ArmState:
        """Return everything that the server knows of the arm now: the newest state, with its age (s).

        The server is asked, but where reads follow each other within 50 ms: then its published states are listened to, and the
        newest is returned if it is no older than 3 ms.
        """
        # What ended a call may be newer than what has been published.
        return self._reader.read(after_ns=self.last_skill_result.last_state.time_ns)

    def states(self, rate: float = 1000, fields: Sequence[str] = ()) -> StateStream:
        """Return the arm's states from now on, between skills and in error as well.

        Args:
            rate: of them, 1/s: 1000, one for each cycle, or that divided by a whole number.
            fields: of proto.ArmState, those that are sent; none: all.

        Example:
            >>> with fa.states(rate=100, fields=["robot.q", "robot.dq"]) as states:
            ...     print(states.receive().robot.q)
        """
        endpoint = self._server.current_welcome().state_endpoint
        return StateStream(endpoint, rate=number("rate", rate), fields=fields, key=self._server.key)

    def wait_for(self, condition: Callable[[proto.ArmState], bool], timeout: float | None = None) -> proto.ArmState:
        """Wait until a state fulfils a condition, which is asked of each cycle's; return that state.

        Raises FrankaArmCommException when none does within `timeout` (s; None: any time), or when no states come.

        Example:
            >>> fa.wait_for(lambda state: max(state.robot.dq) < 0.05, timeout=10)
        """
        timeout = None if timeout is None else number("timeout", timeout)
        return states.wait_for(self._server.current_welcome().state_endpoint, condition, timeout, self._server.key)

    def get_robot_state(self) -> RobotState:
        """Return the newest state as a dictionary of the published interface; its attribute `age` is how old it is (s).

        Keys: pose and pose_desired (franka_tool_base to world), joints, joints_desired (rad), joint_velocities (rad/s),
        joint_torques (Nm), joint_torques_derivative (Nm/s), ee_force_torque (N, Nm, base axes), cartesian_velocities (m/s, rad/s;
        as commanded, and where the robot is commanded none as measured), gripper_width (m; NaN without a hand), gripper_is_grasped.
        """
        return states.as_dictionary(self.get_arm_state())

    @checks_flags
    def get_pose(self, include_tool_offset: bool = True) -> RigidTransform:
        """Return the measured pose of the tool; franka_tool to world.

        With `include_tool_offset=False` that of the robot's end-effector frame, franka_tool_base to world.
        """
        base = franka_pose_to_rigid_transform(self.get_arm_state().robot.O_T_EE)
        return base * self._tool_delta_pose if include_tool_offset else base

    def get_joints(self) -> np.ndarray:
        """Return the joint positions, rad, (7,)."""
        return np.array(self.get_arm_state().robot.q)

    def get_joint_velocities(self) -> np.ndarray:
        """Return the joint velocities, rad/s, (7,)."""
        return np.array(self.get_arm_state().robot.dq)

    def get_joint_torques(self) -> np.ndarray:
        """Return the measured torques, gravity included, Nm, (7,)."""
        return np.array(self.get_arm_state().robot.tau_J)

    def get_ee_force_torque(self) -> np.ndarray:
        """Return the estimated external wrench on the stiffness frame, base axes, N and Nm, (6,)."""
        return np.array(self.get_arm_state().robot.O_F_ext_hat_K)

    def get_gripper_width(self) -> float:
        """Return the width between the fingers, m."""
        return self._hand.state(self.get_arm_state()).width

    def get_gripper_is_grasped(self) -> bool:
        """Return whether the hand holds an object."""
        return self._hand.state(self.get_arm_state()).is_grasped

    def get_finger_poses(self) -> tuple[RigidTransform, RigidTransform]:
        """Return the poses of the finger tips, finger_left (along +y of the tool) and finger_right to world."""
        state = self.get_arm_state()
        tool = franka_pose_to_rigid_transform(state.robot.O_T_EE).matrix @ self._tool_delta_pose.matrix
        return poses.of_fingers(tool, self._hand.state(state).width)

    @property
    def last_skill_result(self) -> proto.SkillResult:
        """How the last skill of this client that has ended did so: ending, time, stretch, errors, last state."""
        return self._motions.last_result

    # --- tool ----------------------------------------------------------------------------------------------------

    def set_tool_delta_pose(self, tool_delta_pose: RigidTransform) -> None:
        """Say where the tool is on the robot's end-effector frame; franka_tool to franka_tool_base.

        Kept in this object; every later pose is of that tool.
        """
        poses.check("tool_delta_pose", tool_delta_pose, (TOOL, TOOL_BASE))
        self._tool_delta_pose = tool_delta_pose.copy()

    def get_tool_base_pose(self) -> RigidTransform:
        """Return what `set_tool_delta_pose` has set; franka_tool to franka_tool_base."""
        return self._tool_delta_pose.copy()

    # --- kinematics ----------------------------------------------------------------------------------------------

    @property
    def limits(self) -> Limits:
        """Of the connected arm: the range of its joints, and what bounds its motions and can be reduced; see frankapy.limits."""

        def change(limits: proto.ChangeLimits) -> proto.LimitsInForce:
            return self._server.ask(proto.Request(change_limits=limits)).limits

        return Limits(self._server.welcome, change, lambda: self.get_arm_state().robot)

    def is_joints_reachable(self, joints: Numbers) -> bool:
        """Return whether `goto_joints` finds joints (rad, (7,)) inside the range of the connected arm; offline, of the FER.

        Towards the limits of an FR3 a motion has to end a little before them, by up to 0.05 rad. Walls are not asked.
        """
        lower, upper = self._rest_range()
        joints = vector("joints", joints, 7)
        return bool(np.all((lower < joints) & (joints < upper)))

    def ik(self, tool_pose: RigidTransform, near: Numbers | None = None) -> np.ndarray:
        """Return joints (rad, (7,)) that bring the tool to a pose, as `goto_pose_by_joints` goes to.

        Of all such joints, those near to `near` (rad, (7,)); None: to where the arm is, offline to home. Raises
        FrankaArmArgumentError when no joints within the limits do, with how near they come.

        Example:
            >>> pose = fa.get_pose()
            >>> pose.translation[2] += 0.05
            >>> joints = fa.ik(pose)
        """
        poses.check("tool_pose", tool_pose, (TOOL, WORLD))
        now = np.array(FC.HOME_JOINTS) if self._connection is None else self.get_joints()
        flange = tool_pose.matrix @ np.linalg.inv(self._tool_on_flange())
        return reach.joints_for(flange, now if near is None else vector("near", near, 7), *self._rest_range())

    def get_jacobian(self, joints: Numbers) -> np.ndarray:
        """Return the Jacobian of the tool in base axes at `joints` (rad, (7,)); (6, 7), linear over angular."""
        return kinematics.jacobian(vector("joints", joints, 7), self._tool_on_flange())

    @checks_flags
    def get_links_transforms(self, joints: Numbers, use_rigid_transforms: bool = False) -> np.ndarray | list[RigidTransform]:
        """Return the frames of the links at `joints` (rad, (7,)), in the base.

        As matrices, (12, 4, 4): base, joints 1 to 7, flange, twice the tool base, tool. Tool base and tool have the
        flange's axes there, which are turned by 45 degrees about z from those of `get_pose`. With
        `use_rigid_transforms` a list of 11: panda_link1 to panda_link8, panda_hand, franka_tool_base, franka_tool, the
        last three with the hand's axes, so that the last one agrees with `get_pose`.
        """
        links = poses.of_links if use_rigid_transforms else poses.link_matrices
        return links(vector("joints", joints, 7), self._tool_base_on_flange(), self._tool_delta_pose.matrix)

    # --- boxes ---------------------------------------------------------------------------------------------------

    @checks_flags
    def get_collision_boxes_poses(
        self, joints: Numbers | None = None, use_rigid_transforms: bool = False
    ) -> list[np.ndarray] | list[RigidTransform]:
        """Return the poses of the arm's boxes (FrankaConstants.COLLISION_BOX_SHAPES) in the base.

        At `joints` (rad, (7,)), None: where the arm is. As matrices (4, 4), or as poses from box0 and so on to world.
        """
        boxes = list(collision_boxes.poses_at(self._joints_or_now(joints)))
        return [poses.in_world(box, f"box{i}") for i, box in enumerate(boxes)] if use_rigid_transforms else boxes

    def check_box_collision(self, box: Numbers, joints: Numbers | None = None) -> bool:
        """Return whether the arm meets a box: centre x, y, z, roll, pitch, yaw about fixed axes, size; m, rad, (9,).

        In place of the angles there may be a quaternion w, x, y, z: (10,). At `joints` (rad, (7,)), None: where the arm is.
        """
        return collision_boxes.arm_meets(box, self._joints_or_now(joints))

    def is_joints_in_collision_with_boxes(self, joints: Numbers | None = None, boxes: Any = None) -> bool:
        """Return whether the arm meets any of some boxes (see `check_box_collision`); None: the WORKSPACE_WALLS.

        At `joints` (rad, (7,)), None: where the arm is.
        """
        placed = collision_boxes.as_boxes(FC.WORKSPACE_WALLS if boxes is None else boxes)
        return collision_boxes.arm_meets_any(placed, self._joints_or_now(joints))

    # --- of scripts for ROS --------------------------------------------------------------------------------------

    def publish_sensor_values(self, sensor_values: SensorDataGroup | None = None) -> bool | None:
        """Send sensor messages into the running skill (see frankapy.proto_utils); None: nothing, which returns False."""
        if sensor_values is None:
            return False
        if self._connection is not None:
            if self._sensors is None:
                self._sensors = self.publisher(_SENSOR_TOPIC)
            for message in messages_of(sensor_values):
                self._sensors.publish(message)
        return None

    def publish_sensor_data(self, msg: SensorDataGroup) -> None:
        """Send sensor messages into the running skill (see frankapy.proto_utils)."""
        self.publish_sensor_values(msg)

    def publish_joints(self, joints: Numbers | None = None) -> None:
        """Publish joints (rad, (7,); None: those of now) for rviz, under franka_virtual_joints_<number of the arm>.

        Where scripts run without rospy there is nobody who would look.
        """
        ros_utils.publish_joints(self._joints_or_now(joints), self._robot_num)

    def publish_collision_boxes(self, joints: Numbers | None = None) -> None:
        """Publish the arm's boxes at `joints` (rad, (7,); None: those of now) for rviz, as BoxesPublisher does."""
        ros_utils.publish_arm_boxes(self._joints_or_now(joints), self._robot_num)

    # --- of scripts for ROS 2 ------------------------------------------------------------------------------------

    def get_time(self) -> float:
        """Return the time of this computer, s since 1970."""
        return time.time()

    def log_info(self, msg: str) -> None:
        """Write a line into the log of frankapy, or where that shows none of its kind to the terminal."""
        if logger.isEnabledFor(logging.INFO):
            logger.info(msg)
        else:
            print(f"[INFO] {msg}", flush=True)

    # --- inside --------------------------------------------------------------------------------------------------

    def _run(
        self, trajectory: Message, controller: Message, ends: Sequence[Message], skill_desc: str, block: bool, ignore_errors: bool,
        robot_controller: str = "auto", preempt: bool = False, speed: float | None = None, start_time: float | None = None,
        led: bool = False, publishers: Mapping[str, Sequence[str]] | None = None, recover: str | int | None = None,
    ) -> proto.SkillResult | None:  # fmt: skip
        """Send a skill; where asked to, wait for its end and return its result."""
        speed = self.speed if speed is None else number("speed", speed)
        under = self._policy(recover, ignore_errors)
        skill = make_skill(trajectory, controller, ends, skill_desc, robot_controller, speed, start_time, publishers, under)
        self._reader.stop_listening()
        duration = getattr(trajectory, "duration", 0.0) / (speed or 1)
        return self._motions.run(skill, duration, block, ignore_errors, preempt, led)

    def _policy(self, recover: str | int | None, ignore_errors: bool) -> proto.RecoveryPolicy:
        if recover is None:
            recover = self._recovery
        return policy(recover if recover is not None else "itself" if ignore_errors else "ask")

    def _joints_or_now(self, joints: Numbers | None) -> np.ndarray:
        return self.get_joints() if joints is None else vector("joints", joints, 7)

    def _rest_range(self) -> tuple[np.ndarray, np.ndarray]:
        return reach.rest_range(None if self._connection is None else self._connection.welcome.limits)

    def _tool_base_on_flange(self) -> np.ndarray:
        """Return the end-effector frame that the robot has now, (4, 4): F_T_EE; offline that of the Franka hand."""
        if self._connection is None:
            return reach.offline_tool()
        return np.reshape(self.get_arm_state().robot.F_T_EE, (4, 4)).T

    def _tool_on_flange(self) -> np.ndarray:
        return self._tool_base_on_flange() @ self._tool_delta_pose.matrix

    def _start_of_next(self) -> np.ndarray:
        """Return the end-effector frame in the base where the next motion begins: (4, 4); in a sequence where the one before ends."""
        started = self._motions.before_next()
        if started is None:
            return self.get_pose(include_tool_offset=False).matrix
        if started.goal_q:
            return poses.tool_frames(np.array(started.goal_q), self._tool_base_on_flange(), np.eye(4))[1]
        return np.reshape(started.goal_O_T_EE, (4, 4)).T

    def _check_walls(self, what: str, **points: np.ndarray) -> None:
        collision_boxes.check(FC.WORKSPACE_WALLS, what, **points)

    def _check_walls_at(self, what: str, joints: np.ndarray) -> None:
        tool = poses.tool_frames(joints, self._tool_base_on_flange(), self._tool_delta_pose.matrix)[-1]
        self._check_walls(what, arm=collision_boxes.corners_at(joints), tool=tool[None, :3, 3])

    @property
    def _in_skill(self) -> bool:
        """Whether a skill was sent and not waited for; scripts set it to False to send another one, which takes over from it."""
        return self._motions.running is not None and not self._motions.running.forgotten

    @_in_skill.setter
    def _in_skill(self, there_is_one: bool) -> None:
        if not there_is_one and self._motions.running is not None:
            self._motions.running.forgotten = True
