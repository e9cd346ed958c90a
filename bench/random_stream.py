"""Targets at random, far beyond what the arm can and may do, streamed for an hour of its time: whether the robot ever minds.

Joints, poses, joint velocities and Cartesian velocities in turn, each for STREAM seconds, under our torques and under the robot's own
control, FER and FR3 by turns, in lockstep. A target comes every 0.02 to 1 s of the arm's time and has nothing to do with the one
before. Joints are drawn from their range, and some beyond it; poses from a cube that is larger than the arm reaches; velocities from
twice the limits; half a second without one is common, so that streams are braked too. Streams are stopped wherever the arm is.
The arm stands at a table with a plate, which are walls for it and bodies in its world.
  random_stream_reflexes        errors of the robot
  random_stream_hours           of the arm's time; an argument: others
  random_stream_targets         that were sent
  random_stream_refused         of these, as a joint was beyond its range
  random_stream_limited_share   of the cycles in which a stream ran, those in which limits, walls or the arm itself held it
  random_stream_nearest_mm      from walls to the arm, at least, in truth (walls are kept away from by 10 mm; it is looked at every
                                10 ms or so)
  random_stream_errors_per_minute_franky, random_stream_minutes_franky
                                targets drawn likewise to franky-control 2.0.0 with an FR3 at that table, each as a motion in the place of
                                the last (asynchronous), at its full dynamics: errors of the robot, in real time. What it refuses does not
                                count.
                                Left out where it is not installed and cannot be.
"""

import itertools
import json
import logging
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
from google.protobuf.message import Message
from shared.arm import HOME, arm
from tqdm import tqdm

from frankapy import FrankaArm, FrankaArmArgumentError, FrankaArmException, proto
from frankapy.parts import (
    CartesianImpedance,
    InternalImpedance,
    JointImpedance,
    MinJerkJoint,
    Never,
    StreamCartesianVelocity,
    StreamJoint,
    StreamJointVelocity,
    StreamPose,
)
from frankapy.sim import Simulation, program
from frankapy.walls import Box, Plane

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(REPOSITORY / "tests" / "interop"), str(REPOSITORY / "tests" / "safety")]
from judge import capsules, frames, gap  # noqa: E402
from peer import environment, left_out, simulated_arm  # noqa: E402
from wire_limits import LIMITS, Limits  # noqa: E402

HOURS = 1.0
STREAM = 30.0  # s of a skill
RUN = 8  # streams on one arm, then the other
SEED = 17
PAUSE = (0.02, 1.0)  # s to the next target
BEYOND, OUT = 0.2, 1.0  # of joint targets that are out of range, by so much at most, rad
CUBE = np.array([[-1.1, -1.1, -0.4], [1.1, 1.1, 1.4]])  # m
FASTER = 2.0  # than the limits
TOPIC = "targets"
SCENE = "plate"
WALLS = {"table": Plane([0, 0, 1], [0, 0, 0]), "plate": Box([0.36, 0.6, 0.2], [0.5, 0, 0.1])}  # as in sim/scenes/plate.xml
KINDS = ("joints", "pose", "joint_velocities", "cartesian_velocities")
STREAMS = {"joints": StreamJoint, "pose": StreamPose, "joint_velocities": StreamJointVelocity, "cartesian_velocities": StreamCartesianVelocity}
LAWS = {"joints": JointImpedance, "pose": CartesianImpedance, "joint_velocities": JointImpedance, "cartesian_velocities": CartesianImpedance}
PEER, PEER_SECONDS = ("franky-control", "2.0.0"), 30.0
PEER_SCRIPT = """
import contextlib, json, sys, time
import franky

given = json.load(sys.stdin)
robot = franky.Robot(sys.argv[1], realtime_config=franky.RealtimeConfig.Ignore, default_torque_threshold=100, default_force_threshold=100)
robot.recover_from_errors()
errors, refused = [], []
MOTIONS = {
    "joints": lambda x: franky.JointMotion(x, return_when_finished=False),
    "pose": lambda x: franky.CartesianMotion(franky.Affine(x[:3], x[4:] + x[3:4]), return_when_finished=False),
    "joint_velocities": lambda x: franky.JointVelocityMotion(x, franky.Duration(1000)),
    "cartesian_velocities": lambda x: franky.CartesianVelocityMotion(franky.RobotVelocity(franky.Twist(x[:3], x[3:])), franky.Duration(1000)),
}
robot.relative_dynamics_factor = 0.3
robot.move(franky.JointMotion(given["home"]))
robot.relative_dynamics_factor = 1.0
begin = time.time()
for when, target in given["targets"]:
    time.sleep(max(0, begin + when - time.time()))
    try:
        robot.move(MOTIONS[given["kind"]](target), asynchronous=True)
    except franky.ControlException as error:
        errors.append(str(error))
    except Exception as error:
        refused.append(str(error))
    if robot.has_errors:
        with contextlib.suppress(franky.Exception):
            robot.recover_from_errors()
print(json.dumps([errors, refused]))
"""


