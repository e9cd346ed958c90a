"""Targets that are streamed with jitter and loss, and how smoothly an arm follows them: ours, and franky-control 2.0.0 with the
same stream. Real time, one FR3 for each.

Joints go along sines for 10 s. Of so many targets a second each is sent at its time, up to 30 % of the period early or late,
and says where the joints are to be then; 10 % are not sent. The seed is fixed. RATE is 10, 20, 50, 100.
  stream_rms_mm_RATE       root mean square of the tool's way from what was meant, in truth, with the delay taken out
  stream_delay_ms_RATE     the delay with which that is least
  stream_true_jerk_RATE    rad/s³, root mean square over the joints, in truth: what is felt
  stream_jerk_share_RATE   the greatest jerk that was commanded, of the limit of its joint, where no command was lost on the way,
                           after which the robot's reference is another (ours)
  stream_errors            of the robot, or of whoever streams, over all rates
  ..._franky               JointImpedanceTrackingMotion, each target set as its reference
  ..._franky_motions       JointMotion, each in the place of the last (asynchronous), at half of the limits, as ours
Ours is StreamJoint as it is without arguments, under the robot's internal impedance. The peer is left out where it is not installed
and cannot be.
"""

import contextlib
import inspect
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from frankapy import FrankaArm, FrankaArmException, FrankaConstants, proto
from frankapy.kinematics import link_frames
from frankapy.parts import InternalImpedance, Never, StreamJoint
from frankapy.sim import SimulatedArm, Simulation, program, read_truth

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY / "tests" / "interop"))
from peer import environment, left_out, simulated_arm  # noqa: E402

HOME = np.array(FrankaConstants.HOME_JOINTS)
RATES = [10, 20, 50, 100]
SECONDS, JITTER, LOSS, SEED = 10.0, 0.3, 0.1, 7
AMPLITUDE = np.array([0.25, 0.12, 0.2, 0.15, 0.2, 0.15, 0.3])  # rad
FREQUENCY = np.array([0.3, 0.45, 0.25, 0.4, 0.5, 0.35, 0.55])  # Hz
JERK = 5000.0  # rad/s³, of each joint of an FR3 (frankarobotics.github.io, robot and interface specifications)
DELAYS = np.arange(0, 500)  # ms
PEER = ("franky-control", "2.0.0")
PEER_SCRIPT = """
import json, sys, time
import franky
import numpy as np

address, way = sys.argv[1], sys.argv[2]
given = json.load(sys.stdin)
HOME, AMPLITUDE, FREQUENCY, SECONDS = (np.array(given[name]) for name in ("home", "amplitude", "frequency", "seconds"))
%s
robot = franky.Robot(address, realtime_config=franky.RealtimeConfig.Ignore)
robot.recover_from_errors()
robot.relative_dynamics_factor = 0.5
robot.move(franky.JointMotion(given["home"]))
time.sleep(0.5)
errors, clocks = [], []
try:
    if way == "tracking":
        motion = franky.JointImpedanceTrackingMotion(stiffness=given["stiffness"])
        motion.set_reference(franky.JointReference(q=given["home"]))
        robot.move(motion, asynchronous=True)
        time.sleep(0.5)
    begin = time.time() + 0.2
    for when in given["times"]:
        time.sleep(max(0, begin + when - time.time()))
        q = meant(np.array([time.time() - begin]))[0]
        try:
            if way == "tracking":
                motion.set_reference(franky.JointReference(q=q))
                if not robot.is_in_control:
                    raise RuntimeError("the motion has ended")
            else:
                robot.move(franky.JointMotion(q, return_when_finished=False), asynchronous=True)
        except Exception as error:
            errors.append(str(error))
            robot.recover_from_errors()
            if way == "tracking":
                break
        clocks.append((robot.state.time.to_msec(), time.time()))
    time.sleep(1)
    robot.move(franky.TorqueStopMotion() if way == "tracking" else franky.JointStopMotion())
except Exception as error:
    errors.append(str(error))
print(json.dumps({"begin": begin, "clocks": clocks, "errors": errors}))
"""


def meant(t):
    """Return where the joints are to be at times (s) since the stream began, rad."""
    t = np.clip(t, 0, SECONDS)
    fade = np.minimum(t, SECONDS - t)[:, None].clip(0, 1)
    return HOME + fade**2 * (3 - 2 * fade) * AMPLITUDE * np.sin(2 * np.pi * np.outer(t, FREQUENCY))


def times(rate: int) -> list[float]:
    """Return when targets are sent, s."""
    random = np.random.default_rng(SEED + rate)
    count = int(SECONDS * rate)
    when = (np.arange(1, count) + random.uniform(-JITTER, JITTER, count - 1)) / rate
    return [*map(float, when[random.random(count - 1) >= LOSS]), SECONDS]  # not without the last


