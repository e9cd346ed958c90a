"""What scripts published for frankapy rely on: names, numbers, helpers, and rospy's stand-in."""

import ast
import importlib.util
import inspect
import os
import pickle
import subprocess
import sys
import textwrap
import time
import types
from pathlib import Path

import numpy as np
import pytest
from conftest import HOME

import frankapy
from frankapy import (
    FrankaArm,
    FrankaArmArgumentError,
    FrankaArmException,
    FrankaArmStateClient,
    RigidTransform,
    SensorDataMessageType,
    proto,
)
from frankapy import FrankaConstants as FC
from frankapy.cli import COMPAT
from frankapy.collision_boxes import as_box, meet
from frankapy.proto_utils import make_sensor_group_msg, messages_of, sensor_proto2ros_msg
from frankapy.ros_messages import Header, RobotState, SensorData, SensorDataGroup
from frankapy.ros_utils import BoxesPublisher
from frankapy.sim import SimulatedArm, Simulation
from frankapy.utils import convert_array_to_rigid_transform
from frankapy.walls import from_boxes

METHODS = """
    apply_effector_forces_along_axis apply_effector_forces_torques apply_joint_torques check_box_collision close_gripper
    execute_cartesian_velocities execute_joint_dmp execute_joint_torques execute_joint_velocities execute_pose_dmp
    execute_quaternion_pose_dmp get_collision_boxes_poses get_ee_force_torque get_finger_poses get_gripper_is_grasped
    get_gripper_width get_jacobian get_joint_torques get_joint_velocities get_joints get_links_transforms get_pose
    get_robot_state get_speed get_tool_base_pose goto_gripper goto_joints goto_pose goto_pose_delta home_gripper
    is_joints_in_collision_with_boxes is_joints_reachable is_skill_done open_gripper publish_collision_boxes publish_joints
    publish_sensor_values reset_joints reset_pose run_dynamic_force_position run_guide_mode selective_guidance_mode set_speed
    set_tool_delta_pose stop_gripper stop_skill wait_for_franka_interface wait_for_gripper wait_for_skill
    publish_sensor_data log_info get_time is_gripper_skill_done
""".split()

