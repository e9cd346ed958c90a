"""Run independent programs against ours, and show what came of it: `run.py [build directory]`."""

import sys
from pathlib import Path

import clients
import errors
import models
import servers
from peer import REPOSITORY, Result


def main() -> int:
    """Print a table; 1 when something failed that the peer itself can do."""
    build = Path(sys.argv[1]) if len(sys.argv) > 1 else REPOSITORY / "build"
    results: list[Result] = []
    for module in (clients, models, errors, servers):
        print(f"\n{module.__doc__}")
        for result in module.run(build):
            results.append(result)
            verdict = "OK" if result.ok else "peer can't" if result.excuse else "FAILED"
            why = result.excuse if result.excuse and not result.ok else result.why
            print(f"{result.peer:24}{result.mode:12}{result.capability:60}{verdict:12}{why}", flush=True)
    failed = [result for result in results if not result.ok and not result.excuse]
    print(f"\n{sum(result.ok for result in results)} OK, {len(failed)} failed, "
          f"{len(results) - len(failed) - sum(result.ok for result in results)} that the peer itself can't")  # fmt: skip
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
