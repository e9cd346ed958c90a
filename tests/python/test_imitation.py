"""From a hand that leads the arm to a motion that the arm makes: recording, smoothing, learning, execution."""

import contextlib
import pickle
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import HOME

from frankapy import FrankaArm, FrankaArmArgumentError, RigidTransform, cli, dmp, guidance, proto
from frankapy.demonstration import Demonstration
from frankapy.parts import InternalImpedance
from frankapy.sim import free_address
from frankapy.writing import require_writable

TRUTH_FILE = True


def bow(n=600, duration=3.0):
    """A smooth motion of the joints: there, with a bow."""
    s = np.linspace(0, 1, n)
    p = s**3 * (10 - 15 * s + 6 * s**2)
    way = np.outer(p, [0.3, 0.1, -0.2, 0.2, 0.1, -0.1, 0.4]) + np.outer(4 * p * (1 - p), [0, 0.1, 0, 0, 0.2, 0, 0])
    return Demonstration(s * duration, HOME + way)


def turn(angle, n=600, duration=3.0):
    """The tool goes along a bow and turns about its axis by an angle, rad."""
    s = np.linspace(0, 1, n)
    p = s**3 * (10 - 15 * s + 6 * s**2)
    positions = [0.307, 0, 0.487] + np.outer(p, [0.1, -0.1, -0.1]) + np.outer(4 * p * (1 - p), [0, 0, 0.05])
    down = RigidTransform(np.diag([1.0, -1, -1]), np.zeros(3))
    spin = [RigidTransform(RigidTransform.z_axis_rotation(angle * each), np.zeros(3), "world", "world") for each in p]
    orientations = np.array([RigidTransform(each.rotation @ down.rotation, np.zeros(3)).quaternion for each in spin])
    return Demonstration(s * duration, None, positions, orientations)


def angle_between(a, b):
    return 2 * np.arccos(np.minimum(np.abs(np.sum(a * b, axis=-1)), 1))


# --- demonstrations --------------------------------------------------------------------------------------------------


def test_rests_part_a_demonstration():
    s = np.linspace(0, 1, 200)
    p = s**3 * (10 - 15 * s + 6 * s**2)
    rest = np.zeros(150)
    path = np.concatenate([rest, 0.3 * p, rest + 0.3, 0.3 - 0.2 * p, rest + 0.1])
    whole = Demonstration(np.arange(len(path)) * 0.01, None, np.column_stack([path, 0 * path, 0 * path]))
    first, second = whole.segments()
    assert first.duration == pytest.approx(2.0, abs=0.3) and second.duration == pytest.approx(2.0, abs=0.3)
    np.testing.assert_allclose(first.positions[[0, -1], 0], [0, 0.3], atol=0.002)
    np.testing.assert_allclose(second.positions[[0, -1], 0], [0.3, 0.1], atol=0.002)
    assert whole.trimmed().duration == pytest.approx(1.5 + 4, abs=0.3)
    assert len(whole.segments(least=5)) == 1
    with pytest.raises(FrankaArmArgumentError, match="nothing moves"):
        Demonstration([0, 0.1, 0.2, 0.3], np.zeros((4, 7))).trimmed()


