"""Skills of any parts: combinations that fit move the arm as the truth says; each other is refused with what fits."""

import ast
import contextlib
import inspect
import itertools
import random
import subprocess
import sys

import numpy as np
import pytest
from conftest import REPOSITORY

from frankapy import FrankaArmArgumentError, FrankaArmException, RigidTransform, parts, proto
from frankapy.parts import (
    Admittance,
    AllOf,
    AnyOf,
    CartesianImpedance,
    CartesianVelocity,
    Contact,
    CubicHermiteJoint,
    CubicHermitePose,
    FinalJoint,
    FinalPose,
    ForceAbove,
    ForceAxisImpedance,
    ForcePosition,
    FreeDrive,
    GoalPoseDmp,
    HybridForcePosition,
    Impulse,
    InternalImpedance,
    JointDmp,
    JointImpedance,
    JointSamples,
    JointVelocity,
    JointWaypoints,
    LinearForcePosition,
    LinearJoint,
    LinearPose,
    Lqr,
    MinJerkJoint,
    MinJerkPose,
    Moved,
    Never,
    OutsideBox,
    PassThrough,
    PassThroughJointTorque,
    PoseDmp,
    PoseSamples,
    PoseWaypoints,
    QuaternionPoseDmp,
    RelativeLinearPose,
    RelativeMinJerkJoint,
    RelativeMinJerkPose,
    SineJoint,
    SinePose,
    StayJoint,
    StayPose,
    StreamCartesianVelocity,
    StreamForcePosition,
    StreamJoint,
    StreamJointVelocity,
    StreamPose,
    Time,
    TimeOptimalJoint,
    TimeOptimalPose,
    TorqueAbove,
    VelocityBelow,
)

HOME = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
GOAL = HOME + [0.1, -0.1, 0.1, 0.1, -0.1, 0.1, 0.1]
STRETCHED = np.array([1.2, 1.0, 0, -0.6, 0, 2.4, 0.8])  # 0.9 m from the base
SHIFT = np.array([0.03, 0.05, -0.04])  # m
LEAST = 0.002  # rad and m that a motion may end beside its goal, of a spring that is held by friction

SPRING = (1, 200, 50)  # of a movement primitive that rises in 0.5 s
BASIS = ([1, 0.8], [50, 50])


def far(*ways: float) -> np.ndarray:
    """Return the weights of a movement primitive that ends so far from its start."""
    return np.column_stack([ways, np.zeros(len(ways))])


def fraction(samples: int) -> np.ndarray:
    s = np.linspace(0, 1, samples)[:, None]
    return s**3 * (10 - 15 * s + 6 * s**2)


def samples_to(goal: RigidTransform) -> proto.PoseSamples:
    position = goal.translation + (fraction(801) - 1) * SHIFT
    return PoseSamples(position, np.tile(goal.quaternion, (801, 1)))


