"""Move the arm a little. Start one first: `frankapy sim`."""

from frankapy import FrankaArm

fa = FrankaArm()
fa.reset_joints(duration=2)
pose = fa.get_pose()
pose.translation[2] -= 0.1  # m
fa.goto_pose(pose, duration=2)
print(fa.get_pose())
