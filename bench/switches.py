"""Random switches and preemptions in lockstep, judged twice: by the simulated arm's own checks, and from the wire.

Any trajectory, any controller, any robot controller, near or far, slow or as fast as it goes, alone or blended in a
queue, waited for, stopped, or taken over by the next at any moment; on both models. What leaves for the arm is recorded
between the two, and its differences compared with the documented limits (tests/interop/wire_limits.py).
  switch_discontinuities            motions that the arm ended by an error, and commands beyond a limit, of 10,000 switches
  switch_discontinuities_unlimited  the same of a server without limits, to see that they are found: of at most ten batches, until there is one

    bench/switches.py --robot fer --first 17 --batches 1 --keep build/found    again what batch 17 drew

A batch draws from its own seed, begins at home and has 20 switches; how many cycles pass between two is the computer's.
"""

import argparse
import collections
import contextlib
import json
import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from google.protobuf.message import Message

from frankapy import FrankaArm, FrankaArmException, FrankaConstants, RigidTransform, proto
from frankapy.parts import (
    CartesianImpedance,
    CartesianVelocity,
    CubicHermiteJoint,
    CubicHermitePose,
    FreeDrive,
    InternalImpedance,
    JointImpedance,
    JointVelocity,
    LinearJoint,
    LinearPose,
    MinJerkJoint,
    MinJerkPose,
    RelativeLinearPose,
    RelativeMinJerkJoint,
    RelativeMinJerkPose,
    SineJoint,
    SinePose,
    StayJoint,
    StayPose,
    TimeOptimalJoint,
    TimeOptimalPose,
)
from frankapy.sim import program

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY / "tests" / "interop"))
import wire_limits  # noqa: E402
from tapped_server import tapped_server  # noqa: E402
from wire_tap import WireTap  # noqa: E402

SWITCHES = 10_000
BATCH = 20  # switches
UNLIMITED = REPOSITORY / "build" / "bench" / "franka-interface-unlimited"
UNLIMITED_BATCHES = 10
PATIENCE = 60  # s of the wall for a few switches; next to singularities they may take some 10 s of the arm's
KEPT = 8000  # last datagrams of either way when something is found
JOINTS = ["joint_position", "joint_velocity"]
POSES = ["cartesian_pose", "cartesian_velocity"]
HOME = np.array(FrankaConstants.HOME_JOINTS)


class Draw:
    """Random skills."""

    def __init__(self, seed: int, limits: wire_limits.Limits) -> None:
        self._random = np.random.default_rng(seed)
        self._range = limits.q + [[0.02], [-0.02]]
        self._dq = limits.dq

    def one(self, choices: list) -> object:
        return choices[self._random.integers(len(choices))]

    def uniform(self, least: float, most: float, size: int | None = None) -> np.ndarray:
        return self._random.uniform(least, most, size)

    def joints(self, far: bool) -> Message:
        reach = 1 if far else 0.3
        q = np.clip(HOME + self.uniform(-reach, reach, 7), *self._range)
        duration = self.uniform(0.05, 1)
        return self.one(
            [
                lambda: MinJerkJoint(q, duration),
                lambda: RelativeMinJerkJoint(self.uniform(-reach / 2, reach / 2, 7), duration),
                lambda: LinearJoint(q, duration),
                lambda: SineJoint(q, duration),
                lambda: CubicHermiteJoint(q, duration),
                lambda: TimeOptimalJoint(q, self.uniform(0.1, 1)),
                lambda: JointVelocity(self.uniform(-reach, reach, 7), duration=0.3),
                lambda: StayJoint(0.05),
            ]
        )()

    def pose(self, far: bool) -> Message:
        reach = 0.25 if far else 0.08
        turn = self.uniform(-1, 1, 3) * (1 if far else 0.2)
        pose = FrankaConstants.HOME_POSE.copy()
        pose.translation += self.uniform(-reach, reach, 3)
        pose.rotation = RigidTransform.rotation_from_axis_angle(turn) @ pose.rotation
        change = RigidTransform(
            rotation=RigidTransform.rotation_from_axis_angle(turn / 2),
            translation=self.uniform(-reach / 2, reach / 2, 3),
            from_frame="franka_tool",
            to_frame="franka_tool",
        )
        frame = self.one(["base", "end_effector"])
        duration = self.uniform(0.05, 1)
        return self.one(
            [
                lambda: MinJerkPose(pose, duration),
                lambda: RelativeMinJerkPose(change, frame=frame, duration=duration),
                lambda: LinearPose(pose, duration),
                lambda: RelativeLinearPose(change, frame=frame, duration=duration),
                lambda: SinePose(pose, duration),
                lambda: CubicHermitePose(pose, duration),
                lambda: TimeOptimalPose(pose, self.uniform(0.05, 1)),
                lambda: CartesianVelocity(self.uniform(-reach, reach, 6), duration=0.3),
                lambda: StayPose(0.05),
            ]
        )()

    def skill(self) -> dict:
        if self._random.random() < 0.03:
            trajectory = self.one([StayJoint, StayPose])(self.uniform(0.02, 0.3))
            return {"trajectory": trajectory, "controller": FreeDrive(self.uniform(0, 10, 7))}
        joints = self._random.random() < 0.5
        far = self._random.random() < 0.4
        trajectory = self.joints(far) if joints else self.pose(far)
        motions = JOINTS if joints else POSES
        speed = self.one([1, 1, 1, self.uniform(0.1, 1)])
        scale = self.uniform(0.3, 2)
        kind = self._random.random()
        if kind < 0.4:
            controller, robot_controller = InternalImpedance(), self.one(motions)
        elif joints or kind < 0.5:
            controller = JointImpedance(scale * np.array(FrankaConstants.DEFAULT_K_GAINS))
            robot_controller = self.one(["torque"] * joints + [f"torque_and_{name}" for name in motions])
        else:
            frame = self.one(["base", "end_effector"])
            controller = CartesianImpedance(600 * scale, 50 * scale, frame=frame)
            robot_controller = self.one(["torque", *(f"torque_and_{name}" for name in motions)])
        return {"trajectory": trajectory, "controller": controller, "robot_controller": robot_controller, "speed": speed}


