"""Run independent programs against ours, and show what came of it."""

import argparse
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

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


MODULES = {"clients": clients, "models": models, "errors": errors, "servers": servers}


def run_module(module: ModuleType, arguments: argparse.Namespace) -> Iterator[Result]:
    """Run one of them."""
    if module is clients:
        return clients.run(arguments.build, ["lockstep"] if arguments.lockstep else clients.MODES)
    return module.run(arguments.build)


def main() -> int:
    """Print a table; 1 when something failed that the peer itself can do."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=Path, default=REPOSITORY / "build", help="where the programs are")
    parser.add_argument("--junit", type=Path, help="a file for what came of it")
    parser.add_argument("--lockstep", action="store_true", help="only what does not depend on this computer's speed")
    parser.add_argument("module", nargs="*", help=f"of {', '.join(MODULES)}; without any, all")
    arguments = parser.parse_args()
    if unknown := set(arguments.module) - set(MODULES):
        parser.error(f"no such module: {', '.join(sorted(unknown))}")

    def everything() -> Iterator[Result]:
        for name, module in MODULES.items():
            if arguments.module and name not in arguments.module:
                continue
            print(f"\n{module.__doc__}")
            if arguments.lockstep and module is servers:
                print("not run here: these arms keep real time")
                continue
            try:
                yield from run_module(module, arguments)
            except (OSError, subprocess.SubprocessError) as error:  # a peer that cannot be installed, for one
                yield Result(name, "", "run to the end", False, f"{type(error).__name__}: {error}")

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
