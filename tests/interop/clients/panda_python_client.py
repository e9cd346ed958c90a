"""libfranka 0.9.2 through panda-python 1.1.1 (protocol 5), its nine ways to control: `panda_python_client.py ADDRESS`."""

import sys

import hands
import numpy as np
import people
import provocations
import report
from panda_py import libfranka as franka

ADDRESS = sys.argv[1]
INTERNAL = {
    "joint impedance": franka.ControllerMode.kJointImpedance,
    "Cartesian impedance": franka.ControllerMode.kCartesianImpedance,
}
robot = franka.Robot(ADDRESS, franka.RealtimeConfig.kIgnore)


def follow(make):
    """The callback that commands make(state, t) until the motion is over."""
    t = 0.0

    def callback(state, duration):
        nonlocal t
        t += duration.to_sec()
        command = make(state, t)
        command.motion_finished = t > report.TIME + 0.2
        return command

    return callback


def newest():
    """A state from after now: one that was under way already may come first."""
    robot.read_once()
    return robot.read_once()


def references(start):
    return {
        "joint position": lambda _, t: franka.JointPositions(report.joint_position(start.q_d, t)),
        "joint velocity": lambda _, t: franka.JointVelocities(report.joint_velocity(t)),
        "cartesian pose": lambda _, t: franka.CartesianPose(report.pose(start.O_T_EE_c, t)),
        "cartesian velocity": lambda _, t: franka.CartesianVelocities(report.twist(t)),
    }


def check(kind, start, end, tolerance=0.01):
    if kind.startswith("joint"):
        report.expect_joint(start.q, end.q, tolerance)
    else:
        report.expect_raised(start.O_T_EE, end.O_T_EE, tolerance)


def internal(kind, mode):
    start = newest()
    control = getattr(robot, "control_" + kind.replace(" ", "_"))
    control(follow(references(start)[kind]), mode)
    check(kind, start, robot.read_once())


def torque():
    start = newest()
    robot.control(follow(lambda state, t: franka.Torques(report.torque(start.q, state.q, state.dq, t))))
    check("joint", start, robot.read_once())


def torque_with(kind):
    """Torques that follow what the robot makes of the reference: q_d."""
    start = newest()

    def torques(state, _):
        stiffness = [600, 600, 600, 600, 250, 150, 150]
        return franka.Torques(
            [k * (d - q) + 0.8 * k**0.5 * (dd - dq)
             for k, d, q, dd, dq in zip(stiffness, state.q_d, state.q, state.dq_d, state.dq, strict=True)]
        )  # fmt: skip

    control = getattr(robot, "control_torque_" + kind.replace(" ", "_"))
    control(torques, follow(references(start)[kind]))
    check(kind, start, robot.read_once())


def setters():
    robot.set_collision_behavior([20.0] * 7, [40.0] * 7, [20.0] * 6, [40.0] * 6)
    robot.set_joint_impedance([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0])
    robot.set_cartesian_impedance([3000.0] * 3 + [300.0] * 3)
    robot.set_guiding_mode([True] * 6, False)
    identity = [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0]
    shifted = identity[:14] + [0.05, 1.0]
    before = newest().F_T_EE
    robot.set_ee(shifted)
    robot.set_k(shifted)
    state = newest()
    report.expect("F_T_EE", state.F_T_EE[14] - before[14], 0.05, 1e-9)
    report.expect("EE_T_K", state.EE_T_K[14], 0.05, 1e-9)
    robot.set_ee(identity)
    robot.set_k(identity)
    robot.set_load(0.2, [0.0, 0.0, 0.05], [0.001, 0, 0, 0, 0.001, 0, 0, 0, 0.001])
    report.expect("m_load", newest().m_load, 0.2, 1e-9)
    robot.set_load(0.0, [0.0] * 3, [0.0] * 9)
    report.expect_refused("invalid argument", lambda: robot.set_joint_impedance([-5.0] * 7))


def model():
    state = newest()
    gravity = robot.load_model().gravity(state)
    for i in range(7):
        report.expect(f"gravity on joint {i + 1}", gravity[i], state.tau_J[i], 0.5)


def reflex_and_recovery():
    """Finish while the arm moves: a robot calls that a discontinuity."""
    start = newest()
    t = 0.0

    def callback(_, duration):
        nonlocal t
        t += duration.to_sec()
        command = franka.JointPositions(report.joint_position(start.q_d, t))
        command.motion_finished = t > report.TIME / 2
        return command

    try:
        robot.control_joint_position(callback, limit_rate=False, cutoff_frequency=1000.0)
    except RuntimeError as error:
        if "still moving" not in str(error):
            raise
    else:
        raise AssertionError("the robot let itself be finished while it moved")
    if robot.read_once().robot_mode != franka.RobotMode.kReflex:
        raise AssertionError(f"the robot's mode is {robot.read_once().robot_mode}")
    robot.automatic_error_recovery()
    if newest().robot_mode != franka.RobotMode.kIdle:
        raise AssertionError(f"after recovery the robot's mode is {robot.read_once().robot_mode}")