T = "buffer_time=0.2 force_thresholds=None torque_thresholds=None"
I = "cartesian_impedances=None joint_impedances=None"
G = "k_gains=None d_gains=None"
B = "block=True ignore_errors=True"
W = "ignore_virtual_walls=False"
SIGNATURES = f"""
    goto_pose tool_pose duration=3 use_impedance=True dynamic=False {T} {I} {B} {W} skill_desc='GoToPose'
    goto_pose_delta delta_tool_pose duration=3 use_impedance=True {T} {I} {B} {W} skill_desc='GoToPoseDelta'
    goto_joints joints duration=5 use_impedance=False dynamic=False {T} {I} {G} {B} {W} skill_desc='GoToJoints'
    execute_cartesian_velocities cartesian_velocities cartesian_accelerations duration=5 dynamic=False {T} {I} {B} {W}
        skill_desc='ExecutecartesianVelocities'
    execute_joint_velocities joint_velocities joint_accelerations duration=5 dynamic=False {T} {I} {B} {W}
        skill_desc='ExecuteJointVelocities'
    execute_joint_torques joint_torques selection remove_gravity duration=5 dynamic=False {T} {G} {B} {W}
        skill_desc='ExecuteJointTorques'
    execute_joint_dmp joint_dmp_info duration initial_sensor_values=None use_impedance=False {T} {I} {G} {B} skill_desc='JointDmp'
    execute_pose_dmp pose_dmp_info duration use_goal_formulation=False initial_sensor_values=None orientation_only=False
        position_only=False ee_frame=False use_impedance=True {T} {I} {B} skill_desc='PoseDmp'
    execute_quaternion_pose_dmp position_dmp_info quat_dmp_info duration goal_quat goal_quat_time use_goal_formulation=False
        initial_sensor_values=None ee_frame=False use_impedance=True {T} {I} {B} skill_desc='QuaternionPoseDmp'
    apply_effector_forces_torques run_duration acc_duration max_translation max_rotation forces=None torques=None {T} {B}
        skill_desc='ForceTorque'
    apply_effector_forces_along_axis run_duration acc_duration max_translation forces {T} {B} skill_desc='ForcesAlongAxis'
    run_guide_mode duration=10 block=True skill_desc='GuideMode'
    selective_guidance_mode duration=5 use_joints=False use_impedance=False use_ee_frame=False {T} {I} {G} {B} {W}
        skill_desc='SelectiveGuidance'
    run_dynamic_force_position duration=3 {T} position_kps_cart force_kps_cart position_kps_joint force_kps_joint S
        interpolate=False use_cartesian_gains=True ignore_errors=True {W} skill_desc=''
    reset_joints duration=5 {B} skill_desc=''
    reset_pose duration=5 {B} skill_desc=''
    goto_gripper width grasp=False speed=0.04 force=0.0 epsilon_inner=0.08 epsilon_outer=0.08 {B} skill_desc='GoToGripper'
    open_gripper block=True skill_desc='OpenGripper'
    close_gripper grasp=True block=True skill_desc='CloseGripper'
    home_gripper block=True skill_desc='HomeGripper'
    stop_gripper block=True skill_desc='StopGripper'
    wait_for_franka_interface timeout=None
    is_skill_done ignore_errors=True
    get_pose include_tool_offset=True
    get_links_transforms joints use_rigid_transforms=False
    get_collision_boxes_poses joints=None use_rigid_transforms=False
    check_box_collision box joints=None
    is_joints_in_collision_with_boxes joints=None boxes=None
    apply_joint_torques torques duration ignore_errors=True skill_desc=''
    publish_sensor_values sensor_values=None
"""
CONSTANTS = """
    HOME_JOINTS HOME_POSE READY_JOINTS READY_POSE JOINT_LIMITS_MIN JOINT_LIMITS_MAX DEFAULT_TERM_BUFFER_TIME
    DYNAMIC_SKILL_WAIT_TIME GRIPPER_CMD_SLEEP_TIME ACTION_WAIT_LOOP_TIME DEFAULT_FRANKA_INTERFACE_TIMEOUT DEFAULT_POSE_THRESHOLDS
    DEFAULT_JOINT_THRESHOLDS GRIPPER_WIDTH_MAX GRIPPER_WIDTH_MIN GRIPPER_MAX_FORCE MAX_LIN_MOMENTUM MAX_ANG_MOMENTUM
    MAX_LIN_MOMENTUM_CONSTRAINED DEFAULT_K_GAINS DEFAULT_D_GAINS DEFAULT_TRANSLATIONAL_STIFFNESSES DEFAULT_ROTATIONAL_STIFFNESSES
    DEFAULT_JOINT_IMPEDANCES DEFAULT_CARTESIAN_IMPEDANCES DEFAULT_FORCE_AXIS_TRANSLATIONAL_STIFFNESS
    DEFAULT_FORCE_AXIS_ROTATIONAL_STIFFNESS DEFAULT_HFPC_FORCE_GAIN DEFAULT_HFPC_S DEFAULT_LOWER_TORQUE_THRESHOLDS_ACCEL
    DEFAULT_UPPER_TORQUE_THRESHOLDS_ACCEL DEFAULT_LOWER_TORQUE_THRESHOLDS_NOMINAL DEFAULT_UPPER_TORQUE_THRESHOLDS_NOMINAL
    DEFAULT_LOWER_FORCE_THRESHOLDS_ACCEL DEFAULT_UPPER_FORCE_THRESHOLDS_ACCEL DEFAULT_LOWER_FORCE_THRESHOLDS_NOMINAL
    DEFAULT_UPPER_FORCE_THRESHOLDS_NOMINAL DH_PARAMS N_REV_JOINTS COLLISION_BOX_SHAPES COLLISION_BOX_LINKS COLLISION_BOX_POSES
    WORKSPACE_WALLS JOINT_NAMES DEFAULT_SENSOR_PUBLISHER_TOPIC EMPTY_SENSOR_VALUES LOGGING_LEVEL
""".split()
SENSOR_MESSAGES = """
    PosePositionSensorMessage id timestamp position quaternion
    PosePositionVelocitySensorMessage id timestamp seg_run_time position quaternion pose_velocities
    JointPositionSensorMessage id timestamp joints
    JointPositionVelocitySensorMessage id timestamp seg_run_time joints joint_vels
    JointVelocitySensorMessage id timestamp joint_velocities
    CartesianVelocitySensorMessage id timestamp cartesian_velocities
    ForcePositionSensorMessage id timestamp seg_run_time pose force
    ForcePositionControllerSensorMessage id timestamp position_kps_cart force_kps_cart position_kps_joint force_kps_joint selection
    CartesianImpedanceSensorMessage id timestamp translational_stiffnesses rotational_stiffnesses
    JointTorqueControllerSensorMessage id timestamp selection remove_gravity joint_torques k_gains d_gains
    ShouldTerminateSensorMessage timestamp should_terminate
    BoundingBox name id x y w h
"""
SKILL_METHODS = """
    set_meta_skill_type set_meta_skill_id add_initial_sensor_values add_trajectory_params add_feedback_controller_params
    add_termination_params add_timer_params set_cartesian_impedances set_joint_impedances add_cartesian_impedances
    add_force_axis_params add_internal_impedances add_joint_torques add_force_position_params add_joint_gains
    check_for_contact_params add_contact_termination_params add_joint_threshold_params add_pose_threshold_params
    add_time_termination_params add_gripper_params add_impulse_params add_goal_cartesian_velocities add_goal_pose add_goal_joints
    add_goal_joint_velocities add_joint_dmp_params add_pose_dmp_params add_quaternion_pose_dmp_params add_run_time create_goal
    feedback_callback
""".split()


def run_script(text, server="", **options):
    """Run a script as one for ROS is run here; return what it printed."""
    environment = os.environ | {"PYTHONPATH": str(COMPAT), "FRANKA_INTERFACE_SERVER": server}
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(text)], env=environment, capture_output=True, text=True, timeout=300, check=False, **options
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


# --- names and numbers -----------------------------------------------------------------------------------------------


def test_every_method_is_there_and_says_what_it_does():
    for name in METHODS:
        assert inspect.getdoc(getattr(FrankaArm, name)), name


def test_arguments_have_their_places_and_defaults():
    for line in SIGNATURES.replace("\n        ", " ").strip().splitlines():
        name, *expected = line.split()
        parameters = list(inspect.signature(getattr(FrankaArm, name)).parameters.values())[1:]
        assert [parameter.name for parameter in parameters] == [each.split("=")[0] for each in expected], name
        defaults = {each.split("=")[0]: each.split("=")[1] for each in expected if "=" in each}
        for parameter in parameters:
            if parameter.name in defaults:
                assert parameter.default == ast.literal_eval(defaults[parameter.name]), f"{name}: {parameter.name}"
    constructor = list(inspect.signature(FrankaArm.__init__).parameters)[1:8]
    assert constructor == ["rosnode_name", "ros_log_level", "robot_num", "with_gripper", "old_gripper", "offline", "init_node"]
    assert {"node_name", "init_rclpy"} <= set(inspect.signature(FrankaArm.__init__).parameters)