JOINTS = {
    "MinJerkJoint": lambda: MinJerkJoint(GOAL, 0.8),
    "RelativeMinJerkJoint": lambda: RelativeMinJerkJoint(GOAL - HOME, 0.8),
    "LinearJoint": lambda: LinearJoint(GOAL, 0.8),
    "CubicHermiteJoint": lambda: CubicHermiteJoint(GOAL, 0.8),
    "SineJoint": lambda: SineJoint(GOAL, 0.8),
    "TimeOptimalJoint": lambda: TimeOptimalJoint(GOAL, 0.2),
    "JointVelocity": lambda: JointVelocity((GOAL - HOME) / 0.9, np.full(7, 0.1 / 0.09), 1.0),
    "JointDmp": lambda: JointDmp(*SPRING, *BASIS, far(*GOAL - HOME), duration=0.8),
    "JointWaypoints": lambda: JointWaypoints([HOME + 0.5 * (GOAL - HOME), GOAL], speed=0.2),
    "JointSamples": lambda: JointSamples(HOME + fraction(801) * (GOAL - HOME)),
    "StreamJoint": lambda: StreamJoint("nobody"),
    "StreamJointVelocity": lambda: StreamJointVelocity("nobody"),
    "StayJoint": lambda: StayJoint(0.3),
}
POSES = {
    "MinJerkPose": lambda goal: MinJerkPose(goal, 0.8),
    "RelativeMinJerkPose": lambda goal: RelativeMinJerkPose(SHIFT, frame="base", duration=0.8),
    "LinearPose": lambda goal: LinearPose(goal, 0.8),
    "RelativeLinearPose": lambda goal: RelativeLinearPose(SHIFT, frame="base", duration=0.8),
    "CubicHermitePose": lambda goal: CubicHermitePose(goal, 0.8),
    "SinePose": lambda goal: SinePose(goal, 0.8),
    "TimeOptimalPose": lambda goal: TimeOptimalPose(goal, 0.1),
    "CartesianVelocity": lambda goal: CartesianVelocity([*SHIFT / 0.7, 0, 0, 0], [0.25] * 3 + [1] * 3, 1.0),
    "PoseDmp": lambda goal: PoseDmp(*SPRING, *BASIS, far(*SHIFT, 0, 0, 0), duration=0.8),
    "GoalPoseDmp": lambda goal: GoalPoseDmp(1, 16, 4, *BASIS, far(*SHIFT), duration=1.6, position_only=True),
    "QuaternionPoseDmp": lambda goal: QuaternionPoseDmp(
        *SPRING, *BASIS, far(*SHIFT), None, 48, 12, *BASIS, far(0, 0, 0), goal.quaternion, 0.6, 0.8
    ),
    "LinearForcePosition": lambda goal: LinearForcePosition(goal, duration=0.8),
    "Impulse": lambda goal: Impulse([0, 0, 0.02], duration=0.3),
    "PoseWaypoints": lambda goal: PoseWaypoints([goal.translation - SHIFT / 2, goal.translation], [goal.quaternion] * 2),
    "PoseSamples": samples_to,
    "StreamPose": lambda goal: StreamPose("nobody"),
    "StreamForcePosition": lambda goal: StreamForcePosition("nobody"),
    "StreamCartesianVelocity": lambda goal: StreamCartesianVelocity("nobody"),
    "StayPose": lambda goal: StayPose(0.3),
}
# These have no end of their own.
STREAMS = {"StreamJoint", "StreamPose", "StreamForcePosition", "StreamJointVelocity", "StreamCartesianVelocity"}
STAY = {"StayJoint", "StayPose", "Impulse"} | STREAMS
CONTROLLERS = {
    "JointImpedance": lambda: JointImpedance(),
    "CartesianImpedance": lambda: CartesianImpedance(1500, 100),
    "CartesianImpedance of EE": lambda: CartesianImpedance([1500, 1200, 1000], 100, frame="end_effector"),
    "JointImpedance damped": lambda: JointImpedance(damping_ratio=1, inertia_scale=0.8, integral_rate=2),
    "Lqr": lambda: Lqr(),
    "Admittance": lambda: Admittance(stiffness=[1000] * 3 + [100] * 3),
    "ForcePosition": lambda: ForcePosition(position_kps_cart=[1500] * 3 + [100] * 3),
    "ForcePosition of joints": lambda: ForcePosition(use_cartesian_gains=False, position_kps_joint=[1500] * 4 + [250, 150, 100]),
    "HybridForcePosition": lambda: HybridForcePosition(),
    "FreeDrive": lambda: FreeDrive(),
    "PassThrough": lambda: PassThrough(),
    "ForceAxisImpedance": lambda: ForceAxisImpedance("z"),
    "PassThroughJointTorque": lambda: PassThroughJointTorque(),
    "InternalImpedance K_theta": lambda: InternalImpedance([3000] * 7),
    "InternalImpedance K_x": lambda: InternalImpedance(K_x=[2500] * 3 + [250] * 3),
}
ROBOT_CONTROLLERS = ["auto", *(name.lower() for name in proto.RobotController.keys() if name != "AUTO")]
LED = {"FreeDrive", "PassThrough", "ForceAxisImpedance", "PassThroughJointTorque"}  # these follow no reference


def fits(trajectory: str, controller: str, robot_controller: str) -> bool:
    found = parts.robot_controllers(trajectory, controller.split()[0])
    return robot_controller in found or (robot_controller == "auto" and bool(found))


COMBINATIONS = list(itertools.product([*JOINTS, *POSES], CONTROLLERS, ROBOT_CONTROLLERS))


