"""Two arms at once, from one script. Start them first: `frankapy sim --robot fr3 --robot fer`."""

import numpy as np

from frankapy import FrankaArm, FrankaConstants

left, right = FrankaArm(robot_num=1), FrankaArm(robot_num=2)

for arm in (left, right):
    arm.reset_joints(duration=2, block=False)
for arm in (left, right):
    arm.wait_for_skill()

for side in (0.5, -0.5, 0):
    turned = np.array(FrankaConstants.HOME_JOINTS) + [side, 0, 0, 0, 0, 0, 0]
    mirrored = np.array(FrankaConstants.HOME_JOINTS) - [side, 0, 0, 0, 0, 0, 0]
    left.goto_joints(turned, duration=2, block=False)
    right.goto_joints(mirrored, duration=2, block=False)
    left.wait_for_skill()
    right.wait_for_skill()
    print("left:", np.round(left.get_joints(), 3), " right:", np.round(right.get_joints(), 3))
