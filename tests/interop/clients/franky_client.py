"""franky-control 2.0.0 (libfranka 0.21.2, protocol 10) or 1.1.0 (0.15.0, protocol 9): `franky_client.py ADDRESS`."""

import contextlib
import sys
import time

import franky
import hands
import numpy as np
import people
import report

ADDRESS = sys.argv[1]
robot = franky.Robot(ADDRESS, realtime_config=franky.RealtimeConfig.Ignore)
FACTOR = 0.2  # of franky's limits
# The same where a motion is not to be over before it is stopped, although in lockstep its time goes much faster than ours.
SLOW = 0.002
robot.relative_dynamics_factor = FACTOR
robot.recover_from_errors()


def joints():
    return list(robot.current_joint_state.position)


def tool():
    """Column-major (16,)"""
    return list(robot.current_cartesian_state.pose.end_effector_pose.matrix.T.flatten())


def joint_motion():
    start = joints()
    robot.move(franky.JointMotion(report.joint_position(start, report.TIME)))
    report.expect_joint(start, joints(), 0.01)


def joint_waypoints():
    start = joints()
    away = report.joint_position(start, report.TIME)
    robot.move(franky.JointWaypointMotion([franky.JointWaypoint(away), franky.JointWaypoint(start)]))
    for i, (q, wanted) in enumerate(zip(joints(), start, strict=True)):
        report.expect(f"joint {i + 1}", q, wanted, 0.01)


def joint_velocity():
    start = joints()
    velocity = [0.0] * 7
    velocity[report.JOINT] = 0.1
    robot.move(franky.JointVelocityMotion(velocity, franky.Duration(1000)))
    robot.move(franky.JointVelocityStopMotion())
    moved = joints()[report.JOINT] - start[report.JOINT]
    if not 0.05 < moved < 0.2:
        raise AssertionError(f"the joint moved by {moved:.3f} rad")


def cartesian_motion():
    start = tool()
    up = franky.Affine([0.0, 0.0, report.DISTANCE])
    robot.move(franky.CartesianMotion(franky.Affine([0, 0, -report.DISTANCE]), franky.ReferenceType.Relative))
    report.expect_raised(start, tool())  # the tool's z points down
    robot.move(franky.CartesianMotion(up, franky.ReferenceType.Relative))


def cartesian_velocity():
    start = tool()
    robot.move(franky.CartesianVelocityMotion(franky.Twist([0.0, 0.0, 0.05]), franky.Duration(1000)))
    robot.move(franky.CartesianVelocityStopMotion())
    rise = tool()[14] - start[14]
    if not 0.02 < rise < 0.12:
        raise AssertionError(f"the tool rose by {rise:.3f} m")


def impedance():
    start = joints()
    robot.set_joint_impedance([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0])
    robot.move(franky.JointMotion(report.joint_position(start, report.TIME)))
    report.expect_joint(start, joints(), 0.01)


def after(states):
    """The newest state, when so many have come."""
    for _ in range(states):
        state = robot.state
    return state


def refuse(setter, *values):
    try:
        setter(*values)
    except franky.CommandException as error:
        if "invalid argument" not in str(error):
            raise
    else:
        raise AssertionError(f"{values} was taken")


@contextlib.contextmanager
def pushed(*force):
    """A push on the tool, N; the state when it has been felt."""
    report.world("push", force)
    try:
        yield after(300)
    finally:
        report.world("push", [0.0, 0.0, 0.0])
        after(300)