def test_every_constant_and_every_field_of_a_sensor_message_is_there():
    assert not [name for name in CONSTANTS if not hasattr(FC, name)]
    for line in SENSOR_MESSAGES.strip().splitlines():
        name, *fields = line.split()
        assert [field.name for field in getattr(proto, name).DESCRIPTOR.fields][: len(fields)] == fields, name


def test_a_skill_is_described_as_it_was_sent():
    from frankapy.skill_list import Skill

    assert all(inspect.getdoc(getattr(Skill, name)) for name in SKILL_METHODS)
    skill = Skill(
        frankapy.SkillType.ImpedanceControlSkill,
        frankapy.TrajectoryGeneratorType.JointDmpTrajectoryGenerator,
        feedback_controller_type=frankapy.FeedbackControllerType.JointImpedanceFeedbackController,
        termination_handler_type=frankapy.TerminationHandlerType.TimeTerminationHandler,
        skill_desc="a dmp",
    )
    info = dict(tau=0.5, alpha=60, beta=15, num_basis=2, num_sensors=1, mu=[1, 0.8], h=[50, 50], weights=np.ones((7, 1, 2)))
    skill.add_joint_dmp_params(3, info, [1])
    skill.set_joint_impedances(True, None, None, None, None)
    skill.add_time_termination_params(buffer_time=0.2)
    goal = skill.create_goal()
    assert (goal.skill_type, goal.trajectory_generator_type, goal.skill_description) == (4, 6, "a dmp")
    trajectory = proto.JointDMPTrajectoryGeneratorMessage.FromString(goal.trajectory_generator_param_data)
    assert trajectory.run_time == 3 and len(trajectory.weights) == 14 and list(trajectory.basis_mean) == [1, 0.8]
    gains = proto.JointImpedanceFeedbackControllerMessage.FromString(goal.feedback_controller_param_data)
    assert list(gains.k_gains) == FC.DEFAULT_K_GAINS
    assert not skill.check_for_contact_params(0.2, None, None) and skill.check_for_contact_params(0.2, [10] * 6, None)
    contact = proto.ContactTerminationHandlerMessage.FromString(goal.termination_handler_param_data)
    assert goal.termination_handler_type == 0 and len(contact.force_thresholds) == 6 and not contact.torque_thresholds
    skill.add_quaternion_pose_dmp_params(
        False, 3, info | {"weights": np.ones(6)}, info | {"weights": np.zeros(6)}, [1, 1, 1], [1, 0, 0, 0], 2
    )
    turn = proto.QuaternionPoseDMPTrajectoryGeneratorMessage.FromString(goal.trajectory_generator_param_data)
    assert turn.tau_pos == turn.tau_quat == 0.5 and turn.goal_quat_w == 1 and list(turn.pos_weights) == [1] * 6
    for call, text in (
        (lambda: skill.add_goal_joints(3, [0] * 6), "joints has 6 elements: expected 7"),
        (lambda: skill.add_run_time(-1), "run_time is -1: expected at least 0"),
        (lambda: skill.add_joint_dmp_params(3, info | {"weights": [1]}, [1]), "weights has 1 elements: expected 14"),
    ):
        with pytest.raises(FrankaArmArgumentError, match=text):
            call()


@pytest.mark.parametrize(
    "call",
    [
        lambda fa: fa.goto_joints(HOME, duration=-1),
        lambda fa: fa.goto_pose(FC.HOME_POSE, force_thresholds=[10] * 5),
        lambda fa: fa.goto_joints(HOME, torque_thresholds=[10] * 6),
        lambda fa: fa.goto_joints(HOME, force_thresholds=10),
        lambda fa: fa.goto_joints(HOME, use_impedance=True, k_gains=[1] * 6, d_gains=[1] * 7),
        lambda fa: fa.goto_pose(FC.HOME_POSE, cartesian_impedances=[600] * 3),
        lambda fa: convert_array_to_rigid_transform(np.zeros(15)),
    ],
)
def test_what_was_asserted_may_be_caught_as_that(call):
    for kind in (AssertionError, ValueError, FrankaArmException):
        with pytest.raises(kind):
            call(FrankaArm(offline=True))


def test_what_is_imported_from_where():
    from frankapy.exceptions import FrankaArmCommException, FrankaArmException, FrankaArmFrankaInterfaceNotReadyException
    from frankapy.franka_interface_common_definitions import SkillStatus, TrajectoryGeneratorType
    from frankapy.proto import PoseThresholdMessage, sensor_msg_pb2

    assert issubclass(FrankaArmCommException, FrankaArmException)
    assert issubclass(FrankaArmFrankaInterfaceNotReadyException, FrankaArmException)
    assert sensor_msg_pb2.BoundingBox is proto.BoundingBox
    assert list(PoseThresholdMessage(buffer_time=0.2, position_thresholds=[1, 2, 3]).position_thresholds) == [1, 2, 3]
    assert SkillStatus.VIRT_COLL_ERR == 3
    assert TrajectoryGeneratorType.StayInInitialPoseTrajectoryGenerator == 25
    assert frankapy.FeedbackControllerType.SetInternalImpedanceFeedbackController == 8
    assert frankapy.TerminationHandlerType.TimeTerminationHandler == 4
    assert frankapy.SkillType.JointVelocitySkill == 6
    assert SensorDataMessageType.JOINT_POSITION == 6 and SensorDataMessageType.SHOULD_TERMINATE == 11


