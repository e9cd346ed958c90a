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

import ctypes
import errno
import json
import os
import queue
import random
import re
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
from typing import IO, Any

import numpy as np
import zmq
from numpy.typing import ArrayLike

from frankapy import proto
from frankapy.connection import list_arms
from frankapy.exceptions import FrankaArmArgumentError, FrankaArmCommException, FrankaArmException
from frankapy.rigid_transform import RigidTransform
from frankapy.validation import number, validate, vector, whole

PROGRAMS_VARIABLE = "FRANKAPY_PROGRAMS"
FCI_PORT, GRIPPER_PORT = 1337, 1338  # fixed, as on the arm
CONTROL_PORT = 1339

_START_TIME = 20.0  # s
_STOP_TIME = 5.0  # s
_PATIENCE = 10.0  # s, for an answer on the control channel
_DRAWING = 60.0  # s, that a picture may take on a busy computer, the first most
_SLOWEST_CYCLE = 0.3  # s: in lockstep, when the client falls silent
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_STARTED_BY = "FRANKAPY_STARTED_BY"  # environment of its children: its process id


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
    more: Sequence[str] = ()  # further options of fci-sim


@dataclass(frozen=True)
class Truth:
    """What is really so with an arm and around it; SI units, base frame O of the arm. Columns of the truth file too."""

    cycle: int  # of the world; the robot's message_id where the world never stood still
    message_id: int  # of the robot's newest state
    time: float  # s of the world
    moving: bool  # a motion of the robot is active
    q: np.ndarray  # (7,) rad
    dq: np.ndarray  # (7,) rad/s
    ddq: np.ndarray  # (7,) rad/s^2, mean over the cycle
    tau_motor: np.ndarray  # (7,) N m, applied at the joints
    tau_J: np.ndarray  # (7,) N m at the links, behind friction and motor inertia
    finger: np.ndarray  # (2,) m, opening of each finger
    finger_force: np.ndarray  # (2,) N, with which each is pushed open
    O_T_TCP: np.ndarray  # (4, 4) pose of the tool centre of the hand
    contact_wrench: np.ndarray  # (6,) N, N m, of the world on hand and fingers, at the TCP
    push: np.ndarray  # (6,) N, N m, of push() and hand() on the arm, taken at the TCP
    objects: dict[str, np.ndarray]  # name: (4, 4) pose, of everything that can move
    paused: str | None  # None, "all" or "between_motions"
    late_cycles: int  # that this computer let come late
    worst_delay: float  # s, of them


