"""Sensor messages into skills that run: targets, velocities, ends; and other parts for a skill that runs."""

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from frankapy import (
    FrankaArm,
    FrankaArmArgumentError,
    FrankaArmException,
    FrankaArmFrankaInterfaceNotReadyException,
    FrankaConstants,
    SensorPublisher,
    cli,
    proto,
)
from frankapy.parts import (
    CartesianImpedance,
    Contact,
    ForcePosition,
    FreeDrive,
    InternalImpedance,
    JointImpedance,
    JointSamples,
    MinJerkJoint,
    MinJerkPose,
    Never,
    PassThroughJointTorque,
    PoseDmp,
    SensorSays,
    Silence,
    StayJoint,
    StayPose,
    StreamCartesianVelocity,
    StreamForcePosition,
    StreamJoint,
    StreamJointVelocity,
    StreamPose,
    Time,
    TimeOptimalJoint,
)
from frankapy.sim import SimulatedArm, Simulation

HOME = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
NEAR = HOME + [0.1, -0.1, 0.1, 0.1, -0.1, 0.1, 0.1]
END = proto.ShouldTerminateSensorMessage(timestamp=0, should_terminate=True)
GO_ON = proto.ShouldTerminateSensorMessage(timestamp=0, should_terminate=False)


def run_after(fa, seconds: float, *parts) -> float:
    """Start a skill that begins so much later, or later still where this computer takes too long to say so; return when."""
    for patience in (1, 5, 25):
        at = time.time() + patience * seconds
        try:
            fa.run(*parts, start_time=at, block=False)
        except FrankaArmArgumentError:
            if time.time() < at:
                raise
        else:
            return at
    raise TimeoutError("this computer stalls")


def wait_for(fa, condition, longest=100.0):
    until = time.monotonic() + longest
    while not condition():
        assert time.monotonic() < until, f"it has not come; {fa.get_arm_state()}\n{fa.topics()}\nbefore: {fa.last_skill_result}"
        time.sleep(0.005)


def publish_in_time(fa, publisher, topic, message):
    """Publish until one has not been held up for as long as the timeout, which is stale."""

    def taken():
        what = fa.topics().get(topic)
        return what.received - what.stale if what else 0

    before = taken()
    wait_for(fa, lambda: publisher.publish(message) or taken() > before)


# --- targets ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("controller", [InternalImpedance(), JointImpedance()])
def test_joints_that_are_published_are_gone_to(fa, controller):
    fa.run(StreamJoint("goal", delay=0, timeout=0), controller, Never(), block=False)
    with fa.publisher("goal") as publisher:
        publisher.publish(proto.JointPositionSensorMessage(id=1, timestamp=0, joints=NEAR))
        wait_for(fa, lambda: np.abs(fa.get_joints() - NEAR).max() < 0.01)
        back = proto.JointPositionVelocitySensorMessage(joints=HOME, joint_vels=[0] * 7)
        wait_for(fa, lambda: publisher.publish(back) or np.abs(fa.get_joints() - HOME).max() < 0.01)
    fa.stop_skill()
    assert fa.last_skill_result.ending == proto.STOPPED


@pytest.mark.parametrize(
    "controller",
    [InternalImpedance(), *(pytest.param(law, marks=pytest.mark.nightly) for law in (CartesianImpedance(600, 50), JointImpedance()))],
)
def test_poses_out_of_reach_are_gone_to_as_far_as_it_goes_and_left_again(fa, controller):
    fa.goto_joints(HOME, 1)
    home = fa.get_pose()
    fa.run(StreamPose("pose", delay=0, timeout=0), controller, block=False)  # and nothing ends it
    with fa.publisher("pose") as publisher:
        def send(place):
            publisher.publish(proto.PosePositionSensorMessage(position=place, quaternion=home.quaternion))
            return fa.get_arm_state().robot.message_id

        for place in ([1.9, 0, 0.4], [0.75, 0, 0.4], [0.4, 0, 1.6], [0.8, 0, 0.2]):
            sent = send(place)
            fa.wait_for(lambda state, sent=sent: state.robot.message_id > sent + 1000 and np.abs(state.robot.dq).max() < 2e-3, 120)
            send(home.translation)
            fa.wait_for(lambda state: np.linalg.norm(state.robot.O_T_EE[12:15] - home.translation) < 0.02, 120)
    fa.stop_skill()
    assert fa.last_skill_result.ending == proto.STOPPED


@pytest.mark.parametrize("controller", [InternalImpedance(), CartesianImpedance(1500, 100)])
def test_poses_that_are_published_are_gone_to(fa, controller):
    goal = fa.get_pose(include_tool_offset=False)
    goal.translation = goal.translation + [0.05, 0.06, -0.05]
    fa.run(StreamPose("pose", delay=0, timeout=0), controller, Never(), block=False)
    with fa.publisher("pose") as publisher:
        publisher.publish(proto.PosePositionSensorMessage(position=goal.translation, quaternion=goal.quaternion))
        wait_for(fa, lambda: np.abs(fa.get_pose(include_tool_offset=False).translation - goal.translation).max() < 0.005)
    fa.stop_skill()


def test_velocities_that_are_published_are_kept_until_they_cease(fa):
    for trajectory, message in [
        (StreamJointVelocity("speed", 0.5), proto.JointVelocitySensorMessage(joint_velocities=[0.2] + [0] * 6)),
        (StreamCartesianVelocity("speed", 0.5), proto.CartesianVelocitySensorMessage(cartesian_velocities=[0, 0.05, 0, 0, 0, 0])),
    ]:
        fa.run(MinJerkJoint(HOME, 1))
        fa.run(trajectory, InternalImpedance(), Never(), block=False)
        with fa.publisher("speed") as publisher:
            wait_for(fa, lambda message=message: publisher.publish(message) or np.abs(fa.get_joints() - HOME).max() > 0.03)
        wait_for(fa, lambda: np.abs(fa.get_joint_velocities()).max() < 1e-4)
        assert not fa.is_skill_done()
        fa.stop_skill()


def test_a_stream_and_a_chunk_move_the_arm_until_a_message_ends_it(fa):
    fa.run(StreamJoint("policy"), InternalImpedance(), SensorSays("end"), block=False)
    with fa.publisher("policy") as publisher, fa.publisher("end") as end:
        for i in range(20):
            publisher.publish(proto.JointPositionSensorMessage(joints=HOME + 0.1 * np.sin(0.4 * i)))
            time.sleep(0.01)
        wait_for(fa, lambda: np.abs(fa.get_joints() - HOME).max() > 0.01)
        chunk = proto.JointChunk(times=[0.05, 0.1, 0.15], joints=np.tile(NEAR, 3))
        wait_for(fa, lambda: publisher.publish(chunk) or np.abs(fa.get_joints() - NEAR).max() < 0.01)
        end.publish(END)
        fa.wait_for_skill()
    assert fa.last_skill_result.ending == proto.TERMINATED
    assert fa.last_skill_result.termination == "SensorSays"


