"""Cycles that get no command between skills, seen from the wire.

  gap_same_cycles              at most, from skill to skill on one robot controller, and inside of skills
  gap_switch_cycles            at most, from one robot controller to another: all ordered pairs of the nine, three times,
                               from rest with the settings in force; both in lockstep
  gap_switch_realtime_share    of as many switches in real time, those of one cycle
  gap_switch_cycles_libfranka  the same between joint positions and torques of pylibfranka 0.21.3, the median
"""

import contextlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from frankapy import FrankaArm, FrankaConstants
from frankapy.parts import (
    CartesianImpedance,
    InternalImpedance,
    JointImpedance,
    MinJerkJoint,
    RelativeMinJerkJoint,
    StayPose,
)
from frankapy.sim import program

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY / "tests" / "interop"))
import wire_limits  # noqa: E402
from peer import environment, left_out, simulated_arm  # noqa: E402
from wire_record import WireRecord  # noqa: E402

PEER = "pylibfranka", "0.21.3"
ROUNDS = 3
HOLD = 600  # s, so that no motion ends by itself
KINDS = {
    "torque": ("joints", JointImpedance()),
    "joint_position": ("joints", InternalImpedance()),
    "joint_velocity": ("joints", InternalImpedance()),
    "cartesian_pose": ("pose", InternalImpedance()),
    "cartesian_velocity": ("pose", InternalImpedance()),
    "torque_and_joint_position": ("joints", JointImpedance()),
    "torque_and_joint_velocity": ("joints", JointImpedance()),
    "torque_and_cartesian_pose": ("pose", CartesianImpedance()),
    "torque_and_cartesian_velocity": ("pose", CartesianImpedance()),
}
LIBFRANKA = """
import sys
import pylibfranka as franka

robot = franka.Robot(sys.argv[1], franka.RealtimeConfig.kIgnore)
for i in range(20):
    torque = i % 2
    start = robot.start_torque_control if torque else robot.start_joint_position_control
    control = start() if torque else start(franka.ControllerMode.JointImpedance)
    for k in range(50):
        state, _ = control.readOnce()
        q = state.q_d
        command = franka.Torques([0.0] * 7) if torque else franka.JointPositions(q)
        command.motion_finished = k == 49
        control.writeOnce(command)
"""


@contextlib.contextmanager
def arm(lockstep: bool) -> Iterator[tuple[str, WireRecord]]:
    # In lockstep time between motions is the wall's: slow enough for whatever this computer does besides.
    how = ["--lockstep", "--speed", "0.1"] if lockstep else []
    with (
        WireRecord() as wire,
        simulated_arm(program("fci-sim"), "--ideal", "--wire", str(wire.path), *how) as address,
    ):
        yield address, wire


def gaps(wire: WireRecord) -> tuple[np.ndarray, np.ndarray]:
    """Return cycles without a command: from command to command of a motion, and from motion to motion."""
    commands = wire_limits.parsed("RobotCommand", wire_limits.FLOAT_STATES, wire.recorded()[0])
    finished = (commands["motion_generation_finished"] | commands["torque_command_finished"]).astype(bool)
    missing = np.diff(commands["message_id"].astype(int)) - 1
    return missing[~finished[:-1]], missing[finished[:-1] & ~finished[1:]]


@contextlib.contextmanager
def server(address: str) -> Iterator[str]:
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "arms.toml"
        config.write_text(f'[[arm]]\nname = "arm"\naddress = "{address}"\nhold_time = {HOLD}\ngripper = false\n')
        command = [program("franka-interface"), "--config", config, "--port", "0"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            try:
                yield process.stdout.readline().split("tcp://")[1].strip()
            finally:
                process.terminate()


def every_pair() -> list[str]:
    """Return a walk from robot controller to robot controller that takes each ordered pair once."""
    ways = {name: [other for other in KINDS if other != name] for name in KINDS}
    walk, stack = [], [next(iter(KINDS))]
    while stack:  # Hierholzer
        if ways[stack[-1]]:
            stack.append(ways[stack[-1]].pop())
        else:
            walk.append(stack.pop())
    return walk


def switch(fa: FrankaArm, names: list[str]) -> None:
    for begin in range(0, len(names), 30):
        with fa.sequence():
            for i, name in enumerate(names[begin : begin + 30]):
                kind, controller = KINDS[name]
                delta = np.full(7, 0.002 * (-1) ** i)
                part = RelativeMinJerkJoint(delta, 0.05) if kind == "joints" else StayPose(0.05)
                fa.run(part, controller, robot_controller=name)
                fa.run(part, controller, robot_controller=name)  # the same again


def ours(lockstep: bool) -> tuple[np.ndarray, np.ndarray]:
    walk = every_pair()
    with arm(lockstep) as (address, wire), server(address) as where, FrankaArm(server=where, with_gripper=False) as fa:
        fa.run(MinJerkJoint(FrankaConstants.HOME_JOINTS, 1))
        fa.run(RelativeMinJerkJoint(np.zeros(7), 0.1), KINDS[walk[0]][1], robot_controller=walk[0])
        for _ in range(ROUNDS):
            switch(fa, walk[1:])
        return gaps(wire)


def libfranka() -> np.ndarray:
    python = environment(*PEER)
    with arm(lockstep=True) as (address, wire):
        subprocess.run([python, "-c", LIBFRANKA, address], check=True)
        return gaps(wire)[1]


def main() -> None:
    same, switches = ours(lockstep=True)
    _, paced = ours(lockstep=False)
    entries = {
        "gap_same_cycles": int(same.max()),
        "gap_switch_cycles": int(switches.max()),
        "gap_switch_realtime_share": float(np.mean(paced == 1)),
    }
    found = [("in lockstep", switches, 200), ("in real time", paced, 200)]
    with left_out(*PEER):
        theirs = libfranka()
        found.append(("of libfranka", theirs, 15))
        entries["gap_switch_cycles_libfranka"] = float(np.median(theirs))
    for name, gaps, least in found:
        print(f"{len(gaps)} switches {name}: {np.unique(gaps, return_counts=True)} without a command", file=sys.stderr)
        if len(gaps) < least:
            sys.exit(f"expected at least {least} switches {name}")
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
