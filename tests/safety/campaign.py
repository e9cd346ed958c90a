"""The safety campaign: random runs of arm, server and clients, judged by what truly happened.

    make safety HOURS=20          simulated hours, from seed 0 on; writes its entries into build/bench.json
    make safety SEED=17           one run again
    .venv/bin/python tests/safety/campaign.py --seed 17 --events 3 8 9      and of it these events alone
    make safety-gate              some two minutes, always the same seeds
    make safety-lacking           that it finds what servers lack

What a run is: scenario.py; what it is judged by: judge.py; docs/safety-campaign.md. Ends with 1 when a violation was found, or
--until-found when it was not.
"""

import argparse
import collections
import contextlib
import json
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

import scenario
from judge import KINDS, REPOSITORY, Violation
from play import Outcome, play
from scenario import Scenario
from tqdm import tqdm

from frankapy.sim import die_with_parent, program

BENCH = REPOSITORY / "build" / "bench.json"
FOUND = REPOSITORY / "build" / "safety"  # what is left of runs with violations
LONGEST = 1800  # s of the wall, for a run
ROOM = 4e9  # bytes, that the runs at a time may take
SHRINKING = 1200  # s of the wall, for making one shorter
WORKERS = 2 * (os.cpu_count() or 1)  # an arm and its loop take turns, and their client mostly waits
GATE = range(13004, 13014)  # what every change has to pass: some minutes, simulated, with events of every kind
GATE_LONGEST = 200  # s of the wall, for one of these
_FORK = multiprocessing.get_context("fork")


def _memory() -> Path | None:
    """Return where recordings need no disk, if there is room: one that stalls for half a second would be ten seconds too slow in lockstep."""
    shared = Path("/dev/shm")
    return shared if shared.is_dir() and shutil.disk_usage(shared).free > ROOM else None


class Run:
    """A run in a process of its own, with all that it starts."""

    def __init__(self, what: Scenario, server: str, record: str, longest: float = LONGEST) -> None:
        self.scenario = what
        self.folder = Path(tempfile.mkdtemp(prefix="safety-", dir=_memory()))
        self.outcome: Outcome | None = None
        self._longest = longest
        self._until = time.monotonic() + longest
        self._reports, sends = _FORK.Pipe(duplex=False)
        self._process: BaseProcess = _FORK.Process(target=self._play, args=(server, record, sends))
        self._process.start()
        sends.close()

    @property
    def reports(self) -> Connection:
        return self._reports

    @property
    def is_late(self) -> bool:
        return time.monotonic() > self._until

    def end(self) -> Outcome:
        """Take its report, and end what it has left over."""
        outcome = Outcome([Violation("hung", f"no report within {self._longest} s" if self.is_late else "its process ended without a report")])
        with contextlib.suppress(EOFError):
            if self._reports.poll():
                outcome = self._reports.recv()
            if self._reports.poll(0 if self.is_late else 10):  # the end of it
                self._reports.recv()
        self.kill()
        return outcome

    def give_up(self) -> None:
        """Leave nothing of it."""
        self.kill()
        shutil.rmtree(self.folder, ignore_errors=True)

    def kill(self) -> None:
        """End it and all that it has started."""
        assert self._process.pid is not None
        with contextlib.suppress(ProcessLookupError):  # its group is named after it
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.join()

    def _play(self, server: str, record: str, sends: Connection) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        os.setsid()
        die_with_parent()
        play(self.scenario, server, record, self.folder, sends.send)


