"""Motions that wait for each other, blend into each other, or take over: without a gap, inside the limits."""

import asyncio
import re

import numpy as np
import pytest

from frankapy import FrankaArm, FrankaArmArgumentError, FrankaArmException, RigidTransform, proto
from frankapy.parts import (
    CartesianImpedance,
    InternalImpedance,
    JointImpedance,
    MinJerkJoint,
    Moved,
    RelativeMinJerkJoint,
    RelativeMinJerkPose,
    StreamJoint,
    Time,
    TimeOptimalJoint,
)

TRUTH_FILE = True
HOME = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
LONG = 1000  # s of the robot's clock; in lockstep, many seconds of ours
STEP = np.array([0.1, -0.1, 0.1, 0.1, -0.1, 0.1, 0.1])


def speeds(arm, first, last):
    rows = arm.truth(since=first)
    return np.abs(rows[rows["cycle"] <= last]["dq"]).max(axis=1)


def test_a_sequence_goes_on_without_a_gap(ideal_arm):
    with ideal_arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 0.7))
        fa.wait_for(lambda state: np.abs(state.robot.dq).max() < 5e-4, 30)
        began = ideal_arm.cycle()
        with fa.sequence() as results, ideal_arm.standing_still():
            for delta in (STEP, STEP, -STEP):
                fa.run(RelativeMinJerkJoint(delta, 0.5))
            fa.goto_joints(HOME, 0.5)
        assert [result.ending for result in results] == [proto.TERMINATED] * 4
        np.testing.assert_allclose(fa.get_joints(), HOME, atol=5e-3)
        # From the first motion to the last it is at rest for a cycle or two between them.
        rows = ideal_arm.truth(since=began)
        moving = np.flatnonzero(np.abs(rows["dq"]).max(axis=1) > 1e-3)
        resting = np.diff(moving)
        assert sorted(resting)[-4] <= 30 and len(resting[resting > 30]) <= 3
        assert moving[-1] - moving[0] == pytest.approx(1000 * sum(result.time for result in results), abs=60)


def test_what_comes_after_a_failure_is_cancelled_even_when_it_comes_late(ideal_arm):
    with ideal_arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 0.7))
        with pytest.raises(FrankaArmException, match="joint_reflex"), fa.sequence() as results:
            fa.run(RelativeMinJerkJoint(STEP, LONG))
            ideal_arm.simulation.inject("joint_reflex")
            fa._motions.running.call.final()
            fa.recover()
            fa.run(RelativeMinJerkJoint(STEP, 1))
        assert [result.ending for result in results] == [proto.ROBOT_ERROR, proto.CANCELLED]


def test_relative_goals_count_from_the_goal_before(fa):
    with fa.sequence():
        fa.run(MinJerkJoint(HOME + STEP, 0.5))
        fa.run(RelativeMinJerkPose([0, 0, 0.05], frame="base", duration=0.5), InternalImpedance(K_x=[2500] * 3 + [250] * 3))
        fa.run(RelativeMinJerkPose([0, 0, -0.05], frame="base", duration=0.5), CartesianImpedance(2000, 100))
        fa.run(RelativeMinJerkJoint(-STEP, 0.5), JointImpedance())
    # Another robot controller begins where the arm is, which friction keeps beside its reference.
    np.testing.assert_allclose(fa.get_joints(), HOME, atol=1e-2)


def test_what_a_queued_motion_is_checked_against_is_the_goal_before(fa):
    up = RelativeMinJerkJoint([0, 0, 0, 0.9, 0, 0, 0], 1)
    fa.run(up, until=Moved(0.001))  # it fits from here
    fa.goto_joints(HOME, 0.5)
    with pytest.raises(FrankaArmArgumentError, match="beyond the arm's range"), fa.sequence():
        fa.run(RelativeMinJerkJoint([0, 0, 0, 1.5, 0, 0, 0], 1))
        fa.run(up)
    assert fa.is_skill_done()


