"""FrankaArmStateClient: the state of an arm, for programs that do not move it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from frankapy.franka_arm import FrankaArm
from frankapy.rigid_transform import RigidTransform
from frankapy.ros_messages import RobotState


class FrankaArmStateClient:
    """Reads the state of an arm; others may command it meanwhile.

    Example:
        >>> FrankaArmStateClient().get_joints()
    """

    def __init__(
        self,
        new_ros_node: bool = True,
        robot_state_server_name: str = "/get_current_robot_state_server_node_1/get_current_robot_state_server",
        offline: bool = False,
    ) -> None:
        """Connect to the server; the number in `robot_state_server_name` tells the arm, `new_ros_node` means nothing."""
        digits = [part.rpartition("_")[2] for part in robot_state_server_name.split("/")]
        robot_num = next((int(digit) for digit in digits if digit.isdecimal()), 1)
        self._arm = FrankaArm(robot_num=robot_num, offline=offline)

    def get_data(self) -> dict[str, Any]:
        """Return the state as FrankaArm.get_robot_state does."""
        return self._arm.get_robot_state()

    def get_pose(self) -> RigidTransform:
        """Return the pose of the robot's end-effector frame; franka_tool_base to world."""
        return self._arm.get_pose(include_tool_offset=False)

    def get_joints(self) -> np.ndarray:
        """Return the joint positions, rad, (7,)."""
        return self._arm.get_joints()

    def get_joint_torques(self) -> np.ndarray:
        """Return the measured torques, Nm, (7,)."""
        return self._arm.get_joint_torques()

    def get_joint_velocities(self) -> np.ndarray:
        """Return the joint velocities, rad/s, (7,)."""
        return self._arm.get_joint_velocities()

    def get_gripper_width(self) -> float:
        """Return the width between the fingers, m."""
        return self._arm.get_gripper_width()

    def get_gripper_is_grasped(self) -> bool:
        """Return whether the hand holds an object."""
        return self._arm.get_gripper_is_grasped()

    def get_ee_force_torque(self) -> np.ndarray:
        """Return the estimated external wrench, base axes, N and Nm, (6,)."""
        return self._arm.get_ee_force_torque()

    def _get_current_robot_state(self) -> SimpleNamespace:
        """Return the answer of the service that this was made for; scripts look into it."""
        return SimpleNamespace(robot_state=RobotState(self._arm.get_arm_state()))