class Arm:
    """A simulated arm, a server, and what passes between them."""

    def __init__(self, robot: str, tap: WireTap, fa: FrankaArm, other: FrankaArm, keep: Path | None) -> None:
        self._limits = wire_limits.LIMITS[robot]
        self._robot = robot
        self._tap, self._fa, self._other, self._keep = tap, fa, other, keep
        self.endings: collections.Counter[str] = collections.Counter()
        self.errors: collections.Counter[str] = collections.Counter()
        self.beyond = 0
        self.commands = 0

    def batch(self, seed: int, until_found: bool = False) -> None:
        """Make BATCH random switches from home, or as many as it takes to find something."""
        draw = Draw(seed, self._limits)
        self._home()
        done = ""
        made = 0
        while made < BATCH:
            number = min(draw.one([1, 1, 1, 2, 3]), BATCH - made)
            made += number
            skills = [draw.skill() for _ in range(number)]
            how = draw.one(["wait", "preempt", "preempt", "preempt", "stop", "sequence"])
            pauses = [draw.one([0, 0, draw.uniform(0, 0.03)]) for _ in skills]
            blend = draw.one([0, draw.uniform(0, 0.3)])
            done = f"{how} " + ", ".join(
                f"{type(s['trajectory']).__name__} by {s.get('robot_controller', 'torque')}" for s in skills
            )
            with self._watched(done):
                self._try(lambda how=how, skills=skills, pauses=pauses, blend=blend: self._run(how, skills, pauses, blend))
            if self._fa.get_arm_state().phase == proto.ERROR:
                self._found(seed, made, done)
                if until_found:
                    return
                self._home()
        self._try(self._fa.stop_skill)
        self._judge(seed, done)

    def _run(self, how: str, skills: list[dict], pauses: list[float], blend: float) -> None:
        fa = self._fa
        if how == "sequence":
            self._try(fa.stop_skill)
            with fa.sequence(blend=blend):
                for skill in skills:
                    fa.run(**skill)
            return
        for skill, pause in zip(skills, pauses, strict=True):
            self._try(lambda skill=skill: fa.run(**skill, preempt=True, block=how == "wait"))
            time.sleep(pause)
        if how == "stop":
            fa.stop_skill()

    @contextlib.contextmanager
    def _watched(self, done: str) -> Iterator[None]:
        """Stop what does not come to its end, and count it."""

        def stop() -> None:
            self.errors["did not end"] += 1
            print(f"{self._robot}: {done}: did not end", file=sys.stderr, flush=True)
            self._other.stop_skill()

        watch = threading.Timer(PATIENCE, stop)
        watch.start()
        try:
            yield
        finally:
            watch.cancel()

    def _try(self, do: Callable[[], object]) -> None:
        try:
            do()
        except FrankaArmException as error:
            self.endings[f"refused: {str(error)[:50]}"] += 1
        except ValueError as error:
            self.endings[f"refused: {str(error).split(':')[-1][:50]}"] += 1
        last = self._fa.last_skill_result
        if last is not None:
            self.endings[proto.Ending.Name(last.ending)] += 1

    def _home(self) -> None:
        self._fa.wait_for_franka_interface()
        self._fa.run(MinJerkJoint(HOME, 1), preempt=True, ignore_errors=True)

    def _found(self, seed: int, number: int, done: str) -> None:
        text = ", ".join(self._fa.get_arm_state().robot.reflex_reason) or ", ".join(self._fa.last_skill_result.errors)
        self.errors[text] += 1
        print(f"{self._robot} {seed} at {number}: {done}: {text}", file=sys.stderr, flush=True)
        self._judge(seed, done, number)

    def _judge(self, seed: int, done: str, number: int = 0) -> None:
        commands, states = self._tap.recorded()
        version = wire_limits.FLOAT_STATES if states and len(states[0]) < 2000 else 5
        found, count = wire_limits.violations(self._limits, version, commands, states)
        self.beyond += len(found)
        self.commands += count
        for text in found[:3]:
            print(f"{self._robot} {seed}: {done}: {len(found)} beyond limits: {text}", file=sys.stderr, flush=True)
        if self._keep is not None and (found or number):
            self._keep.mkdir(parents=True, exist_ok=True)
            np.savez_compressed(
                self._keep / f"{self._robot}-{seed}-{number}.npz",
                commands=np.frombuffer(b"".join(commands[-KEPT :]), np.uint8).reshape(-1, len(commands[0])),
                states=np.frombuffer(b"".join(states[-KEPT :]), np.uint8).reshape(-1, len(states[0])),
            )


