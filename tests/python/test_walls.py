"""Virtual walls: what they refuse, and that nothing goes through them."""

import contextlib

import numpy as np
import pytest
from conftest import HOME, client_after_crash

from frankapy import FrankaArmArgumentError, FrankaArmBusyException, RigidTransform, proto
from frankapy.cli import main
from frankapy.parts import CartesianImpedance, FreeDrive, JointImpedance, MinJerkJoint, Never, StayJoint, StreamJoint, StreamPose, Time
from frankapy.walls import Box, Capsule, Cylinder, Plane, Sphere

TRUTH_FILE = True
LEFT = HOME + [0.9, 0, 0, 0, 0, 0, 0]
WALL = Box([1, 0.01, 1], [0.4, 0.25, 0.5])
FACE = 0.25 - 0.005  # m, its y


@pytest.fixture
def walled(fa):
    yield fa
    fa.walls.clear()


def gap(rows) -> float:
    """Return the least distance between hand and wall (m), by the two capsules of models/arm.cpp."""
    frames = rows["O_T_TCP"].reshape(-1, 4, 4).transpose(0, 2, 1)
    least = []
    for z, radius in ((0.04, 0.04), (0.10, 0.02)):
        for y in (-0.05, 0.05):
            end = frames[:, :3, 3] + frames[:, :3, :3] @ [0, y, z - 0.1034]
            least.append((FACE - end[:, 1]).min() - radius)
    return min(least)


def test_walls_are_a_mapping(walled):
    walls = walled.walls
    walls["table"] = Plane([0, 0, 2], [0, 0, -0.2])
    walls.update({"ball": Sphere(0.1, [0.5, 0.5, 0.5]), "post": Cylinder(0.05, 1, [-0.5, 0, 0.5])})
    walls.hold("pen", Capsule(0.005, 0.1, [0, 0, 0.05]))
    assert list(walls) == ["ball", "pen", "post", "table"]
    assert walls["ball"].sphere.radius == 0.1
    assert "pen: capsule (held)" in repr(walls)
    # In the flange's frame it is where the tool is.
    np.testing.assert_allclose(walls["pen"].position, [0, 0, 0.1034 + 0.05], atol=1e-6)
    del walls["ball"]
    assert len(walls) == 3
    walls.clear()
    assert not walls


