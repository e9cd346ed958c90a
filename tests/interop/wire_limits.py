"""What leaves for the arm against the arm's documented limits, computed from recorded datagrams alone.

Derivatives are backward differences over the cycle of 1 ms, the first ones against q_d, dq_d, ddq_d (of a pose:
O_T_EE_c, O_dP_EE_c, O_ddP_EE_c; of torques: tau_J_d) of the state that the first command answers. Figures: Franka's
documentation, "Robot and interface specifications".
"""

import csv
import dataclasses
import functools
from pathlib import Path

import numpy as np

LAYOUTS = Path(__file__).resolve().parents[1] / "wire" / "data"

TICK = 1e-3  # s
MOVE = 2  # robot_mode
JOINT_POSITION, JOINT_VELOCITY, CARTESIAN_POSE, CARTESIAN_VELOCITY = range(1, 5)  # motion_generator_mode
EXTERNAL = 2  # controller_mode
FLOAT_STATES = 10  # version from which states are float32
# What a state of float32 takes from positions, and doubles from differences; rad or m.
FLOAT_ROUNDING, DOUBLE_ROUNDING = 2.0**-23, 1e-12


@dataclasses.dataclass(frozen=True)
class Limits:
    """rad, m, s, N m."""

    q: np.ndarray  # (2, 7) least and greatest
    dq: np.ndarray
    ddq: np.ndarray
    dddq: np.ndarray
    translation: tuple[float, float, float]  # velocity, acceleration, jerk
    rotation: tuple[float, float, float]
    # |dq| towards an end of the range: max(0, sqrt(2 deceleration distance) - offset); None: no such envelope
    deceleration: np.ndarray | None = None
    offset: np.ndarray | None = None

    def dq_towards(self, end: int, q: np.ndarray) -> np.ndarray:
        """Greatest speed at q towards the lower (0) or upper (1) end."""
        if self.deceleration is None:
            return np.broadcast_to(self.dq, q.shape)
        distance = np.maximum(self.q[1] - q if end else q - self.q[0], 0)
        return np.clip(np.sqrt(2 * self.deceleration * distance) - self.offset, 0, self.dq)


TAU = np.array([87.0] * 4 + [12.0] * 3)
DTAU = 1000.0
LIMITS = {
    "fer": Limits(
        q=np.array(
            [
                [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973],
                [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973],
            ]
        ),
        dq=np.array([2.175] * 4 + [2.61] * 3),
        ddq=np.array([15, 7.5, 10, 12.5, 15, 20, 20]),
        dddq=np.array([7500.0, 3750, 5000, 6250, 7500, 10000, 10000]),
        translation=(1.7, 13, 6500),
        rotation=(2.5, 25, 12500),
    ),
    "fr3": Limits(  # from system 5.9 on
        q=np.array(
            [
                [-2.9007, -1.8361, -2.9007, -3.0770, -2.8763, 0.4398, -3.0508],
                [2.9007, 1.8361, 2.9007, -0.1169, 2.8763, 4.6216, 3.0508],
            ]
        ),
        dq=np.array([2.62] * 4 + [5.26, 4.18, 5.26]),
        ddq=np.full(7, 10.0),
        dddq=np.full(7, 5000.0),
        translation=(3, 9, 4500),
        rotation=(2.5, 17, 8500),
        deceleration=np.array([6, 2.585, 3.5, 4, 17, 5.5, 17]),
        offset=np.array([0.6599, 0.2517, 0.2, 0.3533, 0.5757, 0.4878, 0.4628]),
    ),
}


NUMBERS = {"double": "<f8", "float": "<f4", "unsigned long": "<u8", "bool": "u1", "enum(u8)": "u1"}


@functools.cache
def layout(struct: str, version: int) -> np.dtype:
    """Return RobotState or RobotCommand as it is on the wire."""
    names, formats, offsets, size = [], [], [], 0
    file = "layout-v10.csv" if version >= FLOAT_STATES else "layout-v5.csv"
    with (LAYOUTS / file).open() as rows:
        for row in csv.DictReader(rows):
            if row["struct"] != f"robot.{struct}":
                continue
            if row["field"] == "(total)":
                size = int(row["offset_bytes"])
                continue
            names.append(row["field"].rsplit(".", 1)[-1])
            count = int(row["count"])
            formats.append(NUMBERS[row["type"]] if count == 1 else (NUMBERS[row["type"]], count))
            offsets.append(int(row["offset_bytes"]))
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})


def parsed(struct: str, version: int, datagrams: list[bytes]) -> np.ndarray:
    """Return datagrams of one kind as records."""
    kind = layout(struct, version)
    return np.frombuffer(b"".join(each[: kind.itemsize] for each in datagrams), kind)