def test_dynamic_motions_of_the_published_interface_follow_their_topic(fa):
    with fa.publisher(FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC) as publisher:
        fa.goto_joints(HOME, dynamic=True, buffer_time=1000)
        near = proto.JointPositionSensorMessage(joints=NEAR)
        wait_for(fa, lambda: publisher.publish(near) or np.abs(fa.get_joints() - NEAR).max() < 0.01)
        publisher.publish(END)
        fa.wait_for_skill()
        assert fa.last_skill_result.termination == "SensorSays"

        pose = fa.get_pose()
        fa.goto_pose(pose, dynamic=True, buffer_time=1000)
        target = pose.translation + [0, 0, 0.05]
        there = proto.PosePositionSensorMessage(position=target, quaternion=pose.quaternion)
        wait_for(fa, lambda: publisher.publish(there) or np.abs(fa.get_pose().translation - target).max() < 0.005)
        fa.stop_skill()

        fa.execute_joint_velocities([0] * 7, [0] * 7, dynamic=True, buffer_time=1000)
        faster = proto.JointVelocitySensorMessage(joint_velocities=[0, 0, 0, 0, 0, 0, 0.3])
        wait_for(fa, lambda: publisher.publish(faster) or fa.get_joints()[6] > NEAR[6] + 0.02)
        publisher.publish(END)
        fa.wait_for_skill()
        assert fa.last_skill_result.termination == "SensorSays"

        before = fa.get_pose().translation[2]
        fa.execute_cartesian_velocities([0] * 6, [0] * 6, dynamic=True, buffer_time=1000)
        up = proto.CartesianVelocitySensorMessage(cartesian_velocities=[0, 0, 0.1, 0, 0, 0])
        wait_for(fa, lambda: publisher.publish(up) or fa.get_pose().translation[2] > before + 0.01)
        fa.stop_skill()


@pytest.mark.parametrize(
    "move",
    [
        lambda fa: fa.run_guide_mode(1000, block=False),
        lambda fa: fa.goto_joints(NEAR, 1000, block=False),
        lambda fa: fa.goto_pose(fa.get_pose(), 1000, block=False, force_thresholds=[100] * 6),
        lambda fa: fa.execute_joint_velocities([0] * 6 + [1e-4], [0] * 7, 1000, block=False),
        lambda fa: fa.selective_guidance_mode(1000, block=False),
    ],
    ids=["guided", "joints", "pose", "velocities", "held"],
)
def test_a_message_ends_any_motion_of_the_published_interface_and_none_that_comes_later(fa, move):
    topic = FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC
    with fa.publisher(topic) as publisher:
        move(fa)
        publisher.publish(END)
        fa.wait_for_skill()
        assert fa.last_skill_result.termination == "SensorSays"
        received = fa.topics()[topic].received
        publisher.publish(END)
        wait_for(fa, lambda: fa.topics()[topic].received > received)
        fa.goto_joints(HOME, 1)
    assert fa.last_skill_result.termination == "FinalJoint"


def test_a_message_ends_one_motion_of_a_sequence(fa):
    with fa.publisher(FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC) as publisher, fa.sequence(blend=0.2) as results:
        fa.goto_joints(NEAR, 1000)
        fa.goto_joints(HOME, 1)
        publisher.publish(END)
    assert [result.termination for result in results] == ["SensorSays", "FinalJoint"]


def test_torques_that_are_published_turn_a_joint_and_gains_hold_it(fa):
    with fa.publisher(FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC) as publisher:
        fa.execute_joint_torques([0] * 7, dynamic=True, buffer_time=1000)
        before = fa.get_joints()
        last = [0] * 6 + [1]
        publisher.publish(proto.JointTorqueControllerSensorMessage(selection=last, joint_torques=[0] * 6 + [0.4]))
        wait_for(fa, lambda: fa.get_joints()[6] > before[6] + 0.1)
        np.testing.assert_allclose(fa.get_joints()[:6], before[:6], atol=0.02)
        held = proto.JointTorqueControllerSensorMessage(selection=[0] * 7, joint_torques=[0] * 7)
        publisher.publish(held)  # back to where it was when it took over
        wait_for(fa, lambda: abs(fa.get_joints()[6] - before[6]) < 0.03)
        unstable = proto.JointTorqueControllerSensorMessage(joint_torques=[0] * 7, k_gains=[3000] * 7, d_gains=[1] * 7)
        publisher.publish(unstable)
        topic = FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC
        wait_for(fa, lambda: "stiffness[" in fa.topics()[topic].why_refused)
        publisher.publish(END)
        fa.wait_for_skill()
    assert fa.last_skill_result.termination == "SensorSays"


def test_a_torque_gives_way_where_its_publisher_falls_silent(fa):
    law = PassThroughJointTorque(selection=[0] * 6 + [1], topic="torque", timeout=0.3)
    before = fa.get_joints()[6]
    fa.run(StayJoint(1000), law, Never(), block=False)
    with fa.publisher("torque") as publisher:
        torque = proto.JointTorqueControllerSensorMessage(joint_torques=[0] * 6 + [0.1])
        wait_for(fa, lambda: publisher.publish(torque) or fa.get_joints()[6] > before + 0.005)
        wait_for(fa, lambda: abs(fa.get_joint_velocities()[6]) < 1e-3)
    assert fa.get_joints()[6] < before + 1
    assert not fa.is_skill_done()
    fa.stop_skill()
    with pytest.raises(FrankaArmArgumentError, match="timeout"):
        fa.run(StayJoint(1), PassThroughJointTorque(topic="torque", timeout=-1))


def test_poses_forces_and_gains_that_are_published_are_followed(fa):
    def message(pose, force=(0,) * 6):
        return proto.ForcePositionSensorMessage(pose=pose.matrix.T.ravel(), force=force)

    with fa.publisher(FrankaConstants.DEFAULT_SENSOR_PUBLISHER_TOPIC) as publisher:
        pose = fa.get_pose(include_tool_offset=False)
        fa.run_dynamic_force_position(1000, position_kps_cart=[1500] * 3 + [100] * 3)
        pose.translation = pose.translation + [0.04, 0, 0]
        there = message(pose)
        wait_for(fa, lambda: publisher.publish(there) or np.abs(fa.get_pose(include_tool_offset=False).translation - pose.translation).max() < 0.005)
        up = pose.translation[2]
        publisher.publish(proto.ForcePositionControllerSensorMessage(selection=[1, 1, 0, 1, 1, 1]))
        pressed = message(pose, [0, 0, 5, 0, 0, 0])
        wait_for(fa, lambda: publisher.publish(pressed) or fa.get_pose(include_tool_offset=False).translation[2] > up + 0.02)  # there is nothing to push
        publisher.publish(END)
        fa.wait_for_skill()
    assert fa.last_skill_result.termination == "SensorSays"


