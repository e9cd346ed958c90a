"""FrankaArm: one arm, commanded through franka-interface."""

from __future__ import annotations

import logging
import math
import signal
import threading
import time
import weakref
from collections.abc import Sequence
from types import FrameType, TracebackType
from typing import Any

import numpy as np
from google.protobuf.message import Message

from frankapy import kinematics, proto
from frankapy.connection import Call, Connection
from frankapy.exceptions import (
    FrankaArmArgumentError,
    FrankaArmCommException,
    FrankaArmException,
    FrankaArmFrankaInterfaceNotReadyException,
    FrankaArmNotBuiltError,
)
from frankapy.franka_constants import FrankaConstants as FC
from frankapy.rigid_transform import RigidTransform
from frankapy.skill import make_skill
from frankapy.states import StateStream
from frankapy.utils import franka_pose_to_rigid_transform
from frankapy.validation import number, validate, vector

logger = logging.getLogger("frankapy")

_TOOL, _TOOL_BASE, _WORLD = "franka_tool", "franka_tool_base", "world"
_STRETCH_WORTH_A_WORD = 1.01
_STOP_TIME = 3.0  # s after which an interrupted call no longer waits for the arm to rest

# What an ended skill may look like without anything being wrong.
_GOOD_ENDINGS = (proto.TERMINATED, proto.STOPPED, proto.PREEMPTED)


