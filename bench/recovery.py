"""How soon an arm takes motions again after an error, and whether it always does; real time.

Every error that a robot has is raised in turn, at random moments of motions, and the published interface recovers by itself.
  recovery_ms_p50, _p99       from the last cycle of the motion that failed to the arm being ready for the next one, less what the
                              simulated arm takes for its own part
  recovery_errors             that were raised
  recovery_not_recovered      after which the next motion did not come to its goal
"""

import json
import logging
import re
import sys
import time
from pathlib import Path

import numpy as np
from tqdm import tqdm

from frankapy import FrankaArm, FrankaArmException, FrankaConstants, proto
from frankapy.sim import Simulation

ERRORS = 1000
ARMS_OWN = 50.0  # ms: kRecoveryCycles of sim/robot/robot.cpp
HOME = np.array(FrankaConstants.HOME_JOINTS)
STEP = np.array([0.1, 0.1, 0, 0, 0, 0.1, 0])
TIME = 0.4  # s of a motion
NAMES = re.findall(r'^    "(\w+)",$', (Path(__file__).resolve().parent.parent / "wire/fci/errors.hpp").read_text(), re.MULTILINE)


def main() -> int:
    random = np.random.default_rng(1)
    logging.getLogger("frankapy").setLevel(logging.ERROR)
    ms, not_recovered = [], 0
    with Simulation() as simulation, FrankaArm(server=simulation.server) as fa:
        fa.reset_joints(1)
        for n in tqdm(range(ERRORS), unit="error"):
            name = NAMES[n % len(NAMES)]
            fa.goto_joints(HOME + STEP, TIME, block=False)
            time.sleep(random.uniform(0, 0.8 * TIME))
            simulation.inject(name)
            fa.wait_for_skill()
            ready = time.monotonic_ns()
            result = fa.last_skill_result
            if name not in result.errors:
                print(f"{name}: ended with {proto.Ending.Name(result.ending)}, {list(result.errors)}", file=sys.stderr)
            ms.append((ready - result.last_cycle_ns) / 1e6 - ARMS_OWN)
            try:
                fa.goto_joints(HOME, TIME, ignore_errors=False)
            except FrankaArmException as error:
                print(f"after {name}: {error}", file=sys.stderr)
                not_recovered += 1
                fa.wait_for_franka_interface()
    print(f"ready again: p50 {np.median(ms):.1f}, p99 {np.percentile(ms, 99):.1f}, at most {max(ms):.1f} ms", file=sys.stderr)
    entries = {"recovery_ms_p50": float(np.median(ms)), "recovery_ms_p99": float(np.percentile(ms, 99))}
    print(json.dumps(entries | {"recovery_errors": ERRORS, "recovery_not_recovered": not_recovered}))
    return int(not_recovered > 0)


if __name__ == "__main__":
    sys.exit(main())
