"""Movement primitives, waypoints and samples, judged by the truth of the physics; what of them is refused."""

import numpy as np
import pytest
from conftest import HOME

from frankapy import FrankaArmArgumentError, FrankaArmException, RigidTransform, parts, proto
from frankapy.parts import (
    CartesianImpedance,
    CartesianVelocity,
    InternalImpedance,
    JointDmp,
    JointImpedance,
    JointSamples,
    JointWaypoints,
    MinJerkJoint,
    PoseDmp,
    PoseSamples,
    PoseWaypoints,
    Time,
)

TRUTH_FILE = True
GOAL = HOME + [0.2, -0.15, 0.1, 0.2, -0.2, 0.1, 0.3]


def rise(s):
    """Return the minimum-jerk rise from 0 to 1 and its first two derivatives."""
    s = np.clip(s, 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)


def curve(t, duration, ways, bows):
    """Return positions (n, dimensions) that go `ways` from 0, with `bows` to the side, and their derivatives."""
    s = t / duration
    p, dp, ddp = rise(s)
    b = p * (1 - p) * 4
    db = 4 * dp * (1 - 2 * p)
    ddb = 4 * (ddp * (1 - 2 * p) - 2 * dp**2)
    y = np.outer(p, ways) + np.outer(b, bows)
    return y, (np.outer(dp, ways) + np.outer(db, bows)) / duration, (np.outer(ddp, ways) + np.outer(ddb, bows)) / duration**2


def features(t, tau, mu, h):
    x = np.exp(-tau * t)
    psi = np.exp(-h * (x[:, None] - mu) ** 2)[:, 1:]
    first, _, _ = rise(2 * tau * t)
    return np.column_stack([first, psi * x[:, None] / psi.sum(axis=1, keepdims=True)])


def learned(duration, ways, bows, basis=25, alpha=25.0):
    """Return the dictionary of a movement primitive that was fitted to that curve."""
    tau, beta = 0.5 / duration, alpha / 4
    t = np.linspace(0, duration, 2000)
    y, dy, ddy = curve(t, duration, ways, bows)
    mu = np.exp(-0.5 * np.arange(basis) / (basis - 1))
    width = np.diff(mu)
    h = 0.5 / (0.65 * np.append(width, width[-1]) ** 2)
    f = y + (ddy / tau**2 + alpha * dy / tau) / (alpha * beta)
    weights = np.linalg.lstsq(features(t, tau, mu, h), f, rcond=None)[0].T
    return dict(
        tau=tau, alpha=alpha, beta=beta, num_basis=basis, num_sensors=1, mu=mu.tolist(), h=h.tolist(),
        weights=weights[:, None, :],
    )  # fmt: skip


def truth_of(arm, fa, run):
    """Return the times of the skill that `run()` makes, s since its begin, and the rows of the truth then."""
    with fa.states() as states:
        before = states.receive().skill_id
        run()
        state = next(each for each in states if each.skill_id != before and each.phase == proto.RUNNING)
    result = fa.last_skill_result
    assert result.ending == proto.TERMINATED, result
    rows = arm.truth(since=arm.cycle(state.robot.message_id) - round(1000 * state.skill_time))
    t = (rows["cycle"] - rows["cycle"][0]) / 1000
    return t[t <= result.time], rows[t <= result.time]


def orientation(rows):
    return rows["O_T_TCP"].reshape(-1, 4, 4).transpose(0, 2, 1)[:, :3, :3]


def position(rows):
    return rows["O_T_TCP"].reshape(-1, 4, 4)[:, 3, :3]


