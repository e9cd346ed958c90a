"""Virtual walls: what they refuse, and that nothing goes through them."""

import re
import struct
import sys

import numpy as np
import pytest
from conftest import HOME, REPOSITORY, client_after_crash

from frankapy import (
    FrankaArm,
    FrankaArmArgumentError,
    FrankaArmBusyException,
    FrankaArmException,
    FrankaConstants,
    RigidTransform,
    connection,
    proto,
)
from frankapy.cli import main
from frankapy.parts import (
    CartesianImpedance,
    FreeDrive,
    JointImpedance,
    JointWaypoints,
    MinJerkJoint,
    Never,
    RelativeMinJerkPose,
    StayJoint,
    StreamJoint,
    StreamJointVelocity,
    StreamPose,
    Time,
)
from frankapy.sim import SimulatedArm, Simulation
from frankapy.walls import Box, Capsule, Cylinder, Mesh, Plane, Sphere, from_boxes, read_stl

sys.path[:0] = [str(REPOSITORY / "tests" / "safety"), str(REPOSITORY / "tests" / "interop")]
from judge import clearance, held_capsule, self_distance  # noqa: E402

TRUTH_FILE = True
LEFT = HOME + [0.9, 0, 0, 0, 0, 0, 0]
WALL = Box([1, 0.01, 1], [0.4, 0.25, 0.5])
FACE = 0.25 - 0.005  # m, its y
# The corner i of a cube is at +1/2 along the axes whose bit i has.
CUBE = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]) - 0.5
SIDES = [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]]
MESH = Mesh(CUBE * [1, 0.01, 1], SIDES, [0.4, 0.25, 0.5])  # the same as WALL
DENTED = np.vstack([CUBE[:7], [0.1, 0.1, 0.1]])


@pytest.fixture
def walled(fa):
    yield fa
    fa.walls.clear()


def gap(rows) -> float:
    """Return the least distance between hand and wall (m), by the hull of models/arm.hpp and the fingers' capsule."""
    frames = rows["O_T_TCP"].reshape(-1, 4, 4).transpose(0, 2, 1)
    least = []
    for z, radius, length in ((0.0225, 0.049, 0.155), (0.10, 0.02, 0.1)):
        for y in (-length / 2, length / 2):
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
    "a mesh with a dent": (lambda fa: fa.walls.add("a", Mesh(DENTED, SIDES)), 'Wall "a" is not convex: corner .* mm outside'),
    "a mesh of squares": (lambda fa: fa.walls.add("a", Mesh(CUBE, [[0, 1, 2, 3]])), "triangles has shape"),
    "a mesh of millions": (lambda fa: fa.walls.add("a", Mesh(CUBE, SIDES * 100)), "triangles has 1200 rows: expected at most 128"),
    "a mesh of ragged corners": (lambda fa: fa.walls.add("a", Mesh([[0, 0, 0], [1, 0]], SIDES)), "corners is no array"),
    "a mesh of too few corners": (lambda fa: fa.walls.add("a", Mesh(CUBE, [[0, 1, 2**32]])), "triangles has 4294967296: .* 8 corners"),
    "a file that is not there": (lambda fa: read_stl("/no.stl"), "/no.stl cannot be read: No such file"),
    "a name of none": (lambda fa: fa.walls.add(5, Sphere(1)), "name is 5: expected a text"),
    "to remove no name": (lambda fa: fa.walls.remove(5), "name is 5: expected a text"),
    "walls without names": (lambda fa: fa.walls.update([Sphere(1)]), "walls is a list: expected a dictionary"),
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


def test_another_client_changes_nothing_while_this_one_commands(walled, ideal_arm, monkeypatch):
    monkeypatch.setattr(connection, "_LEASE_TIME", 0)  # a client that is held up for as long loses the arm
    with ideal_arm.client() as other:
        walled.walls.add("table", Plane())
        assert list(other.walls) == ["table"]
        with pytest.raises(FrankaArmBusyException):
            other.walls.clear()