def test_smoothing_takes_the_tremor_and_leaves_the_motion():
    clean = turn(1.0)
    random = np.random.default_rng(0)
    noisy = Demonstration(clean.times, None, clean.positions + 0.001 * random.standard_normal((600, 3)), clean.orientations)
    smooth = noisy.smooth(0.05)
    at = np.column_stack([np.interp(clean.times, smooth.times, column) for column in smooth.positions.T])
    assert np.abs(at - clean.positions)[50:-50].max() < 0.0008 and np.abs(at - clean.positions).max() < 0.004
    jerk = lambda demonstration: np.abs(np.diff(demonstration.positions, 3, axis=0)).max()  # noqa: E731
    assert jerk(smooth) < jerk(noisy) / 50
    np.testing.assert_allclose(np.linalg.norm(smooth.orientations, axis=1), 1)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Demonstration([0], np.zeros((1, 7))), "has 1 samples: expected at least 2"),
        (lambda: Demonstration([0, 0.1, 0.1], np.zeros((3, 7))), r"times\[2\] is 0.1 s after 0.1 s"),
        (lambda: Demonstration([0, 0.1, 2], np.zeros((3, 7))), "a gap of 1.90 s at 0.10 s"),
        (lambda: Demonstration([0, 0.01], np.outer([0, 1], np.ones(7))), "joints jump by 1.000 rad in 0.0100 s"),
        (lambda: Demonstration([0, 0.1], np.full((2, 7), np.nan)), r"joints\[0, 0\] is nan"),
        (lambda: Demonstration([0, 0.1], np.zeros((2, 6))), r"joints has the shape \(2, 6\): expected \(2, 7\)"),
        (lambda: Demonstration([0, 0.1]), "neither joints nor positions"),
        (lambda: Demonstration([0, 0.1], None, np.zeros((2, 3)), np.zeros((2, 4))), "norms of 0.000 to 0.000"),
        (lambda: Demonstration([0, 0.1], None, None, np.tile([1, 0, 0, 0], (2, 1))), "neither joints nor positions"),
        (lambda: Demonstration([0, 0.01], None, np.zeros((2, 3)), np.eye(4)[:2]), "orientations turn by 3.142 rad in 0.0100 s"),
        (lambda: Demonstration([0, 0.1], "far"), "joints are no numbers"),
        (lambda: bow().smooth(10), "width is 10 s"),
        (lambda: bow().cut(5, 6), "0 samples of 600 are there"),
        (lambda: bow().resampled(-2), "samples is -2: expected a whole number"),
        (lambda: dmp.fit([], "joint"), "no demonstration"),
        (lambda: dmp.fit(bow(), "elbow"), "kind is 'elbow': expected one of joint, position, pose"),
        (lambda: dmp.fit(bow(), "pose"), "lacks what a primitive of pose is learned from"),
        (lambda: dmp.fit(bow(), "joint", basis=1), "basis is 1: expected 2 to 100"),
        (lambda: dmp.fit(bow(), "joint", method="magic"), "method is 'magic'"),
        (lambda: dmp.fit(bow(), "joint").part(0), "duration is 0 s: expected 0.01 to 120 s"),
        (lambda: dmp.fit(bow(), "joint").part(goal=[1, 2]), "goal has 2 elements: expected 7"),
        (lambda: dmp.fit(bow(), "joint").part(sensor_values=[1, 2]), r"sensor_values has the shape \(2,\): expected \(1,\)"),
        (lambda: dmp.fit(bow(), "joint").orientations(), "it has no orientation"),
        (lambda: dmp.fit(bow(), "joint").part(goal_orientation=[1, 0, 0, 0]), "goal_orientation is for a primitive of a pose"),
        (lambda: dmp.fit(turn(np.radians(200)), "pose"), "turns by 200 degrees from its goal: expected at most 180"),
        (lambda: dmp.fit(bow()).part(goal=HOME, sensor_values=[0]), "a goal cannot be reached with them"),
        (lambda: dmp.fit([bow(), bow()], sensor_values=[1, 1]), r"has the shape \(2,\): expected \(2, sensors\)"),
        (lambda: dmp.fit([bow(), bow()], sensor_values=[[1, 2], [2, 4]]), "tell 1 of 2 sensors apart"),
        (lambda: dmp.fit(bow(), sensor_values=[[1, 0]]), "tell 1 of 2 sensors apart"),
        (lambda: dmp.Primitive("joint", 1, HOME, np.ones(3), np.ones(2), np.ones((7, 1, 3))), r"h has the shape \(2,\): expected \(3,\)"),
    ],
)
def test_what_cannot_be_learned_from_is_refused(make, text):
    with pytest.raises(FrankaArmArgumentError, match=text):
        make()


class Evil:
    def __reduce__(self):
        return print, ("run",)


def test_of_states_with_a_gap_the_longest_part_is_kept(caplog):
    times = np.r_[np.arange(100), np.arange(700, 1000), np.arange(2000, 2050)] * 1e-3
    joints = np.outer(np.linspace(0, 0.1, len(times)), np.ones(7))
    kept = Demonstration.of_states(times, joints, np.tile(np.eye(4).ravel(), (len(times), 1)))
    assert kept.duration == pytest.approx(0.299)
    assert "of 3 parts the longest is kept" in caplog.text


def test_files_are_read_back_and_pickles_run_nothing(tmp_path, capsys):
    demonstration = turn(1.0)
    demonstration.save(tmp_path / "a.npz")
    again = Demonstration.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(again.positions, demonstration.positions)
    assert again.joints is None
    for name in ("b", "b.pkl", "b.mcap", "b.NPZ"):
        demonstration.save(tmp_path / name)
        assert len(Demonstration.load(tmp_path / name)) == len(demonstration)
    poses = [RigidTransform(RigidTransform.x_axis_rotation(0.001 * i), [0, 0, 0.001 * i], "franka_tool", "world") for i in range(50)]
    (tmp_path / "poses.pkl").write_bytes(pickle.dumps(poses))
    of_poses = Demonstration.load(tmp_path / "poses.pkl")
    assert of_poses.duration == pytest.approx(0.49)
    np.testing.assert_allclose(of_poses.positions[-1], [0, 0, 0.049])
    states = {"q": np.zeros((3, 7)), "O_T_EE": np.tile(np.eye(4).ravel(), (3, 1)), "time_since_skill_started": np.array([0, 0.01, 0.02])}
    (tmp_path / "guided.pkl").write_bytes(pickle.dumps({0: {"skill_description": "GuideMode", "skill_state_dict": states}}))
    assert len(Demonstration.load(tmp_path / "guided.pkl")) == 3
    for name, data, text in (
        ("evil.pkl", pickle.dumps([Evil()]), "print, which is not made from files"),
        ("broken.pkl", pickle.dumps(poses)[:-20], "cannot be read as a pickle"),
        ("other.pkl", pickle.dumps({"a": 1}), "holds a dictionary with a: expected a list of poses, or"),
        ("primitive.pkl", pickle.dumps(old_dictionary(3)), "the dictionary of a movement primitive, which dmp.load_script"),
        ("lacks.pkl", pickle.dumps({0: {"skill_state_dict": {"q": [1]}}}), "has no 'O_T_EE' in its skill_state_dict"),
        ("text.pkl", pickle.dumps({0: {"skill_state_dict": states | {"O_T_EE": "far"}}}), "text.pkl holds no motion of an arm: could not"),
        ("short.pkl", pickle.dumps({0: {"skill_state_dict": states | {"O_T_EE": np.zeros((3, 15))}}}), "short.pkl holds no motion"),
        ("zeros.pkl", pickle.dumps({0: {"skill_state_dict": states | {"O_T_EE": np.zeros((3, 16))}}}), "this is no rotation matrix"),
        ("gap.pkl", pickle.dumps({0: {"skill_state_dict": states | {"time_since_skill_started": [0, 1, 2]}}}), "a gap of 1.00 s"),
        ("garbage.npz", b"PK\x03\x04garbage", "archive"),
        ("broken.npz", (tmp_path / "a.npz").read_bytes()[:500], "archive"),
        ("nothing.npz", None, "cannot be read: No such file"),
    ):
        if data is not None:
            (tmp_path / name).write_bytes(data)
        with pytest.raises(FrankaArmArgumentError, match=text):
            Demonstration.load(tmp_path / name)
    assert "run" not in capsys.readouterr().out
    np.savez(tmp_path / "strange.npz", format=np.array("something"), a=np.zeros(3))
    with pytest.raises(FrankaArmArgumentError, match="is no 'frankapy demonstration 1'"):
        Demonstration.load(tmp_path / "strange.npz")