def test_a_spring_becomes_stiffer_over_its_topic(ideal_arm, fa):
    def yields() -> float:
        return up - fa.get_pose(include_tool_offset=False).translation[2]

    up = fa.get_pose(include_tool_offset=False).translation[2]
    fa.run(StayPose(1000), CartesianImpedance(200, 50, topic="spring"), Never(), block=False)
    ideal_arm.simulation.push([0, 0, -6, 0, 0, 0], duration=3600)
    with fa.publisher("spring") as publisher:
        wait_for(fa, lambda: yields() > 0.028)  # 6 N / 200 N/m
        publisher.publish(proto.CartesianImpedanceSensorMessage(translational_stiffnesses=[1500] * 3, rotational_stiffnesses=[100] * 3))
        wait_for(fa, lambda: yields() < 0.008)  # 6 N / 1500 N/m, and what the arm had yielded before the skill began
        assert fa.topics()["spring"].received == 1
        with pytest.raises(FrankaArmArgumentError, match="translational_stiffnesses.* is 9000"):
            publisher.publish(
                proto.CartesianImpedanceSensorMessage(translational_stiffnesses=[9000] * 3, rotational_stiffnesses=[50] * 3)
            )
    ideal_arm.simulation.push([0] * 6, duration=0)
    fa.stop_skill()
    assert fa.last_skill_result.ending == proto.STOPPED


# --- limits, and what happens when nothing comes ------------------------------------------------------------------------


def drive(fa, publisher, message, until):
    wait_for(fa, lambda: publisher.publish(message) or until())


def held_by_motion_limits(fa):
    return bool(fa.get_arm_state().held_by & proto.MOTION_LIMITS)


@pytest.mark.parametrize(
    ("trajectory", "slow", "fast"),
    [
        (
            StreamJointVelocity("pace", timeout=3000),
            proto.JointVelocitySensorMessage(joint_velocities=[0] * 6 + [0.1]),
            proto.JointVelocitySensorMessage(joint_velocities=[0] * 6 + [-9]),
        ),
        (
            StreamCartesianVelocity("pace", timeout=3000),
            proto.CartesianVelocitySensorMessage(cartesian_velocities=[0, 0, 0, 0, 0, 0.05]),
            proto.CartesianVelocitySensorMessage(cartesian_velocities=[0, 0, 0, 0, 0, -9]),
        ),
        (
            StreamJoint("pace", delay=0.2, speed=0.05),
            proto.JointChunk(times=[2, 4], joints=[*HOME, *NEAR]),
            proto.JointChunk(times=[5, 5.1], joints=[*NEAR, *HOME]),  # meant for later than the skill may be waited for
        ),
    ],
)
def test_what_is_streamed_faster_than_the_limits_is_told(fa, trajectory, slow, fast):
    fa.goto_joints(HOME, 1)
    with fa.publisher("pace") as publisher, fa.publisher("over") as over:
        fa.run(trajectory, InternalImpedance(), SensorSays("over"), block=False)
        publisher.publish(slow)
        wait_for(fa, lambda: np.abs(fa.get_joints() - HOME).max() > 0.05)
        assert not held_by_motion_limits(fa)
        over.publish(END)
        fa.wait_for_skill()
        assert fa.last_skill_result.limited_cycles == 0

        fa.run(trajectory, InternalImpedance(), SensorSays("over"), block=False)
        publisher.publish(fast)
        wait_for(fa, lambda: fa.get_arm_state().phase == proto.RUNNING and fa.get_arm_state().skill_time > 7)
        over.publish(END)
        fa.wait_for_skill()
    assert fa.last_skill_result.held_by == proto.MOTION_LIMITS
    assert fa.last_skill_result.limited_cycles > 50
    assert "held back by motion limits" in repr(fa.last_skill_result)


def test_a_chunk_whose_publisher_falls_silent_is_left_after_the_timeout_and_the_next_is_followed(fa):
    fa.goto_joints(HOME, 1)
    fa.run(StreamJoint("left", timeout=0.5), InternalImpedance(), Never(), block=False)
    with fa.publisher("left") as publisher:
        publish_in_time(fa, publisher, "left", proto.JointChunk(times=[0.05, 1.5], joints=[*HOME, *NEAR]))
        wait_for(fa, lambda: np.abs(fa.get_joints() - HOME).max() > 5e-3)
        wait_for(fa, lambda: np.abs(fa.get_joint_velocities()).max() < 1e-4)
        left = fa.get_joints()
        assert 5e-3 < np.abs(left - HOME).max() < 0.05
        until = fa.get_arm_state().cycles + 3000
        wait_for(fa, lambda: fa.get_arm_state().cycles > until)
        np.testing.assert_allclose(fa.get_joints(), left, atol=1e-3)
        publish_in_time(fa, publisher, "left", proto.JointChunk(times=[0.4], joints=NEAR))
        wait_for(fa, lambda: np.abs(fa.get_joints() - NEAR).max() < 0.01)
    fa.stop_skill()


def test_a_wrench_gives_way_where_its_publisher_falls_silent(fa):
    def pushed():
        wrench = fa.get_arm_state().O_F_EE_ref
        return wrench[0] if len(wrench) else 0.0

    message = proto.ForcePositionSensorMessage(
        pose=fa.get_pose(include_tool_offset=False).matrix.T.ravel(), force=[3, 0, 0, 0, 0, 0]
    )
    law = ForcePosition(selection=[1] * 6)  # so that the arm stays, and shows what it was asked for
    for timeout, stays in [(0.5, False), (None, False), (0, True)]:
        fa.run(StreamForcePosition("push", timeout=timeout), law, Never(), block=False)
        with fa.publisher("push") as publisher:
            drive(fa, publisher, message, lambda: pushed() == 3)
        if stays:
            until = fa.get_arm_state().cycles + 3000
            wait_for(fa, lambda until=until: fa.get_arm_state().cycles > until)
            assert pushed() == 3
        else:
            wait_for(fa, lambda: pushed() == 0)
        assert not fa.is_skill_done()
        fa.stop_skill()


