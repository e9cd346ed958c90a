"""A simulated arm and a server as child processes, on addresses and ports that are free.

What `frankapy sim`, the examples and the tests start; a script may do so too:

    with Simulation() as simulation:
        fa = FrankaArm(server=simulation.server)
"""

from __future__ import annotations

import ctypes
import os
import queue
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO

import numpy as np

from frankapy.connection import list_arms
from frankapy.exceptions import FrankaArmCommException, FrankaArmException

PROGRAMS_VARIABLE = "FRANKAPY_PROGRAMS"
FCI_PORT, GRIPPER_PORT = 1337, 1338  # fixed, as on the arm

_START_TIME = 20.0  # s
_STOP_TIME = 5.0  # s
_PR_SET_PDEATHSIG = 1  # linux/prctl.h


@dataclass
class SimulatedArm:
    """What fci-sim is told."""

    robot: str = "fr3"  # fer, fr3, fr3v2
    protocol: str = "auto"  # or "5" to "10"
    address: str | None = None  # of 127.0.0.0/8; None: a free one
    lockstep: bool = False  # as fast as this computer can, deterministic
    ideal: bool = False  # no joint friction, no noise
    scene: str | os.PathLike[str] | None = None  # MJCF file around the arm
    truth: str | os.PathLike[str] | None = None  # file for what really happens, every cycle
    more: Sequence[str] = ()  # further options of fci-sim