# --- learning --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("method", "rms"), [("ridge", 2e-4), ("local", 2e-2)])
def test_a_rollout_is_what_was_demonstrated(method, rms):
    primitive = dmp.fit(bow(), "joint", method=method)
    t, y = primitive.rollout()
    expected = np.column_stack([np.interp(t, bow().times, column) for column in bow().joints.T])
    assert np.sqrt(np.mean(np.sum((y - expected) ** 2, axis=1))) < rms
    assert primitive.rms == pytest.approx(np.sqrt(np.mean(np.sum((y - expected) ** 2, axis=1))), rel=0.1)
    twice, slow = primitive.rollout(duration=6)
    np.testing.assert_allclose(slow, y, atol=1e-9)
    assert twice[-1] == 6


def test_a_new_goal_is_reached_from_a_new_start():
    primitive = dmp.fit(turn(1.0), "position")
    start, goal = [0.4, 0.1, 0.4], [0.3, 0.3, 0.5]
    y = primitive.rollout(start=start, goal=goal)[1]
    np.testing.assert_allclose(y[0], start)
    np.testing.assert_allclose(y[-1], goal, atol=1e-9)
    np.testing.assert_allclose(primitive.goal, turn(1.0).positions[-1], atol=1e-3)
    for sensors in ([0.5], [[2], [0.3], [1]]):
        y = primitive.rollout(start=start, goal=goal, sensor_values=sensors)[1]
        np.testing.assert_allclose(y[-1], goal, atol=1e-9)


@pytest.mark.parametrize("degrees", [20, 150, -170, 179])
def test_orientations_turn_by_more_than_120_degrees(degrees):
    demonstration = turn(np.radians(degrees))
    primitive = dmp.fit(demonstration, "pose")
    q = primitive.orientations()
    times = np.linspace(0, demonstration.duration, len(q))
    at = demonstration.resampled(len(q)).orientations
    assert np.degrees(angle_between(q, at).max()) < 1 and len(times) == len(q)
    assert np.degrees(primitive.rms_angle) < 0.5


def test_of_several_demonstrations_the_mean_is_learned():
    rows = [bow(), bow()]
    rows[0].joints[:, 0] += 0.1 * np.sin(np.linspace(0, np.pi, 600))
    rows[1].joints[:, 0] -= 0.1 * np.sin(np.linspace(0, np.pi, 600))
    rows[1] = Demonstration(rows[1].times * 2, rows[1].joints + 0.2)
    primitive = dmp.fit(rows, "joint")
    assert primitive.duration == pytest.approx(4.5)
    y = primitive.rollout(start=HOME)[1]
    np.testing.assert_allclose(y[:, 0], bow().resampled(len(y)).joints[:, 0], atol=2e-3)
    assert 0.05 < primitive.rms < 0.1  # they differ by that


def test_of_several_demonstrations_that_turn_differently_the_error_says_so():
    one, other = turn(1.0), turn(1.0 + np.radians(40))
    primitive = dmp.fit([one, other], "pose")
    middle = turn(1.0 + np.radians(20))
    q = primitive.orientations()
    assert np.degrees(angle_between(q, middle.resampled(len(q)).orientations).max()) < 0.5
    assert 5 < np.degrees(primitive.rms_angle) < 20  # 20 degrees at the end, nothing at the start
    assert np.degrees(dmp.fit([one, one], "pose").rms_angle) < 0.5


