"""Run independent programs against ours, and show what came of it."""

import argparse
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import clients
import errors
import models
import servers
from peer import REPOSITORY, Result


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


def main() -> int:
    """Print a table; 1 when something failed that the peer itself can do."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=Path, default=REPOSITORY / "build", help="where the programs are")
    parser.add_argument("--junit", type=Path, help="a file for what came of it")
    parser.add_argument("--lockstep", action="store_true", help="only what does not depend on this computer's speed")
    arguments = parser.parse_args()

    def everything() -> Iterator[Result]:
        modes = ["lockstep"] if arguments.lockstep else list(clients.MODES)
        print(f"\n{clients.__doc__}")
        yield from clients.run(arguments.build, modes)
        for module in (models, errors) if arguments.lockstep else (models, errors, servers):
            print(f"\n{module.__doc__}")
            yield from module.run(arguments.build)

    results: list[tuple[Result, float]] = []
    last = time.monotonic()
    for result in everything():
        now = time.monotonic()
        results.append((result, now - last))
        last = now
        why = result.excuse if result.excuse and not result.ok else result.why
        print(f"{result.peer:24}{result.mode:12}{result.capability:60}{verdict(result):12}{why}", flush=True)
    if arguments.junit:
        write_junit(arguments.junit, results)
    verdicts = [verdict(result) for result, _ in results]
    print(f"\n{verdicts.count('OK')} OK, {verdicts.count('FAILED')} failed, "
          f"{len(verdicts) - verdicts.count('OK') - verdicts.count('FAILED')} that the peer itself can't")  # fmt: skip
    return 1 if "FAILED" in verdicts else 0


if __name__ == "__main__":
    sys.exit(main())