class ControlChannel:
    """The world of one simulated arm: truth, people, things, network, time.

    Works beside the robot's own protocol, whoever the robot's client is. Every call returns when it is done, with
    effect from the arm's next cycle on; it raises FrankaArmArgumentError which says what was wrong with it, and
    FrankaArmCommException when no simulated arm answers. Times are of the world. Positions and forces are in the base
    frame O of this arm.
    """

    def __init__(self, address: str = "127.0.0.1") -> None:
        """Speak to the arm of a fci-sim at this address.

        Raises FrankaArmCommException when there is none.
        """
        self._address = address
        self._lock = threading.Lock()
        self._socket: zmq.Socket[bytes] | None = None
        self.truth()

    # --- what is so -------------------------------------------------------------------------------------------------

    def truth(self) -> Truth:
        """Return what is really so now."""
        message = self._ask(get_truth=proto.GetTruth()).truth
        values = {
            name: np.array(getattr(message, name))
            for name in ("q", "dq", "ddq", "tau_motor", "tau_J", "finger", "finger_force", "contact_wrench", "push")
        }
        paused = proto.Pause.Kind.Name(message.paused).lower() if message.HasField("paused") else None
        return Truth(
            cycle=message.cycle,
            message_id=message.message_id,
            time=message.time,
            moving=message.moving,
            O_T_TCP=np.array(message.O_T_TCP).reshape(4, 4).T,
            objects={thing.name: _matrix(thing.pose) for thing in message.objects},
            paused=paused,
            late_cycles=message.late_cycles,
            worst_delay=message.worst_delay,
            **values,
        )

    def image(self, camera: str | None = None, width: int = 640, height: int = 480) -> tuple[np.ndarray, np.ndarray]:
        """Return colour (height, width, 3; uint8) and depth (height, width; float32, m) as a camera sees the scene.

        `camera` is one of the scene, or "wrist" on the arm's hand; None: a view of the whole arm. Depth is measured
        along the camera's axis, infinite where nothing is. The arm does not wait for the picture; the first takes a
        second, others some 0.1 s.
        """
        call = proto.TakeImage(width=whole("width", width), height=whole("height", height))
        if camera is not None:
            call.camera = camera
        image = self._ask(take_image=call).image
        shape = (image.height, image.width)
        colour = np.frombuffer(image.colour, np.uint8).reshape(*shape, 3).copy()
        return colour, np.frombuffer(image.depth, "<f4").reshape(shape).copy()

    # --- people and things ------------------------------------------------------------------------------------------

    def push(
        self, wrench: ArrayLike, duration: float, point: ArrayLike | None = None, link: int | None = None
    ) -> None:
        """Push the arm with force and moment (6,; N, N m; axes of O) for `duration` (s).

        At `point` (3,; m in O), which goes with the link from then on; None: the tool centre, or the origin of the
        link. `link`: 0 to 7; None: the hand. Takes the place of an earlier push.
        """
        self._ask(
            push=proto.Push(
                wrench=vector("wrench", wrench, 6), duration=number("duration", duration), at=_hold(point, link)
            )
        )

    def hand(
        self,
        positions: ArrayLike,
        times: ArrayLike,
        duration: float | None = None,
        stiffness: float = 500.0,
        damping: float = 30.0,
        max_force: float = 100.0,
        point: ArrayLike | None = None,
        link: int | None = None,
    ) -> None:
        """Take the arm by the hand: a spring and a damper to a point that moves.

        Args:
            positions: (n, 3) or (3,), m in O: where that point goes, straight and evenly from where the arm is.
            times: (n,) or one, s from now: when it is there.
            duration: s, after which the hand lets go; None: with the last of `times`.
            stiffness: N/m.
            damping: N s/m.
            max_force: N.
            point, link: where it takes hold, as in push().
        """
        when = np.atleast_1d(np.asarray(times, dtype=float))
        where = np.asarray(positions, dtype=float)
        if when.ndim != 1 or where.shape not in ((when.size, 3), (3,) if when.size == 1 else None):
            raise FrankaArmArgumentError(
                f"positions has the shape {where.shape} and times {when.shape}: expected (n, 3) and (n,)"
            )
        self._ask(
            pull=proto.Pull(
                times=when,
                positions=where.ravel(),
                duration=number("duration", when[-1] if duration is None and when.size else duration),
                stiffness=number("stiffness", stiffness),
                damping=number("damping", damping),
                max_force=number("max_force", max_force),
                at=_hold(point, link),
            )
        )

    def move_object(self, name: str, pose: RigidTransform | ArrayLike) -> None:
        """Put an object there, at rest. `pose`: RigidTransform, (4, 4), or (3,) for a position alone."""
        position, quaternion = _pose(pose)
        self._ask(move_object=proto.MoveObject(name=name, position=position, quaternion=quaternion))

    def add_object(
        self,
        name: str,
        shape: str,
        size: ArrayLike,
        mass: float,
        pose: RigidTransform | ArrayLike,
        friction: float = 0.6,
        colour: ArrayLike = (0.9, 0.33, 0.16),
    ) -> None:
        """Add a thing to the scene; the clock of the simulation waits for it, some 0.1 s.

        Args:
            name: of letters, digits, _ and -.
            shape: "box" with its three sides as `size`, "sphere" with its radius, "cylinder" or "capsule" with radius
                and length along z (of a capsule without the caps).
            size: m.
            mass: kg; 0: it does not move.
            pose: as in move_object().
            friction: sliding, against things of the scene; the arm's fingers and links keep their own.
            colour: red, green, blue from 0 to 1.
        """
        shapes = [kind.lower() for kind in proto.AddObject.Shape.keys()]
        if shape not in shapes:
            raise FrankaArmArgumentError(f"shape is {shape!r}: expected one of {', '.join(shapes)}")
        position, quaternion = _pose(pose)
        sizes = np.atleast_1d(np.asarray(size, dtype=float)).ravel()
        self._ask(
            add_object=proto.AddObject(
                name=name, shape=shape.upper(), size=sizes, mass=number("mass", mass), position=position,
                quaternion=quaternion, friction=number("friction", friction), colour=vector("colour", colour, 3),
            )
        )  # fmt: skip

    def set_friction(self, name: str, friction: float) -> None:
        """Set the sliding friction of a body's or geom's contacts with everything, the arm's fingers included."""
        self._ask(set_friction=proto.SetFriction(name=name, friction=number("friction", friction)))

    # --- the robot ---------------------------------------------------------------------------------------------------

    def user_stop(self, pressed: bool = True) -> None:
        """Press or release the user stop (external activation device)."""
        self._press(proto.PressButton.USER_STOP, pressed)

    def enabling_device(self, held: bool) -> None:
        """Hold or let go the enabling device; it is held unless let go."""
        self._press(proto.PressButton.ENABLING_DEVICE, held)

    def guide(self, pressed: bool = True) -> None:
        """Press or release the guiding buttons at the hand; they act while the user stop is pressed, as on the robot."""
        self._press(proto.PressButton.GUIDING, pressed)

    def lock_joints(self, locked: bool = True) -> None:
        """Close or open the brakes of the joints, as in the robot's own user interface; refused while a motion runs."""
        self._press(proto.PressButton.JOINT_LOCK, locked)

    def virtual_wall(
        self, size: ArrayLike, pose: RigidTransform | ArrayLike, number: int = 0, active: bool = True
    ) -> None:
        """Set up one of the robot's own virtual walls: a cuboid that the arm must not enter.

        The arm reports `cartesian_position_limits_violation` and stops when it does.

        Args:
            size: m (3,), along the axes of `pose`.
            pose: of a corner of the cuboid; as in move_object().
            number: of the wall; one that is there already is replaced.
            active: whether the robot minds it.
        """
        position, quaternion = _pose(pose)
        self._ask(
            set_virtual_wall=proto.SetVirtualWall(
                id=whole("number", number), size=vector("size", size, 3), position=position, quaternion=quaternion,
                active=bool(active),
            )
        )  # fmt: skip

    def inject(self, error: str) -> None:
        """Raise an error of the robot as if there were reason to; `error`: its name as in current_errors."""
        self._ask(inject_error=proto.InjectError(name=error))

    def network(
        self,
        loss_in: float = 0.0,
        loss_out: float = 0.0,
        delayed_in: float = 0.0,
        delayed_out: float = 0.0,
        delay_in: float = 0.0,
        delay_out: float = 0.0,
        seed: int = 1,
    ) -> None:
        """Make the network of the robot's datagrams bad, while motions run; without arguments it is good again.

        Args:
            loss_in: share of commands (into the arm) that are lost, 0 to 1.
            loss_out: share of states (out of the arm).
            delayed_in: share of commands that are delayed, of those not lost.
            delayed_out: share of states.
            delay_in: s, by which.
            delay_out: s.
            seed: of the draw.
        """
        way = proto.SetNetwork.Way
        self._ask(
            set_network=proto.SetNetwork(
                to_arm=way(loss=number("loss_in", loss_in), delayed=number("delayed_in", delayed_in),
                           delay=number("delay_in", delay_in)),
                from_arm=way(loss=number("loss_out", loss_out), delayed=number("delayed_out", delayed_out),
                             delay=number("delay_out", delay_out)),
                seed=whole("seed", seed),
            )
        )  # fmt: skip

    # --- time --------------------------------------------------------------------------------------------------------

    def pause(self, between_motions: bool = False) -> None:
        """Let the world stand still, of all arms that share it.

        The robot goes on telling its state, so its client stays. With `between_motions` the world goes on over the
        cycles in which the arm or the hand does something. Without, a motion under way waits as well, with its client:
        for as long as that one waits for the next state (libfranka: any time, franka-interface: 1 s).
        """
        kind = proto.Pause.BETWEEN_MOTIONS if between_motions else proto.Pause.ALL
        self._ask(pause=proto.Pause(kind=kind))

    def step(self, cycles: int = 1) -> None:
        """While paused, let so many cycles (ms) of the world go by, and return when they have."""
        self._ask(step=proto.StepCycles(cycles=whole("cycles", cycles)))

    def resume(self) -> None:
        """End any pause."""
        self._ask(resume=proto.Resume())

    def save(self) -> int:
        """Keep this moment; return its number for restore() and forget().

        It holds the world, and of every arm in it the robot with its settings and errors, the hand, and the network with
        its draw: what is lost and delayed after restore() is the same again. At most 100 moments are kept. Refused while a
        motion is being stopped or an error recovered from.
        """
        return self._ask(save=proto.SaveMoment()).moment

    def restore(self, moment: int) -> None:
        """Go back to a moment that was saved.

        The robot's clients do not go back with it; their connections, the robot's message_id, Truth.cycle and frictions go
        on. So a moment that was saved while no motion ran is restored while none runs (`fa.stop_skill()` ends what the
        server holds), and one that was saved within a motion while that same motion runs. Its client gets the state of the
        moment and has to go on from there: a law that follows from the state does; where the client has moved on by itself,
        as the server does, that is a discontinuity as on the robot. When objects were added since, the moment is refused.
        """
        self._ask(restore=proto.RestoreMoment(moment=whole("moment", moment)))

    def forget(self, moment: int) -> None:
        """Make room for another moment."""
        self._ask(forget=proto.ForgetMoment(moment=whole("moment", moment)))

    def disconnect(self) -> None:
        """Close the channel; the next call opens it again."""
        with self._lock:
            self._drop()

    def _press(self, button: proto.PressButton.Button, pressed: bool) -> None:
        self._ask(press_button=proto.PressButton(button=button, pressed=bool(pressed)))

    def _ask(self, **call: Any) -> proto.SimulationReply:
        request = proto.SimulationCall(**call)
        validate(request)
        patience = _PATIENCE
        if request.HasField("step"):
            patience += request.step.cycles * _SLOWEST_CYCLE
        elif request.HasField("take_image"):
            patience += _DRAWING
        with self._lock:
            if self._socket is None:
                self._require_somebody()
                self._socket = zmq.Context.instance().socket(zmq.REQ)
                self._socket.setsockopt(zmq.LINGER, 0)
                self._socket.connect(f"tcp://{self._address}:{CONTROL_PORT}")
            self._socket.send(request.SerializeToString())
            if not self._socket.poll(round(patience * 1000)):
                self._drop()
                raise self._nobody(f"within {patience:g} s")
            reply = proto.SimulationReply.FromString(self._socket.recv())
        if reply.HasField("error"):
            raise FrankaArmArgumentError(reply.error)
        return reply

    def _require_somebody(self) -> None:
        # ZeroMQ would try for as long as anyone waits; a refusal is known at once.
        try:
            socket.create_connection((self._address, CONTROL_PORT), timeout=_PATIENCE).close()
        except OSError as error:
            raise self._nobody(f"({error.strerror or 'timed out'})") from error

    def _nobody(self, why: str) -> FrankaArmCommException:
        return FrankaArmCommException(
            f"No simulated arm answers on {self._address}:{CONTROL_PORT} {why}: does fci-sim run there?"
        )

    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


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
            log: where both programs write; None: nowhere, but into the exception when they fail.

        Raises FrankaArmException which says what a program wrote when it did not start.
        """
        self._children: list[_Child] = []
        self._folder = tempfile.TemporaryDirectory(prefix="frankapy-")
        self._log = log
        self.arms: list[ControlChannel] = []
        try:
            self.addresses: list[str] = []
            self._loops: list[str] = []  # what the server's configuration says of the loop of each address
            for arm in arms or (SimulatedArm(),):
                own, loop = self._pair(arm)
                addresses = self._start_arm(arm, own)
                self.addresses += addresses
                self._loops += [loop] * len(addresses)
            super().__init__(self.addresses[0])
            self.arms += [self, *(ControlChannel(address) for address in self.addresses[1:])]
            self.server = self._start_server(listen, port, hold_time, load, record, recordings)
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

    def __enter__(self) -> Simulation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _start_arm(self, arm: SimulatedArm, processor: int | None) -> list[str]:
        # Its last line of those that say where an arm is tells that all are ready.
        address = arm.address or free_address(arm.arms or 16)
        if arm.address is not None and not _is_free(arm.address, FCI_PORT):
            raise FrankaArmException(
                f"{arm.address}:{FCI_PORT} is taken: is there a simulated arm of another run? End it, or leave the address out and "
                f"a free one is taken.{''.join(f' fci-sim runs with process id {pid}.' for pid in left_over_arms())}"
            )
        command = [program("fci-sim"), "--robot", arm.robot, "--listen", address, "--protocol", str(arm.protocol)]
        command += ["--lockstep"] * arm.lockstep + ["--ideal"] * arm.ideal
        command += ["--speed", str(arm.speed), "--seed", str(arm.seed)]
        if arm.arms is not None:
            command += ["--arms", str(arm.arms)]
        if arm.paused_between_motions:
            command += ["--pause", "between-motions"]
        if arm.scene is not None:
            command += ["--scene", os.fspath(arm.scene)]
        if arm.truth is not None:
            command += ["--truth", os.fspath(arm.truth)]
        child = _Child([*command, *arm.more], self._log, processor)
        self._children.append(child)
        addresses: list[str] = []
        deadline = time.monotonic() + _START_TIME
        while (line := child.first_line("fci-sim: ")) != "fci-sim: ready":
            child.check()
            if line and (found := re.search(rf" on ([0-9.]+):{FCI_PORT}, ", line)):
                addresses.append(found[1])
            if time.monotonic() > deadline:
                raise FrankaArmException(
                    f"fci-sim is not ready on {address} after {_START_TIME:.0f} s.{child.tail()}"
                )
        return addresses

    def _pair(self, arm: SimulatedArm) -> tuple[int | None, str]:
        # In lockstep arm and loop work by turns and poll for each other: a processor for each.
        if not arm.lockstep:
            return None, ""
        processors = sorted(os.sched_getaffinity(0))
        if len(processors) < 2:
            return None, "lockstep = true\n"
        first = len(self.addresses)
        loop = processors[(first + 1) % len(processors)]
        return processors[first % len(processors)], f"lockstep = true\nprocessor = {loop}\n"

    def _start_server(
        self,
        listen: str,
        port: int,
        hold_time: float | None,
        load: Sequence[str | os.PathLike[str]],
        record: str | None,
        recordings: str | os.PathLike[str] | None,
    ) -> str:
        if port:
            _require_free_port(listen, port)
        config = Path(self._folder.name) / "arms.toml"
        text = f"load = {json.dumps([os.path.abspath(path) for path in load])}\n"
        for i, (address, loop) in enumerate(zip(self.addresses, self._loops, strict=True), 1):
            text += f'[[arm]]\nname = "arm{i}"\naddress = "{address}"\n{loop}'
            if hold_time is not None:
                text += f"hold_time = {float(hold_time)}\n"
        config.write_text(text)
        command = [program("franka-interface"), "--config", str(config), "--listen", listen, "--port", str(port)]
        command += ["--record", record] if record else []
        command += ["--recordings", os.fspath(recordings)] if recordings else []
        child = _Child(command, self._log)
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

    def __init__(self, command: Sequence[str], log: IO[str] | None, processor: int | None = None) -> None:
        self.name = Path(command[0]).name
        self._log = log
        self._lines: list[str] = []
        self._first: queue.SimpleQueue[str] = queue.SimpleQueue()

        def before_start() -> None:
            die_with_parent()  # when the script is killed
            if processor is not None:
                os.sched_setaffinity(0, {processor})

        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,  # Ctrl-C is for the script, which then ends its children
            preexec_fn=before_start,
            env=os.environ | {_STARTED_BY: str(os.getpid())},
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


_libc = ctypes.CDLL(None)


def die_with_parent() -> None:
    """Let this process be told to end (SIGTERM) when its parent has ended, however: `preexec_fn` of subprocess.Popen."""
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
            rows = np.load(path)
        except (EOFError, ValueError):  # not even its header is there
            rows = None
        if rows is not None and (until is None or (len(rows) and rows["cycle"][-1] >= until)):
            return rows
        if time.monotonic() > deadline:
            raise FrankaArmException(
                f"{os.fspath(path)} has no cycle {until or 0} after {timeout:g} s: does fci-sim run?"
            )
        time.sleep(0.05)


def _hold(point: ArrayLike | None, link: int | None) -> proto.Hold:
    at = proto.Hold()
    if point is not None:
        at.point.extend(vector("point", point, 3))
    if link is not None:
        at.link = whole("link", link)
    return at


def _pose(pose: RigidTransform | ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return position and quaternion (w, x, y, z)."""
    given: Any = pose
    if not hasattr(pose, "quaternion"):
        array = np.asarray(pose, dtype=float)
        if array.shape == (4, 4):
            given = RigidTransform(rotation=array[:3, :3], translation=array[:3, 3])
        elif array.shape == (3,):
            given = RigidTransform(translation=array)
        else:
            raise FrankaArmArgumentError(f"pose has the shape {array.shape}: expected (4, 4), or (3,) for a position")
    return np.asarray(given.translation), np.asarray(given.quaternion)


def _matrix(pose: Sequence[float]) -> np.ndarray:
    return RigidTransform(rotation=np.array(pose[3:]), translation=np.array(pose[:3])).matrix