def test_primitives_are_written_and_read_and_old_scripts_find_their_dictionaries(tmp_path):
    primitive = dmp.fit(turn(1.0), "pose")
    primitive.save(tmp_path / "p.npz")
    again = dmp.Primitive.load(tmp_path / "p.npz")
    np.testing.assert_array_equal(again.rollout()[1], primitive.rollout()[1])
    np.testing.assert_array_equal(again.orientations(), primitive.orientations())
    assert repr(again) == repr(primitive)
    primitive.save(tmp_path / "p.pkl")
    for part in ("position", "quaternion"):
        info = dmp.load_script(tmp_path / f"p-{part}.pkl")
        assert info["num_basis"] == 25 and np.size(info["weights"]) == 75
    poses = [RigidTransform(from_frame="franka_tool")] * 3
    for held, text in (
        ({"a": 1, "b": 2}, "a dictionary with a, b: expected a dictionary with tau"),
        (poses, "a list of poses, which Demonstration.load reads: expected a dictionary with tau"),
        ({0: {"skill_state_dict": {"q": [1]}}}, "what record_trajectory.py writes, which Demonstration.load reads"),
        ([], "an empty list: expected"),
    ):
        (tmp_path / "other.pkl").write_bytes(pickle.dumps(held))
        for read in (dmp.load_script, dmp.Primitive.load):
            with pytest.raises(FrankaArmArgumentError, match=f"holds {text}"):
                read(tmp_path / "other.pkl")
    from_script = dmp.Primitive.load(tmp_path / "p-position.pkl")
    np.testing.assert_allclose(from_script.rollout(start=primitive.start)[1], primitive.rollout()[1], atol=1e-12)
    with pytest.raises(FrankaArmArgumentError, match="is no 'frankapy primitive 1'"):
        turn(1.0).save(tmp_path / "d.npz")
        dmp.Primitive.load(tmp_path / "d.npz")


def old_dictionary(dimensions, sensors=2, basis=5, tau=0.25, alpha=20.0):
    """A dictionary as a lab's pickles have it, soft and with several sensors."""
    weights = np.random.default_rng(1).uniform(-0.05, 0.05, (dimensions, sensors, basis))
    weights[:, :, 0] = 0.02
    return dict(
        tau=tau, alpha=alpha, beta=alpha / 5, num_basis=basis, num_sensors=sensors,
        mu=[1.0, 0.9, 0.8, 0.7, 0.6], h=[60.0] * 5, weights=weights.ravel().tolist(),
    )  # fmt: skip


def way_of(info, values, duration, steps=20_000):
    """Integrate the law of a dictionary in small steps; where it is at the end, (dimensions,)."""
    weights = np.reshape(info["weights"], (-1, info["num_sensors"], info["num_basis"]))
    y, v, dt = np.zeros(len(weights)), np.zeros(len(weights)), duration / steps
    tau, alpha, beta = info["tau"], info["alpha"], info["beta"]
    for k in range(steps):
        t = k * dt
        x, u = np.exp(-tau * t), min(2 * tau * t, 1)
        psi = np.exp(-np.array(info["h"][1:]) * (x - np.array(info["mu"][1:])) ** 2)
        f = np.einsum("dsk,s,k->d", weights, values, np.r_[u**3 * (10 - 15 * u + 6 * u * u), psi / psi.sum() * x])
        v = v + dt * tau**2 * (alpha * (beta * -y - v / tau) + alpha * beta * f)
        y = y + dt * v
    return y


@pytest.mark.parametrize(("dimensions", "kind"), [(7, "joint"), (3, "position")])
def test_dictionaries_of_old_scripts_are_primitives_too(tmp_path, dimensions, kind):
    info = old_dictionary(dimensions)
    (tmp_path / "old.pkl").write_bytes(pickle.dumps(info, protocol=2))
    primitive = dmp.Primitive.load(tmp_path / "old.pkl")
    assert (primitive.kind, primitive.duration, primitive.start) == (kind, 2.0, None)
    start = np.full(dimensions, 0.1)
    for values in ([1, 1], [0.3, -1]):
        y = primitive.rollout(start=start, sensor_values=values)[1]
        np.testing.assert_allclose(y[-1] - start, way_of(info, values, 2), atol=1e-5)
    np.testing.assert_allclose(primitive.rollout(start=start, goal=start + 0.2)[1][-1], start + 0.2)
    assert list(primitive.part().weights) == pytest.approx(info["weights"])
    primitive.save(tmp_path / "new.npz")
    again = dmp.Primitive.load(tmp_path / "new.npz")
    np.testing.assert_array_equal(again.rollout(start=start)[1], primitive.rollout(start=start)[1])
    for call in (lambda: primitive.goal, primitive.rollout, lambda: primitive.part(goal=start)):
        with pytest.raises(FrankaArmArgumentError, match="start is missing"):
            call()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (old_dictionary(6), "60 weights: expected 7 .* or 3 .* those of 6 are for fa.execute_pose_dmp"),
        (dict(num_sensors=3), "num_sensors 3"),
        (dict(num_basis=0), "num_basis 0"),
        (dict(num_basis="many"), r"old.pkl\['num_basis'\] is 'many'"),
        (dict(mu=[1, 2]), r"old.pkl\['mu'\] has 2 elements: expected 5"),
        (dict(tau=0), r"old.pkl\['tau'\] is 0 1/s"),
        (dict(weights=[[1, 2], [3]]), r"old.pkl\['weights'\] is"),
    ],
)
def test_dictionaries_that_are_no_motion_are_refused(tmp_path, change, text):
    (tmp_path / "old.pkl").write_bytes(pickle.dumps(old_dictionary(3) | change))
    with pytest.raises(FrankaArmArgumentError, match=text):
        dmp.Primitive.load(tmp_path / "old.pkl")