def test_a_wall_where_the_arm_is_is_told_with_the_link_when_it_comes_and_to_who_connects(walled, ideal_arm, caplog):
    walled.walls.add("far", Sphere(0.1, [-0.5, 0.5, 0.5]))
    assert not caplog.records
    tool = walled.get_pose().translation
    walled.walls.add("ball", Sphere(0.05, tool))
    (record,) = caplog.records
    assert re.match(r"the hand or what it holds is \d+ mm inside of the wall 'ball': .* the arm may only go away", record.message)
    walled.walls.remove("far")
    assert len(caplog.records) == 1
    with ideal_arm.client():
        assert [each.message for each in caplog.records] == 2 * [record.message]


def test_boxes_of_the_published_interface_are_walls(walled):
    walled.walls.update(from_boxes(FrankaConstants.WORKSPACE_WALLS, "workspace"))
    assert list(walled.walls) == [f"workspace {i}" for i in range(1, 7)]
    walled.goto_joints(HOME, 1)
    with pytest.raises(FrankaArmArgumentError, match=r'wall "workspace [12]"'):  # at a side
        walled.run(RelativeMinJerkPose([0, 0.42, 0], frame="base", duration=3), CartesianImpedance())
    turned = [0.4, 0.1, 0.2, 0.3, -0.4, 0.5, 0.1, 0.2, 0.3]
    (by_angles,) = from_boxes(turned).values()
    (by_quaternion,) = from_boxes([*turned[:3], *by_angles.orientation, *turned[6:]]).values()
    np.testing.assert_allclose(by_quaternion.orientation, by_angles.orientation)
    assert by_quaternion.position == by_angles.position == turned[:3]
    for bad in ([1, 2, 3], [*turned[:3], 1, 1, 0, 0, *turned[6:]], [*turned[:8], np.nan]):
        with pytest.raises(FrankaArmArgumentError):
            from_boxes(bad)


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


def test_while_a_skill_runs_ways_through_walls_and_bad_walls_and_limits_are_refused_and_it_goes_on(walled):
    walled.walls.add("glass", WALL)
    walled.run(StayJoint(1), JointImpedance(), Never(), block=False)
    running = walled.wait_for(lambda state: state.phase == proto.RUNNING).skill_id
    for call, why in (
        (lambda: walled.change(trajectory=MinJerkJoint(LEFT, 3)), r'MinJerkJoint: .*wall "glass" at \d+ % of its way'),
        (lambda: walled.run(MinJerkJoint(LEFT, 3), preempt=True), r'MinJerkJoint: .*wall "glass" at \d+ % of its way'),
        *((lambda case=case: REFUSED[case][0](walled), REFUSED[case][1]) for case in ("a negative size", "a mesh with a dent", "too many")),
        (lambda: walled.limits.update(tool_speed=100), "tool_speed"),
    ):
        with pytest.raises(FrankaArmArgumentError, match=why):
            call()
    state = walled.get_arm_state()
    assert (state.skill_id, state.phase) == (running, proto.RUNNING)
    assert list(walled.walls) == ["glass"]
    walled.stop_skill()
    assert (walled.last_skill_result.ending, walled.last_skill_result.held_by) == (proto.STOPPED, 0)


def test_a_way_is_checked_while_nothing_moves_and_by_whom_ever(walled, ideal_arm):
    walled.walls.add("glass", WALL)
    with ideal_arm.client() as other:
        with pytest.raises(FrankaArmArgumentError, match=r'MinJerkJoint: .*wall "glass" at \d+ % of its way'):
            other.check(MinJerkJoint(LEFT, 3))
        right = HOME - [1, 0, 0, 0, 0, 0, 0]
        with pytest.raises(FrankaArmArgumentError, match='wall "glass"'):
            other.check(MinJerkJoint(LEFT, 3), joints=right)
        checked = other.check(MinJerkJoint(HOME, 3), joints=right, speed=0.5)
        assert checked.duration == pytest.approx(6)
        assert checked.stretch == 1
        assert checked.robot_controller == proto.JOINT_POSITION
        fast = other.check(MinJerkJoint(right, 0.1), JointImpedance())
        assert fast.robot_controller == proto.TORQUE
        assert fast.duration == pytest.approx(0.1 * fast.stretch)
        assert fast.stretch > 5
        assert not other.check(StreamJoint("goal"), JointImpedance(), Never()).HasField("duration")
        with pytest.raises(FrankaArmArgumentError, match="joints has 2 elements"):
            other.check(StayJoint(1), joints=[0, 0])