@pytest.mark.parametrize("lower", ["joints", "pose"])
def test_walls_of_a_delta_are_looked_for_from_where_the_motion_before_ends(lower, fa):
    fa.goto_joints(HOME, 0.5)
    down = RigidTransform(translation=[0, 0, 0.3], from_frame="franka_tool", to_frame="franka_tool")
    low = fa.get_pose()
    low.translation[2] -= 0.3
    joints = fa.ik(low)
    with pytest.raises(FrankaArmArgumentError, match="goto_pose_delta would bring the tool"), fa.sequence():
        fa.goto_joints(joints, 2) if lower == "joints" else fa.goto_pose_delta(down, 2, use_impedance=False)
        fa.goto_pose_delta(down, 2)
    fa.goto_joints(joints, 2)
    with pytest.raises(FrankaArmArgumentError, match="goto_pose_delta would bring the tool"):
        fa.goto_pose_delta(down, 2)
    with fa.sequence():
        fa.goto_joints(HOME, 2) if lower == "joints" else fa.goto_pose_delta(down.inverse(), 2, use_impedance=False)
        fa.goto_pose_delta(down, 2, use_impedance=False)
    np.testing.assert_allclose(fa.get_pose().translation, low.translation, atol=5e-3)


def test_blended_motions_do_not_stop(ideal_arm):
    with ideal_arm.client() as fa:
        slowest = {}
        for blend in (0, 0.3):
            fa.run(MinJerkJoint(HOME, 0.7))
            with fa.sequence(blend=blend) as results, ideal_arm.standing_still():
                for i in range(3):
                    fa.run(MinJerkJoint(HOME + (i + 1) * STEP, 0.8))
            first, _, last = (ideal_arm.cycle(result.last_state.robot.message_id) for result in results)
            slowest[blend] = speeds(ideal_arm, first - 100, last - 400).min()
            np.testing.assert_allclose(fa.get_joints(), HOME + 3 * STEP, atol=1e-3)
        assert slowest[0] < 1e-3 and slowest[0.3] > 0.01


def test_slow_motions_blend_as_quick_ones_do(ideal_arm):
    with ideal_arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 0.7))
        with fa.sequence(blend=0.3) as results, ideal_arm.standing_still():
            for i in range(3):
                fa.run(MinJerkJoint(HOME + (i + 1) * STEP, 0.4), speed=0.5)
        first, _, last = (ideal_arm.cycle(result.last_state.robot.message_id) for result in results)
        rows = ideal_arm.truth(since=first - 100)
        along = rows[rows["cycle"] <= last - 400]["dq"] @ np.sign(STEP)
        assert along.min() > 0.05  # neither a stop nor back
        np.testing.assert_allclose(fa.get_joints(), HOME + 3 * STEP, atol=1e-3)


def test_what_is_queued_behind_a_stream_waits_for_its_end(fa):
    with fa.sequence(blend=0.3) as results:
        fa.run(StreamJoint("nobody"), JointImpedance(), Time(3))
        fa.run(MinJerkJoint(HOME, 1))
    assert results[0].time == pytest.approx(3, abs=0.1)


def test_behind_a_failure_everything_is_cancelled(ideal_arm):
    with ideal_arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 0.7))
        with pytest.raises(FrankaArmException, match="cartesian_reflex"), fa.sequence() as results:
            for _ in range(4):
                fa.run(RelativeMinJerkJoint(STEP, LONG))
            ideal_arm.simulation.inject("cartesian_reflex")
        assert [result.ending for result in results] == [proto.ROBOT_ERROR] + [proto.CANCELLED] * 3
        fa.recover()
        fa.goto_joints(HOME, 1)
        np.testing.assert_allclose(fa.get_joints(), HOME, atol=5e-3)


def test_stop_ends_all_that_are_queued(fa):
    with fa.sequence() as results:
        for _ in range(4):
            fa.run(RelativeMinJerkJoint(STEP, LONG))
        fa.stop_skill()
    assert [result.ending for result in results] == [proto.STOPPED] * 4
    assert fa.is_skill_done()


def test_an_exception_inside_stops_the_arm(fa):
    with pytest.raises(ZeroDivisionError), fa.sequence():
        fa.run(RelativeMinJerkJoint(STEP, LONG))
        raise ZeroDivisionError
    assert fa.is_skill_done()
    assert fa.last_skill_result.ending == proto.STOPPED
    fa.goto_joints(HOME, 1)


def test_a_queue_is_bounded(fa):
    with pytest.raises(FrankaArmException, match="skills are queued already"), fa.sequence():
        for _ in range(400):
            fa.run(RelativeMinJerkJoint(np.zeros(7), 5))