class _Motion:
    """A skill of this client which the server has taken."""

    def __init__(self, call: Call, description: str) -> None:
        self.call = call
        self.description = description
        self.handled = False


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
        self._motion: _Motion | None = None
        self._gripping: Call | None = None
        self._lock = threading.Lock()
        self._last_result = proto.SkillResult()
        self._connection: Connection | None = None
        if self._offline:
            logger.warning("FrankaArm is offline: reads give zeros, and nothing moves.")
            return
        self._connection = Connection(server, robot_num)
        self._finalizer = weakref.finalize(self, self._connection.close)
        _stop_on_interrupt(self)
        self._wait_for_phase(lambda phase: phase != proto.CONNECTING, FC.DEFAULT_FRANKA_INTERFACE_TIMEOUT)

    def close(self) -> None:
        """Leave the arm to others. A skill that still runs goes on to its own end."""
        if self._connection is not None:
            self._connection.close()

    def __enter__(self) -> FrankaArm:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # --- waiting and stopping ------------------------------------------------------------------------------------

    def wait_for_franka_interface(self, timeout: float | None = None) -> None:
        """Wait until the arm can move; an arm in error is told to recover.

        `timeout` in s; None is 10 s. Raises FrankaArmCommException when it cannot move by then, with the reason.
        """
        timeout = FC.DEFAULT_FRANKA_INTERFACE_TIMEOUT if timeout is None else number("timeout", timeout)
        if self._offline:
            return
        deadline = time.monotonic() + timeout
        reason = ""
        while True:
            try:
                phase = self.get_arm_state().phase
                if phase == proto.ERROR:
                    self._server.ask(proto.Request(recover=proto.Recover()))
                elif phase not in (proto.CONNECTING, proto.RECOVERING):
                    return
                reason = f"its phase is {proto.Phase.Name(phase)}"
            except FrankaArmFrankaInterfaceNotReadyException as error:
                reason = error.message
            if time.monotonic() > deadline:
                raise FrankaArmCommException(f"The arm is not ready after {timeout:g} s: {reason}")
            time.sleep(0.01)

    def wait_for_skill(self) -> None:
        """Return when the skill that was last sent has ended, however it ended."""
        motion = self._motion
        if motion is not None:
            self._wait(motion, ignore_errors=True)

    def is_skill_done(self, ignore_errors: bool = True) -> bool:
        """Return whether the skill that was last sent has ended; True when there is none.

        With `ignore_errors=False` a skill that failed raises FrankaArmException.
        """
        motion = self._motion
        if motion is None:
            return True
        if motion.call.last(timeout=0) is None:
            return False
        self._finish(motion, ignore_errors)
        return True

    def stop_skill(self) -> None:
        """Bring the arm to rest, whoever moves it, and wait until the skill of this client has ended."""
        if self._offline:
            return
        self._server.ask(proto.Request(stop_skill=proto.StopSkill()))
        self.wait_for_skill()

    def wait_for_gripper(self) -> None:
        """Return when the gripper command that was last sent has ended."""
        if self._gripping is not None:
            self._wait_for_gripper(self._gripping, ignore_errors=True)

    def is_gripper_skill_done(self) -> bool:
        """Return whether the gripper command that was last sent has ended."""
        return self._gripping is None or self._gripping.last(timeout=0) is not None

    # --- motions -------------------------------------------------------------------------------------------------

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
            dynamic: not built yet.
            buffer_time: s after the end of the curve at which the skill ends in any case.
            force_thresholds: not built yet.
            torque_thresholds: not built yet.
            cartesian_impedances: of the robot's own controller, 3 N/m and 3 Nm/rad; without `use_impedance`.
            joint_impedances: of the robot's own controller, Nm/rad, (7,); without `use_impedance`.
            k_gains: stiffness of the server's controller, Nm/rad, (7,); with `use_impedance`.
            d_gains: damping of the server's controller, Nms/rad, (7,); with `use_impedance`.
            block: whether to wait for the end.
            ignore_errors: True: a failure is logged and recovered from. False: it raises FrankaArmException.
            ignore_virtual_walls: do not refuse goals behind FrankaConstants.WORKSPACE_WALLS.
            skill_desc: goes into states and logs.

        Example:
            >>> fa.goto_joints([0, -0.785, 0, -2.356, 0, 1.571, 0.6], duration=2)
        """
        self._refuse_not_built(dynamic, force_thresholds, torque_thresholds)
        joints = vector("joints", joints, 7)
        self._check_reachable(joints)
        if not ignore_virtual_walls:
            self._check_walls(kinematics.link_frames(joints)[1:, :3, 3], "goto_joints would bring the arm to")
        if use_impedance:
            _warn_of_unused("use_impedance=True", "the robot's own controller", joint_impedances=joint_impedances,
                            cartesian_impedances=cartesian_impedances)  # fmt: skip
            controller = proto.JointImpedance(
                stiffness=_given("k_gains", k_gains, 7), damping=_given("d_gains", d_gains, 7)
            )
        else:
            _warn_of_unused("use_impedance=False", "the server's controller", k_gains=k_gains, d_gains=d_gains)
            controller = _internal_impedance(cartesian_impedances, joint_impedances)
        self._run(
            proto.MinJerkJoint(q=joints, duration=number("duration", duration)),
            controller,
            [proto.FinalJoint(), _time_after(buffer_time)],
            skill_desc,
            block,
            ignore_errors,
        )

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
            dynamic: not built yet.
            buffer_time: s.
            force_thresholds: not built yet.
            torque_thresholds: not built yet.
            cartesian_impedances: 3 N/m and 3 Nm/rad, of whichever controller.
            joint_impedances: of the robot's own controller, Nm/rad, (7,); without `use_impedance`; goes before
                `cartesian_impedances`.
            block: whether to wait for the end.
            ignore_errors: True: a failure is logged and recovered from. False: it raises FrankaArmException.
            ignore_virtual_walls: do not refuse goals behind FrankaConstants.WORKSPACE_WALLS.
            skill_desc: goes into states and logs.

        Example:
            >>> pose = fa.get_pose()
            >>> pose.translation[0] += 0.05
            >>> fa.goto_pose(pose, duration=2)
        """
        self._refuse_not_built(dynamic, force_thresholds, torque_thresholds)
        _check_pose("tool_pose", tool_pose, (_TOOL, _WORLD))
        goal = tool_pose.matrix @ self._tool_delta_pose.inverse().matrix
        if not ignore_virtual_walls:
            self._check_walls(goal[None, :3, 3], "goto_pose would bring the tool base to")
        self._run(
            proto.MinJerkPose(
                position=goal[:3, 3], quaternion=_quaternion(goal), duration=number("duration", duration)
            ),
            _pose_controller(use_impedance, cartesian_impedances, joint_impedances),
            [proto.FinalPose(), _time_after(buffer_time)],
            skill_desc,
            block,
            ignore_errors,
        )

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
        self._refuse_not_built(False, force_thresholds, torque_thresholds)
        _check_pose("delta_tool_pose", delta_tool_pose, (_TOOL, _TOOL), (_WORLD, _WORLD))
        delta = delta_tool_pose.matrix
        in_tool = delta_tool_pose.from_frame == _TOOL
        if in_tool:
            tool = self._tool_delta_pose.matrix
            delta = tool @ delta @ np.linalg.inv(tool)
        if not ignore_virtual_walls and not self._offline:
            now = self.get_pose(include_tool_offset=False).matrix
            goal = (now @ delta)[:3, 3] if in_tool else now[:3, 3] + delta[:3, 3]
            self._check_walls(goal[None], "goto_pose_delta would bring the tool base to")
        frame = proto.RelativeMinJerkPose.END_EFFECTOR if in_tool else proto.RelativeMinJerkPose.BASE
        self._run(
            proto.RelativeMinJerkPose(
                translation=delta[:3, 3],
                quaternion=_quaternion(delta),
                frame=frame,
                duration=number("duration", duration),
            ),
            _pose_controller(use_impedance, cartesian_impedances, joint_impedances),
            [proto.FinalPose(), _time_after(buffer_time)],
            skill_desc,
            block,
            ignore_errors,
        )

    def reset_joints(
        self, duration: float = 5, block: bool = True, ignore_errors: bool = True, skill_desc: str = ""
    ) -> None:
        """Move to FrankaConstants.HOME_JOINTS, as `goto_joints` does."""
        self.goto_joints(
            FC.HOME_JOINTS, duration=duration, block=block, ignore_errors=ignore_errors, skill_desc=skill_desc
        )

    def reset_pose(
        self, duration: float = 5, block: bool = True, ignore_errors: bool = True, skill_desc: str = ""
    ) -> None:
        """Move to FrankaConstants.HOME_POSE, as `goto_pose` does."""
        self.goto_pose(FC.HOME_POSE, duration=duration, block=block, ignore_errors=ignore_errors, skill_desc=skill_desc)

    # --- gripper -------------------------------------------------------------------------------------------------

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
            force: of a grasp, N.
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
                    force=number("force", force),
                    epsilon_inner=number("epsilon_inner", epsilon_inner),
                    epsilon_outer=number("epsilon_outer", epsilon_outer),
                )
            )
        else:
            command = proto.GripperCommand(move=proto.GripperCommand.Move(width=width, speed=speed))
        self._grip(command, block, ignore_errors)

    def open_gripper(self, block: bool = True, skill_desc: str = "OpenGripper") -> None:
        """Open the fingers to 0.08 m."""
        self.goto_gripper(FC.GRIPPER_WIDTH_MAX, block=block, skill_desc=skill_desc)

    def close_gripper(self, grasp: bool = True, block: bool = True, skill_desc: str = "CloseGripper") -> None:
        """Close the fingers: with `grasp` until 60 N are met, else to width 0."""
        self.goto_gripper(
            FC.GRIPPER_WIDTH_MIN, grasp=grasp, force=FC.GRIPPER_MAX_FORCE, block=block, skill_desc=skill_desc
        )

    def home_gripper(self, block: bool = True, skill_desc: str = "HomeGripper") -> None:
        """Let the hand find its largest width; after fingers were changed."""
        self._grip(proto.GripperCommand(homing=proto.GripperCommand.Homing()), block, ignore_errors=True)

    def stop_gripper(self, block: bool = True, skill_desc: str = "StopGripper") -> None:
        """Stop the fingers where they are."""
        self._grip(proto.GripperCommand(stop=proto.GripperCommand.StopGripper()), block, ignore_errors=True)

    # --- reads ---------------------------------------------------------------------------------------------------

    def get_arm_state(self) -> proto.ArmState:
        """Return everything that the server knows of the arm now."""
        if self._offline:
            zeros, identity = [0.0] * 7, np.eye(4).flatten()
            robot = proto.RobotState(
                O_T_EE=identity, O_T_EE_d=identity, q=zeros, q_d=zeros, dq=zeros, tau_J=zeros, dtau_J=zeros,
                O_F_ext_hat_K=zeros[:6], O_dP_EE_c=zeros[:6],
            )  # fmt: skip
            return proto.ArmState(robot=robot, gripper=proto.GripperState(width=0, is_grasped=False))
        return self._server.ask(proto.Request(get_state=proto.GetState())).state

    def stream_states(self) -> StateStream:
        """Return the arm's states from now on, one for each cycle of 1 ms.

        Example:
            >>> with fa.stream_states() as states:
            ...     print(states.receive().robot.q)
        """
        return StateStream(self._server.welcome.state_endpoint)

    def get_robot_state(self) -> dict[str, Any]:
        """Return the state as a dictionary of the published interface.

        Keys: pose and pose_desired (franka_tool_base to world), joints, joints_desired (rad), joint_velocities (rad/s),
        joint_torques (Nm), joint_torques_derivative (Nm/s), ee_force_torque (N, Nm, base axes), cartesian_velocities
        (commanded; m/s, rad/s), gripper_width (m; NaN without a hand), gripper_is_grasped.
        """
        state = self.get_arm_state()
        robot = state.robot
        has_hand = state.HasField("gripper")
        return {
            "cartesian_velocities": np.array(robot.O_dP_EE_c),
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
        return self._last_result

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

    def is_joints_reachable(self, joints: Any) -> bool:
        """Return whether joints (rad, (7,)) are inside the limits of the connected arm; offline, of the FER."""
        lower, upper = self._joint_limits()
        joints = vector("joints", joints, 7)
        return bool(np.all((lower < joints) & (joints < upper)))

    def get_jacobian(self, joints: Any) -> np.ndarray:
        """Return the Jacobian of the tool in base axes at `joints` (rad, (7,)); (6, 7), linear over angular."""
        return kinematics.jacobian(vector("joints", joints, 7), self._tool_delta_pose.translation)

    def get_links_transforms(
        self, joints: Any, use_rigid_transforms: bool = False
    ) -> np.ndarray | list[RigidTransform]:
        """Return the frames of the links at `joints` (rad, (7,)), in the base.

        As matrices, (12, 4, 4): base, joints 1 to 7, flange, twice the tool base, tool. Tool base and tool have the
        flange's axes there, which are turned by 45 degrees about z from those of `get_pose`. With
        `use_rigid_transforms` a list of 11: panda_link1 to panda_link8, panda_hand, franka_tool_base, franka_tool, the
        last three with the hand's axes, so that the last one agrees with `get_pose`.
        """
        frames = kinematics.link_frames(vector("joints", joints, 7))
        base = kinematics.turned_about_z(frames[9], kinematics.HAND_YAW)
        tool = base @ self._tool_delta_pose.matrix
        if not use_rigid_transforms:
            return np.concatenate([frames, frames[9:], kinematics.turned_about_z(tool, -kinematics.HAND_YAW)[None]])
        hand = kinematics.turned_about_z(frames[8], kinematics.HAND_YAW)
        names = [f"panda_link{i}" for i in range(1, 9)] + ["panda_hand", _TOOL_BASE, _TOOL]
        return [
            RigidTransform(matrix[:3, :3], matrix[:3, 3], name, _WORLD)
            for name, matrix in zip(names, [*frames[1:9], hand, base, tool], strict=True)
        ]

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
    ) -> None:
        """Send a skill, and wait for its end where asked to."""
        skill = make_skill(trajectory, controller, terminations, description)
        if self._offline:
            logger.warning("%s is not made: this FrankaArm is offline.", description or "The skill")
            return
        if not self.is_skill_done():
            raise FrankaArmArgumentError("Cannot send another command when the previous skill is active!")
        request = proto.Request(start_skill=proto.StartSkill(skill=skill))
        try:
            call = self._server.start(request)
        except FrankaArmFrankaInterfaceNotReadyException as error:
            if not ignore_errors:
                raise
            logger.warning("%s The arm is told to recover.", error.message)
            self.wait_for_franka_interface()
            call = self._server.start(request)
        motion = self._motion = _Motion(call, description)
        if block:
            self._wait(motion, ignore_errors)

    def _wait(self, motion: _Motion, ignore_errors: bool) -> None:
        try:
            motion.call.final()
        except KeyboardInterrupt:
            self._server.send(proto.Request(stop_skill=proto.StopSkill()))
            motion.call.last(_STOP_TIME)
            self._finish(motion, ignore_errors=True)
            raise
        except FrankaArmException:
            pass  # found again below
        self._finish(motion, ignore_errors)

    def _finish(self, motion: _Motion, ignore_errors: bool) -> None:
        """Judge a skill that has ended, once."""
        with self._lock:
            if self._motion is motion:
                self._motion = None
            if motion.handled:
                return
            motion.handled = True
        reply = motion.call.last(timeout=0)
        if reply is None:
            return
        result = self._last_result = reply.skill_result
        name = motion.description or "The skill"
        if result.stretch > _STRETCH_WORTH_A_WORD:
            logger.warning("%s was too fast for the arm and took %.2f times as long.", name, result.stretch)
        if result.ending in _GOOD_ENDINGS:
            return
        message = f"{name} ended with {proto.Ending.Name(result.ending)}: {result.message or ', '.join(result.errors)}"
        if not ignore_errors:
            raise FrankaArmException(message)
        logger.warning("%s", message)
        if result.ending in (proto.ROBOT_ERROR, proto.REFUSED):
            self.wait_for_franka_interface()

    def _grip(self, command: proto.GripperCommand, block: bool, ignore_errors: bool) -> None:
        if not self._with_gripper:
            raise FrankaArmException("This FrankaArm was made with with_gripper=False.")
        validate(command)
        if self._offline:
            logger.warning("The gripper stays: this FrankaArm is offline.")
            return
        call = self._gripping = self._server.start(proto.Request(gripper=command))
        if block:
            self._wait_for_gripper(call, ignore_errors)

    def _wait_for_gripper(self, call: Call, ignore_errors: bool) -> None:
        try:
            result = call.final().gripper_result
        except KeyboardInterrupt:
            stop = proto.GripperCommand(stop=proto.GripperCommand.StopGripper())
            self._server.send(proto.Request(gripper=stop))
            call.last(_STOP_TIME)
            raise
        if self._gripping is call:
            self._gripping = None
        if not result.success:
            message = f"The gripper did not succeed: {result.message or 'it gave no reason'}"
            if not ignore_errors:
                raise FrankaArmException(message)
            logger.warning("%s", message)

    def _gripper_state(self, state: proto.ArmState | None = None) -> proto.GripperState:
        if not self._with_gripper:
            raise FrankaArmException("This FrankaArm was made with with_gripper=False.")
        state = state or self.get_arm_state()
        if not state.HasField("gripper"):
            raise FrankaArmException("The server has no hand on this arm.")
        return state.gripper

    def _wait_for_phase(self, accepted: Any, timeout: float) -> None:
        deadline = time.monotonic() + timeout
        while True:
            try:
                phase = self.get_arm_state().phase
                reason = f"its phase is {proto.Phase.Name(phase)}"
                if accepted(phase):
                    return
            except FrankaArmFrankaInterfaceNotReadyException as error:
                reason = error.message
            if time.monotonic() > deadline:
                raise FrankaArmCommException(f"The arm is not ready after {timeout:g} s: {reason}")
            time.sleep(0.01)

    def _joint_limits(self) -> tuple[np.ndarray, np.ndarray]:
        if self._connection is not None and len(self._connection.welcome.limits.q_min) == 7:
            limits = self._connection.welcome.limits
            return np.array(limits.q_min), np.array(limits.q_max)
        return np.array(FC.JOINT_LIMITS_MIN), np.array(FC.JOINT_LIMITS_MAX)

    def _check_reachable(self, joints: np.ndarray) -> None:
        lower, upper = self._joint_limits()
        for i in range(7):
            if not lower[i] < joints[i] < upper[i]:
                raise FrankaArmArgumentError(
                    f"Joints not reachable! joints[{i}] is {joints[i]:.4f} rad: expected between {lower[i]:.4f} and "
                    f"{upper[i]:.4f}, the limits of joint {i + 1}"
                )

    @staticmethod
    def _check_walls(points: np.ndarray, what: str) -> None:
        walls = np.asarray(FC.WORKSPACE_WALLS, dtype=float)
        for axis, name in enumerate("xyz"):
            places = walls[np.argmin(walls[:, 6:9], axis=1) == axis, axis]
            if not len(places):
                continue
            lower, upper = places.min(), places.max()
            beyond = points[~((lower < points[:, axis]) & (points[:, axis] < upper)), axis]
            if len(beyond):
                raise FrankaArmArgumentError(
                    f"{what} {name} = {beyond[0]:.3f} m: the virtual walls are at {lower:g} and {upper:g} m "
                    f"(FrankaConstants.WORKSPACE_WALLS). ignore_virtual_walls=True goes there all the same"
                )

    def _refuse_not_built(self, dynamic: bool, force_thresholds: Any, torque_thresholds: Any) -> None:
        if dynamic:
            raise FrankaArmNotBuiltError("dynamic=True: streaming goals to a running skill is not built yet.")
        if force_thresholds is not None or torque_thresholds is not None:
            raise FrankaArmNotBuiltError(
                "force_thresholds and torque_thresholds: ending a skill at a contact is not built yet, so the motion "
                "was not started."
            )

    @property
    def _server(self) -> Connection:
        if self._connection is None:
            raise FrankaArmException("This needs a server, and this FrankaArm is offline.")
        return self._connection


# --- arguments -------------------------------------------------------------------------------------------------------


def _given(name: str, value: Any, size: int) -> np.ndarray | None:
    return None if value is None else vector(name, value, size)


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


# --- Ctrl-C ----------------------------------------------------------------------------------------------------------

_arms: weakref.WeakSet[FrankaArm] = weakref.WeakSet()


def _stop_on_interrupt(arm: FrankaArm) -> None:
    """Let Ctrl-C stop this arm's running skill, also one that nobody waits for.

    Only where Ctrl-C means KeyboardInterrupt: a handler of the script's own stays, and threads have none.
    """
    _arms.add(arm)
    in_main_thread = threading.current_thread() is threading.main_thread()
    if in_main_thread and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupted)


def _interrupted(signum: int, frame: FrameType | None) -> None:
    for arm in list(_arms):
        if arm._motion is not None and arm._connection is not None:
            arm._connection.stop_from_signal_handler()
    signal.default_int_handler(signum, frame)
