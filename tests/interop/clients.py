"""Independent programs as clients of the simulated arm; docs/clients.md says what each does."""

import dataclasses
import functools
import subprocess
import tempfile
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from peer import NOT_INSTALLED, REPOSITORY, Result, free_address, run_installed, tabled
from world import World

SCRIPTS = REPOSITORY / "tests" / "interop" / "clients"
MODES = {"real time": [], "lockstep": ["--lockstep"]}
TABLE = REPOSITORY / "docs" / "clients.md"
TIME = 240  # s for all that one program tries


@dataclasses.dataclass
class Client:
    """A program that speaks to a robot."""

    name: str
    version: str  # on PyPI
    script: str
    robot: str

    @property
    def peer(self) -> str:
        """Name and version, for people."""
        return f"{self.name} {self.version}"


CLIENTS = [
    Client("pylibfranka", "0.21.3", "pylibfranka_client.py", "fr3"),
    Client("panda-python", "1.1.1", "panda_python_client.py", "fer"),
    Client("franky-control", "1.1.0", "franky_client.py", "fr3"),  # libfranka 0.15.0: protocol 9
    Client("franky-control", "2.0.0", "franky_client.py", "fr3"),
]


def results_of(client: Client, python: Path, address: str, mode: str) -> Iterator[Result]:
    """Run a client, and do around the arm what it asks for."""
    world = World(address)
    results, hung = 0, threading.Event()
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(
            [python, SCRIPTS / client.script, address], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True
        ) as program,
    ):
        patience = threading.Timer(TIME, lambda: (hung.set(), program.kill()))
        patience.start()
        for line in program.stdout:
            if line.count("\t") != 2:
                continue
            name, verdict, why = line.rstrip("\n").split("\t")
            if verdict == "ask":
                print(world.do(name, why), file=program.stdin, flush=True)
                continue
            results += 1
            yield Result(client.peer, mode, name, verdict == "OK", why, why if verdict == "can't" else "")
        status = program.wait()
        patience.cancel()
        errors.seek(0)
        wrote = errors.read().decode(errors="replace").strip()[-500:]
    if hung.is_set():
        yield Result(client.peer, mode, "run to the end", False, f"it hung for more than {TIME} s")
    elif status not in (0, 1) or results == 0:
        yield Result(client.peer, mode, "run to the end", False, f"it ended with {status}: {wrote}")


def try_client(client: Client, python: Path, program: Path, mode: str) -> Iterator[Result]:
    """Start an arm, and let the client try all that it can do with it."""
    address = free_address()
    arm = subprocess.Popen(
        [program, "--robot", client.robot, "--listen", address, *MODES[mode]],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        if not arm.stdout.readline():  # the line that says it is ready
            yield Result(client.peer, mode, "start the arm", False, arm.stderr.read().strip())
            return
        yield from results_of(client, python, address, mode)
        if arm.poll() is not None:
            yield Result(client.peer, mode, "arm goes on", False, f"fci-sim ended with {arm.returncode}")
    finally:
        arm.terminate()
        arm.wait(10)


def table(results: list[Result]) -> str:
    """What each client has done."""
    cells = {(result.capability, result.peer): "yes" if result.ok else result.excuse or "fails" for result in results}
    peers = [client.peer for client in CLIENTS]
    lines = [
        "# What clients do with the simulated arm",
        "",
        "Written by `make interop`: independent programs, as they are on PyPI, with `fci-sim --lockstep`. An empty field: it was "
        "not asked of that client, mostly because it does not offer it. Errors: [errors.md](errors.md).",
        "",
        "- *User stop*: pressed while such a motion runs. The client is told so, sees the robot's mode, is refused a motion and a "
        "recovery, and moves again when it is let go.",
        "- *Guiding*: the client sees the mode while somebody leads the arm by the hand; of the axes that it sets, only along "
        "those that are free.",
        "- *Setters* (`set_...`): a value in range, seen in the robot's state, or in how a push is felt where the state does not "
        "tell it (Cartesian impedance: taken, and nothing more); values out of range are refused with the client's own exception.",
        "- *Grasp*: of a block of 4 cm, twice outside the tolerances asked for and twice within; it is lifted, and let go.",
        "",
        f"| | {' | '.join(peers)} |",
        f"|---|{'---|' * len(peers)}",
    ]
    for capability in dict.fromkeys(result.capability for result in results):
        lines.append(f"| {capability} | {' | '.join(cells.get((capability, peer), '') for peer in peers)} |")
    return "\n".join(lines) + "\n"


def try_modes(client: Client, program: Path, modes: Iterable[str], python: Path) -> Iterator[Result]:
    """Let a client try with an arm in each of these."""
    for mode in modes:
        yield from try_client(client, python, program, mode)


def run(build: Path, lockstep: bool) -> Iterator[Result]:
    """Every client, with the arm in real time and in lockstep, or in lockstep alone, where the table has to be as it is."""
    modes = ["lockstep"] if lockstep else MODES
    program = build / "bin" / "fci-sim"

    def rows_of(client: Client) -> list[Result]:
        return list(run_installed(client.name, client.version, functools.partial(try_modes, client, program, modes)))

    results = []
    with ThreadPoolExecutor(len(CLIENTS) if lockstep else 1) as side_by_side:
        for some in side_by_side.map(rows_of, CLIENTS):
            results += some
            yield from some
    if not any(result.capability == NOT_INSTALLED for result in results):
        yield from tabled(TABLE, table([result for result in results if result.mode == "lockstep"]), write=not lockstep)
