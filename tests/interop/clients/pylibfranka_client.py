"""Official libfranka 0.21.3 through its Python bindings (protocol 10): `pylibfranka_client.py ADDRESS`."""

import gc
import sys
import time

import hands
import numpy as np
import people
import provocations
import pylibfranka as franka
import report

ADDRESS = sys.argv[1]
INTERNAL = {
    "joint impedance": franka.ControllerMode.JointImpedance,
    "Cartesian impedance": franka.ControllerMode.CartesianImpedance,
}
robot = franka.Robot(ADDRESS, franka.RealtimeConfig.kIgnore)


def recover():
    """To a robot that takes motions; over another connection where this one has broken."""
    global robot
    try:
        robot.automatic_error_recovery()
        robot.read_once()
    except Exception:  # noqa: BLE001 - whatever the bindings make of a broken connection
        robot = None
        gc.collect()  # it is closed when the last motion that held it is gone
        robot = franka.Robot(ADDRESS, franka.RealtimeConfig.kIgnore)
        if robot.read_once().robot_mode == franka.RobotMode.Reflex:
            robot.automatic_error_recovery()


def drive(control, command_at):
    """Send command_at(state, t) each cycle until its motion is over; the last state."""
    t = 0.0
    while True:
        state, duration = control.readOnce()
        t += duration.to_sec()
        command = command_at(state, t)
        command.motion_finished = t > report.TIME + 0.2
        control.writeOnce(command)
        if command.motion_finished:
            return


def newest():
    """A state from after now: one that was under way already may come first."""
    robot.read_once()
    return robot.read_once()


def joint_position(mode):
    start = robot.read_once()
    drive(
        robot.start_joint_position_control(mode),
        lambda _, t: franka.JointPositions(report.joint_position(start.q_d, t)),
    )
    report.expect_joint(start.q, robot.read_once().q, 0.01)


def joint_velocity(mode):
    start = robot.read_once()
    drive(robot.start_joint_velocity_control(mode), lambda _, t: franka.JointVelocities(report.joint_velocity(t)))
    report.expect_joint(start.q, robot.read_once().q, 0.01)


def cartesian_pose(mode):
    start = robot.read_once()
    drive(
        robot.start_cartesian_pose_control(mode),
        lambda _, t: franka.CartesianPose(report.pose(start.O_T_EE_c, t)),
    )
    report.expect_raised(start.O_T_EE, robot.read_once().O_T_EE)


def cartesian_velocity(mode):
    start = robot.read_once()
    drive(robot.start_cartesian_velocity_control(mode), lambda _, t: franka.CartesianVelocities(report.twist(t)))
    report.expect_raised(start.O_T_EE, robot.read_once().O_T_EE)