def violations(limits: Limits, version: int, commands: list[bytes], states: list[bytes]) -> tuple[list[str], int]:
    """Judge consecutive commands; return what broke a limit, in words, and how many commands there were to judge."""
    if not commands or not states:
        return [], 0
    command, state = parsed("RobotCommand", version, commands), parsed("RobotState", version, states)
    at = np.searchsorted(state["message_id"], command["message_id"])
    at = np.minimum(at, len(state) - 1)
    answered = state[at]
    judged = (
        (answered["message_id"] == command["message_id"])
        & (answered["robot_mode"] == MOVE)
        & (command["motion_generation_finished"] == 0)
    )
    # A run ends where a cycle has no command or the robot did not take it, as it came late, and where the motion is another.
    same = (np.diff(command["message_id"]) == 1) & judged[1:] & judged[:-1]
    taken = answered["control_command_success_rate"]  # 0 before the first
    same &= (taken[1:] > 0) & (taken[1:] >= taken[:-1])
    for mode in ("motion_generator_mode", "controller_mode"):
        same &= answered[mode][1:] == answered[mode][:-1]
    found: list[str] = []
    starts = np.flatnonzero(np.concatenate([[True], ~same]))
    for begin, end in zip(starts, [*starts[1:], len(command)], strict=True):
        if judged[begin]:
            found += _of_run(limits, version, command[begin:end], answered[begin])
    return found, int(judged.sum())


def _of_run(limits: Limits, version: int, command: np.ndarray, before: np.ndarray) -> list[str]:
    found: list[str] = []
    # States are rounded, so the first three differences from them are.
    rounding = np.full(len(command), DOUBLE_ROUNDING)
    if version >= FLOAT_STATES:
        rounding[:3] = FLOAT_ROUNDING

    def check(what: str, values: np.ndarray, most: np.ndarray | float, slack: np.ndarray | float = 0.0) -> None:
        for k, *joint in np.argwhere(~(values <= most + np.maximum(slack, 1e-9 * np.abs(most)))):
            where = f" of joint {joint[0] + 1}" if joint else ""
            limit = np.broadcast_to(most, values.shape)[(k, *joint)]
            found.append(f"{command['message_id'][k]}: {what}{where} {values[(k, *joint)]:.6g}, limit {limit:.6g}")

    def differences(v: np.ndarray, v_before: np.ndarray, a_before: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a = np.diff(np.vstack([v_before, v]), axis=0) / TICK
        return a, np.diff(np.vstack([a_before, a]), axis=0) / TICK

    generator = before["motion_generator_mode"]
    slack = [(rounding / TICK**n)[:, None] for n in range(4)]
    if generator in (JOINT_POSITION, JOINT_VELOCITY):
        if generator == JOINT_POSITION:
            q = np.vstack([before["q_d"], command["q_c"]])
            v = np.diff(q, axis=0) / TICK
        else:
            v = command["dq_c"]
            q = np.vstack([before["q_d"], before["q_d"] + np.cumsum(v, axis=0) * TICK])
        a, j = differences(v, before["dq_d"], before["ddq_d"])
        beyond = np.maximum(q - limits.q[1], limits.q[0] - q)
        check("position beyond its range", beyond[1:], np.maximum(beyond[:-1], 0), slack[0])
        check("velocity up", v, limits.dq_towards(1, q[:-1]), slack[1])
        check("velocity down", -v, limits.dq_towards(0, q[:-1]), slack[1])
        check("acceleration", np.abs(a), limits.ddq, slack[2])
        check("jerk", np.abs(j), limits.dddq, slack[3])
    elif generator in (CARTESIAN_POSE, CARTESIAN_VELOCITY):
        if generator == CARTESIAN_POSE:
            pose = np.vstack([before["O_T_EE_c"], command["O_T_EE_c"]]).reshape(-1, 4, 4).transpose(0, 2, 1)
            turn = pose[1:, :3, :3] @ pose[:-1, :3, :3].transpose(0, 2, 1)
            v = np.hstack([np.diff(pose[:, :3, 3], axis=0), _rotation_vectors(turn)]) / TICK
        else:
            v = command["O_dP_EE_c"]
        a, j = differences(v, before["O_dP_EE_c"], before["O_ddP_EE_c"])
        for name, part, most in (("translation", slice(3), limits.translation), ("rotation", slice(3, 6), limits.rotation)):
            for n, (what, values) in enumerate((("velocity", v), ("acceleration", a), ("jerk", j))):
                check(f"{what} of {name}", np.linalg.norm(values[:, part], axis=1), most[n], 2 * slack[n + 1][:, 0])
    if before["controller_mode"] == EXTERNAL:
        tau = command["tau_J_d"]
        check("torque", np.abs(tau), TAU)
        check("torque rate", np.abs(np.diff(np.vstack([before["tau_J_d"], tau]), axis=0)) / TICK, DTAU, 4e-3)
    return found


def _rotation_vectors(R: np.ndarray) -> np.ndarray:
    """Of small turns."""
    axis = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    sine = np.linalg.norm(axis, axis=1)
    return axis * (np.arcsin(np.minimum(sine, 1)) / np.where(sine > 0, sine, 1) + (sine == 0))[:, None]
