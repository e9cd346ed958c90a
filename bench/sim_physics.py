"""What the simulated arm owes to physics, over its own protocol and control channel, judged by its truth or by formula.

  sim_energy_drift_pct           of a pendulum beside the arm, over 10 s: of the energy at its lowest point
  sim_pendulum_period_error_pct  from the period of large swings, over 10 s
  sim_plate_force_error_pct      between the force that a skill commands on a plate, 5 to 15 N, and what the contact reads
                                 in the last half second; the worst, of an arm without friction in its joints
  sim_external_force_error_n     between a constant push of 15 N and 1 N m, and the wrench that the robot estimates of it after
  sim_external_torque_error_nm   1.5 s: the worst of ten postures, with friction and noise. 1 N + 5 % are 1.75 N

The worst of both models.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from frankapy import FrankaArm, FrankaConstants
from frankapy.parts import ForceAxisImpedance, HybridForcePosition, Impulse, MinJerkJoint, MinJerkPose, StayPose
from frankapy.sim import SimulatedArm, Simulation, read_truth

GRAVITY, LENGTH, RADIUS, ANGLE = 9.81, 0.8, 0.03, 1.0  # m/s^2, m, m, rad
SECONDS = 10
PENDULUM = f"""<mujoco><compiler angle="radian"/><worldbody>
  <site name="arm"/>
  <body name="pendulum" pos="0 2 2" euler="{ANGLE} 0 0"><joint type="hinge" axis="1 0 0"/>
    <geom type="sphere" pos="0 0 -{LENGTH}" size="{RADIUS}" mass="1"/></body></worldbody></mujoco>"""
FORCES = (5.0, 10.0, 15.0)  # N
PUSH = 15.0, 1.0  # N, N m
POSTURES = 10
HOME = np.array(FrankaConstants.HOME_JOINTS)


def mean_of_means(a: float, b: float) -> float:
    """Return the arithmetic-geometric mean, of which the period of large swings follows."""
    while abs(a - b) > 1e-15:
        a, b = (a + b) / 2, np.sqrt(a * b)
    return a


def pendulum(robot: str) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        scene, truth = Path(folder) / "pendulum.xml", Path(folder) / "truth.npy"
        scene.write_text(PENDULUM)
        with Simulation(SimulatedArm(robot, ideal=True, scene=scene, truth=truth, speed=10)) as simulation:
            simulation.pause()
            simulation.step(1000 * SECONDS)
            rows = read_truth(truth, until=1000 * SECONDS)[: 1000 * SECONDS]
    angle = ANGLE + rows["qpos"][:, 0]
    lowest = np.flatnonzero(angle[:-1] * angle[1:] <= 0)
    speed = (angle[lowest + 1] - angle[lowest]) / 1e-3
    passage = 1e-3 * (lowest - angle[lowest] / (angle[lowest + 1] - angle[lowest]))
    inertia = LENGTH**2 + 0.4 * RADIUS**2
    period = 2 * np.pi * np.sqrt(inertia / (GRAVITY * LENGTH)) / mean_of_means(1.0, np.cos(ANGLE / 2))
    measured = 2 * (passage[-1] - passage[0]) / (len(passage) - 1)
    return {
        "sim_energy_drift_pct": 100 * abs((speed[-1] / speed[0]) ** 2 - 1),
        "sim_pendulum_period_error_pct": 100 * abs(measured / period - 1),
    }


def plate(robot: str) -> dict[str, float]:
    errors = []
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.npy"
        with Simulation(SimulatedArm(robot, ideal=True, lockstep=True, scene="plate", truth=truth)) as simulation:
            with FrankaArm(server=simulation.server) as fa:
                fa.goto_gripper(0)
                above = fa.get_pose(include_tool_offset=False)
                above.translation = [0.5, 0, 0.22]
                for force in FORCES:
                    fa.run(MinJerkPose(above, 2))
                    fa.run(StayPose(3), HybridForcePosition([0, 0, 1, 0, 0, 0], [0, 0, -3, 0, 0, 0]))  # comes to the plate
                    result = fa.run(Impulse([0, 0, -force], acc_duration=0.2, duration=3), ForceAxisImpedance("z"))
                    end = simulation.truth().cycle - (simulation.truth().message_id - result.last_state.robot.message_id)
                    rows = read_truth(truth, until=end)
                    rows = rows[(rows["cycle"] > end - 1000) & (rows["cycle"] <= end - 500)]  # before it falls again
                    errors.append(abs(rows["contact_wrench"][:, 2].mean() / force - 1))
    return {"sim_plate_force_error_pct": 100 * max(errors)}


def push(robot: str) -> dict[str, float]:
    generator = np.random.default_rng(7)
    errors = []
    with Simulation(SimulatedArm(robot, lockstep=True), hold_time=0.1) as simulation, FrankaArm(server=simulation.server) as fa:
        for _ in range(POSTURES):
            fa.run(MinJerkJoint(HOME + generator.uniform(-0.4, 0.4, 7), 2))
            fa.stop_skill()
            while simulation.truth().moving:  # from here on the robot holds itself
                time.sleep(0.005)
            force, torque = generator.normal(size=(2, 3))
            wrench = np.concatenate([PUSH[0] * force / np.linalg.norm(force), PUSH[1] * torque / np.linalg.norm(torque)])
            simulation.pause()
            simulation.push(wrench, 3600)
            simulation.step(1500)
            time.sleep(0.05)  # the newest state is with the server
            felt = -np.array(fa.get_arm_state().robot.O_F_ext_hat_K)
            simulation.push([0] * 6, 0)
            simulation.step(500)
            simulation.resume()
            errors.append([np.linalg.norm((felt - wrench)[:3]), np.linalg.norm((felt - wrench)[3:])])
    worst = np.max(errors, axis=0)
    return {"sim_external_force_error_n": float(worst[0]), "sim_external_torque_error_nm": float(worst[1])}


def main() -> None:
    found: dict[str, float] = {}
    for robot in ("fer", "fr3"):
        for part in (pendulum, plate, push):
            entries = {name: float(value) for name, value in part(robot).items()}
            print(robot, entries, file=sys.stderr)
            found |= {name: max(value, found.get(name, 0.0)) for name, value in entries.items()}
    print(json.dumps(found))


if __name__ == "__main__":
    main()
