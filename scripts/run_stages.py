#!/usr/bin/python3
"""Run stages, each under a limit of its own and whatever became of the others, and say what came of them.

    run_stages.py gate|nightly [STAGE...]

A stage is a target of the Makefile. What it prints is in build/stages/<stage>.log, what its tests say of themselves in
JUnit files below build/stages/<stage>/, and these are what is counted; a stage that writes none counts as one test. A stage
that takes longer than it should is SLOW, and at twice that is ended and has failed. Tests of the stage `wall` are about wall
time and have three tries; most other tests of the gate have a second one (a stage that wrote none, as a whole), which is named:
such a test is to be mended. Everything that a stage has started is ended with it. `nightly` also writes build/nightly.json.
Exit status: 0 when all passed.
"""

import collections
import ctypes
import dataclasses
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
FOLDER = REPOSITORY / "build" / "stages"
prctl = ctypes.CDLL(None).prctl
PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36  # linux/prctl.h
LAST_LINES = 30
FEW = 5  # tests that are named
PROGRESS = 60.0  # s, after which what runs still says how far it is


@dataclasses.dataclass
class Stage:
    """A target, how long it should take at the most, s, and how often its failed tests are tried."""

    target: str
    allowed: float
    tries: int = 1


# Twice of what a machine with two cores needs that has compiled nothing before; 20 minutes together where it has.
GATE = [
    Stage("setup", 180),
    Stage("build", 900),
    Stage("test-cpp", 240, tries=2),
    Stage("test-python", 480, tries=2),
    Stage("types", 120),
    Stage("interop-lockstep", 240, tries=2),
    Stage("demo-lockstep", 120, tries=2),
    Stage("safety-gate", 120),
    Stage("asan", 700, tries=2),
    Stage("tsan", 500, tries=2),
    Stage("fuzz-gate", 300),
    Stage("wall", 120, tries=3),
]
NIGHTLY = [
    Stage("setup", 600),
    Stage("build", 3600),
    Stage("test-cpp", 900),
    Stage("test-python", 1200),
    Stage("types", 120),
    Stage("test-nightly", 7200),
    Stage("wall-20", 3600),
    Stage("interop", 1800),
    Stage("demo", 300),
    Stage("asan-all", 5400),
    Stage("tsan-all", 5400),
    Stage("fuzz", 2200),
    Stage("safety-lacking", 2700),
    Stage("safety", 36000),
    Stage("bench", 36000),
]


@dataclasses.dataclass
class Outcome:
    """What came of a stage: its tests by name with what the failed ones said, and what it printed last if it failed.

    `troubles`: what was wrong with this computer when it had failed.
    """

    stage: Stage
    seconds: float = 0
    tests: int = 0
    failed: dict[str, str] = dataclasses.field(default_factory=dict)
    again: dict[str, str] = dataclasses.field(default_factory=dict)  # needed a further try, and what they said then
    troubles: list[str] = dataclasses.field(default_factory=list)
    skipped: list[str] = dataclasses.field(default_factory=list)

    @property
    def verdict(self) -> str:
        """One word for the table."""
        return "FAILED" if self.failed else "SLOW" if self.seconds > self.stage.allowed else "ok"


def descendants() -> list[int]:
    """Every process that comes from this one, also those whose parents have gone."""
    parents = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                parents[int(folder.name)] = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
            except (OSError, IndexError):
                continue
    found = {os.getpid()}
    while grown := {process for process, parent in parents.items() if parent in found} - found:
        found |= grown
    return list(found - {os.getpid()})


def reap() -> tuple[int, int] | None:
    """A process that has ended and how, or None while all others run."""
    try:
        process, status = os.waitpid(-1, os.WNOHANG)
    except ChildProcessError:
        return None
    return (process, status) if process else None


def end_descendants() -> None:
    """End them, first with a word."""
    for number, patience in ((signal.SIGTERM, 3), (signal.SIGKILL, 1)):
        for process in descendants():
            try:
                os.kill(process, number)
            except (ProcessLookupError, PermissionError):  # of root, of what sudo runs
                continue
        deadline = time.monotonic() + patience
        while descendants() and time.monotonic() < deadline:
            while reap() is not None:
                pass
            time.sleep(0.05)


def last_lines(text: str, count: int = LAST_LINES) -> str:
    """The end of what something printed."""
    return "\n".join(line[:300] for line in text.strip().splitlines()[-count:])


