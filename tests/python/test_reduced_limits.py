"""Limits that are reduced while the server runs: what is refused, and what the truth then says of speed, torque and power."""


import numpy as np
import pytest
from conftest import FASTEST, HOME, client_after_crash

from frankapy import FrankaArmArgumentError, FrankaArmBusyException, connection, proto
from frankapy.limits import BODY_REGIONS, contact_speed
from frankapy.parts import CartesianImpedance, InternalImpedance, JointImpedance, JointWaypoints, MinJerkJoint, Never, StreamJoint, StreamPose

TRUTH_FILE = True
ASIDE = HOME + [0.8, 0.2, 0, 0.2, 0.2, 0, 0.5]


@pytest.fixture
def limited(fa):
    yield fa
    fa.stop_skill()
    fa.limits.reset()


def tool_speed(rows) -> np.ndarray:
    """Return the speed of the tool in each cycle but the first, m/s."""
    steps = np.diff(rows["O_T_TCP"].reshape(-1, 4, 4)[:, 3, :3], axis=0)
    return np.linalg.norm(steps, axis=1) / np.diff(rows["time"])


def test_limits_are_read_and_set(limited):
    limits = limited.limits
    most = limits.most
    assert limits.now == most and limits.velocity == 1
    assert 1 < most.tool_speed < 5 and 500 < most.power < 2000
    limits.velocity = 0.3
    limits.update(tool_speed=0.25, power=np.float32(80))
    assert (limits.velocity, limits.acceleration, limits.tool_speed, limits.power) == (0.3, 1, 0.25, 80)
    assert "tool_speed=0.25" in repr(limits)
    assert limits.q_min.shape == (7,)
    limits.reset()
    assert limits.now == most


