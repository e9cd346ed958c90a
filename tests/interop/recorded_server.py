"""A simulated arm in lockstep and a server, and all that passes between them."""

import contextlib
import dataclasses
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

from frankapy.programs import die_with_parent, program
from peer import simulated_arm
from wire_record import WireRecord


@dataclasses.dataclass
class RecordedServer:
    """What was started."""

    arm: str  # address of the arm itself, and of its control channel
    wire: WireRecord
    server: str  # host:port
    process: subprocess.Popen  # the server's supervisor


@contextlib.contextmanager
def recorded_server(
    robot: str,
    server: str | Path,
    arm_options: Sequence[str] = ("--ideal",),
    settings: str = "",
    server_options: Sequence[str] = (),
    log: IO[str] | int = subprocess.DEVNULL,
) -> Iterator[RecordedServer]:
    """Start them; `settings` are lines of the arm's table in the server's file, `log` takes what the server says."""
    with (
        WireRecord() as wire,
        simulated_arm(
            program("fci-sim"), "--lockstep", "--patience", "2", "--robot", robot, "--wire", str(wire.path), *arm_options
        ) as address,
        tempfile.TemporaryDirectory() as folder,
    ):
        config = Path(folder) / "arms.toml"
        config.write_text(f'[[arm]]\nname = "arm"\naddress = "{address}"\nlockstep = true\n{settings}')
        command = [server, "--config", config, "--port", "0", *server_options]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True, preexec_fn=die_with_parent) as process:
            try:
                where = process.stdout.readline().split("tcp://")[1].strip()
                yield RecordedServer(address, wire, where, process)
            finally:
                process.terminate()