# --- movement primitives ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("use_impedance", [False, True])
def test_a_demonstration_of_the_joints_is_reproduced(fa, ideal_arm, use_impedance):
    duration, bows = 2.0, np.array([0.1, 0, -0.1, 0.1, 0, 0.2, 0])
    dmp = learned(duration, GOAL - HOME, bows)
    t, rows = truth_of(ideal_arm, fa, lambda: fa.execute_joint_dmp(dmp, duration, use_impedance=use_impedance))
    assert fa.last_skill_result.termination == "Time"
    assert fa.last_skill_result.time == pytest.approx(2.2, abs=0.02)
    expected = HOME + curve(t, duration, GOAL - HOME, bows)[0]
    np.testing.assert_allclose(rows["q"], expected, atol=0.02 if use_impedance else 0.01)  # it follows a little late
    np.testing.assert_allclose(rows["q"][-1], GOAL, atol=0.003)


@pytest.mark.parametrize("ee_frame", [False, True])
def test_a_demonstration_of_the_pose_is_reproduced(fa, ideal_arm, ee_frame):
    duration = 2.0
    ways, bows = np.array([0.05, 0.08, -0.06, 0.2, -0.1, 0.3]), np.array([0.02, 0, 0.03, 0, 0.1, 0])
    start = fa.get_pose(include_tool_offset=False)
    dmp = learned(duration, ways, bows)
    t, rows = truth_of(
        ideal_arm, fa, lambda: fa.execute_pose_dmp(dmp, duration, ee_frame=ee_frame, use_impedance=False)
    )
    y = curve(t, duration, ways, bows)[0]
    way = y[:, :3] @ (start.rotation.T if ee_frame else np.eye(3))
    np.testing.assert_allclose(position(rows), start.translation + way, atol=0.003)
    # R = Rx(a) Ry(b) Rz(c) of angles that have moved so far from those at the start.
    R = start.rotation
    angles = np.array([np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(R[0, 2]), np.arctan2(-R[0, 1], R[0, 0])]) + y[-1, 3:]
    turns = [RigidTransform.rotation_from_axis_angle(a * axis) for a, axis in zip(angles, np.eye(3), strict=True)]
    np.testing.assert_allclose(orientation(rows)[-1], turns[0] @ turns[1] @ turns[2], atol=0.003)


@pytest.mark.parametrize("only", ["position_only", "orientation_only"])
def test_a_demonstration_of_half_of_the_pose_leaves_the_other_half(fa, only):
    start = fa.get_pose(include_tool_offset=False)
    fa.execute_pose_dmp(learned(1.5, [0.05, -0.1, 0.1], np.zeros(3)), 1.5, use_impedance=False, **{only: True})
    end = fa.get_pose(include_tool_offset=False)
    moved = end.translation - start.translation
    turned = np.arccos(np.clip((np.trace(start.rotation.T @ end.rotation) - 1) / 2, -1, 1))
    if only == "position_only":
        np.testing.assert_allclose(moved, [0.05, -0.1, 0.1], atol=0.001)
        assert turned < 0.002
    else:
        assert np.linalg.norm(moved) < 0.001
        assert turned > 0.1


def test_the_goal_formulation_goes_to_its_goal(fa):
    start = fa.get_pose(include_tool_offset=False).translation
    weights = np.zeros((6, 2, 2))
    weights[1, :, 0] = 1
    spring = dict(tau=0.5, alpha=16, beta=4, num_basis=2, num_sensors=2, mu=[1, 0.8], h=[50, 50], weights=weights)
    values = np.zeros((6, 2))
    values[1] = [0.1, -0.02]  # of the two sensors, which are added
    fa.execute_pose_dmp(spring, 3, use_goal_formulation=True, initial_sensor_values=values.ravel().tolist())
    np.testing.assert_allclose(fa.get_pose(include_tool_offset=False).translation - start, [0, 0.08, 0], atol=0.003)


