"""Independent simulated arms, which our server runs."""

import contextlib
import dataclasses
import functools
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from peer import REPOSITORY, Result, environment, free_address, is_taken, run_installed

MOTIONS = REPOSITORY / "tests" / "interop" / "motions.py"
START_TIME, TIME = 120, 240  # s


@dataclasses.dataclass
class Server:
    """A program that is an arm to others."""

    name: str
    version: str  # on PyPI
    arguments: list[str]  # after its Python; ADDRESS stands for the address
    excuses: dict[str, str] = dataclasses.field(default_factory=dict)  # capability: why the peer cannot

    @property
    def peer(self) -> str:
        """Name and version, for people."""
        return f"{self.name} {self.version}"


FRANKY_SIM = Server(
    "franky-sim",
    "1.0.4",
    ["-c", "from franky_sim.run_server import main; main()", "--simulator", "mujoco", "--hostname", "ADDRESS"],
)
FRANKA_SIM = Server(
    "franka-sim",
    "1.1.7",
    [str(REPOSITORY / "tests" / "interop" / "franka_sim_server.py"), "ADDRESS"],
)


def fr3_model(build: Path) -> Path:
    """The model that franka-sim would download: franky-sim brings the same one."""
    python = environment(FRANKY_SIM.name, FRANKY_SIM.version)
    (assets,) = (python.parents[1] / "lib").glob("python3*/site-packages/franky_sim/assets")
    folder = build / "interop" / "fr3_model"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "fr3.xml").write_bytes((assets / "fr3.xml").read_bytes())
    with contextlib.suppress(FileExistsError):
        (folder / "assets").symlink_to((assets / "meshes").resolve())
    return folder / "fr3.xml"


def log_of(file) -> str:
    """The last lines of what a program wrote."""
    file.seek(0)
    return " ".join(file.read().decode(errors="replace").split())[-400:]


def try_server(server: Server, python: Path, build: Path) -> Iterator[Result]:
    """Start the peer and franka-interface, and let frankapy try all that it can do with them."""
    address = free_address()

    def failure(capability: str, why: str) -> Result:
        return Result(server.peer, "real time", capability, False, why)

    with tempfile.TemporaryFile() as log, contextlib.ExitStack() as running:
        environment_variables = {"FR3_MJCF": str(fr3_model(build)), "PATH": "/usr/bin:/bin"}
        arguments = [address if argument == "ADDRESS" else argument for argument in server.arguments]
        arm = subprocess.Popen([python, *arguments], stdout=log, stderr=log, env=environment_variables)
        running.callback(arm.wait)
        running.callback(arm.kill)
        deadline = time.monotonic() + START_TIME
        while not (is_taken(address, 1337) and is_taken(address, 1338)):
            if arm.poll() is not None or time.monotonic() > deadline:
                yield failure("start the arm", log_of(log))
                return
            time.sleep(0.1)

        interface = subprocess.Popen(
            [build / "bin" / "franka-interface", "--robot", address, "--port", "0"],
            stdout=subprocess.PIPE, stderr=log, text=True,
        )  # fmt: skip
        running.callback(interface.wait)
        running.callback(interface.terminate)
        endpoint = interface.stdout.readline().strip().removeprefix("listening on tcp://")
        try:
            done = subprocess.run(
                [sys.executable, MOTIONS, endpoint], capture_output=True, text=True, timeout=TIME, check=False
            )
            out, complete = done.stdout, done.returncode in (0, 1)
            end = f"it ended with {done.returncode}: {done.stderr.strip()[-500:]}"
        except subprocess.TimeoutExpired as expired:
            out, end, complete = (expired.stdout or b"").decode(), f"it hung for more than {TIME} s", False
        rows = [line.split("\t") for line in out.splitlines() if line.count("\t") == 2]
        for capability, verdict, why in rows:
            excuse = server.excuses.get(capability, "")
            yield Result(server.peer, "real time", capability, verdict == "OK", why, excuse)
        if not complete or not rows:
            yield failure("run to the end", f"{end} {log_of(log)}")
        if interface.poll() is not None:
            yield failure("server goes on", f"franka-interface ended with {interface.returncode}")


def run(build: Path) -> Iterator[Result]:
    """Every peer."""
    for server in (FRANKY_SIM, FRANKA_SIM):
        yield from run_installed(server.name, server.version, functools.partial(try_server, server, build=build))
