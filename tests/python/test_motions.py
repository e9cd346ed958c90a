"""What the arm does, judged by the truth of the physics."""

import time
from contextlib import ExitStack

import numpy as np
import pytest
from conftest import HOME

from frankapy import FrankaArm, FrankaArmArgumentError, FrankaArmCommException, FrankaConstants, RigidTransform, kinematics, proto

TRUTH_FILE = True

# Pose in the truth: of the tool centre of the hand, which is the robot's end effector by default.


def tool_of(arm) -> RigidTransform:
    matrix = arm.simulation.truth().O_T_TCP
    return RigidTransform(matrix[:3, :3], matrix[:3, 3], "franka_tool", "world")


def errors(pose: RigidTransform, goal: RigidTransform) -> tuple[float, float]:
    """Return the distance in m and the angle in degrees."""
    turn = pose.rotation.T @ goal.rotation
    angle = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    return float(np.linalg.norm(pose.translation - goal.translation)), float(angle)


def moved(pose: RigidTransform, translation=(0, 0, 0), axis=(0, 0, 0)) -> RigidTransform:
    """Return a pose moved along the base's axes and turned about its own."""
    turned = pose.copy()
    turned.translation += translation
    turned.rotation = pose.rotation @ RigidTransform.rotation_from_axis_angle(np.array(axis, dtype=float))
    return turned


def in_tool(translation=(0, 0, 0), axis=(0, 0, 0), frame="franka_tool") -> RigidTransform:
    rotation = RigidTransform.rotation_from_axis_angle(np.array(axis, dtype=float))
    return RigidTransform(rotation, translation, frame, frame)


GOAL = HOME + [0.4, -0.2, 0.3, 0.3, -0.3, 0.4, 0.5]


@pytest.mark.parametrize("arm_fixture", ["ideal_arm", "default_arm"])
def test_goto_joints_by_the_robots_control_ends_within_a_milliradian(request, arm_fixture):
    arm = request.getfixturevalue(arm_fixture)
    with arm.client() as fa:
        fa.goto_joints(HOME, 1)
        fa.goto_joints(GOAL, 1.5)
        assert fa.last_skill_result.termination == "FinalJoint"
        np.testing.assert_allclose(arm.simulation.truth().q, GOAL, atol=0.001)


def test_goto_joints_is_a_minimum_jerk_curve(fa, ideal_arm):
    start = ideal_arm.cycle()
    fa.goto_joints(GOAL, 1.5)
    rows = ideal_arm.truth(since=start)
    share = (rows["q"] - HOME) @ (GOAL - HOME) / np.sum((GOAL - HOME) ** 2)
    first, last = np.searchsorted(share, [0.25, 0.75])
    # 10 r^3 - 15 r^4 + 6 r^5 passes a quarter at 0.35944 of the way and three quarters at the mirrored time.
    assert (last - first) / 1500 == pytest.approx(1 - 2 * 0.35944, abs=0.01)
    assert share.max() < 1.001


def test_goto_joints_by_the_servers_impedance(fa, ideal_arm):
    fa.goto_joints(GOAL, 1.5, use_impedance=True, buffer_time=0.5)
    np.testing.assert_allclose(ideal_arm.simulation.truth().q, GOAL, atol=0.005)


@pytest.mark.parametrize(("arm_fixture", "mm", "degrees"), [("ideal_arm", 2, 0.5), ("default_arm", 5, 1)])
def test_cartesian_impedance_ends_near_its_goal(request, arm_fixture, mm, degrees):
    arm = request.getfixturevalue(arm_fixture)
    with arm.client() as fa:
        fa.goto_joints(HOME, 1)
        for translation, axis in [([0.1, 0.15, -0.15], [0.3, 0.2, 0.4]), ([-0.05, -0.2, 0.05], [0, -0.3, 0])]:
            goal = moved(fa.get_pose(), translation, axis)
            fa.goto_pose(goal, 2)
            distance, angle = errors(tool_of(arm), goal)
            assert distance < mm / 1000
            assert angle < degrees


def test_goto_pose_by_the_robots_control_ends_at_its_goal(fa, ideal_arm):
    goal = moved(fa.get_pose(), [0.1, 0.1, -0.1], [0.2, 0, 0.3])
    fa.goto_pose(goal, 2, use_impedance=False)
    distance, angle = errors(tool_of(ideal_arm), goal)
    assert distance < 0.001
    assert angle < 0.1