@contextlib.contextmanager
def arm_and_server(robot: str, server: str | Path, keep: Path | None) -> Iterator[Arm]:
    with (
        tapped_server(robot, server) as tapped,
        FrankaArm(server=tapped.server, with_gripper=False) as fa,
        FrankaArm(server=tapped.server, with_gripper=False) as other,
    ):
        yield Arm(robot, tapped.tap, fa, other, keep)


def run(robot: str, server: str | Path, batches: range, keep: Path | None, until_found: bool = False) -> int:
    """Return how much was found."""
    began = time.monotonic()
    with arm_and_server(robot, server, keep) as arm:
        for seed in batches:
            arm.batch(seed, until_found)
    print(
        f"{robot}: {len(batches) * BATCH} switches in {time.monotonic() - began:.0f} s, {arm.commands} commands, "
        f"{sum(arm.errors.values())} errors {dict(arm.errors)}, {arm.beyond} commands beyond limits\n{dict(arm.endings)}",
        file=sys.stderr,
        flush=True,
    )
    return sum(arm.errors.values()) + arm.beyond


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", choices=list(wire_limits.LIMITS), help="default: each half of it")
    parser.add_argument("--server", help="another franka-interface; default: ours, and then that without limits")
    parser.add_argument("--first", type=int, default=0, help="batch")
    parser.add_argument("--batches", type=int, help=f"of {BATCH} switches; default: those of {SWITCHES} switches")
    parser.add_argument("--keep", type=Path, help="folder for what passed before something was found")
    options = parser.parse_args()
    logging.getLogger("frankapy").setLevel(logging.CRITICAL)  # motions that were too fast are here the point
    robots = [options.robot] if options.robot else list(wire_limits.LIMITS)
    count = options.batches or SWITCHES // BATCH // len(robots)
    batches = range(options.first, options.first + count)
    found = [run(robot, options.server or program("franka-interface"), batches, options.keep) for robot in robots]
    entries = {"switch_discontinuities": sum(found)}
    if options.server is None and options.batches is None:
        unlimited = (run(robots[0], UNLIMITED, range(seed, seed + 1), None, until_found=True) for seed in range(UNLIMITED_BATCHES))
        entries["switch_discontinuities_unlimited"] = next(filter(None, unlimited), 0)
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
