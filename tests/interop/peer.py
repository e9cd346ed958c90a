"""Independent programs: an environment for each, and what came of them."""

import dataclasses
import random
import socket
import subprocess
import sys
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


def environment(build: Path, name: str, requirements: list[str]) -> Path:
    """The Python of the program's own virtual environment, made when it is not there yet."""
    folder = build / "interop" / name
    stamp = folder / ".installed"
    wanted = "\n".join(requirements)
    if not stamp.exists() or stamp.read_text() != wanted:
        print(f"installing {' '.join(requirements)} in {folder}", flush=True)
        subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
        pip = [folder / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, *requirements], check=True)
        stamp.write_text(wanted)
    return folder / "bin" / "python"


def free_address() -> str:
    """A loopback address on which nobody has a robot's ports."""
    while True:
        address = ".".join(["127", *(str(random.randint(1, 254)) for _ in range(3))])
        try:
            for port in (1337, 1338):
                with socket.socket() as probe:
                    probe.bind((address, port))
        except OSError:
            continue
        return address