def test_a_bad_sequence_is_refused(fa):
    for blend in (-1, 11, np.nan, "long"):
        with pytest.raises(FrankaArmArgumentError, match="blend"), fa.sequence(blend):
            pass
    with pytest.raises(FrankaArmArgumentError, match="is being made already"), fa.sequence(), fa.sequence():
        pass
    with pytest.raises(FrankaArmArgumentError, match="preempt"), fa.sequence():
        fa.run(MinJerkJoint(HOME, 1), preempt=True)
    fa.goto_joints(HOME, 1)


@pytest.mark.parametrize(
    ("controller", "robot_controller"),
    [
        (InternalImpedance(), "auto"),
        (InternalImpedance(), "joint_velocity"),
        (JointImpedance(), "auto"),
        (JointImpedance(), "torque_and_joint_position"),
    ],
)
def test_a_motion_takes_over_in_the_middle(fa, controller, robot_controller):
    for _ in range(5):
        fa.run(MinJerkJoint(HOME + 3 * STEP, 1000), block=False)
        first = fa._motions.running
        result = fa.run(TimeOptimalJoint(HOME, 0.5), controller, preempt=True, robot_controller=robot_controller)
        assert first.call.final().skill_result.ending == proto.PREEMPTED
        assert result.ending == proto.TERMINATED
        np.testing.assert_allclose(fa.get_joints(), HOME, atol=5e-3)


def test_a_coroutine_waits_while_others_run(fa):
    async def motion():
        fa.goto_joints(HOME + [0.1, 0, 0, 0, 0, 0, 0], 2, block=False, ignore_virtual_walls=True)
        return await fa.finished()

    async def other():
        for _ in range(5):
            await asyncio.sleep(0)
        return "meanwhile"

    async def both():
        return await asyncio.gather(motion(), other())

    result, text = asyncio.run(both())
    assert result.ending == proto.TERMINATED and text == "meanwhile"
    assert fa.is_skill_done()


def test_a_coroutine_that_is_cancelled_stops_the_arm(fa):
    async def main():
        fa.goto_joints(HOME + [0.3, 0, 0, 0, 0, 0, 0], 1000, block=False, ignore_virtual_walls=True)
        await asyncio.wait_for(fa.finished(), 0.05)

    with pytest.raises(asyncio.TimeoutError):
        asyncio.run(main())
    fa.wait_for_skill()
    assert fa.last_skill_result.ending == proto.STOPPED


def test_a_coroutine_waits_for_the_hand_while_the_arm_moves(fa):
    async def both():
        fa.goto_joints(HOME + [0.1, 0, 0, 0, 0, 0, 0], 1000, block=False, ignore_virtual_walls=True)
        for width in (0.02, 0.06):
            fa.goto_gripper(width, block=False)
            await fa.gripper_finished()
            assert fa.get_gripper_width() == pytest.approx(width, abs=0.002)
        await fa.gripper_finished()  # nothing is left to wait for
        assert not fa.is_skill_done()
        fa.goto_gripper(0.04, grasp=True, epsilon_inner=0.001, epsilon_outer=0.001, block=False)
        with pytest.raises(FrankaArmException, match="The gripper did not succeed"):
            await fa.gripper_finished()

    asyncio.run(both())
    fa.stop_skill()


def test_a_coroutine_that_is_cancelled_stops_the_hand(fa):
    fa.goto_gripper(0.08)

    async def main():
        fa.goto_gripper(0.0, speed=0.001, block=False)
        while fa.get_gripper_width() > 0.078:
            await asyncio.sleep(0)
        waiting = asyncio.ensure_future(fa.gripper_finished())
        await asyncio.sleep(0)
        waiting.cancel()
        await waiting

    with pytest.raises(asyncio.CancelledError):
        asyncio.run(main())
    fa.wait_for_gripper()
    assert fa.get_gripper_width() > 0.01
    fa.open_gripper()
    assert fa.get_gripper_width() == pytest.approx(0.08, abs=0.002)


def test_an_arm_says_which_it_is(fa):
    assert re.fullmatch(r"FrankaArm\(\w+: FR3 at 127[.\d]+, protocol version \d+\)", repr(fa))
    assert repr(FrankaArm(offline=True)) == "FrankaArm(offline)"
