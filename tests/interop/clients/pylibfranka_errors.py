"""Every error that libfranka 0.21.3 can provoke through its Python bindings: `pylibfranka_errors.py ADDRESS`."""

import sys
import time

import numpy as np
import provocations
import pylibfranka as franka

robot = franka.Robot(sys.argv[1], franka.RealtimeConfig.kIgnore)
START = {
    "joint position": lambda: robot.start_joint_position_control(franka.ControllerMode.JointImpedance),
    "joint velocity": lambda: robot.start_joint_velocity_control(franka.ControllerMode.JointImpedance),
    "cartesian pose": lambda: robot.start_cartesian_pose_control(franka.ControllerMode.CartesianImpedance),
    "cartesian velocity": lambda: robot.start_cartesian_velocity_control(franka.ControllerMode.CartesianImpedance),
    "torque": robot.start_torque_control,
}
COMMAND = {
    "joint position": franka.JointPositions,
    "joint velocity": franka.JointVelocities,
    "cartesian pose": franka.CartesianPose,
    "cartesian velocity": franka.CartesianVelocities,
    "torque": franka.Torques,
}


def go(goal):
    control = START["joint position"]()
    state, _ = control.readOnce()
    for q in provocations.way(np.array(state.q_d), goal):
        command = franka.JointPositions(q)
        control.writeOnce(command)
        control.readOnce()
    command.motion_finished = True
    control.writeOnce(command)


def provoke(case):
    if case.elbow is not None:
        raise NotImplementedError("its bindings have no elbow")
    go(case.posture)
    robot.set_EE(provocations.frame(case.tool))
    torque, force = case.thresholds
    robot.set_collision_behavior(*([torque] * 7,) * 2, *([force] * 6,) * 2)
    control = START[case.kind]()
    try:
        state, _ = control.readOnce()
        start = state
        for cycle in range(case.cycles):
            if cycle == 10:
                time.sleep(case.silence)
            control.writeOnce(COMMAND[case.kind](case.stream(start, state, cycle)))
            state, _ = control.readOnce()
        raise AssertionError("nothing came of it")
    except franka.ControlException as error:
        told = str(error)
    del control
    names = [name for name in dir(franka.Errors) if getattr(robot.read_once().last_motion_errors, name, None) is True]
    return f"{told} {names}"


def recover():
    robot.automatic_error_recovery()
    robot.set_collision_behavior(*([1000.0] * 7,) * 2, *([1000.0] * 6,) * 2)


provocations.run("fr3", provoke, recover)
