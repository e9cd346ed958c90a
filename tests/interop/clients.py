"""Independent programs as clients of the simulated arm."""

import dataclasses
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path

from peer import REPOSITORY, Result, environment, free_address

SCRIPTS = REPOSITORY / "tests" / "interop" / "clients"
MODES = {"real time": [], "lockstep": ["--lockstep"]}
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
        try:
            done = subprocess.run(
                [python, SCRIPTS / client.script, address], capture_output=True, text=True, timeout=TIME, check=False
            )
            out, end = done.stdout, f"it ended with {done.returncode}: {done.stderr.strip()[-500:]}"
            complete = done.returncode in (0, 1)
        except subprocess.TimeoutExpired as expired:
            out, end, complete = (expired.stdout or b"").decode(), f"it hung for more than {TIME} s", False
        rows = [line.split("\t") for line in out.splitlines() if line.count("\t") == 2]
        for capability, verdict, why in rows:
            yield Result(client.peer, mode, capability, verdict == "OK", why)
        if not complete or not rows:
            yield Result(client.peer, mode, "run to the end", False, end)
        if arm.poll() is not None:
            yield Result(client.peer, mode, "arm goes on", False, f"fci-sim ended with {arm.returncode}")
    finally:
        arm.terminate()
        arm.wait(10)


def run(build: Path, modes: Iterable[str] = MODES) -> Iterator[Result]:
    """Every client, with the arm in real time and in lockstep."""
    program = build / "bin" / "fci-sim"
    for client in CLIENTS:
        python = environment(client.name, client.version)
        for mode in modes:
            yield from try_client(client, python, program, mode)
