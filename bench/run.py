"""Run every program of bench/ and merge what they measure into build/bench.json.

A program is a bench/*.cpp (built to build/bench/<name>) or another bench/*.py. It may print what it likes on stderr; the
last line of its stdout is a flat JSON object {"name_of_entry": number}. Programs run one after another and alone,
since they measure time. One that counts what may not happen has failed. Names given as arguments run only these, and
leave the other entries of build/bench.json; without any, those of the campaign stay, which is no program of bench/.
"""

import json
import subprocess
import sys
from pathlib import Path

from tqdm import tqdm

REPOSITORY = Path(__file__).resolve().parent.parent
BUILD = REPOSITORY / "build"
LONGEST = 4 * 3600  # s that a program may take: random switches and all combinations take their time
OUTPUT = BUILD / "bench.json"
# Entries that count what may not happen.
NEVER = ("combinations_wrong", "landing_reflexes", "log_lost", "loss_errors", "random_stream_reflexes", "state_lost", "switch_discontinuities")
CAMPAIGN = "campaign_"  # entries of tests/safety/campaign.py


def commands() -> dict[str, list[str]]:
    """Return the command of each program by its name."""
    sources = sorted(p for p in (REPOSITORY / "bench").iterdir() if p.suffix in (".cpp", ".py") and p.name != "run.py")
    return {
        p.stem: [sys.executable, str(p)] if p.suffix == ".py" else [str(BUILD / "bench" / p.stem)] for p in sources
    }


def measure(command: list[str]) -> dict[str, float]:
    """Run one program and return its entries; raise ValueError when it fails or prints something else."""
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, cwd=REPOSITORY, check=False, timeout=LONGEST)
    if done.returncode != 0:
        raise ValueError(f"ended with status {done.returncode}")
    last_line = (done.stdout.strip().splitlines() or [""])[-1]
    try:
        entries = json.loads(last_line)
    except json.JSONDecodeError:
        entries = None
    if not isinstance(entries, dict) or not all(isinstance(v, (int, float)) for v in entries.values()):
        raise ValueError(f"the last line of its output should be a flat JSON object of numbers, and is {last_line!r}")
    return entries


def main() -> int:
    programs = commands()
    chosen = sys.argv[1:] or list(programs)
    if unknown := set(chosen) - set(programs):
        print(f"No such benchmark: {', '.join(sorted(unknown))}. There are: {', '.join(programs)}.", file=sys.stderr)
        return 2

    there = json.loads(OUTPUT.read_text()) if OUTPUT.exists() else {}
    results = {name: value for name, value in there.items() if sys.argv[1:] or name.startswith(CAMPAIGN)}
    failures = {}
    progress = tqdm(chosen, unit="program")
    for name in progress:
        progress.set_description(name)
        try:
            entries = measure(programs[name])
        except (OSError, ValueError, subprocess.TimeoutExpired) as error:
            failures[name] = error
            continue
        results |= entries
        OUTPUT.write_text(json.dumps(results, indent=2, sort_keys=True) + "\n")
        for entry, value in entries.items():
            progress.write(f"{entry:40} {value:12.4g}")
        if wrong := [entry for entry in NEVER if entries.get(entry, 0) > 0]:
            failures[name] = ValueError(", ".join(f"{entry} is {entries[entry]:g}: expected 0" for entry in wrong))

    for name, error in failures.items():
        print(f"{name}: {error}", file=sys.stderr)
    print(f"{len(chosen) - len(failures)} passed, {len(failures)} failed; {OUTPUT.relative_to(REPOSITORY)}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
