"""Run independent programs against ours, and show what came of it."""

import argparse
import functools
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import clients
import errors
import models
import servers
from peer import REPOSITORY, Result

from frankapy.programs import die_with_parent


def verdict(result: Result) -> str:
    """One word for the table."""
    return "OK" if result.ok else "peer can't" if result.excuse else "FAILED"


def write_junit(file: Path, results: list[tuple[Result, float]]) -> None:
    """What came of it and how long each took, s, for programs."""
    suite = ElementTree.Element("testsuite", name="interop", tests=str(len(results)))
    for result, seconds in results:
        case = ElementTree.SubElement(
            suite, "testcase", classname=f"{result.peer} {result.mode}", name=result.capability, time=f"{seconds:.3f}"
        )
        if verdict(result) == "FAILED":
            ElementTree.SubElement(case, "failure", message=result.why)
        elif not result.ok:
            ElementTree.SubElement(case, "skipped", message=result.excuse)
    file.parent.mkdir(parents=True, exist_ok=True)
    ElementTree.ElementTree(suite).write(file, encoding="unicode")


MODULES = {"clients": clients, "models": models, "errors": errors, "servers": servers}


def run_module(name: str, arguments: argparse.Namespace) -> Iterator[tuple[Result, float]]:
    """Run one of them; each row, and how long it took, s."""
    if arguments.lockstep and name == "servers":
        print("servers: not run here, these arms keep real time")
        return
    last = time.monotonic()
    try:
        lockstep = {"lockstep": arguments.lockstep} if name in ("clients", "errors") else {}
        for result in MODULES[name].run(arguments.build, **lockstep):
            now = time.monotonic()
            yield result, now - last
            last = now
    except Exception as error:  # noqa: BLE001 - a row that says so, and the other modules run
        yield Result(name, "", "run to the end", False, f"{type(error).__name__}: {error}"), time.monotonic() - last


def main() -> int:
    """Print a table; 1 when something failed that the peer itself can do."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=Path, default=REPOSITORY / "build", help="where the programs are")
    parser.add_argument("--junit", type=Path, help="a file for what came of it")
    parser.add_argument("--lockstep", action="store_true", help="only what does not depend on this computer's speed")
    parser.add_argument("--again", action="store_true", help="only the modules of which something failed last time")
    parser.add_argument("module", nargs="*", help=f"of {', '.join(MODULES)}; without any, all")
    arguments = parser.parse_args()
    if unknown := set(arguments.module) - set(MODULES):
        parser.error(f"no such module: {', '.join(sorted(unknown))}")

    subprocess.Popen.__init__ = functools.partialmethod(subprocess.Popen.__init__, preexec_fn=die_with_parent)
    names = arguments.module or list(MODULES)
    last = arguments.build / "interop" / "failed"
    if arguments.again and last.exists():
        names = [name for name in names if name in last.read_text().split()]
    last.unlink(missing_ok=True)
    failed = set()

    def everything() -> Iterator[tuple[str, Iterable[tuple[Result, float]]]]:
        if not arguments.lockstep:
            yield from ((name, run_module(name, arguments)) for name in names)
            return
        with ThreadPoolExecutor() as side_by_side:  # nothing depends on this computer's speed
            yield from zip(names, side_by_side.map(lambda name: list(run_module(name, arguments)), names), strict=True)

    results: list[tuple[Result, float]] = []
    for name, rows in everything():
        print(f"\n{MODULES[name].__doc__}")
        for result, seconds in rows:
            results.append((result, seconds))
            if verdict(result) == "FAILED":
                failed.add(name)
            why = result.excuse if result.excuse and not result.ok else result.why
            print(f"{result.peer:24}{result.mode:12}{result.capability:60}{verdict(result):12}{why}", flush=True)
    last.parent.mkdir(exist_ok=True)
    last.write_text(" ".join(sorted(failed)))
    if arguments.junit:
        write_junit(arguments.junit, results)
    verdicts = [verdict(result) for result, _ in results]
    print(f"\n{verdicts.count('OK')} OK, {verdicts.count('FAILED')} failed, "
          f"{len(verdicts) - verdicts.count('OK') - verdicts.count('FAILED')} that the peer itself can't")  # fmt: skip
    return 1 if "FAILED" in verdicts else 0


if __name__ == "__main__":
    sys.exit(main())
