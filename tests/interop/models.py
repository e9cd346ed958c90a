"""Kinematics and dynamics as clients compute them with what the arm gives them, against Pinocchio."""

import functools
import json
import socket
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

from clients import SCRIPTS
from peer import Result, environment, free_address, run_installed, simulated_arm

CLIENTS = [  # package, version, script, arm, what it gives
    ("panda-python", "1.1.1", "panda_python_model.py", "fer", "library"),
    ("pylibfranka", "0.21.3", "pylibfranka_model.py", "fr3", "URDF"),
]
PINOCCHIO = ("pin", "4.1.0")
TOLERANCES = {"pose": 1e-6, "zero_jacobian": 1e-6, "body_jacobian": 1e-6}  # m, rad
DYNAMICS = 1e-4  # kg m², N m
TIME = 240  # s
HEADER = struct.Struct("<III")  # command, id, size
CONNECT, GET_ROBOT_MODEL = 0, 11  # of protocol version 10


def urdf(fci_sim: Path, robot: str) -> str:
    """Ask an arm for its description, as clients of version 10 do; also one whose own systems never spoke that."""
    with (
        simulated_arm(fci_sim, "--robot", robot, "--protocol", "10") as address,
        socket.create_connection((address, 1337)) as arm,
        arm.makefile("rb") as stream,
    ):
        arm.sendall(HEADER.pack(CONNECT, 1, HEADER.size + 4) + struct.pack("<HH", 10, 9))
        stream.read(HEADER.size + 3)
        arm.sendall(HEADER.pack(GET_ROBOT_MODEL, 2, HEADER.size))
        *_, size = HEADER.unpack(stream.read(HEADER.size))
        return stream.read(size - HEADER.size)[1:].decode()


def try_client(client: tuple[str, str, str, str, str], pinocchio: Path, build: Path, python: Path) -> Iterator[Result]:
    """Start an arm, and compare what the client says of it with Pinocchio."""
    name, version, script, robot, what = client
    address = free_address()
    command = [build / "bin" / "fci-sim", "--robot", robot, "--listen", address, "--lockstep"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as arm:
        arm.stdout.readline()  # the line that says it is ready
        try:
            description = build / "interop" / f"{robot}.urdf"
            description.parent.mkdir(exist_ok=True)
            description.write_text(urdf(build / "bin" / "fci-sim", robot))
            waiting = {"capture_output": True, "text": True, "timeout": TIME, "check": True}
            samples = subprocess.run([python, SCRIPTS / script, address], **waiting).stdout
            worst = json.loads(
                subprocess.run([pinocchio, SCRIPTS / "pinocchio_model.py", description], input=samples, **waiting).stdout
            )
        except (subprocess.SubprocessError, OSError) as error:
            why = f"{error} {getattr(error, 'stderr', '')}"[-500:]
            yield Result(f"{name} {version}", "lockstep", f"model functions, our {what}", False, why)
            return
        finally:
            arm.terminate()
    for function, difference in worst.items():
        within = difference <= TOLERANCES.get(function, DYNAMICS)
        yield Result(f"{name} {version}", "lockstep", f"{function}, our {what}", within, f"{difference:.1e} off")


def run(build: Path) -> Iterator[Result]:
    """Every client that has model functions."""
    pinocchio = environment(*PINOCCHIO)
    for client in CLIENTS:
        yield from run_installed(*client[:2], functools.partial(try_client, client, pinocchio, build))