def test_messages_that_describe_parts_are_messages():
    names = [name for name in vars(proto) if name.endswith(("GeneratorMessage", "ControllerMessage", "HandlerMessage"))]
    names += ["RunTimeMessage", "JointThresholdMessage", "PoseThresholdMessage"]
    assert len(set(names)) == 20
    message = proto.ImpulseTrajectoryGeneratorMessage(run_time=1, acc_time=0.2, max_trans=0, max_rot=0, forces=np.arange(3))
    again = type(message).FromString(message.SerializeToString())
    assert again == message and list(again.forces) == [0, 1, 2]
    with pytest.raises(Exception, match="run_time"):
        proto.ImpulseTrajectoryGeneratorMessage().SerializeToString()


def test_without_the_folder_there_is_no_rospy():
    assert subprocess.run([sys.executable, "-c", "import rospy"], capture_output=True, check=False).returncode == 1


# --- helpers ---------------------------------------------------------------------------------------------------------


def test_groups_hold_what_was_packed():
    pose = proto.PosePositionSensorMessage(id=1, timestamp=0.1, position=np.ones(3), quaternion=[1, 0, 0, 0])
    end = proto.ShouldTerminateSensorMessage(timestamp=0.1, should_terminate=True)
    packed = sensor_proto2ros_msg(pose, SensorDataMessageType.POSE_POSITION, info="a pose")
    assert (packed.type, packed.info, packed.size) == (10, "a pose", len(packed.sensorData))
    group = make_sensor_group_msg(
        trajectory_generator_sensor_msg=packed,
        termination_handler_sensor_msg=sensor_proto2ros_msg(end, SensorDataMessageType.SHOULD_TERMINATE),
    )
    assert group.has_trajectory_generator_sensor_data and not group.has_feedback_controller_sensor_data
    assert messages_of(group) == [pose, end]


@pytest.mark.parametrize("kind", [SensorData, SensorDataGroup])
def test_sensor_messages_have_headers_of_their_own(kind):
    kind().header.stamp = 1.5
    assert kind().header == Header()


def test_what_does_not_fit_its_type_is_refused():
    with pytest.raises(FrankaArmArgumentError, match="a ShouldTerminateSensorMessage as type 10: expected PosePos"):
        sensor_proto2ros_msg(proto.ShouldTerminateSensorMessage(), SensorDataMessageType.POSE_POSITION)
    for data in (SensorData(type=99), SensorData(type=10, sensorData=b"\xff\xff")):
        with pytest.raises(FrankaArmArgumentError, match=f"trajectory generator's sensor data is of type {data.type} and has"):
            messages_of(make_sensor_group_msg(trajectory_generator_sensor_msg=data))


def test_boxes_meet_where_they_have_a_point_in_common():
    random = np.random.default_rng(0)
    found = {True: 0, False: 0}
    for _ in range(300):
        boxes = [as_box(np.r_[random.uniform(-0.4, 0.4, 3), random.uniform(-3, 3, 3), random.uniform(0.05, 0.5, 3)]) for _ in range(2)]
        (pose, size), (other, other_size) = boxes
        points = random.uniform(-0.5, 0.5, (20000, 3)) * size @ pose[:3, :3].T + pose[:3, 3]
        inside = np.abs((points - other[:3, 3]) @ other[:3, :3]) <= other_size / 2
        answer = meet(*boxes[0], *boxes[1])
        assert answer == meet(*boxes[1], *boxes[0])
        if inside.all(axis=1).any():
            assert answer
        else:  # at most they touch: a little smaller they do not
            assert not meet(pose, 0.9 * size, other, 0.9 * other_size)
        found[answer] += 1
    assert min(found.values()) > 50


def test_collision_thresholds_are_those_published():
    assert FC.DEFAULT_UPPER_TORQUE_THRESHOLDS_ACCEL[:4] == [120, 120, 120, 118]
    assert FC.DEFAULT_UPPER_TORQUE_THRESHOLDS_NOMINAL[:4] == [120, 120, 118, 118]


def test_torques_that_were_never_applied_are_not_now(caplog):
    assert FrankaArm(offline=True).apply_joint_torques([0] * 7, 1) is None
    assert "moves nothing" in caplog.text


def test_the_arm_as_boxes():
    fa = FrankaArm(offline=True)
    tool = fa.get_links_transforms(HOME)[-1][:3, 3]
    assert len(fa.get_collision_boxes_poses(HOME)) == len(FC.COLLISION_BOX_SHAPES) == 12
    poses = fa.get_collision_boxes_poses(HOME, use_rigid_transforms=True)
    assert (poses[3].from_frame, poses[3].to_frame) == ("box3", "world")
    assert fa.check_box_collision([*tool, 0, 0, 0, 0.1, 0.1, 0.2], HOME)
    assert not fa.check_box_collision(np.array([*tool - [0, 0, 0.3], 0, 0, 0, 0.1, 0.1, 0.1]), HOME)
    assert not fa.is_joints_in_collision_with_boxes(HOME)
    assert fa.is_joints_in_collision_with_boxes(HOME, boxes=[[*tool, 0, 0, 0.7, 0.1, 0.1, 0.2]])
    for none in ([], np.empty((0, 9))):
        assert not fa.is_joints_in_collision_with_boxes(HOME, boxes=none) and not from_boxes(none)
    assert fa.is_joints_in_collision_with_boxes([-0.16, 1.12, 0.26, -0.67, 0.05, 2.08, 0.82])  # behind the front wall
    with pytest.raises(FrankaArmArgumentError, match="box has 3 elements: expected 9"):
        fa.check_box_collision([1, 2, 3], HOME)