def test_a_quaternion_primitive_turns_to_its_goal(fa):
    start = fa.get_pose(include_tool_offset=False)
    turn = RigidTransform.rotation_from_axis_angle(np.array([0.2, -0.1, 0.4]))
    goal = RigidTransform(turn @ start.rotation, start.translation)
    still = dict(learned(2, np.zeros(3), np.zeros(3)), alpha=48, beta=12)
    fa.execute_quaternion_pose_dmp(
        learned(2, [0.05, 0.05, -0.05], [0, 0, 0.03]), still, 2, tuple(1.004 * goal.quaternion), 1.5, use_impedance=False
    )
    end = fa.get_pose(include_tool_offset=False)
    np.testing.assert_allclose(end.translation - start.translation, [0.05, 0.05, -0.05], atol=0.001)
    np.testing.assert_allclose(end.rotation, goal.rotation, atol=0.002)


def test_a_primitive_that_touches_nothing_ends_with_its_time(fa):
    fa.execute_joint_dmp(learned(1, GOAL - HOME, np.zeros(7)), 1, force_thresholds=[60] * 6, buffer_time=0.1)
    assert fa.last_skill_result.termination == "Time"
    np.testing.assert_allclose(fa.get_joints(), GOAL, atol=0.005)


# --- waypoints -------------------------------------------------------------------------------------------------------


def test_waypoints_of_joints_are_passed_at_their_times(fa, ideal_arm):
    way = GOAL - HOME
    q = np.array([HOME + 0.5 * way, HOME + [0.1, 0, 0, 0, 0.1, 0, 0], GOAL, HOME])
    times = [1.0, 2.0, 3.5, 5.0]
    t, rows = truth_of(ideal_arm, fa, lambda: fa.run(JointWaypoints(q, times=times), InternalImpedance([3000] * 7)))
    assert fa.last_skill_result.stretch == 1
    for when, where in zip(times, q, strict=True):
        near = abs(t - when) < 0.03  # it follows a little late
        np.testing.assert_allclose(np.abs(rows["q"][near] - where).max(axis=1).min(), 0, atol=0.002)


def test_waypoints_without_times_take_as_long_as_the_speed_allows(fa):
    q = np.array([HOME + 0.3 * (GOAL - HOME), HOME + 0.7 * (GOAL - HOME), GOAL])
    durations = []
    for speed in (0.05, 0.1, 0.2):
        fa.run(MinJerkJoint(HOME, 1))
        durations.append(fa.run(JointWaypoints(q, speed=speed), JointImpedance()).time)
        np.testing.assert_allclose(fa.get_joints(), GOAL, atol=0.01)
    assert durations[0] > 1.4 * durations[1] > 1.4 * 1.2 * durations[2]


def test_waypoints_that_come_too_soon_are_stretched(fa):
    result = fa.run(JointWaypoints([GOAL, HOME], times=[0.05, 0.1]))
    assert result.stretch > 3
    assert result.time == pytest.approx(0.1 * result.stretch, abs=0.05)
    np.testing.assert_allclose(fa.get_joints(), HOME, atol=0.002)


def test_waypoints_of_poses_are_passed_at_their_times(fa, ideal_arm):
    start = fa.get_pose(include_tool_offset=False)
    poses = []
    for shift, axis in [([0.05, 0, 0], [0.2, 0, 0]), ([0.05, 0.08, 0], [0, 0.2, 0]), ([0, 0.1, -0.05], [0, 0, 0.3])]:
        turn = RigidTransform.rotation_from_axis_angle(np.array(axis))
        poses.append(RigidTransform(start.rotation @ turn, start.translation + shift))
    times = [1.0, 2.0, 3.0]
    part = PoseWaypoints(poses, times=times)
    t, rows = truth_of(ideal_arm, fa, lambda: fa.run(part, InternalImpedance(), Time(after_trajectory=0.2)))
    for when, pose in zip(times, poses, strict=True):
        near = abs(t - when) < 0.03
        distances = np.linalg.norm(position(rows)[near] - pose.translation, axis=1)
        assert distances.min() < 0.001
        np.testing.assert_allclose(orientation(rows)[near][distances.argmin()], pose.rotation, atol=0.01)


