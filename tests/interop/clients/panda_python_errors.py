"""Every error that libfranka 0.9.2 can provoke through panda-python 1.1.1: `panda_python_errors.py ADDRESS`."""

import sys
import time

import numpy as np
import provocations
from panda_py import libfranka as franka

robot = franka.Robot(sys.argv[1], franka.RealtimeConfig.kIgnore)
UNFILTERED = {"limit_rate": False, "cutoff_frequency": 1000.0}
CONTROL = {
    "joint position": (robot.control_joint_position, franka.JointPositions),
    "joint velocity": (robot.control_joint_velocity, franka.JointVelocities),
    "cartesian pose": (robot.control_cartesian_pose, franka.CartesianPose),
    "cartesian velocity": (robot.control_cartesian_velocity, franka.CartesianVelocities),
    "torque": (robot.control, franka.Torques),
}


def go(goal):
    steps = None

    def callback(state, _):
        nonlocal steps
        steps = steps or list(provocations.way(np.array(state.q_d), goal))
        command = franka.JointPositions(steps.pop(0))
        command.motion_finished = not steps
        return command

    robot.control_joint_position(callback, **UNFILTERED)


def provoke(case):
    go(case.posture)
    robot.set_ee(provocations.frame(case.tool))
    torque, force = case.thresholds
    robot.set_collision_behavior(*([torque] * 7,) * 2, *([force] * 6,) * 2)
    control, make = CONTROL[case.kind]
    start, cycle = None, -1

    def callback(state, _):
        nonlocal start, cycle
        start = start or state
        cycle += 1
        if cycle == 10:
            time.sleep(case.silence)
        if cycle > case.cycles:
            raise AssertionError("nothing came of it")
        values = case.stream(start, state, cycle)
        return make(values, case.elbow(start, state, cycle)) if case.elbow else make(values)

    try:
        control(callback, **UNFILTERED)
        raise AssertionError("nothing came of it")
    except RuntimeError as error:
        told = str(error)
    errors = robot.read_once().last_motion_errors
    names = [name for name in dir(errors) if getattr(errors, name) is True]
    return f"{told} {names}"


def recover():
    robot.automatic_error_recovery()
    robot.set_collision_behavior(*([1000.0] * 7,) * 2, *([1000.0] * 6,) * 2)


provocations.run("fer", provoke, recover)