def test_boxes_are_rows_of_nine_or_ten():
    publisher = BoxesPublisher("boxes")
    publisher.publish_boxes([np.zeros(9), np.zeros(10)])
    with pytest.raises(ValueError, match="Invalid format for box"):
        publisher.publish_boxes([np.zeros(8)])


def test_poses_survive_being_pickled():
    pose = RigidTransform(RigidTransform.z_axis_rotation(0.3), [1, 2, 3], "franka_tool", "world")
    again = pickle.loads(pickle.dumps([pose]))[0]
    np.testing.assert_array_equal(again.matrix, pose.matrix)
    assert (again.from_frame, again.to_frame) == ("franka_tool", "world")


def test_a_state_has_its_fields_in_any_letters():
    state = RobotState(proto.ArmState(robot=proto.RobotState(q=[1] * 7, O_T_EE=[0] * 16, errors=["joint_reflex"])))
    assert state.q == (1,) * 7 and state.o_t_ee == state.O_T_EE == (0,) * 16
    assert state.current_errors.joint_reflex and not state.current_errors.cartesian_reflex
    with pytest.raises(AttributeError, match="no 'qq'"):
        _ = state.qq


# --- rospy's stand-in ------------------------------------------------------------------------------------------------


def test_times_and_durations_count_as_in_ros():
    run_script("""
        import numpy as np
        import rospy
        one, half = rospy.Time(1, 0), rospy.Duration(0.5)
        assert rospy.Duration(np.float32(0.5)) == half and rospy.Time(np.int64(2**60 // 10**9), np.int64(1)).nsecs == 1
        assert (one + half).to_sec() == 1.5 and (one - half).to_nsec() == 500_000_000
        assert one - rospy.Time(0, 250_000_000) == rospy.Duration(0, 750_000_000)
        assert (half * 3).to_sec() == 1.5 and half / rospy.Duration(2) == 0.25 and -half < half
        assert rospy.Duration.from_sec(2.25).secs == 2 and rospy.Duration.from_sec(2.25).nsecs == 250_000_000
        assert abs(rospy.Time.now().to_time() - rospy.get_time()) < 1 and rospy.Time().is_zero()
        assert rospy.Time(3) == rospy.Time(3) and rospy.Time(3) != rospy.Duration(3)
    """)


def test_a_rate_is_kept_and_a_timer_calls():
    run_script("""
        import time, rospy
        rospy.init_node("test", anonymous=True)
        calls = []
        timer = rospy.Timer(rospy.Duration(0.02), lambda event: calls.append(event.current_real))
        once = rospy.Timer(rospy.Duration(0.02), lambda event: calls.append("once"), oneshot=True)
        begin = time.monotonic()
        rate = rospy.Rate(50)
        for _ in range(25):
            rate.sleep()
        assert time.monotonic() - begin > 0.48
        while len(calls) <= 5 and time.monotonic() - begin < 60:
            time.sleep(0.01)
        timer.shutdown()
        assert calls.count("once") == 1 and len(calls) > 5
        ended = []
        rospy.on_shutdown(lambda: ended.append(1))
        rospy.signal_shutdown("enough")
        assert rospy.is_shutdown() and ended == [1]
        rospy.spin()
        try:
            rospy.sleep(1)
        except rospy.ROSInterruptException:
            ended.append(2)
        assert ended == [1, 2]
    """)


def test_what_runs_beside_the_main_thread_sees_ctrl_c():
    out = run_script("""
        import os, signal, threading, time
        import rospy
        rospy.init_node("test")
        rospy.on_shutdown(lambda: print("hook", flush=True))

        def work():
            while not rospy.is_shutdown():
                time.sleep(0.01)
            try:
                rospy.sleep(100)
            except rospy.ROSInterruptException:
                print("worker ended", flush=True)

        worker = threading.Thread(target=work)  # the program waits for its end
        worker.start()
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(100)
        except KeyboardInterrupt:
            worker.join()
            rospy.spin()
            print("saved", flush=True)
    """)
    assert out.split("\n") == ["worker ended", "saved", "hook", ""]


def test_log_lines_and_topics_of_ones_own():
    out = run_script("""
        import rospy
        from autolab_core import Point, RigidTransform
        from sensor_msgs.msg import JointState
        rospy.loginfo("%d joints", 7)
        rospy.logdebug("not this")
        for _ in range(3):
            rospy.loginfo_once("only once")
        got = []
        rospy.Subscriber("own", JointState, lambda message, extra: got.append((message.name, extra)), callback_args=5)
        rospy.Publisher("/own", JointState, queue_size=1).publish(name=["a"])
        while not got:
            rospy.sleep(0.01)
        assert got == [(["a"], 5)]

        latching = rospy.Publisher("/kept", JointState, queue_size=1, latch=True)
        for name in ("first", "last"):
            latching.publish(name=[name])
        rospy.Publisher("/lost", JointState, queue_size=1).publish(name=["nobody listens"])
        assert rospy.wait_for_message("/kept", JointState, timeout=60).name == ["last"]
        latching.unregister()
        for topic in ("/kept", "/lost"):
            try:
                rospy.wait_for_message(topic, JointState, timeout=0.05)
            except rospy.ROSException:
                got.append(topic)
        assert got[1:] == ["/kept", "/lost"]
        p = RigidTransform(translation=[0, 0, 1], from_frame="camera") * Point([1, 2, 3], "camera")
        assert list(p.data) == [1, 2, 4] and p.frame == "world"
    """)
    assert "]: 7 joints" in out and out.count("only once") == 1 and "not this" not in out


