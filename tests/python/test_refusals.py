"""What is refused, before anything moves; afterwards the next good command works."""

import numpy as np
import pytest
from conftest import HOME
from test_validation import BAD

from frankapy import FrankaArmArgumentError, FrankaArmBusyException, FrankaConstants, RigidTransform, proto
from frankapy.validation import validate

ROTATION = np.diag([1.0, -1.0, -1.0])


def pose(x, y, z, from_frame="franka_tool", to_frame="world", rotation=ROTATION):
    return RigidTransform(rotation, [x, y, z], from_frame, to_frame)


def broken_pose():
    p = pose(0.4, 0, 0.4)
    p.translation[1] = np.nan
    return p


def skewed_pose():
    p = pose(0.4, 0, 0.4)
    p.rotation[0, 0] = 1.5
    return p


def mirrored_pose():
    p = pose(0.4, 0, 0.4)
    p.rotation[:, 1] *= -1
    return p


REFUSED = {
    "joints: NaN": (lambda fa: fa.goto_joints([0, 0, np.nan, -2, 0, 2, 0]), r"joints\[2\] is nan"),
    "joints: infinite": (lambda fa: fa.goto_joints([0, 0, 0, -np.inf, 0, 2, 0]), r"joints\[3\] is -inf"),
    "joints: six": (lambda fa: fa.goto_joints([0] * 6), "6 elements: expected 7"),
    "joints: text": (lambda fa: fa.goto_joints("home"), "expected 7 numbers"),
    "joints: out of reach": (lambda fa: fa.goto_joints([0, 0, 0, 0.5, 0, 2, 0]), "Joints not reachable!.*joint 4"),
    "joints: behind a wall": (lambda fa: fa.goto_joints(HOME + [1.5, 1.2, 0, 1.5, 0, 0, 0]), "virtual walls"),
    "duration: zero": (lambda fa: fa.goto_joints(HOME, duration=0), "duration is 0 s"),
    "duration: negative": (lambda fa: fa.goto_joints(HOME, duration=-3), "duration is -3 s"),
    "duration: NaN": (lambda fa: fa.goto_pose(pose(0.4, 0, 0.4), duration=np.nan), "duration is nan"),
    "buffer_time: negative": (lambda fa: fa.goto_joints(HOME, buffer_time=-1), "after_trajectory is -1 s"),
    "gains: six": (lambda fa: fa.goto_joints(HOME, use_impedance=True, k_gains=[1] * 6), "k_gains has 6"),
    "gains: negative": (lambda fa: fa.goto_joints(HOME, use_impedance=True, k_gains=[-1] * 7), r"stiffness\[0\] is -1"),
    "stiffness: too high": (
        lambda fa: fa.goto_pose(pose(0.4, 0, 0.4), cartesian_impedances=[1e4] * 6),
        r"translational_stiffness\[0\] is 10000 N/m: expected 0 to 3000",
    ),
    "stiffness of the robot: too high": (
        lambda fa: fa.goto_joints(HOME, joint_impedances=[20000] * 7),
        r"K_theta\[0\] is 20000",
    ),
    "velocities: six": (lambda fa: fa.execute_joint_velocities([0.1] * 6, [1] * 7), "joint_velocities has 6"),
    "velocities: beyond the arm": (lambda fa: fa.execute_joint_velocities([9] + [0] * 6, [0] * 7), r"dq\[0\] is 9"),
    "velocities: NaN": (lambda fa: fa.execute_cartesian_velocities([np.nan] * 6, [1] * 6), "cartesian_velocities.0. is nan"),
    "acceleration: negative": (lambda fa: fa.execute_cartesian_velocities([0.1] * 6, [-1] * 6), r"O_ddP_EE\[0\] is -1"),
    "forces: for too long": (
        lambda fa: fa.apply_effector_forces_torques(5, 1, 0, 0, forces=[0, 0, 5]),
        "forces of 5 for run_duration 5 s make 25: expected at most 20",
    ),
    "torques: for too long": (
        lambda fa: fa.apply_effector_forces_torques(5, 1, 0, 0, torques=[0, 0, 1]),
        "torques of 1 .* expected at most 2",
    ),
    "forces: rise too long": (
        lambda fa: fa.apply_effector_forces_along_axis(2, 1.5, 0, [0, 0, 5]),
        "acc_duration is 1.5 s: expected at most half",
    ),
    "forces: none": (lambda fa: fa.apply_effector_forces_along_axis(2, 0.5, 0, [0, 0, 0]), "expected a force"),
    "rate of states": (lambda fa: fa.states(rate=300), "rate is 300 Hz: expected 1000, or that divided"),
    "a field of states": (lambda fa: fa.states(fields="robot.q"), "fields is 'robot.q': expected a list"),
    "a number as field": (lambda fa: fa.states(fields=[1]), "fields has '1': expected fields of ArmState"),
    "a condition that is none": (lambda fa: fa.wait_for(True), "condition is True: expected a function"),
    "fields of states": (lambda fa: fa.states(fields=["robot.p"]), "fields has 'robot.p': expected fields of ArmState"),
    "pose: no pose": (lambda fa: fa.goto_pose([0.4, 0, 0.4]), "expected a RigidTransform"),
    "pose: NaN": (lambda fa: fa.goto_pose(broken_pose()), "not finite"),
    "pose: no rotation": (lambda fa: fa.goto_pose(skewed_pose()), "rotation is no rotation matrix"),
    "pose: mirrored": (lambda fa: fa.goto_pose(mirrored_pose()), "rotation is no rotation matrix"),
    "pose: of the tool base": (
        lambda fa: fa.goto_pose(fa.get_pose(include_tool_offset=False)),
        "frames franka_tool_base to world: expected franka_tool to world",
    ),
    "pose: unknown frame": (lambda fa: fa.goto_pose(pose(0.4, 0, 0.4, to_frame="table")), "franka_tool to table"),
    "pose: behind a wall": (lambda fa: fa.goto_pose(pose(0.8, 0, 0.4)), "x = 0.800 m.*virtual walls.*0.75"),
    "pose: out of reach": (
        lambda fa: fa.goto_pose(pose(0.74, 0.45, 0.95), ignore_virtual_walls=True),
        "(?i)reach",
    ),
    "pose: 3 m away": (
        lambda fa: fa.goto_pose(pose(3, 0, 0.4), ignore_virtual_walls=True),
        "position.*expected -2 to 2",
    ),
    "delta: wrong frames": (
        lambda fa: fa.goto_pose_delta(pose(0, 0, 0.1, "franka_tool", "world")),
        "expected franka_tool to franka_tool or world to world",
    ),
    "delta: behind a wall": (
        lambda fa: fa.goto_pose_delta(pose(0, 0, -0.9, "world", "world", np.eye(3))),
        "virtual walls",
    ),
    "delta: out of reach": (
        lambda fa: fa.goto_pose_delta(pose(0.9, 0, 0, "world", "world", np.eye(3)), ignore_virtual_walls=True),
        "(?i)reach",
    ),
    "tool: wrong frames": (
        lambda fa: fa.set_tool_delta_pose(pose(0, 0, 0.1)),
        "expected franka_tool to franka_tool_base",
    ),
    "gripper: too wide": (lambda fa: fa.goto_gripper(0.09), "width is 0.09 m: expected 0 to 0.08"),
    "gripper: negative": (lambda fa: fa.goto_gripper(-0.01), "width is -0.01 m"),
    "gripper: NaN": (lambda fa: fa.goto_gripper(np.nan), "width is nan"),
    "gripper: speed": (lambda fa: fa.goto_gripper(0.04, speed=-1), "speed is -1 m/s"),
    "gripper: force": (lambda fa: fa.goto_gripper(0.04, grasp=True, force=1000), "force is 1000 N: expected 0 to 140"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_by_name_and_nothing_moves(fa, name):
    call, text = REFUSED[name]
    before = fa.get_joints()
    with pytest.raises(FrankaArmArgumentError, match=text):
        call(fa)
    assert fa.is_skill_done()
    np.testing.assert_allclose(fa.get_joints(), before, atol=1e-4)


def test_a_way_on_which_the_arm_would_meet_itself_is_refused(fa):
    folded = [0, -1.7, 0, -3.0, 0, 0.6, 0.785]
    with pytest.raises(FrankaArmArgumentError, match=r"come within \d+ mm of link \d of the arm itself at"):
        fa.goto_joints(folded, 5, ignore_virtual_walls=True)
    assert fa.is_skill_done()


def test_walls_are_not_asked_where_they_are_ignored(fa):
    joints = HOME + [1.2, 0.9, 0, 0.9, 0, 0, 0]
    with pytest.raises(ValueError, match="y = .* virtual walls"):
        fa.goto_joints(joints, 1)
    fa.goto_joints(joints, 1, ignore_virtual_walls=True)


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("end", ["rest_min", "rest_max"])
def test_joints_that_are_reachable_are_those_that_the_server_takes(fa, joint, end):
    inwards = 1 if end == "rest_min" else -1
    outside, inside = HOME.copy(), HOME.copy()
    outside[joint] = getattr(fa.limits, end)[joint] - inwards * 1e-6
    inside[joint] = getattr(fa.limits, end)[joint] + inwards * 1e-6
    assert not fa.is_joints_reachable(outside) and fa.is_joints_reachable(inside)
    for refused in (
        lambda: fa.goto_joints(outside, ignore_virtual_walls=True),
        lambda: fa.run(proto.MinJerkJoint(q=outside, duration=60), block=False),
    ):
        with pytest.raises(FrankaArmArgumentError, match=rf"(joints|q)\[{joint}\] is"):
            refused()
    try:
        fa.goto_joints(inside, 60, block=False, ignore_virtual_walls=True)
        fa.stop_skill()
    except FrankaArmArgumentError as refused:  # from here it is reached past the arm itself
        assert "of the arm itself" in str(refused)


def test_walls_are_those_of_the_constants(fa, monkeypatch):
    walls = FrankaConstants.WORKSPACE_WALLS.copy()
    walls[3, 0] = 0.35
    monkeypatch.setattr(FrankaConstants, "WORKSPACE_WALLS", walls)
    with pytest.raises(ValueError, match="0.35"):
        fa.goto_pose(pose(0.4, 0, 0.45))


def request_of(message) -> proto.Request:
    """Return a request that carries a component, the rest of its skill good."""
    if isinstance(message, proto.GripperCommand):
        return proto.Request(gripper=message)
    parts = {
        "trajectory": proto.MinJerkJoint(q=HOME, duration=1),
        "controller": proto.JointImpedance(),
        "terminations": proto.Time(after_trajectory=0.1),
    }
    kind = message.DESCRIPTOR.file.name.rsplit("/")[-1].removesuffix(".proto")
    parts[{"trajectories": "trajectory", "controllers": "controller"}.get(kind, kind)] = message
    skill = proto.Skill()
    skill.trajectory.Pack(parts["trajectory"])
    skill.controller.Pack(parts["controller"])
    skill.terminations.add().Pack(parts["terminations"])
    return proto.Request(start_skill=proto.StartSkill(skill=skill))


@pytest.mark.parametrize("message", [message for message, _ in BAD], ids=[text for _, text in BAD])
def test_the_server_refuses_what_the_client_refuses_in_the_same_words(fa, message):
    with pytest.raises(FrankaArmArgumentError) as ours:
        validate(message)
    with pytest.raises(FrankaArmArgumentError) as theirs:
        fa._connection.ask(request_of(message))
    assert ours.value.message in theirs.value.message


def test_an_unknown_kind_is_refused_with_those_known(fa):
    request = request_of(proto.JointImpedance())
    request.start_skill.skill.controller.type_url = "type.googleapis.com/frankapy.proto.FromTheFuture"
    with pytest.raises(FrankaArmArgumentError, match="FromTheFuture.*CartesianImpedance"):
        fa._connection.ask(request)


def test_bytes_that_are_not_the_kind_are_refused(fa):
    request = request_of(proto.JointImpedance())
    request.start_skill.skill.trajectory.value = b"\x0a\xff\xff"
    with pytest.raises(FrankaArmArgumentError, match="MinJerkJoint"):
        fa._connection.ask(request)


def test_a_skill_that_runs_goes_on_whatever_is_refused_meanwhile(fa):
    fa.run(proto.MinJerkJoint(q=HOME + [0.3, 0.1, -0.2, 0.2, 0.2, 0.1, 0.3], duration=600), block=False)
    running = fa.wait_for(lambda state: state.skill_id != 0 and state.phase == proto.RUNNING).skill_id
    unknown, garbled = request_of(proto.JointImpedance()), request_of(proto.JointImpedance())
    unknown.start_skill.skill.controller.type_url = "type.googleapis.com/frankapy.proto.FromTheFuture"
    garbled.start_skill.skill.trajectory.value = b"\x0a\xff\xff"
    for request in [request_of(message) for message, _ in BAD] + [unknown, garbled]:
        if request.HasField("start_skill"):
            request.start_skill.preempt = True
        with pytest.raises(FrankaArmArgumentError):
            fa._connection.ask(request)
    for name in ("joints: behind a wall", "pose: NaN", "tool: wrong frames"):
        with pytest.raises((FrankaArmArgumentError, FrankaArmBusyException)):
            REFUSED[name][0](fa)
    state = fa.get_arm_state()
    assert state.skill_id == running and not fa.is_skill_done()
    fa.stop_skill()
    result = fa.last_skill_result
    assert (result.skill_id, result.ending, result.limited_cycles, result.held_by) == (running, proto.STOPPED, 0, 0)
    fa.goto_joints(HOME, 1)
