"""Dynamic movement primitives learned from demonstrations (Ijspeert et al., Dynamical Movement Primitives, 2013).

The laws are those of the server's JointDmp, PoseDmp and QuaternionPoseDmp, which follow what is learned here.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from google.protobuf.message import Message

from frankapy import proto
from frankapy.demonstration import Demonstration, held, read_npz, unpickle, write_npz
from frankapy.dmp_dictionaries import KEYS, checked_fields
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.rigid_transform import RigidTransform
from frankapy.validation import number, numbers, text, vector, whole
from frankapy.writing import write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from frankapy.franka_arm import FrankaArm
    from frankapy.limits import Limits

Kind = Literal["joint", "position", "pose"]
_KINDS = ("joint", "position", "pose")
_ALPHA = 200.0  # so stiff that what is asked of the spring is what it does
_QUAT_ALPHA = 48.0
_STEPS = 2000  # of a rollout: some hundredths of the spring's own time
_SAMPLES = 1000  # of a demonstration that is fitted
_WAYPOINTS = 40  # of a rollout that joints are found for
_FORMAT = "frankapy primitive 1"
Rollout = tuple[np.ndarray, np.ndarray]


@dataclasses.dataclass
class Primitive:
    """A learned motion of joints, of the tool's position, or of its pose.

    It begins where the arm is; `part` makes of it what `fa.run` takes, with another length, goal, or weights of sensors.
    `rms` says how far it is from what it was learned from (rad, or m), `rms_angle` of the orientation (rad).

    Example:
        >>> primitive = dmp.fit(demonstration, "pose")
        >>> primitive.plot(demonstration)
        >>> fa.run(primitive.part(), InternalImpedance())
    """

    kind: Kind
    duration: float  # s
    start: np.ndarray | None  # where the demonstration began: rad (7,), or m (3,); None: wherever the arm is
    mu: np.ndarray
    h: np.ndarray
    weights: np.ndarray  # of each dimension, sensor and basis function
    alpha: float = _ALPHA
    beta: float = _ALPHA / 4
    rms: float = 0.0
    # Of a pose:
    start_orientation: np.ndarray | None = None  # w, x, y, z
    goal_orientation: np.ndarray | None = None
    quat_mu: np.ndarray | None = None
    quat_h: np.ndarray | None = None
    quat_weights: np.ndarray | None = None
    quat_alpha: float = _QUAT_ALPHA
    rms_angle: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in _KINDS:
            raise FrankaArmArgumentError(f"kind is {self.kind!r}: expected one of {', '.join(_KINDS)}")
        dimensions, basis = (7 if self.kind == "joint" else 3), np.size(self.mu)
        sensors = np.shape(self.weights)[1] if np.ndim(self.weights) == 3 else 1
        shapes = {"mu": (basis,), "h": (basis,), "weights": (dimensions, sensors, basis)}
        if self.start is not None:
            shapes["start"] = (dimensions,)
        if self.kind == "pose":
            quat_basis = np.size(np.asarray(self.quat_mu))
            shapes |= {"start_orientation": (4,), "goal_orientation": (4,), "quat_mu": (quat_basis,), "quat_h": (quat_basis,)}
            shapes["quat_weights"] = (3, 1, quat_basis)
        for name, expected in shapes.items():
            if np.shape(getattr(self, name)) != expected:
                raise FrankaArmArgumentError(f"{name} has the shape {np.shape(getattr(self, name))}: expected {expected}")

    @property
    def goal(self) -> np.ndarray:
        """Where it ends when it begins at `start`; rad (7,), or m (3,)."""
        return self._begin(None) + self._rollout(self.weights.sum(axis=1), self.duration)[-1]

    def part(
        self,
        duration: float | None = None,
        start: Any = None,
        goal: Any = None,
        goal_orientation: Any = None,
        sensor_values: Any = None,
        topic: str | None = None,
    ) -> Message:
        """Return the trajectory for `fa.run`.

        Args:
            duration: s; None: as long as it was learned.
            start: where the arm is when it begins, which `goal` is counted from: rad (7,), or m (3,); None: as it was learned.
            goal: where it is to end with `sensor_values`; None: as far from the start as it was learned.
            goal_orientation: w, x, y, z, of a pose; None: as it was learned.
            sensor_values: weights of the sensors, (sensors,) or of each dimension (dimensions, sensors); None: 1.
            topic: over which proto.DmpSensorValues, in the order of `sensor_values` of each dimension (of joints: of the sensors),
                change them while it runs; of at most 8 sensors.

        Raises FrankaArmArgumentError for values that cannot be.
        """
        T = self._length(duration)
        weights = self._weights_to(start, goal, sensor_values)
        values: dict[str, Any] = dict(weights=weights.ravel(), duration=T)
        if sensor_values is not None:
            values["initial_sensor_values"] = self._sensor_values(sensor_values)
        if topic is not None:
            values["topic"] = text("topic", topic, 256)
        if goal_orientation is not None and self.kind != "pose":
            raise FrankaArmArgumentError(f"goal_orientation is for a primitive of a pose: this one is of kind {self.kind!r}")
        spring: dict[str, Any] = dict(tau=0.5 / T, alpha=self.alpha, beta=self.beta, mu=self.mu, h=self.h)
        if self.kind == "joint":
            return proto.JointDmp(**spring, **values)
        if self.kind == "position":
            return proto.PoseDmp(**spring, **values, position_only=True)
        values["position_weights"] = values.pop("weights")
        orientation = self.goal_orientation if goal_orientation is None else vector("goal_orientation", goal_orientation, 4)
        return proto.QuaternionPoseDmp(
            **{f"position_{name}": value for name, value in spring.items()},
            **values,
            quat_alpha=self.quat_alpha,
            quat_beta=self.quat_alpha / 4,
            quat_mu=self.quat_mu,
            quat_h=self.quat_h,
            quat_weights=self.quat_weights.ravel(),  # type: ignore[union-attr]
            goal_quat=orientation,
            goal_quat_time=T,
        )

    def rollout(self, duration: float | None = None, start: Any = None, goal: Any = None, sensor_values: Any = None) -> Rollout:
        """Return times (n,) s and what `part` of the same arguments commands then: rad (n, 7), or m (n, 3)."""
        T = self._length(duration)
        weights = self._weights_to(start, goal, sensor_values)
        y = self._rollout((weights * self._sensors(sensor_values)).sum(axis=1), T)
        return np.linspace(0, T, len(y)), self._begin(start) + y

    def orientations(self, duration: float | None = None, start: Any = None, goal: Any = None) -> np.ndarray:
        """Return the orientations of a pose's rollout; w, x, y, z (n, 4), from `start` to `goal` (None: as learned)."""
        if self.kind != "pose":
            raise FrankaArmArgumentError(f"This is a primitive of {self.kind}: it has no orientation")
        quat_mu, quat_h, learned_start, learned_goal, quat_weights = (
            np.asarray(each) for each in (self.quat_mu, self.quat_h, self.start_orientation, self.goal_orientation, self.quat_weights)
        )
        T = self._length(duration)
        begin = learned_start if start is None else vector("start", start, 4)
        end = learned_goal if goal is None else vector("goal", goal, 4)
        force = lambda t: _gaussians(np.exp(-t / T), quat_mu, quat_h) @ quat_weights[:, 0].T  # noqa: E731
        r = _spring(force, T, self.quat_alpha**2 / 4 / T**2, self.quat_alpha / T, 1 / T**2, _log(_between(begin, end)))
        return _product(_exp(r), end)

    def beyond(
        self,
        fa: FrankaArm,
        duration: float | None = None,
        start: Any = None,
        goal: Any = None,
        goal_orientation: Any = None,
        sensor_values: Any = None,
    ) -> list[str]:
        """Return what of its rollout the connected arm cannot do as it is, a line each; where it is too fast it gets slower.

        The tool's motions are followed by the joints from where the arm is, at its orientation where they have none.
        """
        t, y = self.rollout(duration, start, goal, sensor_values)
        limits = fa.limits
        if self.kind != "joint":
            rows = np.linspace(0, len(y) - 1, _WAYPOINTS).round().astype(int)
            orientations = np.tile(fa.get_pose(False).quaternion, (_WAYPOINTS, 1))
            if self.kind == "pose":
                orientations = self.orientations(duration, goal=goal_orientation)[rows]
            joints = fa.get_joints()
            path: list[np.ndarray] = []
            for position, orientation in zip(y[rows], orientations, strict=True):
                base = RigidTransform(RigidTransform.rotation_from_quaternion(orientation), position, "franka_tool_base", "world")
                try:
                    joints = fa.ik(base * fa.get_tool_base_pose(), near=joints)
                except FrankaArmArgumentError as error:
                    return [f"{t[rows[len(path)]]:.2f} s after its start, at {np.round(position, 3)} m: {error.message}"]
                path.append(joints)
            t, y = t[rows], np.array(path)
        v = np.abs(np.diff(y, axis=0)) / np.diff(t)[:, None]
        lines = []
        for i in range(7):
            least, most = float(y[:, i].min()), float(y[:, i].max())
            if least < limits.q_min[i] or most > limits.q_max[i]:
                lines.append(f"joint {i + 1} goes from {least:.3f} to {most:.3f} rad: it has {limits.q_min[i]:.3f} to {limits.q_max[i]:.3f}")
            if (fastest := float(v[:, i].max())) > limits.dq_max[i]:
                lines.append(f"joint {i + 1} reaches {fastest:.2f} rad/s: its limit is {limits.dq_max[i]:.2f}")
        return lines

    def plot(
        self,
        demonstrations: Demonstration | Sequence[Demonstration] = (),
        goal: Any = None,
        duration: float | None = None,
        sensor_values: Any = None,
        limits: Limits | None = None,
        start: Any = None,
        goal_orientation: Any = None,
    ) -> Figure:
        """Draw what `part` of the same arguments commands over what it was learned from. Needs matplotlib.

        With `limits` (`fa.limits`) the range of joints that come near to it is dashed; of the tool's motions `beyond` tells.
        Orientations are drawn as rotation vectors from where it was learned to end.
        """
        from matplotlib.figure import Figure

        t, y = self.rollout(duration, start, goal, sensor_values)
        names = [f"joint {i + 1} [rad]" for i in range(7)] if self.kind == "joint" else [f"{axis} [m]" for axis in "xyz"]
        if self.kind == "pose":
            y = np.hstack([y, self._turns(self.orientations(duration, goal=goal_orientation))])
            names += [f"about {axis} [rad]" for axis in "xyz"]
        figure = Figure(figsize=(8, 1.6 * len(names) + 1), layout="constrained")
        axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for demonstration in _listed(demonstrations):
            shown = _values(demonstration, self.kind)
            if self.kind == "pose":
                shown = np.hstack([shown, self._turns(np.asarray(demonstration.orientations))])
            for i, axis in enumerate(axes):
                axis.plot(demonstration.times * t[-1] / demonstration.duration, shown[:, i], "0.6", lw=3)
        for i, axis in enumerate(axes):
            axis.plot(t, y[:, i], "C0")
            axis.set_ylabel(names[i])
            if limits is not None and self.kind == "joint":
                axis.autoscale(False)
                for end in (limits.q_min[i], limits.q_max[i]):
                    axis.axhline(end, color="C3", linestyle="--")
        axes[0].set_title(f"{self!r}; grey: demonstrated", fontsize="small")
        axes[-1].set_xlabel("time [s]")
        return figure

    def _turns(self, orientations: np.ndarray) -> np.ndarray:
        """Rotation vectors (n, 3) of orientations from the learned goal."""
        return _unwrapped(_log(_between(orientations, np.asarray(self.goal_orientation))))

    def save(self, path: str | Path) -> list[Path]:
        """Write it as a NumPy archive (.npz), or as the dictionary that old scripts read (.pkl); of a pose two files, NAME-position.pkl
        and NAME-quaternion.pkl, beside which they want `goal_orientation` and `duration`. Return the files.
        """
        path = Path(path)
        if path.suffix == ".pkl":
            import pickle

            parts = {"": self.info} if self.kind != "pose" else {"-position": self.info, "-quaternion": self.quat_info}
            files = [path.with_stem(path.stem + name) for name in parts]
            for file, info in zip(files, parts.values(), strict=True):
                write_file(file, pickle.dumps(info))
            return files
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        write_npz(path, _FORMAT, {name: np.asarray(value) for name, value in fields.items() if value is not None})
        return [path]

    @classmethod
    def load(cls, path: str | Path) -> Primitive:
        """Read what `save` wrote, or a dictionary of old scripts (.pkl) of joints or of a position.

        A dictionary does not say where its motion begins, so that this one begins wherever the arm is. It takes
        1/(2 tau) s. Those of a pose are for fa.execute_pose_dmp and fa.execute_quaternion_pose_dmp: `load_script`
        reads them.
        """
        path = Path(path)
        if path.suffix == ".pkl":
            return cls._of_script(path, load_script(path))
        try:
            data = path.read_bytes()
        except OSError as error:
            raise FrankaArmArgumentError(f"{path} cannot be read: {error.strerror}") from None
        arrays = read_npz(path, data, _FORMAT)
        known = {field.name for field in dataclasses.fields(cls)}
        values: dict[str, Any] = {"start": None}
        values |= {name: value.item() if value.ndim == 0 else value for name, value in arrays.items() if name in known}
        try:
            return cls(**values)
        except TypeError as error:
            raise FrankaArmArgumentError(f"{path} lacks what a primitive has: {error}") from None
        except FrankaArmArgumentError as error:
            raise FrankaArmArgumentError(f"{path} is a broken primitive: {error.message}") from None

    @classmethod
    def _of_script(cls, path: Path, info: dict[str, Any]) -> Primitive:
        size = len(numbers(f"{path}['weights']", info["weights"]))
        basis, sensors = (whole(f"{path}[{key!r}]", info[key]) for key in ("num_basis", "num_sensors"))
        kinds: dict[int, Kind] = {7 * basis * sensors: "joint", 3 * basis * sensors: "position"}
        if not size or size not in kinds:
            raise FrankaArmArgumentError(
                f"{path} has {size} weights: expected 7 (of joints) or 3 (of a position) times num_basis {basis} "
                f"times num_sensors {sensors}; those of 6 are for fa.execute_pose_dmp(dmp.load_script(file), duration)"
            )
        fields = checked_fields(str(path), info, size // (basis * sensors))
        if not fields["tau"] > 0:
            raise FrankaArmArgumentError(f"{path}['tau'] is {fields['tau']:g} 1/s: expected more than 0")
        weights = fields["weights"].reshape(-1, sensors, basis)
        T = 0.5 / fields["tau"]
        return cls(kinds[size], T, None, fields["mu"], fields["h"], weights, fields["alpha"], fields["beta"])

    @property
    def info(self) -> dict[str, Any]:
        """The dictionary that execute_joint_dmp, or for positions execute_pose_dmp(position_only=True), takes."""
        return dict(
            tau=0.5 / self.duration, alpha=self.alpha, beta=self.beta,
            num_basis=len(self.mu), num_sensors=self.weights.shape[1], mu=self.mu.tolist(), h=self.h.tolist(), weights=self.weights,
        )  # fmt: skip

    @property
    def quat_info(self) -> dict[str, Any]:
        """The second dictionary that execute_quaternion_pose_dmp takes, of a pose."""
        if self.quat_mu is None or self.quat_h is None:
            raise FrankaArmArgumentError(f"This is a primitive of {self.kind}: it has no orientation")
        return dict(
            tau=1 / self.duration, alpha=self.quat_alpha, beta=self.quat_alpha / 4, num_basis=len(self.quat_mu), num_sensors=1,
            mu=self.quat_mu.tolist(), h=self.quat_h.tolist(), weights=self.quat_weights,
        )  # fmt: skip

    def __repr__(self) -> str:
        error = f"{self.rms:.4f} rad" if self.kind == "joint" else f"{1e3 * self.rms:.2f} mm"
        if self.kind == "pose":
            error += f" and {math.degrees(self.rms_angle):.2f} degrees"
        return f"Primitive of {self.kind}, {self.duration:.2f} s, {len(self.mu)} basis functions, {error} from what it learned"

    # --- inside -------------------------------------------------------------------------------------------------------

    def _rollout(self, weights: np.ndarray, duration: float) -> np.ndarray:
        """Positions at even steps from rest at 0; `weights` (dimensions, basis)."""
        tau = 0.5 / duration
        stiffness = self.alpha * self.beta * tau**2
        force = lambda t: _features(t, tau, self.mu, self.h) @ weights.T  # noqa: E731
        return _spring(force, duration, stiffness, self.alpha * tau, stiffness, np.zeros(len(weights)))

    def _weights_to(self, start: Any, goal: Any, sensor_values: Any) -> np.ndarray:
        """The weights with which a rollout from `start` ends at `goal`."""
        if goal is None:
            return self.weights
        begin, end = self._begin(start), vector("goal", goal, len(self.weights))
        sensors = self._sensors(sensor_values)
        total = sensors[:, :, 0].sum(axis=1)
        if np.any(np.abs(total) < 1e-6):
            raise FrankaArmArgumentError(f"sensor_values are {sensor_values}, of a sum of 0: a goal cannot be reached with them")
        # The first basis function alone leads from the start to the goal; how far by its end, the spring tells.
        first = np.zeros((1, len(self.mu)))
        first[0, 0] = 1
        reached = self._rollout(first, self.duration)[-1, 0]
        missing = end - begin - self._rollout((self.weights * sensors).sum(axis=1), self.duration)[-1]
        weights = self.weights.copy()
        weights[:, :, 0] += (missing / reached / total)[:, None]
        return weights

    def _length(self, duration: Any) -> float:
        """How long it takes, s; None: as it was learned."""
        T = self.duration if duration is None else number("duration", duration)
        if not 0.01 <= T <= 120:
            raise FrankaArmArgumentError(f"duration is {T:g} s: expected 0.01 to 120 s")
        return T

    def _begin(self, start: Any) -> np.ndarray:
        """Where it begins: at `start`; None: where it was learned."""
        if start is not None:
            return vector("start", start, len(self.weights))
        if self.start is None:
            raise FrankaArmArgumentError("start is missing: this primitive does not say where it was learned")
        return self.start

    def _sensors(self, values: Any) -> np.ndarray:
        """By what the weights of each dimension and sensor count, (dimensions, sensors, 1)."""
        shape = self.weights.shape[:2]
        sensors = np.ones(shape) if values is None else self._sensor_values(values).reshape(-1, shape[1])
        return np.broadcast_to(sensors, shape)[:, :, None]

    def _sensor_values(self, values: Any) -> np.ndarray:
        sensors, dimensions = self.weights.shape[1], self.weights.shape[0]
        array = numbers("sensor_values", values).reshape(np.shape(values))
        expected = [(sensors,)] if self.kind == "joint" else [(sensors,), (dimensions, sensors)]
        if array.shape not in expected:
            raise FrankaArmArgumentError(f"sensor_values has the shape {array.shape}: expected {' or '.join(map(str, expected))}")
        return array if self.kind == "joint" else np.broadcast_to(array, (dimensions, sensors)).ravel()


def fit(
    demonstrations: Demonstration | Sequence[Demonstration],
    kind: Kind = "joint",
    basis: int = 25,
    method: Literal["ridge", "local"] = "ridge",
    ridge: float = 1e-8,
    sensor_values: Any = None,
) -> Primitive:
    """Learn a primitive from a demonstration, or from several of one motion.

    Args:
        demonstrations: several may begin and end at different places and take different times; what they have in common is
            learned, as long as their mean and towards their mean goal. With `sensor_values`, what they differ by.
        kind: "joint", "position" (of the tool), or "pose" (position, and orientation by its rotation vector from the goal).
        basis: functions, 2 to 100.
        method: "ridge": least squares over all weights at once, with `ridge` against large ones. "local": each weight by
            itself from where its function is large (locally weighted regression), with which few of them matter less.
        ridge: share of the mean square of the basis functions.
        sensor_values: of each demonstration the values of the sensors in it, (demonstrations, sensors): each sensor has
            weights of its own then, with which the values of a demonstration give that one, as near as may be. As many
            demonstrations as sensors are needed, and none a mixture of others. Of a pose sensors lead the position.
            None: one sensor, which is 1.

    Raises FrankaArmArgumentError where a demonstration lacks what the kind needs, or turns by more than 180 degrees from its goal.
    """
    listed = _listed(demonstrations)
    if kind not in _KINDS:
        raise FrankaArmArgumentError(f"kind is {kind!r}: expected one of {', '.join(_KINDS)}")
    if not listed:
        raise FrankaArmArgumentError("There is no demonstration to learn from.")
    if not isinstance(basis, (int, np.integer)) or not 2 <= basis <= 100:
        raise FrankaArmArgumentError(f"basis is {basis!r}: expected 2 to 100")
    if method not in ("ridge", "local"):
        raise FrankaArmArgumentError(f"method is {method!r}: expected 'ridge' or 'local'")
    if not ridge >= 0:
        raise FrankaArmArgumentError(f"ridge is {ridge!r}: expected at least 0")
    values = np.ones((len(listed), 1)) if sensor_values is None else _sensor_rows(sensor_values, len(listed))
    T = float(np.mean([each.duration for each in listed]))
    even = [each.resampled(_SAMPLES) for each in listed]
    t = np.linspace(0, T, _SAMPLES)
    step, tau = t[1], 0.5 / T

    mu, h = _centres(np.exp(-0.5 * np.arange(basis) / (basis - 1)))
    stiffness, damping = _ALPHA**2 / 4 * tau**2, _ALPHA * tau
    ways = [_values(each, kind) - _values(each, kind)[0] for each in even]
    forces = [y + (_rate(_rate(y, step), step) + damping * _rate(y, step)) / stiffness for y in ways]
    # Learning is linear in the force: what the sensors weigh is mixed of what each demonstration does.
    features = _features(t, tau, mu, h)
    mixed = np.tensordot(np.linalg.pinv(values), forces, 1)  # (sensors, n, dimensions)
    weights = np.stack([_solve(features, force, method, ridge, first=True) for force in mixed], axis=1)
    start = np.mean([_values(each, kind)[0] for each in even], axis=0)
    orientation = _learn_orientation(even, t, basis, method, ridge) if kind == "pose" else {}
    primitive = Primitive(kind, T, start, mu, h, weights, **orientation)
    if kind == "pose":
        primitive.rms_angle = _rms_angle(primitive, even)
    errors = []
    for way, row in zip(ways, values, strict=True):
        times, rollout = primitive.rollout(sensor_values=row)
        errors.append(np.column_stack([np.interp(t, times, column) for column in rollout.T]) - start - way)
    primitive.rms = float(np.sqrt(np.mean(np.sum(np.square(errors), axis=-1))))
    return primitive


def _sensor_rows(values: Any, demonstrations: int) -> np.ndarray:
    array = numbers("sensor_values", values).reshape(np.shape(values))
    if array.ndim != 2 or len(array) != demonstrations or not array.size:
        raise FrankaArmArgumentError(
            f"sensor_values has the shape {array.shape}: expected ({demonstrations}, sensors), a row each"
        )
    if (rank := int(np.linalg.matrix_rank(array))) < array.shape[1]:
        raise FrankaArmArgumentError(
            f"sensor_values tell {rank} of {array.shape[1]} sensors apart: expected as many demonstrations as sensors, none a "
            "mixture of others"
        )
    return array


def load_script(path: str | Path) -> dict[str, Any]:
    """Return the dictionary of a pickle that old scripts use, without running code in it.

    Raises FrankaArmArgumentError where it is broken, or of another layout, which is named.
    """
    path = Path(path)
    try:
        data = unpickle(path, path.read_bytes())
    except OSError as error:
        raise FrankaArmArgumentError(f"{path} cannot be read: {error.strerror}") from None
    if not isinstance(data, dict) or not set(KEYS) <= data.keys():
        raise FrankaArmArgumentError(f"{path} holds {held(data)}: expected a dictionary with {', '.join(KEYS)}")
    return data


# --- the laws --------------------------------------------------------------------------------------------------------


def _features(t: np.ndarray, tau: float, mu: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Basis functions of JointDmp and PoseDmp, (n, basis)."""
    x = np.exp(-tau * np.asarray(t))
    u = np.minimum(2 * tau * np.asarray(t), 1.0)
    functions = _gaussians(x, mu[1:], h[1:])
    return np.concatenate([(u**3 * (10 - 15 * u + 6 * u**2))[..., None], functions], axis=-1)


def _gaussians(x: Any, mu: np.ndarray, h: np.ndarray) -> np.ndarray:
    psi = np.exp(-h * (np.asarray(x)[..., None] - mu) ** 2)
    return psi * np.asarray(x)[..., None] / (1e-8 + psi.sum(axis=-1, keepdims=True))


def _spring(
    force: Any, duration: float, stiffness: float, damping: float, gain: float, start: np.ndarray
) -> np.ndarray:
    """Positions (_STEPS + 1, n) of y'' = -stiffness y - damping y' + gain f(t) from rest at `start`; Runge-Kutta of order 4."""
    h = duration / _STEPS
    f = gain * force(np.linspace(0, duration, 2 * _STEPS + 1))
    y, v = np.array(start, dtype=float), np.zeros(len(start))
    ys = np.empty((_STEPS + 1, len(y)))
    ys[0] = y
    # The spring is linear: a step is a matrix, the same for all.
    A = np.array([[0, 1], [-stiffness, -damping]])
    B = np.array([0, 1.0])
    Ah = A * h
    step = np.eye(2) + Ah + Ah @ Ah / 2 + Ah @ Ah @ Ah / 6 + Ah @ Ah @ Ah @ Ah / 24
    now = h / 6 * (np.eye(2) + Ah + Ah @ Ah / 2 + Ah @ Ah @ Ah / 4) @ B
    middle = h / 6 * (4 * np.eye(2) + 2 * Ah + Ah @ Ah / 2) @ B
    after = h / 6 * B
    state = np.stack([y, v])
    driven = now[:, None] * f[:-1:2, None, :] + middle[:, None] * f[1::2, None, :] + after[:, None] * f[2::2, None, :]
    for k in range(_STEPS):
        state = step @ state + driven[k]
        ys[k + 1] = state[0]
    return ys


def _centres(mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres and widths of which neighbours overlap."""
    width = np.diff(mu)
    return mu, 0.5 / (0.65 * np.append(width, width[-1])) ** 2


def _solve(features: np.ndarray, force: np.ndarray, method: str, ridge: float, first: bool) -> np.ndarray:
    """Weights (dimensions, basis) with which the features give a force (n, dimensions)."""
    if method == "ridge":
        gram = features.T @ features
        gram += ridge * np.trace(gram) / len(gram) * np.eye(len(gram))
        return np.linalg.solve(gram, features.T @ force).T
    weights = np.zeros((features.shape[1], force.shape[1]))
    if first:  # it alone spans all of the time
        weights[0] = force[-1]
        force = force - np.outer(features[:, 0], weights[0])
    for k in range(int(first), features.shape[1]):
        phi = features[:, k]
        total = features[:, int(first) :].sum(axis=1)
        near = phi / np.maximum(total, 1e-12)
        weights[k] = (near * total) @ force / max((near * total) @ total, 1e-12)
    return weights.T


def _learn_orientation(even: Sequence[Demonstration], t: np.ndarray, basis: int, method: str, ridge: float) -> dict[str, Any]:
    """The fields of a primitive that are of its orientation."""
    T, step = float(t[-1]), t[1]
    mu, h = _centres(np.exp(-np.arange(basis) / (basis - 1)))
    stiffness, damping = _QUAT_ALPHA**2 / 4 / T**2, _QUAT_ALPHA / T
    shown = [np.asarray(each.orientations) for each in even]
    turns = [_unwrapped(_log(_between(each, each[-1]))) for each in shown]
    for r in turns:
        if (turn := float(np.linalg.norm(r[0]))) > math.pi:
            raise FrankaArmArgumentError(
                f"A demonstration turns by {math.degrees(turn):.0f} degrees from its goal: expected at most 180, beyond which the other way "
                "round is the shorter one. cut() it in two, or learn joints"
            )
    forces = [T**2 * (_rate(_rate(r, step), step) + damping * _rate(r, step) + stiffness * r) for r in turns]
    weights = _solve(_gaussians(np.exp(-t / T), mu, h), np.mean(forces, axis=0), method, ridge, first=False)
    goal = _product(_exp(np.mean([_log(_between(each[-1], shown[0][-1])) for each in shown], axis=0)), shown[0][-1])
    return dict(
        start_orientation=_product(_exp(np.mean([r[0] for r in turns], axis=0)), goal), goal_orientation=goal,
        quat_mu=mu, quat_h=h, quat_weights=weights[:, None, :],
    )  # fmt: skip


def _rms_angle(primitive: Primitive, even: Sequence[Demonstration]) -> float:
    """How far its orientations are from those of demonstrations, each counted from its start; rad."""
    made = primitive.orientations()
    made = _between(made, made[0])
    errors = []
    for each in even:
        shown = np.asarray(each.resampled(len(made)).orientations)
        cosines = np.abs(np.sum(made * _between(shown, shown[0]), axis=1))
        errors.append(2 * np.arccos(np.minimum(cosines, 1)))
    return float(np.sqrt(np.mean(np.square(errors))))


def _rate(values: np.ndarray, step: float) -> np.ndarray:
    return np.gradient(values, step, axis=0)


def _listed(demonstrations: Demonstration | Sequence[Demonstration]) -> list[Demonstration]:
    return [demonstrations] if isinstance(demonstrations, Demonstration) else list(demonstrations)


def _values(demonstration: Demonstration, kind: str) -> np.ndarray:
    values = demonstration.joints if kind == "joint" else demonstration.positions
    if values is None or (kind == "pose" and demonstration.orientations is None):
        raise FrankaArmArgumentError(f"{demonstration!r} lacks what a primitive of {kind} is learned from")
    return values


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of quaternions w, x, y, z, (..., 4)."""
    w, v, s, u = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    return np.concatenate([w * s - np.sum(v * u, axis=-1, keepdims=True), w * u + s * v + np.cross(v, u)], axis=-1)


def _between(q: np.ndarray, end: np.ndarray) -> np.ndarray:
    """What turns `end` into q."""
    return _product(q, end * [1, -1, -1, -1])


def _log(q: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3) of quaternions, up to half a turn."""
    q = q * np.where(q[..., :1] < 0, -1, 1)
    length = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(length, q[..., :1])
    return q[..., 1:] * np.where(length > 1e-12, angle / np.maximum(length, 1e-12), 2)


def _exp(r: np.ndarray) -> np.ndarray:
    """Quaternions of rotation vectors (..., 3)."""
    half = np.linalg.norm(r, axis=-1, keepdims=True) / 2
    return np.concatenate([np.cos(half), 0.5 * r * np.sinc(half / np.pi)], axis=-1)


def _unwrapped(r: np.ndarray) -> np.ndarray:
    """Rotation vectors of which none jumps by a whole turn; the last is 0."""
    out = r.copy()
    for i in range(len(r) - 2, -1, -1):
        angle = np.linalg.norm(r[i])
        if angle > 1e-9:
            axis = r[i] / angle
            turns = round(float((out[i + 1] @ axis - angle) / (2 * np.pi)))
            out[i] = r[i] + 2 * np.pi * turns * axis
    return out