def test_a_subscriber_listens_to_the_server_that_there_is():
    run_script(f"""
        import os, sys, time
        import rospy, zmq
        sys.path.append({str(Path(__file__).parent)!r})
        from frankapy import proto
        from franka_interface_msgs.msg import RobotState
        from scripted_server import ScriptedServer

        got, port = [], 0
        with zmq.Context() as context:
            for number in (1, 2):  # servers, each with another port for its states
                with context.socket(zmq.PUB) as states, ScriptedServer(port=port) as server:
                    states.bind("tcp://127.0.0.1:*")
                    server.state_endpoint = states.last_endpoint.decode()
                    if number == 1:
                        os.environ["FRANKA_INTERFACE_SERVER"] = server.address
                        port = int(server.address.rpartition(":")[2])
                        rospy.Subscriber("/robot_state_publisher_node_1/robot_state", RobotState, got.append)
                    deadline = time.monotonic() + 100
                    while not (got and got[-1].q[0] == number):
                        assert time.monotonic() < deadline
                        state = proto.ArmState(robot=proto.RobotState(q=[number] * 7))
                        states.send(b"10" + bytes(1) + state.SerializeToString())
                        time.sleep(0.01)
            rospy.signal_shutdown("enough")
    """)


def test_poses_that_a_lab_has_pickled_are_read_without_autolab_core(tmp_path, monkeypatch):
    name = "autolab_core.rigid_transformations"
    module = types.ModuleType(name)
    module.RigidTransform = type("RigidTransform", (), {"__module__": name})  # as the real one writes itself
    monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setitem(sys.modules, "autolab_core", types.ModuleType("autolab_core"))
    pose = module.RigidTransform()
    vars(pose).update(_rotation=np.eye(3), _translation=np.array([0.4, 0, 0.3]), _from_frame="franka_tool", _to_frame="world")
    (tmp_path / "poses.pkl").write_bytes(pickle.dumps([pose]))
    run_script(f"""
        import pickle
        from frankapy import RigidTransform
        (pose,) = pickle.load(open({str(tmp_path / "poses.pkl")!r}, "rb"))
        assert type(pose) is RigidTransform
        assert list(pose.translation) == [0.4, 0, 0.3] and (pose.from_frame, pose.to_frame) == ("franka_tool", "world")
    """)


# A class that is not frankapy's, with as much of autolab_core's interface as frankapy may use, and as strict.
AUTOLAB_CORE = """
    import numpy as np

    class RigidTransform:
        def __init__(self, rotation=np.eye(3), translation=np.zeros(3), from_frame="unassigned", to_frame="world"):
            assert isinstance(from_frame, str) and isinstance(to_frame, str)
            self._from_frame, self._to_frame = from_frame, to_frame
            self.rotation, self.translation = rotation, translation

        from_frame = property(lambda self: self._from_frame)
        to_frame = property(lambda self: self._to_frame)
        rotation = property(lambda self: self._rotation)
        translation = property(lambda self: self._translation)

        @rotation.setter
        def rotation(self, rotation):
            if np.size(rotation) == 4:
                rotation = self.rotation_from_quaternion(rotation)
            self._rotation = np.array(rotation, dtype=float)
            if self._rotation.shape != (3, 3) or abs(np.linalg.det(self._rotation) - 1) > 1e-3:
                raise ValueError("Illegal rotation")

        @translation.setter
        def translation(self, translation):
            self._translation = np.array(translation, dtype=float).reshape(3)

        @property
        def matrix(self):
            return np.vstack([np.column_stack([self._rotation, self._translation]), [0, 0, 0, 1]])

        @property
        def quaternion(self):  # an eigenvector of this symmetric matrix, of which eigh reads one half
            r = self._rotation
            matrix = np.diag(np.r_[2 * np.diag(r) - np.trace(r), np.trace(r)])
            matrix[[1, 2, 2], [0, 0, 1]] = r[1, 0] + r[0, 1], r[2, 0] + r[0, 2], r[2, 1] + r[1, 2]
            matrix[3, :3] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
            x, y, z, w = np.linalg.eigh(matrix)[1][:, -1]
            return np.array([w, x, y, z]) * (1 if w >= 0 else -1)

        @staticmethod
        def rotation_from_quaternion(q_wxyz):
            w, *v = np.array(q_wxyz) / np.linalg.norm(q_wxyz)
            cross = np.cross(np.eye(3), v)
            return np.eye(3) + 2 * w * cross + 2 * cross @ cross

        @staticmethod
        def x_axis_rotation(theta):
            return RigidTransform.rotation_from_quaternion([np.cos(theta / 2), np.sin(theta / 2), 0, 0])

        @staticmethod
        def y_axis_rotation(theta):
            return RigidTransform.rotation_from_quaternion([np.cos(theta / 2), 0, np.sin(theta / 2), 0])

        @staticmethod
        def z_axis_rotation(theta):
            return RigidTransform.rotation_from_quaternion([np.cos(theta / 2), 0, 0, np.sin(theta / 2)])

        def inverse(self):
            back = self._rotation.T
            return RigidTransform(back, -back @ self._translation, self._to_frame, self._from_frame)

        def copy(self):
            return RigidTransform(self._rotation, self._translation, self._from_frame, self._to_frame)

        def __mul__(self, other):
            if not isinstance(other, RigidTransform):
                raise ValueError("Can only compose with other RigidTransform classes")
            if other._to_frame != self._from_frame:
                raise ValueError("Frames do not meet")
            matrix = self.matrix @ other.matrix
            return RigidTransform(matrix[:3, :3], matrix[:3, 3], other._from_frame, self._to_frame)
"""


