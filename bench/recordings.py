"""Recordings: whether all is in them, what they cost the loop and the disk, and how fast they are read.

  log_lost                     states that came and are not in the recordings, in ten minutes of motion with all on: a reader of all
                               states, and 100 sensor messages a second
  recording_overhead_p99       of the loop's computing time (p99), recording over not recording, by turns
  log_mb_per_hour, _idle       moving under torque control; the robot holding itself
  recording_read_rate          cycles a second, from a file into NumPy arrays
  recording_kill_loss_ms       the most that a killed server's recording lacks at its end, of a hundred
"""

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from frankapy import FrankaArm, FrankaConstants, proto
from frankapy.recording import Recording
from frankapy.sim import SimulatedArm, Simulation

HOME = np.array(FrankaConstants.HOME_JOINTS)
LONG = 600.0  # s
TURN, TURNS = 15.0, 4  # s, of recording and of not
KILLS = 100


def move(fa: FrankaArm, seconds: float) -> None:
    """Keep the arm in motion under torque control."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        fa.goto_joints(HOME + [0.2, 0.1, 0.1, 0.1, 0.1, 0.1, 0.2], 1.5, use_impedance=True, ignore_virtual_walls=True)
        fa.goto_joints(HOME, 1.5, use_impedance=True)


@contextmanager
def listened_and_told(fa: FrankaArm) -> Iterator[None]:
    """Have all states read meanwhile, and sensor messages sent."""
    over = threading.Event()

    def listen() -> None:
        with fa.states() as states:
            for _ in states:
                if over.is_set():
                    break

    def tell() -> None:
        with fa.publisher("bench") as publisher:
            while not over.wait(0.01):
                publisher.publish(proto.JointPositionSensorMessage(joints=HOME))

    threads = [threading.Thread(target=each) for each in (listen, tell)]
    for thread in threads:
        thread.start()
    yield
    over.set()
    for thread in threads:
        thread.join()


def overhead(fa: FrankaArm) -> float:
    """Return the ratio of the p99 of computing, the median of several turns."""

    def computing() -> float:
        values = []
        with fa.states() as states:
            fa.goto_joints(HOME + 0.1, TURN, use_impedance=True, block=False, ignore_virtual_walls=True)
            end = time.monotonic() + TURN
            for state in states:
                if state.phase == proto.RUNNING:
                    values.append(state.compute_us)
                if time.monotonic() > end:
                    break
        fa.wait_for_skill()
        fa.goto_joints(HOME, 1)
        return float(np.percentile(values, 99))

    ratios = []
    for _ in range(TURNS):
        without = computing()
        with fa.recording():
            ratios.append(computing() / without)
    print(f"computing, p99, recording over not: {np.round(ratios, 3)}", file=sys.stderr)
    return float(np.median(ratios))


def kill() -> float:
    """Return what a killed server's recording lacks at its end, ms."""
    with tempfile.TemporaryDirectory() as folder:
        with Simulation(record="always", recordings=folder) as simulation:
            fa = FrankaArm(server=simulation.server)
            fa.goto_joints(HOME + 0.2, 10, block=False, ignore_virtual_walls=True)
            time.sleep(random.uniform(0.5, 2.5))
            supervisor = simulation.processes[-1]
            children = subprocess.run(["pgrep", "-P", str(supervisor)], capture_output=True, text=True, check=True)
            for process in (supervisor, *map(int, children.stdout.split())):
                os.kill(process, signal.SIGKILL)
            killed = time.time()
        (path,) = Path(folder).glob("*/*.mcap")
        recording = Recording(path)
        return 1000 * (killed - recording.start - recording.states["time"][-1])


def main() -> None:
    entries: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        with Simulation(SimulatedArm(), recordings=folder) as simulation, FrankaArm(server=simulation.server) as fa:
            fa.reset_joints(2)
            entries["recording_overhead_p99"] = overhead(fa)
            time.sleep(4)  # until the robot holds itself
            with fa.recording() as status:
                time.sleep(20)
            idle = status()
            entries["log_mb_per_hour_idle"] = idle.bytes / 1e6 / idle.time * 3600
            others = set(Path(folder).glob("*/*.mcap"))
            with fa.recording() as status, listened_and_told(fa):
                move(fa, LONG)
            lost = status().lost
            files = sorted(set(Path(folder).glob("*/*.mcap")) - others)  # one gives way to the next
        size = sum(file.stat().st_size for file in files)
        begin = time.perf_counter()
        recordings = [Recording(file) for file in files]
        phase, cycles = (np.concatenate([each.states[name] for each in recordings]) for name in ("phase", "cycles"))
        took = time.perf_counter() - begin
        seconds = recordings[-1].start + recordings[-1].states["time"][-1] - recordings[0].start
        entries["recording_read_rate"] = len(cycles) / took
        entries["log_mb_per_hour"] = size / 1e6 / seconds * 3600
        moving = ~((phase[1:] == proto.READY) | (phase[:-1] == proto.READY))
        gaps = (np.diff(cycles) - 1)[moving]
        entries["log_lost"] = float(max(gaps.sum(), lost))  # of one that was lost while it moved both tell
        print(f"{len(cycles)} states in {len(files)} files, {size / 1e6:.1f} MB", file=sys.stderr)
    missing = [kill() for _ in range(KILLS)]
    print(f"missing at the end of killed ones: {np.round(missing)} ms", file=sys.stderr)
    entries["recording_kill_loss_ms"] = max(missing)
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