def read_junit(folder: Path) -> tuple[int, dict[str, str], list[str]]:
    """The number of tests that ran, what each failed one said, by name, and who was skipped; a failure as well where none ran.

    Of a test that is in several files the name says in how many of them it failed.
    """
    count, failed, skipped = 0, {}, []
    runs, failures = collections.Counter(), collections.Counter()
    for file in sorted(folder.glob("*.xml")):
        try:
            cases = list(ElementTree.parse(file).iter("testcase"))
        except ElementTree.ParseError as error:
            failed[file.name] = f"not readable: {error}"
            continue
        ran, wrong = set(), set()
        for case in cases:
            if (why := case.find("skipped")) is not None:
                skipped.append(f"{case.get('name')} ({why.get('message')})")
                continue
            count += 1
            name = f"{case.get('classname', '')}.{case.get('name')}" if file.stem[:5] != "ctest" else case.get("name")
            ran.add(name)
            parts = [part for part in case if part.tag in ("failure", "error")]
            if parts or case.get("status") == "fail":
                wrong.add(name)
                said = [f"{part.get('message') or ''}\n{part.text or ''}" for part in parts]
                said += [part.text or "" for part in case.iter("system-out")]
                told = last_lines("\n".join(said))
                failed[name] = f"{failed[name]}\n{told}" if name in failed else told  # pytest: its end, too, may be an error
        runs.update(ran)
        failures.update(wrong)
    for name, times in failures.items():
        if runs[name] > 1:
            failed[f"{name} ({times} of {runs[name]} times)"] = failed.pop(name)
    if count == 0 and not failed and any(folder.glob("*.xml")):
        failed["no test"] = "nothing was run: is what chooses the tests right?"
    return count, failed, skipped


def run_make(target: str, log: Path, junit: Path, again: bool, limit: float) -> int | None:
    """Run a target; its exit status, or None when it was ended."""
    shutil.rmtree(junit, ignore_errors=True)
    junit.mkdir(parents=True, exist_ok=True)
    command = ["make", "--no-print-directory", target, f"JUNIT={junit}", *(["AGAIN=1"] if again else [])]
    with log.open("a" if again else "w") as output:
        process = subprocess.Popen(
            command,
            cwd=REPOSITORY,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
            preexec_fn=lambda: prctl(PR_SET_PDEATHSIG, signal.SIGTERM),
        )
        start = time.monotonic()
        told = start
        try:
            while (now := time.monotonic()) < start + limit:
                # All that has ended: processes whose parents have gone come to this one.
                while (ended := reap()) is not None:
                    if ended[0] == process.pid:
                        process.returncode = os.waitstatus_to_exitcode(ended[1])
                        return process.returncode
                if now > told + PROGRESS:
                    told = now
                    said = last_lines(log.read_text(errors="replace"), 1)[:90]
                    print(f"{now - start:6.0f} s  {said}\n{target:18}", end="", flush=True)
                time.sleep(0.05)
            return None
        finally:
            end_descendants()


def run(stage: Stage) -> Outcome:
    """Run a stage, and its failed tests again where they have more tries."""
    log, junit = FOLDER / f"{stage.target}.log", FOLDER / stage.target
    start = time.monotonic()
    outcome = Outcome(stage)
    count = 0
    failed: dict[str, str] = {}
    for attempt in range(stage.tries):
        before = failed
        left = 2 * stage.allowed - (time.monotonic() - start)
        try:
            status = run_make(stage.target, log, junit, count > 0, max(left, 1))
            count, failed, outcome.skipped = read_junit(junit)
            said = last_lines(log.read_text(errors="replace")) or "its log is empty"
        except OSError as error:  # a full disk, for one
            status, count, failed, said = 1, 0, {}, str(error)
        outcome.tests = max(outcome.tests, count)
        if status is None:
            failed[f"make {stage.target}"] = f"ended after {2 * stage.allowed:g} s\n{said}"
        elif status != 0 and not failed:
            failed[f"make {stage.target}"] = said
        if f"make {stage.target}" in failed:  # not said of which: what had failed before has not passed
            failed = before | failed
        outcome.failed = failed
        if not failed or status is None:
            break
        if attempt + 1 < stage.tries:
            outcome.again |= failed
    outcome.troubles = troubles() if outcome.failed else []
    outcome.tests = max(outcome.tests, len(outcome.failed), 1)
    outcome.seconds = time.monotonic() - start
    return outcome


def troubles() -> list[str]:
    """What is wrong with this computer that may have made stages fail."""
    found = []
    for folder, needed in ((REPOSITORY, 4e9), (Path("/dev/shm"), 5e8), (Path("/tmp"), 1e9)):
        try:
            if (free := shutil.disk_usage(folder).free) < needed:
                found.append(f"{folder} has {free / 1e6:.0f} MB left; some {needed / 1e6:.0f} MB are needed: make room there")
        except OSError as error:
            found.append(f"{folder}: {error.strerror}")
    others = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            program = Path((process / "cmdline").read_text(errors="replace").partition("\0")[0]).name
        except OSError:
            continue
        if program in ("fci-sim", "franka-interface"):
            others.append(f"{program} (process {process.name})")
    if others:
        found.append(f"{', '.join(others)} of other runs take processor time; what such a run has left over: `kill` its process")
    return found


