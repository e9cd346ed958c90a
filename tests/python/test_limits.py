"""What keeps a real arm whole: speed limits of the configuration, people who hold it, packets that are lost; judged by the truth."""

import numpy as np
import pytest
from conftest import FASTEST, HOME

from frankapy import FrankaArm, proto
from frankapy.parts import (
    CartesianImpedance,
    InternalImpedance,
    JointImpedance,
    MinJerkJoint,
    Never,
    PoseSamples,
    RelativeMinJerkPose,
    StreamJoint,
)

TRUTH_FILE = True


@pytest.mark.parametrize("robot", ["fr3", "fer"])
def test_the_configured_speed_bounds_joints_and_poses_alike(start, robot):
    arm = start(settings={"limits": {"velocity": 0.1}}, robot=robot)
    with arm.client() as fa:
        for impedance in (True, False):
            for go in (
                lambda impedance=impedance: fa.goto_joints(np.array(HOME) + 0.2, 0.5, use_impedance=impedance),
                lambda impedance=impedance: fa.goto_pose(beside(fa, [0.05, 0.2, -0.1]), 0.5, use_impedance=impedance),
            ):
                first = fa.get_arm_state().robot.message_id
                go()
                assert fa.last_skill_result.ending == proto.TERMINATED
                share = np.abs(arm.truth(since=first)["dq"]) / FASTEST[robot]
                assert 0.05 < share.max() < 0.115, share.max(axis=0)  # the arm swings about its reference


def beside(fa: FrankaArm, translation):
    """Return the pose that far (m) from the tool's, turned as it is."""
    pose = fa.get_pose()
    pose.translation = pose.translation + translation
    return pose


THRESHOLDS = {
    f"{side}_{what}_thresholds": [1000] * count
    for side in ("lower", "upper")
    for what, count in (("torque", 7), ("force", 6))
}
HELD = 3.0  # s


@pytest.mark.parametrize("robot", ["fr3", "fer"])
@pytest.mark.parametrize("of", ["joints", "pose"])
def test_an_arm_that_is_held_does_not_leap_when_it_is_let_go(start, robot, of):
    """200 N hold it where it is, for 3 s, while its target moves away; it then goes on as slowly as it was to."""
    arm = start(settings={"collision": THRESHOLDS}, robot=robot)
    with arm.client() as fa:
        fa.goto_joints(HOME, 2)
        with arm.standing_still():
            if of == "joints":
                # Soft enough for 200 N to hold them.
                fa.goto_joints(np.array(HOME) + [0.2, 0.2, 0, 0.2, 0, 0.2, 0], 4, block=False, use_impedance=True,
                               k_gains=[300] * 4 + [100] * 3, d_gains=[30] * 4 + [8] * 3)  # fmt: skip
            else:
                fa.goto_pose(beside(fa, [0, 0.2, 0]), 6, block=False, use_impedance=True)
            now = arm.simulation.truth()
            arm.simulation.hand(now.O_T_TCP[:3, 3], 0.001, duration=HELD, stiffness=10_000, damping=200, max_force=200)
        fa.wait_for_skill()
        result = fa.last_skill_result
        assert result.ending == proto.TERMINATED, result.message
        rows = arm.truth(since=now.cycle)
        force = np.linalg.norm(rows["push"][:, :3], axis=1)
        held = rows["time"] - now.time < HELD
        moved = np.linalg.norm(rows["O_T_TCP"].reshape(-1, 4, 4)[:, 3, :3] - now.O_T_TCP[:3, 3], axis=1)
        assert result.held_by & proto.HELD_ARM
        assert force.max() > 20
        assert moved[held].max() < 0.02, "it was held"
        assert np.abs(rows["dq"]).max() < 0.3
        assert moved[-1] > 0.1, "and went on"


def test_an_arm_that_something_keeps_from_its_goal_says_how_far_away_it_is(start, caplog):
    """A table in its way: the motion ends in its time, with a word of where the arm stands."""
    with start(scene="table_with_block", ideal=True).client() as fa:
        fa.goto_joints(HOME, 2)
        pose = beside(fa, [0.2, -0.1, -0.15])
        fa.goto_pose(pose, 2, use_impedance=True)
        assert not fa.last_skill_result.message and not fa.last_skill_result.held_by
        assert fa.last_skill_result.position_left < 2e-3 and fa.last_skill_result.angle_left < 0.01
        pose = beside(fa, [0, 0, -0.41])
        fa.goto_pose(pose, 12, use_impedance=True, cartesian_impedances=[100, 100, 100, 30, 30, 30], ignore_virtual_walls=True)
        result = fa.last_skill_result
        assert result.ending == proto.TERMINATED
        away = np.linalg.norm(fa.get_pose().translation - pose.translation)
        assert result.position_left == pytest.approx(away, abs=2e-3) and away > 0.05
        assert f"{1e3 * result.position_left:.0f} mm" in caplog.text and "away from its goal" in caplog.text