@pytest.mark.parametrize("use_impedance", [True, False])
def test_a_difference_in_the_tools_frame_is_along_and_about_its_axes(fa, ideal_arm, use_impedance):
    delta = in_tool([0.02, 0.05, 0.08], [0, 0, 0.4])
    goal = tool_of(ideal_arm) * delta
    fa.goto_pose_delta(delta, 1.5, use_impedance=use_impedance)
    distance, angle = errors(tool_of(ideal_arm), goal)
    assert distance < 0.002
    assert angle < 0.5


def test_a_difference_in_the_base_is_along_its_axes_and_about_the_tools(fa, ideal_arm):
    start = tool_of(ideal_arm)
    fa.goto_pose_delta(in_tool([0.03, 0.06, -0.05], [0.3, 0, 0], "world"), 1.5, use_impedance=False)
    distance, angle = errors(tool_of(ideal_arm), moved(start, [0.03, 0.06, -0.05], [0.3, 0, 0]))
    assert distance < 0.001
    assert angle < 0.1


def test_a_tool_is_what_moves_to_the_pose(fa, ideal_arm):
    tool = RigidTransform(
        RigidTransform.z_axis_rotation(0.5), [0.02, 0.01, 0.05], from_frame="franka_tool", to_frame="franka_tool_base"
    )
    fa.set_tool_delta_pose(tool)
    goal = moved(fa.get_pose(), [0.05, -0.05, -0.05])
    fa.goto_pose(goal, 1.5, use_impedance=False)
    base = tool_of(ideal_arm).as_frames("franka_tool_base")
    assert errors(base * tool, goal)[0] < 0.001
    # Turned in place about the tool's tip, this stays where it is.
    tip = (base * tool).translation
    fa.goto_pose_delta(in_tool(axis=[0, 0.3, 0]), 1.5, use_impedance=False)
    base = tool_of(ideal_arm).as_frames("franka_tool_base")
    np.testing.assert_allclose((base * tool).translation, tip, atol=0.001)


def test_softer_springs_leave_more_of_the_friction(default_arm):
    left = {}
    with default_arm.client() as fa:
        for stiffness in (200, 2000):
            fa.goto_joints(HOME, 1)
            goal = moved(fa.get_pose(), [0.1, 0.1, -0.1])
            fa.goto_pose(goal, 1.5, cartesian_impedances=[stiffness] * 3 + [50] * 3)
            left[stiffness] = errors(tool_of(default_arm), goal)[0]
    assert left[2000] < left[200]


def test_reset_pose_and_reset_joints_lead_home(fa):
    fa.goto_joints(GOAL, 1)
    fa.reset_pose(2)
    np.testing.assert_allclose(fa.get_pose().translation, [0.3069, 0, 0.4867], atol=0.002)
    fa.reset_joints(1)
    np.testing.assert_allclose(fa.get_joints(), HOME, atol=0.001)


def test_reads_agree_with_the_truth_and_with_each_other(fa, ideal_arm):
    fa.goto_joints(GOAL, 1)
    truth = ideal_arm.simulation.truth()
    state = fa.get_robot_state()
    assert 0 <= state.age < 60
    np.testing.assert_allclose(fa.get_joints(), truth.q, atol=1e-4)
    np.testing.assert_allclose(state["joints"], truth.q, atol=1e-4)
    np.testing.assert_allclose(fa.get_pose().matrix, tool_of(ideal_arm).matrix, atol=1e-4)
    np.testing.assert_allclose(state["pose"].matrix, tool_of(ideal_arm).matrix, atol=1e-4)
    np.testing.assert_allclose(fa.get_joint_velocities(), 0, atol=0.01)
    np.testing.assert_allclose(fa.get_joint_torques(), truth.tau_J, atol=1)
    assert np.linalg.norm(fa.get_ee_force_torque()[:3]) < 2
    # Its own kinematics: of the frames of the links, and of the Jacobian by differences
    frames = fa.get_links_transforms(truth.q, use_rigid_transforms=True)
    np.testing.assert_allclose(frames[-1].matrix, tool_of(ideal_arm).matrix, atol=1e-4)
    numeric = [
        (fa.get_links_transforms(truth.q + e)[-1][:3, 3] - fa.get_links_transforms(truth.q - e)[-1][:3, 3]) / 2e-6
        for e in 1e-6 * np.eye(7)
    ]
    np.testing.assert_allclose(fa.get_jacobian(truth.q)[:3], np.transpose(numeric), atol=1e-6)