def test_every_trajectory_that_the_server_knows_is_tried():
    assert {descriptor.name for _, descriptor in parts.kinds("trajectory")} == {*JOINTS, *POSES}
    assert {descriptor.name for _, descriptor in parts.kinds("controller")} == {name.split()[0] for name in CONTROLLERS}


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


def moves_as_told(arm, fa, trajectory, controller, robot_controller):
    """Run a combination and compare with what the arm really did."""
    what = f"{trajectory} with {controller} in {robot_controller}"
    fa.run(MinJerkJoint(HOME, 0.7), robot_controller="auto")
    began = fa.get_pose(include_tool_offset=False)
    goal = began.copy()
    goal.translation = began.translation + SHIFT
    if trajectory in JOINTS:
        part = JOINTS[trajectory]()
        wanted = HOME if trajectory in STAY else GOAL
    else:
        part = POSES[trajectory](goal)
        wanted = began.translation if trajectory in STAY else goal.translation
    until = Time(0.6) if trajectory in STREAMS else Time(after_trajectory=0.3)
    result = fa.run(part, CONTROLLERS[controller](), until, robot_controller=robot_controller)
    assert result.ending == proto.TERMINATED, f"{what}: {result.message}"
    assert result.termination == "Time", what
    if controller in LED:  # nobody leads it
        wanted = HOME if trajectory in JOINTS else began.translation
    truth = arm.simulation.truth()
    now = truth.q if trajectory in JOINTS else truth.O_T_TCP[:3, 3]
    np.testing.assert_allclose(now, wanted, atol=LEAST, err_msg=what)


@pytest.mark.parametrize("robot", ["fer", "fr3"])
def test_combinations_that_fit_move_the_arm_as_told(start, robot):
    """Each trajectory and each controller once, with others on each arm; bench/combinations.py runs all combinations."""
    fitting = [each for each in COMBINATIONS if each[2] != "auto" and fits(*each)]
    assert len(fitting) > 700
    draw = random.Random(robot)
    drawn = [draw.choice([each for each in fitting if each[0] == trajectory]) for trajectory in [*JOINTS, *POSES]]
    drawn += [draw.choice([each for each in fitting if each[1] == controller]) for controller in CONTROLLERS]
    arm = start(robot=robot, ideal=True)
    with arm.client() as fa:
        for each in drawn:
            moves_as_told(arm, fa, *each)


@pytest.mark.parametrize("by", ["client", "server"])
def test_what_does_not_fit_is_refused_with_what_would(ideal_arm, by, monkeypatch):
    if by == "server":
        monkeypatch.setattr(parts, "check_fit", lambda *_: None)
    with ideal_arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 1))  # where samples begin
        goal = fa.get_pose(include_tool_offset=False)
        goal.translation = goal.translation + SHIFT
        for trajectory, controller, robot_controller in COMBINATIONS:
            if fits(trajectory, controller, robot_controller):
                continue
            part = JOINTS[trajectory]() if trajectory in JOINTS else POSES[trajectory](goal)
            with pytest.raises(FrankaArmArgumentError, match="does not (take|fit).*use ") as refused:
                fa.run(part, CONTROLLERS[controller](), robot_controller=robot_controller)
            if what_fits := parts.robot_controllers(trajectory, controller.split()[0]):  # the server says the same
                assert f"use {', '.join(what_fits).upper()}" in str(refused.value), (trajectory, controller)
        with pytest.raises(FrankaArmArgumentError, match="robot_controller is 'warp': expected one of auto, torque"):
            fa.run(StayJoint(1), robot_controller="warp")


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
        down = RelativeMinJerkPose([0.1, -0.2, -0.6], frame="base", duration=80)  # gently
        for until, kind in [
            (ForceAbove(8, axis="z"), "ForceAbove"),
            (ForceAbove(8, relative=True), "ForceAbove"),
            (Contact(force_thresholds=[10] * 6), "Contact"),
        ]:
            fa.run(MinJerkJoint(HOME, 2))
            result = ending(fa, [until, Time(90)], down)
            assert result.termination == kind, result
            assert 1 < result.time < 80
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
    assert list(CartesianImpedance(600, 50).translational_stiffness) == [600] * 3
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