def test_a_way_is_checked_from_where_an_arm_is_that_is_led(fa, ideal_arm):
    fa.run(StayJoint(1000), FreeDrive(), block=False)
    ideal_arm.simulation.push([0, 30, 0, 0, 0, 0], 0.3)
    fa.wait_for(lambda state: abs(state.robot.q[0] - HOME[0]) > 0.1, 60)
    fa.wait_for(lambda state: np.abs(state.robot.dq).max() < 0.01, 60)
    assert fa.check(MinJerkJoint(fa.get_joints(), 0.05)).stretch < 1.1
    assert fa.check(MinJerkJoint(HOME, 0.02)).stretch > 2
    fa.stop_skill()


def test_of_a_long_way_no_part_is_left_out(walled):
    walled.walls.add("glass", WALL)
    rest = range(20)  # of the robot, so that the spline is at rest too
    times = [1781.2 + i for i in rest] + [1801.8] + [1803.4 + i for i in rest] + [3600]
    there_and_back = JointWaypoints([HOME] * 20 + [LEFT] + [HOME] * 21, times)
    with pytest.raises(FrankaArmArgumentError, match=r'JointWaypoints: .*wall "glass" at 50 % of its way'):
        walled.check(there_and_back)
    walled.walls.clear()
    assert walled.check(there_and_back).duration == 3600


@pytest.mark.parametrize(
    ("controller", "wall"),
    [
        pytest.param(None, WALL, id="robot"),
        pytest.param(JointImpedance(), WALL, id="torque"),
        pytest.param(JointImpedance(), MESH, id="mesh"),
    ],
)
def test_what_is_streamed_through_a_wall_ends_before_it(controller, wall, walled, ideal_arm):
    walled.walls.add("glass", wall)
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


def test_an_arm_inside_a_wall_may_go_away_and_no_deeper(walled, ideal_arm):
    tool = walled.get_pose().translation
    walled.walls.add("crate", Box([0.4, 0.4, 0.3], tool - [0, 0, 0.1]))  # its top is 5 cm above the tool's centre
    with pytest.raises(FrankaArmArgumentError, match='wall "crate"'):
        walled.run(RelativeMinJerkPose([0, 0, -0.05], frame="base", duration=2))
    first = ideal_arm.cycle()
    walled.run(StreamPose("goal", delay=0, timeout=0), CartesianImpedance(), Never(), block=False)
    with walled.publisher("goal") as publisher:
        publisher.publish(proto.PosePositionSensorMessage(position=tool - [0, 0, 0.1], quaternion=walled.get_pose().quaternion))
        held = walled.wait_for(lambda state: bool(state.held_by & proto.WALL), timeout=60).robot.message_id
        walled.wait_for(lambda state: state.robot.message_id > held + 1000, timeout=60)
    walled.stop_skill()
    gaps = [clearance(walled.walls["crate"], q) for q in ideal_arm.truth(first)["q"][::20]]
    assert min(gaps) > gaps[0] - 0.002
    walled.run(RelativeMinJerkPose([0, 0, 0.2], frame="base", duration=3))
    assert clearance(walled.walls["crate"], walled.get_joints()) > 0.03


def test_an_arm_gives_way_to_a_wall_that_moves(walled, ideal_arm):
    ideal_arm.end_motion(walled)
    tool = walled.get_pose().translation
    gaps = []
    with ideal_arm.standing_still():
        walled.run(StayJoint(60), FreeDrive(), Never(), block=False)
        for y in np.linspace(0.2, 0, 80):  # its face; 0.05 m/s, seen 20 times a second
            walled.walls["visitor"] = Box([0.3, 0.3, 0.2], tool + [0, y + 0.15, 0])
            ideal_arm.simulation.step(50)
            gaps.append(clearance(walled.walls["visitor"], ideal_arm.simulation.truth().q))
    walled.stop_skill()
    assert min(gaps) > 0
    assert gaps[-1] < 0.01
    assert walled.last_skill_result.wall == "visitor"


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
    with ideal_arm.standing_still():
        walled.run(MinJerkJoint(LEFT, 30), proto.InternalImpedance(), block=False)
        ideal_arm.simulation.step(5000)
        assert ideal_arm.simulation.truth().q[0] > 0.02
        walled.walls.add("glass", WALL)
    walled.wait_for_skill()
    assert walled.last_skill_result.wall == "glass"
    assert gap(ideal_arm.truth(first)) > 0.009


