"""Record a motion, and look at it. Start an arm and a server on this computer first: `frankapy sim`.

The file opens in Foxglove too; `frankapy plot FILE` draws a page of it.
"""

import numpy as np

from frankapy import FrankaArm
from frankapy.recording import Recording

fa = FrankaArm()
fa.reset_joints(duration=2)
pose = fa.get_pose()
pose.translation += [0.1, 0.1, -0.1]  # m

with fa.recording() as status:
    fa.goto_pose(pose, duration=2)

recording = Recording(status().file)
states = recording.states
moving = states["skill_id"] != 0
recording.plot().savefig("recording.png")
print(f"{recording.path}, drawn in recording.png")
print(f"{moving.sum()} cycles of motion, torques up to {np.abs(states['tau_J'][moving]).max(axis=0).round(1)} Nm")