@pytest.mark.parametrize("where", ["installed", "standing in"])
def test_poses_are_autolab_cores_in_and_out(where, fa, ideal_arm, tmp_path, monkeypatch):
    if where == "installed":
        if importlib.util.find_spec("autolab_core") is None:
            pytest.skip("autolab_core is not installed")
    else:
        (tmp_path / "autolab_core").mkdir()
        (tmp_path / "autolab_core" / "__init__.py").write_text("from .rigid_transformations import RigidTransform\n")
        (tmp_path / "autolab_core" / "rigid_transformations.py").write_text(textwrap.dedent(AUTOLAB_CORE))
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    fa.close()
    program = f"""
        import pickle
        import numpy as np
        from autolab_core import RigidTransform
        from frankapy import FrankaArm, FrankaArmStateClient, dmp
        from frankapy import FrankaConstants as FC
        from frankapy import RigidTransform as ours
        from frankapy.demonstration import Demonstration
        from frankapy.utils import convert_array_to_rigid_transform, convert_rigid_transform_to_array

        assert ours is RigidTransform and RigidTransform.__module__.startswith("autolab_core"), RigidTransform
        fa = FrankaArm()
        start = fa.get_pose()
        state = fa.get_robot_state()
        given = [
            start, fa.get_pose(include_tool_offset=False), fa.get_tool_base_pose(), *fa.get_finger_poses(),
            state["pose"], state["pose_desired"], FC.HOME_POSE, FC.READY_POSE,
            *fa.get_links_transforms(FC.HOME_JOINTS, use_rigid_transforms=True),
            *fa.get_collision_boxes_poses(use_rigid_transforms=True), FrankaArmStateClient().get_pose(),
            convert_array_to_rigid_transform(convert_rigid_transform_to_array(start)),
        ]
        assert all(type(pose) is RigidTransform for pose in given), given
        assert np.allclose(given[-1].matrix, start.matrix)
        assert pickle.loads(pickle.dumps(start)).from_frame == "franka_tool"

        goal = fa.get_pose()
        goal.translation[2] -= 0.1
        turn = RigidTransform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], from_frame="franka_tool", to_frame="franka_tool")
        goal = goal * turn
        fa.goto_pose(goal, duration=2, use_impedance=False)
        now = fa.get_pose()
        assert np.allclose(now.matrix, goal.matrix, atol=0.01)
        tool, base = "franka_tool", "franka_tool_base"
        fa.goto_pose_delta(RigidTransform(translation=[0, 0, -0.05], from_frame=tool, to_frame=tool), 1)
        fa.set_tool_delta_pose(RigidTransform(translation=[0, 0, 0.05], from_frame=tool, to_frame=base))
        assert np.allclose(fa.get_pose().translation, now.translation, atol=0.004)
        fa.goto_pose_by_joints(now)
        assert np.allclose(fa.get_pose().translation, now.translation, atol=0.002)
        try:
            fa.goto_pose(RigidTransform(from_frame="camera", to_frame="world"))
        except ValueError as error:
            assert "camera to world" in str(error)
        else:
            raise AssertionError("a pose of a camera was taken")

        fa.goto_joints(FC.HOME_JOINTS, 1)
        way = [start.copy() for _ in range(100)]
        for i, pose in enumerate(way):
            pose.translation[1] += 0.001 * i
        with open({str(tmp_path / "way.pkl")!r}, "wb") as file:
            pickle.dump(way, file)
        shown = Demonstration.load({str(tmp_path / "way.pkl")!r})
        fa.set_tool_delta_pose(RigidTransform(from_frame="franka_tool", to_frame="franka_tool_base"))
        fa.imitate(dmp.fit(shown, "pose"), duration=3)
        assert abs(fa.get_pose().translation[1] - way[-1].translation[1]) < 0.01
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        env=os.environ | {"FRANKA_INTERFACE_SERVER": ideal_arm.server}, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


STREAM = """
    import time
    import numpy as np
    import rospy
    from autolab_core import RigidTransform
    from frankapy import FrankaArm, SensorDataMessageType
    from frankapy import FrankaConstants as FC
    from frankapy.proto_utils import sensor_proto2ros_msg, make_sensor_group_msg
    from frankapy.proto import PosePositionSensorMessage, ShouldTerminateSensorMessage, CartesianImpedanceSensorMessage
    from franka_interface_msgs.msg import RobotState, SensorDataGroup
    from frankapy.utils import min_jerk_weight
    from sensor_msgs.msg import JointState

    fa = FrankaArm()
    states = []
    rospy.Subscriber("/robot_state_publisher_node_1/robot_state", RobotState, states.append)
    fingers = rospy.wait_for_message("/franka_gripper_1/joint_states", JointState, timeout=60)
    assert abs(sum(fingers.position) - fa.get_gripper_width()) < 1e-3
    p0 = fa.get_pose()
    p1 = p0.copy()
    p1.translation[2] -= 0.1
    pub = rospy.Publisher(FC.DEFAULT_SENSOR_PUBLISHER_TOPIC, SensorDataGroup, queue_size=1000)
    rate = rospy.Rate(50)
    fa.goto_pose(p0, duration=2, dynamic=True, buffer_time=1e4, cartesian_impedances=[600.0, 600.0, 400.0, 50.0, 50.0, 50.0])
    begin = rospy.Time.now().to_time()
    for i in range(100):
        now = rospy.Time.now().to_time() - begin
        pose = p0.interpolate_with(p1, min_jerk_weight(i / 99, 1))
        pub.publish(make_sensor_group_msg(
            trajectory_generator_sensor_msg=sensor_proto2ros_msg(
                PosePositionSensorMessage(id=i, timestamp=now, position=pose.translation, quaternion=pose.quaternion),
                SensorDataMessageType.POSE_POSITION),
            feedback_controller_sensor_msg=sensor_proto2ros_msg(
                CartesianImpedanceSensorMessage(id=i, timestamp=now, translational_stiffnesses=[600.0, 600.0, 400.0 + 4 * i],
                                                rotational_stiffnesses=FC.DEFAULT_ROTATIONAL_STIFFNESSES),
                SensorDataMessageType.CARTESIAN_IMPEDANCE)))
        rate.sleep()
    time.sleep(1.5)
    assert not fa.is_skill_done()
    assert len(states) > 50 and len(states[-1].q) == 7 and states[-1].q != states[0].q
    pub.publish(make_sensor_group_msg(termination_handler_sensor_msg=sensor_proto2ros_msg(
        ShouldTerminateSensorMessage(timestamp=0.0, should_terminate=True), SensorDataMessageType.SHOULD_TERMINATE)))
