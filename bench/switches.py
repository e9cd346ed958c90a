"""Random switches in lockstep, judged by the simulated arm's own checks and from the wire.

Any trajectory, controller, robot controller and termination, and messages over the topics of those that listen: alone, in a
queue or blended, waited for, taken over at any moment and that again at once, stopped, or changed while they run; on both models.
What is drawn and played is what the safety campaign draws and plays (tests/safety), and so is what is judged of it: what leaves
for the arm is recorded between the two, and its differences compared with the documented limits (tests/interop/wire_limits.py).
  switch_discontinuities            of 10,000 skills: errors of the arm and commands beyond a limit, once for each ten or so
                                    skills, and skills that hung or had no result
  switch_discontinuities_unlimited  the same of a server without limits, to see that they are found: of at most ten batches, until there is one

    bench/switches.py --robot fer --first 17 --batches 1 --keep build/found    again what batch 17 drew

A batch draws from its own seed and begins at home; how many cycles pass between two skills is the computer's. Under a controller
that lets the arm be led it may meet itself, or the end of a joint's range: those errors count for nothing until the event is over.
"""

import argparse
import collections
import contextlib
import json
import logging
import os
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

from tqdm import tqdm

from frankapy import FrankaArmException
from frankapy.parts import kinds
from frankapy.sim import program

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(REPOSITORY / "tests" / "safety"), str(REPOSITORY / "tests" / "interop")]
import scenario  # noqa: E402
from judge import Violation  # noqa: E402
from play import FLOOR_SETTINGS, Outcome, Player  # noqa: E402
from recorded_server import recorded_server  # noqa: E402

SKILLS = 10_000
EVENTS = 4  # of a batch; each has some ten skills
UNLIMITED = REPOSITORY / "build" / "bench" / "franka-interface-unlimited"
UNLIMITED_BATCHES = 10


def run(robot: str, server: str | Path, batches: Iterable[int], skills: int | None, keep: Path | None, until_found: bool = False) -> int:
    """Play batches until there were so many skills, if that is given; return how much was found."""
    began = time.monotonic()
    total = Outcome()
    endings: collections.Counter[str] = collections.Counter()

    def hung(outcome: Outcome) -> None:
        print("\n".join(["the batch does not come to its end:", *outcome.said]), file=sys.stderr, flush=True)
        os._exit(1)

    with contextlib.ExitStack() as opened:
        log = subprocess.DEVNULL if keep is None else opened.enter_context((keep / f"{robot}.log").open("w"))
        recorded = opened.enter_context(recorded_server(robot, server, settings=FLOOR_SETTINGS, log=log))
        bar = opened.enter_context(tqdm(total=skills, unit="skill", desc=robot))
        for seed in batches:
            outcome = Outcome()
            try:
                Player(recorded, scenario.switches(seed, robot, EVENTS), outcome, hung, keep).play()
            except FrankaArmException as error:
                outcome.violations.append(Violation("hung", " ".join(str(error).split())))
            total.skills += outcome.skills
            total.changes += outcome.changes
            total.commands += outcome.commands
            total.ran.update(outcome.ran)
            total.violations += outcome.violations
            endings.update(outcome.endings)
            bar.update(outcome.skills)
            for violation in outcome.violations:
                bar.write(f"{robot} {seed}: event {violation.event}: {violation.kind}: {violation.text}", file=sys.stderr)
            if outcome.violations and keep is not None:
                (keep / f"{robot}-{seed}.txt").write_text("\n".join(outcome.said) + "\n")
            if (until_found and outcome.violations) or (skills is not None and total.skills >= skills):
                break
    print(
        f"{robot}: {total.skills} skills and {total.changes} changes of them in {time.monotonic() - began:.0f} s, "
        f"{total.commands} commands, {len(total.violations)} violations\n"
        f"{dict(endings.most_common())}\nnot run: {', '.join({d.name for _, d in kinds()} - set(total.ran)) or 'none'}",
        file=sys.stderr,
        flush=True,
    )
    return len(total.violations)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", choices=scenario.ROBOTS, help="default: each half of it")
    parser.add_argument("--server", help="another franka-interface; default: ours, and then that without limits")
    parser.add_argument("--first", type=int, default=0, help="batch")
    parser.add_argument("--batches", type=int, help=f"default: as many as have {SKILLS} skills")
    parser.add_argument("--keep", type=Path, help="folder for what passed before something was found, and what had happened")
    options = parser.parse_args()
    if options.keep is not None:
        options.keep.mkdir(parents=True, exist_ok=True)
    logging.getLogger("frankapy").setLevel(logging.CRITICAL)  # motions that were too fast are here the point
    robots = [options.robot] if options.robot else scenario.ROBOTS
    skills = SKILLS // len(robots) if options.batches is None else None
    batches = range(options.first, options.first + (options.batches or SKILLS))
    found = [run(robot, options.server or program("franka-interface"), batches, skills, options.keep) for robot in robots]
    entries = {"switch_discontinuities": sum(found)}
    if options.server is None and options.batches is None:
        entries["switch_discontinuities_unlimited"] = run(robots[0], UNLIMITED, range(UNLIMITED_BATCHES), None, None, until_found=True)
        if not entries["switch_discontinuities_unlimited"]:
            sys.exit("nothing was found of a server without limits: this would find nothing of ours either")
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
