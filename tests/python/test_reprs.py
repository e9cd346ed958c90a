"""What a notebook shows of arms, states, results and poses: a line with units."""

import numpy as np
import pytest

from frankapy import FrankaArm, RigidTransform, proto
from frankapy.demonstration import Demonstration

JOINTS = [0, -0.785, -1e-5, -2.356, 0, 1.571, 0.785]
POSE = [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0.307, 0, 0.487, 1]
ROBOT = proto.RobotState(q=JOINTS, O_T_EE=POSE, O_F_ext_hat_K=[3, 0, 4, 0, 0, 0.5], robot_mode=proto.MOVE)
SHOWN = "joints [0.000 -0.785 0.000 -2.356 0.000 1.571 0.785] rad; tool at [0.307 0.000 0.487] m; 5.0 N and 0.5 Nm on it"


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (ROBOT, f"RobotState(move; {SHOWN})"),
        (
            proto.ArmState(
                phase=proto.RUNNING, robot=ROBOT, skill_id=3, skill_description="GoToPose", skill_time=1.2, age=4e-4,
                gripper=proto.GripperState(width=0.04, is_grasped=True),
            ),
            f"ArmState(running; skill 'GoToPose' since 1.20 s; {SHOWN}; hand 40.0 mm open, holds something; 0.4 ms old)",
        ),
        (proto.ArmState(robot=proto.RobotState(errors=["joint_reflex"])), "ArmState(errors joint_reflex)"),
        (proto.ArmState(), "ArmState()"),
        (proto.SkillResult(), "SkillResult()"),
        (
            proto.SkillResult(
                ending=proto.TERMINATED, termination="FinalPose", time=3.0124, stretch=1.5, position_left=3e-4,
                held_by=proto.MOTION_LIMITS | proto.WALL, wall="table",
            ),
            "SkillResult(terminated by FinalPose after 3.012 s; 1.50 times as long as asked for; "
            "held back by motion limits, wall 'table'; 0.3 mm left)",
        ),
        (
            proto.SkillResult(ending=proto.ROBOT_ERROR, time=0.2, stretch=1, errors=["cartesian_reflex"], message="it hit something"),
            "SkillResult(robot error after 0.200 s; cartesian_reflex; it hit something)",
        ),
        (proto.GripperResult(success=False, message="nothing there"), "GripperResult(no success: nothing there)"),
        (proto.JointLimits(q_min=[-1] * 2, dq_max=[2] * 2), "JointLimits(from [-1.000 -1.000] rad; up to [2.000 2.000] rad/s)"),
        (
            proto.RecordingStatus(open=True, file="a.mcap", time=2, states=2000, bytes=3_000_000),
            "RecordingStatus(a.mcap; 2.0 s, 2000 states, 3.0 MB, 0 lost)",
        ),
        (
            proto.Topics.Topic(topic="policy", message="JointChunk", received=10, lost=1, age=0.5),
            "Topic('policy' of JointChunk: 10 received; 1 lost; newest 0.500 s ago)",
        ),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, str) else "",
)  # fmt: skip
def test_a_message_shows_itself_in_a_line(message, expected):
    assert repr(message) == expected


def test_print_shows_all_of_a_message():
    assert "O_F_ext_hat_K: 3" in str(ROBOT)


def test_arms_poses_and_demonstrations_show_themselves():
    assert repr(FrankaArm(offline=True)) == "FrankaArm(offline)"
    pose = RigidTransform(np.eye(3), [0.3, 0, 0.5], "franka_tool", "world")
    assert "0.3" in repr(pose) and "franka_tool" in repr(pose) and len(repr(pose)) < 250
    assert repr(Demonstration(np.arange(101) * 0.01, np.zeros((101, 7)))) == "Demonstration(1.00 s, 101 samples of joints)"
