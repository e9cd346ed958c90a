"""How much faster than real time a contact is simulated: server and simulated arm in lockstep, two processes over UDP.

The server's Cartesian impedance presses the hand on a plate with 10 N for 60 s of the robot's clock.
  lockstep_realtime_factor        that time by the time it took
  lockstep_safe_realtime_factor   the same among 20 boxes as walls, 5 of them near the arm
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from frankapy import FrankaArm
from frankapy.sim import SimulatedArm, Simulation, read_truth
from frankapy.walls import Box

SECONDS = 60  # simulated
FORCE = 10  # N
STIFFNESS = [600, 600, 600, 50, 50, 50]  # N/m, Nm/rad
PLATE = 0.2  # m, the height of its top
SCENE = Path(__file__).resolve().parent.parent / "sim" / "scenes" / "plate.xml"
NEAR = [(0.5, 0.21, 0.25), (0.5, -0.21, 0.25), (0.72, 0, 0.3), (0.3, 0.15, 0.15), (0.3, -0.15, 0.15)]  # m, about the hand
FAR = [(0.9 * np.cos(a), 0.9 * np.sin(a), 0.2 + a / 8) for a in 0.4 * np.arange(15)]


def press(walls: dict) -> float:
    """Return the factor."""
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.npy"
        arm = SimulatedArm(lockstep=True, scene=SCENE, truth=truth)
        with Simulation(arm) as simulation, FrankaArm(server=simulation.server) as fa:
            fa.reset_joints(3)
            fa.close_gripper(grasp=False)
            pose = fa.get_pose()
            pose.translation[:] = [0.5, 0, PLATE + 0.03]
            fa.goto_pose(pose, 3, cartesian_impedances=STIFFNESS)
            fa.walls.update(walls)
            # The fingers stop at the plate, gently, and the spring goes on.
            pose.translation[2] = PLATE
            fa.goto_pose(pose, 4, cartesian_impedances=STIFFNESS)
            pose.translation[2] = fa.get_pose().translation[2] - FORCE / STIFFNESS[2]
            fa.goto_pose(pose, 2, buffer_time=SECONDS - 2, cartesian_impedances=STIFFNESS)
            result = fa.last_skill_result
            rows = read_truth(truth, until=result.last_state.robot.message_id)
    pressing = rows[rows["cycle"] <= result.last_state.robot.message_id][-1000 * (SECONDS - 5) :]
    force = pressing["contact_wrench"][:, 2]
    print(f"pressed for {result.time:.1f} s with {force.mean():.2f} N ({force.min():.2f} to {force.max():.2f})", file=sys.stderr)
    if abs(result.time - SECONDS) > 0.5 or abs(force.mean() - FORCE) > 0.2 * FORCE or np.any(force <= 0):
        sys.exit(f"It should have pressed for {SECONDS} s with {FORCE} N within 20 %, without leaving the plate.")
    took = (result.last_cycle_ns - result.first_command_ns) / 1e9
    return result.time / took


def main() -> None:
    boxes = {f"box {k}": Box([0.1, 0.1, 0.1], place) for k, place in enumerate([*NEAR, *FAR])}
    print(json.dumps({"lockstep_realtime_factor": press({}), "lockstep_safe_realtime_factor": press(boxes)}))


if __name__ == "__main__":
    main()
