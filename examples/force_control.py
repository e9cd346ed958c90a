"""Press on a surface with 10 N and wipe along it. Start an arm first: `frankapy sim --scene plate`.

Hybrid control: along z a force, along x and y a motion.
"""

from frankapy import FrankaArm
from frankapy.parts import AnyOf, CartesianImpedance, ForceAbove, HybridForcePosition, RelativeMinJerkPose, Time

fa = FrankaArm()
fa.reset_joints(duration=2)
fa.close_gripper(grasp=False)

pose = fa.get_pose()
pose.translation[:] = [0.45, -0.08, 0.23]  # m
fa.goto_pose(pose, duration=3)
fa.run(RelativeMinJerkPose([0, 0, -0.08], frame="base", duration=5), CartesianImpedance(400, 30), AnyOf(ForceAbove(4, axis="z"), Time(6)))

wipe = RelativeMinJerkPose([0, 0.16, 0], frame="base", duration=4)
fa.run(wipe, HybridForcePosition(force_axes=[0, 0, 1, 0, 0, 0], force=[0, 0, -10, 0, 0, 0]), block=False)
with fa.states(rate=10) as states:
    for state in states:
        if fa.is_skill_done():
            break
        print(f"{state.skill_time:4.1f} s: y = {1000 * state.robot.O_T_EE[13]:6.1f} mm, pressing with {-state.robot.O_F_ext_hat_K[2]:5.1f} N")
fa.reset_joints(duration=3)
