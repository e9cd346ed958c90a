"""The same motion, stiff and soft. Start an arm first: `frankapy sim`.

Stiff is the robot's own joint impedance, which follows a position; soft is the server's Cartesian impedance, a spring
of as many N/m as are asked for between the tool and the curve.
"""

import numpy as np

from frankapy import FrankaArm, RigidTransform

fa = FrankaArm()
fa.reset_joints(duration=2)

for title, arguments in {
    "robot's own impedance": {"use_impedance": False},
    "600 N/m": {},
    "200 N/m": {"cartesian_impedances": [200, 200, 200, 30, 30, 30]},
}.items():
    goal = fa.get_pose()
    goal.translation += [0.1, 0.1, -0.1]  # m
    fa.goto_pose(goal, duration=2, **arguments)
    error = 1000 * np.linalg.norm(fa.get_pose().translation - goal.translation)
    print(f"{title:24} ends {error:5.2f} mm beside its goal")

    back = RigidTransform(translation=[-0.1, -0.1, 0.1], from_frame="world", to_frame="world")
    fa.goto_pose_delta(back, duration=2, use_impedance=False)
