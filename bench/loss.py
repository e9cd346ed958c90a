"""What lost packets cost: 10 minutes of figures of eight while 5 % of the commands and 5 % of the states are lost; FER in lockstep.

The robot follows poses with its own controller, and ours with torques, five minutes each; the same rounds without a loss beside it.
  loss_errors     of the robot, and rounds that did not end by themselves
  loss_rms_ratio  root mean square of the tool's way from what was meant, in truth, by that without a loss; the greater of both
  loss_rms_mm, loss_rms_mm_without  of that way of moving
The seed of what is lost is fixed; how many cycles pass between rounds is the computer's. An argument: other minutes.
"""

import json
import sys
from pathlib import Path

import numpy as np
from shared.arm import HOME, arm
from shared.figure_eight import figure_eight
from tqdm import tqdm

from frankapy import FrankaArm, parts, proto
from frankapy.parts import CartesianImpedance, InternalImpedance, MinJerkJoint
from frankapy.sim import read_truth

LOSS, SEED = 0.05, 11
MINUTES = 10
SECONDS = 16.0
AFTER = 1  # s, between two figures, so that the arm rests


def follow(fa: FrankaArm, truth: Path, controller: object) -> tuple[np.ndarray, bool]:
    """Return the squares of the tool's distance from the figure (m²), cycle by cycle, and whether it was followed to its end."""
    start = fa.get_pose(include_tool_offset=False)
    way = start.translation + figure_eight(SECONDS)
    samples = parts.PoseSamples(way, np.tile(start.quaternion, (len(way), 1)))
    with fa.states() as states:
        result = fa.run(samples, controller, ignore_errors=True)
        when = {}  # the time of the skill in a cycle
        for state in states:
            if state.skill_id == result.skill_id:
                when[state.robot.message_id] = round(1000 * state.skill_time)
            elif when:
                break
    rows = read_truth(truth, until=max(when))
    rows = rows[np.isin(rows["cycle"], list(when))]
    wanted = np.array([way[min(when[cycle], len(way) - 1)] for cycle in rows["cycle"]])
    return np.sum((rows["O_T_TCP"][:, 12:15] - wanted) ** 2, axis=1), not result.errors and result.ending == proto.TERMINATED


def measure(controller: object, minutes: float, loss: float) -> tuple[float, int]:
    """Return the root mean square (m) over rounds of so many minutes, and the errors."""
    squares, errors = [], 0
    with arm() as (simulation, fa, truth):
        simulation.network(loss_in=loss, loss_out=loss, seed=SEED)
        for _ in tqdm(range(max(1, round(60 * minutes / (SECONDS + AFTER)))), unit="round", disable=None):
            found, well = follow(fa, truth, controller)
            squares.append(found)
            errors += not well
            if not well:
                fa.wait_for_franka_interface()
                fa.run(MinJerkJoint(HOME, 1.5), ignore_errors=True)
    return float(np.sqrt(np.mean(np.concatenate(squares)))), errors


def main() -> None:
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else MINUTES
    entries = {"loss_errors": 0.0, "loss_rms_ratio": 0.0}
    for controller in (InternalImpedance(), CartesianImpedance(600, [30] * 3)):
        lossy, errors = measure(controller, minutes / 2, LOSS)
        whole, others = measure(controller, minutes / 2, 0)
        name = type(controller).__name__
        print(f"{name}: {1e3 * lossy:.3f} mm, {1e3 * whole:.3f} mm without; {errors + others} errors", file=sys.stderr)
        entries["loss_errors"] += errors + others
        if lossy / whole > entries["loss_rms_ratio"]:
            entries |= {"loss_rms_ratio": lossy / whole, "loss_rms_mm": 1e3 * lossy, "loss_rms_mm_without": 1e3 * whole}
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
