"""Parts: what is told of them, how they are made, what ends a skill, how fast it is, and what happens under a hand."""

import ast
import contextlib
import inspect
import subprocess
import sys

import numpy as np
import pytest
from conftest import REPOSITORY
from part_combinations import GOAL, HOME

from frankapy import FrankaArmArgumentError, FrankaArmException, RigidTransform, parts, proto
from frankapy.parts import (
    AllOf,
    AnyOf,
    CartesianImpedance,
    Contact,
    FinalJoint,
    FinalPose,
    ForceAbove,
    Impulse,
    InternalImpedance,
    JointImpedance,
    MinJerkJoint,
    MinJerkPose,
    Moved,
    Never,
    OutsideBox,
    PassThrough,
    RelativeMinJerkJoint,
    RelativeMinJerkPose,
    StayJoint,
    StayPose,
    Time,
    TimeOptimalJoint,
    TorqueAbove,
    VelocityBelow,
)

STRETCHED = np.array([1.2, 1.0, 0, -0.6, 0, 2.4, 0.8])  # 0.9 m from the base


def test_kinds_are_told_with_fields_and_what_fits(fa):
    kinds = {kind.name: kind for kind in fa.kinds()}
    assert set(kinds) == {descriptor.name for _, descriptor in parts.kinds()}
    assert kinds["MinJerkPose"].fields["duration"] == "s, 0.001 to 3600, default 3.0"
    assert kinds["MinJerkPose"].fits["InternalImpedance"] == ["cartesian_pose", "cartesian_velocity"]
    assert "CartesianImpedance" not in kinds["MinJerkJoint"].fits
    assert set(kinds["PassThrough"].fits) >= {"Impulse", "MinJerkJoint"}
    assert "MinJerkPose" not in kinds["FinalJoint"].fits and "MinJerkJoint" in kinds["FinalJoint"].fits
    assert {kind.role for kind in fa.kinds("termination")} == {"termination"}
    with pytest.raises(FrankaArmArgumentError, match="role is 'sensor'"):
        fa.kinds("sensor")


def test_the_reference_in_docs_is_what_the_messages_say(tmp_path):
    subprocess.run([sys.executable, REPOSITORY / "scripts/parts_reference.py", tmp_path / "parts.md"], check=True)
    assert (REPOSITORY / "docs/parts.md").read_text() == (tmp_path / "parts.md").read_text(), "run scripts/parts_reference.py"


def test_the_stub_is_that_of_the_source(tmp_path):
    subprocess.run([sys.executable, REPOSITORY / "scripts/parts_stub.py", tmp_path / "parts.pyi"], check=True)
    written = REPOSITORY / "python/frankapy/parts.pyi"
    assert written.read_text() == (tmp_path / "parts.pyi").read_text(), "run scripts/parts_stub.py"
    functions = [node for node in ast.parse(written.read_text()).body if isinstance(node, ast.FunctionDef)]
    assert {function.name for function in functions} == {descriptor.name for _, descriptor in parts.kinds()}
    for function in functions:
        allowed = {*inspect.signature(getattr(parts, function.name)).parameters, "pose"}
        assert {argument.arg for argument in function.args.args} <= allowed, function.name


# --- what ends a skill -----------------------------------------------------------------------------------------------


def ending(fa, until, trajectory=None):
    trajectory = trajectory or RelativeMinJerkPose([0, 0, -0.1], frame="base", duration=1)
    return fa.run(trajectory, CartesianImpedance(), until)


@pytest.mark.parametrize(
    ("until", "kind", "earliest", "latest"),
    [
        (Time(0.4), "Time", 0.4, 0.45),
        (Moved(0.05), "Moved", 0.3, 0.7),
        (VelocityBelow(0.02, 0.1, 0.5), "VelocityBelow", 1.0, 1.6),
        (AnyOf(Time(3), Moved(0.05)), "Moved", 0.3, 0.7),
        (AllOf(Time(0.2), Moved(0.05), Time(0.9)), "AllOf", 0.9, 0.95),
        ([Never(), Time(0.3)], "Time", 0.3, 0.35),
        (AllOf(AnyOf(Time(0.1), Time(9)), Time(0.6)), "AllOf", 0.6, 0.65),
    ],
)  # fmt: skip
def test_the_result_says_what_ended_it(ideal_arm, until, kind, earliest, latest):
    with ideal_arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 1))
        result = ending(fa, until)
        assert (result.ending, result.termination) == (proto.TERMINATED, kind)
        assert earliest <= result.time <= latest


