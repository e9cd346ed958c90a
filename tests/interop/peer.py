"""Independent programs: an environment for each, and what came of them."""

import contextlib
import dataclasses
import fcntl
import hashlib
import os
import random
import socket
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from frankapy.programs import die_with_parent

REPOSITORY = Path(__file__).resolve().parents[2]
# Each program with everything that it needs:
#   echo name==version | uv pip compile --universal --no-header --no-annotate --python-version 3.11 - -o name-version.txt
PINS = Path(__file__).resolve().parent / "peers"
NOT_INSTALLED = "be installed"  # what a program that cannot be had cannot do
PORTS = (1337, 1338, 1339)  # of an arm, its hand, and what is around a simulated one


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


def run_installed(name: str, version: str, run: Callable[[Path], Iterable[Result]]) -> Iterator[Result]:
    """What `run` gives with the Python of a program; where that cannot be had, a row that says so: the others run."""
    try:
        python = environment(name, version)
    except (OSError, subprocess.CalledProcessError) as error:
        yield Result(f"{name} {version}", "", NOT_INSTALLED, False, str(error))
        return
    yield from run(python)


def tabled(file: Path, text: str, write: bool) -> Iterator[Result]:
    """Write a table of docs/, or see that it is the one that is there."""
    if write:
        file.write_text(text)
    else:
        yield Result("all", "lockstep", f"docs/{file.name}", file.read_text() == text, "it says something else: `make interop` writes it anew")


@contextlib.contextmanager
def left_out(name: str, version: str) -> Iterator[None]:
    """Go on without what is measured of a program that is not installed and cannot be, or that fails."""
    try:
        yield
    except (OSError, subprocess.SubprocessError) as error:
        print(f"without {name} {version}: {error} {getattr(error, 'stderr', None) or ''}", file=sys.stderr)


def environment(name: str, version: str) -> Path:
    """The Python of a virtual environment with a program, as pinned in peers/; made when it is not there yet.

    Outside the build directory and named after what is in it, so that every checkout of a user has the same one.
    """
    wanted = (PINS / f"{name}-{version}.txt").read_text()
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    key = hashlib.sha256((wanted + sys.version).encode()).hexdigest()[:12]
    folder = cache / "franka-interface" / "peers" / f"{name}-{version}-{key}"
    folder.parent.mkdir(parents=True, exist_ok=True)
    with (folder.parent / f"{folder.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        stamp = folder / ".installed"
        if not stamp.exists():
            print(f"installing {name} {version} in {folder}", flush=True)
            subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
            install = [folder / "bin" / "python", "-m", "pip", "install", "--no-compile", "--no-deps", "--quiet"]
            install += ["--disable-pip-version-check", "-r", PINS / f"{name}-{version}.txt"]
            done = subprocess.run(install, stderr=subprocess.PIPE, text=True, check=False)
            if done.returncode != 0:
                why = [line for line in done.stderr.splitlines() if "ERROR" in line] or [done.stderr]
                raise OSError(f"pip could not install {name} {version} (is the network there?): {' '.join(why)}")
            stamp.touch()
    return folder / "bin" / "python"


@contextlib.contextmanager
def simulated_arm(fci_sim: str | Path, *options: str) -> Iterator[str]:
    """Run a simulated arm of its own on a free address, which is given when it is ready."""
    address = free_address()
    command = [fci_sim, "--listen", address, *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=die_with_parent) as arm:
        try:
            while "ready" not in arm.stdout.readline():
                if arm.poll() is not None:
                    raise OSError(f"fci-sim did not start on {address}")
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
    for _ in range(100):
        address = ".".join(["127", *(str(random.randint(1, 254)) for _ in range(3))])
        if not any(is_taken(address, port) for port in PORTS):
            return address
    raise OSError(f"ports {PORTS} are taken at all of 100 loopback addresses: end what listens on them at 0.0.0.0")


if __name__ == "__main__":  # the Python of `peer.py NAME VERSION`, for those that are no Python
    print(environment(*sys.argv[1:]))
