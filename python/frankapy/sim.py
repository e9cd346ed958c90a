"""Simulated arms and a server as child processes, on addresses and ports that are free, and the world around the arms.

What `frankapy sim`, the examples and the tests start; a script may do so too:

    with Simulation(SimulatedArm(scene="table_with_blocks")) as sim:
        fa = FrankaArm(server=sim.server)
        fa.reset_joints()
        sim.push([0, 0, -20, 0, 0, 0], duration=0.5)
        print(sim.truth().q)

`ControlChannel(address)` gives the same over an arm of a fci-sim that runs already.
"""

from __future__ import annotations

import errno
import json
import os
import random
import re
import socket
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO

import numpy as np

from frankapy.connection import list_arms
from frankapy.control_channel import CONTROL_PORT, ControlChannel, Truth
from frankapy.exceptions import FrankaArmCommException, FrankaArmException
from frankapy.programs import Child, die_with_parent, left_over_arms, program

__all__ = [
    "CONTROL_PORT", "FCI_PORT", "GRIPPER_PORT", "ControlChannel", "SimulatedArm", "Simulation", "Truth", "die_with_parent",
    "free_address", "left_over_arms", "program", "read_truth",
]  # fmt: skip
FCI_PORT, GRIPPER_PORT = 1337, 1338  # fixed, as on the arm

_START_TIME = 20.0  # s


@dataclass
class SimulatedArm:
    """What fci-sim is told."""

    robot: str = "fr3"  # fer, fr3, fr3v2; of several arms "fr3,fer"
    protocol: str = "auto"  # or "5" to "10"
    address: str | None = None  # of 127.0.0.0/8; None: a free one. Further arms have those that follow
    arms: int | None = None  # in this process; None: as many as robots are named, or share the scene
    lockstep: bool = False  # as fast as this computer can
    ideal: bool = False  # no joint friction, no noise
    speed: float = 1.0  # of the robot's time over the wall's
    seed: int = 1  # of the noise
    scene: str | os.PathLike[str] | None = None  # around the arm: a name of sim/scenes, or an MJCF file
    truth: str | os.PathLike[str] | None = None  # .npy file for what really happens, every cycle
    # The world stands still from the start except while the arm does something: with lockstep, the same script then
    # gives the same run, bit for bit.
    paused_between_motions: bool = False
    # s for which lockstep waits for a command, which then is lost; twenty of them end a motion. The server waits 10 s for a state.
    patience: float = 2.0
    more: Sequence[str] = ()  # further options of fci-sim