# --- samples ---------------------------------------------------------------------------------------------------------


def test_samples_of_joints_are_followed(fa, ideal_arm):
    t = np.arange(2001) / 1000
    q = HOME + np.outer(np.sin(np.pi * t / 2) ** 2, GOAL - HOME)
    t, rows = truth_of(ideal_arm, fa, lambda: fa.run(JointSamples(q), InternalImpedance([3000] * 7)))
    assert fa.last_skill_result.stretch == 1
    expected = HOME + np.outer(np.sin(np.pi * np.minimum(t, 2) / 2) ** 2, GOAL - HOME)
    np.testing.assert_allclose(rows["q"], expected, atol=0.01)
    # What was recorded plays again.
    fa.run(MinJerkJoint(HOME, 1))
    fa.run(JointSamples(rows["q"]), JointImpedance())
    np.testing.assert_allclose(fa.get_joints(), HOME, atol=0.01)


def test_samples_of_poses_are_followed(fa, ideal_arm):
    start = fa.get_pose(include_tool_offset=False)
    s = np.sin(np.pi * np.arange(1501) / 1500) ** 2
    poses = [
        RigidTransform(
            start.rotation @ RigidTransform.rotation_from_axis_angle(np.array([0, 0.3 * each, 0])),
            start.translation + each * np.array([0.03, 0.08, -0.05]),
        )
        for each in s
    ]
    t, rows = truth_of(ideal_arm, fa, lambda: fa.run(PoseSamples(poses), InternalImpedance()))
    share = np.sin(np.pi * np.minimum(t, 1.5) / 1.5) ** 2
    np.testing.assert_allclose(position(rows), start.translation + np.outer(share, [0.03, 0.08, -0.05]), atol=0.003)
    middle = np.argmin(abs(t - 0.75))
    np.testing.assert_allclose(orientation(rows)[middle], poses[750].rotation, atol=0.01)


def test_two_minutes_of_samples_are_taken(fa):
    result = fa.run(JointSamples(np.tile(HOME, (120_000, 1))), JointImpedance(), Time(0.1))
    assert result.termination == "Time"


# --- what is refused -------------------------------------------------------------------------------------------------

DMP = learned(1, np.zeros(7), np.zeros(7))
UPRIGHT = [0.0, 1, 0, 0]


def with_a_nan(q):
    q = np.array(q, dtype=float)
    q[1, 2] = np.nan
    return q


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (lambda: JointWaypoints(np.zeros((3, 6))), r"JointWaypoints.q has the shape \(3, 6\): expected \(n, 7\)"),
        (lambda: JointWaypoints(np.zeros(14)), r"JointWaypoints.q has the shape \(14,\): expected \(n, 7\)"),
        (lambda: JointWaypoints(np.zeros((0, 7))), r"JointWaypoints.q has the shape \(0, 7\)"),
        (lambda: JointWaypoints([[1, 2], [3]]), r"JointWaypoints.q is \[\[1, 2\], \[3\]\]: expected rows of 7"),
        (lambda: JointWaypoints("there"), "JointWaypoints.q is 'there': expected rows of 7 numbers"),
        (lambda: JointWaypoints(with_a_nan(np.zeros((3, 7)))), r"JointWaypoints.q\[1, 2\] is nan"),
        (lambda: JointWaypoints(np.zeros((1001, 7))), "JointWaypoints.q has 1001 rows: expected at most 1000"),
        (lambda: JointWaypoints([HOME], times=[-1]), r"JointWaypoints.times\[0\] is -1 s"),
        (lambda: JointWaypoints([HOME], speed=2), "JointWaypoints.speed is 2 of the limits: expected 0.01 to 1"),
        (lambda: JointWaypoints(), "JointWaypoints.q has 0 elements: expected rows of 7"),
        (lambda: PoseWaypoints([[0, 0, 3]], [UPRIGHT]), r"PoseWaypoints.position\[2\] is 3 m: expected -2 to 2"),
        (lambda: PoseWaypoints([[0, 0, 0]] * 2, [UPRIGHT, [0, 2, 0, 0]]), "row 1 of PoseWaypoints.quaternion has the norm"),
        (lambda: JointSamples(np.zeros((120_001, 7))), "JointSamples.q has 120001 rows: expected at most 120000"),
        (lambda: JointSamples(with_a_nan(np.zeros((3, 7)))), r"JointSamples.q\[1, 2\] is nan"),
        (lambda: JointDmp(1, 25, 6, [1], [1], np.full((7, 1), np.inf)), r"JointDmp.weights\[0\] is inf"),
        (lambda: JointDmp(1, 25, 6, [1], "wide"), "JointDmp.h is 'wide': expected numbers"),
        (lambda: PoseDmp(-1, 25, 6, [1], [1], np.zeros(6)), "PoseDmp.tau is -1 1/s"),
        (lambda: PoseDmp(1), "PoseDmp.alpha is missing"),
        (lambda: parts.MinJerkPose([RigidTransform()]), "MinJerkPose takes no poses here"),
    ],
)
def test_what_breaks_a_rule_is_refused_by_name(wrong, says):
    with pytest.raises(FrankaArmArgumentError, match=says):
        wrong()