def test_the_result_says_which_of_a_kind_ended_it(ideal_arm):
    with ideal_arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 1))
        assert ending(fa, AnyOf(Time(3), Time(0.4), Moved(1))).termination_index == 1
        assert ending(fa, [Moved(1), Time(3), Time(0.4)]).termination_index == 2


def test_a_box_that_is_left_ends_the_skill(ideal_arm):
    with ideal_arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 1))
        height = fa.get_pose(include_tool_offset=False).translation[2]
        result = ending(fa, OutsideBox([-1, -1, height - 0.05], [1, 1, 1]))
        assert result.termination == "OutsideBox"
        reached = fa.get_pose(include_tool_offset=False).translation[2]
        assert height - 0.08 < reached < height - 0.045


def test_force_ends_the_skill_at_the_table(start):
    arm = start(scene="table_with_block")
    with arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 1))
        above = fa.get_pose()
        above.translation = above.translation + [0.1, -0.2, 0]
        above.translation[2] = 0.06
        fa.goto_pose(above, 3)
        near = fa.get_joints()
        down = RelativeMinJerkPose([0, 0, -0.15], frame="base", duration=20)  # gently
        for until, kind in [
            (ForceAbove(8, axis="z"), "ForceAbove"),
            (ForceAbove(8, relative=True), "ForceAbove"),
            (Contact(force_thresholds=[10] * 6), "Contact"),
        ]:
            fa.run(MinJerkJoint(near, 1))
            result = ending(fa, [until, Time(30)], down)
            assert result.termination == kind, result
            assert 1 < result.time < 20
            assert arm.simulation.truth().O_T_TCP[2, 3] < 0.03


def test_somebody_who_turns_the_hand_ends_the_skill(ideal_arm):
    with ideal_arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 1))
        ideal_arm.simulation.push([0, 0, 0, 0, 0, 2.0], duration=3600)
        try:
            for until, kind in [
                (AnyOf(TorqueAbove(1.5, axis="x"), Time(0.5)), "Time"),
                (AnyOf(TorqueAbove(1.5, axis="z"), Time(0.5)), "TorqueAbove"),
                (AnyOf(ForceAbove(5), Time(0.5)), "Time"),
            ]:
                assert ending(fa, until, StayPose(2)).termination == kind
        finally:
            ideal_arm.simulation.push([0] * 6, duration=0)


def test_an_arm_that_a_soft_law_lets_yield_is_not_torn_back_by_a_stiff_one(ideal_arm):
    def away(state):
        return np.abs(np.subtract(state.robot.q, state.robot.q_d)).max()

    for soft in (InternalImpedance(K_x=[74, 74, 74, 10, 10, 10]), InternalImpedance(K_theta=[50] * 7)):
        with ideal_arm.client() as fa:
            fa.run(MinJerkJoint(HOME, 1))
            fa.run(RelativeMinJerkJoint([0.05] * 7, 0.5), soft)
            ideal_arm.simulation.push([0, 0, 8, 0, 0, 0], duration=3600)
            try:
                fa.wait_for(lambda state: state.phase == proto.READY and away(state) > 0.06, 60)
                result = fa.run(RelativeMinJerkJoint([0.02] * 7, 0.5), InternalImpedance())
                assert result.ending == proto.TERMINATED, result
            finally:
                ideal_arm.simulation.push([0] * 6, duration=0)


def test_thresholds_of_frankapy_end_motions_at_a_contact(start):
    with start(scene="table_with_block").client() as fa:
        fa.goto_joints(HOME, 2)
        pose = fa.get_pose()
        pose.translation += [0.1, -0.2, -0.6]
        for arguments in (
            {"force_thresholds": [10] * 6},
            {"force_thresholds": np.full(6, 12.0), "torque_thresholds": []},
            {"force_thresholds": [40] * 6},  # beyond the reflex of a robot that was just switched on
        ):
            fa.goto_pose(pose, 8, ignore_virtual_walls=True, **arguments)
            assert fa.last_skill_result.termination == "Contact"
            assert fa.last_skill_result.time < 8
            fa.goto_joints(HOME, 2)
        # In free space the time ends it.
        fa.goto_joints(GOAL, 1, force_thresholds=[60] * 6, torque_thresholds=[60] * 7)
        assert fa.last_skill_result.termination == "Time"
        np.testing.assert_allclose(fa.get_joints(), GOAL, atol=0.005)
        for wrong in ([1, 2], [200] * 6, [np.nan] * 6, [-1] * 6):
            with pytest.raises(FrankaArmArgumentError, match="force_thresholds"):
                fa.goto_joints(HOME, 1, force_thresholds=wrong)