def compiler_cache() -> str:
    """What ccache says of this run."""
    try:
        said = subprocess.run(["ccache", "--print-stats"], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return "no ccache"
    numbers = dict(line.split("\t") for line in said.splitlines())
    hits = int(numbers["direct_cache_hit"]) + int(numbers["preprocessed_cache_hit"])
    return f"{hits} of {hits + int(numbers['cache_miss'])} found by ccache since its counters were last zero"


def report(outcomes: list[Outcome], seconds: float) -> None:
    """The table, what failed and why, and as the last line what counts."""
    for outcome in outcomes:
        for name, said in outcome.again.items():
            if name not in outcome.failed:
                print(f"\n--- {outcome.stage.target}: {name}, of which a further try passed\n{said}")
        for name, said in outcome.failed.items():
            print(f"\n--- {outcome.stage.target}: {name}\n{said}")
    print(f"\n{'stage':18}{'tests':>7}{'failed':>8}{'s':>8}{'of':>7}")
    for o in outcomes:
        print(f"{o.stage.target:18}{o.tests:7}{len(o.failed):8}{o.seconds:8.0f}{o.stage.allowed:7.0f}  {o.verdict}")
    print(f"{'all':18}{sum(o.tests for o in outcomes):7}{sum(len(o.failed) for o in outcomes):8}{seconds:8.0f}")
    print(f"{os.cpu_count()} processors; {compiler_cache()}")
    for outcome in outcomes:
        for name in outcome.failed:
            print(f"failed: {outcome.stage.target}: {name}")
        for trouble in outcome.troubles:
            print(f"this computer after {outcome.stage.target}: {trouble}")
        for name in outcome.again:
            print(f"needed a second try: {name}")
        if outcome.skipped and not outcome.stage.target.startswith("interop"):  # there: what a peer itself cannot do
            few = len(outcome.skipped) <= FEW
            print(f"skipped in {outcome.stage.target}: {', '.join(outcome.skipped) if few else f'{len(outcome.skipped)} tests'}")
    failed = sum(len(o.failed) for o in outcomes)
    print(f"{sum(o.tests for o in outcomes) - failed} passed, {failed} failed")


def stopped(number: int, _frame: object) -> None:
    """Let `finally` clauses run."""
    raise KeyboardInterrupt(signal.Signals(number).name)


def main() -> int:
    """Run what is asked for."""
    lists = {"gate": GATE, "nightly": NIGHTLY}
    if len(sys.argv) < 2 or sys.argv[1] not in lists:
        sys.exit(__doc__)
    stages = lists[sys.argv[1]]
    if unknown := set(sys.argv[2:]) - {stage.target for stage in stages}:
        sys.exit(f"no such stage: {', '.join(sorted(unknown))}; there are {', '.join(s.target for s in stages)}")
    prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # as under nohup
            signal.signal(number, stopped)
    subprocess.run(["ccache", "--zero-stats"], capture_output=True, check=False) if shutil.which("ccache") else None

    start, outcomes, interrupted = time.monotonic(), [], False
    try:
        for stage in stages:
            if sys.argv[2:] and stage.target not in sys.argv[2:]:
                continue
            print(f"{stage.target:18}", end="", flush=True)
            begun = time.monotonic()
            outcomes.append(outcome := run(stage))
            print(f"{outcome.verdict:8}{outcome.tests:5} tests{outcome.seconds:7.0f} s", flush=True)
    except KeyboardInterrupt as interruption:
        interrupted = True
        end_descendants()
        said = {f"stopped by {str(interruption) or 'SIGINT'}": ""}
        outcomes.append(Outcome(stage, time.monotonic() - begun, 1, said))
    report(outcomes, time.monotonic() - start)
    if sys.argv[1] == "nightly":
        results = {o.stage.target: {"tests": o.tests, "failed": sorted(o.failed), "seconds": o.seconds} for o in outcomes}
        try:
            (REPOSITORY / "build" / "nightly.json").write_text(json.dumps(results, indent=2) + "\n")
        except OSError as error:  # what is told above counts
            print(f"not written: {error}")
    if interrupted:
        print("stopped before the end", file=sys.stderr)
    return 1 if interrupted or any(outcome.failed for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