@pytest.mark.parametrize("method", ["ridge", "local"])
def test_what_demonstrations_differ_by_is_learned_as_sensors(tmp_path, method):
    low, high = bow(), bow()
    high.joints[:, 0] += 0.2 * np.sin(np.linspace(0, np.pi, 600)) ** 2
    high = Demonstration(high.times, high.joints)
    both = dmp.fit([low, high], "joint", method=method, sensor_values=[[1, 0], [1, 1]])
    alone = dmp.fit(high, "joint", method=method)
    assert both.weights.shape == (7, 2, 25)
    np.testing.assert_allclose(both.rollout(sensor_values=[1, 1])[1], alone.rollout()[1], atol=1e-6)
    low_way, middle, high_way = (both.rollout(sensor_values=[1, by])[1] for by in (0, 0.5, 1))
    np.testing.assert_allclose(middle, (low_way + high_way) / 2, atol=1e-9)
    assert both.rms < max(dmp.fit([low, high], "joint", method=method).rms / 2, 2e-4)
    both.save(tmp_path / "both.pkl")
    assert dmp.load_script(tmp_path / "both.pkl")["num_sensors"] == 2
    again = dmp.Primitive.load(tmp_path / "both.pkl")
    np.testing.assert_allclose(again.rollout(start=both.start, sensor_values=[1, 0.5])[1], middle, atol=1e-9)


def test_what_it_generates_is_drawn_over_what_was_shown():
    figure = dmp.fit(bow(), "joint").plot(bow(), goal=HOME, duration=2, limits=proto.JointLimits(q_min=HOME - 1, q_max=HOME + 1))
    assert len(figure.axes) == 7 and all(len(axes.lines) == 4 for axes in figure.axes)
    drawn = figure.axes[0].lines[1].get_xydata()
    np.testing.assert_allclose(drawn[-1], [2, HOME[0]], atol=1e-6)
    start, down = [0.4, 0.1, 0.4], turn(2).orientations[0]
    changed = dmp.fit(turn(2), "pose").plot(start=start, goal_orientation=down)
    np.testing.assert_allclose([axes.lines[0].get_ydata()[0] for axes in changed.axes[:3]], start)
    figure = dmp.fit(turn(2), "pose").plot(turn(2))
    assert len(figure.axes) == 6
    for axes in figure.axes:
        shown, made = (line.get_xydata() for line in axes.lines)
        np.testing.assert_allclose(np.interp(shown[:, 0], *made.T), shown[:, 1], atol=0.02)


# --- on the arm ------------------------------------------------------------------------------------------------------


def lead(arm, fa, way, seconds):
    """Have the tool led along a way (n, 3) relative to where it is, and return the demonstration."""
    times = 1.5 + np.linspace(0, seconds, len(way))
    with hand_with_the_motion(arm, fa, np.vstack([np.zeros(3), way]), np.r_[1.4, times]):
        return fa.demonstrate(seconds + 3)


@contextlib.contextmanager
def hand_with_the_motion(arm, fa, way, times):
    """Have the tool led along a way relative to where it is, from the begin of the next motion on."""
    arm.end_motion(fa)
    with arm.standing_still(between_motions=True):
        here = arm.simulation.truth().O_T_TCP[:3, 3]
        arm.simulation.hand(here + way, times, stiffness=2000, damping=80)
        yield