def drawn(kind: str, limits: Limits, random: np.random.Generator) -> list[float]:
    """Return a target: seven joints, position and quaternion (w, x, y, z), or velocities."""
    if kind == "joints":
        q = random.uniform(*limits.q)
        if random.random() < BEYOND:
            i = random.integers(7)
            q[i] = limits.q[1, i] + random.uniform(0, OUT) if random.random() < 0.5 else limits.q[0, i] - random.uniform(0, OUT)
        return list(map(float, q))
    if kind == "pose":
        quaternion = random.normal(size=4)
        return list(map(float, [*random.uniform(*CUBE), *(quaternion / np.linalg.norm(quaternion))]))
    most = limits.dq if kind == "joint_velocities" else np.repeat([limits.translation[0], limits.rotation[0]], 3)
    return list(map(float, random.uniform(-FASTER, FASTER, len(most)) * most))


def targets(kind: str, limits: Limits, random: np.random.Generator, seconds: float) -> list[tuple[float, list[float]]]:
    """Return what is sent in a stream, each with its time (s)."""
    when = np.cumsum(random.uniform(*PAUSE, int(seconds / PAUSE[0])))
    return [(float(t), drawn(kind, limits, random)) for t in when[when < seconds]]


def message(kind: str, x: list[float]) -> Message:
    if kind == "joints":
        return proto.JointPositionSensorMessage(joints=x)
    if kind == "pose":
        return proto.PosePositionSensorMessage(position=x[:3], quaternion=x[3:])
    if kind == "joint_velocities":
        return proto.JointVelocitySensorMessage(joint_velocities=x)
    return proto.CartesianVelocitySensorMessage(cartesian_velocities=x)


# --- ours ----------------------------------------------------------------------------------------------------------------


class Found:
    """What came of the streams."""

    def __init__(self) -> None:
        self.reflexes = self.targets = self.refused = self.cycles = self.limited = 0
        self.seconds = 0.0
        self.nearest = np.inf

    def see(self, postures: list[np.ndarray]) -> None:
        at = frames(np.array(postures))
        for wall in WALLS.values():
            self.nearest = min(self.nearest, *(float(gap(wall, each, at[each.frame]).min()) for each in capsules()))


def stream(simulation: Simulation, fa: FrankaArm, kind: str, own: bool, sent: list[tuple[float, list[float]]], found: Found) -> None:
    """Begin where the arm is, and send targets for as long as the last of them says."""
    law = InternalImpedance() if own else LAWS[kind]()
    delay = {"delay": 0} if kind in ("joints", "pose") else {}
    fa.run(STREAMS[kind](TOPIC, timeout=0.5, speed=1, **delay), law, Never(), block=False)
    begin = simulation.truth().cycle
    postures = []
    with fa.publisher(TOPIC) as publisher:
        for when, target in sent:
            while (truth := simulation.truth()).cycle < begin + 1000 * when:
                postures.append(np.array(truth.q))
                if fa.is_skill_done():
                    break
            publisher.publish(message(kind, target))
            found.targets += 1
            if fa.is_skill_done():
                break
    found.seconds += (simulation.truth().cycle - begin) / 1000
    found.see(postures)


