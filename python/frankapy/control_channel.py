"""The world of a simulated arm from outside: truth, people, things, network, time; over the channel beside its robot's protocol."""

from __future__ import annotations

import os
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import zmq
from numpy.typing import ArrayLike

from frankapy import proto
from frankapy.digits import digits
from frankapy.exceptions import FrankaArmArgumentError, FrankaArmCommException
from frankapy.fork import Lock
from frankapy.rigid_transform import RigidTransform
from frankapy.validation import array, number, numbers, validate, vector, whole

CONTROL_PORT = 1339

_PATIENCE = 10.0  # s, for an answer
_DRAWING = 60.0  # s, that a picture may take on a busy computer, the first most
_SLOWEST_CYCLE = 0.3  # s: in lockstep, when the client falls silent


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

    def __repr__(self) -> str:
        moves = "moving" if self.moving else "at rest"
        return (
            f"Truth({self.time:.3f} s; {moves}; joints {digits(self.q)} rad; tool at {digits(self.O_T_TCP[:3, 3])} m; "
            f"touched with {np.linalg.norm(self.contact_wrench[:3]):.1f} N)"
        )


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
        self._lock = Lock()
        self._pid = os.getpid()
        self._socket: zmq.Socket[bytes] | None = None
        self.truth()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._address})"

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
        when = np.atleast_1d(array("times", times))
        where = array("positions", positions)
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
        self._ask(
            add_object=proto.AddObject(
                name=name, shape=shape.upper(), size=numbers("size", size), mass=number("mass", mass), position=position,
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

        It holds the world, and of every arm in it the robot with its errors, the hand, and the network with its draw:
        what is lost and delayed after restore() is the same again. At most 100 moments are kept. Refused while a motion
        is being stopped or an error recovered from.
        """
        return self._ask(save=proto.SaveMoment()).moment

    def restore(self, moment: int) -> None:
        """Go back to a moment that was saved.

        The robot's clients do not go back with it; their connections, what they have set (impedances, thresholds, load, frames), the
        robot's message_id and Truth.cycle go on.
        So a moment that was saved while no motion ran is restored while none runs (`fa.stop_skill()` ends what the
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
            if self._pid != os.getpid():  # forked: the socket is the parent's
                self._socket, self._pid = None, os.getpid()
            try:
                if self._socket is None:
                    self._require_somebody()
                    self._socket = zmq.Context.instance().socket(zmq.REQ)
                    self._socket.setsockopt(zmq.LINGER, 0)
                    self._socket.connect(f"tcp://{self._address}:{CONTROL_PORT}")
                self._socket.send(request.SerializeToString())
                if not self._socket.poll(round(patience * 1000)):
                    raise self._nobody(f"within {patience:g} s")
                reply = proto.SimulationReply.FromString(self._socket.recv())
            except BaseException:  # Ctrl-C too: a REQ that has not received sends nothing any more
                self._drop()
                raise
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
        values = array("pose", pose)
        if values.shape == (4, 4):
            given = RigidTransform(rotation=values[:3, :3], translation=values[:3, 3])
        elif values.shape == (3,):
            given = RigidTransform(translation=values)
        else:
            raise FrankaArmArgumentError(f"pose has the shape {values.shape}: expected (4, 4), or (3,) for a position")
    return np.asarray(given.translation), np.asarray(given.quaternion)


def _matrix(pose: Sequence[float]) -> np.ndarray:
    return RigidTransform(rotation=np.array(pose[3:]), translation=np.array(pose[:3])).matrix
