"""What libfranka 0.9.2 (panda-python 1.1.1) computes with the library that the arm gives it: `... ADDRESS`, JSON out."""

import json
import sys

import numpy as np
from panda_py import libfranka as franka
from report import LOAD, TOOL

robot = franka.Robot(sys.argv[1], franka.RealtimeConfig.kIgnore)
robot.set_ee(TOOL)
robot.set_k(TOOL)
robot.set_load(*LOAD)
robot.read_once()  # one that was under way
state = robot.read_once()
model = robot.load_model()
mass = (state.I_total, state.m_total, state.F_x_Ctotal)
frames = [getattr(franka.Frame, name) for name in dir(franka.Frame) if name.startswith("k")]
random = np.random.default_rng(1)
samples = []
for _ in range(50):
    q, dq = random.uniform(-2.5, 2.5, 7), random.uniform(-2, 2, 7)
    sample = {name: list(getattr(state, name)) for name in ("F_T_EE", "EE_T_K", "F_x_Ctotal", "I_total")}
    sample |= {"q": list(q), "dq": list(dq), "m_total": state.m_total}
    sample["mass"] = list(model.mass(q, *mass))
    sample["coriolis"] = list(model.coriolis(q, dq, *mass))
    sample["gravity"] = list(model.gravity(q, *mass[1:]))
    for function in (model.pose, model.zero_jacobian, model.body_jacobian):
        sample[function.__name__] = {
            frame.name.removeprefix("k"): list(function(frame, q, state.F_T_EE, state.EE_T_K)) for frame in frames
        }
    samples.append(sample)
json.dump(samples, sys.stdout)