def count(fa: FrankaArm, what: str, found: Found) -> None:
    """Take the result of the stream that has ended."""
    result = fa.last_skill_result
    found.cycles += round(1000 * result.time)
    found.limited += result.limited_cycles
    if result.ending == proto.ROBOT_ERROR:
        found.reflexes += 1
        print(f"{what}: {list(result.errors)} {result.message}", file=sys.stderr)


def ours(hours: float) -> dict[str, float]:
    found = Found()
    random = np.random.default_rng(SEED)
    with tqdm(total=round(3600 * hours), unit="s", disable=None) as bar:
        for robot in itertools.cycle(LIMITS):
            with arm(robot, scene=SCENE) as (simulation, fa, _):
                for name, wall in WALLS.items():
                    fa.walls[name] = wall
                for n in range(RUN):
                    kind, own = KINDS[n % len(KINDS)], n >= len(KINDS)
                    sent = targets(kind, LIMITS[robot], random, STREAM)
                    try:
                        stream(simulation, fa, kind, own, sent, found)
                    except FrankaArmArgumentError:  # a robot leads no pose from a singular posture, and there the arm may have been left
                        fa.run(MinJerkJoint(HOME, 5))
                        stream(simulation, fa, kind, own, sent, found)
                    with suppress(FrankaArmException):
                        fa.stop_skill()
                    count(fa, f"{robot}, {kind}{' with its own control' * own}", found)
                    bar.update(round(found.seconds) - bar.n)
                    bar.set_postfix(reflexes=found.reflexes)
                    if fa.last_skill_result.ending == proto.ROBOT_ERROR or found.seconds >= 3600 * hours:
                        break  # and go on with another arm
                found.refused += fa.topics()[TOPIC].refused
            if found.seconds >= 3600 * hours:
                break
    return {
        "random_stream_reflexes": found.reflexes,
        "random_stream_hours": found.seconds / 3600,
        "random_stream_targets": found.targets,
        "random_stream_refused": found.refused,
        "random_stream_limited_share": found.limited / found.cycles,
        "random_stream_nearest_mm": 1e3 * found.nearest,
    }


# --- the peer ------------------------------------------------------------------------------------------------------------


def peers() -> dict[str, float]:
    random = np.random.default_rng(SEED)
    count = 0
    for kind in KINDS:
        given = {"home": HOME.tolist(), "kind": kind, "targets": targets(kind, LIMITS["fr3"], random, PEER_SECONDS)}
        with simulated_arm(program("fci-sim"), "--robot", "fr3", "--scene", SCENE) as address:
            done = subprocess.run(
                [environment(*PEER), "-c", PEER_SCRIPT, address], input=json.dumps(given), check=True, capture_output=True, text=True,
                timeout=600,
            )  # fmt: skip
        errors, refused = json.loads(done.stdout.strip().splitlines()[-1])
        count += len(errors)
        print(f"franky, {kind}: {len(refused)} of {len(given['targets'])} targets refused", file=sys.stderr)
        for error in sorted(set(errors)):
            print(f"franky, {kind}, {errors.count(error)} times: {error}", file=sys.stderr)
    minutes = len(KINDS) * PEER_SECONDS / 60
    return {"random_stream_errors_per_minute_franky": count / minutes, "random_stream_minutes_franky": minutes}


def main() -> None:
    logging.getLogger("frankapy").setLevel(logging.ERROR)
    began = time.monotonic()
    entries = ours(float(sys.argv[1]) if len(sys.argv) > 1 else HOURS)
    print(f"{time.monotonic() - began:.0f} s of this computer's", file=sys.stderr)
    with left_out(*PEER):
        entries |= peers()
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