def test_what_was_published_long_before_its_skill_begins_moves_nothing(fa):
    """The time of the arm counts: a second of it, with a timeout of half of that."""
    fa.goto_joints(HOME, 1)
    turn = proto.JointVelocitySensorMessage(joint_velocities=[0] * 6 + [0.5])
    streams = [
        (StreamJoint("waits", delay=0, timeout=0.5), positions(NEAR), True),
        (StreamJoint("waits"), positions(NEAR), True),
        (StreamJointVelocity("waits", timeout=0.5), turn, True),
        (StreamJoint("waits", timeout=0), positions(NEAR), False),
    ]
    with fa.publisher("waits") as publisher, fa.publisher("go") as go, fa.publisher("over") as over:
        for trajectory, message, is_old in streams:
            stale = fa.topics()["waits"].stale if "waits" in fa.topics() else 0
            with fa.sequence() as results:
                fa.run(StayJoint(10_000), InternalImpedance(), SensorSays("go"))
                fa.run(trajectory, InternalImpedance(), [SensorSays("over"), Silence("waits", 3000)])
                wait_for(fa, lambda: fa.get_arm_state().phase == proto.RUNNING)
                first = fa.get_arm_state().skill_id
                count = fa.topics()["waits"].received + 1 if "waits" in fa.topics() else 1
                publisher.publish(message)
                received(fa, publisher, count)
                until = fa.get_arm_state().cycles + 1000
                wait_for(fa, lambda until=until: fa.get_arm_state().cycles > until)
                go.publish(END)
                wait_for(fa, lambda first=first: fa.get_arm_state().skill_id > first and fa.get_arm_state().skill_time > 2)
                if is_old:
                    assert np.abs(fa.get_joints() - HOME).max() < 1e-3
                    assert fa.topics()["waits"].stale > stale
                    drive(fa, publisher, message, lambda: np.abs(fa.get_joints() - HOME).max() > 0.05)
                else:
                    wait_for(fa, lambda: np.abs(fa.get_joints() - NEAR).max() < 0.01)
                over.publish(END)
            assert results[1].termination == "SensorSays"
            assert not is_old or fa.topics()["waits"].stale > stale
            fa.goto_joints(HOME, 1)


def test_the_time_without_data_counts_from_the_beginning_of_the_skill(fa):
    with fa.publisher("none") as publisher, fa.publisher("go") as go, fa.sequence() as results:
        fa.run(StayJoint(10_000), InternalImpedance(), SensorSays("go"))
        fa.run(StreamJoint("none"), InternalImpedance(), Silence("none", 0.5))
        publisher.publish(positions(HOME))
        wait_for(fa, lambda: fa.get_arm_state().skill_time > 3)
        go.publish(END)
    assert results[1].termination == "Silence"
    assert results[1].time == pytest.approx(0.5, abs=0.01)


def test_a_publisher_that_is_killed_leaves_an_arm_at_rest_for_the_next(fa, ideal_arm):
    fa.goto_joints(HOME, 1)
    fa.run(StreamJointVelocity("dies", timeout=10), InternalImpedance(), Never(), block=False)
    script = f"""
import itertools, time
from frankapy import SensorPublisher, proto
publisher = SensorPublisher("dies", server={ideal_arm.server!r})
for i in itertools.count():
    speed = 0.1 * (-1) ** (i // 100)
    publisher.publish(proto.JointVelocitySensorMessage(joint_velocities=[0] * 6 + [speed]))
    time.sleep(0.005)
"""
    process = subprocess.Popen([sys.executable, "-c", script])
    try:
        wait_for(fa, lambda: abs(fa.get_joint_velocities()[6]) > 0.05)
    finally:
        process.kill()
        process.wait()
    wait_for(fa, lambda: fa.topics()["dies"].silences > 0 and np.abs(fa.get_joint_velocities()).max() < 1e-4)
    assert not fa.is_skill_done()
    rests = fa.get_joints()[6]
    with fa.publisher("dies") as publisher:
        turn = proto.JointVelocitySensorMessage(joint_velocities=[0] * 6 + [-0.2])
        drive(fa, publisher, turn, lambda: fa.get_joints()[6] < rests - 0.02)
    fa.stop_skill()
    assert fa.topics()["dies"].lost == 0


def test_each_skill_is_told_that_nothing_comes(fa):
    with fa.publisher("quiet") as publisher:
        publisher.publish(proto.JointVelocitySensorMessage(joint_velocities=[0] * 7))
        for silences in (1, 2):
            fa.run(StreamJointVelocity("quiet", timeout=0.1), JointImpedance(), Time(500), block=False)
            wait_for(fa, lambda silences=silences: fa.topics()["quiet"].silences >= silences)
            fa.stop_skill()


def test_a_message_that_is_too_long_is_refused_here(fa):
    with fa.publisher("long") as publisher:
        chunk = proto.JointChunk(times=np.arange(1000) * 1e-3, joints=np.tile(HOME, 1000))
        with pytest.raises(FrankaArmArgumentError, match=r"JointChunk has \d+ bytes .* expected at most 65472"):
            publisher.publish(chunk)


# --- ends ------------------------------------------------------------------------------------------------------------


def test_a_message_ends_the_skill_and_so_does_silence(fa):
    fa.run(StayJoint(1000), InternalImpedance(), [SensorSays("stop"), Time(500)], block=False)
    with fa.publisher("stop") as publisher:
        publisher.publish(proto.ShouldTerminateSensorMessage(timestamp=1, should_terminate=False))
        publisher.publish(proto.ShouldTerminateSensorMessage(timestamp=2, should_terminate=True))
        publisher.publish(proto.ShouldTerminateSensorMessage(timestamp=3, should_terminate=False))
        fa.wait_for_skill()
    assert fa.last_skill_result.termination == "SensorSays"
    result = fa.run(StayJoint(1000), InternalImpedance(), Silence("nobody", 0.5))
    assert result.termination == "Silence"
    assert result.time == pytest.approx(0.5, abs=0.01)


def test_however_many_topics_there_were_a_new_one_is_heard(fa):
    with fa.publisher("flood") as publisher:
        for i in range(300):
            message = proto.SensorMessage(topic=f"flood {i}")
            message.message.Pack(GO_ON)
            publisher._socket.send(message.SerializeToString())
    wait_for(fa, lambda: "flood 299" in fa.topics())
    assert len(fa.topics()) == 256
    fa.run(StayJoint(1000), InternalImpedance(), [SensorSays("fresh"), Never()], block=False)
    with fa.publisher("fresh") as publisher:
        publisher.publish(proto.ShouldTerminateSensorMessage(timestamp=0, should_terminate=True))
        fa.wait_for_skill()
    assert fa.last_skill_result.termination == "SensorSays"


