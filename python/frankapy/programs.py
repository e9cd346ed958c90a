"""The C++ programs: where they are, and as child processes that end with this one."""

from __future__ import annotations

import ctypes
import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from frankapy.exceptions import FrankaArmException

PROGRAMS_VARIABLE = "FRANKAPY_PROGRAMS"

_STOP_TIME = 5.0  # s
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_STARTED_BY = "FRANKAPY_STARTED_BY"  # environment of its children: its process id


class Child:
    """A program that ends with this one, and what it writes."""

    def __init__(self, command: Sequence[str], ready: str, log: IO[str] | None) -> None:
        """Start it.

        `ready`: how the line begins with which it says that it is ready, the last that `first_line` finds.

        Raises FrankaArmException when it cannot be started.
        """
        self.name = Path(command[0]).name
        self._ready = ready
        self._log = log
        self._lines: list[str] = []
        self._first: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._tried = threading.Event()
        self._failure: Exception | None = None
        self.process: subprocess.Popen[str]
        # The kernel takes the thread that starts a program for its parent: one that lives as long as the program does.
        self._reader = threading.Thread(target=self._run, args=(command,), daemon=True)
        self._reader.start()
        try:
            self._tried.wait()
        except BaseException:  # Ctrl-C: nobody has what is being started
            self._tried.wait()
            if self._failure is None:
                self.stop()
            raise
        if self._failure is not None:
            raise FrankaArmException(f"{command[0]} cannot be started: {self._failure}") from self._failure

    def _run(self, command: Sequence[str]) -> None:
        try:
            self.process = _start(command)
        except Exception as error:  # whoever waits for the start raises it
            self._failure = error
            return
        finally:
            self._tried.set()
        self._read()
        self.process.wait()

    def _read(self) -> None:
        assert self.process.stdout is not None
        is_ready = False
        for line in self.process.stdout:
            self._lines.append(line.rstrip("\n"))
            del self._lines[:-200]
            if not is_ready:
                self._first.put(self._lines[-1])
                is_ready = line.startswith(self._ready)
            if self._log is not None:
                try:
                    print(f"{self.name}: {line}", end="", file=self._log, flush=True)
                except (OSError, ValueError):  # full or closed: no reason to end the program, as it would be with this thread
                    self._log = None

    def first_line(self, prefix: str) -> str | None:
        """Return the first line that begins so, when it is there within 0.1 s."""
        try:
            while not (line := self._first.get(timeout=0.1)).startswith(prefix):
                pass
        except queue.Empty:
            return None
        return line

    def check(self) -> None:
        """Raise FrankaArmException when it has ended."""
        status = self.process.poll()
        if status is not None:
            self._reader.join(timeout=1)
            raise FrankaArmException(f"{self.name} ended with status {status}.{self.tail()}")

    def tail(self) -> str:
        """Return the last lines that it wrote."""
        return "".join(f"\n  {self.name}: {line}" for line in self._lines[-12:])

    def stop(self) -> None:
        """Ask it to end, and wait for that."""
        self.process.terminate()
        try:
            self.process.wait(_STOP_TIME)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join(timeout=1)


def _start(command: Sequence[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,  # Ctrl-C is for the script, which then ends its children
        preexec_fn=die_with_parent,  # when the script is killed
        env=os.environ | {_STARTED_BY: str(os.getpid())},
    )


_libc = ctypes.CDLL(None)


def die_with_parent() -> None:
    """Let this process be told to end (SIGTERM) when its parent has ended, however: `preexec_fn` of subprocess.Popen.

    Its parent is the thread that starts it.
    """
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def program(name: str) -> str:
    """Return the path of one of the C++ programs.

    Looks in $FRANKAPY_PROGRAMS, in build/bin of the repository that this package lies in, beside the Python
    interpreter, and in $PATH. Raises FrankaArmException when it is in none.
    """
    folders = [os.environ.get(PROGRAMS_VARIABLE), Path(__file__).resolve().parents[2] / "build" / "bin",
               Path(sys.executable).parent]  # fmt: skip
    for folder in folders:
        if folder and os.access(path := Path(folder) / name, os.X_OK) and path.is_file():
            return str(path)
    if found := shutil.which(name):
        return found
    raise FrankaArmException(
        f"{name} is not built: run `make build` in the repository, or say in {PROGRAMS_VARIABLE} which folder it is in."
    )


def left_over_arms() -> list[int]:
    """Return the process ids of this user's fci-sim which outlived the Python program that had started them."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            if not folder.name.isdigit() or (folder / "comm").read_text() != "fci-sim\n":
                continue
            parent = (folder / "stat").read_text().rpartition(")")[2].split()[1]
            environment = (folder / "environ").read_bytes().split(b"\0")
        except OSError:  # it has just ended, or is another user's
            continue
        starter = next((each for each in environment if each.startswith(f"{_STARTED_BY}=".encode())), None)
        if starter is not None and starter != f"{_STARTED_BY}={parent}".encode():
            found.append(int(folder.name))
    return sorted(found)
