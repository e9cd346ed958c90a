"""What libfranka 0.21.3 (pylibfranka) computes with the URDF that the arm gives it: `... ADDRESS`, JSON out."""

import json
import sys

import numpy as np
import pylibfranka as franka
from report import LOAD, TOOL

robot = franka.Robot(sys.argv[1], franka.RealtimeConfig.kIgnore)
robot.set_EE(TOOL)
robot.set_K(TOOL)
robot.set_load(*LOAD)
model = robot.load_model()
samples = []
control = robot.start_joint_position_control(franka.ControllerMode.JointImpedance)
state, _ = control.readOnce()
start, away = np.array(state.q_d), np.array([0.4, -0.3, 0.5, 0.4, -0.5, 0.3, 0.6])
SECONDS = 3.0
for cycle in range(int(1000 * SECONDS) + 1):
    s = cycle / (1000 * SECONDS)
    command = franka.JointPositions(list(start + away * s**3 * (10 - 15 * s + 6 * s**2)))
    command.motion_finished = s >= 1
    if cycle % 100 == 0:
        sample = {name: list(getattr(state, name)) for name in ("F_T_EE", "EE_T_K", "F_x_Ctotal", "I_total", "q", "dq")}
        sample["m_total"] = state.m_total
        for function in (model.mass, model.coriolis, model.gravity):
            sample[function.__name__] = np.array(function(state)).flatten("F").tolist()
        sample["zero_jacobian"] = {"EndEffector": np.array(model.zero_jacobian(state)).flatten("F").tolist()}
        samples.append(sample)
    control.writeOnce(command)
    if not command.motion_finished:
        state, _ = control.readOnce()
json.dump(samples, sys.stdout)