def test_what_a_hand_shows_the_arm_does(fa, ideal_arm, tmp_path):
    s = np.linspace(0, 1, 60)
    p = s**3 * (10 - 15 * s + 6 * s**2)
    way = np.outer(p, [0.05, 0.15, -0.08]) + np.outer(4 * p * (1 - p), [0, 0, 0.06])
    shown = lead(ideal_arm, fa, way, 4)
    assert 7 <= shown.duration < 7.2
    motion = shown.trimmed().smooth()
    assert np.linalg.norm(motion.positions[-1] - motion.positions[0] - way[-1]) < 0.03

    fa.goto_joints(motion.joints[0], 2)
    primitive = dmp.fit(motion, "joint")
    assert primitive.beyond(fa) == []
    before = ideal_arm.truth()["cycle"][-1]
    fa.run(primitive.part(start=fa.get_joints()), InternalImpedance())
    rows = ideal_arm.truth(since=before)
    expected = primitive.rollout()[1]
    begin = int(np.argmax(np.abs(rows["q"] - rows["q"][0]).max(axis=1) > 1e-4))
    path = rows["O_T_TCP"].reshape(-1, 4, 4)[begin:, 3, :3]
    away = [np.linalg.norm(path - position, axis=1).min() for position in motion.positions[:: len(motion) // 50]]
    assert max(away) < 0.005
    np.testing.assert_allclose(rows["q"][-1], expected[-1], atol=0.02)  # it comes to rest beyond its end

    # The same way for the tool, elsewhere: as a position primitive to another goal.
    fa.goto_joints(HOME, 2)
    start = fa.get_pose(include_tool_offset=False).translation
    goal = start + [0.1, -0.1, -0.05]
    primitive = dmp.fit(motion, "position")
    fa.run(primitive.part(2.5, start=start, goal=goal), InternalImpedance())
    np.testing.assert_allclose(ideal_arm.truth()["O_T_TCP"][-1].reshape(4, 4)[3, :3], goal, atol=0.002)


def test_a_pose_is_reproduced_within_two_millimetres_and_a_degree(fa, ideal_arm):
    fa.goto_joints(HOME, 2)
    pose = fa.get_pose(include_tool_offset=False)
    demonstration = turn(np.radians(130))
    demonstration.positions += pose.translation - demonstration.positions[0]
    primitive = dmp.fit(demonstration, "pose")
    assert primitive.beyond(fa) == []
    before = ideal_arm.truth()["cycle"][-1]
    fa.run(primitive.part(), InternalImpedance())
    rows = ideal_arm.truth(since=before)
    matrices = rows["O_T_TCP"].reshape(-1, 4, 4).transpose(0, 2, 1)
    moving = np.flatnonzero(np.linalg.norm(np.diff(matrices[:, :3, 3], axis=0), axis=1) > 1e-7)
    count = round(1000 * demonstration.duration)
    even = demonstration.resampled(count + 1)
    best = np.inf, np.inf
    for begin in range(max(0, moving[0] - 60), moving[0] + 60, 5):
        part = matrices[begin : begin + count + 1]
        q = np.array([RigidTransform(matrix[:3, :3], np.zeros(3)).quaternion for matrix in part[::50]])
        distance = np.sqrt(np.mean(np.sum((part[:, :3, 3] - even.positions[: len(part)]) ** 2, axis=1)))
        angle = np.degrees(np.sqrt(np.mean(angle_between(q, even.orientations[: len(part) : 50]) ** 2)))
        best = min(best, (distance, angle))
    assert best[0] < 0.002 and best[1] < 1


def test_what_the_arm_cannot_do_is_said_before(fa):
    fa.goto_joints(HOME, 2)
    primitive = dmp.fit(bow(), "joint")
    assert any("joint 7 reaches" in line for line in primitive.beyond(fa, duration=0.1))
    assert any("joint 4 goes from" in line for line in primitive.beyond(fa, goal=HOME + [0, 0, 0, 3, 0, 0, 0]))
    away = dmp.fit(turn(0.1), "position")
    assert "not reachable" in away.beyond(fa, goal=[1.2, 0, 0.5])[0]


def test_strokes_that_leave_the_range_between_two_looks_are_refused(fa):
    times = np.linspace(0, 8, 801)
    joints = np.tile(HOME, (801, 1))
    joints[:, 3] -= 0.45 * (1 - np.cos(2 * np.pi * times))
    primitive = dmp.fit(Demonstration(times, joints), basis=80)
    fa.goto_joints(HOME, 1)
    with pytest.raises(FrankaArmArgumentError, match=r"joint 4 would be at -3\.\d+ rad at its path"):
        fa.check(primitive.part(), InternalImpedance())


def test_it_is_done_as_often_as_asked_and_looked_at_before_anything_moves(fa, ideal_arm):
    primitive = dmp.fit(bow(), "joint")
    goal = primitive.start + [0, 0.1, 0, 0, 0, 0, 0.2]
    before = ideal_arm.cycle()
    results = fa.imitate(primitive, loops=2, duration=2, goal=goal)
    assert [result.ending for result in results] == [proto.TERMINATED] * 2
    away = np.abs(ideal_arm.truth(since=before)["q"] - goal).max(axis=1) < 0.005
    assert np.count_nonzero(np.diff(away.astype(int)) == 1) == 2 and away[-1]

    ideal_arm.end_motion(fa)
    resting = fa.get_joints()
    tool = dmp.fit(turn(0.3), "pose")
    for wrong, changed, text in (
        (primitive, dict(goal=HOME + [0, 0, 0, 3, 0, 0, 0]), "joint 4|JointDmp"),
        (primitive, dict(start=HOME + [0, 3, 0, 0, 0, 0, 0]), "joint 2|q\\[1\\]"),
        (tool, dict(start=[1.5, 0, 0.5]), "not reachable"),
        (tool, dict(goal=[0.3, 0, 1.6]), "QuaternionPoseDmp|reach"),
        (primitive, dict(sensor_values=[1, 2]), "sensor_values has the shape"),
        (primitive, dict(loops=-1), "loops is -1"),
    ):
        with pytest.raises(FrankaArmArgumentError, match=text):
            fa.imitate(wrong, **changed)
    assert fa.imitate(tool, loops=0) == []
    np.testing.assert_allclose(fa.get_joints(), resting, atol=1e-5)


def test_a_lab_s_dictionary_does_on_the_arm_what_its_law_says(fa, ideal_arm, tmp_path):
    info = old_dictionary(3)
    (tmp_path / "old.pkl").write_bytes(pickle.dumps(info))
    start = fa.get_pose(include_tool_offset=False).translation
    expected = start + way_of(info, [1, 1], 2)
    fa.execute_pose_dmp(dmp.load_script(tmp_path / "old.pkl"), 2, position_only=True, use_impedance=False)
    by_method = ideal_arm.truth()["O_T_TCP"][-1].reshape(4, 4)[3, :3]
    fa.goto_joints(HOME, 1)
    fa.imitate(dmp.Primitive.load(tmp_path / "old.pkl"))
    by_primitive = ideal_arm.truth()["O_T_TCP"][-1].reshape(4, 4)[3, :3]
    np.testing.assert_allclose(by_primitive, by_method, atol=0.002)
    assert np.linalg.norm(by_primitive - expected) < 0.01  # it comes to rest beyond its end
    assert np.linalg.norm(expected - start) > 0.04
    with pytest.raises(FrankaArmArgumentError, match="3 with position_only or orientation_only"):
        fa.execute_pose_dmp(info, 2)
    fa.goto_joints(HOME, 1)
    fa.close()
    goal = start + [0, 0.05, 0.05]
    asked = ["--goal", *map(str, goal), "--plot", str(tmp_path / "next.png"), "--server", ideal_arm.server]
    assert cli.main(["imitate", str(tmp_path / "old.pkl"), *asked]) == 0 and (tmp_path / "next.png").exists()
    end = ideal_arm.truth()["O_T_TCP"][-1].reshape(4, 4)[3, :3]
    np.testing.assert_allclose(end, goal, atol=0.01)  # it comes to rest beyond its end


@pytest.mark.parametrize(("kind", "method"), [("joint", "local"), ("position", "ridge"), ("pose", "local")])
def test_what_the_command_line_is_asked_for_is_done(ideal_arm, tmp_path, kind, method):
    arm, learned = ["--server", ideal_arm.server], tmp_path / "learned.npz"
    with ideal_arm.client() as fa:
        fa.goto_joints(HOME, 1)
        here = fa.get_pose(include_tool_offset=False)
    if kind == "joint":
        shown = bow()
        other = Demonstration(shown.times, HOME + 1.5 * (shown.joints - HOME))
    else:
        shown, other = turn(0.5), turn(0.5)
        shown.positions += here.translation - shown.positions[0]
        other.positions += here.translation - other.positions[0] + np.outer(np.linspace(0, 1, len(shown)), [0, 0, 0.05])
    files = [tmp_path / "one.npz", tmp_path / "other.npz"]
    for file, demonstration in zip(files, (shown, other), strict=True):
        demonstration.save(file)
    asked = ["--kind", kind, "--method", method, "--basis", "30", "--smooth", "0", "--sensors", "1", "0", "0", "1"]
    asked += ["--plot", str(tmp_path / "learned.png")]
    assert cli.main(["learn", *map(str, files), "-o", str(learned), *asked]) == 0
    primitive = dmp.Primitive.load(learned)
    moved = [Demonstration.load(file).trimmed() for file in files]
    expected = dmp.fit(moved, kind, 30, method, sensor_values=np.eye(2))
    np.testing.assert_array_equal(primitive.weights, expected.weights)
    assert primitive.kind == kind and primitive.weights.shape[1:] == (2, 30)
    assert (tmp_path / "learned.png").stat().st_size > 10_000
    goal = primitive.rollout(sensor_values=[0.25, 0.75])[1][-1]
    before = ideal_arm.cycle()
    asked = ["--loops", "2", "--sensors", "0.25", "0.75", "--duration", "2"]
    assert cli.main(["imitate", str(learned), *asked, *arm]) == 0
    rows = ideal_arm.truth(since=before)
    place = rows["q"] if kind == "joint" else rows["O_T_TCP"].reshape(-1, 4, 4)[:, 3, :3]
    away = np.linalg.norm(place - goal, axis=1) < 0.01
    assert np.count_nonzero(np.diff(away.astype(int)) == 1) == 2 and away[-1]


def test_values_of_sensors_are_as_many_for_each_file(tmp_path, capsys):
    bow().save(tmp_path / "one.npz")
    files = [str(tmp_path / "one.npz")] * 2
    assert cli.main(["learn", *files, "-o", str(tmp_path / "learned.npz"), "--sensors", "1", "0", "1"]) == 1
    assert "--sensors has 3 values: expected as many for each of 2 files" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "text"), [("no/pour.npz", "there is no folder"), ("pour.pkl", "ends in .npz"), ("pour", "ends in .npz")])
