"""Every trajectory with every controller in every robot controller, on both models in lockstep.

What the rule allows is run and compared with what the simulated arm really did; what it does not allow is to be refused.
Rule, examples and comparison are those of tests/python/part_combinations.py; a new kind is in it by itself.
  combinations_run      that moved both arms as told
  combinations_wrong    that did not, on either, and what was taken or refused against the rule
build/combinations.md says of each whether it runs, or why it is refused.
"""

import json
import logging
import sys
from pathlib import Path

from frankapy import FrankaArm
from frankapy.sim import SimulatedArm, Simulation

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY / "tests" / "python"))
from part_combinations import RUNS, Combination, combinations, tried  # noqa: E402

OUTPUT = REPOSITORY / "build" / "combinations.md"


def outcomes(robot: str) -> dict[Combination, str]:
    """Try them all on one arm; return what came of each."""
    of: dict[Combination, str] = {}
    with (
        Simulation(SimulatedArm(robot=robot, lockstep=True, ideal=True)) as simulation,
        FrankaArm(server=simulation.server) as fa,
    ):
        for each in combinations():
            of[each] = tried(simulation, fa, *each)
            if of[each].startswith("WRONG"):
                print(f"{robot} {each}: {of[each]}", file=sys.stderr, flush=True)
    return of


def write(of: dict[str, dict[Combination, str]]) -> None:
    """Write the table; one line for each trajectory with each controller."""
    lines = ["# Combinations", "", "Trajectory, controller: the robot controllers in which it runs, and why not in others.", ""]
    lines += ["| trajectory | controller | runs in | refused |", "|---|---|---|---|"]
    first = next(iter(of.values()))
    for trajectory, controller in dict.fromkeys(each[:2] for each in first):
        runs, refused = [], {}
        for each in first:
            if each[:2] != (trajectory, controller):
                continue
            texts = {texts[each] for texts in of.values()}
            if texts == {RUNS}:
                runs.append(each[2])
            else:
                refused.setdefault("; ".join(sorted(texts)), []).append(each[2])
        why = "<br>".join(f"{', '.join(names)}: {text}" for text, names in refused.items())
        lines.append(f"| {trajectory} | {controller} | {', '.join(runs)} | {why.replace('|', '/')} |")
    OUTPUT.write_text("\n".join(lines) + "\n")


def main() -> None:
    logging.getLogger("frankapy").setLevel(logging.ERROR)
    of = {robot: outcomes(robot) for robot in ("fer", "fr3")}
    write(of)
    both = [tuple(texts[each] for texts in of.values()) for each in next(iter(of.values()))]
    wrong = [texts for texts in both if any(text.startswith("WRONG") for text in texts)]
    entries = {"combinations_run": both.count((RUNS, RUNS)), "combinations_wrong": len(wrong)}
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
