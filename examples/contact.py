"""Go down until something is touched. Start an arm first: `frankapy sim --scene plate`.

The motion ends by a force or a time, whichever comes first; the end of the way ends nothing where terminations are given. Nothing
stops the robot: the arm yields.
"""

from frankapy import FrankaArm
from frankapy.parts import AnyOf, CartesianImpedance, ForceAbove, RelativeMinJerkPose, Time

fa = FrankaArm()
fa.reset_joints(duration=3)
fa.close_gripper(grasp=False)

pose = fa.get_pose()
pose.translation[2] = 0.25  # m
fa.goto_pose(pose, duration=3)

down = RelativeMinJerkPose([0, 0, -0.1], frame="base", duration=6)  # m, s
result = fa.run(down, CartesianImpedance(400, 30), AnyOf(ForceAbove(5, axis="z"), Time(7)))

height = fa.get_pose().translation[2]
print(f"ended by {result.termination} after {result.time:.1f} s, {1000 * height:.0f} mm above the base")
pose.translation[2] = height + 0.1  # away from it first
fa.goto_pose(pose, duration=2)
fa.reset_joints(duration=3)