def set_collision_behavior():
    """Thresholds in all three forms: a push is a contact, or a collision."""
    high, low = [60.0] * 7, [60.0] * 6
    try:
        for contact in (
            (high, high, [4.0] * 6, low),
            (high, high, high, high, low, low, [4.0] * 6, low),
        ):
            robot.set_collision_behavior(*contact)
            with pushed(0.0, 0.0, -10.0) as state:
                if not np.any(state.cartesian_contact) or robot.has_errors:
                    raise AssertionError("a push of 10 N is no contact where 4 N are the threshold")
        robot.set_collision_behavior(high, low)
        with pushed(0.0, 0.0, -10.0) as state:
            if np.any(state.cartesian_contact):
                raise AssertionError("a push of 10 N is a contact where 60 N are the threshold")
        robot.set_collision_behavior(60.0, 4.0)
        with pushed(0.0, 0.0, -10.0) as state:
            if not state.current_errors.cartesian_reflex:
                raise AssertionError("a push of 10 N is no reflex where 4 N are the threshold")
        robot.recover_from_errors()
        refuse(robot.set_collision_behavior, -1.0, 30.0)
    finally:
        robot.recover_from_errors()
        robot.set_collision_behavior(20.0, 30.0)  # franky's own


def set_joint_impedance():
    """The arm yields to a push by its torque over the stiffness."""
    stiff = [3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0]
    robot.move(franky.JointMotion(joints()))  # it holds by joint impedance from now on
    for stiffness in (200.0, 1000.0):
        robot.set_joint_impedance([stiffness, *stiff[1:]])
        with pushed(0.0, 10.0, 0.0) as state:
            torque, yielded = state.tau_ext_hat_filtered[0], state.q[0] - state.q_d[0]
        report.expect("yielding of joint 1", abs(yielded), abs(torque) / stiffness, 0.25 * abs(torque) / stiffness)
    robot.set_joint_impedance(stiff)
    refuse(robot.set_joint_impedance, [-5.0, *stiff[1:]])
    refuse(robot.set_joint_impedance, [20000.0, *stiff[1:]])


def set_cartesian_impedance():
    robot.set_cartesian_impedance([500.0] * 3 + [50.0] * 3)
    robot.set_cartesian_impedance([3000.0] * 3 + [300.0] * 3)
    refuse(robot.set_cartesian_impedance, [5.0, 500.0, 500.0, 50.0, 50.0, 50.0])
    refuse(robot.set_cartesian_impedance, [500.0, 500.0, 500.0, 50.0, 50.0, 400.0])


def frame_setter(setter, name):
    """A frame that the state shows, and two that are none."""
    try:
        setter(report.TOOL)
        shown = getattr(after(2), name).matrix.T.flatten()
        for i, wanted in enumerate(report.TOOL):
            report.expect(f"{name}[{i}]", shown[i], wanted, 1e-6)
    finally:
        setter(list(np.eye(4).flatten()))
    refuse(setter, [2.0, *report.TOOL[1:]])
    refuse(setter, [-1.0, *report.TOOL[1:]])  # left-handed


def set_load():
    mass, center, inertia = report.LOAD
    try:
        robot.set_load(mass, center, inertia)
        state = after(2)
        report.expect("m_load", state.m_load, mass, 1e-6)
        for i in range(3):
            report.expect(f"F_x_Cload[{i}]", state.F_x_Cload[i], center[i], 1e-6)
        for i, wanted in enumerate(inertia):
            report.expect(f"I_load[{i}]", state.I_load.T.flatten()[i], wanted, 1e-6)
    finally:
        robot.set_load(0.0, [0.0] * 3, [0.0] * 9)
    refuse(robot.set_load, -0.1, center, inertia)
    refuse(robot.set_load, mass, center, [-value for value in inertia])


def user_stop(motion_to):
    """A motion to where the arm never is; afterwards it goes back."""
    start = joints()

    def motion():
        robot.relative_dynamics_factor = SLOW
        try:
            robot.move(motion_to(start), asynchronous=True)
            wait_until(lambda: max(abs(q - q0) for q, q0 in zip(joints(), start, strict=True)) > 0.002)
            report.ask("user_stop", True)
            robot.join_motion(60.0)
        finally:
            robot.relative_dynamics_factor = FACTOR

    def back():
        robot.recover_from_errors()
        robot.move(franky.JointMotion(start))
        for i, (q, wanted) in enumerate(zip(joints(), start, strict=True)):
            report.expect(f"joint {i + 1}", q, wanted, 0.01)

    refused = [lambda: robot.move(franky.JointMotion(start)), robot.recover_from_errors]
    people.user_stop(lambda: robot.state, motion, refused, back)


