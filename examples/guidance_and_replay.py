"""Lead the arm by hand along a plane; it then does exactly that again. Start an arm first, a real one, or `frankapy sim`.

Of a simulated arm the hand is `frankapy.sim.ControlChannel(ADDRESS).hand(positions, times)`, from another terminal, as in
docs/imitation.md.
"""

import numpy as np

from frankapy import FrankaArm
from frankapy.parts import JointSamples

fa = FrankaArm()
fa.reset_joints(duration=2)

print("Lead the arm for 8 s: it yields to the side and up, and neither forwards nor in its orientation.")
shown = fa.demonstrate(8, use_impedance=True, cartesian_impedances=[1000, 0, 0, 50, 50, 50])
motion = shown.trimmed().smooth()
motion = motion.resampled(round(1000 * motion.duration) + 1)  # one for each ms
print(motion)

fa.goto_joints(motion.joints[0], duration=2)
fa.run(JointSamples(motion.joints))
print(f"ends {1000 * np.linalg.norm(fa.get_pose().translation - motion.positions[-1]):.1f} mm from where the hand let go")