REFUSED = {
    "no wall": (lambda fa: fa.walls.add("a", [1, 2, 3]), "expected Plane"),
    "a size of zero": (lambda fa: fa.walls.add("a", Box([1, 0, 1])), r"size\[1\] is 0 m: expected 0.001 to 10"),
    "a negative size": (lambda fa: fa.walls.add("a", Sphere(-1)), "radius is -1"),
    "NaN": (lambda fa: fa.walls.add("a", Box([1, 1, 1], [0, np.nan, 0])), r"position\[1\] is nan"),
    "a direction of nothing": (lambda fa: fa.walls.add("a", Plane([0, 0, 0])), "normal is"),
    "no name": (lambda fa: fa.walls.add("", Sphere(1)), "name"),
    "one that is not there": (lambda fa: fa.walls.remove("moon"), 'there is no wall "moon"'),
    "a plane that is held": (lambda fa: fa.walls.hold("a", Plane()), "is held and a plane"),
    "too many": (
        lambda fa: fa.walls.update({f"{i}": Sphere(0.1, [5, 5, 5]) for i in range(1000)}),
        "1000 walls: expected at most 64",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_wall_that_is_none_is_refused(case, walled):
    call, why = REFUSED[case]
    with pytest.raises(FrankaArmArgumentError, match=why):
        call(walled)
    assert not walled.walls


def test_another_client_changes_nothing_while_this_one_commands(walled, ideal_arm):
    walled.walls.add("table", Plane())
    with ideal_arm.client() as other:
        assert list(other.walls) == ["table"]
        with pytest.raises(FrankaArmBusyException):
            other.walls.clear()


def test_a_way_through_a_wall_is_refused_with_the_place(walled):
    walled.walls.add("glass", WALL)
    before = walled.get_joints()
    with pytest.raises(FrankaArmArgumentError, match=r'MinJerkJoint: .*wall "glass" at \d+ % of its way'):
        walled.goto_joints(LEFT, ignore_virtual_walls=True)
    pose = walled.get_pose()
    pose.translation[1] = 0.4
    with pytest.raises(FrankaArmArgumentError, match='MinJerkPose: .*wall "glass"'):
        walled.goto_pose(pose, ignore_virtual_walls=True)
    np.testing.assert_allclose(walled.get_joints(), before, atol=1e-6)
    walled.walls.clear()
    walled.goto_joints(LEFT, 2)


@pytest.mark.parametrize("controller", [None, JointImpedance()], ids=["robot", "torque"])
def test_what_is_streamed_through_a_wall_ends_before_it(controller, walled, ideal_arm):
    walled.walls.add("glass", WALL)
    first = ideal_arm.cycle()
    parts = [StreamJoint("goal", delay=0, timeout=0), *([controller] if controller else [proto.InternalImpedance()])]
    walled.run(*parts, Never(), block=False)
    with walled.publisher("goal") as publisher:
        publisher.publish(proto.JointPositionSensorMessage(joints=LEFT))
        walled.wait_for(lambda state: state.robot.q[0] > 0.15 and max(np.abs(state.robot.dq)) < 1e-3, timeout=60)
    walled.stop_skill()
    assert walled.last_skill_result.wall == "glass"
    assert walled.last_skill_result.held_by & proto.WALL
    assert 0.009 < gap(ideal_arm.truth(first)) < 0.012


@pytest.mark.parametrize(
    "controller",
    [pytest.param(proto.InternalImpedance(), id="robot", marks=pytest.mark.nightly), pytest.param(CartesianImpedance(), id="torque")],
)
def test_a_pose_slides_along_a_wall_to_beside_its_goal(controller, walled, ideal_arm):
    walled.walls.add("glass", WALL)
    first = ideal_arm.cycle()
    goal = walled.get_pose()
    goal.translation[:] += [0.1, 0.3, 0]
    walled.run(StreamPose("goal", delay=0, timeout=0), controller, Never(), block=False)
    with walled.publisher("goal") as publisher:
        publisher.publish(proto.PosePositionSensorMessage(position=goal.translation, quaternion=goal.quaternion))
        walled.wait_for(lambda state: state.robot.O_T_EE[12] > goal.translation[0] - 0.01, timeout=60)
    walled.stop_skill()
    assert walled.last_skill_result.wall == "glass"
    assert 0.005 < gap(ideal_arm.truth(first)) < 0.02


def test_an_arm_that_is_pushed_is_held_off(walled, ideal_arm):
    walled.walls.add("glass", WALL)
    ideal_arm.end_motion(walled)
    with ideal_arm.standing_still(between_motions=True):  # the push begins with the skill
        first = ideal_arm.cycle()
        ideal_arm.simulation.push([0, 12, 0, 0, 0, 0], duration=4)
        walled.run(StayJoint(6), FreeDrive(), Time(5))
    assert walled.last_skill_result.ending == proto.TERMINATED
    assert walled.last_skill_result.wall == "glass"
    assert 0.001 < gap(ideal_arm.truth(first)) < 0.01


def test_a_wall_comes_while_a_skill_runs(walled, ideal_arm):
    first = ideal_arm.cycle()
    walled.run(MinJerkJoint(LEFT, 30), proto.InternalImpedance(), block=False)
    with contextlib.ExitStack() as until_it_is_there:

        def pause_on_the_way(state):
            if state.robot.q[0] > 0.02:
                until_it_is_there.enter_context(ideal_arm.standing_still())
            return state.robot.q[0] > 0.02

        walled.wait_for(pause_on_the_way)
        walled.walls.add("glass", WALL)
    walled.wait_for_skill()
    assert walled.last_skill_result.wall == "glass"
    assert gap(ideal_arm.truth(first)) > 0.009


def test_walls_outlive_the_process_of_their_arm(walled, ideal_arm):
    walled.walls.add("glass", WALL)
    with client_after_crash(ideal_arm) as again:
        assert list(again.walls) == ["glass"]
        with pytest.raises(FrankaArmArgumentError, match='wall "glass"'):
            again.goto_joints(LEFT, ignore_virtual_walls=True)


def test_the_command_line_turns_holds_and_keeps(ideal_arm, capsys):
    def walls(*words: str) -> str:
        assert main(["walls", "--server", ideal_arm.server, *words]) == 0
        return capsys.readouterr().out

    walls("add", "ramp", "box", "1", "0.5", "0.1", "--at", "0.5", "0", "-0.5", "--turn", "0", "30", "90")
    shown = walls("add", "pen", "capsule", "0.005", "0.1", "--at", "0", "0", "0.05", "--held", "--keep")
    assert "box 1 x 0.5 x 0.1 at 0.5, 0, -0.5 m, turned 0 30 90 degrees" in shown
    assert "held, kept" in shown
    with ideal_arm.client() as fa:
        assert list(fa.obstacles) == ["pen", "ramp"]
        # Its long edge, turned down by 30 degrees and then to the left.
        rotation = RigidTransform.rotation_from_quaternion(fa.walls["ramp"].orientation)
        np.testing.assert_allclose(rotation[:, 0], [0, np.cos(np.pi / 6), -0.5], atol=1e-6)
        np.testing.assert_allclose(fa.walls["pen"].position, [0, 0, 0.1034 + 0.05], atol=1e-6)
    assert walls("remove", "pen", "ramp").strip() == "no walls"