def test_a_call_ends_at_a_wall_that_comes_across_its_way(walled, ideal_arm):
    with ideal_arm.standing_still():
        walled.goto_joints(LEFT, duration=30, block=False)
        ideal_arm.simulation.step(5000)
        walled.walls.add("glass", WALL)
    walled.wait_for_skill()
    assert walled.last_skill_result.ending == proto.TERMINATED
    assert walled.last_skill_result.wall == "glass"


@pytest.mark.nightly
def test_what_is_held_is_kept_from_the_arm_itself(walled, ideal_arm):
    stick = Capsule(0.01, 0.3, RigidTransform(RigidTransform.y_axis_rotation(np.pi / 2), [-0.15, 0, 0]))  # towards the arm
    back = RelativeMinJerkPose([-0.17, 0, 0], frame="base", duration=20)
    walled.check(back)
    first = ideal_arm.cycle()
    with ideal_arm.standing_still():
        walled.run(back, proto.InternalImpedance(), block=False)
        ideal_arm.simulation.step(5000)
        walled.walls.hold("stick", stick)
    walled.wait_for_skill()
    assert walled.last_skill_result.held_by & proto.ITSELF
    held = [held_capsule(wall) for wall in walled.walls.values()]
    assert 0.02 < min(self_distance(q, held) for q in ideal_arm.truth(first)["q"][::50]) < 0.04  # motions keep 0.031 m
    walled.walls.remove("stick")  # so near to link 3 the way home may lead a little nearer
    walled.reset_joints(2)
    walled.walls.hold("stick", stick)
    with pytest.raises(FrankaArmArgumentError, match=r"the hand or what it holds would come within \d+ mm of link \d of the arm itself"):
        walled.run(back)
    walled.walls.remove("stick")
    walled.run(back)


def test_joints_that_slide_along_a_wall_come_no_nearer_to_it(start_for_module):
    arm = start_for_module(robot="fer")
    glass = Plane([0, -1, 0], [0, 0.2, 0])
    with arm.client() as fa:
        fa.run(MinJerkJoint([-0.7, 0.1, 0, -2.1, 0, 2.2, 0.785], 2))
        fa.walls.add("glass", glass)
        first = arm.cycle()
        fa.run(StreamJointVelocity("way", timeout=60, speed=1), proto.InternalImpedance(), Never(), block=False)
        with fa.publisher("way") as publisher:
            publisher.publish(proto.JointVelocitySensorMessage(joint_velocities=[0.9, 0, 0, 0, 0, 0, 0]))
            held = fa.wait_for(lambda state: bool(state.held_by & proto.WALL)).robot.message_id
            fa.wait_for(lambda state: state.robot.message_id > held + 1000)
        fa.stop_skill()
        rows = arm.truth(first)
    assert min(clearance(glass, q) for q in rows["q"][::20]) > 0.009


def test_walls_outlive_the_process_of_their_arm(walled, ideal_arm):
    walled.walls.add("glass", WALL)
    with client_after_crash(ideal_arm) as again:
        assert list(again.walls) == ["glass"]
        with pytest.raises(FrankaArmArgumentError, match='wall "glass"'):
            again.goto_joints(LEFT, ignore_virtual_walls=True)


