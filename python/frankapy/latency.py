"""How long things take between a script, its server and an arm, and whether that is good enough."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from frankapy import parts, proto
from frankapy.doctor import BAD, NOTE, OK, WARN, Finding

if TYPE_CHECKING:
    from frankapy.franka_arm import FrankaArm

_QUESTIONS = 300
_LISTEN = 3.0  # s
_HOLD = 5.0  # s
_MESSAGES = 20
_TOPIC = "frankapy latency"

# Good below the first; no use above the second. Streams of targets bear some ms; the loop itself bears none.
_ROUND_TRIP = (2.0, 20.0)  # ms, the slowest of a hundred
_JITTER = (5.0, 50.0)
_COMPUTING = (300.0, 700.0)  # µs of a cycle of 1000
_SUCCESS = (0.999, 0.97)  # share of commands that come in time; the robot stops when 20 in a row do not
_NETWORK = (
    "Use a cable instead of wifi between this computer and the server's, or run the script on the server's own computer; "
    "where that cannot be, stream targets (Stream... trajectories), which bear it."
)
_COMPUTER = (
    "The server's computer keeps the loop waiting: a kernel with PREEMPT_RT, the processor's governor at performance, and a network "
    "card of its own for the robot, without a switch; `frankapy doctor` there says what is missing."
)


def measure(arm: FrankaArm, hold: bool = False) -> Iterator[Finding]:
    """Measure one thing after the other.

    `hold` also holds the arm where it is for some 10 s, under torque control: how many of its commands come in time, and how soon a
    sensor message does what it is to do.
    """
    server = arm._server  # noqa: SLF001 - what is below a FrankaArm is what is measured
    trips = []
    for _ in range(_QUESTIONS):
        begin = time.perf_counter()
        server.ask(proto.Request(get_state=proto.GetState()))
        trips.append(1e3 * (time.perf_counter() - begin))
    yield _judged("question, answer", trips, "ms", _ROUND_TRIP, _NETWORK)

    difference, uncertain = server.clock_difference
    yield Finding(
        OK if abs(difference) < max(0.001, uncertain) else NOTE,
        "clocks",
        f"the server's is {1e3 * abs(difference):.2f} ms {'ahead' if difference > 0 else 'behind'} (± {1e3 * uncertain:.2f} ms)",
        "" if abs(difference) < 0.1 else "Start times and times in recordings are the server's: let NTP or chrony set both clocks.",
    )
    yield from _states(arm, difference)
    if hold:
        yield from _holding(arm)
        yield _messages(arm)


def _judged(what: str, values: list[float], unit: str, bounds: tuple[float, float], advice: str) -> Finding:
    middle, slow = np.percentile(values, [50, 99])
    level = OK if slow <= bounds[0] else WARN if slow <= bounds[1] else BAD
    found = f"{middle:.2f} {unit}, the slowest of a hundred {slow:.2f} {unit}"
    return Finding(level, what, found, "" if level == OK else advice)


def _states(arm: FrankaArm, difference: float) -> Iterator[Finding]:
    ages, cycles = [], []
    with arm.states() as states:
        end = time.monotonic() + _LISTEN
        for state in states:
            ages.append(1e3 * (time.time() + difference - state.time_ns * 1e-9))
            cycles.append(state.cycles)
            if time.monotonic() > end:
                break
    if len(cycles) < 2:
        yield Finding(BAD, "states", "none arrive", "Is a firewall between this computer and the server's?")
        return
    yield _judged("arm to script", ages, "ms", _JITTER, _NETWORK)
    missed = cycles[-1] - cycles[0] + 1 - len(cycles)
    yield Finding(
        WARN if missed else OK,
        "states",
        f"{len(cycles) / _LISTEN:.0f} a second, {missed} of {cycles[-1] - cycles[0] + 1} did not get here",
        "This computer is too slow, or too busy, for all of them: ask for fewer, fa.states(rate=100)." if missed else "",
    )
    state = arm.get_arm_state()
    level = NOTE if state.lost_states else OK
    yield Finding(level, "robot's network", f"{state.lost_states} of {state.cycles} states of the robot were lost since the server began")


def _holding(arm: FrankaArm) -> Iterator[Finding]:
    arm.run(parts.StayJoint(_HOLD), parts.JointImpedance(), block=False)
    computing, success, gaps = [], [], []
    last = 0.0
    with arm.states() as states:
        for state in states:
            if state.phase == proto.RUNNING:
                computing.append(state.compute_us)
                success.append(state.robot.control_command_success_rate)
                now = state.time_ns * 1e-6
                if last:
                    gaps.append(abs(now - last - 1))
                last = now
            elif computing or (arm.is_skill_done() and state.cycles > arm.last_skill_result.last_state.cycles):
                break
    arm.wait_for_skill()
    if not computing:
        yield Finding(BAD, "computing", f"the arm was not held: {arm.last_skill_result.message or 'its skill did not begin'}")
        return
    yield _judged("computing", computing, "µs", _COMPUTING, _COMPUTER)
    yield _judged("jitter of cycles", gaps, "ms", (0.3, 1.0), _COMPUTER)
    share = float(np.mean(success))
    level = OK if share >= _SUCCESS[0] else WARN if share >= _SUCCESS[1] else BAD
    yield Finding(level, "commands in time", f"{100 * share:.2f} %, the least of any hundred {100 * min(success):.0f} %", "" if level == OK else _COMPUTER)


def _messages(arm: FrankaArm) -> Finding:
    trips = []
    with arm.publisher(_TOPIC) as publisher:
        for _ in range(_MESSAGES):
            until = [parts.SensorSays(_TOPIC), parts.Time(_HOLD)]  # its way may be barred
            arm.run(parts.StayJoint(_HOLD), parts.JointImpedance(), until, block=False)
            time.sleep(0.1)
            begin = time.perf_counter()
            publisher.publish(proto.ShouldTerminateSensorMessage(should_terminate=True))
            arm.wait_for_skill()
            trips.append(1e3 * (time.perf_counter() - begin))
    return _judged("sensor message, loop, result", trips, "ms", _JITTER, _NETWORK)