class Simulation(ControlChannel):
    """Simulated arms with a server; a context manager.

    `server` is what FrankaArm wants to know; `addresses` are those of the arms, in the order of robot_num, and `arms`
    the control of each. What ControlChannel offers is for the first of them here: `sim.push(...)` is
    `sim.arms[0].push(...)`.
    """

    def __init__(
        self,
        *arms: SimulatedArm,
        port: int = 0,
        listen: str = "127.0.0.1",
        hold_time: float | None = None,
        load: Sequence[str | os.PathLike[str]] = (),
        record: str | None = None,
        recordings: str | os.PathLike[str] | None = None,
        keys: str | os.PathLike[str] | None = None,
        settings: Mapping[str, Mapping[str, object]] | None = None,
        log: IO[str] | None = None,
    ) -> None:
        """Start, and wait until every arm is ready; without `arms`, one FR3.

        Args:
            arms: one process each.
            port: of the server; 0: a free one.
            listen: address of the server.
            hold_time: s that the server keeps a motion with nothing to do; None: its default.
            load: libraries of parts of one's own (`frankapy new`).
            record: what the server records: "off", "errors", "skills" or "always"; None: its default, errors.
            recordings: folder of its recordings; None: its default.
            keys: folder of its keys (docs/keys.md), of which this program has one as $FRANKAPY_KEY or in the usual place; None: its
                default.
            settings: what the server's configuration has of each arm, such as {"recovery": {"collisions": "itself"}}.
            log: where both programs write; None: nowhere, but into the exception when they fail.

        Raises FrankaArmException which says what a program wrote when it did not start.
        """
        self._children: list[Child] = []
        self._folder = tempfile.TemporaryDirectory(prefix="frankapy-")
        self._log = log
        self.arms: list[ControlChannel] = []
        try:
            self.addresses: list[str] = []
            self._lockstep: list[bool] = []  # whether each address is in lockstep
            for arm in arms or (SimulatedArm(),):
                addresses = self._start_arm(arm)
                self.addresses += addresses
                self._lockstep += [arm.lockstep] * len(addresses)
            super().__init__(self.addresses[0])
            self.arms += [self, *(ControlChannel(address) for address in self.addresses[1:])]
            self.server = self._start_server(listen, port, hold_time, load, record, recordings, keys, settings or {})
            self._wait_until_ready()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the server, then the arms."""
        for arm in self.arms:
            arm.disconnect()
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

    def __repr__(self) -> str:
        return f"Simulation(arms at {', '.join(self.addresses)}; server {self.server})"

    def __enter__(self) -> Simulation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _start_arm(self, arm: SimulatedArm) -> list[str]:
        # Its last line of those that say where an arm is tells that all are ready.
        address = arm.address or free_address(arm.arms or 16)
        if arm.address is not None and not _is_free(arm.address, FCI_PORT):
            raise FrankaArmException(
                f"{arm.address}:{FCI_PORT} is taken: is there a simulated arm of another run? End it, or leave the address out and "
                f"a free one is taken.{''.join(f' fci-sim runs with process id {pid}.' for pid in left_over_arms())}"
            )
        command = [program("fci-sim"), "--robot", arm.robot, "--listen", address, "--protocol", str(arm.protocol)]
        command += ["--lockstep"] * arm.lockstep + ["--ideal"] * arm.ideal
        command += ["--speed", str(arm.speed), "--patience", str(arm.patience), "--seed", str(arm.seed)]
        if arm.arms is not None:
            command += ["--arms", str(arm.arms)]
        if arm.paused_between_motions:
            command += ["--pause", "between-motions"]
        if arm.scene is not None:
            command += ["--scene", os.fspath(arm.scene)]
        if arm.truth is not None:
            command += ["--truth", os.fspath(arm.truth)]
        ready = "fci-sim: ready"
        child = Child([*command, *arm.more], ready, self._log)
        self._children.append(child)
        addresses: list[str] = []
        deadline = time.monotonic() + _START_TIME
        while (line := child.first_line("fci-sim: ")) != ready:
            child.check()
            if line and (found := re.search(rf" on ([0-9.]+):{FCI_PORT}, ", line)):
                addresses.append(found[1])
            if time.monotonic() > deadline:
                raise FrankaArmException(
                    f"fci-sim is not ready on {address} after {_START_TIME:.0f} s.{child.tail()}"
                )
        return addresses

    def _start_server(
        self,
        listen: str,
        port: int,
        hold_time: float | None,
        load: Sequence[str | os.PathLike[str]],
        record: str | None,
        recordings: str | os.PathLike[str] | None,
        keys: str | os.PathLike[str] | None,
        settings: Mapping[str, Mapping[str, object]],
    ) -> str:
        if port:
            _require_free_port(listen, port)
        config = Path(self._folder.name) / "arms.toml"
        text = f"load = {json.dumps([os.path.abspath(path) for path in load])}\n"
        for i, (address, lockstep) in enumerate(zip(self.addresses, self._lockstep, strict=True), 1):
            text += f'[[arm]]\nname = "arm{i}"\naddress = "{address}"\nlockstep = {json.dumps(lockstep)}\n'
            if hold_time is not None:
                text += f"hold_time = {float(hold_time)}\n"
            for table, values in settings.items():
                text += f"[arm.{table}]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items())
        config.write_text(text)
        command = [program("franka-interface"), "--config", str(config), "--listen", listen, "--port", str(port)]
        command += ["--record", record] if record else []
        command += ["--recordings", os.fspath(recordings)] if recordings else []
        command += ["--keys", os.fspath(keys)] if keys else []
        prefix = "listening on tcp://"
        child = Child(command, prefix, self._log)
        self._children.append(child)
        deadline = time.monotonic() + _START_TIME
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


def _is_free(address: str, port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # what has just ended does not count
        try:
            probe.bind((address, port))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                return False
            raise FrankaArmException(f"No program can listen at {address}:{port}: {error.strerror}") from None
    return True


def _require_free_port(listen: str, port: int) -> None:
    if _is_free(listen, port):
        return
    host = "127.0.0.1" if listen == "0.0.0.0" else listen
    try:
        arms = ", ".join(f"{arm.name} at {arm.address}" for arm in list_arms(f"{host}:{port}"))
        who = f"by a franka-interface with {arms}. It may be of another run, which Ctrl-C in its terminal ends"
    except FrankaArmCommException:
        who = "by another program"
    raise FrankaArmException(
        f"Port {port} of {listen} is taken, {who}. Port 0 takes a free one (`frankapy sim --port 0`, Simulation(port=0))."
    )


def free_address(arms: int = 1) -> str:
    """Return a loopback address on which, and on those that follow, the ports of a robot are free."""
    generator = random.SystemRandom()
    for _ in range(100):
        start = f"127.{generator.randrange(1, 255)}.{generator.randrange(0, 255)}."
        first = generator.randrange(2, 255 - arms)
        try:
            for last in range(first, first + arms):
                for port in (FCI_PORT, GRIPPER_PORT, CONTROL_PORT):
                    with socket.socket() as probe:
                        probe.bind((f"{start}{last}", port))
            return f"{start}{first}"
        except OSError:
            continue
    raise FrankaArmException(
        f"None of 100 addresses in 127.0.0.0/8 has a robot's ports {FCI_PORT} to {CONTROL_PORT} free: end what listens on them at 0.0.0.0."
    )


def read_truth(path: str | os.PathLike[str], until: int | None = None, timeout: float = 10.0) -> np.ndarray:
    """Return what fci-sim wrote with --truth: a structured array, one row for each cycle; SI units, base frame.

    It is written every 100 cycles, and at the end. With `until` (a cycle: the robot's message_id where the world never stood still,
    else Truth.cycle) this waits until that cycle is in the file, at most `timeout` (s) for a row to come;
    FrankaArmException when it does not.
    """
    deadline = time.monotonic() + timeout
    while True:
        try:
            rows = np.load(path, mmap_mode="r")  # of which only the end is looked at
        except (EOFError, ValueError):  # not even its header is there
            rows = None
        if rows is not None and (until is None or (len(rows) and rows["cycle"][-1] >= until)):
            return np.array(rows)
        if time.monotonic() > deadline:
            raise FrankaArmException(
                f"{os.fspath(path)} has no cycle {until or 0} after {timeout:g} s: does fci-sim run?"
            )
        time.sleep(0.05)