class Simulation:
    """Simulated arms with a server; a context manager.

    `server` is what FrankaArm wants to know; `addresses` are those of the arms, in the order of robot_num.
    """

    def __init__(
        self,
        *arms: SimulatedArm,
        port: int = 0,
        listen: str = "127.0.0.1",
        hold_time: float | None = None,
        log: IO[str] | None = None,
    ) -> None:
        """Start, and wait until every arm is ready; without `arms`, one FR3.

        Args:
            arms: one each.
            port: of the server; 0: a free one.
            listen: address of the server.
            hold_time: s that the server keeps a motion with nothing to do; None: its default.
            log: where both programs write; None: nowhere, but into the exception when they fail.

        Raises FrankaArmException which says what a program wrote when it did not start.
        """
        self._children: list[_Child] = []
        self._folder = tempfile.TemporaryDirectory(prefix="frankapy-")
        self._log = log
        try:
            self.addresses: list[str] = []
            for arm in arms or (SimulatedArm(),):
                self.addresses.append(self._start_arm(arm))
            self.server = self._start_server(listen, port, hold_time)
            self._wait_until_ready()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the server, then the arms."""
        while self._children:
            self._children.pop().stop()
        self._folder.cleanup()

    def check(self) -> None:
        """Raise FrankaArmException when one of the programs has ended."""
        for child in self._children:
            child.check()

    @property
    def processes(self) -> list[int]:
        """Process ids: the arms', then the server's."""
        return [child.process.pid for child in self._children]

    def __enter__(self) -> Simulation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _start_arm(self, arm: SimulatedArm) -> str:
        address = arm.address or free_address()
        command = [program("fci-sim"), "--robot", arm.robot, "--listen", address, "--protocol", str(arm.protocol)]
        command += ["--lockstep"] * arm.lockstep + ["--ideal"] * arm.ideal
        if arm.scene is not None:
            command += ["--scene", os.fspath(arm.scene)]
        if arm.truth is not None:
            command += ["--truth", os.fspath(arm.truth)]
        child = _Child([*command, *arm.more], self._log)
        self._children.append(child)
        deadline = time.monotonic() + _START_TIME
        while not (_is_listening(address, FCI_PORT) and _is_listening(address, GRIPPER_PORT)):
            child.check()
            if time.monotonic() > deadline:
                raise FrankaArmException(
                    f"fci-sim does not listen on {address} after {_START_TIME:.0f} s.{child.tail()}"
                )
            time.sleep(0.01)
        return address

    def _start_server(self, listen: str, port: int, hold_time: float | None) -> str:
        config = Path(self._folder.name) / "arms.toml"
        text = ""
        for i, address in enumerate(self.addresses, 1):
            text += f'[[arm]]\nname = "arm{i}"\naddress = "{address}"\n'
            if hold_time is not None:
                text += f"hold_time = {float(hold_time)}\n"
        config.write_text(text)
        child = _Child([program("franka-interface"), "--config", str(config), "--listen", listen, "--port", str(port)],
                       self._log)  # fmt: skip
        self._children.append(child)
        deadline = time.monotonic() + _START_TIME
        prefix = "listening on tcp://"
        while not (line := child.first_line(prefix)):
            child.check()
            if time.monotonic() > deadline:
                raise FrankaArmException(f"franka-interface does not listen after {_START_TIME:.0f} s.{child.tail()}")
        return line.removeprefix(prefix).replace("0.0.0.0:", "127.0.0.1:")

    def _wait_until_ready(self) -> None:
        deadline = time.monotonic() + _START_TIME
        while True:
            self.check()
            try:
                waiting = [f"{arm.name}: {arm.status}" for arm in list_arms(self.server) if not arm.endpoint]
            except FrankaArmCommException as error:
                waiting = [error.message]
            if not waiting:
                return
            if time.monotonic() > deadline:
                raise FrankaArmException(
                    f"not ready after {_START_TIME:.0f} s: {'; '.join(waiting)}{self._children[-1].tail()}"
                )
            time.sleep(0.02)


class _Child:
    """A program that ends with this one, and what it writes."""

    def __init__(self, command: Sequence[str], log: IO[str] | None) -> None:
        self.name = Path(command[0]).name
        self._log = log
        self._lines: list[str] = []
        self._first: queue.SimpleQueue[str] = queue.SimpleQueue()
        libc = ctypes.CDLL(None)
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,  # Ctrl-C is for the script, which then ends its children
            preexec_fn=lambda: libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM),  # when the script is killed
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.append(line.rstrip("\n"))
            del self._lines[:-200]
            self._first.put(self._lines[-1])
            if self._log is not None:
                print(f"{self.name}: {line}", end="", file=self._log, flush=True)

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


def free_address() -> str:
    """Return a loopback address on which the ports of a robot are free."""
    generator = random.SystemRandom()
    for _ in range(100):
        address = f"127.{generator.randrange(1, 255)}.{generator.randrange(0, 255)}.{generator.randrange(2, 255)}"
        try:
            for port in (FCI_PORT, GRIPPER_PORT):
                with socket.socket() as probe:
                    probe.bind((address, port))
            return address
        except OSError:
            continue
    raise FrankaArmException("No free address in 127.0.0.0/8 was found in 100 attempts.")


def read_truth(path: str | os.PathLike[str], until: int | None = None, timeout: float = 10.0) -> np.ndarray:
    """Return what fci-sim wrote with --truth: a structured array, one row for each cycle; SI units, base frame.

    It is written once a second. With `until` (a message_id) this waits until that cycle is in the file, at most
    `timeout` (s) for a row to come; FrankaArmException when it does not.
    """
    deadline = time.monotonic() + timeout
    while True:
        try:
            rows = np.load(path)
        except (EOFError, ValueError):  # not even its header is there
            rows = None
        if rows is not None and (until is None or (len(rows) and rows["message_id"][-1] >= until)):
            return rows
        if time.monotonic() > deadline:
            raise FrankaArmException(
                f"{os.fspath(path)} has no cycle {until or 0} after {timeout:g} s: does fci-sim run?"
            )
        time.sleep(0.05)


def _is_listening(address: str, port: int) -> bool:
    """Return whether somebody listens there, without connecting: the arm takes one client."""
    place = "".join(f"{int(byte):02X}" for byte in reversed(address.split("."))) + f":{port:04X}"
    everywhere = f"00000000:{port:04X}"
    with open("/proc/net/tcp") as table:
        rows = [row.split() for row in table.readlines()[1:]]
    return any(row[1] in (place, everywhere) and row[3] == "0A" for row in rows)
