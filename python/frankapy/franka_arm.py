"""FrankaArm: one arm, commanded through franka-interface."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import time
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from types import TracebackType
from typing import Any

import numpy as np
from google.protobuf.message import Message

from frankapy import collision_boxes, dmp, kinematics, proto
from frankapy.connection import Connection
from frankapy.demonstration import Demonstration
from frankapy.exceptions import (
    FrankaArmArgumentError,
    FrankaArmCommException,
    FrankaArmException,
)
from frankapy.franka_constants import FrankaConstants as FC
from frankapy.hand import Hand
from frankapy.interrupts import stop_on_interrupt
from frankapy.motions import Motions, MotionSequence
from frankapy.parts import Kind, describe
from frankapy.progress import progress
from frankapy.proto_utils import messages_of
from frankapy.rigid_transform import RigidTransform
from frankapy.ros_messages import SensorDataGroup
from frankapy.ros_utils import BoxesPublisher
from frankapy.sensors import SensorPublisher
from frankapy.skill import make_skill
from frankapy.states import NewestState, StateStream
from frankapy.utils import franka_pose_to_rigid_transform
from frankapy.validation import checks_flags, number, numbers, table, text, validate, vector, whole
from frankapy.walls import Walls

logger = logging.getLogger("frankapy")

_TOOL, _TOOL_BASE, _WORLD = "franka_tool", "franka_tool_base", "world"
_MAX_BLEND = 10.0  # s
_SENSOR_TOPIC = FC.DEFAULT_SENSOR_PUBLISHER_TOPIC
_QUATERNION_TYPED = 0.05  # by which the norm of one that was typed in may differ from 1
_NEW = 0.003  # s, of a published state that counts as now
_SOON = 0.05  # s, between reads for which states are listened to
_RECORDING_TIME = 5.0  # s for the server to begin or to end a file
_CARTESIAN_MODES = (3, 4)  # of ArmState.robot.motion_generator_mode: pose and velocity
_COROUTINE_TICK = 0.002  # s
_LONGEST_DESCRIPTION = 1000  # bytes; it goes with every state


def _unpacked(part: Any) -> Message:
    message: Message = getattr(proto, part.TypeName().rsplit(".", 1)[-1])()
    part.Unpack(message)
    return message


def _any_of(until: Message | Sequence[Message]) -> list[Message]:
    """Return terminations as the server takes them: any of them."""
    terminations: list[Message] = []
    if not isinstance(until, (Message, Iterable)):
        raise FrankaArmArgumentError(f"until is {until!r}: expected terminations, such as Time(4)")
    for end in [until] if isinstance(until, Message) else list(until):
        if isinstance(end, proto.AnyOf):
            terminations += [_unpacked(part) for part in end.of]
        else:
            terminations.append(end)
    return terminations


class FrankaArm:
    """One Franka arm with its hand.

    Poses are RigidTransforms in metres; `franka_tool` is the point that is moved, `franka_tool_base` the robot's
    end-effector frame, `world` the base of the arm. Arrays may be lists, tuples or ndarrays. A motion that is refused
    raises FrankaArmArgumentError (a ValueError) before anything moves. One client commands an arm at a time, the
    others may read, and stop it.

    Example:
        >>> from frankapy import FrankaArm
        >>> fa = FrankaArm()
        >>> fa.reset_joints()
        >>> pose = fa.get_pose()
        >>> pose.translation[2] -= 0.1
        >>> fa.goto_pose(pose, duration=2)
    """

    def __init__(
        self,
        rosnode_name: str = "franka_arm_client",
        ros_log_level: int = 2,
        robot_num: int = 1,
        with_gripper: bool = True,
        old_gripper: bool = False,
        offline: bool = False,
        init_node: bool = True,
        *,
        server: str | None = None,
        node_name: str | None = None,
        init_rclpy: bool = True,
    ) -> None:
        """Connect to the server of an arm and wait until it is there, at most 10 s.

        `robot_num` is the number of the arm in the server's configuration, from 1. `server` is host or host:port of
        franka-interface; without it the environment variable FRANKA_INTERFACE_SERVER, then 127.0.0.1:5757.
        `with_gripper=False` is for an arm without a hand. `offline=True` needs no server: reads give zeros, motions are
        checked and not made. The names of nodes, their log level and `old_gripper` are accepted and mean nothing here.

        Raises FrankaArmCommException when there is no server, no arm, or another version.
        """
        self._offline = bool(offline)
        self._with_gripper = bool(with_gripper)
        self._tool_delta_pose = RigidTransform(np.eye(3), np.zeros(3), from_frame=_TOOL, to_frame=_TOOL_BASE)
        self._speed = 1.0
        self._connection: Connection | None = None
        self._motions: Motions | None = None
        self._hand: Hand | None = None
        self._newest: tuple[int, str, NewestState] | None = None  # of this process, at this endpoint
        self._read_time = -math.inf  # of the last read
        self._sensors: SensorPublisher | None = None
        self._server_name, self._robot_num = server, whole("robot_num", robot_num)
        if self._offline:
            logger.warning("FrankaArm is offline: reads give zeros, and nothing moves.")
            return
        self._connection = Connection(server, self._robot_num)
        self._finalizer = weakref.finalize(self, self._connection.close)
        self._motions, self._hand = Motions(self._connection), Hand(self._connection)
        stop_on_interrupt(self._connection)
        self._connection.wait_until_ready(recover=False)

    def __repr__(self) -> str:
        if self._connection is None:
            return "FrankaArm(offline)"
        welcome = self._connection.welcome
        return f"FrankaArm({welcome.arm}: {welcome.model.upper()} at {welcome.address}, protocol version {welcome.protocol_version})"

    def close(self) -> None:
        """Leave the arm to others. A skill that still runs goes on to its own end."""
        self._stop_listening()
        if self._connection is not None:
            self._connection.close()

    def __enter__(self) -> FrankaArm:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # --- speed ---------------------------------------------------------------------------------------------------

    @property
    def speed(self) -> float:
        """Of the clock of all motions that are called for from now on, 0.01 to 1: at 0.2 each takes five times as long.

        Terminations that name a time of the skill, as `Time(4)`, keep theirs.
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
        """Wait until the arm can move; an arm in error is told to recover.

        `timeout` in s; None is 10 s. Raises FrankaArmCommException when it cannot move by then, with the reason.
        """
        timeout = FC.DEFAULT_FRANKA_INTERFACE_TIMEOUT if timeout is None else number("timeout", timeout)
        if not self._offline:
            self._server.wait_until_ready(timeout)

    def wait_for_skill(self) -> None:
        """Return when the skill that was last sent has ended, however it ended."""
        if self._motions is not None and (motion := self._motions.running) is not None:
            self._motions.wait(motion, ignore_errors=True)

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
        import asyncio  # which takes its time

        motions = self._motions
        motion = None if motions is None else motions.running
        if motions is not None and motion is not None:
            try:
                while motion.result(timeout=0) is None:
                    await asyncio.sleep(_COROUTINE_TICK)
            except asyncio.CancelledError:
                self._server.send(proto.Request(stop_skill=proto.StopSkill()))
                raise
            except FrankaArmException:
                pass  # found again below
            await asyncio.to_thread(motions.wait, motion, ignore_errors)
        return self.last_skill_result

    @checks_flags
    def is_skill_done(self, ignore_errors: bool = True) -> bool:
        """Return whether the skill that was last sent has ended; True when there is none.

        With `ignore_errors=False` a skill that failed raises FrankaArmException. Where the connection was lost meanwhile this
        raises FrankaArmCommException, once.
        """
        return self._motions is None or self._motions.is_done(ignore_errors)

    def stop_skill(self) -> None:
        """Bring the arm to rest, whoever moves it, and wait until the skill of this client has ended."""
        if self._offline:
            return
        self._server.ask(proto.Request(stop_skill=proto.StopSkill()))
        self.wait_for_skill()

    def wait_for_gripper(self) -> None:
        """Return when the gripper command that was last sent has ended."""
        if self._hand is not None:
            self._hand.wait()

    def is_gripper_skill_done(self) -> bool:
        """Return whether the gripper command that was last sent has ended."""
        return self._hand is None or self._hand.is_done()

    # --- motions -------------------------------------------------------------------------------------------------

    @checks_flags
    def goto_joints(
        self,
        joints: Any,
        duration: float = 5,
        use_impedance: bool = False,
        dynamic: bool = False,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        cartesian_impedances: Sequence[float] | None = None,
        joint_impedances: Sequence[float] | None = None,
        k_gains: Sequence[float] | None = None,
        d_gains: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        ignore_virtual_walls: bool = False,
        skill_desc: str = "GoToJoints",
    ) -> None:
        """Move the joints along minimum-jerk curves.

        Returns when the commanded joints are there (with `block=False` when the server has taken the skill).

        Args:
            joints: goal, rad, (7,).
            duration: s; a motion that is too fast for the arm takes longer.
            use_impedance: False: the robot's own joint impedance holds the arm to the curve. True: the server's.
            dynamic: go where messages lead that are published over FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC while
                this runs: JointPositionSensorMessage, JointChunk and the like (see `publisher`). The goal is checked, and then
                not gone to; the skill is not waited for, and ends after `duration` and `buffer_time`, or by a
                ShouldTerminateSensorMessage.
            buffer_time: s after the end of the curve at which the skill ends in any case.
            force_thresholds: external forces and torques on the tool, N and N m (6,), above which the robot calls it
                contact and the motion ends where it is. Then the goal being reached no longer ends it: `duration` and
                `buffer_time` do.
            torque_thresholds: external torques of the joints, N m (7,), as force_thresholds; contact of the tool ends it.
            cartesian_impedances: of the robot's own controller, 3 N/m and 3 Nm/rad; without `use_impedance`.
            joint_impedances: of the robot's own controller, Nm/rad, (7,); without `use_impedance`.
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
        self._check_reachable(joints)
        if not ignore_virtual_walls:
            tool = self._links(joints)[-1]
            self._check_walls("goto_joints", arm=collision_boxes.corners_at(joints), tool=tool[None, :3, 3])
        if dynamic:
            controller = _joint_controller(True, cartesian_impedances, joint_impedances, k_gains, d_gains)
            ends = _stream_ends(duration, buffer_time, force_thresholds, torque_thresholds)
            self._run(proto.StreamJoint(topic=_SENSOR_TOPIC), controller, ends, skill_desc, False, ignore_errors, speed=1)
            return
        self._run(
            proto.MinJerkJoint(q=joints, duration=number("duration", duration)),
            _joint_controller(use_impedance, cartesian_impedances, joint_impedances, k_gains, d_gains),
            [_end(proto.FinalJoint(), force_thresholds, torque_thresholds), _time_after(buffer_time)],
            skill_desc,
            block,
            ignore_errors,
        )

    @checks_flags
    def goto_pose(
        self,
        tool_pose: RigidTransform,
        duration: float = 3,
        use_impedance: bool = True,
        dynamic: bool = False,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        cartesian_impedances: Sequence[float] | None = None,
        joint_impedances: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        ignore_virtual_walls: bool = False,
        skill_desc: str = "GoToPose",
    ) -> None:
        """Move the tool to a pose: minimum-jerk along a line, with the shortest rotation.

        Returns when the measured pose is within 0.1 mm and 0.1 mrad of the goal, or `buffer_time` after the end of the
        curve (with `block=False` when the server has taken the skill).

        Args:
            tool_pose: goal, from franka_tool to world.
            duration: s; a motion that is too fast for the arm takes longer.
            use_impedance: True: a spring between tool and curve, 600 N/m and 50 Nm/rad, by the server. False: the
                robot's own impedance control.
            dynamic: go where messages lead that are published over FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC while
                this runs: PosePositionSensorMessage of the tool base, PoseChunk and the like (see `publisher`);
                CartesianImpedanceSensorMessage sets the spring anew. The goal is checked, and then not gone to; the skill
                is not waited for, and ends after `duration` and `buffer_time`, or by a ShouldTerminateSensorMessage.
            buffer_time: s.
            force_thresholds: external forces and torques on the tool, N and N m (6,), above which the robot calls it
                contact and the motion ends where it is. Then the goal being reached no longer ends it: `duration` and
                `buffer_time` do.
            torque_thresholds: external torques of the joints, N m (7,), as force_thresholds; contact of the tool ends it.
            cartesian_impedances: 3 N/m and 3 Nm/rad, of whichever controller.
            joint_impedances: of the robot's own controller, Nm/rad, (7,); without `use_impedance`; goes before
                `cartesian_impedances`.
            block: whether to wait for the end.
            ignore_errors: True: a failure is logged and recovered from. False: it raises FrankaArmException.
            ignore_virtual_walls: do not refuse goals where tool base or tool is behind FrankaConstants.WORKSPACE_WALLS.
            skill_desc: goes into states and logs.

        Example:
            >>> pose = fa.get_pose()
            >>> pose.translation[0] += 0.05
            >>> fa.goto_pose(pose, duration=2)
        """
        _check_pose("tool_pose", tool_pose, (_TOOL, _WORLD))
        goal = tool_pose.matrix @ self._tool_delta_pose.inverse().matrix
        if not ignore_virtual_walls:
            self._check_walls("goto_pose", tool_base=goal[None, :3, 3], tool=tool_pose.matrix[None, :3, 3])
        if dynamic:
            controller: Any = _pose_controller(True, cartesian_impedances, joint_impedances)
            controller.topic = _SENSOR_TOPIC
            ends = _stream_ends(duration, buffer_time, force_thresholds, torque_thresholds)
            self._run(proto.StreamPose(topic=_SENSOR_TOPIC), controller, ends, skill_desc, False, ignore_errors, speed=1)
            return
        self._run(
            proto.MinJerkPose(
                position=goal[:3, 3], quaternion=_quaternion(goal), duration=number("duration", duration)
            ),
            _pose_controller(use_impedance, cartesian_impedances, joint_impedances),
            [_end(proto.FinalPose(judged=proto.FinalJoint.ARM), force_thresholds, torque_thresholds), _time_after(buffer_time)],
            skill_desc,
            block,
            ignore_errors,
        )

    @checks_flags
    def goto_pose_delta(
        self,
        delta_tool_pose: RigidTransform,
        duration: float = 3,
        use_impedance: bool = True,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        cartesian_impedances: Sequence[float] | None = None,
        joint_impedances: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        ignore_virtual_walls: bool = False,
        skill_desc: str = "GoToPoseDelta",
    ) -> None:
        """Move the tool by a difference from where it is.

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
        _check_pose("delta_tool_pose", delta_tool_pose, (_TOOL, _TOOL), (_WORLD, _WORLD))
        delta = delta_tool_pose.matrix
        in_tool = delta_tool_pose.from_frame == _TOOL
        if in_tool:
            tool = self._tool_delta_pose.matrix
            delta = tool @ delta @ np.linalg.inv(tool)
        if not ignore_virtual_walls and not self._offline:
            now = self.get_pose(include_tool_offset=False).matrix
            goal = now @ delta
            if not in_tool:
                goal[:3, 3] = now[:3, 3] + delta[:3, 3]
            tool = goal @ self._tool_delta_pose.matrix
            self._check_walls("goto_pose_delta", tool_base=goal[None, :3, 3], tool=tool[None, :3, 3])
        frame = proto.RelativeMinJerkPose.END_EFFECTOR if in_tool else proto.RelativeMinJerkPose.BASE
        self._run(
            proto.RelativeMinJerkPose(
                translation=delta[:3, 3],
                quaternion=_quaternion(delta),
                frame=frame,
                duration=number("duration", duration),
            ),
            _pose_controller(use_impedance, cartesian_impedances, joint_impedances),
            [_end(proto.FinalPose(judged=proto.FinalJoint.ARM), force_thresholds, torque_thresholds), _time_after(buffer_time)],
            skill_desc,
            block,
            ignore_errors,
        )

    @checks_flags
    def reset_joints(
        self, duration: float = 5, block: bool = True, ignore_errors: bool = True, skill_desc: str = ""
    ) -> None:
        """Move to FrankaConstants.HOME_JOINTS, as `goto_joints` does."""
        self.goto_joints(
            FC.HOME_JOINTS, duration=duration, block=block, ignore_errors=ignore_errors, skill_desc=skill_desc
        )

    @checks_flags
    def reset_pose(
        self, duration: float = 5, block: bool = True, ignore_errors: bool = True, skill_desc: str = ""
    ) -> None:
        """Move to FrankaConstants.HOME_POSE, as `goto_pose` does."""
        self.goto_pose(FC.HOME_POSE, duration=duration, block=block, ignore_errors=ignore_errors, skill_desc=skill_desc)

    @checks_flags
    def execute_joint_dmp(
        self,
        joint_dmp_info: Mapping[str, Any],
        duration: float,
        initial_sensor_values: Any = None,
        use_impedance: bool = False,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        cartesian_impedances: Sequence[float] | None = None,
        joint_impedances: Sequence[float] | None = None,
        k_gains: Sequence[float] | None = None,
        d_gains: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        skill_desc: str = "JointDmp",
    ) -> None:
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
        self._run(
            proto.JointDmp(
                **_dmp("joint_dmp_info", joint_dmp_info, 7),
                initial_sensor_values=_sensor_values(initial_sensor_values, joint_dmp_info, 1),
                duration=number("duration", duration),
            ),
            _joint_controller(use_impedance, cartesian_impedances, joint_impedances, k_gains, d_gains),
            [_time_after(buffer_time), *_contact(force_thresholds, torque_thresholds)],
            skill_desc,
            block,
            ignore_errors,
        )

    @checks_flags
    def execute_pose_dmp(
        self,
        pose_dmp_info: Mapping[str, Any],
        duration: float,
        use_goal_formulation: bool = False,
        initial_sensor_values: Any = None,
        orientation_only: bool = False,
        position_only: bool = False,
        ee_frame: bool = False,
        use_impedance: bool = True,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        cartesian_impedances: Sequence[float] | None = None,
        joint_impedances: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        skill_desc: str = "PoseDmp",
    ) -> None:
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
        dimensions = 3 if orientation_only or position_only else 6
        kind = proto.GoalPoseDmp if use_goal_formulation else proto.PoseDmp
        self._run(
            kind(
                **_dmp("pose_dmp_info", pose_dmp_info, dimensions),
                initial_sensor_values=_sensor_values(initial_sensor_values, pose_dmp_info, dimensions),
                duration=number("duration", duration),
                position_only=bool(position_only),
                orientation_only=bool(orientation_only),
                ee_frame=bool(ee_frame),
            ),
            _pose_controller(use_impedance, cartesian_impedances, joint_impedances),
            [_time_after(buffer_time), *_contact(force_thresholds, torque_thresholds)],
            skill_desc,
            block,
            ignore_errors,
        )

    @checks_flags
    def execute_quaternion_pose_dmp(
        self,
        position_dmp_info: Mapping[str, Any],
        quat_dmp_info: Mapping[str, Any],
        duration: float,
        goal_quat: Sequence[float],
        goal_quat_time: float,
        use_goal_formulation: bool = False,
        initial_sensor_values: Any = None,
        ee_frame: bool = False,
        use_impedance: bool = True,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        cartesian_impedances: Sequence[float] | None = None,
        joint_impedances: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        skill_desc: str = "QuaternionPoseDmp",
    ) -> None:
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
        goal = vector("goal_quat", goal_quat, 4)
        norm = float(np.linalg.norm(goal))
        if abs(norm - 1) > _QUATERNION_TYPED:
            raise FrankaArmArgumentError(f"goal_quat has the norm {norm:.6g}: expected w, x, y, z of a unit quaternion")
        quat = _dmp("quat_dmp_info", quat_dmp_info, 3)
        del quat["tau"]
        self._run(
            proto.QuaternionPoseDmp(
                **{f"position_{key}": value for key, value in _dmp("position_dmp_info", position_dmp_info, 3).items()},
                **{f"quat_{key}": value for key, value in quat.items()},
                initial_sensor_values=_sensor_values(initial_sensor_values, position_dmp_info, 3),
                goal_quat=goal / norm,
                goal_quat_time=number("goal_quat_time", goal_quat_time),
                duration=number("duration", duration),
                ee_frame=bool(ee_frame),
            ),
            _pose_controller(use_impedance, cartesian_impedances, joint_impedances),
            [_time_after(buffer_time), *_contact(force_thresholds, torque_thresholds)],
            skill_desc,
            block,
            ignore_errors,
        )

    @checks_flags
    def run_guide_mode(self, duration: float = 10, block: bool = True, skill_desc: str = "GuideMode") -> None:
        """Let the arm be led by hand for `duration` (s): gravity is compensated, a little dry friction holds what nobody leads.

        Ends early by `stop_skill`. The arm then holds itself where it is.
        """
        # The duration is the person's, whatever the speed of motions.
        self._run(
            proto.StayJoint(duration=number("duration", duration)),
            proto.FreeDrive(),
            [proto.Time(after_trajectory=0)],
            skill_desc,
            block,
            ignore_errors=True,
            speed=1,
        )

    @checks_flags
    def selective_guidance_mode(
        self,
        duration: float = 5,
        use_joints: bool = False,
        use_impedance: bool = False,
        use_ee_frame: bool = False,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        cartesian_impedances: Sequence[float] | None = None,
        joint_impedances: Sequence[float] | None = None,
        k_gains: Sequence[float] | None = None,
        d_gains: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        ignore_virtual_walls: bool = False,
        skill_desc: str = "SelectiveGuidance",
    ) -> None:
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
        duration = number("duration", duration)
        stay: Message = proto.StayJoint(duration=duration) if use_joints else proto.StayPose(duration=duration)
        controller: Any
        if use_joints:
            controller = _joint_controller(use_impedance, cartesian_impedances, joint_impedances, k_gains, d_gains)
        else:
            controller = _pose_controller(use_impedance, cartesian_impedances, joint_impedances)
            if use_impedance and use_ee_frame:
                controller.frame = proto.CartesianImpedance.END_EFFECTOR
        ends = [_time_after(buffer_time), *_contact(force_thresholds, torque_thresholds)]
        self._run(stay, controller, ends, skill_desc, block, ignore_errors, speed=1)

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
        rows: list[proto.ArmState] = []
        with self.states(fields=["robot.message_id", "robot.q", "robot.O_T_EE", "skill_id"]) as states:
            states.receive()  # the server knows of this reader: from here on none is missed
            if guidance:
                self.selective_guidance_mode(duration, block=False, skill_desc=skill_desc, **guidance)
            else:
                self.run_guide_mode(duration, block=False, skill_desc=skill_desc)
            motion = None if self._motions is None else self._motions.running
            if motion is None:
                raise FrankaArmException("This FrankaArm is offline: there is no arm that could be led.")
            try:
                with progress(duration, "demonstrate", unit="s") as bar:
                    skill = motion.id
                    for state in states:
                        if state.skill_id == skill:
                            rows.append(state)
                            bar.update(0.001)
                        elif rows:
                            break
            except KeyboardInterrupt:
                self.stop_skill()
        self.wait_for_skill()
        if len(rows) < 2:
            raise FrankaArmException("No states have come: `frankapy status` tells why.")
        return Demonstration.of_states(
            np.array([state.robot.message_id for state in rows]) * 1e-3,
            np.array([state.robot.q for state in rows]),
            np.array([state.robot.O_T_EE for state in rows]),
        )

    @checks_flags
    def execute_joint_velocities(
        self,
        joint_velocities: Any,
        joint_accelerations: Any,
        duration: float = 5,
        dynamic: bool = False,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        cartesian_impedances: Sequence[float] | None = None,
        joint_impedances: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        ignore_virtual_walls: bool = False,
        skill_desc: str = "ExecuteJointVelocities",
    ) -> None:
        """Turn the joints with constant velocities for `duration`, from rest to rest, under the robot's own impedance control.

        Args:
            joint_velocities: rad/s (7,).
            joint_accelerations: rad/s² (7,), at both ends; all 0: half of what the arm can do.
            duration: s, with both ends.
            dynamic: follow the JointVelocitySensorMessages that are published over
                FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC while this runs, and nothing else. The skill is not waited for,
                and ends after `duration` and `buffer_time`, or by a ShouldTerminateSensorMessage. Where messages cease for
                0.2 s the arm stops.
            ignore_virtual_walls: means nothing here.

        The other arguments are those of `goto_joints`.
        """
        dq = vector("joint_velocities", joint_velocities, 7)
        ddq = _accelerations("joint_accelerations", joint_accelerations, dq)
        ends = _streamed_or_timed_ends(dynamic, duration, buffer_time, force_thresholds, torque_thresholds)
        self._run(
            proto.StreamJointVelocity(topic=_SENSOR_TOPIC)
            if dynamic
            else proto.JointVelocity(dq=dq, ddq=ddq, duration=number("duration", duration)),
            _internal_impedance(cartesian_impedances, joint_impedances),
            ends,
            skill_desc,
            block and not dynamic,
            ignore_errors,
        )

    @checks_flags
    def execute_cartesian_velocities(
        self,
        cartesian_velocities: Any,
        cartesian_accelerations: Any,
        duration: float = 5,
        dynamic: bool = False,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        cartesian_impedances: Sequence[float] | None = None,
        joint_impedances: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        ignore_virtual_walls: bool = False,
        skill_desc: str = "ExecuteCartesianVelocities",
    ) -> None:
        """Move the end effector with a constant velocity, as `execute_joint_velocities` turns the joints.

        Args:
            cartesian_velocities: along and about the axes of the base, m/s and rad/s (6,).
            cartesian_accelerations: m/s² and rad/s² (6,), at both ends; all 0: half of what the arm can do.
            duration: s, with both ends.
            dynamic: as there, by CartesianVelocitySensorMessages.
            ignore_virtual_walls: means nothing here.

        The other arguments are those of `goto_pose`.
        """
        twist = vector("cartesian_velocities", cartesian_velocities, 6)
        acceleration = _accelerations("cartesian_accelerations", cartesian_accelerations, twist)
        ends = _streamed_or_timed_ends(dynamic, duration, buffer_time, force_thresholds, torque_thresholds)
        self._run(
            proto.StreamCartesianVelocity(topic=_SENSOR_TOPIC)
            if dynamic
            else proto.CartesianVelocity(O_dP_EE=twist, O_ddP_EE=acceleration, duration=number("duration", duration)),
            _internal_impedance(cartesian_impedances, joint_impedances),
            ends,
            skill_desc,
            block and not dynamic,
            ignore_errors,
        )

    @checks_flags
    def apply_effector_forces_torques(
        self,
        run_duration: float,
        acc_duration: float,
        max_translation: float,
        max_rotation: float,
        forces: Any = None,
        torques: Any = None,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        skill_desc: str = "ForceTorque",
    ) -> None:
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
        force, torque = (
            np.zeros(3) if value is None else vector(name, value, 3)
            for name, value in (("forces", forces), ("torques", torques))
        )
        impulse = self._impulse(run_duration, acc_duration, force, FC.MAX_LIN_MOMENTUM)
        _within_momentum("torques", float(np.linalg.norm(torque)), impulse.duration, FC.MAX_ANG_MOMENTUM)
        impulse.torque.extend(torque)
        self._run(
            impulse,
            proto.PassThrough(
                max_translation=number("max_translation", max_translation), max_rotation=number("max_rotation", max_rotation)
            ),
            [_time_after(buffer_time), *_contact(force_thresholds, torque_thresholds)],
            skill_desc,
            block,
            ignore_errors,
            speed=1,
        )

    @checks_flags
    def apply_effector_forces_along_axis(
        self,
        run_duration: float,
        acc_duration: float,
        max_translation: float,
        forces: Any,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        skill_desc: str = "ForcesAlongAxis",
    ) -> None:
        """Let the end effector exert a force, and hold it on the line of that force with springs (600 N/m, 20 Nm/rad).

        Args:
            forces: N (3,), not all 0, along the axes of the base; its norm times run_duration at most
                FrankaConstants.MAX_LIN_MOMENTUM_CONSTRAINED.

        The other arguments are those of `apply_effector_forces_torques`.
        """
        force = vector("forces", forces, 3)
        if not force.any():
            raise FrankaArmArgumentError("forces is 0 along every axis: expected a force, as the arm is held on its line")
        self._run(
            self._impulse(run_duration, acc_duration, force, FC.MAX_LIN_MOMENTUM_CONSTRAINED),
            proto.ForceAxisImpedance(axis=force, max_translation=number("max_translation", max_translation)),
            [_time_after(buffer_time), *_contact(force_thresholds, torque_thresholds)],
            skill_desc,
            block,
            ignore_errors,
            speed=1,
        )

    @staticmethod
    def _impulse(run_duration: Any, acc_duration: Any, force: np.ndarray, most: float) -> proto.Impulse:
        duration, rise = number("run_duration", run_duration), number("acc_duration", acc_duration)
        if rise > duration / 2:
            raise FrankaArmArgumentError(
                f"acc_duration is {rise:g} s: expected at most half of run_duration, which is {duration:g} s"
            )
        _within_momentum("forces", float(np.linalg.norm(force)), duration, most)
        return proto.Impulse(force=force, acc_duration=rise, duration=duration)

    @checks_flags
    def execute_joint_torques(
        self,
        joint_torques: Any,
        selection: Sequence[float] = (0,) * 7,
        remove_gravity: Sequence[float] = (0,) * 7,
        duration: float = 5,
        dynamic: bool = False,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        k_gains: Sequence[float] | None = None,
        d_gains: Sequence[float] | None = None,
        block: bool = True,
        ignore_errors: bool = True,
        ignore_virtual_walls: bool = False,
        skill_desc: str = "ExecuteJointTorques",
    ) -> None:
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
                in 0.1 s. The skill is not waited for, and ends by a ShouldTerminateSensorMessage too.
            k_gains: stiffness of the joints that are held, Nm/rad, (7,).
            d_gains: damping of the joints that are held, Nms/rad, (7,).
            ignore_virtual_walls: means nothing here.

        The other arguments are those of `goto_joints`.

        Example:
            >>> fa.execute_joint_torques([0, 0, 0, 0, 0, 0, 0.4], selection=[0, 0, 0, 0, 0, 0, 1], duration=0.5)
        """
        self._run(
            proto.StayJoint(duration=number("duration", duration)),
            proto.PassThroughJointTorque(
                torque=vector("joint_torques", joint_torques, 7),
                selection=vector("selection", selection, 7),
                remove_gravity=vector("remove_gravity", remove_gravity, 7),
                stiffness=_given("k_gains", k_gains, 7),
                damping=_given("d_gains", d_gains, 7),
                topic=_SENSOR_TOPIC if dynamic else None,
                timeout=0,  # as ever, the last torque stays
            ),
            _streamed_or_timed_ends(dynamic, duration, buffer_time, force_thresholds, torque_thresholds),
            skill_desc,
            block and not dynamic,
            ignore_errors,
            speed=1,
        )

    @checks_flags
    def apply_joint_torques(
        self, torques: Any, duration: float, ignore_errors: bool = True, skill_desc: str = ""
    ) -> None:
        """Move nothing, as ever: scripts that call it never met an arm whose joints nobody holds.

        `execute_joint_torques` applies torques.
        """
        vector("torques", torques, 7)
        logger.warning("apply_joint_torques moves nothing, as in frankapy; execute_joint_torques applies torques")

    @checks_flags
    def run_dynamic_force_position(
        self,
        duration: float = 3,
        buffer_time: float = FC.DEFAULT_TERM_BUFFER_TIME,
        force_thresholds: Sequence[float] | None = None,
        torque_thresholds: Sequence[float] | None = None,
        position_kps_cart: Sequence[float] = (600, 600, 600, 50, 50, 50),
        force_kps_cart: Sequence[float] = (0.1,) * 6,
        position_kps_joint: Sequence[float] = (600, 600, 600, 600, 250, 150, 50),
        force_kps_joint: Sequence[float] = (0.1,) * 7,
        S: Sequence[float] = (1,) * 6,
        interpolate: bool = False,
        use_cartesian_gains: bool = True,
        ignore_errors: bool = True,
        ignore_virtual_walls: bool = False,
        skill_desc: str = "",
    ) -> None:
        """Follow poses and exert forces that are published while this runs; return when the server has taken the skill.

        Poses and forces come as ForcePositionSensorMessages, other gains as ForcePositionControllerSensorMessages, over
        FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC (see `publisher`). Until the first comes the arm stays where it is and
        exerts nothing. It ends after `duration` and `buffer_time`, or by a ShouldTerminateSensorMessage.

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
        per_joint = numbers("force_kps_joint", force_kps_joint)
        if len(per_joint) == 6:  # the default of published scripts
            per_joint = np.append(per_joint, per_joint[-1])
        self._run(
            proto.StreamForcePosition(topic=_SENSOR_TOPIC, delay=None if interpolate else 0),
            proto.ForcePosition(
                selection=vector("S", S, 6),
                use_cartesian_gains=use_cartesian_gains,
                position_kps_cart=vector("position_kps_cart", position_kps_cart, 6),
                force_kps_cart=vector("force_kps_cart", force_kps_cart, 6),
                position_kps_joint=vector("position_kps_joint", position_kps_joint, 7),
                force_kps_joint=vector("force_kps_joint", per_joint, 7),
                topic=_SENSOR_TOPIC,
            ),
            _stream_ends(duration, buffer_time, force_thresholds, torque_thresholds),
            skill_desc,
            False,
            ignore_errors,
            speed=1,
        )

    @checks_flags
    def run(
        self,
        trajectory: Message,
        controller: Message | None = None,
        until: Message | Sequence[Message] = (),
        *,
        robot_controller: str = "auto",
        speed: float | None = None,
        start_time: float | None = None,
        preempt: bool = False,
        block: bool = True,
        ignore_errors: bool = False,
        skill_desc: str = "",
    ) -> proto.SkillResult | None:
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
            skill_desc: goes with the skill's states.

        Raises FrankaArmArgumentError for values against their rules and for parts that do not fit each other, with those
        that would; FrankaArmException where the robot reports an error.
        """
        self._run(
            trajectory,
            controller if controller is not None else proto.InternalImpedance(),
            _any_of(until),
            skill_desc,
            block,
            ignore_errors,
            robot_controller,
            preempt,
            speed,
            start_time,
        )
        return self.last_skill_result if block and self._motions is not None and self._motions.sequence is None else None

    def change(
        self,
        trajectory: Message | None = None,
        controller: Message | None = None,
        until: Message | Sequence[Message] = (),
    ) -> None:
        """Give the skill that runs other parts, without a gap and without a step in torque; returns when it has them.

            fa.run(MinJerkPose(goal, 5), CartesianImpedance(600, 50), block=False)
            fa.change(controller=CartesianImpedance(200, 20))

        What is not given stays. A new trajectory begins at the reference as it then is; a new controller has the torque of the
        one before and comes to its own within 0.1 s. The robot controller stays, and so do the robot's own settings.

        Raises FrankaArmArgumentError for parts that do not fit, FrankaArmFrankaInterfaceNotReadyException when the skill does
        not run at that moment, FrankaArmException when there is none.
        """
        motion = None if self._motions is None else self._motions.running
        if motion is None or self.is_skill_done():
            raise FrankaArmException("No skill of this client runs: there is nothing to change.")
        change = proto.ChangeSkill(skill_id=motion.id)
        if trajectory is not None:
            validate(trajectory)
            change.trajectory.Pack(trajectory)
        if controller is not None:
            validate(controller)
            change.controller.Pack(controller)
        for termination in _any_of(until):
            validate(termination)
            change.terminations.add().Pack(termination)
        self._server.ask(proto.Request(change_skill=change))

    @staticmethod
    def kinds(role: str | None = None) -> list[Kind]:
        """Return what skills are made of: every kind with its fields, their units and defaults, and what it fits.

        Args:
            role: "trajectory", "controller", "termination", or None for all.

        Example:
            >>> for kind in fa.kinds("controller"):
            ...     print(kind.name, list(kind.fits))
        """
        if role not in (None, "trajectory", "controller", "termination"):
            raise FrankaArmArgumentError(f"role is {role!r}: expected trajectory, controller, termination or None")
        return describe(role)

    def publisher(self, topic: str) -> SensorPublisher:
        """Return a publisher of sensor messages over a topic of this arm."""
        return SensorPublisher(topic, self._robot_num, self._server_name)

    @property
    def walls(self) -> Walls:
        """What this arm must not touch, by name; see frankapy.walls."""

        def change(walls: proto.ChangeWalls) -> proto.Walls:
            return self._server.ask(proto.Request(change_walls=walls)).walls

        return Walls(change, lambda: np.array(self.get_arm_state().robot.F_T_EE).reshape(4, 4).T)

    def topics(self) -> dict[str, proto.Topics.Topic]:
        """Return what came over each topic since the arm's process began: received, lost, out of order, refused and why."""
        return {topic.topic: topic for topic in self._server.ask(proto.Request(list_topics=proto.ListTopics())).topics.topics}

    @contextlib.contextmanager
    def recording(self) -> Iterator[Callable[[], proto.RecordingStatus]]:
        """Record everything that happens inside, on the server's computer; `frankapy.recording` reads it.

        Gives a function that tells what there is: `file`, `time` (s), `states`, `bytes`, `lost`.

            with fa.recording() as status:
                fa.goto_pose(pose)
            print(status().file)

        Raises FrankaArmException where the server cannot write there.
        """

        def ask(on: bool | None = None) -> proto.RecordingStatus:
            record = proto.Record() if on is None else proto.Record(on=on)
            return self._server.ask(proto.Request(record=record)).recording

        def wait(so: Callable[[proto.RecordingStatus], bool]) -> None:
            deadline = time.monotonic() + _RECORDING_TIME
            while not so(status := ask()):
                if status.error:
                    raise FrankaArmException(f"The server does not record: {status.error}")
                if time.monotonic() > deadline:
                    return  # one that records all the time does not end
                time.sleep(0.01)

        before = ask(on=True).states
        try:
            wait(lambda status: status.open and status.states != before)
            yield ask
        finally:
            ask(on=False)
            wait(lambda status: not status.open)

    @contextlib.contextmanager
    def sequence(self, blend: float = 0) -> Iterator[list[proto.SkillResult]]:
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
        blend = number("blend", blend)
        if not 0 <= blend <= _MAX_BLEND:
            raise FrankaArmArgumentError(f"blend is {blend:g} s: expected 0 to {_MAX_BLEND:g} s")
        results: list[proto.SkillResult] = []
        motions = self._motions
        if motions is None:
            yield results
            return
        if motions.sequence is not None:
            raise FrankaArmArgumentError("A sequence is being made already: end it before another one begins.")
        sequence = motions.sequence = MotionSequence(blend)
        try:
            yield results
        except BaseException:
            motions.sequence = None
            self.stop_skill()
            raise
        motions.sequence = None
        failure: FrankaArmException | None = None
        for motion, ignore_errors in sequence.motions:
            try:
                motions.wait(motion, ignore_errors)
            except FrankaArmException as error:
                failure = failure or error
            if motion.ended is not None:
                results.append(motion.ended)
        if failure is not None:
            raise failure

    # --- gripper -------------------------------------------------------------------------------------------------

    @checks_flags
    def goto_gripper(
        self,
        width: float,
        grasp: bool = False,
        speed: float = 0.04,
        force: float = 0.0,
        epsilon_inner: float = 0.08,
        epsilon_outer: float = 0.08,
        block: bool = True,
        ignore_errors: bool = True,
        skill_desc: str = "GoToGripper",
    ) -> None:
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
        width = number("width", width)
        if not FC.GRIPPER_WIDTH_MIN <= width <= FC.GRIPPER_WIDTH_MAX:
            raise FrankaArmArgumentError(
                f"width is {width:g} m: expected {FC.GRIPPER_WIDTH_MIN} to {FC.GRIPPER_WIDTH_MAX}"
            )
        speed = number("speed", speed)
        if grasp:
            command = proto.GripperCommand(
                grasp=proto.GripperCommand.Grasp(
                    width=width,
                    speed=speed,
                    force=number("force", force) or None,
                    epsilon_inner=number("epsilon_inner", epsilon_inner),
                    epsilon_outer=number("epsilon_outer", epsilon_outer),
                )
            )
        else:
            command = proto.GripperCommand(move=proto.GripperCommand.Move(width=width, speed=speed))
        self._grip(command, block, ignore_errors)

    @checks_flags
    def open_gripper(self, block: bool = True, skill_desc: str = "OpenGripper") -> None:
        """Open the fingers to 0.08 m."""
        self.goto_gripper(FC.GRIPPER_WIDTH_MAX, block=block, skill_desc=skill_desc)

    @checks_flags
    def close_gripper(self, grasp: bool = True, block: bool = True, skill_desc: str = "CloseGripper") -> None:
        """Close the fingers: with `grasp` until 60 N are met, else to width 0."""
        self.goto_gripper(
            FC.GRIPPER_WIDTH_MIN, grasp=grasp, force=FC.GRIPPER_MAX_FORCE, block=block, skill_desc=skill_desc
        )

    @checks_flags
    def home_gripper(self, block: bool = True, skill_desc: str = "HomeGripper") -> None:
        """Let the hand find its largest width; after fingers were changed."""
        self._grip(proto.GripperCommand(homing=proto.GripperCommand.Homing()), block, ignore_errors=True)

    @checks_flags
    def stop_gripper(self, block: bool = True, skill_desc: str = "StopGripper") -> None:
        """Stop the fingers where they are."""
        self._grip(proto.GripperCommand(stop=proto.GripperCommand.StopGripper()), block, ignore_errors=True)

    # --- reads ---------------------------------------------------------------------------------------------------

    def get_arm_state(self) -> proto.ArmState:
        """Return everything that the server knows of the arm now: the newest state, with its age (s).

        The server is asked, but where reads follow each other within 50 ms: then its published states are listened to, and the
        newest is returned if it is no older than 3 ms.
        """
        if self._offline:
            zeros, identity = [0.0] * 7, np.eye(4).flatten()
            robot = proto.RobotState(
                O_T_EE=identity, O_T_EE_d=identity, q=zeros, q_d=zeros, dq=zeros, tau_J=zeros, dtau_J=zeros,
                O_F_ext_hat_K=zeros[:6], O_dP_EE_c=zeros[:6],
            )  # fmt: skip
            return proto.ArmState(robot=robot, gripper=proto.GripperState(width=0, is_grasped=False))
        before, self._read_time = self._read_time, time.monotonic()
        if self._read_time - before > _SOON:
            self._stop_listening()
        elif (state := self._newest_state()) is not None:
            return state
        return self._server.state()

    def states(self, rate: float = 1000, fields: Sequence[str] = ()) -> StateStream:
        """Return the arm's states from now on, between skills and in error as well.

        Args:
            rate: of them, 1/s: 1000, one for each cycle, or that divided by a whole number.
            fields: of proto.ArmState, those that are sent; none: all.

        Example:
            >>> with fa.states(rate=100, fields=["robot.q", "robot.dq"]) as states:
            ...     print(states.receive().robot.q)
        """
        return StateStream(self._server.current_welcome().state_endpoint, rate=number("rate", rate), fields=fields)

    def wait_for(self, condition: Callable[[proto.ArmState], bool], timeout: float | None = None) -> proto.ArmState:
        """Wait until a state fulfils a condition, which is asked of each cycle's; return that state.

        Raises FrankaArmCommException when none does within `timeout` (s; None: any time), or when no states come.

        Example:
            >>> fa.wait_for(lambda state: max(state.robot.dq) < 0.05, timeout=10)
        """
        deadline = math.inf if timeout is None else time.monotonic() + number("timeout", timeout)
        with StateStream(self._server.current_welcome().state_endpoint) as states:
            for state in states:
                if condition(state):
                    return state
                if time.monotonic() > deadline:
                    raise FrankaArmCommException(f"In {timeout:g} s no state fulfilled the condition.")
        raise FrankaArmCommException("No states have come for 3 s: `frankapy status` tells why.")

    def get_robot_state(self) -> dict[str, Any]:
        """Return the state as a dictionary of the published interface.

        Keys: pose and pose_desired (franka_tool_base to world), joints, joints_desired (rad), joint_velocities (rad/s),
        joint_torques (Nm), joint_torques_derivative (Nm/s), ee_force_torque (N, Nm, base axes), cartesian_velocities (m/s, rad/s;
        as commanded, and where the robot is commanded none as measured), gripper_width (m; NaN without a hand), gripper_is_grasped.
        """
        state = self.get_arm_state()
        robot = state.robot
        has_hand = state.HasField("gripper")
        if robot.motion_generator_mode in _CARTESIAN_MODES or self._offline:
            twist = np.array(robot.O_dP_EE_c)
        else:  # the robot is commanded none
            twist = kinematics.jacobian(np.array(robot.q), np.zeros(3)) @ np.array(robot.dq)
        return {
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
        return self._gripper_state().width

    def get_gripper_is_grasped(self) -> bool:
        """Return whether the hand holds an object."""
        return self._gripper_state().is_grasped

    def get_finger_poses(self) -> tuple[RigidTransform, RigidTransform]:
        """Return the poses of the finger tips, finger_left (along +y of the tool) and finger_right to world."""
        state = self.get_arm_state()
        tool = franka_pose_to_rigid_transform(state.robot.O_T_EE).matrix @ self._tool_delta_pose.matrix
        half = self._gripper_state(state).width / 2
        return tuple(  # type: ignore[return-value]
            RigidTransform(tool[:3, :3], tool[:3, 3] + side * half * tool[:3, 1], name, _WORLD)
            for name, side in (("finger_left", 1), ("finger_right", -1))
        )

    @property
    def last_skill_result(self) -> proto.SkillResult:
        """How the last skill of this client that has ended did so: ending, time, stretch, errors, last state."""
        return proto.SkillResult() if self._motions is None else self._motions.last_result

    # --- tool ----------------------------------------------------------------------------------------------------

    def set_tool_delta_pose(self, tool_delta_pose: RigidTransform) -> None:
        """Say where the tool is on the robot's end-effector frame; franka_tool to franka_tool_base.

        Kept in this object; every later pose is of that tool.
        """
        _check_pose("tool_delta_pose", tool_delta_pose, (_TOOL, _TOOL_BASE))
        self._tool_delta_pose = tool_delta_pose.copy()

    def get_tool_base_pose(self) -> RigidTransform:
        """Return what `set_tool_delta_pose` has set; franka_tool to franka_tool_base."""
        return self._tool_delta_pose.copy()

    # --- kinematics ----------------------------------------------------------------------------------------------

    @property
    def limits(self) -> proto.JointLimits:
        """Of the joints of the connected arm: range (q_min, q_max, rad), where motions may end (rest_min, rest_max, rad), and
        greatest velocities (dq_max, rad/s)."""
        return self._server.welcome.limits

    def is_joints_reachable(self, joints: Any) -> bool:
        """Return whether `goto_joints` finds joints (rad, (7,)) inside the range of the connected arm; offline, of the FER.

        Towards the limits of an FR3 a motion has to end a little before them, by up to 0.05 rad. Walls are not asked.
        """
        lower, upper = self._rest_range()
        joints = vector("joints", joints, 7)
        return bool(np.all((lower < joints) & (joints < upper)))

    def ik(self, tool_pose: RigidTransform, near: Any = None) -> np.ndarray:
        """Return joints (rad, (7,)) that bring the tool to a pose, for `goto_joints`.

        Of all such joints, those near to `near` (rad, (7,)); None: to where the arm is, offline to home. Raises
        FrankaArmArgumentError when no joints within the limits do, with how near they come.

        Example:
            >>> pose = fa.get_pose()
            >>> pose.translation[2] += 0.05
            >>> fa.goto_joints(fa.ik(pose), duration=3)
        """
        _check_pose("tool_pose", tool_pose, (_TOOL, _WORLD))
        if near is None:
            near = FC.HOME_JOINTS if self._offline else self.get_joints()
        if self._offline:
            tool = kinematics.turned_about_z(np.eye(4), kinematics.HAND_YAW)
            tool[2, 3] = kinematics.DH_PARAMS[8, 1]
        else:
            tool = np.array(self.get_arm_state().robot.F_T_EE).reshape(4, 4).T
        flange = tool_pose.matrix @ np.linalg.inv(tool @ self._tool_delta_pose.matrix)
        joints, distance, angle = kinematics.inverse(flange, vector("near", near, 7), *self._rest_range())
        if max(distance, angle) > kinematics.REACHED:
            raise FrankaArmArgumentError(
                f"Target pose not reachable! The joints come as near as {1e3 * distance:.1f} mm and "
                f"{math.degrees(angle):.2f} degrees: choose a pose nearer to the arm or another orientation"
            )
        return joints

    def get_jacobian(self, joints: Any) -> np.ndarray:
        """Return the Jacobian of the tool in base axes at `joints` (rad, (7,)); (6, 7), linear over angular."""
        return kinematics.jacobian(vector("joints", joints, 7), self._tool_delta_pose.translation)

    @checks_flags
    def get_links_transforms(
        self, joints: Any, use_rigid_transforms: bool = False
    ) -> np.ndarray | list[RigidTransform]:
        """Return the frames of the links at `joints` (rad, (7,)), in the base.

        As matrices, (12, 4, 4): base, joints 1 to 7, flange, twice the tool base, tool. Tool base and tool have the
        flange's axes there, which are turned by 45 degrees about z from those of `get_pose`. With
        `use_rigid_transforms` a list of 11: panda_link1 to panda_link8, panda_hand, franka_tool_base, franka_tool, the
        last three with the hand's axes, so that the last one agrees with `get_pose`.
        """
        frames, base, tool = self._links(vector("joints", joints, 7))
        if not use_rigid_transforms:
            return np.concatenate([frames, frames[9:], kinematics.turned_about_z(tool, -kinematics.HAND_YAW)[None]])
        hand = kinematics.turned_about_z(frames[8], kinematics.HAND_YAW)
        names = [f"panda_link{i}" for i in range(1, 9)] + ["panda_hand", _TOOL_BASE, _TOOL]
        return [
            RigidTransform(matrix[:3, :3], matrix[:3, 3], name, _WORLD)
            for name, matrix in zip(names, [*frames[1:9], hand, base, tool], strict=True)
        ]

    # --- boxes ---------------------------------------------------------------------------------------------------

    @checks_flags
    def get_collision_boxes_poses(
        self, joints: Any = None, use_rigid_transforms: bool = False
    ) -> list[np.ndarray] | list[RigidTransform]:
        """Return the poses of the arm's boxes (FrankaConstants.COLLISION_BOX_SHAPES) in the base.

        At `joints` (rad, (7,)), None: where the arm is. As matrices (4, 4), or as poses from box0 and so on to world.
        """
        poses = list(collision_boxes.poses_at(self._joints_or_now(joints)))
        if not use_rigid_transforms:
            return poses
        return [RigidTransform(pose[:3, :3], pose[:3, 3], f"box{i}", _WORLD) for i, pose in enumerate(poses)]

    def check_box_collision(self, box: Any, joints: Any = None) -> bool:
        """Return whether the arm meets a box: centre x, y, z, roll, pitch, yaw about fixed axes, size; m, rad, (9,).

        At `joints` (rad, (7,)), None: where the arm is.
        """
        return collision_boxes.arm_meets(box, self._joints_or_now(joints))

    def is_joints_in_collision_with_boxes(self, joints: Any = None, boxes: Any = None) -> bool:
        """Return whether the arm meets any of some boxes (see `check_box_collision`); None: the WORKSPACE_WALLS.

        At `joints` (rad, (7,)), None: where the arm is.
        """
        joints = self._joints_or_now(joints)
        return any(collision_boxes.arm_meets(box, joints) for box in table("boxes", FC.WORKSPACE_WALLS if boxes is None else boxes, 9))

    # --- of scripts for ROS --------------------------------------------------------------------------------------

    def publish_sensor_values(self, sensor_values: SensorDataGroup | None = None) -> bool | None:
        """Send sensor messages into the running skill (see frankapy.proto_utils); None: nothing, which returns False."""
        if sensor_values is None:
            return False
        if not self._offline:
            if self._sensors is None:
                self._sensors = self.publisher(_SENSOR_TOPIC)
            for message in messages_of(sensor_values):
                self._sensors.publish(message)
        return None

    def publish_sensor_data(self, sensor_data_msg: SensorDataGroup) -> None:
        """Send sensor messages into the running skill (see frankapy.proto_utils)."""
        self.publish_sensor_values(sensor_data_msg)

    def publish_joints(self, joints: Any = None) -> None:
        """Publish joints (rad, (7,); None: those of now) for rviz, under franka_virtual_joints_<number of the arm>.

        Where scripts run without rospy there is nobody who would look.
        """
        joints = self._joints_or_now(joints)
        try:
            import rospy
            from sensor_msgs.msg import JointState
        except ImportError:
            return
        message = JointState()
        message.header.stamp = rospy.Time.now()
        message.name, message.position = list(FC.JOINT_NAMES), [*joints.tolist(), 0.0, 0.0]
        rospy.Publisher(f"franka_virtual_joints_{self._robot_num}", JointState, queue_size=10).publish(message)

    def publish_collision_boxes(self, joints: Any = None) -> None:
        """Publish the arm's boxes at `joints` (rad, (7,); None: those of now) for rviz, as BoxesPublisher does."""
        poses = collision_boxes.poses_at(self._joints_or_now(joints))
        boxes = [np.r_[pose[:3, 3], _quaternion(pose), size] for pose, size in zip(poses, FC.COLLISION_BOX_SHAPES, strict=True)]
        BoxesPublisher(f"franka_collision_boxes_{self._robot_num}").publish_boxes(boxes)

    # --- of scripts for ROS 2 ------------------------------------------------------------------------------------

    def get_time(self) -> float:
        """Return the time of this computer, s since 1970."""
        return time.time()

    def log_info(self, message: str) -> None:
        """Write a line into the log of frankapy."""
        logger.info(message)

    # --- inside --------------------------------------------------------------------------------------------------

    def _run(
        self,
        trajectory: Message,
        controller: Message,
        terminations: Sequence[Message],
        description: str,
        block: bool,
        ignore_errors: bool,
        robot_controller: str = "auto",
        preempt: bool = False,
        speed: float | None = None,
        start_time: float | None = None,
    ) -> None:
        """Send a skill, and wait for its end where asked to."""
        speed = self.speed if speed is None else number("speed", speed)
        description = text("skill_desc", description, _LONGEST_DESCRIPTION)
        skill = make_skill(trajectory, controller, terminations, description, robot_controller, speed, start_time)
        if self._motions is None:
            logger.warning("%s is not made: this FrankaArm is offline.", description or "The skill")
            return
        self._stop_listening()
        duration = getattr(trajectory, "duration", 0.0) / (speed or 1)
        self._motions.run(skill, duration, block, ignore_errors, preempt)

    def _grip(self, command: proto.GripperCommand, block: bool, ignore_errors: bool) -> None:
        self._require_gripper()
        validate(command)
        if self._hand is None:
            logger.warning("The gripper stays: this FrankaArm is offline.")
            return
        self._hand.command(command, block, ignore_errors)

    def _require_gripper(self) -> None:
        if not self._with_gripper:
            raise FrankaArmException("This FrankaArm was made with with_gripper=False.")

    def _gripper_state(self, state: proto.ArmState | None = None) -> proto.GripperState:
        self._require_gripper()
        state = state or self.get_arm_state()
        if not state.HasField("gripper"):
            raise FrankaArmException("The server has no hand on this arm.")
        return state.gripper

    def _links(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the frames of kinematics.link_frames, and those of tool base and tool as `get_pose` has them."""
        frames = kinematics.link_frames(joints)
        base = kinematics.turned_about_z(frames[9], kinematics.HAND_YAW)
        return frames, base, base @ self._tool_delta_pose.matrix

    def _joints_or_now(self, joints: Any) -> np.ndarray:
        return self.get_joints() if joints is None else vector("joints", joints, 7)

    @property
    def _in_skill(self) -> bool:
        """Whether a skill was sent and not waited for; scripts set it to False to send another one."""
        return self._motions is not None and self._motions.running is not None

    @_in_skill.setter
    def _in_skill(self, there_is_one: bool) -> None:
        if self._motions is not None and not there_is_one:
            self._motions.running = None

    def _rest_range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return where motions of the joints may end, rad: of the connected arm; offline of the FER."""
        if self._connection is None or len(self._connection.welcome.limits.rest_min) != 7:
            return np.array(FC.JOINT_LIMITS_MIN), np.array(FC.JOINT_LIMITS_MAX)
        limits = self._connection.welcome.limits
        return np.array(limits.rest_min), np.array(limits.rest_max)

    def _check_reachable(self, joints: np.ndarray) -> None:
        lower, upper = (limit.tolist() for limit in self._rest_range())
        for i in range(7):
            if not lower[i] < joints[i] < upper[i]:
                raise FrankaArmArgumentError(
                    f"Joints not reachable! joints[{i}] is {joints[i]:.4f} rad: expected between {lower[i]:.4f} and "
                    f"{upper[i]:.4f}, where joint {i + 1} of this arm may come to rest"
                )

    def _check_walls(self, what: str, **points: np.ndarray) -> None:
        """Raise FrankaArmArgumentError for points (m, (n, 3), by the name of what is there) behind the WORKSPACE_WALLS."""
        for name, where in points.items():
            found = collision_boxes.behind(FC.WORKSPACE_WALLS, where, whole_wall=name == "arm")
            if found is not None:
                wall, point = found
                raise FrankaArmArgumentError(
                    f"{what} would bring the {name.replace('_', ' ')} to "
                    f"{collision_boxes.place(FC.WORKSPACE_WALLS[wall], where[point])} (FrankaConstants.WORKSPACE_WALLS[{wall}]). "
                    f"ignore_virtual_walls=True goes there all the same"
                )

    def _newest_state(self) -> proto.ArmState | None:
        """Return the newest published state if it is new enough; the first call subscribes."""
        endpoint = self._server.welcome.state_endpoint
        if not endpoint:
            return None
        newest = self._newest
        if newest is None or newest[:2] != (os.getpid(), endpoint):
            self._stop_listening()
            self._newest = (os.getpid(), endpoint, NewestState(endpoint))
            return None
        state = newest[2].read()
        if state is None:
            return None
        # Clocks are never quite the same.
        state.age = max(0.0, time.time() + self._server.clock_difference[0] - state.time_ns * 1e-9)
        # What ended a call may be newer than what has been published.
        return state if state.age <= _NEW and state.time_ns >= self.last_skill_result.last_state.time_ns else None

    def _stop_listening(self) -> None:
        """Listen to published states no longer: each costs the server, the network and this computer something."""
        newest, self._newest = self._newest, None
        if newest is not None and newest[0] == os.getpid():
            newest[2].close()

    @property
    def _server(self) -> Connection:
        if self._connection is None:
            raise FrankaArmException("This needs a server, and this FrankaArm is offline.")
        return self._connection


# --- arguments -------------------------------------------------------------------------------------------------------


def _end(at_goal: Message, force_thresholds: Any, torque_thresholds: Any) -> Message:
    """Return what ends a motion beside its time: the goal, or contact where thresholds are given ([] is none)."""
    if force_thresholds is None and torque_thresholds is None:
        return at_goal
    thresholds = {"force_thresholds": (force_thresholds, 6), "torque_thresholds": (torque_thresholds, 7)}
    given: dict[str, Any] = {
        name: vector(name, each, size)
        for name, (each, size) in thresholds.items()
        if each is not None and not (isinstance(each, Sized) and len(each) == 0)
    }
    return proto.Contact(**given)


def _contact(force_thresholds: Any, torque_thresholds: Any) -> list[Message]:
    if force_thresholds is None and torque_thresholds is None:
        return []
    return [_end(proto.Never(), force_thresholds, torque_thresholds)]


def _stream_ends(duration: Any, buffer_time: Any, force_thresholds: Any, torque_thresholds: Any) -> list[Message]:
    return [
        proto.Time(seconds=number("duration", duration) + number("buffer_time", buffer_time)),
        proto.SensorSays(topic=_SENSOR_TOPIC),
        *_contact(force_thresholds, torque_thresholds),
    ]


def _streamed_or_timed_ends(
    dynamic: bool, duration: Any, buffer_time: Any, force_thresholds: Any, torque_thresholds: Any
) -> list[Message]:
    if dynamic:
        return _stream_ends(duration, buffer_time, force_thresholds, torque_thresholds)
    return [_time_after(buffer_time), *_contact(force_thresholds, torque_thresholds)]


def _accelerations(name: str, values: Any, velocities: np.ndarray) -> np.ndarray | None:
    """Return what a constant velocity takes: none given where there is nothing but zeros, and any where nothing moves."""
    accelerations = vector(name, values, len(velocities))
    if not accelerations.any():
        return None
    return np.where((accelerations == 0) & (velocities == 0), 1.0, accelerations)


def _within_momentum(what: str, strength: float, duration: float, most: float) -> None:
    if strength * duration > most:
        raise FrankaArmArgumentError(
            f"{what} of {strength:.3g} for run_duration {duration:g} s make {strength * duration:.4g}: expected at most {most:g}"
        )


def _dmp(name: str, info: Mapping[str, Any], dimensions: int) -> dict[str, Any]:
    """Return the fields of a movement primitive's dictionary, of which sizes agree."""
    if not isinstance(info, Mapping):
        raise FrankaArmArgumentError(f"{name} is a {type(info).__name__}: expected a dictionary with {', '.join(dmp.KEYS)}")
    missing = [key for key in dmp.KEYS if key not in info]
    if missing:
        raise FrankaArmArgumentError(f"{name} has no {missing[0]}: expected {', '.join(dmp.KEYS)}")
    basis, sensors = (number(f"{name}[{key!r}]", info[key]) for key in ("num_basis", "num_sensors"))
    fields: dict[str, Any] = {key: number(f"{name}[{key!r}]", info[key]) for key in ("tau", "alpha", "beta")}
    for key, size, of in [
        ("mu", basis, "num_basis"),
        ("h", basis, "num_basis"),
        ("weights", dimensions * basis * sensors, f"{dimensions} dimensions times num_basis times num_sensors"),
    ]:
        fields[key] = numbers(f"{name}[{key!r}]", info[key])
        if len(fields[key]) != size:
            raise FrankaArmArgumentError(f"{name}[{key!r}] has {len(fields[key])} elements: expected {size:g}, {of}")
    return fields


def _sensor_values(values: Any, info: Mapping[str, Any], dimensions: int) -> np.ndarray | None:
    if values is None:
        return None
    return vector("initial_sensor_values", numbers("initial_sensor_values", values), dimensions * int(info["num_sensors"]))


def _given(name: str, value: Any, size: int) -> np.ndarray | None:
    return None if value is None else vector(name, value, size)


def _joint_controller(
    use_impedance: bool, cartesian_impedances: Any, joint_impedances: Any, k_gains: Any, d_gains: Any
) -> Message:
    if not use_impedance:
        _warn_of_unused("use_impedance=False", "the server's controller", k_gains=k_gains, d_gains=d_gains)
        return _internal_impedance(cartesian_impedances, joint_impedances)
    _warn_of_unused("use_impedance=True", "the robot's own controller", joint_impedances=joint_impedances,
                    cartesian_impedances=cartesian_impedances)  # fmt: skip
    return proto.JointImpedance(stiffness=_given("k_gains", k_gains, 7), damping=_given("d_gains", d_gains, 7))


def _pose_controller(use_impedance: bool, cartesian_impedances: Any, joint_impedances: Any) -> Message:
    if not use_impedance:
        return _internal_impedance(cartesian_impedances, joint_impedances)
    _warn_of_unused("use_impedance=True", "the robot's own controller", joint_impedances=joint_impedances)
    controller = proto.CartesianImpedance()
    stiffness = _given("cartesian_impedances", cartesian_impedances, 6)
    if stiffness is not None:
        controller.translational_stiffness.extend(stiffness[:3])
        controller.rotational_stiffness.extend(stiffness[3:])
    return controller


def _internal_impedance(cartesian_impedances: Any, joint_impedances: Any) -> proto.InternalImpedance:
    if joint_impedances is not None:
        return proto.InternalImpedance(K_theta=vector("joint_impedances", joint_impedances, 7))
    return proto.InternalImpedance(K_x=_given("cartesian_impedances", cartesian_impedances, 6))


def _time_after(buffer_time: Any) -> proto.Time:
    return proto.Time(after_trajectory=number("buffer_time", buffer_time))


def _warn_of_unused(when: str, whose: str, **arguments: Any) -> None:
    for name, value in arguments.items():
        if value is not None:
            logger.warning("%s means nothing with %s: it is of %s.", name, when, whose)


def _check_pose(name: str, pose: Any, *frames: tuple[str, str]) -> None:
    """Raise FrankaArmArgumentError unless `pose` is one, finite, and between one of these pairs of frames."""
    try:
        matrix = np.asarray(pose.matrix, dtype=float)
        given = (pose.from_frame, pose.to_frame)
    except (AttributeError, TypeError, ValueError):
        raise FrankaArmArgumentError(f"{name} is a {type(pose).__name__}: expected a RigidTransform") from None
    if given not in frames:
        expected = " or ".join(f"{a} to {b}" for a, b in frames)
        raise FrankaArmArgumentError(f"{name} has the frames {given[0]} to {given[1]}: expected {expected}")
    if not np.isfinite(matrix).all():
        raise FrankaArmArgumentError(f"{name} is not finite: translation {pose.translation}, rotation {pose.rotation}")
    rotation = matrix[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
        raise FrankaArmArgumentError(f"{name}.rotation is no rotation matrix:\n{rotation}")


def _quaternion(matrix: np.ndarray) -> np.ndarray:
    return RigidTransform(matrix[:3, :3], np.zeros(3)).quaternion