def stop():
    """A callback that gives up: the client cancels its motion."""
    start = newest()
    t = 0.0

    def callback(_, duration):
        nonlocal t
        t += duration.to_sec()
        if t > report.TIME / 2:
            raise InterruptedError
        return franka.JointVelocities(report.joint_velocity(t))

    try:
        robot.control_joint_velocity(callback)
    except InterruptedError:
        pass
    state = newest()
    if state.robot_mode != franka.RobotMode.kIdle:
        raise AssertionError(f"the robot's mode is {state.robot_mode}")
    if not 0.02 < state.q[report.JOINT] - start.q[report.JOINT] < 0.09:
        raise AssertionError("the arm was not stopped half way")
    robot.stop()  # with nothing to stop


def gripper():
    hand = franka.Gripper(ADDRESS)
    if not hand.homing():
        raise AssertionError("homing failed")
    report.expect("max_width", hand.read_once().max_width, 0.08, 0.001)
    if not hand.move(0.03, 0.1):
        raise AssertionError("move failed")
    report.expect("width", hand.read_once().width, 0.03, 0.001)
    if hand.grasp(0.02, 0.1, 20.0):
        raise AssertionError("air was grasped")
    if not hand.move(0.06, 0.1):
        raise AssertionError("move after a failed grasp failed")


def home():
    """To where all ways are free."""
    way = list(provocations.way(np.array(newest().q_d), provocations.HOME))

    def callback(_, __):
        command = franka.JointPositions(way.pop(0))
        command.motion_finished = not way
        return command

    robot.control_joint_position(callback, limit_rate=False, cutoff_frequency=1000.0)


def with_hand(attempt, *more):
    hand = franka.Gripper(ADDRESS)
    attempt(hand, hand.read_once, *more)


def grasp():
    home()
    with_hand(hands.grasp, lambda: internal("cartesian pose", INTERNAL["joint impedance"]))


def user_stop(kind):
    home()
    start = newest()
    make = {
        "joint velocity": lambda _, t: franka.JointVelocities(report.joint_velocity(t, report.sway)),
        "cartesian velocity": lambda _, t: franka.CartesianVelocities(report.twist(t, report.sway)),
        "torque": lambda state, t: franka.Torques(report.torque(start.q, state.q, state.dq, t, report.sway)),
    }[kind]
    t, press_at = 0.0, people.presser()

    def callback(state, duration):
        nonlocal t
        t += duration.to_sec()
        press_at(t)
        return make(state, t)

    def motion():
        control = robot.control if kind == "torque" else getattr(robot, "control_" + kind.replace(" ", "_"))
        control(callback)

    def again():
        robot.automatic_error_recovery()
        internal("joint velocity", INTERNAL["joint impedance"])

    people.user_stop(newest, motion, [again, robot.automatic_error_recovery], again)


def guiding():
    home()
    with people.guiding(newest):
        people.lead(lambda: newest().O_T_EE[12:15], 1, free=True)
    internal("joint velocity", INTERNAL["joint impedance"])


def guiding_axes():
    home()
    robot.set_guiding_mode([True, False, False, False, False, False], False)
    with people.guiding(newest):
        people.lead(lambda: newest().O_T_EE[12:15], 0, free=True)
        people.lead(lambda: newest().O_T_EE[12:15], 1, free=False)
    robot.set_guiding_mode([True] * 6, True)


report.run(
    [("model", model), ("setters", setters)]
    + [
        (f"{kind}, {name}", lambda kind=kind, mode=mode: internal(kind, mode))
        for kind in references(None)
        for name, mode in INTERNAL.items()
    ]
    + [("torque", torque)]
    + [(f"torque and {kind}", lambda kind=kind: torque_with(kind)) for kind in references(None)]
    + [
        ("stop", stop),
        ("reflex and recovery", reflex_and_recovery),
        *((f"user stop, {kind}", lambda kind=kind: user_stop(kind)) for kind in ("joint velocity", "cartesian velocity", "torque")),
        ("guiding", guiding),
        ("guiding axes", guiding_axes),
        ("gripper", gripper),
        ("gripper stop", lambda: with_hand(hands.stop)),
        ("gripper, values out of range", lambda: with_hand(hands.out_of_range)),
        ("grasp", grasp),
    ],
    robot.automatic_error_recovery,
)