def test_poses_are_fresh_and_may_be_changed(fa):
    pose = fa.get_pose()
    pose.translation[2] -= 0.2
    assert fa.get_pose().translation[2] == pytest.approx(pose.translation[2] + 0.2, abs=1e-3)
    assert pose.translation.dtype == np.float64


def test_a_motion_too_fast_for_the_arm_is_stretched_and_arrives(fa, ideal_arm):
    start = ideal_arm.cycle()
    goal = HOME + [1.5, 0, 0, 0, 0, 0, 0]
    fa.goto_joints(goal, 0.2)
    assert fa.last_skill_result.stretch > 1.5
    rows = ideal_arm.truth(since=start)
    np.testing.assert_allclose(rows[-1]["q"], goal, atol=0.001)
    assert np.abs(rows["dq"][:, 0]).max() < 2.62 * 1.01  # rad/s, of the FR3


def test_numpy_numbers_and_tuples_are_taken(fa):
    fa.goto_joints(tuple(GOAL), np.float32(1), buffer_time=np.float64(0.1))
    fa.goto_pose(fa.get_pose(), np.int64(1), cartesian_impedances=tuple([600.0] * 3 + [50.0] * 3))


def test_the_gripper_arrives_before_its_call_returns(fa, ideal_arm):
    fa.open_gripper()
    assert fa.get_gripper_width() == pytest.approx(0.08, abs=0.002)
    fa.goto_gripper(0.03)
    assert ideal_arm.simulation.truth().finger.sum() == pytest.approx(0.03, abs=0.002)
    left, right = fa.get_finger_poses()
    along = fa.get_pose().rotation[:, 1]  # the hand's left finger is on the side of its y
    assert along @ (left.translation - right.translation) == pytest.approx(0.03, abs=0.002)
    fa.goto_gripper(0.07, block=False)
    fa.wait_for_gripper()
    assert fa.get_gripper_width() == pytest.approx(0.07, abs=0.002)
    assert fa.is_gripper_skill_done()


def test_whether_something_is_grasped_is_told_when_the_call_returns(fa):
    for _ in range(4):
        fa.goto_gripper(0.008, speed=0.1)
        assert not fa.get_gripper_is_grasped()
        fa.close_gripper()
        assert fa.get_gripper_is_grasped()
    fa.goto_gripper(0.008, block=False)
    while not fa.is_gripper_skill_done():
        time.sleep(0.01)
    assert not fa.get_gripper_is_grasped()


def test_a_grasp_that_names_no_force_grasps(fa):
    fa.goto_gripper(0.008)
    fa.goto_gripper(0, grasp=True, ignore_errors=False)
    assert fa.get_gripper_is_grasped()


def test_the_gripper_moves_while_the_arm_does(fa):
    fa.goto_gripper(0.08)
    fa.goto_joints(GOAL, 2, block=False)
    fa.goto_gripper(0.02)
    fa.wait_for_skill()
    assert fa.get_gripper_width() == pytest.approx(0.02, abs=0.002)
    np.testing.assert_allclose(fa.get_joints(), GOAL, atol=0.001)


def test_states_come_one_a_cycle(fa):
    with fa.states() as states:
        while (state := states.receive()) is None:
            pass
        cycles = [state.cycles]
        fa.goto_joints(GOAL, 0.5)
        running = 0
        while cycles[-1] < fa.last_skill_result.last_state.cycles:
            state = states.receive()
            cycles.append(state.cycles)
            running += state.phase == proto.RUNNING and state.skill_description == "GoToJoints"
    assert (np.diff(cycles) == 1).all()
    assert running >= 500
    with pytest.raises(FrankaArmCommException, match="closed"):
        states.receive()


def test_states_come_at_a_lower_rate_and_in_parts_as_well(fa):
    with fa.states(rate=50, fields=["cycles", "robot.q"]) as states:
        received = [states.receive() for _ in range(5)]
    assert (np.diff([state.cycles for state in received]) == 20).all()
    assert all(len(state.robot.q) == 7 and not state.robot.tau_J and not state.HasField("phase") for state in received)