def test_what_is_listed_says_how_tables_are_given():
    fields = proto.PoseSamples.DESCRIPTOR.fields_by_name
    assert parts.text_of(fields["position"]) == "up to 120000 rows of 3 numbers, m, -2 to 2, must be given"
    assert "times: numbers, s, 0.001 to 3600, may be left out" in parts.JointWaypoints.__doc__
    q = np.arange(14.0).reshape(2, 7)
    for each in (q, q.tolist(), [tuple(row) for row in q], q.astype(np.float32)):
        np.testing.assert_array_equal(JointWaypoints(each, times=[1, 2]).q, q.ravel())
    assert list(JointWaypoints(q[0]).q) == list(q[0])


def test_what_the_arm_cannot_do_is_refused_by_name(ideal_arm):
    far = HOME.copy()
    far[3] = 0.5
    out = RigidTransform(np.diag([1.0, -1, -1]), [0.9, 0.4, 0.4])
    with ideal_arm.client() as fa:
        fa.goto_joints(HOME, 1)
        near = fa.get_pose(include_tool_offset=False)
        beside = near.copy()
        beside.translation = near.translation + [0, 0.1, 0]
        for part, says in [
            (JointWaypoints([HOME, far]), r"JointWaypoints: waypoint 1 of q\[3\] is 0.5"),
            (JointWaypoints([HOME, GOAL], times=[1]), "JointWaypoints: times has 1 elements: expected 2"),
            (JointWaypoints([HOME, GOAL], times=[2, 1]), r"JointWaypoints: times\[1\] is 1"),
            (PoseWaypoints([near, out, near]), "PoseWaypoints: waypoint 1 is out of the arm's reach"),
            (PoseWaypoints([near.translation] * 2, [near.quaternion]), "PoseWaypoints: there are 2 positions and 1 quat"),
            (JointSamples([GOAL] * 3), "JointSamples: the first sample has joint 1 at 0.2 rad.*move it to the first sample"),
            (JointSamples([HOME]), "JointSamples: number of samples is 1"),
            (PoseSamples([beside] * 3), "PoseSamples: the first sample is 0.1.*move it there before"),
            (PoseSamples([near, near, out]), "PoseSamples: sample 2 is out of the arm's reach"),
            (JointDmp(0.5, 25, 6, [1, 2], [1], np.zeros(14)), "JointDmp: h has 1 elements: expected 2, as mu has"),
            (JointDmp(0.5, 25, 6, [1], [1], np.zeros(6)), "JointDmp: weights has 6 elements: expected 7"),
            (JointDmp(100, 25, 6, [1], [1], np.zeros(7)), "JointDmp: natural frequency of tau, alpha and beta is 2500"),
            (JointDmp(1, 60, 15, [1], [1], 4 * np.eye(7)[0]), "JointDmp: its goal is beyond the arm's range"),
            (PoseDmp(1, 60, 15, [1], [1], [1, 0, 0, 0, 0, 0]), "PoseDmp: its goal is out of the arm's reach"),
            (PoseDmp(1, 60, 15, [1], [1], [0] * 3, position_only=True, orientation_only=True), "both true"),
        ]:
            controller = JointImpedance() if part.DESCRIPTOR.name.startswith("Joint") else CartesianImpedance()
            with pytest.raises(FrankaArmException, match=says):
                fa.run(part, controller)
        assert fa.run(JointWaypoints([HOME]), JointImpedance()).ending == proto.TERMINATED


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (dict(weights=np.zeros(8)), r"joint_dmp_info\['weights'\] has 8 elements: expected 175, 7 dimensions times"),
        (dict(mu=[1.0] * 4), r"joint_dmp_info\['mu'\] has 4 elements: expected 25, num_basis"),
        (dict(h="wide"), r"joint_dmp_info\['h'\] is 'wide'"),
        (dict(tau=[1, 2]), r"joint_dmp_info\['tau'\] is \[1, 2\]: expected a number"),
        (dict(tau=0), "JointDmp.tau is 0 1/s"),
        (dict(weights=np.full((7, 25), np.nan)), r"joint_dmp_info\['weights'\]\[0\] is nan"),
    ],
)
def test_a_dictionary_whose_sizes_disagree_is_refused(fa, change, says):
    with pytest.raises(FrankaArmArgumentError, match=says):
        fa.execute_joint_dmp({**DMP, **change}, 1)


