"""Carry a block over a table. Start the arm with it: `frankapy sim --scene table_with_block`."""

import numpy as np

from frankapy import FrankaArm, RigidTransform

BLOCK = np.array([0.5, -0.15, 0.02])  # m, its middle, in the base of the arm
GOAL = np.array([0.5, 0.15, 0.02])
ABOVE = np.array([0, 0, 0.15])


def pointing_down(position: np.ndarray) -> RigidTransform:
    """Return the pose of the tool at a position, fingers down."""
    return RigidTransform(np.diag([1.0, -1.0, -1.0]), position, from_frame="franka_tool", to_frame="world")


fa = FrankaArm()
fa.reset_joints(duration=2)
fa.open_gripper()
fa.goto_pose(pointing_down(BLOCK + ABOVE), duration=2)
fa.goto_pose(pointing_down(BLOCK), duration=1.5)
fa.goto_gripper(0.02, grasp=True, force=20)
fa.goto_pose(pointing_down(BLOCK + ABOVE), duration=1.5)
fa.goto_pose(pointing_down(GOAL + ABOVE), duration=2)
fa.goto_pose(pointing_down(GOAL), duration=1.5)
fa.open_gripper()
fa.goto_pose(pointing_down(GOAL + ABOVE), duration=1.5)