def test_a_topic_is_told_of_as_soon_as_a_skill_listens(fa, ideal_arm, capsys):
    fa.run(StreamJoint("awaited"), InternalImpedance(), [SensorSays("awaited"), Never()], block=False)
    topic = fa.topics()["awaited"]
    assert topic.received == 0
    assert not topic.HasField("age")
    assert len(topic.skills) == 1
    assert repr(topic).count("nothing yet") == 1
    assert cli.main(["status", "--server", ideal_arm.server]) == 0
    assert f"awaited: nothing has come; skill {topic.skills[0]} listens" in " ".join(capsys.readouterr().out.split())
    fa.stop_skill()
    assert "awaited" not in fa.topics()


def test_what_a_script_publishes_right_before_it_exits_arrives(fa, ideal_arm):
    fa.run(StayJoint(1000), InternalImpedance(), [SensorSays("bye"), Never()], block=False)
    script = (
        "from frankapy import SensorPublisher, proto\n"
        f"publisher = SensorPublisher('bye', server={ideal_arm.server!r})\n"
        "publisher.publish(proto.ShouldTerminateSensorMessage(timestamp=0, should_terminate=True))\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=300)
    fa.wait_for_skill()
    assert fa.last_skill_result.termination == "SensorSays"


def test_a_message_is_for_the_first_skill_that_listens(fa):
    with fa.publisher("shared") as publisher, fa.sequence() as results:
        for _ in range(2):
            fa.run(StayJoint(1), InternalImpedance(), SensorSays("shared"))
        publisher.publish(GO_ON)
        wait_for(fa, lambda: fa.topics()["shared"].received and len(fa.topics()["shared"].skills) == 2)
        wait_for(fa, lambda: fa.get_arm_state().phase == proto.RUNNING)
        first = fa.get_arm_state().skill_id
        publisher.publish(END)
        wait_for(fa, lambda: fa.get_arm_state().skill_id > first and fa.get_arm_state().skill_time > 1)
        publisher.publish(END)
    assert [result.termination for result in results] == ["SensorSays"] * 2
    assert results[1].time > 1


def test_an_end_is_heard_among_any_number_of_messages(fa):
    # Until it starts it hears nothing.
    run_after(fa, 2, StayJoint(1), InternalImpedance(), SensorSays("busy"))
    with fa.publisher("busy") as publisher:
        for _ in range(2000):
            publisher.publish(GO_ON)
        publisher.publish(END)
        wait_for(fa, lambda: fa.topics()["busy"].received == 2001)
        assert fa.topics()["busy"].overrun == 0
    fa.wait_for_skill()
    assert fa.last_skill_result.termination == "SensorSays"


def test_a_clock_that_is_set_forward_is_believed_in_the_end(fa):
    fa.run(StreamJoint("set", delay=0), InternalImpedance(), SensorSays("over"), block=False)

    def publish(publisher, message, sequence, later):
        envelope = proto.SensorMessage(
            topic=publisher.topic, publisher=7, sequence=sequence, sent_ns=time.time_ns() + round(later * 1e9)
        )
        envelope.message.Pack(message)
        publisher._socket.send(envelope.SerializeToString())

    with fa.publisher("set") as publisher, fa.publisher("over") as over:
        publish(publisher, proto.JointPositionSensorMessage(joints=HOME), 1, 0)
        for i in range(12):
            publish(publisher, proto.JointPositionSensorMessage(joints=NEAR), 2 + i, 3600)
        wait_for(fa, lambda: np.abs(fa.get_joints() - NEAR).max() < 0.01)
        assert fa.topics()["set"].refused == 10
        publish(over, GO_ON, 1, 0)
        publish(over, END, 2, 3600)
        fa.wait_for_skill()
    assert fa.last_skill_result.termination == "SensorSays"


# --- what is refused -------------------------------------------------------------------------------------------------


def test_what_makes_no_sense_is_refused_counted_and_named(fa, ideal_arm):
    # Silence takes any kind of message, but none that nobody else on its topic can use.
    fa.run(StreamJoint("strict", delay=0), InternalImpedance(), Silence("strict", 3000), block=False)
    with fa.publisher("strict") as publisher:

        def refused(message, says):
            before = fa.topics()["strict"].refused
            envelope = proto.SensorMessage(topic="strict", publisher=7, sequence=refused.sequence, sent_ns=refused.sent)
            envelope.message.Pack(message)
            publisher._socket.send(envelope.SerializeToString())
            refused.sequence += 1
            wait_for(fa, lambda: fa.topics()["strict"].refused > before)
            assert says in fa.topics()["strict"].why_refused

        refused.sequence, refused.sent = 1, time.time_ns()
        refused(proto.PosePositionSensorMessage(position=[0.4, 0, 0.4], quaternion=[1, 0, 0, 0]), "expected JointPosition")
        refused(proto.JointPositionSensorMessage(joints=[np.nan] * 7), "expected a finite number")
        refused(proto.JointPositionSensorMessage(joints=[0] * 6), "expected 7")
        refused(proto.JointPositionSensorMessage(joints=[9] * 7), "joint 1 is 9")
        refused(proto.JointChunk(times=[0.1, 0.1], joints=[0] * 14), "expected more than the time before")
        refused(proto.JointChunk(times=[0.1], joints=[0] * 8), "expected 7")
        refused.sent += 3600 * 10**9
        refused(proto.JointPositionSensorMessage(joints=HOME), "in the future")
        publisher._socket.send(b"\xff\xfe garbage")
        with pytest.raises(FrankaArmArgumentError, match="JointPositionSensorMessage.joints has 3 elements"):
            publisher.publish(proto.JointPositionSensorMessage(joints=[1, 2, 3]))
        with pytest.raises(FrankaArmArgumentError, match="expected a message"):
            publisher.publish("go")
        # It goes on, and what is right is taken still.
        publisher.publish(proto.JointPositionSensorMessage(joints=NEAR))
        wait_for(fa, lambda: np.abs(fa.get_joints() - NEAR).max() < 0.01)
        topic = fa.topics()["strict"]
        assert topic.refused == 7
        assert topic.lost == 0
        assert list(topic.skills)
    fa.stop_skill()
    with pytest.raises(FrankaArmArgumentError, match="topic"):
        SensorPublisher("", server=ideal_arm.server)
    with pytest.raises(FrankaArmArgumentError, match="StreamJoint.topic is missing"):
        fa.run(StreamJoint(), InternalImpedance(), Never())


def test_lost_and_late_messages_are_counted(fa):
    with fa.publisher("counted") as publisher:
        for sequence in (1, 2, 5, 4, 6):
            envelope = proto.SensorMessage(topic="counted", publisher=1, sequence=sequence)
            envelope.message.Pack(proto.JointPositionSensorMessage(joints=HOME))
            publisher._socket.send(envelope.SerializeToString())
        wait_for(fa, lambda: "counted" in fa.topics() and fa.topics()["counted"].received == 5)
        topic = fa.topics()["counted"]
        assert (topic.lost, topic.out_of_order) == (2, 1)


def publish(publisher, sequence, sent, message, number=1):
    """Send a message of another publisher, sent at another time (ns since 1970)."""
    envelope = proto.SensorMessage(topic=publisher.topic, publisher=number, sequence=sequence, sent_ns=sent)
    envelope.message.Pack(message)
    publisher._socket.send(envelope.SerializeToString())


def positions(joints):
    return proto.JointPositionSensorMessage(joints=joints)


def test_what_took_longer_on_its_way_is_counted_and_without_a_timeout_taken(fa):
    fa.run(StreamJoint("slow", delay=0, timeout=0), InternalImpedance(), Never(), block=False)
    sent = time.time_ns()
    with fa.publisher("slow") as publisher:
        publish(publisher, 1, sent, positions(HOME))
        wait_for(fa, lambda: fa.topics()["slow"].received)
        time.sleep(1)
        publish(publisher, 2, sent, positions(NEAR))
        wait_for(fa, lambda: np.abs(fa.get_joints() - NEAR).max() < 0.01)
        topic = fa.topics()["slow"]
        assert topic.late + topic.stale == 1
        assert (topic.lost, topic.out_of_order, topic.refused) == (0, 0, 0)
    fa.stop_skill()


def received(fa, publisher, count):
    wait_for(fa, lambda: publisher.topic in fa.topics() and fa.topics()[publisher.topic].received == count)
    return fa.topics()[publisher.topic]


def stays(fa, joints):
    until = fa.get_arm_state().cycles + 200
    wait_for(fa, lambda: fa.get_arm_state().cycles > until)
    assert np.abs(fa.get_joints() - joints).max() < 0.01


def test_what_is_older_than_the_timeout_moves_nothing(fa):
    fa.goto_joints(HOME, 1)
    fa.run(StreamJoint("old", delay=0, timeout=0.5), InternalImpedance(), Never(), block=False)
    sent = time.time_ns()
    with fa.publisher("old") as publisher:
        publish(publisher, 1, sent, positions(HOME))
        received(fa, publisher, 1)
        time.sleep(0.6)
        publish(publisher, 2, sent, positions(NEAR))
        assert received(fa, publisher, 2).stale == 1
        stays(fa, HOME)
        sequence = iter(range(3, 1000))

        def arrives():
            publish(publisher, next(sequence), time.time_ns(), positions(NEAR))
            time.sleep(0.02)
            return np.abs(fa.get_joints() - NEAR).max() < 0.01

        wait_for(fa, arrives)
    fa.stop_skill()


def test_of_a_chunk_that_comes_late_what_is_not_over_yet_is_taken(fa):
    fa.goto_joints(HOME, 1)
    fa.run(StreamJoint("chunks"), InternalImpedance(), Never(), block=False)
    sent = time.time_ns()
    with fa.publisher("chunks") as publisher:
        publish(publisher, 1, sent, proto.JointChunk(times=[0.1], joints=HOME))
        received(fa, publisher, 1)
        time.sleep(0.7)
        publish(publisher, 2, sent, proto.JointChunk(times=[0.05, 0.1], joints=[*NEAR, *NEAR]))
        assert received(fa, publisher, 2).stale == 1
        stays(fa, HOME)
        publish(publisher, 3, sent, proto.JointChunk(times=[0.05, 30], joints=[*HOME, *NEAR]))
        wait_for(fa, lambda: np.abs(fa.get_joints() - HOME).max() > 0.005)
    fa.stop_skill()


def test_an_old_target_of_another_publisher_does_not_replace_a_newer_one(fa):
    fa.goto_joints(HOME, 1)
    fa.run(StreamJoint("two", delay=0, timeout=0), InternalImpedance(), Never(), block=False)
    sent = time.time_ns()
    with fa.publisher("two") as publisher:
        publish(publisher, 1, sent, positions(HOME), number=1)
        received(fa, publisher, 1)
        time.sleep(0.1)
        publish(publisher, 1, sent, positions(NEAR), number=2)  # by its own clock, that nobody knows
        received(fa, publisher, 2)
        publish(publisher, 2, sent, positions(HOME), number=1)
        assert received(fa, publisher, 3).out_of_order == 1
        wait_for(fa, lambda: np.abs(fa.get_joints() - NEAR).max() < 0.01)
        stays(fa, NEAR)
    fa.stop_skill()


def test_an_end_counts_however_late_and_out_of_order_it_comes(fa):
    fa.run(StreamJoint("late end", delay=0, timeout=0.1), InternalImpedance(), [SensorSays("late end"), Never()], block=False)
    sent = time.time_ns()
    with fa.publisher("late end") as publisher:
        publish(publisher, 1, sent, GO_ON)
        publish(publisher, 7, sent, GO_ON)
        received(fa, publisher, 2)
        time.sleep(0.2)
        publish(publisher, 3, sent, END)
        fa.wait_for_skill()
    assert fa.last_skill_result.termination == "SensorSays"


def test_values_of_a_movement_primitives_sensors_come_over_its_topic(fa):
    fa.goto_joints(HOME, 1)
    weights = np.zeros((3, 2, 6))
    weights[0, 0, 0] = 0.06  # m: along x by the first sensor
    weights[2, 1, 0] = -0.06  # along z by the second
    way = PoseDmp(
        tau=0.25, alpha=200, beta=50, mu=np.exp(-0.1 * np.arange(6)), h=[50] * 6, weights=weights.ravel(), position_only=True,
        initial_sensor_values=[1, 0] * 3, duration=2, topic="sensors",
    )  # fmt: skip
    start = fa.get_pose(include_tool_offset=False).translation
    with fa.sequence(), fa.publisher("sensors") as sensors, fa.publisher("go") as go:
        fa.run(StayJoint(1000), InternalImpedance(), SensorSays("go"))
        fa.run(way, InternalImpedance())
        sensors.publish(proto.DmpSensorValues(values=[0, 1, 0]))
        sensors.publish(proto.DmpSensorValues(values=[0, 1] * 3))
        topic = received(fa, sensors, 2)
        assert topic.refused == 1 and "3 values: expected 6" in topic.why_refused
        go.publish(END)
    np.testing.assert_allclose(fa.get_pose(include_tool_offset=False).translation - start, [0, 0, -0.06], atol=2e-3)


def test_the_status_says_who_commands(fa, ideal_arm, capsys):
    fa.run(StreamJoint("shown"), InternalImpedance(), Never(), block=False)
    with fa.publisher("shown") as publisher:
        for _ in range(3):
            publisher.publish(proto.JointPositionSensorMessage(joints=HOME))
        wait_for(fa, lambda: fa.topics()["shown"].received == 3)
    wait_for(fa, lambda: fa.get_arm_state().phase == proto.RUNNING)
    assert f"pid {os.getpid()}" in fa.server_status().commander
    before = fa.server_status().motion_cycles
    wait_for(fa, lambda: fa.server_status().motion_cycles > before)
    assert cli.main(["status", "--server", ideal_arm.server]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert f"pid {os.getpid()}" in told
    assert "shown: JointPositionSensorMessage" in told and "3 received" in told
    assert f"; skill {fa.get_arm_state().skill_id} listens" in told
    fa.stop_skill()


def test_a_flood_disturbs_nothing(fa):
    fa.run(StreamJoint("flood", delay=0, timeout=0), InternalImpedance(), Never(), block=False)
    with fa.publisher("flood") as publisher:
        message = proto.JointPositionSensorMessage(joints=NEAR)
        for _ in range(20_000):
            try:
                publisher.publish(message)
            except FrankaArmException:
                time.sleep(0.01)
        wait_for(fa, lambda: np.abs(fa.get_joints() - NEAR).max() < 0.01)
    fa.stop_skill()
    assert fa.last_skill_result.ending == proto.STOPPED


def test_a_slow_skill_stops_as_soon_when_its_stream_ceases(ideal_arm, fa):
    with fa.publisher("slow") as publisher:
        fa.run(StreamJointVelocity("slow", timeout=0.5), InternalImpedance(), Never(), speed=0.1, block=False)
        wait_for(fa, lambda: fa.get_arm_state().phase == proto.RUNNING)
        with ideal_arm.standing_still():
            turn = proto.JointVelocitySensorMessage(joint_velocities=[0, 0, 0, 0, 0, 0, 0.5])
            publish_in_time(fa, publisher, "slow", turn)
            ideal_arm.simulation.step(300)
            wait_for(fa, lambda: fa.get_arm_state().robot.dq_d[6] > 1e-3)
            ideal_arm.simulation.step(2700)  # and not 5 s
            wait_for(fa, lambda: abs(fa.get_arm_state().robot.dq_d[6]) < 1e-4)
    fa.stop_skill()


# --- other parts for a skill that runs -------------------------------------------------------------------------------


def test_a_running_skill_gets_other_gains_another_goal_and_another_end(fa):
    goal = fa.get_pose(include_tool_offset=False)
    goal.translation = goal.translation + [0.05, 0.05, -0.05]
    fa.run(StayPose(1000), CartesianImpedance(600, 50), Never(), block=False)
    wait_for(fa, lambda: fa.get_arm_state().phase == proto.RUNNING)
    number = fa.get_arm_state().skill_id
    for stiffness in (100, 1500, 300, 1200):
        fa.change(controller=CartesianImpedance(stiffness, 50))
    fa.change(trajectory=MinJerkPose(goal, 1))
    wait_for(fa, lambda: np.abs(fa.get_pose(include_tool_offset=False).translation - goal.translation).max() < 0.005)
    assert fa.get_arm_state().skill_id == number
    fa.change(until=Time(0.1))
    fa.wait_for_skill()
    assert fa.last_skill_result.termination == "Time"
    assert fa.last_skill_result.ending == proto.TERMINATED


def test_a_change_may_go_from_joints_to_a_pose_and_back(fa):
    pose = fa.get_pose(include_tool_offset=False)
    goal = pose.copy()
    goal.translation = goal.translation + [0.05, 0.05, -0.05]
    fa.run(MinJerkJoint(NEAR, 1), JointImpedance(), Never(), block=False)
    wait_for(fa, lambda: fa.get_arm_state().skill_time > 1.5)
    fa.change(trajectory=MinJerkPose(goal, 1), controller=CartesianImpedance(1000, 60))
    wait_for(fa, lambda: np.abs(fa.get_pose(include_tool_offset=False).translation - goal.translation).max() < 0.005)
    fa.change(trajectory=MinJerkJoint(NEAR, 1), controller=JointImpedance(), until=Time(after_trajectory=0.2))
    fa.wait_for_skill()
    assert fa.last_skill_result.ending == proto.TERMINATED
    np.testing.assert_allclose(fa.get_joints(), NEAR, atol=5e-3)


def test_an_arm_that_was_led_stays_where_it_is_when_it_is_held_again(ideal_arm, fa):
    begin = fa.get_pose(include_tool_offset=False).translation
    fa.run(StayPose(10_000), CartesianImpedance(600, 50), Never(), block=False)
    wait_for(fa, lambda: fa.get_arm_state().phase == proto.RUNNING)
    fa.change(controller=FreeDrive())
    with ideal_arm.standing_still():
        ideal_arm.simulation.push([10, 0, 0, 0, 0, 0], duration=0.5)
        ideal_arm.simulation.step(1500)
    wait_for(fa, lambda: np.abs(fa.get_arm_state().robot.dq).max() < 0.02)
    left = fa.get_pose(include_tool_offset=False).translation
    fa.change(controller=CartesianImpedance(600, 50))
    at = fa.get_arm_state().skill_time
    wait_for(fa, lambda: fa.get_arm_state().skill_time > at + 3)
    assert np.linalg.norm(left - begin) > 0.05
    assert np.linalg.norm(fa.get_pose(include_tool_offset=False).translation - left) < 0.02
    fa.stop_skill()


def test_a_change_keeps_what_is_not_given_wherever_the_arm_is(fa):
    """Samples begin where the arm was, and a change of another part does not ask for that again."""
    samples = HOME + np.linspace(0, 1, 3000)[:, None] * (NEAR - HOME) * 5
    fa.run(JointSamples(samples), JointImpedance(), speed=0.05, block=False)
    wait_for(fa, lambda: np.abs(fa.get_joints() - HOME).max() > 0.15)
    fa.change(controller=JointImpedance())
    assert not fa.is_skill_done()
    fa.change(until=Time(0))
    fa.wait_for_skill()
    assert fa.last_skill_result.termination == "Time"


def test_a_part_that_was_replaced_listens_no_more(fa):
    fa.run(StreamJoint("replaced"), JointImpedance(), Never(), block=False)
    fa.change(trajectory=StreamPose("replaced"), controller=CartesianImpedance(600, 50))
    with fa.publisher("replaced") as publisher:
        publisher.publish(proto.JointPositionSensorMessage(joints=NEAR))
        wait_for(fa, lambda: "replaced" in fa.topics() and fa.topics()["replaced"].refused == 1)
    assert "expected PosePositionSensorMessage" in fa.topics()["replaced"].why_refused
    fa.stop_skill()


def test_a_while_after_the_trajectory_is_after_the_one_that_it_has_now(fa):
    fa.run(MinJerkJoint(NEAR, 0.5), JointImpedance(), Time(after_trajectory=20), block=False)
    wait_for(fa, lambda: fa.get_arm_state().skill_time > 3)
    fa.change(trajectory=MinJerkJoint(HOME, 5))
    fa.wait_for_skill()
    assert fa.last_skill_result.time > 27.9
    np.testing.assert_allclose(fa.get_joints(), HOME, atol=5e-3)


def test_a_change_that_does_not_fit_is_refused_and_the_skill_goes_on(fa):
    with pytest.raises(FrankaArmException, match="nothing to change"):
        fa.change(until=Time(1))
    fa.run(StayJoint(1000), InternalImpedance(), Never(), block=False)
    for change, says in [
        ({"controller": InternalImpedance([1000] * 7)}, "preempt the skill"),
        ({"controller": CartesianImpedance()}, "does not"),
        ({"trajectory": StayPose(1)}, "does not"),
        ({"trajectory": MinJerkJoint([9] * 7)}, "limits|should lie"),
        ({}, "changes nothing"),
    ]:
        with pytest.raises(FrankaArmArgumentError, match=says):
            fa.change(**change)
    assert not fa.is_skill_done()
    fa.change(trajectory=TimeOptimalJoint(NEAR, 0.3), until=Time(after_trajectory=0.1))
    fa.wait_for_skill()
    np.testing.assert_allclose(fa.get_joints(), NEAR, atol=1e-3)


def test_what_waits_behind_another_is_changed_once_it_runs(fa):
    with pytest.raises(FrankaArmFrankaInterfaceNotReadyException, match="waits behind another"), fa.sequence():
        fa.run(StayJoint(1000), JointImpedance(), Never())
        fa.run(StayJoint(1), JointImpedance())
        fa.change(until=Time(1))


def test_thresholds_of_contact_are_those_of_a_skill_and_cost_the_robot_no_rest(ideal_arm, fa):
    """A skill takes them while it runs, and the robot's own stay."""
    ideal_arm.simulation.push([0, 0, 15, 0, 0, 0], duration=3600)
    try:
        for threshold, ends in [(30, "Time"), (8, "Contact")]:
            fa.run(StayPose(1000), CartesianImpedance(), Never(), block=False)
            wait_for(fa, lambda: fa.get_arm_state().phase == proto.RUNNING and abs(fa.get_arm_state().robot.O_F_ext_hat_K[2]) > 12)
            fa.change(until=[Contact(force_thresholds=[100, 100, threshold, 20, 20, 20]), Time(0)])
            fa.wait_for_skill()
            assert fa.last_skill_result.termination == ends
            assert not any(fa.get_arm_state().robot.cartesian_contact)
    finally:
        ideal_arm.simulation.push([0] * 6, duration=0)


# --- a time to begin at ----------------------------------------------------------------------------------------------


def test_what_only_pushes_does_not_before_its_start_time(fa):
    before = fa.get_joints()
    law = PassThroughJointTorque(torque=[0, 0, 0, 0, 0, 0, 3], selection=[0] * 6 + [1])
    at = run_after(fa, 0.5, StayJoint(1), law, Time(0.1))
    time.sleep(0.2)
    joints = fa.get_joints()
    if time.time() < at:  # this computer was quick enough
        np.testing.assert_allclose(joints, before, atol=1e-3)
    fa.wait_for_skill()
    assert fa.last_skill_result.ending == proto.TERMINATED
    assert fa.get_joints()[6] - before[6] > 1e-3
    fa.reset_joints(2)


def test_a_skill_begins_at_its_start_time(fa):
    at = run_after(fa, 1, MinJerkJoint(NEAR, 1))
    wait_for(fa, lambda: fa.get_arm_state().phase == proto.RUNNING or time.time() > at)
    joints = fa.get_joints()
    if time.time() < at:  # this computer was quick enough
        np.testing.assert_allclose(joints, HOME, atol=1e-3)
    fa.wait_for_skill()
    result = fa.last_skill_result
    began = result.first_command_ns * 1e-9 - time.monotonic() + time.time()
    assert at - 0.01 <= began < at + 60
    assert result.time == pytest.approx(1, abs=0.05)
    np.testing.assert_allclose(fa.get_joints(), NEAR, atol=1e-3)
    for wrong in (time.time() + 100, time.time() - 100, np.nan):
        with pytest.raises(FrankaArmArgumentError, match="start_time"):
            fa.run(MinJerkJoint(HOME, 1), start_time=wrong)
    # One that waits can be stopped.
    fa.run(MinJerkJoint(HOME, 1), start_time=time.time() + 30, block=False)
    fa.stop_skill()
    assert fa.last_skill_result.ending == proto.STOPPED
    np.testing.assert_allclose(fa.get_joints(), NEAR, atol=1e-3)


@pytest.mark.wall
def test_two_arms_begin_together():
    with Simulation(SimulatedArm(ideal=True, arms=2)) as simulation:
        arms = [FrankaArm(server=simulation.server, robot_num=number) for number in (1, 2)]
        at = time.time() + 1
        for fa in arms:
            fa.run(StayJoint(0.3), JointImpedance(), start_time=at, block=False)
        began = []
        for fa in arms:
            fa.wait_for_skill()
            began.append(fa.last_skill_result.first_command_ns * 1e-9 - time.monotonic() + time.time())
            fa.close()
    assert abs(began[0] - began[1]) < 0.01
    assert -0.001 < began[0] - at < 0.02


def test_a_change_waits_for_a_skill_that_has_not_begun(fa):
    fa.run(StayJoint(1000), JointImpedance(), Never(), block=False)
    fa.change(trajectory=MinJerkJoint(NEAR, 1), until=Time(after_trajectory=0.2))
    fa.wait_for_skill()
    np.testing.assert_allclose(fa.get_joints(), NEAR, atol=5e-3)