def test_what_could_not_be_written_is_not_shown(tmp_path, capsys, name, text):
    asked = ["demonstrate", str(tmp_path / name), "--server", f"{free_address()}:5757"]  # where nobody is
    assert cli.main(asked) == 1
    assert text in capsys.readouterr().err


def test_what_cannot_be_written_is_told_by_name(tmp_path, capsys):
    bow().save(tmp_path / "one.npz")
    missing = tmp_path / "no" / "learned.npz"
    for command in (["segment", str(tmp_path / "one.npz"), "-o"], ["learn", str(tmp_path / "one.npz"), "-o"]):
        assert cli.main([*command, str(missing)]) == 1
        assert "there is no folder" in capsys.readouterr().err
    learn = ["learn", str(tmp_path / "one.npz"), "-o", str(tmp_path / "two.npz"), "--plot", str(tmp_path / "two.xyz")]
    assert cli.main(learn) == 1
    assert "two.xyz: expected a name that ends in .png, .pdf or .svg" in capsys.readouterr().err
    with pytest.raises(FrankaArmArgumentError, match="learned.npz cannot be written: No such file"):
        bow().save(missing)
    with pytest.raises(FrankaArmArgumentError, match="is a folder"):
        require_writable(tmp_path)


def test_an_arm_that_yields_along_axes_of_its_tool(ideal_arm, tmp_path):
    shown = tmp_path / "shown.npz"
    with ideal_arm.client() as fa:
        # The tool's x is between those of the base.
        fa.goto_joints(HOME + [0, 0, 0, 0, 0, 0, np.pi / 4], 1, ignore_virtual_walls=True)
        axes = fa.get_pose(include_tool_offset=False).rotation
        assert abs(axes[0, 0]) < 0.9
        with hand_with_the_motion(ideal_arm, fa, [[0, 0, 0], 0.08 * axes[:, 0] + 0.08 * axes[:, 1]], [1.5, 3.5]):
            fa.close()
            asked = ["--seconds", "5", "--yield", "x", "--frame", "tool", "--server", ideal_arm.server]
            assert cli.main(["demonstrate", str(shown), *asked]) == 0
    along = (Demonstration.load(shown).positions - Demonstration.load(shown).positions[0]) @ axes
    assert np.ptp(along[:, 0]) > 0.06 and np.ptp(along[:, 0]) > 1.3 * np.ptp(along[:, 1])


