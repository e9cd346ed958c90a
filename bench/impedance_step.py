"""How the tool follows a short straight line under the server's Cartesian impedance, 600 N/m, judged by the truth of the physics.

A minimum-jerk line of 5 cm in 0.85 s along each axis of the base, with the friction that joints have; in lockstep, so it
does not depend on this computer. The worst of both models and the three directions:
  impedance_step_lag_ms        by which the tool's motion comes after its reference: the shift that makes both most alike
  impedance_step_behind_mm     greatest distance of the tool behind its reference, along the line
  impedance_step_overshoot_mm  past the goal, along the line
  impedance_step_rest_mm       from the goal, 1 s after the reference is there
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from frankapy import FrankaArm, FrankaConstants
from frankapy.parts import CartesianImpedance, MinJerkJoint, MinJerkPose, Time
from frankapy.sim import SimulatedArm, Simulation, read_truth

WAY, DURATION, REST = 0.05, 0.85, 1.0  # m, s, s
SHIFTS = np.arange(0, 200.5, 0.5)  # ms


def follow(fa: FrankaArm, truth: Path, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Make the motion from home; return reference and tool in each of its cycles, (n, 3) m, and the goal."""
    fa.run(MinJerkJoint(FrankaConstants.HOME_JOINTS, 2))
    goal = fa.get_pose(include_tool_offset=False)
    goal.translation = goal.translation + WAY * direction
    reference = {}
    with fa.states() as states:
        states.receive()  # the server knows of this reader: from here on none is missed
        result = fa.run(MinJerkPose(goal, DURATION), CartesianImpedance(600, 50), Time(after_trajectory=REST))
        for state in states:
            if state.skill_id == result.skill_id and state.O_T_EE_ref:  # none while the motion is being started
                reference[state.robot.message_id] = state.O_T_EE_ref[12:15]
            elif state.skill_id != result.skill_id and reference:
                break
    if result.limited_cycles or result.stretch != 1 or len(reference) < 1000 * (DURATION + REST) - 1:
        sys.exit(f"not the motion that was to be measured: {result}")
    rows = read_truth(truth, until=max(reference))
    rows = rows[np.isin(rows["cycle"], list(reference))]
    return np.array([reference[cycle] for cycle in rows["cycle"]]), rows["O_T_TCP"][:, 12:15], goal.translation


def judge(reference: np.ndarray, tool: np.ndarray, goal: np.ndarray, direction: np.ndarray) -> dict[str, float]:
    """Return the entries of one motion."""
    wanted, made = (reference - goal) @ direction, (tool - goal) @ direction
    cycles = np.arange(len(wanted), dtype=float)
    moving = cycles < 1000 * DURATION + SHIFTS[-1]
    unlike = [np.sum((made - np.interp(cycles - shift, cycles, wanted))[moving] ** 2) for shift in SHIFTS]
    return {
        "impedance_step_lag_ms": float(SHIFTS[np.argmin(unlike)]),
        "impedance_step_behind_mm": 1e3 * float(np.max(wanted - made)),
        "impedance_step_overshoot_mm": 1e3 * max(0.0, float(made.max())),
        "impedance_step_rest_mm": 1e3 * float(np.linalg.norm(tool[-1] - goal)),
    }


def main() -> None:
    found = []
    for robot in ("fer", "fr3"):
        with tempfile.TemporaryDirectory() as folder:
            truth = Path(folder) / "truth.npy"
            with Simulation(SimulatedArm(robot, lockstep=True, truth=truth)) as simulation, FrankaArm(server=simulation.server) as fa:
                for axis, direction in zip("xyz", np.eye(3), strict=True):
                    found.append(judge(*follow(fa, truth, direction), direction))
                    print(robot, axis, {name: round(value, 2) for name, value in found[-1].items()}, file=sys.stderr)
    print(json.dumps({name: max(each[name] for each in found) for name in found[0]}))


if __name__ == "__main__":
    main()