class Campaign:
    """Runs side by side, and what was found in them."""

    def __init__(self, server: str, record: str, longest: float = LONGEST) -> None:
        self._server, self._record, self._longest = server, record, longest
        self.found: collections.Counter[str] = collections.Counter()
        self.endings: collections.Counter[str] = collections.Counter()
        self.seconds = 0.0
        self.skills = 0
        self.answers = self.late_answers = 0
        self.longest_answer = 0.0  # s
        self.stopped = False  # before its end

    def play(
        self, scenarios: Iterable[Scenario], hours: float, workers: int, until_found: str | None = None
    ) -> list[tuple[Scenario, Outcome]]:
        """Play one after another until so many hours were simulated; return the runs with violations."""
        left = iter(scenarios)
        running: list[Run] = []
        bad = []
        began = time.monotonic()
        bar = tqdm(total=round(3600 * hours), unit="s", desc="simulated")
        with contextlib.ExitStack() as at_end, bar, self._stoppable():
            at_end.callback(lambda: [run.give_up() for run in running])
            while True:
                enough = self.seconds >= 3600 * hours or (until_found and self.found[until_found])
                while not enough and len(running) < workers and (what := next(left, None)) is not None:
                    running.append(Run(what, self._server, self._record, self._longest))
                if not running:
                    break
                ready = wait([run.reports for run in running], timeout=1)
                for run in [run for run in running if run.reports in ready or run.is_late]:
                    running.remove(run)
                    outcome = run.end()
                    self._count(outcome)
                    bar.update(round(outcome.seconds))
                    bar.set_postfix(skills=self.skills, violations=self.found.total())
                    if outcome.violations:
                        bar.write(f"after {time.monotonic() - began:.0f} s: " + told(run.scenario, outcome, run.folder))
                        bad.append((run.scenario, outcome))
                    else:
                        shutil.rmtree(run.folder, ignore_errors=True)
        return bad

    @contextlib.contextmanager
    def _stoppable(self) -> Iterator[None]:
        """What was played until somebody stops it counts."""
        try:
            yield
        except KeyboardInterrupt:
            self.stopped = True

    def shrink(self, whole: Scenario, outcome: Outcome) -> list[int]:
        """Leave out events while the first kind of violation stays; return the places of those that are left."""
        kind = outcome.violations[0].kind
        places = [event.seed[1] for event in whole.events]
        if (seen := outcome.violations[0].event) is not None:
            places = [place for place in places if place <= seen]
        until = time.monotonic() + SHRINKING
        parts = 2
        while len(places) > 1 and time.monotonic() < until:
            size = -(-len(places) // parts)
            for begin in range(0, len(places), size):
                fewer = places[:begin] + places[begin + size :]
                if fewer and self._has(kind, whole.only(fewer)):
                    places, parts = fewer, max(parts - 1, 2)
                    print(f"  also with events {' '.join(map(str, places))}", file=sys.stderr, flush=True)
                    break
                if time.monotonic() > until:
                    break
            else:
                if size == 1:
                    break
                parts = min(2 * parts, len(places))
        return places

    def _has(self, kind: str, what: Scenario) -> bool:
        run = Run(what, self._server, self._record)
        while not (run.is_late or wait([run.reports], timeout=1)):
            pass
        outcome = run.end()
        shutil.rmtree(run.folder, ignore_errors=True)
        return any(violation.kind == kind for violation in outcome.violations)

    def _count(self, outcome: Outcome) -> None:
        self.seconds += outcome.seconds
        self.skills += outcome.skills
        self.answers += outcome.answers
        self.late_answers += outcome.late_answers
        self.longest_answer = max(self.longest_answer, outcome.longest_answer)
        self.found.update(violation.kind for violation in outcome.violations)
        self.endings.update(outcome.endings)

    def entries(self) -> dict[str, float]:
        """For build/bench.json."""
        kinds = {f"campaign_violations_{kind}": self.found[kind] for kind in KINDS}
        return {
            "campaign_hours": self.seconds / 3600,
            "campaign_skills": self.skills,
            "campaign_answers": self.answers,
            "campaign_answers_late": self.late_answers,
            "campaign_answer_s_longest": self.longest_answer,
            "campaign_violations": self.found.total(),
        } | kinds


def of_events(seed: int, places: list[int]) -> str:
    """Return the command that plays these events of a run again."""
    return f".venv/bin/python tests/safety/campaign.py --seed {seed} --events {' '.join(map(str, places))}"


def told(what: Scenario, outcome: Outcome, folder: Path) -> str:
    """What was found in a run, with where it is left and how to have it again."""
    kept = FOUND / f"seed-{what.seed}"
    shutil.rmtree(kept, ignore_errors=True)
    kept.parent.mkdir(parents=True, exist_ok=True)
    shutil.move(folder, kept)
    (kept / "said.txt").write_text("\n".join([f"{what}", *outcome.said]) + "\n")
    whole = len(what.events) == scenario.EVENTS
    again = f"make safety SEED={what.seed}" if whole else of_events(what.seed, [event.seed[1] for event in what.events])
    lines = [f"seed {what.seed} ({what.robot}): {len(outcome.violations)} violations; {again}"]
    for violation in outcome.violations[:5]:
        where = "" if violation.event is None else f"in event {violation.event}, {what.kind_at(violation.event)}: "
        lines.append(f"  {violation.kind}: {where}{violation.text}")
    return "\n".join([*lines, f"  {kept.relative_to(REPOSITORY)}"])


def write_junit(file: Path, scenarios: list[Scenario], bad: list[tuple[Scenario, Outcome]]) -> None:
    """A test for each run, for programs."""
    suite = ElementTree.Element("testsuite", name="safety", tests=str(len(scenarios)))
    found = {what.seed: outcome for what, outcome in bad}
    for what in scenarios:
        case = ElementTree.SubElement(suite, "testcase", classname="safety", name=f"seed {what.seed} ({what.robot})")
        if what.seed in found:
            violations = [f"{each.kind}: {each.text}" for each in found[what.seed].violations]
            failure = ElementTree.SubElement(case, "failure", message="; ".join(violations))
            failure.text = "\n".join([*found[what.seed].said, *violations])  # the end is what is shown
    file.parent.mkdir(parents=True, exist_ok=True)
    ElementTree.ElementTree(suite).write(file, encoding="unicode")


def stopped(number: int, _frame: object) -> None:
    """Let what runs be ended."""
    raise KeyboardInterrupt(signal.Signals(number).name)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=20, help="simulated (default: %(default)g)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first run (default: %(default)d)")
    parser.add_argument("--seed", type=int, help="only this run")
    parser.add_argument("--events", type=int, nargs="+", help="of that run only these, by their places")
    parser.add_argument("--runs", type=int, help="at most so many")
    parser.add_argument("--workers", type=int, default=WORKERS, help="runs at a time (default: %(default)d)")
    parser.add_argument("--server", help="another franka-interface, to see that the campaign finds what it lacks")
    parser.add_argument("--record", default="always", help="what the server records; other than always: likewise")
    parser.add_argument("--until-found", choices=KINDS, help="end with the first run that has a violation of this kind")
    parser.add_argument("--no-shrink", action="store_true", help="leave runs with violations as long as they are")
    parser.add_argument("--gate", type=Path, metavar="FILE", help="only what every change has to pass; FILE gets it as JUnit")
    options = parser.parse_args()
    tqdm.monitor_interval = 0  # its thread would be forked
    signal.signal(signal.SIGTERM, stopped)
    longest = LONGEST if options.gate is None else GATE_LONGEST
    campaign = Campaign(options.server or program("franka-interface"), options.record, longest)
    if options.gate is not None:
        scenarios = [scenario.draw(seed) for seed in GATE]
        bad = campaign.play(scenarios, hours=1, workers=options.workers)
        write_junit(options.gate, scenarios, bad)
        return 1 if bad or campaign.stopped else 0
    if options.seed is not None:
        what = scenario.draw(options.seed)
        run = Run(what if options.events is None else what.only(options.events), campaign._server, campaign._record)
        while not (run.is_late or wait([run.reports], timeout=1)):
            pass
        outcome = run.end()
        print("\n".join(outcome.said))
        bad = [(run.scenario, outcome)] if outcome.violations else []
        if bad:
            print(told(run.scenario, outcome, run.folder))
        else:
            print(f"{outcome.skills} skills, {outcome.seconds:.0f} s, nothing found")
            shutil.rmtree(run.folder, ignore_errors=True)
    else:
        seeds = range(options.first, options.first + (options.runs or 1_000_000))
        bad = campaign.play(map(scenario.draw, seeds), options.hours, options.workers, options.until_found)
        print(json.dumps(campaign.entries(), indent=2))
        print(dict(campaign.endings.most_common(20)), file=sys.stderr)
        if not options.server and options.record == "always":
            entries = json.loads(BENCH.read_text()) if BENCH.exists() else {}
            BENCH.write_text(json.dumps(entries | campaign.entries(), indent=2, sort_keys=True) + "\n")
    if options.until_found:
        return 0 if campaign.found[options.until_found] else 1
    if bad and not options.no_shrink and options.events is None and not campaign.stopped:
        print("Which events does the first of them need?", file=sys.stderr)
        places = campaign.shrink(*bad[0])
        print(f"these: {of_events(bad[0][0].seed, places)}" + (f" --server {options.server}" if options.server else ""))
    return 1 if bad or campaign.stopped else 0


if __name__ == "__main__":
    sys.exit(main())