def test_what_else_a_primitive_is_given_is_checked(fa):
    with pytest.raises(FrankaArmArgumentError, match="joint_dmp_info has no mu: expected tau, alpha"):
        fa.execute_joint_dmp({key: value for key, value in DMP.items() if key != "mu"}, 1)
    with pytest.raises(FrankaArmArgumentError, match="initial_sensor_values has 2 elements: expected 1"):
        fa.execute_joint_dmp(DMP, 1, initial_sensor_values=[1, 1])
    with pytest.raises(FrankaArmArgumentError, match="JointDmp.duration is 500 s: expected 0.001 to 120 s"):
        fa.execute_joint_dmp(DMP, 500)
    pose = learned(1, np.zeros(3), np.zeros(3))
    with pytest.raises(FrankaArmArgumentError, match="goal_quat has the norm 2"):
        fa.execute_quaternion_pose_dmp(pose, pose, 1, [2, 0, 0, 0], 1)
    with pytest.raises(FrankaArmArgumentError, match=r"quat_dmp_info\['weights'\] has 75 elements: expected 150"):
        fa.execute_quaternion_pose_dmp(pose, {**pose, "num_sensors": 2}, 1, UPRIGHT, 1)


@pytest.mark.parametrize("robot", ["fer", "fr3"])
def test_a_velocity_without_an_acceleration_is_reached_as_fast_as_the_joints_can_and_not_overshot(start, robot):
    arm = start(robot=robot, ideal=True)
    with arm.client() as fa:
        for axis in range(3):
            fa.run(MinJerkJoint(HOME, 1))
            first = arm.cycle()
            result = fa.run(CartesianVelocity(0.1 * np.eye(6)[axis], duration=0.5), InternalImpedance())
            assert (result.ending, result.limited_cycles, result.stretch) == (proto.TERMINATED, 0, 1)  # it is what was asked for
            speed = 1000 * np.diff(arm.truth(first)["O_T_TCP"][:, 12 + axis])
            assert 0.099 < speed.max() < 0.102
