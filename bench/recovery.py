"""How soon an arm takes motions again after an error, and whether it always does; real time.

Every error that a robot has is raised in turn, at random moments of motions, and between them a user stop is pressed, an enabling
device let go, commands are lost and states. The arm recovers by itself where the lab's file lets it by default; of collisions and
stops the bench is the person who is asked.
  recovery_ms_p50, _p99       from the last cycle of the motion that failed to the arm being ready for the next one, less what the
                              simulated arm takes for its own part; without the time until somebody releases a stop
  recovery_errors             that were raised
  recovery_by_itself          of these
  recovery_reported           of these: the result said what stood in the way, and the person's Recover then did it
  recovery_not_recovered      of these: after which the next motion did not come to its goal
  recovery_hung               of these: no result, or none of Recover, within 20 s
  recovery_stalls             motions that this computer ended by itself, as it stood still for too long: an error that was to come then
                              is raised again, and a motion after one is begun again; with more than 50 the bench ends, and has failed
"""

import json
import logging
import re
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
from tqdm import tqdm

from frankapy import FrankaArm, FrankaArmException, FrankaConstants, proto
from frankapy.sim import Simulation

ERRORS = 1000
ARMS_OWN = 50.0  # ms: kRecoveryCycles of sim/robot/robot.cpp
LONGEST = 20.0  # s
MOST_STALLS = 50  # beyond these it is not this computer alone
HOME = np.array(FrankaConstants.HOME_JOINTS)
STEP = np.array([0.1, 0.1, 0, 0, 0, 0.1, 0])
TIME = 0.4  # s of a motion
NAMES = re.findall(r'^    "(\w+)",$', (Path(__file__).resolve().parent.parent / "wire/fci/errors.hpp").read_text(), re.MULTILINE)
LOST = "communication_constraints_violation"
# What befalls the robot, how it ends, and the error that the result names.
MISHAPS: dict[str, tuple[Callable[[Simulation], None], Callable[[Simulation], None], str]] = {
    "user stop": (lambda sim: sim.user_stop(), lambda sim: sim.user_stop(False), ""),
    "enabling device": (lambda sim: sim.enabling_device(False), lambda sim: sim.enabling_device(True), ""),
    "commands lost": (lambda sim: sim.network(loss_in=1), lambda sim: sim.network(), LOST),
    "states lost": (lambda sim: sim.network(loss_out=1), lambda sim: sim.network(), LOST),
}


def until(condition: Callable[[], bool]) -> bool:
    """Wait until it is so; return whether it has become so in time."""
    deadline = time.monotonic() + LONGEST
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.001)
    return True


def ready(fa: FrankaArm) -> bool:
    """Return whether a person's Recover has brought the arm back; what stands in the way may take a moment to go."""
    with suppress(FrankaArmException):
        return fa.recover().recovered
    return False


def move_on(fa: FrankaArm) -> str | None:
    """Move home; return why not, or that this computer stood still meanwhile (LOST), or None."""
    before = fa.last_skill_result.skill_id
    try:
        fa.goto_joints(HOME, TIME, ignore_errors=False)
    except FrankaArmException as failed:
        result = fa.last_skill_result
        return LOST if result.skill_id != before and LOST in result.errors else str(failed)
    return None


def main() -> int:
    random = np.random.default_rng(1)
    logging.getLogger("frankapy").setLevel(logging.ERROR)
    ms = []
    counts = dict.fromkeys(("by_itself", "reported", "not_recovered", "hung", "stalls"), 0)
    kinds = [*NAMES, *MISHAPS]
    bar = tqdm(total=ERRORS, unit="error")
    with Simulation() as simulation, FrankaArm(server=simulation.server) as fa, bar:
        fa.reset_joints(1)
        while bar.n < ERRORS and counts["stalls"] <= MOST_STALLS:
            kind = kinds[bar.n % len(kinds)]
            begin, end, error = MISHAPS.get(kind, (lambda sim, kind=kind: sim.inject(kind), lambda _: None, kind))
            fa.goto_joints(HOME + STEP, TIME, block=False)
            time.sleep(random.uniform(0.05, 0.8) * TIME)
            begin(simulation)
            told = until(fa.is_skill_done)
            now = time.monotonic_ns()
            end(simulation)
            result = fa.last_skill_result
            if told and error != LOST and LOST in result.errors:
                counts["stalls"] += 1
                until(lambda: ready(fa))
                continue
            if told and (result.ending != proto.ROBOT_ERROR or (error and error not in result.errors)):
                bar.write(f"{kind}: ended with {proto.Ending.Name(result.ending)}, {list(result.errors)}", file=sys.stderr)
            if told and result.recovery.recovered:
                counts["by_itself"] += 1
            elif told and until(lambda: ready(fa)):
                counts["reported"] += result.recovery.obstacle != proto.NO_OBSTACLE
                now = time.monotonic_ns()
            else:
                counts["hung"] += 1
            if error:
                ms.append((now - result.last_cycle_ns) / 1e6 - ARMS_OWN)
            while (failure := move_on(fa)) == LOST and counts["stalls"] <= MOST_STALLS and until(lambda: ready(fa)):
                counts["stalls"] += 1
            if failure:
                bar.write(f"after {kind}: {failure}", file=sys.stderr)
                counts["not_recovered"] += 1
                until(lambda: ready(fa))
            bar.update()
    print(f"ready again: p50 {np.median(ms):.1f}, p99 {np.percentile(ms, 99):.1f}, at most {max(ms):.1f} ms", file=sys.stderr)
    entries = {"recovery_ms_p50": float(np.median(ms)), "recovery_ms_p99": float(np.percentile(ms, 99)), "recovery_errors": bar.n}
    print(json.dumps(entries | {f"recovery_{name}": count for name, count in counts.items()}))
    return int(bar.n < ERRORS or counts["not_recovered"] + counts["hung"] > 0)


if __name__ == "__main__":
    sys.exit(main())