def wait_until(condition):
    deadline = time.monotonic() + 60
    while not condition():
        if time.monotonic() > deadline:
            raise AssertionError("it has not come within a minute")
        time.sleep(0.001)


def moved_from(start):
    return joints()[report.JOINT] - start[report.JOINT]


@contextlib.contextmanager
def on_the_way(start):
    """Have a slow motion under way, which what is done inside ends before its goal."""
    robot.relative_dynamics_factor = SLOW
    try:
        robot.move(franky.JointMotion(report.joint_position(start, report.TIME)), asynchronous=True)
        wait_until(lambda: moved_from(start) > 0.001)
        yield
        if not moved_from(start) < 0.8 * report.ANGLE:
            raise AssertionError("the arm did not stop on its way")
    finally:
        robot.relative_dynamics_factor = FACTOR


def stop():
    """A motion that another one replaces while it runs."""
    with on_the_way(joints()):
        robot.move(franky.JointStopMotion())
        state = robot.current_joint_state
        report.expect("joint velocity", max(abs(v) for v in state.velocity), 0.0, 0.005)


def cancel():
    """A motion that is cancelled from outside."""
    start = joints()
    with on_the_way(start):
        robot.stop()
        try:
            robot.join_motion(10.0)
        except franky.ControlException as error:
            if "preempted" not in str(error):
                raise
    robot.recover_from_errors()
    robot.move(franky.JointMotion(start))
    report.expect("joint", joints()[report.JOINT], start[report.JOINT], 0.01)


def reaction():
    """A motion that ends when something happens: time passes, the floor is met."""

    def down(way):
        return franky.CartesianMotion(franky.Affine([0, 0, way]), franky.ReferenceType.Relative)

    start = joints()
    motion = franky.JointMotion(report.joint_position(start, report.TIME))
    motion.add_reaction(franky.JointPositionReaction(franky.Measure.REL_TIME > 0.1, franky.JointStopMotion()))
    robot.move(motion)
    if not 0.001 < joints()[report.JOINT] - start[report.JOINT] < 0.8 * report.ANGLE:
        raise AssertionError("the arm did not stop on its way")
    robot.move(franky.JointMotion(start))

    robot.set_collision_behavior(80.0, 80.0)
    robot.move(franky.JointMotion([0.0, 0.1, 0.0, -2.2, 0.0, 2.3, start[6]]))  # farther out
    robot.move(down(tool()[14] - 0.02))  # the tool's z points down
    robot.relative_dynamics_factor = 0.01
    motion = down(0.04)
    motion.add_reaction(franky.CartesianPoseReaction(franky.Measure.FORCE_Z < -8.0, franky.CartesianStopMotion()))
    robot.move(motion)
    report.expect("height over the floor", tool()[14], 0.0, 0.02)
    robot.relative_dynamics_factor = FACTOR
    robot.move(franky.JointMotion(start))


def recovery():
    """A reflex, by a motion faster than the joints may be, and on from there."""
    start = joints()
    robot.relative_dynamics_factor = 1.0
    try:
        robot.move(franky.CartesianMotion(franky.Affine([0, 0.3, 0]), franky.ReferenceType.Relative))
    except franky.ControlException as error:
        if "reflex" not in str(error):
            raise
    else:
        raise AssertionError("joints were faster than they may")
    finally:
        robot.relative_dynamics_factor = FACTOR
    if not robot.has_errors:
        raise AssertionError("the robot has no errors after a reflex")
    robot.recover_from_errors()
    if robot.has_errors:
        raise AssertionError("errors after recovery")
    robot.move(franky.JointMotion(start))
    for i, (q, wanted) in enumerate(zip(joints(), start, strict=True)):
        report.expect(f"joint {i + 1}", q, wanted, 0.01)


def place():
    """m (3,)"""
    return after(2).O_T_EE.translation


