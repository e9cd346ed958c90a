"""What provokes each error of a robot, in commands that any client can send; the clients of this folder send them.

A stream is a function of (state at the start, newest state, cycle) that gives the values of one command. This needs
NumPy only.
"""

import dataclasses
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from report import was_late

DT = 0.001  # s
ATTEMPTS = 4
HOME = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
RANGES = {  # rad, of the last joint
    "fer": (-2.8973, 2.8973),
    "fr3": (-3.0508, 3.0508),
}

Stream = Callable[[Any, Any, int], np.ndarray]


@dataclasses.dataclass
class Command:
    """One command: `kind` says what the values are, and `elbow` may go with a pose or a twist."""

    kind: str  # "joint position", "joint velocity", "cartesian pose", "cartesian velocity" or "torque"
    values: np.ndarray
    elbow: tuple[float, float] | None = None


@dataclasses.dataclass
class Provocation:
    """How an error is provoked: from a posture, with one kind of command, for at most some time."""

    error: str
    kind: str
    stream: Stream
    posture: np.ndarray = dataclasses.field(default_factory=lambda: HOME)
    cycles: int = 3000
    elbow: Stream | None = None
    # Thresholds of torque (N m) and force (N) at which contact is a collision.
    thresholds: tuple[float, float] = (1000.0, 1000.0)
    # m, of a tool that is longer than the hand.
    tool: float = 0.0
    # s in which no command leaves, at cycle 10.
    silence: float = 0.0


def ramp(final: float, rate: float, jerk: float, cycle: int) -> float:
    """A velocity that goes from 0 to its final value from cycle 5 on, with a bounded rate and change of rate."""
    time, rounding = max(cycle - 5, 0) * DT, rate / jerk
    end = final / rate + rounding
    if time >= end:
        return final
    if time > end - rounding:
        return final - jerk * (end - time) ** 2 / 2
    return jerk * time**2 / 2 if time < rounding else rate * (time - rounding / 2)


def joint(index: int, value: float) -> np.ndarray:
    """A vector (7,) of zeros but for one joint."""
    return value * np.eye(7)[index]


def jump(cycle: int, by: np.ndarray) -> np.ndarray:
    """Nothing up to cycle 5, then all of it."""
    return by if cycle >= 5 else 0 * by


def pose(start, by=(0.0, 0.0, 0.0), mirrored: bool = False) -> np.ndarray:
    """O_T_EE_c of the start, shifted; mirrored is a frame that is left-handed."""
    moved = np.array(start.O_T_EE_c)
    moved[12:15] += by
    if mirrored:
        moved[0:3] *= -1
    return moved


class TorqueRamp:
    """Torques that go to their aim as fast as the torque rate allows (1000 N m/s)."""

    def __init__(self, aim: Callable[[Any, int], np.ndarray]) -> None:
        self.aim = aim
        self.last = np.zeros(7)

    def __call__(self, _start, state, cycle: int) -> np.ndarray:
        """N m (7,); cycle 0 begins a motion"""
        if cycle == 0:
            self.last = np.zeros(7)
        elif state.control_command_success_rate < 1:  # the rate counts from the last one that the robot took
            self.last = np.array(state.tau_J_d)
        self.last = np.clip(self.aim(state, cycle), self.last - 0.95, self.last + 0.95)
        return self.last


def velocity_law(state, wanted: np.ndarray) -> np.ndarray:
    """Torques that keep the joints at those velocities; N m (7,)"""
    return np.array([20.0] * 4 + [4.0] * 3) * (wanted - np.array(state.dq))