REFUSED = {
    "above the robot's": (dict(velocity=1.5), r"velocity is 1.5 of the robot's: expected 0.01 to 1"),
    "a tool above the robot's": (dict(tool_speed=9), r"tool_speed is 9 m/s: expected 0.01 to \d"),
    "more than the joints have": (dict(power=9000), r"power is 9000 W: expected 1 to \d+"),
    "zero": (dict(tool_speed=0), "tool_speed is 0"),
    "a negative one": (dict(jerk=-1), "jerk is -1"),
    "NaN": (dict(torque=np.nan), "torque is nan"),
    "no number": (dict(velocity="slow"), "velocity is 'slow'"),
    "one that there is not": (dict(speed=1), "speed: expected some of velocity"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_limit_is_refused_and_nothing_changed(case, limited):
    given, why = REFUSED[case]
    before = limited.limits.now
    with pytest.raises(FrankaArmArgumentError, match=why):
        limited.limits.update(acceleration=0.5, **given)
    assert limited.limits.now == before


def test_another_client_changes_nothing_while_this_one_commands(limited, ideal_arm, monkeypatch):
    monkeypatch.setattr(connection, "_LEASE_TIME", 0)  # a client that is held up for as long loses the arm
    with ideal_arm.client() as other:
        limited.limits.velocity = 0.5
        limited.run(MinJerkJoint(HOME, 1), InternalImpedance())
        assert other.limits.velocity == 0.5
        with pytest.raises(FrankaArmBusyException):
            other.limits.reset()


CONTROLLERS = pytest.mark.parametrize("controller", [InternalImpedance(), JointImpedance()], ids=["robot", "torque"])


@CONTROLLERS
def test_motions_keep_to_a_speed_of_the_tool(controller, limited, ideal_arm):
    limited.limits.tool_speed = 0.2
    first = ideal_arm.cycle()
    limited.run(MinJerkJoint(ASIDE, 1), controller)
    assert limited.last_skill_result.ending == proto.TERMINATED
    assert limited.last_skill_result.stretch > 1.5
    np.testing.assert_allclose(limited.get_joints(), ASIDE, atol=0.02)
    speed = tool_speed(ideal_arm.truth(first))
    assert 0.1 < speed.max() < 0.2


@pytest.mark.parametrize("of", ["joints", "pose"])
@pytest.mark.parametrize("how", ["robot", "torque"])
def test_what_is_streamed_keeps_to_a_speed_of_the_tool(of, how, limited, ideal_arm):
    limited.limits.tool_speed = 0.2
    first = ideal_arm.cycle()
    stream = (StreamJoint if of == "joints" else StreamPose)("goal", delay=0, timeout=0, speed=1)
    ours = JointImpedance() if of == "joints" else CartesianImpedance()
    limited.run(stream, InternalImpedance() if how == "robot" else ours, Never(), block=False)
    pose = limited.get_pose()
    goal = pose.translation + [0.1, 0.3, -0.1]
    with limited.publisher("goal") as publisher:
        if of == "joints":
            publisher.publish(proto.JointPositionSensorMessage(joints=ASIDE))
            limited.wait_for(lambda state: np.abs(np.array(state.robot.q) - ASIDE).max() < 0.02, timeout=60)
        else:
            publisher.publish(proto.PosePositionSensorMessage(position=goal, quaternion=pose.quaternion))
            limited.wait_for(lambda state: np.linalg.norm(np.array(state.robot.O_T_EE)[12:15] - goal) < 0.01, timeout=60)
    limited.stop_skill()
    assert limited.last_skill_result.ending == proto.STOPPED
    speed = tool_speed(ideal_arm.truth(first))
    assert 0.1 < speed.max() < 0.2


@CONTROLLERS
def test_a_motion_that_runs_is_slowed_and_goes_on(controller, limited, ideal_arm):
    begin = ideal_arm.cycle()
    to_and_fro = np.array([ASIDE, HOME] * 7 + [ASIDE])
    with ideal_arm.standing_still():
        limited.run(JointWaypoints(to_and_fro, times=1.5 * np.arange(1, len(to_and_fro) + 1)), controller, block=False)
        ideal_arm.simulation.step(2500)
        limited.limits.update(tool_speed=0.2, velocity=0.5)
        first = ideal_arm.cycle()
    limited.wait_for_skill()
    result = limited.last_skill_result
    assert result.ending == proto.TERMINATED
    assert result.held_by & proto.TOOL_SPEED
    np.testing.assert_allclose(limited.get_joints(), ASIDE, atol=0.02)
    rows = ideal_arm.truth(begin)
    speed = tool_speed(rows)
    assert speed[: first - begin].max() > 0.25, "it was faster"
    assert speed[first - begin + 500 :].max() < 0.2


def test_a_controller_exerts_no_more_torque_than_may_be(limited, ideal_arm):
    limited.limits.torque = 0.05
    first = limited.get_arm_state().robot.message_id
    torques = []
    limited.run(StreamJoint("goal", delay=0, timeout=0, speed=1), JointImpedance([600] * 7, [20] * 7), Never(), block=False)
    with limited.publisher("goal") as publisher:
        publisher.publish(proto.JointPositionSensorMessage(joints=ASIDE))

        def done(state):
            torques.append(state.robot.tau_J_d)
            return state.robot.message_id > first + 3000

        limited.wait_for(done, timeout=60)
    limited.stop_skill()
    assert np.all(np.abs(torques).max(axis=0) <= 0.05 * np.array([87] * 4 + [12] * 3) + 1e-6)


def test_a_share_of_the_velocity_bounds_joints(limited, ideal_arm):
    limited.limits.velocity = 0.1
    first = ideal_arm.cycle()
    limited.goto_joints(HOME + 0.2, 0.5)
    assert limited.last_skill_result.ending == proto.TERMINATED
    share = np.abs(ideal_arm.truth(first)["dq"]) / FASTEST["fr3"]
    assert 0.05 < share.max() < 0.105


def test_a_shared_space_is_as_slow_as_its_most_delicate_part(limited):
    limited.limits.share_space("chest", "hand")
    robot = limited.get_arm_state().robot
    # ISO/TS 15066, A.3.4, written out: 280 N and 25 N/mm, 40 kg.
    links = limited._server.welcome.moving_mass
    robot_mass = links / 2 + robot.m_ee + robot.m_load
    by_hand = 280 / np.sqrt(25e3 / (1 / 40 + 1 / robot_mass))
    assert 12 < links < 20
    assert limited.limits.tool_speed == pytest.approx(by_hand)
    assert limited.limits.power == 80
    limited.limits.tool_speed = 0.1
    limited.limits.share_space()
    assert limited.limits.tool_speed == 0.1, "never more than there is"
    assert min(contact_speed(region, 16, 0.7) for region in BODY_REGIONS) == pytest.approx(0.38, abs=0.01)
    with pytest.raises(FrankaArmArgumentError, match="region is 'head': expected one of neck"):
        limited.limits.share_space("head")


def test_limits_outlive_the_process_of_their_arm(limited, ideal_arm):
    limited.limits.tool_speed = 0.2
    with client_after_crash(ideal_arm) as again:
        assert again.limits.tool_speed == 0.2
        first = ideal_arm.cycle()
        again.goto_joints(ASIDE, 0.5)
        assert tool_speed(ideal_arm.truth(first)).max() < 0.2


def test_the_configuration_is_the_most_that_may_be_set(start):
    arm = start(truth=True, ideal=True, settings={"limits": {"velocity": 0.5, "tool_speed": 0.25}})
    with arm.client() as fa:
        assert (fa.limits.velocity, fa.limits.most.tool_speed) == (0.5, 0.25)
        with pytest.raises(FrankaArmArgumentError, match=r"velocity is 0.8 of the robot's: expected 0.01 to 0.5"):
            fa.limits.velocity = 0.8
        with pytest.raises(FrankaArmArgumentError, match=r"tool_speed is 0.3 m/s: expected 0.01 to 0.25"):
            fa.limits.tool_speed = 0.3
        fa.goto_joints(HOME, 3)
        first = arm.cycle()
        fa.goto_joints(ASIDE, 0.5)
        assert 0.15 < tool_speed(arm.truth(first)).max() < 0.25