NINE = {
    "torque": JointImpedance(),
    "joint_position": InternalImpedance(),
    "joint_velocity": InternalImpedance(),
    "cartesian_pose": InternalImpedance(),
    "cartesian_velocity": InternalImpedance(),
    "torque_and_joint_position": JointImpedance(),
    "torque_and_joint_velocity": JointImpedance(),
    "torque_and_cartesian_pose": CartesianImpedance(),
    "torque_and_cartesian_velocity": CartesianImpedance(),
}


def lose_packets(arm, robot_controller: str, seconds: float) -> None:
    """Move for so long (s) while one packet in twenty is lost each way: no error, inside the limits."""
    with arm.client() as fa:
        fa.goto_joints(HOME, 2)
        arm.simulation.network(loss_in=0.05, loss_out=0.05)
        try:
            begin = fa.get_arm_state().robot.message_id
            sign = 1
            while fa.get_arm_state().robot.message_id - begin < 1000 * seconds:
                if "cartesian" in robot_controller:
                    way = RelativeMinJerkPose(sign * np.array([0.08, 0.12, -0.1]), duration=0.9)
                else:
                    way = MinJerkJoint(np.array(HOME) + (0.15 + sign * 0.15), 0.9)
                result = fa.run(way, NINE[robot_controller], robot_controller=robot_controller)
                assert result.ending == proto.TERMINATED, f"{robot_controller}: {result.message}"
                sign = -sign
        finally:
            arm.simulation.network()


@pytest.mark.parametrize("robot_controller", NINE)
def test_lost_packets_end_no_motion(default_arm, robot_controller):
    lose_packets(default_arm, robot_controller, 5)


def test_samples_that_begin_beside_the_reference_are_caught_up_with_while_packets_are_lost(start):
    arm = start(robot="fer", truth=False)
    with arm.client() as fa:
        arm.simulation.network(loss_in=0.05, loss_out=0.05, seed=11)
        aside = 0.05 * (1 - np.cos(np.pi * np.linspace(0, 2, 2001)))[:, None] * [1, 1, 0.5]
        for _ in range(6):
            here = fa.get_pose(include_tool_offset=False)  # where it is, and not where it was to be
            samples = PoseSamples(here.translation + aside, np.tile(here.quaternion, (len(aside), 1)))
            result = fa.run(samples, InternalImpedance())
            assert result.ending == proto.TERMINATED
            assert result.time < 2.5


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("robot", ["fr3", "fer"])
@pytest.mark.parametrize("robot_controller", NINE)
def test_lost_packets_end_no_motion_in_a_minute(start, robot, robot_controller):
    lose_packets(start(robot=robot, truth=False), robot_controller, 60)


@pytest.mark.parametrize("robot", ["fer", "fr3"])
@pytest.mark.parametrize("controller", [InternalImpedance(), JointImpedance()], ids=["robot", "torque"])
def test_what_is_streamed_into_the_arm_itself_ends_before_it(start, robot, controller):
    """There the fingers would meet the shoulder."""
    folded = np.array([0, -0.5, 0, -2.7, 0, 1.4, np.pi / 4])
    with start(robot=robot, ideal=True).client() as fa:
        fa.goto_joints(folded, 2, ignore_virtual_walls=True)
        fa.run(StreamJoint("goal", delay=0, timeout=0), controller, Never(), block=False)
        with fa.publisher("goal") as publisher:
            publisher.publish(proto.JointPositionSensorMessage(joints=[*folded[:5], 0.5, folded[6]]))
            fa.wait_for(lambda state: state.robot.q[5] < 1.2 and max(np.abs(state.robot.dq)) < 1e-3, timeout=60)
            publisher.publish(proto.JointPositionSensorMessage(joints=folded))
            fa.wait_for(lambda state: state.robot.q[5] > 1.39, timeout=60)  # the way back is open
        fa.stop_skill()
        result = fa.last_skill_result
        assert result.ending == proto.STOPPED, result.message
        assert result.held_by & proto.ITSELF
