"""The safety campaign's draws are valid, and its judge finds what is there to be found."""

import sys

import numpy as np
import pytest
from conftest import HOME, REPOSITORY

from frankapy import FrankaConstants, RigidTransform, kinematics, parts, proto
from frankapy.walls import Box, Capsule, Cylinder, Mesh, Plane, Sphere

sys.path[:0] = [str(REPOSITORY / "tests" / "safety"), str(REPOSITORY / "tests" / "interop")]
import judge  # noqa: E402
import scenario  # noqa: E402
from draw import Draw  # noqa: E402

LIMITS = judge.wire_limits.LIMITS["fr3"]
POSE = RigidTransform(FrankaConstants.HOME_POSE.rotation, FrankaConstants.HOME_POSE.translation)


def draws(seed: int) -> Draw:
    return Draw([seed], LIMITS.q, HOME, POSE)


def truth(q: np.ndarray) -> np.ndarray:
    rows = np.zeros(len(q), dtype=[("cycle", "<u8"), ("moving", "<u8"), ("q", "<f8", 7), ("dq", "<f8", 7)])
    rows["cycle"], rows["moving"], rows["q"], rows["dq"] = np.arange(len(q)) + 1, 1, q, np.gradient(q, 0.001, axis=0)
    return rows


@pytest.mark.parametrize("kind", [descriptor.name for _, descriptor in parts.kinds()])
def test_every_kind_is_drawn_and_each_time_another(kind):
    descriptor = next(d for _, d in parts.kinds() if d.name == kind)
    drawn = {draws(seed).part(descriptor).SerializeToString() for seed in range(30)}
    assert len(drawn) > 10 or all(field.cpp_type == field.CPPTYPE_STRING for field in descriptor.fields)


def test_skills_fit_and_so_do_those_that_are_to_be_of_torque():
    for seed in range(200):
        skill = draws(seed).skill(torque=seed % 2 == 0)
        parts.check_fit(skill["trajectory"], skill["controller"], skill["robot_controller"])
        assert seed % 2 or skill["robot_controller"].startswith("torque")


def test_a_seed_is_a_run_and_what_is_left_of_it_stays_the_same():
    whole = scenario.draw(17)
    assert whole == scenario.draw(17) and whole != scenario.draw(19)
    assert {event.kind for seed in range(30) for event in scenario.draw(seed).events} == set(scenario.KINDS)
    assert whole.only([3, 8]).events == (whole.events[3], whole.events[8])
    assert draws(5).skill() == draws(5).skill()


def test_frames_are_those_of_the_arm():
    q = np.random.default_rng(1).uniform(*LIMITS.q, (5, 7))
    at = judge.frames(q)
    for k in range(5):
        np.testing.assert_allclose(at[:, k], kinematics.link_frames(q[k])[: judge.FLANGE + 1], atol=1e-12)


def test_gaps_are_those_of_many_points_of_the_capsule():
    random = np.random.default_rng(2)
    capsules = judge.capsules()
    assert len(capsules) == 11
    for seed in range(60):
        wall = draws(seed).wall()
        at = judge.frames(random.uniform(*LIMITS.q, (1, 7)))
        for capsule in capsules:
            frame = at[capsule.frame, 0]
            points = capsule.a + np.linspace(0, 1, 400)[:, None] * (capsule.b - capsule.a)
            expected = judge.distance(wall, points @ frame[:3, :3].T + frame[:3, 3]).min() - capsule.radius
            found = judge.gap(wall, capsule, at[capsule.frame])[0]
            assert found == pytest.approx(expected, abs=2e-3) or (judge.NEAR < found < expected)