# --- led by hand -----------------------------------------------------------------------------------------------------


def test_an_arm_that_is_led_by_hand_stays_where_it_is_left(ideal_arm):
    def push() -> None:
        """Begin with the next motion: until then the world stands still."""
        ideal_arm.end_motion(fa)
        ideal_arm.simulation.pause(between_motions=True)
        ideal_arm.simulation.push([0, 6, 0, 0, 0, 0], duration=0.7)

    with ideal_arm.client() as fa, contextlib.ExitStack() as finally_:
        finally_.callback(ideal_arm.simulation.resume)
        for controller in (InternalImpedance(), JointImpedance()):
            fa.run(MinJerkJoint(HOME, 1))
            began = fa.get_pose().translation
            push()
            fa.run_guide_mode(3)
            assert fa.last_skill_result.ending == proto.TERMINATED
            assert fa.last_skill_result.time == pytest.approx(3, abs=0.01)
            left = fa.get_joints()
            assert np.linalg.norm(fa.get_pose().translation - began) > 0.02
            fa.run(StayJoint(0.5), controller)
            np.testing.assert_allclose(fa.get_joints(), left, atol=0.15)
        # A motion that takes over in the middle goes on from where the arm is.
        fa.run(MinJerkJoint(HOME, 1))
        push()
        fa.run_guide_mode(60, block=False)
        result = fa.run(MinJerkJoint(HOME, 2), JointImpedance(), preempt=True)
        assert result.ending == proto.TERMINATED
        np.testing.assert_allclose(fa.get_joints(), HOME, atol=5e-3)


@pytest.mark.parametrize("use_impedance", [False, True])
def test_selective_guidance_yields_where_the_stiffness_is_low(ideal_arm, use_impedance):
    with ideal_arm.client() as fa:
        for axis in (0, 1):
            fa.run(MinJerkJoint(HOME, 1))
            began = fa.get_pose().translation
            stiffness = [3000.0] * 3 + [250.0] * 3
            stiffness[axis] = 100
            ideal_arm.simulation.push([5, 5, 0, 0, 0, 0], duration=3600)
            try:
                fa.selective_guidance_mode(3, use_impedance=use_impedance, cartesian_impedances=stiffness)
                moved = np.abs(fa.get_pose().translation - began)
            finally:
                ideal_arm.simulation.push([0] * 6, duration=0)
            # Back, before another stiffness pulls all the harder.
            fa.selective_guidance_mode(3, use_impedance=use_impedance, cartesian_impedances=stiffness)
            assert moved[axis] > 0.02
            assert moved[1 - axis] < 0.01


# --- how fast -------------------------------------------------------------------------------------------------------------


def test_one_dial_slows_all_motions(fa):
    fa.speed = 0.25
    fa.goto_joints(GOAL, 1)
    assert 3.7 < fa.last_skill_result.time < 4.05
    np.testing.assert_allclose(fa.get_joints(), GOAL, atol=1e-3)
    fa.set_speed(0.5)
    assert fa.get_speed() == fa.speed == 0.5
    result = fa.run(MinJerkJoint(HOME, 1), JointImpedance())
    assert result.time == pytest.approx(2, abs=0.02)
    result = fa.run(RelativeMinJerkPose([0, 0, 0.05], frame="base", duration=1), CartesianImpedance(), speed=0.2)
    assert result.time == pytest.approx(5, abs=0.02)
    for wrong in (0, 2, -1, np.nan, "slow"):
        with pytest.raises(FrankaArmArgumentError, match="speed"):
            fa.speed = wrong
        with pytest.raises(FrankaArmArgumentError, match="speed"):
            fa.run(MinJerkJoint(HOME, 1), speed=wrong)
    assert fa.speed == 0.5


