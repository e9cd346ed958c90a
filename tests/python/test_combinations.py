"""Skills of any parts: combinations that the rule allows move the arm as the truth says; each other is refused with what fits."""

import random
from contextlib import nullcontext

import part_combinations
import pytest
from draw import is_led
from google.protobuf.message import Message
from judge import clearance
from part_combinations import GOAL, HOME, SHIFT, STAY, fits, moves_as_told, parts_of

from frankapy import FrankaArmArgumentError, RigidTransform, parts, proto
from frankapy.parts import MinJerkJoint, Never, StayJoint, Time
from frankapy.walls import Plane

ALL = part_combinations.combinations()
FITTING = [each for each in ALL if fits(*each)]


def drawn(part: int, seed: str) -> list[part_combinations.Combination]:
    """Return one for each trajectory (part 0) or controller (1), of those that fit."""
    draw = random.Random(seed)
    return [draw.choice([each for each in FITTING if each[part] == name]) for name in dict.fromkeys(each[part] for each in ALL)]


@pytest.mark.parametrize(("robot", "part"), [("fer", 0), ("fr3", 1)], ids=["trajectories-fer", "controllers-fr3"])
def test_combinations_that_fit_move_the_arm_as_told(start, robot, part):
    """Each trajectory, and on the other arm each controller, once, with any that fits."""
    arm = start(robot=robot, ideal=True)
    with arm.client() as fa:
        for each in drawn(part, robot):
            moves_as_told(arm.simulation, fa, *each)


def heard(goal: RigidTransform) -> dict[str, Message]:
    """Return what leads each stream of motions to or through GOAL and that pose."""
    pose = {"position": goal.translation, "quaternion": goal.quaternion}
    return {
        "StreamJoint": proto.JointPositionSensorMessage(joints=GOAL),
        "StreamJointVelocity": proto.JointVelocitySensorMessage(joint_velocities=GOAL - HOME),
        "StreamPose": proto.PosePositionSensorMessage(**pose),
        "StreamForcePosition": proto.ForcePositionSensorMessage(pose=goal.matrix.T.ravel(), force=[0] * 6),
        "StreamCartesianVelocity": proto.CartesianVelocitySensorMessage(cartesian_velocities=[*SHIFT, 0, 0, 0]),
    }


@pytest.mark.nightly
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("part", [0, 1], ids=["trajectories", "controllers"])
@pytest.mark.parametrize("robot", ["fer", "fr3"])
def test_whatever_moves_stops_before_a_wall_that_comes_across_its_way(start, robot, part):
    """Each trajectory, and each controller, once, with any that fits; an arm that follows forces is pushed."""
    arm = start(robot=robot, ideal=True, truth=True)
    with arm.client() as fa:
        for trajectory, controller, robot_controller in drawn(part, f"{robot} walled"):
            what = f"{trajectory} with {controller} in {robot_controller}"
            fa.walls.clear()
            fa.run(MinJerkJoint(HOME, 1))
            arm.end_motion(fa)
            goal = fa.get_pose(include_tool_offset=False)
            goal.translation = goal.translation + SHIFT
            motion, law = parts_of(trajectory, controller, goal)
            streams = trajectory in heard(goal)
            if streams:
                motion.topic, motion.timeout = "way", 60
            nearest = clearance(Plane([0, -1, 0], [0, 0, 0]), HOME)
            glass = Plane([0, -1, 0], [0, 0.02 - nearest, 0])
            first = arm.cycle()
            with arm.standing_still(), fa.publisher("way") if streams else nullcontext() as publisher:
                fa.run(motion, law, Never(), robot_controller=robot_controller, block=False)
                arm.simulation.step(50)
                fa.walls.add("glass", glass)
                if streams:
                    publisher.publish(heard(goal)[trajectory])
                if is_led(controller.split()[0]):
                    arm.simulation.push([0, 12, 0, 0, 0, 0], duration=3)
                for _ in range(4):
                    arm.simulation.step(1000)
            fa.change(until=Time(0))
            fa.wait_for_skill()
            rows = arm.truth(first)["q"][::10]
            assert min(clearance(glass, q) for q in rows) > 0, what
            if trajectory not in STAY or is_led(controller.split()[0]):
                assert fa.last_skill_result.wall == "glass", what


@pytest.mark.nightly
@pytest.mark.timeout(4 * 3600)
@pytest.mark.parametrize("robot", ["fer", "fr3"])
def test_all_combinations_that_fit_move_the_arm_as_told_and_the_others_are_refused(start, robot):
    arm = start(robot=robot, ideal=True)
    with arm.client() as fa:
        of = {each: part_combinations.tried(arm.simulation, fa, *each) for each in ALL}
    assert not {each: text for each, text in of.items() if text.startswith("WRONG")}
    assert {each for each, text in of.items() if text == part_combinations.RUNS} == set(FITTING)
    assert len(FITTING) > 700


def test_a_kind_without_an_example_is_in_it_by_itself(ideal_arm, monkeypatch):
    for table, kinds in (
        ("JOINTS", ["MinJerkJoint", "JointDmp", "StreamJoint"]),
        ("POSES", ["MinJerkPose", "TimeOptimalPose", "Impulse"]),
        ("CONTROLLERS", ["Lqr", "ForceAxisImpedance", "Admittance"]),
    ):
        for kind in kinds:
            monkeypatch.delitem(getattr(part_combinations, table), kind)
    assert {each for each in part_combinations.combinations() if fits(*each)} == set(FITTING)
    with ideal_arm.client() as fa:
        for each in (
            ("MinJerkJoint", "Lqr", "torque"),
            ("JointDmp", "JointImpedance", "torque_and_joint_position"),
            ("StreamJoint", "InternalImpedance", "joint_velocity"),
            ("MinJerkPose", "CartesianImpedance", "torque"),
            ("TimeOptimalPose", "Admittance", "torque"),
            ("Impulse", "ForceAxisImpedance", "torque"),
        ):
            moves_as_told(ideal_arm.simulation, fa, *each)


@pytest.mark.parametrize("by", ["client", "server"])
def test_what_does_not_fit_is_refused_with_what_would(ideal_arm, by, monkeypatch):
    if by == "server":
        monkeypatch.setattr(parts, "check_fit", lambda *_: None)
    with ideal_arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 1))  # where samples begin
        goal = fa.get_pose(include_tool_offset=False)
        goal.translation = goal.translation + SHIFT
        unfit = [each for each in ALL if not fits(*each)]
        unfit += [(*each[:2], "auto") for each in unfit if not parts.robot_controllers(each[0], each[1].split()[0])]
        for trajectory, controller, robot_controller in dict.fromkeys(unfit):
            with pytest.raises(FrankaArmArgumentError, match="does not (take|fit).*use ") as refused:
                fa.run(*parts_of(trajectory, controller, goal), robot_controller=robot_controller)
            if what_fits := parts.robot_controllers(trajectory, controller.split()[0]):  # the server says the same
                assert f"use {', '.join(what_fits).upper()}" in str(refused.value), (trajectory, controller)
        with pytest.raises(FrankaArmArgumentError, match="robot_controller is 'warp': expected one of auto, torque"):
            fa.run(StayJoint(1), robot_controller="warp")