@pytest.mark.parametrize(
    ("wall", "expected"),
    [
        (Plane([0, -1, 0], [0, 0.4, 0]), 0.4),
        (Box([0.2, 0.2, 0.2], [0, 0.6, 0]), 0.5),
        (Sphere(0.1, [0, 0.6, 0]), 0.5),
        (Cylinder(0.1, 0.5, [0, 0.6, 0]), 0.5),
        (Capsule(0.1, 0.3, [0, 0.6, 0.1]), 0.5),
        (Box([2, 2, 0.1], [0, 0, 0]), -0.05),
        (Mesh([[0, 0.5, 0], [1, 1, 0], [-1, 1, 0], [0, 1, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]), 0.5),
        (Mesh([[0, -1, -1], [0, 2, -1], [2, -1, -1], [0, -1, 2]], [[0, 1, 2], [0, 2, 3], [1, 3, 2], [0, 3, 1]]), 0),
    ],
)
def test_distances_to_bodies(wall, expected):
    assert judge.distance(wall, np.zeros((1, 3)))[0] == pytest.approx(expected)


@pytest.fixture
def glass() -> tuple[proto.Wall, np.ndarray]:
    """A wall, and a way of the joints on which joint 2 lets the hand down from home, at 0.49 m, into it and back."""
    wall = Box([2, 2, 0.3], [1.15, 0, 0.3])
    wall.name = "glass"
    return wall, HOME + np.sin(np.linspace(0, np.pi, 500))[:, None] * [0, 0.3, 0, 0, 0, 0, 0]


def test_an_arm_that_goes_into_a_wall_is_found(glass):
    wall, way = glass
    deepest = max(-judge.clearance(wall, q) for q in way[::10])
    assert deepest > 0.03
    rows = truth(way)
    (found,) = judge.judge_walls(rows, [judge.Standing(wall, 1)])
    assert found.kind == "wall" and "hand" in found.text and "glass" in found.text
    # Not before it is there, not after it has gone, and not on the way out.
    assert not judge.judge_walls(rows, [judge.Standing(wall, 1, 20), judge.Standing(wall, 481)])
    assert not judge.judge_walls(truth(way[250:]), [judge.Standing(wall, 1)])


def test_where_the_robot_stops_an_arm_by_itself_is_not_judged_but_where_it_goes_from_there(glass):
    wall, way = glass
    standing = [judge.Standing(wall, 1)]
    rows = truth(way)
    rows["moving"][10:] = 0  # on the way in
    assert not judge.judge_walls(rows, standing)
    rows["moving"][60:] = 1  # and deeper
    assert judge.judge_walls(rows, standing)
    rows["moving"] = 1
    rows["moving"][10:300] = 0  # on the way out
    assert not judge.judge_walls(rows, standing)
    rows["dq"] = 0  # it had ended
    assert judge.judge_walls(rows, standing)


def test_what_is_held_goes_into_a_wall_as_the_arm_does_while_it_is_held():
    floor = Box([2, 2, 0.3], [0.5, 0, 0.1])
    stick = Capsule(0.01, 0.2, [0, 0, 0.2])  # 0.3 m below the flange, at home 0.6 m above the base
    floor.name, stick.name, stick.held = "floor", "stick", True
    rows = truth(HOME + np.sin(np.linspace(0, np.pi, 500))[:, None] * [0, 0.2, 0, 0, 0, 0, 0])
    held = judge.held_capsule(stick)
    deepest = max(-judge.clearance(floor, q, [held]) for q in rows["q"][::10])
    assert deepest > 0.01 and judge.clearance(floor, rows["q"][0], [held]) > 0.01
    assert not judge.judge_walls(rows, [judge.Standing(floor, 1)])
    (found,) = judge.judge_walls(rows, [judge.Standing(floor, 1), judge.Standing(stick, 1)])
    assert "what it holds" in found.text and "floor" in found.text
    assert not judge.judge_walls(rows, [judge.Standing(floor, 1), judge.Standing(stick, 1, 20), judge.Standing(stick, 481)])


def test_a_joint_outside_its_range_is_found():
    q = np.tile(HOME, (10, 1))
    assert not judge.judge_joints(truth(q), LIMITS)
    q[4, 3] = LIMITS.q[1, 3] + 1e-4
    (found,) = judge.judge_joints(truth(q), LIMITS)
    assert found.text == "joint 4 is 0.0001 rad outside its range in cycle 5"


def test_recordings_that_are_not_there_are_found(tmp_path):
    assert [found.kind for found in judge.judge_recordings(tmp_path, [1], 1)] == ["recording"]


def test_parts_that_cannot_be_drawn_are_named():
    draw = draws(1)
    draw._message = lambda descriptor: proto.MinJerkJoint(q=[0])
    with pytest.raises(ValueError, match="MinJerkJoint"):
        draw.part(proto.MinJerkJoint.DESCRIPTOR)


def test_a_step_between_commands_is_found_where_the_robot_took_the_one_before():
    limits, version, count = judge.wire_limits, 5, 5
    command, state = (np.zeros(count, limits.layout(kind, version)) for kind in ("RobotCommand", "RobotState"))
    command["message_id"] = state["message_id"] = np.arange(count) + 1
    state["robot_mode"], state["motion_generator_mode"] = limits.MOVE, limits.JOINT_POSITION
    state["q_d"] = command["q_c"] = HOME
    command["q_c"][2, 0] += 1e-5  # and back in the next

    def found(rates):
        state["control_command_success_rate"] = rates
        return limits.violations(limits.LIMITS["fer"], version, [each.tobytes() for each in command], [each.tobytes() for each in state])[0]

    assert any("jerk of joint 1" in text for text in found([0, 1, 1, 1, 1]))
    command["q_c"][2, 0] -= 7e-6  # taken it would be no more than the limit, and going back from it is
    assert any(text.startswith("4:") for text in found([0, 1, 1, 1, 1]))
    assert not found([0, 1, 1, 0.75, 0.8])


def test_cycles_that_are_missing_in_a_recording_are_found():
    running, idle = np.full(8, proto.RUNNING), np.full(8, proto.READY)
    assert not judge._lacks(np.arange(8), running).any()
    assert judge._lacks(np.array([0, 1, 2, 4, 5, 6, 7, 8]), running).tolist() == [False, False, True] + [False] * 4
    assert not judge._lacks(np.arange(3, 11) * 10, idle).any()
    assert judge._lacks(np.array([10, 20, 40, 50, 60, 70, 80, 90]), idle).sum() == 1


def test_an_arm_that_is_near_itself_is_known():
    assert 0.05 < judge.self_distance(HOME) < 0.5
    assert judge.self_distance(np.array([0, -1.7, 0, -3.0, 0, 0.5, 0.8])) < 0