def test_a_slow_motion_that_takes_over_does_not_run_away(fa):
    for _ in range(3):
        fa.run(TimeOptimalJoint(HOME + 10 * (GOAL - HOME), 0.3), block=False)
        result = fa.run(MinJerkJoint(HOME, 0.5), speed=0.2, preempt=True)
        assert result.ending == proto.TERMINATED
        np.testing.assert_allclose(fa.get_joints(), HOME, atol=5e-3)


def test_fast_joints_do_not_move_the_tool_faster_than_the_robot_allows(start):
    arm = start(robot="fer", ideal=True, truth=True)
    with arm.client() as fa:
        fa.goto_joints(STRETCHED * [-1, 1, 1, 1, 1, 1, 1], ignore_virtual_walls=True)
        since = arm.cycle()
        result = fa.run(TimeOptimalJoint(STRETCHED, 1))
        assert result.ending == proto.TERMINATED
        assert result.stretch > 1.01
    position = arm.truth(since)["O_T_TCP"][:, 12:15]
    speed = np.linalg.norm(np.diff(position, axis=0), axis=1) * 1000
    assert 1.4 < speed.max() < 1.7  # m/s, of FER


# --- how parts are made ----------------------------------------------------------------------------------------------


def test_parts_are_made_by_position_and_by_name():
    goal = RigidTransform(translation=[0.4, 0.1, 0.3], from_frame="franka_tool", to_frame="world")
    by_pose, by_field = MinJerkPose(goal, 2), MinJerkPose(position=[0.4, 0.1, 0.3], quaternion=[1, 0, 0, 0], duration=2)
    assert by_pose == by_field == MinJerkPose(pose=goal, duration=2)
    for stiffness in (600, np.float32(600), np.array(600.0)):
        assert list(CartesianImpedance(stiffness, 50).translational_stiffness) == [600] * 3
    assert list(ForceAbove(10, axis="z").axis) == [0, 0, 1]
    assert ForceAbove(10, frame="stiffness").frame == proto.ForceAbove.STIFFNESS
    assert FinalJoint().threshold == proto.FinalJoint().threshold
    assert FinalPose(1e-3, 0.01).orientation_threshold == 0.01
    assert len(AnyOf(Time(1), AllOf(Time(2), Never())).of) == 2


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (lambda: MinJerkJoint(0.1), r"MinJerkJoint.q is 0.1|has the shape"),
        (lambda: MinJerkJoint(HOME[:6]), "MinJerkJoint.q has 6 elements: expected 7"),
        (lambda: MinJerkJoint(HOME, 2, 3), "MinJerkJoint has 2 fields"),
        (lambda: MinJerkJoint(HOME, speed=2), "MinJerkJoint has no field speed: expected q, duration"),
        (lambda: MinJerkJoint(HOME, q=HOME), "MinJerkJoint.q is given twice"),
        (lambda: MinJerkJoint(), "MinJerkJoint.q has 0 elements"),
        (lambda: ForceAbove(10, axis="up"), "ForceAbove.axis is 'up': expected x, y, z"),
        (lambda: ForceAbove(10, frame="world"), "ForceAbove.frame is 'world': expected base, stiffness"),
        (lambda: ForceAbove(-1), "ForceAbove.threshold is -1 N: expected 0 to 1000 N"),
        (lambda: ForceAbove(float("nan")), "ForceAbove.threshold is nan"),
        (lambda: AnyOf(3), "AnyOf got 3: expected a part"),
        (lambda: Time(RigidTransform()), "Time takes no pose here"),
        (lambda: parts.make("Warp"), "Warp is no kind of part"),
    ],
)
def test_bad_parts_are_refused_by_name(wrong, says):
    with pytest.raises(FrankaArmArgumentError, match=says):
        wrong()


def test_the_server_refuses_what_only_it_can_judge(ideal_arm):
    nested = Time(1)
    for _ in range(6):
        nested = AllOf(nested)
    with ideal_arm.client() as fa:
        for until, says in [
            (AllOf(), "of is empty"),
            (nested, "nested more than 4 deep"),
            (AllOf(*[Time(1)] * 40), "expected at most 32"),
            (proto.Contact(cartesian=False), "look at nothing"),
            (Moved(), "neither distance nor angle"),
            (AllOf(FinalJoint()), "AllOf cannot judge the Cartesian references"),
        ]:
            with pytest.raises(FrankaArmException, match=says):
                ending(fa, until)
        assert ending(fa, Time(0.1)).ending == proto.TERMINATED
