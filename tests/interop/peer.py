"""Independent programs: an environment for each, and what came of them."""

import contextlib
import dataclasses
import random
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]


@dataclasses.dataclass
class Result:
    """What one program can do with one of ours."""

    peer: str
    mode: str
    capability: str
    ok: bool
    why: str = ""
    # What the peer itself cannot do, in words; a failure is then no fault of ours.
    excuse: str = ""


def environment(build: Path, requirements: list[str]) -> Path:
    """The Python of a virtual environment, made when it is not there yet: the program, name==version, comes first."""
    folder = build / "interop" / requirements[0].replace("==", "-")
    stamp = folder / ".installed"
    wanted = "\n".join(requirements)
    if not stamp.exists() or stamp.read_text() != wanted:
        print(f"installing {' '.join(requirements)} in {folder}", flush=True)
        subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
        install = [folder / "bin" / "python", "-m", "pip", "install", "--no-compile"]
        subprocess.run([*install, "--quiet", "--disable-pip-version-check", *requirements], check=True)
        stamp.write_text(wanted)
    return folder / "bin" / "python"


@contextlib.contextmanager
def simulated_arm(fci_sim: str | Path, *options: str) -> Iterator[str]:
    """Run a simulated arm of its own on a free address, which is given when it is ready."""
    address = free_address()
    with subprocess.Popen([fci_sim, "--listen", address, *options], stdout=subprocess.PIPE, text=True) as arm:
        try:
            while "ready" not in arm.stdout.readline():
                if arm.poll() is not None:
                    sys.exit("fci-sim did not start")
            yield address
        finally:
            arm.terminate()


def is_taken(address: str, port: int) -> bool:
    """Whether somebody has this TCP port; without connecting, since an arm takes one client."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((address, port))
        except OSError:
            return True
    return False


def free_address() -> str:
    """A loopback address on which nobody has a robot's ports."""
    while True:
        address = ".".join(["127", *(str(random.randint(1, 254)) for _ in range(3))])
        if not (is_taken(address, 1337) or is_taken(address, 1338)):
            return address
