"""A learned policy in a loop: observations in, chunks of future actions out, ten a second. Start an arm first: `frankapy sim`.

Each chunk says where the joints are to be at several times from now; what was sent before for later is replaced.
"""

import time

import numpy as np

from frankapy import FrankaArm, FrankaConstants, SensorPublisher, proto
from frankapy.parts import JointImpedance, SensorSays, StreamJoint

HOME = np.array(FrankaConstants.HOME_JOINTS)
TIMES = np.arange(1, 9) * 0.05  # s from now


def policy(joints: np.ndarray) -> np.ndarray:
    """Stand in for a network: 0.4 s of actions towards a goal, rad (8, 7)."""
    goal = HOME + [0.3, 0.1, 0, 0.1, 0, 0.2, -0.3]
    steps = np.clip(goal - joints, -0.4, 0.4)  # rad/s
    return joints + np.outer(TIMES, steps)


fa = FrankaArm()
fa.reset_joints(duration=2)
fa.run(StreamJoint("policy"), JointImpedance(), SensorSays("end"), block=False)
with SensorPublisher("policy") as actions, SensorPublisher("end") as end:
    for _ in range(30):
        state = fa.get_arm_state()  # and the picture of a camera
        chunk = policy(np.array(state.q_ref or state.robot.q))
        actions.publish(proto.JointChunk(times=TIMES, joints=chunk.ravel()))
        time.sleep(0.1)
    end.publish(proto.ShouldTerminateSensorMessage(should_terminate=True))
fa.wait_for_skill()
print("joints:", np.round(fa.get_joints(), 3))
