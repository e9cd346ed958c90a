"""What the programs of this folder share: profiles to command, and the report to the one who started them.

They run in the environments of their peers, so this needs NumPy and nothing else.
"""

import contextlib
import json
import math
import re
import sys
from collections.abc import Callable

import numpy as np

TIME = 1.0  # s of a motion
JOINT = 6  # the joint that moves
ANGLE = 0.1  # rad
DISTANCE = 0.05  # m
LONG = 60.0  # s after which a motion to and fro that nothing has ended is given up
ATTEMPTS = 5
TOOL = [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0.01, -0.02, 0.05, 1.0]  # a frame, column-major
LOAD = (0.4, [0.01, 0.02, 0.05], [0.001, 0, 0, 0, 0.002, 0, 0, 0, 0.001])  # kg, m, kg m²
Way = Callable[[float], tuple[float, float]]  # value and rate at a time


def profile(t: float) -> tuple[float, float]:
    """From 0 to 1 in TIME, at rest at both ends with no acceleration: value and rate (1/s)."""
    s = min(max(t / TIME, 0.0), 1.0)
    rate = 0.0 if t >= TIME else 30 * s**2 * (1 - s) ** 2 / TIME
    return s**3 * (10 - 15 * s + 6 * s**2), rate


def sway(t: float) -> tuple[float, float]:
    """To 1 in TIME and back, without end: value and rate (1/s)."""
    return (1 - math.cos(math.pi * t / TIME)) / 2, math.pi / TIME / 2 * math.sin(math.pi * t / TIME)


def joint_velocity(t: float, along: Way = profile) -> list[float]:
    """rad/s (7,)"""
    dq = [0.0] * 7
    dq[JOINT] = ANGLE * along(t)[1]
    return dq


def joint_position(start: list[float], t: float, along: Way = profile) -> list[float]:
    """rad (7,)"""
    q = list(start)
    q[JOINT] += ANGLE * along(t)[0]
    return q


def pose(start: list[float], t: float) -> list[float]:
    """Column-major (16,), up by DISTANCE"""
    moved = list(start)
    moved[14] += DISTANCE * profile(t)[0]
    return moved


def twist(t: float, along: Way = profile) -> list[float]:
    """m/s and rad/s (6,)"""
    return [0.0, 0.0, DISTANCE * along(t)[1], 0.0, 0.0, 0.0]


def torque(start: list[float], q: list[float], dq: list[float], t: float, along: Way = profile) -> list[float]:
    """Joint impedance along joint_position, N m (7,)"""
    stiffness = np.array([600, 600, 600, 600, 250, 150, 150])
    error = np.array(joint_position(start, t, along)) - np.array(q)
    damping = 0.8 * np.sqrt(stiffness)
    return list(stiffness * error + damping * (np.array(joint_velocity(t, along)) - np.array(dq)))


_asked = 0  # calls that nobody has heard the answer of


def ask(call: str, *arguments: object) -> None:
    """Ask for something around the arm, of World in ../world.py, which is done while this goes on; answer() waits for it.

    Prints `call <tab> ask <tab> arguments in JSON`.
    """
    global _asked
    _asked += 1
    print(call, "ask", json.dumps(arguments), sep="\t", flush=True)


def answer() -> object:
    """Wait until all that was asked for is done, and return what came of the last."""
    global _asked
    reply: dict = {"value": None}
    while _asked:
        reply = json.loads(sys.stdin.readline() or '{"error": "nobody answers: this is started by ../run.py"}')
        _asked -= 1
    if "error" in reply:
        raise RuntimeError(reply["error"])
    return reply["value"]


def world(call: str, *arguments: object) -> object:
    """Have something done around the arm, and return what came of it."""
    ask(call, *arguments)
    return answer()


def expect(what: str, value: float, wanted: float, tolerance: float) -> None:
    """Raise AssertionError when a value is not where it should be."""
    if not abs(value - wanted) <= tolerance:
        raise AssertionError(f"{what} is {value:.5f}, and should be {wanted:.5f} within {tolerance:g}")


def expect_joint(start: list[float], end: list[float], tolerance: float = 0.003) -> None:
    """Raise unless JOINT has moved by ANGLE and the others have stayed."""
    for i in range(7):
        expect(f"joint {i + 1}", end[i] - start[i], ANGLE if i == JOINT else 0.0, tolerance)


def expect_raised(start: list[float], end: list[float], tolerance: float = 0.003) -> None:
    """Raise unless the tool has moved up by DISTANCE."""
    for i, axis in enumerate("xyz"):
        expect(axis, end[12 + i] - start[12 + i], DISTANCE if axis == "z" else 0.0, tolerance)
    turned = np.array(start).reshape(4, 4)[:3, :3] @ np.array(end).reshape(4, 4)[:3, :3].T
    angle = math.acos(min(1.0, (np.trace(turned) - 1) / 2))
    expect("turn", angle, 0.0, 0.01)


def expect_refused(told: str, attempt: Callable[[], object]) -> None:
    """Raise unless the client's own exception with that text refuses it."""
    try:
        attempt()
    except Exception as error:  # noqa: BLE001 - each client has classes of its own
        if told not in str(error):
            raise
    else:
        raise AssertionError(f"it was taken, and should be refused as {told!r}")


def was_late(why: str) -> bool:
    """Whether the robot lost commands, as it does when this computer, without a real-time kernel, keeps a client waiting.

    libfranka tells the share of the last 100 that arrived with each motion that a reflex ends.
    """
    rate = re.search(r"control_command_success_rate: ([\d.]+)", why)
    stood_still = "UDP receive: Timeout" in why  # for a second, all of it
    lost = rate is not None and float(rate[1].rstrip(".")) < 1
    return "communication_constraints_violation" in why or stood_still or lost


def run(capabilities: list[tuple[str, Callable[[], None]]], recover: Callable[[], None]) -> None:
    """Try each capability, again when the client was late; one line `name <tab> OK, FAIL or can't <tab> why` for each.

    NotImplementedError says what the client itself cannot do.
    """
    failed = False
    for name, attempt in capabilities:
        before = ""
        for attempt_number in range(1, ATTEMPTS + 1):
            verdict, why = "OK", before and f"in attempt {attempt_number}, after {before}"
            try:
                attempt()
            except NotImplementedError as error:
                verdict, why = "can't", str(error)
            except Exception as error:  # noqa: BLE001 - whatever a peer throws is a result
                verdict, why = "FAIL", " ".join(f"{type(error).__name__}: {error}".split())
                with contextlib.suppress(Exception):  # the next attempt will tell
                    recover()
            if verdict != "FAIL" or not was_late(why):
                break
            before = why
        failed |= verdict == "FAIL"
        print(name, verdict, why, sep="\t", flush=True)
    sys.exit(failed)