@pytest.mark.nightly
def test_who_never_reads_costs_the_others_no_state(fa):
    with ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(fa.states())  # which wait for it until nobody has room for more
        states = stack.enter_context(fa.states(rate=100, fields=["cycles"]))
        fa.goto_joints(GOAL, 60)
        last = fa.last_skill_result.last_state.cycles
        cycles = [states.receive().cycles]
        while cycles[-1] < last - 10:
            cycles.append(states.receive().cycles)
    assert len(cycles) > 5000
    assert (np.diff(cycles) == 10).all()


def test_a_condition_is_waited_for(fa):
    once = iter([lambda: fa.goto_joints(GOAL, 2, block=False)])

    def passed_half(state):
        for start in once:  # now that states come
            start()
        return state.robot.q[0] > GOAL[0] / 2

    half = fa.wait_for(passed_half)
    assert half.robot.q[0] < GOAL[0] * 0.9
    assert half.phase == proto.RUNNING
    with pytest.raises(FrankaArmCommException, match="In 0.05 s no state"):
        fa.wait_for(lambda state: False, timeout=0.05)
    fa.wait_for_skill()


def test_constant_velocities_lead_so_far(fa):
    fa.execute_joint_velocities([0, 0, 0, 0, 0, 0, -0.2], [0] * 6 + [2], 1.1)
    np.testing.assert_allclose(fa.get_joints(), HOME + ([0] * 6 + [-0.2]), atol=0.002)
    start = fa.get_pose()
    fa.execute_cartesian_velocities([0, 0, -0.1, 0, 0, 0], [0, 0, 1, 0, 0, 0], 0.6, cartesian_impedances=[3000] * 3 + [300] * 3)
    distance, angle = errors(fa.get_pose(), moved(start, [0, 0, -0.05]))
    assert distance < 0.003
    assert angle < 0.3


@pytest.mark.parametrize("robot", ["fer", "fr3", "fr3v2"])
def test_every_arm_moves(start, robot):
    with start(robot=robot).client() as fa:
        fa.goto_joints(GOAL, 1)
        np.testing.assert_allclose(fa.get_joints(), GOAL, atol=0.002)
        fa.goto_pose(moved(fa.get_pose(), [0, 0, -0.05]), 1)
        assert fa._connection.welcome.model == robot


@pytest.mark.parametrize("protocol", range(5, 11))
def test_every_protocol_version_moves(start, protocol):
    with start(robot="fer" if protocol == 5 else "fr3", protocol=str(protocol)).client() as fa:
        assert fa._connection.welcome.protocol_version == protocol
        fa.goto_joints(GOAL, 1)
        np.testing.assert_allclose(fa.get_joints(), GOAL, atol=0.002)
        goal = moved(fa.get_pose(), [0, 0.05, -0.05])
        fa.goto_pose(goal, 1)
        assert errors(fa.get_pose(), goal)[0] < 0.005


@pytest.mark.parametrize("robot", ["fer", "fr3"])
def test_under_torque_control_the_tool_turns_as_far_as_it_can(start, robot):
    """Half a turn away from where the motion began, too."""
    with start(robot=robot, ideal=True).client() as fa:
        fa.goto_joints([*HOME[:6], -1.65], 2)
        fa.goto_joints([*HOME[:6], 1.65], 2, use_impedance=True, ignore_errors=False)
        assert fa.get_joints()[6] == pytest.approx(1.65, abs=0.01)


def test_two_arms_move_at_once():
    from frankapy.sim import SimulatedArm, Simulation

    with Simulation(SimulatedArm("fr3", lockstep=True), SimulatedArm("fer", lockstep=True)) as simulation:
        one, two = (FrankaArm(server=simulation.server, robot_num=n) for n in (1, 2))
        for arm, side in ((one, 1), (two, -1)):
            arm.goto_joints(HOME + [0.3 * side, 0, 0, 0, 0, 0, 0], 1, block=False)
        for arm, side in ((one, 1), (two, -1)):
            arm.wait_for_skill()
            assert arm.get_joints()[0] == pytest.approx(0.3 * side, abs=0.002)
            arm.close()


# --- inverse kinematics ---------------------------------------------------------------------------------------------------


def pose_at(fa, joints):
    matrix = fa.get_links_transforms(joints, use_rigid_transforms=True)[-1]
    return RigidTransform(matrix.rotation, matrix.translation, "franka_tool", "world")