def guiding():
    start = joints()
    with people.guiding(lambda: robot.state):
        people.lead(place, 1, free=True)
    robot.move(franky.JointMotion(start))


def guiding_axes():
    start = joints()
    robot.set_guiding_mode([True, False, False, False, False, False], False)
    with people.guiding(lambda: robot.state):
        people.lead(place, 0, free=True)
        people.lead(place, 1, free=False)
    robot.set_guiding_mode([True] * 6, True)
    robot.move(franky.JointMotion(start))


def model():
    gravity = robot.model.gravity(robot.state)
    for i in range(7):
        report.expect(f"gravity on joint {i + 1}", gravity[i], robot.state.tau_J[i], 0.5)
    if "joint7" not in robot.model_urdf:
        raise AssertionError("the arm's URDF has no joint7")


def torque():
    start = joints()
    robot.move(franky.JointImpedanceMotion(report.joint_position(start, report.TIME)), asynchronous=True)
    wait_until(lambda: abs(moved_from(start) - report.ANGLE) < 0.05 and max(map(abs, robot.current_joint_velocities)) < 0.01)
    robot.move(franky.TorqueStopMotion())
    report.expect("joint", moved_from(start), report.ANGLE, 0.05)


def gripper():
    hand = franky.Gripper(ADDRESS)
    hand.homing()
    report.expect("max_width", hand.max_width, 0.08, 0.001)
    hand.move(0.03, 0.1)
    report.expect("width", hand.width, 0.03, 0.001)
    hand.open(0.1)
    report.expect("width", hand.width, 0.08, 0.001)
    if hand.grasp(0.02, 0.1, 20.0, epsilon_inner=0.005, epsilon_outer=0.005):
        raise AssertionError("air was grasped")


def with_hand(attempt, *more):
    hand = franky.Gripper(ADDRESS)
    attempt(hand, lambda: hand.state, *more)


def further(start):
    """Far, so that no computer is there before somebody presses a button."""
    return franky.JointMotion([*start[:6], start[6] + 1.0])


def higher(_start):
    return franky.CartesianMotion(franky.Affine([0.0, 0.0, -0.2]), franky.ReferenceType.Relative)


def raise_arm():
    robot.move(franky.CartesianMotion(franky.Affine([0.0, 0.0, -report.DISTANCE]), franky.ReferenceType.Relative))


def sideways(start):
    return franky.JointImpedanceMotion(report.joint_position(start, report.TIME))


TORQUE = [("torque", torque), ("user stop, torque", lambda: user_stop(sideways))]
report.run(
    [
        ("model", model),
        ("guiding", guiding),
        ("guiding axes", guiding_axes),
        ("joint motion", joint_motion),
        ("joint waypoints", joint_waypoints),
        ("joint velocity", joint_velocity),
        ("cartesian motion", cartesian_motion),
        ("cartesian velocity", cartesian_velocity),
        ("joint impedance setter", impedance),
        ("set_collision_behavior", set_collision_behavior),
        ("set_joint_impedance", set_joint_impedance),
        ("set_cartesian_impedance", set_cartesian_impedance),
        ("set_ee", lambda: frame_setter(robot.set_ee, "NE_T_EE")),
        ("set_k", lambda: frame_setter(robot.set_k, "EE_T_K")),
        ("set_load", set_load),
        ("stop motion", stop),
        ("cancel", cancel),
        *(TORQUE if hasattr(franky, "JointImpedanceMotion") else []),  # not yet in 1.1.0
        ("reaction", reaction),
        ("reflex and recovery", recovery),
        ("user stop, joint motion", lambda: user_stop(further)),
        ("user stop, cartesian motion", lambda: user_stop(higher)),
        ("gripper", gripper),
        ("gripper stop", lambda: with_hand(hands.stop)),
        ("gripper, values out of range", lambda: with_hand(hands.out_of_range)),
        ("grasp", lambda: with_hand(hands.grasp, raise_arm)),
    ],
    robot.recover_from_errors,
)