def judged(rows: np.ndarray, begin: float, clocks: list[tuple[int, float]], name: str) -> dict[str, float]:
    """Return what came of a stream; `clocks`: the robot's time (ms) as seen at times of this computer (s)."""
    # Nothing is seen before it is: the newest look is right.
    offset = max(1e-3 * robot - wall for robot, wall in clocks)
    first = round(1e3 * (begin + offset))
    span = rows[(rows["cycle"] >= first) & (rows["cycle"] < first + 1000 * SECONDS + DELAYS[-1])]
    if len(span) < 1000 * SECONDS:
        raise ValueError("the truth has not all of the stream")
    way = np.array([link_frames(q)[-1][:3, 3] for q in meant(1e-3 * np.arange(0, int(1000 * SECONDS)))])
    tool = span["O_T_TCP"][:, 12:15]
    misses = []
    for delay in DELAYS[: len(tool) - len(way)]:
        misses.append(np.sqrt(np.mean(np.sum((tool[delay : delay + len(way)] - way) ** 2, axis=1))))
    jerk = np.diff(span["ddq"], axis=0) / 1e-3
    return {
        f"stream_rms_mm_{name}": 1e3 * float(min(misses)),
        f"stream_delay_ms_{name}": float(np.argmin(misses)),
        f"stream_true_jerk_{name}": float(np.sqrt(np.mean(jerk**2))),
    }


def ours(rate: int) -> tuple[dict[str, float], int]:
    """Return the entries, and how many errors there were."""
    sent: list[tuple[int, float, list[float]]] = []  # the robot's time, the share of commands that came, joints as commanded
    clocks: list[tuple[int, float]] = []
    errors = 0
    over = threading.Event()

    def watch(server: str) -> None:
        with FrankaArm(server=server) as reader, reader.states() as states:
            for state in states:
                clocks.append((state.robot.message_id, 1e-9 * state.time_ns))
                if len(state.command.q_c) == 7:
                    robot = state.robot
                    sent.append((robot.message_id, robot.control_command_success_rate, list(state.command.q_c)))
                if over.is_set():
                    return

    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.npy"
        with Simulation(SimulatedArm(robot="fr3", truth=truth)) as simulation, FrankaArm(server=simulation.server) as fa:
            fa.goto_joints(HOME, 2)
            fa.run(StreamJoint("targets"), InternalImpedance(), Never(), block=False)
            fa.wait_for(lambda state: state.phase == proto.RUNNING)
            watcher = threading.Thread(target=watch, args=[simulation.server])
            watcher.start()
            with fa.publisher("targets") as publisher:
                begin = time.time() + 0.5
                for when in times(rate):
                    time.sleep(max(0, begin + when - time.time()))
                    publisher.publish(proto.JointPositionSensorMessage(joints=meant(np.array([time.time() - begin]))[0]))
                time.sleep(1)
            topic = fa.topics()["targets"]
            print(f"{rate} Hz: {topic.received} received, {topic.lost} lost, {topic.late} late, {topic.stale} stale", file=sys.stderr)
            over.set()
            watcher.join()
            try:
                fa.stop_skill()
            except FrankaArmException as error:
                print(error.message, file=sys.stderr)
            errors += fa.last_skill_result.ending != proto.STOPPED
            rows = read_truth(truth, until=clocks[-1][0])
    entries = judged(rows, begin, clocks, str(rate))
    cycles, came, commands = (np.array(column) for column in zip(*sent, strict=True))
    jerks = np.abs(np.diff(commands, 3, axis=0)).max(axis=1) / 1e-9
    fewer = np.diff(came) < 0  # the command before has not come
    whole = (cycles[3:] - cycles[:-3] == 3) & ~(fewer[:-2] | fewer[1:-1] | fewer[2:])
    return entries | {f"stream_jerk_share_{rate}": float(jerks[whole].max() / JERK)}, errors


def as_our_loop() -> None:
    """Let this process have the priority that the server gives to its loop, where it may."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(80))


def peers(rate: int, way: str) -> tuple[dict[str, float], int]:
    """Return the entries of franky, and how many errors there were."""
    given = {"home": HOME.tolist(), "amplitude": AMPLITUDE.tolist(), "frequency": FREQUENCY.tolist(), "seconds": SECONDS,
             "times": times(rate), "stiffness": [600, 600, 600, 600, 250, 150, 50]}  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.npy"
        with simulated_arm(program("fci-sim"), "--robot", "fr3", "--truth", str(truth)) as address:
            done = subprocess.run(
                [environment(*PEER), "-c", PEER_SCRIPT % inspect.getsource(meant), address, way], input=json.dumps(given),
                preexec_fn=as_our_loop, check=True, capture_output=True, text=True, timeout=120,
            )  # fmt: skip
            time.sleep(0.3)
            rows = read_truth(truth)
    told = json.loads(done.stdout.strip().splitlines()[-1])
    for error in sorted(set(told["errors"])):
        print(f"franky {way} at {rate} Hz: {error}", file=sys.stderr)
    name = f"{rate}_franky" + "_motions" * (way == "motions")
    try:
        return judged(rows, told["begin"], told["clocks"], name), len(told["errors"])
    except ValueError as error:
        print(f"franky {way} at {rate} Hz: {error}", file=sys.stderr)
        return {}, max(1, len(told["errors"]))


def main() -> None:
    entries: dict[str, float] = {"stream_errors": 0}
    for rate in RATES:
        found, errors = ours(rate)
        entries |= found
        entries["stream_errors"] += errors
        for way in ("motions", "tracking"):
            with left_out(*PEER):
                found, errors = peers(rate, way)
                entries |= found
                key = "stream_errors_franky" + "_motions" * (way == "motions")
                entries[key] = entries.get(key, 0) + errors
        print(rate, entries, file=sys.stderr)
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
