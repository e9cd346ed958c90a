"""Targets that are sent while the arm moves, 50 a second, as from a camera. Start an arm first: `frankapy sim`.

What comes of them is smooth and inside the arm's limits, whatever the network does to them.
"""

import math
import time

from frankapy import FrankaArm, SensorPublisher, proto
from frankapy.parts import InternalImpedance, SensorSays, StreamPose

fa = FrankaArm()
fa.reset_joints(duration=2)
center = fa.get_pose()

fa.run(StreamPose("target"), InternalImpedance(), SensorSays("end"), block=False)
with SensorPublisher("target") as target, SensorPublisher("end") as end:  # these may be in any other process
    begin = time.time()
    while (t := time.time() - begin) < 4:
        fade = min(1, t)
        position = center.translation + [0, 0.08 * fade * math.sin(math.pi * t), 0.05 * fade * math.sin(2 * math.pi * t)]
        target.publish(proto.PosePositionSensorMessage(position=position, quaternion=center.quaternion))
        time.sleep(0.02)
    end.publish(proto.ShouldTerminateSensorMessage(should_terminate=True))
fa.wait_for_skill()

print("ended by", fa.last_skill_result.termination)
print("received:", fa.topics()["target"].received)