"""


@pytest.mark.nightly
def test_a_script_that_streams_runs_as_it_is_and_may_end_right_after_its_last_message():
    with Simulation(SimulatedArm(robot="fer", ideal=True)) as simulation:
        with FrankaArm(server=simulation.server) as fa:
            fa.goto_joints(HOME, 1)
            before = fa.get_pose().translation
        run_script(STREAM, simulation.server)
        fa = FrankaArm(server=simulation.server)
        fa.wait_for(lambda state: state.skill_id == 0, 20)  # it was told to end
        np.testing.assert_allclose(fa.get_pose().translation - before, [0, 0, -0.1], atol=0.01)


@pytest.mark.wall
def test_sensor_values_go_into_the_skill_without_rospy_too():
    with Simulation(SimulatedArm(robot="fer", ideal=True)) as simulation, FrankaArm(server=simulation.server) as fa:
        fa.goto_joints(HOME, 1)
        goal = HOME + [0, 0, 0, 0, 0, 0, 0.3]
        assert fa.publish_sensor_values() is False
        fa.goto_joints(HOME, duration=60, dynamic=True)
        for i in range(60):
            message = proto.JointPositionSensorMessage(id=i, timestamp=0, joints=HOME + (goal - HOME) * min(1, i / 40))
            fa.publish_sensor_values(
                make_sensor_group_msg(sensor_proto2ros_msg(message, SensorDataMessageType.JOINT_POSITION))
            )
            time.sleep(0.02)
        fa.wait_for(lambda state: abs(state.robot.q[6] - goal[6]) < 0.005, 10)
        end = proto.ShouldTerminateSensorMessage(timestamp=0, should_terminate=True)
        fa.publish_sensor_data(
            make_sensor_group_msg(
                termination_handler_sensor_msg=sensor_proto2ros_msg(end, SensorDataMessageType.SHOULD_TERMINATE)
            )
        )
        fa.wait_for_skill()
        assert fa.last_skill_result.termination == "SensorSays"


def test_a_state_client_reads_while_another_commands(fa, ideal_arm, monkeypatch):
    monkeypatch.setenv("FRANKA_INTERFACE_SERVER", ideal_arm.server)
    client = FrankaArmStateClient()
    data = client.get_data()
    np.testing.assert_allclose(data["joints"], HOME, atol=0.002)
    np.testing.assert_allclose(client.get_joints(), fa.get_joints(), atol=0.002)
    assert client.get_pose().from_frame == "franka_tool_base"
    np.testing.assert_allclose(client._get_current_robot_state().robot_state.O_T_EE[12:15], client.get_pose().translation, atol=0.001)
    assert SensorDataGroup() == make_sensor_group_msg()


def test_a_script_may_forget_its_skill_and_send_another(fa):
    fa.goto_joints(HOME + 0.1, 20, block=False, ignore_virtual_walls=True)
    assert fa._in_skill
    fa.stop_skill()
    fa.goto_joints(HOME, 20, block=False)
    fa._in_skill = False
    fa.stop_skill()
    assert fa.is_skill_done()
    fa.goto_joints(HOME + 0.1, 20, block=False, ignore_virtual_walls=True)
    fa._in_skill = False
    assert not fa._in_skill
    fa.goto_joints(HOME, 1)  # takes over
    np.testing.assert_allclose(fa.get_joints(), HOME, atol=0.002)