def test_joints_for_a_pose_are_inside_the_limits_and_near(fa):
    random = np.random.default_rng(5)
    lower, upper = fa._rest_range()
    for tool in (None, RigidTransform(translation=[0.02, 0, 0.1], from_frame="franka_tool", to_frame="franka_tool_base")):
        if tool is not None:
            fa.set_tool_delta_pose(tool)
        for _ in range(8):
            joints = random.uniform(lower + 0.05, upper - 0.05)
            goal = pose_at(fa, joints)
            found = fa.ik(goal)
            reached = pose_at(fa, found)
            np.testing.assert_allclose(reached.matrix, goal.matrix, atol=5e-6)
            assert np.all((lower <= found) & (found <= upper))
            np.testing.assert_allclose(fa.ik(goal, near=joints), joints, atol=1e-4)


def test_the_arm_goes_where_inverse_kinematics_says(fa):
    pose = fa.get_pose()
    pose.translation += [0.08, 0.15, -0.1]
    joints = fa.ik(pose)
    fa.goto_joints(joints, 2)
    np.testing.assert_allclose(fa.get_pose().matrix, pose.matrix, atol=2e-3)
    # Near in the redundant motion: less far than straight home and there
    assert np.abs(joints - HOME).max() < 0.6


@pytest.mark.parametrize("duration", [None, 1.5])
def test_a_pose_beyond_the_base_is_gone_to_by_joints(fa, ideal_arm, duration):
    behind = pose_at(fa, HOME + [2.4, 0, 0, 0, 0, 0, 0])
    fa.goto_pose_by_joints(behind, duration, ignore_virtual_walls=True)
    result = fa.last_skill_result
    assert (result.ending, result.termination) == (proto.TERMINATED, "FinalJoint")
    assert duration is None or result.time == pytest.approx(duration, abs=0.3)
    np.testing.assert_allclose(ideal_arm.simulation.truth().O_T_TCP[:3, 3], behind.translation, atol=5e-4)
    fa.goto_joints(HOME, 2, ignore_virtual_walls=True)


def test_a_pose_is_gone_to_with_the_elbow_where_it_is_to_be(fa):
    pose = fa.get_pose()
    for side in (-0.5, 0.5):
        near = HOME + [-1.55 * side, 0, side, 0, 0.7 * side, 0, -0.84 * side]
        fa.goto_pose_by_joints(pose, near=near, use_impedance=True)
        np.testing.assert_allclose(fa.get_pose().matrix, pose.matrix, atol=3e-3)
        assert fa.get_joints()[2] == pytest.approx(side, abs=0.1)


def test_a_pose_that_is_not_gone_to_by_joints_moves_nothing(fa):
    pose = fa.get_pose()
    pose.translation = [1.2, 0, 0.4]
    with pytest.raises(FrankaArmArgumentError, match="not reachable! The joints come as near as"):
        fa.goto_pose_by_joints(pose)
    pose.translation = [0.5, 0, -0.1]
    with pytest.raises(FrankaArmArgumentError, match="goto_pose_by_joints"):
        fa.goto_pose_by_joints(pose)  # behind the workspace's floor
    with pytest.raises(FrankaArmArgumentError, match="near has 6 elements"):
        fa.goto_pose_by_joints(fa.get_pose(), near=HOME[:6])
    np.testing.assert_allclose(fa.get_joints(), HOME, atol=1e-3)


def test_of_several_ways_to_hold_the_arm_the_nearest_is_found():
    lower, upper = np.array(FrankaConstants.JOINT_LIMITS_MIN), np.array(FrankaConstants.JOINT_LIMITS_MAX)
    random = np.random.default_rng(3)
    for _ in range(10):
        near, goal = random.uniform(lower, upper, (2, 7))
        flange = kinematics.link_frames(goal)[8]
        found, *error = kinematics.inverse(flange, near, lower, upper)
        assert max(error) < kinematics.REACHED
        assert np.linalg.norm(found - near) < 1.5 * np.linalg.norm(goal - near), (near, goal)


def test_poses_out_of_reach_are_refused_with_the_nearest(fa):
    pose = fa.get_pose()
    pose.translation[:] = [1.2, 0, 0.4]
    with pytest.raises(FrankaArmArgumentError, match="not reachable! The joints come as near as"):
        fa.ik(pose)
    with FrankaArm(offline=True) as offline:
        home = offline.ik(pose_at(offline, HOME))
        np.testing.assert_allclose(home, HOME, atol=1e-4)
