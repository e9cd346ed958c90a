"""Every error that a client can provoke, provoked by independent clients of the arm; docs/errors.md says by whom."""

import re
import subprocess
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from peer import NOT_INSTALLED, REPOSITORY, Result, free_address, run_installed, tabled

SCRIPTS = REPOSITORY / "tests" / "interop" / "clients"
TABLE = REPOSITORY / "docs" / "errors.md"
TIME = 600  # s for all errors of one client
CLIENTS = [  # package, version, script, arm
    ("pylibfranka", "0.21.3", "pylibfranka_errors.py", "fr3"),
    ("panda-python", "1.1.1", "panda_python_errors.py", "fer"),
]
OWN = "our own client"
OWN_TESTS = "OwnClient."  # tests named by the error that they provoke

# Why no client provokes an error by what it commands.
UNPROVOKED = {
    "cartesian_position_limits_violation": "the arm has no virtual walls until somebody sets them up",
    "force_control_safety_violation": "of the robot's own force control, which FCI does not offer",
    "cartesian_velocity_profile_safety_violation": "of the robot's own motions, which FCI does not offer",
    "force_controller_desired_force_tolerance_violation": "of the robot's own force control, which FCI does not offer",
    "start_elbow_sign_inconsistent": "of motions that Desk starts",
    "joint_p2p_insufficient_torque_for_planning": "of the robot's own motions, which FCI does not offer",
    "instability_detected": "how the robot detects it is not published",
    "joint_move_in_wrong_direction": "a hand that guides a joint farther out of its range",
    "cartesian_spline_motion_generator_violation": "of the robot's own motions, which FCI does not offer",
    "joint_via_motion_generator_planning_joint_limit_violation": "of the robot's own motions, which FCI does not offer",
    "base_acceleration_initialization_timeout": "the base's sensor does not fail",
    "base_acceleration_invalid_reading": "the base's sensor does not fail",
}


def error_names() -> list[str]:
    """All errors by index, from the one place that has them."""
    text = (REPOSITORY / "wire" / "fci" / "errors.hpp").read_text()
    (table,) = re.findall(r"kErrorNames = \{(.*?)\};", text, re.DOTALL)
    return re.findall(r'"(\w+)"', table)


def try_client(peer: str, python: Path, script: str, robot: str, program: Path) -> Iterator[Result]:
    """Start an arm, and let the client provoke one error after the other."""
    address = free_address()
    arm = subprocess.Popen(
        [program, "--robot", robot, "--listen", address, "--lockstep"], stdout=subprocess.PIPE, text=True
    )
    try:
        arm.stdout.readline()  # the line that says it is ready
        done = subprocess.run(
            [python, SCRIPTS / script, address], capture_output=True, text=True, timeout=TIME, check=False
        )
        rows = [line.split("\t") for line in done.stdout.splitlines() if line.count("\t") == 2]
        for error, verdict, why in rows:
            ok = verdict == "OK"
            yield Result(peer, "lockstep", error, ok, "" if ok else why, why if verdict == "can't" else "")
        if done.returncode != 0:
            end = f"it ended with {done.returncode}: {done.stderr.strip()[-500:]}"
            yield Result(peer, "lockstep", "run to the end", False, end)
    except subprocess.TimeoutExpired:
        yield Result(peer, "lockstep", "run to the end", False, f"it took more than {TIME} s")
    finally:
        arm.terminate()
        arm.wait(10)


def try_own(program: Path) -> Iterator[Result]:
    """What independent clients have no way to say."""
    done = subprocess.run(
        [program, f"--gtest_filter={OWN_TESTS}*"], capture_output=True, text=True, timeout=TIME, check=False
    )
    for verdict, error in re.findall(rf"\[ +(OK|FAILED) +\] {re.escape(OWN_TESTS)}(\w+) \(", done.stdout):
        yield Result(OWN, "lockstep", error, verdict == "OK", "" if verdict == "OK" else done.stdout[-500:])


def table(results: list[Result]) -> str:
    """Who has received which error."""
    peers = [f"{name} {version}" for name, version, *_ in CLIENTS] + [OWN]
    received = {(result.peer, result.capability) for result in results if result.ok}
    independent = {error for peer, error in received if peer != OWN}
    names = error_names()
    lines = [
        "# Errors of the robot and who provokes them here",
        "",
        "Written by `make interop`: each error is provoked by commands to the arm and received under its name.",
        f"{len(independent)} of {len(names)} by independent clients. Those that no command provokes are raised with "
        "`frankapy.sim.Simulation`.",
        "",
        f"| index | error | {' | '.join(peers)} | remark |",
        f"|---|---|{'---|' * len(peers)}---|",
    ]
    for index, name in enumerate(names):
        marks = ["received" if (peer, name) in received else "" for peer in peers]
        lines.append(f"| {index} | `{name}` | {' | '.join(marks)} | {UNPROVOKED.get(name, '')} |")
    return "\n".join(lines) + "\n"


def run(build: Path, lockstep: bool) -> Iterator[Result]:
    """Every client, and the table of what came of it; with `lockstep` it has to be as it is."""

    def results_of(client: tuple[str, str, str, str]) -> list[Result]:
        name, version, script, robot = client

        def tries(python: Path) -> Iterator[Result]:
            return try_client(f"{name} {version}", python, script, robot, build / "bin" / "fci-sim")

        return list(run_installed(name, version, tries))

    with ThreadPoolExecutor() as side_by_side:
        results = [result for some in side_by_side.map(results_of, CLIENTS) for result in some]
    results += try_own(build / "bin" / "sim_test")
    yield from results
    if any(result.capability == NOT_INSTALLED for result in results):
        return
    missing = set(error_names()) - {result.capability for result in results if result.ok} - set(UNPROVOKED)
    for error in sorted(missing):
        yield Result("all", "lockstep", error, False, "nobody has received it")
    yield from tabled(TABLE, table(results), write=not lockstep)