def test_a_demonstration_that_is_over_before_it_has_begun_is_not_waited_for():
    class Over:
        id = 7

        def result(self, timeout):
            return proto.SkillResult(ending=proto.REFUSED)

    def others():
        until = time.monotonic() + 30
        while time.monotonic() < until:
            time.sleep(0.001)
            yield proto.ArmState(skill_id=0)
        pytest.fail("it is waited for")

    assert guidance.shown(others(), Over(), 5, lambda: None) == []


def test_ctrl_c_ends_a_demonstration_and_keeps_it(ideal_arm, tmp_path):
    shown = tmp_path / "shown.npz"
    command = [sys.executable, "-m", "frankapy.cli", "demonstrate", str(shown), "--server", ideal_arm.server]
    with ideal_arm.client() as reader, subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as lead:
        reader.wait_for(lambda state: state.skill_description == "Demonstration" and state.skill_time > 1, 300)
        lead.send_signal(signal.SIGINT)
        errors = lead.communicate(timeout=300)[1]
        assert lead.returncode == 0 and "Traceback" not in errors, errors
        reader.wait_for(lambda state: state.skill_id == 0, 60)
    assert 0.9 < Demonstration.load(shown).duration < 600


def test_from_the_command_line(default_arm, tmp_path, capsys, caplog):
    shown, part, learned, picture = (tmp_path / name for name in ("shown.npz", "part-1.npz", "learned.npz", "learned.png"))
    arm = ["--server", default_arm.server]
    with default_arm.client() as fa:
        fa.goto_joints(HOME, 2)
        with hand_with_the_motion(default_arm, fa, [[0, 0, 0], [0, 0.1, 0], [0, 0.1, 0.05]], [1.5, 3, 4.5]):
            fa.close()
            assert cli.main(["demonstrate", str(shown), "--seconds", "6", "--yield", "y", "z", *arm]) == 0
    demonstration = Demonstration.load(shown)
    moved = np.ptp(demonstration.positions, axis=0)
    assert moved[0] < 0.02 and moved[1] > 0.08 and moved[2] > 0.03
    assert demonstration.duration < 7 and not caplog.text  # an arm that is led is neither too slow nor in the wrong place
    assert cli.main(["segment", str(shown), "--rest", "2", "--output", str(tmp_path / "part.npz")]) == 0
    assert Demonstration.load(part).duration < Demonstration.load(shown).duration - 0.5 and not (tmp_path / "part-2.npz").exists()
    assert cli.main(["learn", str(part), "--smooth", "0", "--output", str(learned), "--plot", str(picture)]) == 0
    assert picture.stat().st_size > 10_000
    primitive = dmp.Primitive.load(learned)
    with FrankaArm(server=default_arm.server) as again:
        again.goto_joints(HOME, 2)
    asked = ["--plot", str(tmp_path / "next.png"), "--over", str(part), "--check"]
    too_fast = ["--duration", "0.3", "--goal", *map(str, primitive.goal + [0, 0, 0, 0, 0, 0, 1])]
    assert cli.main(["imitate", str(learned), *too_fast, *asked, *arm]) == 0
    assert (tmp_path / "next.png").stat().st_size > 10_000 and "rad/s: its limit is" in capsys.readouterr().err
    with FrankaArm(server=default_arm.server) as again:
        np.testing.assert_allclose(again.get_joints(), HOME, atol=0.005)  # it was only asked
    assert cli.main(["imitate", str(learned), "--duration", "3", *arm]) == 0
    with FrankaArm(server=default_arm.server) as again:
        np.testing.assert_allclose(again.get_joints(), primitive.goal, atol=0.01)
    goal = primitive.goal + [0.05, 0, 0, 0, 0, 0, 0.1]
    start = primitive.start + 0.05
    assert cli.main(["imitate", str(learned), "--goal", *map(str, goal), "--start", *map(str, start), *arm]) == 0
    with FrankaArm(server=default_arm.server) as again:
        np.testing.assert_allclose(again.get_joints(), goal, atol=0.01)
    assert cli.main(["learn", str(tmp_path / "no.npz"), "--output", str(learned)]) == 1
    assert cli.main(["imitate", str(learned), "--goal", "1", "2", *arm]) == 1
    assert "goal has 2 elements: expected 7" in capsys.readouterr().err