def asynchronous_joint_position():
    """Targets at 50 Hz, to and fro, then one that is reached; as libfranka's own example async_position_control."""
    handler_of = franka.AsyncPositionControlHandler
    start = rest()
    configured = handler_of.configure(robot, handler_of.Configuration([0.655] * 4 + [1.315] * 3, 0.001))
    if configured.error_message is not None:
        raise AssertionError(configured.error_message)
    handler = configured.handler

    def send(way):
        goal = [q + way for q in start.q_d]
        sent = handler.set_joint_position_target(handler_of.JointPositionTarget(goal))
        if sent.error_message is not None:
            raise AssertionError(sent.error_message)
        return goal

    for step in range(60):
        state = handler.get_target_feedback()
        if state.error_message is not None:
            raise AssertionError(state.error_message)
        goal = send(0.1 if step // 15 % 2 == 0 else -0.1)
        time.sleep(0.02)
    reached = False
    for _ in range(3000):  # states
        state = handler.get_target_feedback()
        if state.error_message is not None:
            raise AssertionError(state.error_message)
        reached = "reached" in str(state.status).lower()
        if reached:
            break
    if not reached:
        raise AssertionError(f"the target is not reached: {state.status}")
    handler.stop_control()
    state = rest()
    if state.robot_mode != franka.RobotMode.Idle:
        raise AssertionError(f"the robot's mode is {state.robot_mode}")
    for i in range(7):
        report.expect(f"joint {i + 1}", state.q[i], goal[i], 0.01)


def rest():
    """The state once the arm no longer swings from the motion before."""
    quiet = 0
    for _ in range(3000):
        state = robot.read_once()
        quiet = quiet + 1 if max(abs(v) for v in state.dq) < 0.01 else 0
        if quiet == 50:
            return state
    raise AssertionError(f"the arm does not come to rest: dq is {state.dq}")


def torques(start, along=report.profile):
    """Commands along a way from there."""
    last = np.zeros(7)

    def within_rate(state, t):
        # The bindings limit no rates, and do not say when a command was late: at a third of the limit two may be lost.
        nonlocal last
        last = np.clip(report.torque(start.q, state.q, state.dq, t, along), last - 0.33, last + 0.33)
        return franka.Torques(last)

    return within_rate


def torque():
    start = rest()
    drive(robot.start_torque_control(), torques(start))
    report.expect_joint(start.q, robot.read_once().q, 0.01)


def setters():
    robot.set_collision_behavior([20.0] * 7, [40.0] * 7, [20.0] * 6, [40.0] * 6)
    robot.set_joint_impedance([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0])
    robot.set_cartesian_impedance([3000.0] * 3 + [300.0] * 3)
    shifted = [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0.05, 1.0]
    before = robot.read_once().F_T_EE
    robot.set_EE(shifted)
    robot.set_K(shifted)
    state = newest()
    report.expect("F_T_EE", state.F_T_EE[14] - before[14], 0.05, 1e-5)
    report.expect("EE_T_K", state.EE_T_K[14], 0.05, 1e-5)
    identity = [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0]
    robot.set_EE(identity)
    robot.set_K(identity)
    robot.set_load(0.2, [0.0, 0.0, 0.05], [0.001, 0, 0, 0, 0.001, 0, 0, 0, 0.001])
    report.expect("m_load", newest().m_load, 0.2, 1e-6)
    robot.set_load(0.0, [0.0] * 3, [0.0] * 9)
    try:
        robot.set_joint_impedance([-5.0] * 7)
    except franka.CommandException:
        return
    raise AssertionError("a stiffness of -5 N m/rad was taken")


def model():
    state = robot.read_once()
    gravity = robot.load_model().gravity(state)
    for i in range(7):
        report.expect(f"gravity on joint {i + 1}", gravity[i], state.tau_J[i], 0.5)


def reflex_and_recovery():
    """Finish while the arm moves: a robot calls that a discontinuity."""
    start = robot.read_once()
    control = robot.start_joint_position_control(INTERNAL["joint impedance"])
    t = 0.0
    try:
        while True:
            _, duration = control.readOnce()
            t += duration.to_sec()
            command = franka.JointPositions(report.joint_position(start.q_d, t))
            command.motion_finished = t > report.TIME / 2
            control.writeOnce(command)
            if t > report.TIME:
                raise AssertionError("the robot let itself be finished while it moved")
            if command.motion_finished:
                break
    except franka.ControlException:
        pass
    else:
        raise AssertionError("the robot let itself be finished while it moved")
    del control
    if robot.read_once().robot_mode != franka.RobotMode.Reflex:
        raise AssertionError(f"the robot's mode is {robot.read_once().robot_mode}")
    robot.automatic_error_recovery()
    if robot.read_once().robot_mode != franka.RobotMode.Idle:
        raise AssertionError(f"after recovery the robot's mode is {robot.read_once().robot_mode}")


def stop():
    """A motion that is left, and one that is stopped."""
    start = robot.read_once()
    control = robot.start_joint_velocity_control(INTERNAL["joint impedance"])
    t = 0.0
    while t < report.TIME / 2:
        _, duration = control.readOnce()
        t += duration.to_sec()
        control.writeOnce(franka.JointVelocities(report.joint_velocity(t)))
    robot.stop()
    del control
    state = robot.read_once()
    if state.robot_mode != franka.RobotMode.Idle:
        raise AssertionError(f"the robot's mode is {state.robot_mode}")
    report.expect("joint velocity", max(abs(v) for v in state.dq), 0.0, 0.05)
    if not 0.02 < state.q[report.JOINT] - start.q[report.JOINT] < 0.09:
        raise AssertionError("the arm was not stopped half way")


def gripper():
    hand = franka.Gripper(ADDRESS)
    if not hand.homing():
        raise AssertionError("homing failed")
    report.expect("max_width", hand.read_once().max_width, 0.08, 0.001)
    if not hand.move(0.03, 0.1):
        raise AssertionError("move failed")
    report.expect("width", hand.read_once().width, 0.03, 0.001)
    if hand.grasp(0.02, 0.1, 20.0, epsilon_inner=0.005, epsilon_outer=0.005):
        raise AssertionError("air was grasped")
    if not hand.move(0.06, 0.1):
        raise AssertionError("move after a failed grasp failed")


def home():
    """To where all ways are free."""
    start = rest()
    control = robot.start_joint_position_control(INTERNAL["joint impedance"])
    way = list(provocations.way(np.array(start.q_d), provocations.HOME))
    for q in way:
        control.readOnce()
        command = franka.JointPositions(q)
        command.motion_finished = q is way[-1]
        control.writeOnce(command)


def with_hand(attempt, *more):
    hand = franka.Gripper(ADDRESS)
    attempt(hand, hand.read_once, *more)


def gripper_stop():
    raise NotImplementedError("a move keeps Python's lock, so that no other thread can stop it")


def grasp():
    home()
    with_hand(hands.grasp, lambda: cartesian_pose(INTERNAL["joint impedance"]))


def user_stop(kind):
    home()
    start = rest()
    mode = INTERNAL["joint impedance"]
    begin, make = {
        "joint velocity": (
            lambda: robot.start_joint_velocity_control(mode),
            lambda _, t: franka.JointVelocities(report.joint_velocity(t, report.sway)),
        ),
        "cartesian velocity": (
            lambda: robot.start_cartesian_velocity_control(mode),
            lambda _, t: franka.CartesianVelocities(report.twist(t, report.sway)),
        ),
        "torque": (robot.start_torque_control, torques(start, report.sway)),
    }[kind]

    def motion():
        control = begin()
        t, press_at = 0.0, people.presser()
        while True:
            state, duration = control.readOnce()
            t += duration.to_sec()
            press_at(t)
            control.writeOnce(make(state, t))

    def again():
        robot.automatic_error_recovery()
        joint_velocity(mode)

    people.user_stop(robot.read_once, motion, [begin, robot.automatic_error_recovery], again)


def guiding():
    home()
    with people.guiding(robot.read_once):
        people.lead(lambda: newest().O_T_EE[12:15], 1, free=True)
    joint_velocity(INTERNAL["joint impedance"])


def guiding_axes():
    raise NotImplementedError("its bindings have none")


report.run(
    [("model", model), ("setters", setters)]
    + [
        (f"{kind.__name__.replace('_', ' ')}, {name}", lambda kind=kind, mode=mode: kind(mode))
        for kind in (joint_position, joint_velocity, cartesian_pose, cartesian_velocity)
        for name, mode in INTERNAL.items()
    ]
    + [
        ("asynchronous joint position", asynchronous_joint_position),
        ("torque", torque),
        ("stop", stop),
        ("reflex and recovery", reflex_and_recovery),
        *((f"user stop, {kind}", lambda kind=kind: user_stop(kind)) for kind in ("joint velocity", "cartesian velocity", "torque")),
        ("guiding", guiding),
        ("guiding axes", guiding_axes),
        ("gripper", gripper),
        ("gripper stop", gripper_stop),
        ("gripper, values out of range", lambda: with_hand(hands.out_of_range)),
        ("grasp", grasp),
    ],
    recover,
)
