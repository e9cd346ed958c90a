"""Guide mode on both models, with the friction that an arm has.

  guide_drift_mm   how far the tool goes in 5 s that nobody holds it, 50 g more on it than the robot knows; the worse arm
  guide_force_n    of a hand that leads it at 0.1 m/s along a line, the mean; the worse of both arms and three directions
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from frankapy import FrankaArm
from frankapy.sim import SimulatedArm, Simulation, read_truth

WEIGHT = 0.05 * 9.81  # N
SPEED, WAY = 0.1, 0.15  # m/s, m


def measure(robot: str) -> tuple[float, float]:
    """Return drift (mm) and force (N) of one arm."""
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.npy"
        with Simulation(SimulatedArm(robot, lockstep=True, truth=truth)) as simulation, FrankaArm(server=simulation.server) as fa:
            fa.reset_joints(3)
            simulation.push([0, 0, -WEIGHT, 0, 0, 0], 8)
            first = fa.get_arm_state().robot.message_id
            fa.run_guide_mode(5)
            rows = read_truth(truth, until=fa.get_arm_state().robot.message_id)
            tool = rows[rows["cycle"] > first]["O_T_TCP"].reshape(-1, 4, 4)[:, 3, :3]
            drift = 1000 * np.linalg.norm(tool - tool[0], axis=1).max()
            forces = []
            for direction in np.eye(3):
                fa.reset_joints(3)
                here = simulation.truth().O_T_TCP[:3, 3]
                wait, seconds = 1.0, WAY / SPEED
                simulation.hand(here + np.outer([0, 1], WAY * direction), [wait, wait + seconds], stiffness=3000, damping=100)
                first = fa.get_arm_state().robot.message_id
                fa.run_guide_mode(wait + seconds + 0.5)
                rows = read_truth(truth, until=fa.get_arm_state().robot.message_id)
                rows = rows[rows["cycle"] > first]
                tool = rows["O_T_TCP"].reshape(-1, 4, 4)[:, 3, :3]
                done = (tool - here) @ direction
                even = (done > 0.3 * WAY) & (done < 0.8 * WAY)
                forces.append(np.linalg.norm(rows["push"][even][:, :3], axis=1).mean())
            print(f"{robot}: drift {drift:.2f} mm, led with {np.round(forces, 2)} N", file=sys.stderr)
    return drift, max(forces)


def main() -> None:
    drifts, forces = zip(*(measure(robot) for robot in ("fer", "fr3")), strict=True)
    print(json.dumps({"guide_drift_mm": max(drifts), "guide_force_n": max(forces)}))


if __name__ == "__main__":
    main()