def provocations(robot: str) -> list[Provocation]:
    """All that an FCI client can provoke without hands at the arm, from postures in free space."""
    low, high = RANGES[robot]

    def twist(axis: int, value: float) -> np.ndarray:
        return value * np.eye(6)[axis]

    def elbow(shift: float = 0.0, sign: float = 1.0, at: int = 0) -> Stream:
        def values(start, _, cycle):
            q3, side = start.elbow_c
            return np.array([q3 + shift, sign * side] if cycle >= at else [q3, side])

        return values

    def holding_pose(start, _state, _cycle):
        return pose(start)

    def same(start, _state, _cycle):
        return np.array(start.q_d)

    near_end = HOME + joint(6, high - 0.2 - HOME[6])
    near_start = HOME + joint(6, low + 0.3 - HOME[6])
    above_floor = np.array([0, 0.3, 0, -2.3, 0, 2.6, HOME[6]])

    def press(_start, _state, cycle):
        return twist(2, -ramp(0.1, 1, 200, cycle))

    stretched = np.array([0, 1.2, 0, -0.4, 0, 1.8, HOME[6]])
    all_arms = [
        Provocation("self_collision_avoidance_violation", "joint velocity",
                    lambda *at: joint(5, -ramp(0.3, 1, 500, at[2])), np.array([0, -0.5, 0, -2.7, 0, 1.4, HOME[6]])),
        Provocation("joint_velocity_violation", "torque",
                    TorqueRamp(lambda state, cycle: velocity_law(state, joint(6, -min(cycle / 50, 9.0))))),
        Provocation("cartesian_velocity_violation", "joint velocity",
                    lambda *at: ramp(2.0, 7, 3000, at[2]) * np.array([1, -1, 0, 1, 0, 1, 0]),
                    np.array([-1.2, -0.69, 0, -1.99, 0, 1.23, HOME[6]]), tool=0.6),
        Provocation("joint_reflex", "cartesian velocity", press, above_floor, thresholds=(5.0, 1000.0)),
        Provocation("cartesian_reflex", "cartesian velocity", press, above_floor, thresholds=(1000.0, 10.0)),
        Provocation("joint_position_motion_generator_start_pose_invalid", "joint position",
                    lambda *at: same(*at) + joint(3, 0.2)),
        Provocation("joint_motion_generator_velocity_limits_violation", "joint velocity",
                    lambda *at: joint(0, ramp(3.0, 7, 3000, at[2]))),
        Provocation("joint_motion_generator_velocity_discontinuity", "joint velocity",
                    lambda *at: joint(0, ramp(3.0, 30, 3000, at[2]))),
        Provocation("joint_motion_generator_acceleration_discontinuity", "joint velocity",
                    lambda *at: jump(at[2], joint(0, 0.009))),
        Provocation("cartesian_position_motion_generator_start_pose_invalid", "cartesian pose",
                    lambda *at: pose(at[0], (0.0, 0.0, 0.1))),
        Provocation("cartesian_motion_generator_elbow_limit_violation", "cartesian pose", holding_pose,
                    elbow=elbow(shift=3.2, at=5)),
        Provocation("cartesian_motion_generator_velocity_limits_violation", "cartesian velocity",
                    lambda *at: twist(5, ramp(3.0, 7, 3000, at[2]))),
        Provocation("cartesian_motion_generator_velocity_discontinuity", "cartesian velocity",
                    lambda *at: jump(at[2], twist(2, 0.03))),
        Provocation("cartesian_motion_generator_acceleration_discontinuity", "cartesian velocity",
                    lambda *at: jump(at[2], twist(2, 0.008))),
        Provocation("cartesian_motion_generator_elbow_sign_inconsistent", "cartesian pose", holding_pose,
                    elbow=elbow(sign=-1, at=5)),
        Provocation("cartesian_motion_generator_start_elbow_invalid", "cartesian pose", holding_pose,
                    elbow=elbow(shift=0.2)),
        Provocation("communication_constraints_violation", "joint position", same, silence=12.0),
        Provocation("power_limit_violation", "torque",
                    TorqueRamp(lambda *_: np.array([87.0, 87, 0, 87, 0, 0, 0])),
                    np.array([-1.5, -1, 0, -2.2, 0, 1.6, HOME[6]])),
        Provocation("cartesian_motion_generator_joint_velocity_limits_violation", "cartesian velocity",
                    lambda *at: twist(1, ramp(1.2, 1, 200, at[2])), HOME + joint(0, -0.8)),
        Provocation("cartesian_motion_generator_joint_velocity_discontinuity", "cartesian velocity",
                    lambda *at: twist(2, ramp(0.8, 8, 500, at[2]))),
        Provocation("cartesian_motion_generator_joint_acceleration_discontinuity", "cartesian velocity",
                    lambda *at: jump(at[2], twist(2, 0.004))),
        Provocation("cartesian_position_motion_generator_invalid_frame", "cartesian pose",
                    lambda *at: pose(at[0], mirrored=at[2] >= 5)),
        Provocation("controller_torque_discontinuity", "torque", lambda *at: jump(at[2], joint(3, 2.0))),
        Provocation("tau_j_range_violation", "torque",
                    TorqueRamp(lambda state, _: velocity_law(state, joint(1, -4.0))), stretched),
        # The last: from there no client recovers without somebody who guides the arm back.
        Provocation("joint_position_limits_violation", "torque",
                    TorqueRamp(lambda state, _: velocity_law(state, joint(6, 0.2))), near_end),
    ]  # fmt: skip
    # FR3's systems from 5.7.2 on have one name for all joints out of range; and its velocity envelope closes before.
    fer_only = [
        Provocation("joint_motion_generator_position_limits_violation", "joint position",
                    lambda *at: same(*at) + jump(at[2], joint(0, 4.0))),
        Provocation("cartesian_motion_generator_joint_position_limits_violation", "cartesian velocity",
                    lambda *at: twist(5, ramp(0.2, 1, 500, at[2])), near_start),
    ]  # fmt: skip
    return (fer_only if robot == "fer" else []) + all_arms


def frame(z: float) -> list[float]:
    """A shift along z, column-major (16,)"""
    return [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, z, 1.0]


def way(start: np.ndarray, goal: np.ndarray) -> Iterator[np.ndarray]:
    """Joint positions from rest to rest, cycle by cycle."""
    cycles = max(int(np.abs(goal - start).max() * 3000), 100)
    for cycle in range(1, cycles + 50):
        s = min(cycle / cycles, 1.0)
        yield start + s**3 * (10 - 15 * s + 6 * s**2) * (goal - start)


def run(robot: str, provoke: Callable[[Provocation], str], recover: Callable[[], None]) -> None:
    """Try each; one line `error <tab> OK, FAIL or can't <tab> why`. `provoke` tells what the client has been told.

    It raises NotImplementedError where the client has no way to send such a command. A computer that holds a client up
    for longer than the arm waits makes another error of it: there are more attempts.
    """
    for provocation in provocations(robot):
        for _ in range(ATTEMPTS):
            try:
                recover()
                told = provoke(provocation)
                verdict, why = ("OK", told) if provocation.error in told else ("FAIL", f"it was told: {told}")
            except NotImplementedError as error:
                verdict, why = "can't", str(error)
            except Exception as error:  # noqa: BLE001 - whatever a peer throws is a result
                verdict, why = "FAIL", f"{type(error).__name__}: {error}"
            if verdict != "FAIL" or not was_late(why):
                break
        print(provocation.error, verdict, " ".join(why.split()), sep="\t", flush=True)
    sys.exit(0)
