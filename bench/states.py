"""Sensor messages in, states out: how long that takes, and what of it is lost. All on one computer, in real time.

  sensor_to_command_us_p50, _p99  from `publish` in Python to the first command that has it, torques passed through
  state_read_us_p50               of fa.get_arm_state()
  state_age_ms_p99                of what it returns
  state_lost                      of three subscribers in a minute, one of which is stopped for 5 s
"""

import json
import multiprocessing
import os
import random
import signal
import sys
import threading
import time

import numpy as np

from frankapy import FrankaArm, proto
from frankapy.parts import Never, PassThroughJointTorque, StayJoint
from frankapy.sim import Simulation

MESSAGES = 1000
READS = 3000
LISTEN = 60.0  # s
STOPPED = 5.0  # s


def sensor_to_command(fa: FrankaArm) -> np.ndarray:
    """Return the times (µs) from publishing a torque to the command that has it."""
    sent: dict[float, int] = {}
    seen: dict[float, int] = {}
    stopped: list[int] = []  # when, ns

    def watch() -> None:
        with fa.states() as states:
            for state in states:
                torque = state.command.tau_J_d[6] if state.command.tau_J_d else 0.0
                seen.setdefault(round(torque, 6), state.time_ns + int(1000 * state.compute_us))
                if stopped and state.time_ns > stopped[0]:
                    break

    watcher = threading.Thread(target=watch)
    watcher.start()
    fa.run(StayJoint(600), PassThroughJointTorque(selection=[0, 0, 0, 0, 0, 0, 1], topic="torques"), Never(), robot_controller="torque", block=False)
    fa.wait_for(lambda state: state.phase == proto.RUNNING, 5)
    with fa.publisher("torques") as publisher:
        for i in range(MESSAGES):
            torque = round(0.02 * (-1) ** i + 1e-5 * i, 6)  # each another
            time.sleep(random.uniform(0.002, 0.005))
            message = proto.JointTorqueControllerSensorMessage(joint_torques=[0, 0, 0, 0, 0, 0, torque])
            sent[torque] = time.time_ns()
            publisher.publish(message)
    time.sleep(0.1)
    stopped.append(time.time_ns())
    fa.stop_skill()
    watcher.join()
    return np.array([(seen[torque] - begin) / 1000 for torque, begin in sent.items() if torque in seen])


def reads(fa: FrankaArm) -> tuple[np.ndarray, np.ndarray]:
    """Return what reads take (µs), and the ages of what they return (ms)."""
    times, ages = [], []
    fa.get_arm_state()
    time.sleep(0.2)
    for _ in range(READS):
        begin = time.perf_counter_ns()
        state = fa.get_arm_state()
        times.append((time.perf_counter_ns() - begin) / 1000)
        ages.append(1000 * state.age)
        time.sleep(random.uniform(0.0005, 0.003))
    return np.array(times), np.array(ages)


def subscribe(server: str, result: multiprocessing.Queue) -> None:
    """Count the states that a subscriber does not get."""
    with FrankaArm(server=server) as fa, fa.states() as states:
        first = last = states.receive().cycles
        count, end = 1, time.monotonic() + LISTEN
        while time.monotonic() < end and (state := states.receive()) is not None:
            last, count = state.cycles, count + 1
        result.put(last - first + 1 - count)


def lost(server: str) -> int:
    """Return what three subscribers did not get."""
    context = multiprocessing.get_context("spawn")
    result = context.Queue()
    processes = [context.Process(target=subscribe, args=(server, result)) for _ in range(3)]
    for process in processes:
        process.start()
    time.sleep(LISTEN / 3)
    os.kill(processes[0].pid, signal.SIGSTOP)
    time.sleep(STOPPED)
    os.kill(processes[0].pid, signal.SIGCONT)
    losses = [result.get(timeout=2 * LISTEN) for _ in processes]
    for process in processes:
        process.join()
    print(f"states lost by each subscriber: {losses}", file=sys.stderr)
    return sum(losses)


def main() -> None:
    with Simulation() as simulation, FrankaArm(server=simulation.server) as fa:
        fa.reset_joints(2)
        latencies = sensor_to_command(fa)
        times, ages = reads(fa)
        print(f"{len(latencies)} of {MESSAGES} messages seen: {np.percentile(latencies, [1, 50, 90, 99])} µs", file=sys.stderr)
        print(f"reads {np.percentile(times, [50, 90, 99])} µs, ages {np.percentile(ages, [50, 90, 99])} ms", file=sys.stderr)
        entries = {
            "sensor_to_command_us_p50": float(np.percentile(latencies, 50)),
            "sensor_to_command_us_p99": float(np.percentile(latencies, 99)),
            "state_read_us_p50": float(np.percentile(times, 50)),
            "state_age_ms_p99": float(np.percentile(ages, 99)),
            "state_lost": lost(simulation.server),
        }
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