def test_walls_that_are_to_be_kept_outlive_the_server_which_does_not_start_without_them(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    with Simulation(SimulatedArm(lockstep=True)) as simulation, FrankaArm(server=simulation.server) as fa:
        fa.walls.add("glass", WALL, keep=True)
        fa.walls.add("visitor", WALL)
        arm = SimulatedArm(lockstep=True, address=simulation.addresses[0])
    with Simulation(arm) as simulation, FrankaArm(server=simulation.server) as fa:
        assert list(fa.walls) == ["glass"]
    (file,) = (tmp_path / "franka-interface" / "walls").iterdir()
    file.write_bytes(b"")  # as a file system may leave it when the power fails
    with pytest.raises(FrankaArmException, match=f"{file}: the walls that were to be kept cannot be read"):
        Simulation(arm)


def test_stl_files_are_read_in_text_and_binary(tmp_path):
    corners = CUBE[np.array(SIDES)] * 1000  # mm
    binary, text = tmp_path / "binary.stl", tmp_path / "text.stl"
    binary.write_bytes(bytes(80) + struct.pack("<I", 12) + b"".join(struct.pack("<12fH", 0, 0, 0, *each.ravel(), 0) for each in corners))
    vertices = ["".join(f"vertex {x} {y} {z}\n" for x, y, z in each) for each in corners]
    text.write_text("solid a\n" + "".join(f"facet normal 0 0 0\nouter loop\n{each}endloop\nendfacet\n" for each in vertices) + "endsolid a\n")
    for path in (binary, text):
        found, triangles = read_stl(path, scale=0.001)
        assert found.shape == (8, 3)
        np.testing.assert_allclose(found[triangles], CUBE[np.array(SIDES)], atol=1e-6)
    binary.write_bytes(binary.read_bytes()[:-1])
    with pytest.raises(FrankaArmArgumentError, match="is no STL file"):
        read_stl(binary)


def test_the_command_line_turns_holds_and_keeps(ideal_arm, capsys, tmp_path):
    def walls(*words: str) -> str:
        assert main(["walls", "--server", ideal_arm.server, *words]) == 0
        return capsys.readouterr().out

    (tmp_path / "cube.stl").write_text(
        "".join("facet\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in CUBE[each]) for each in SIDES)
    )
    shown = walls("add", "fixture", "mesh", "--file", str(tmp_path / "cube.stl"), "--scale", "0.1", "--at", "0.5", "0", "-0.5")
    assert "mesh of 12 triangles at 0.5, 0, -0.5 m" in shown
    assert walls("remove", "fixture").strip() == "no walls"
    assert "sphere 0.2 at 0, 2, 0 m" in walls("add", "ball", "sphere", "0.2", "--at", "0", "2", "0")
    assert "cylinder 0.2 x 1 at 0, 2, 0 m" in walls("add", "ball", "cylinder", "0.2", "1", "--at", "0", "2", "0")
    walls("add", "ball", "plane", "--normal", "0", "-3", "0", "--at", "0", "2", "0")
    walls("add", "ramp", "box", "1", "0.5", "0.1", "--at", "0.5", "0", "-0.5", "--turn", "0", "30", "90")
    shown = walls("add", "pen", "capsule", "0.005", "0.1", "--at", "0", "0", "0.05", "--held", "--keep")
    assert "box 1 x 0.5 x 0.1 at 0.5, 0, -0.5 m, turned 0 30 90 degrees" in shown
    assert "held, kept" in shown
    with ideal_arm.client() as fa:
        assert list(fa.obstacles) == ["ball", "pen", "ramp"]
        normal = RigidTransform.rotation_from_quaternion(fa.walls["ball"].orientation)[:, 2]
        np.testing.assert_allclose(normal, [0, -1, 0], atol=1e-6)
        # Its long edge, turned down by 30 degrees and then to the left.
        rotation = RigidTransform.rotation_from_quaternion(fa.walls["ramp"].orientation)
        np.testing.assert_allclose(rotation[:, 0], [0, np.cos(np.pi / 6), -0.5], atol=1e-6)
        np.testing.assert_allclose(fa.walls["pen"].position, [0, 0, 0.1034 + 0.05], atol=1e-6)
    assert main(["walls", "--server", ideal_arm.server, "add", "safe", "sphere", "0.2", "--protect"]) == 1
    assert "role lab" in capsys.readouterr().err
    assert walls("remove", "ball", "pen", "ramp").strip() == "no walls"
