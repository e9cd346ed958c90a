"""Targets from another process that knows nothing of the robot's clock, as from MoveIt. Start an arm first: `frankapy sim`.

A planner sends whole trajectories, which are points and times from their start (trajectory_msgs/JointTrajectory); MoveIt Servo
sends one target after the other, when it has one. Both go into the same skill, over the same topic.
"""

import multiprocessing
import time

import numpy as np

from frankapy import FrankaArm, FrankaConstants, SensorPublisher, proto
from frankapy.parts import JointImpedance, SensorSays, StreamJoint
from frankapy.utils import min_jerk

HOME = np.array(FrankaConstants.HOME_JOINTS)
GOAL = HOME + [0.3, 0.1, 0, 0.1, 0, 0.2, -0.3]


def planner() -> None:
    """Stand in for MoveIt: in a process of its own, here or on another computer."""
    with SensorPublisher("moveit") as joints, SensorPublisher("moveit_ends") as ends:
        # A planned trajectory. Whatever is sent before it is over takes the place of what is left of it.
        time_from_start = np.arange(1, 16) * 0.2
        points = np.array([min_jerk(HOME, GOAL, t, 3.0) for t in time_from_start])
        joints.publish(proto.JointChunk(times=time_from_start, joints=points.ravel()))
        time.sleep(3.5)

        # Servo: back and forth, some 50 targets a second, not evenly.
        begin = time.time()
        while (t := time.time() - begin) < 3:
            target = GOAL.copy()
            target[0] += 0.1 * np.sin(2 * np.pi * t / 3)
            joints.publish(proto.JointPositionSensorMessage(joints=target))
            time.sleep(np.random.uniform(0.01, 0.03))
        ends.publish(proto.ShouldTerminateSensorMessage(should_terminate=True))


if __name__ == "__main__":
    fa = FrankaArm()
    fa.goto_joints(HOME, 2)
    fa.run(StreamJoint("moveit"), JointImpedance(), SensorSays("moveit_ends"), block=False)
    process = multiprocessing.get_context("spawn").Process(target=planner)
    process.start()
    fa.wait_for_skill()
    process.join()
    print("ended by", fa.last_skill_result.termination)
    print("from the goal:", np.round(np.abs(fa.get_joints() - GOAL).max(), 3), "rad")
    topic = fa.topics()["moveit"]
    print(f"received {topic.received}, lost {topic.lost}, late {topic.late}")
