"""A simulated arm in lockstep and a server, with a recording tap between them."""

import contextlib
import dataclasses
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

from frankapy.sim import program
from peer import simulated_arm
from wire_tap import WireTap


@dataclasses.dataclass
class TappedServer:
    """What was started."""

    arm: str  # address of the arm itself, and of its control channel
    tap: WireTap
    server: str  # host:port
    process: subprocess.Popen  # the server's supervisor


@contextlib.contextmanager
def tapped_server(
    robot: str,
    server: str | Path,
    arm_options: Sequence[str] = ("--ideal",),
    settings: str = "",
    server_options: Sequence[str] = (),
    log: IO[str] | int = subprocess.DEVNULL,
) -> Iterator[TappedServer]:
    """Start them; `settings` are lines of the arm's table in the server's file, `log` takes what the server says."""
    with (
        simulated_arm(program("fci-sim"), "--lockstep", "--patience", "2", "--robot", robot, *arm_options) as address,
        tempfile.TemporaryDirectory() as folder,
    ):
        tap = WireTap(address, record=True)
        config = Path(folder) / "arms.toml"
        config.write_text(f'[[arm]]\nname = "arm"\naddress = "{tap.address}"\nlockstep = true\n{settings}')
        command = [server, "--config", config, "--port", "0", *server_options]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True) as process:
            try:
                where = process.stdout.readline().split("tcp://")[1].strip()
                yield TappedServer(address, tap, where, process)
            finally:
                process.terminate()
