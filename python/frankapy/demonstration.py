"""Demonstrations: what a person's hand did to the arm, made ready to be learned from."""

from __future__ import annotations

import dataclasses
import io
import logging
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from frankapy.dmp_dictionaries import KEYS
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.rigid_transform import RigidTransform
from frankapy.validation import whole
from frankapy.writing import write_file

if TYPE_CHECKING:
    from frankapy.recording import Recording

logger = logging.getLogger("frankapy")

_RATE = 100.0  # Hz, of the poses in lists of scripts, which have no times
_LONGEST_GAP = 0.5  # s between samples, which nothing is known of
_FASTEST = 3.0  # m/s: no arm does that
_FASTEST_JOINT = 10.0  # rad/s; some joints of an FR3 reach 5.26
_FASTEST_TURN = 10.0  # rad/s
_REST_JOINT, _REST = 0.02, 0.005  # rad/s and m/s, below which nobody moves the arm
_MARGIN = 0.1  # s of rest that a segment keeps at both ends
_FORMAT = "frankapy demonstration 1"
_ARCHIVE = b"PK"  # begins one, whatever its name


@dataclasses.dataclass
class Demonstration:
    """A motion: `times` (n,) s from 0, with `joints` (n, 7) rad, or `positions` (n, 3) m and `orientations` (n, 4) unit
    quaternions w, x, y, z of the end effector in the base, or all of these.

    Raises FrankaArmArgumentError for fewer than two samples, times that do not increase, gaps over 0.5 s, jumps that no arm
    makes, and what is not finite.

    Example:
        >>> demonstration = fa.demonstrate(20).trimmed().smooth()
        >>> demonstration.save("pour.npz")
    """

    times: np.ndarray
    joints: np.ndarray | None = None
    positions: np.ndarray | None = None
    orientations: np.ndarray | None = None

    def __post_init__(self) -> None:
        self.times = _array("times", self.times, 1)
        if len(self.times) < 2:
            raise FrankaArmArgumentError(f"A demonstration has {len(self.times)} samples: expected at least 2")
        steps = np.diff(self.times)
        if np.any(steps <= 0):
            i = int(np.argmax(steps <= 0))
            raise FrankaArmArgumentError(f"times[{i + 1}] is {self.times[i + 1]:g} s after {self.times[i]:g} s: expected later")
        if np.any(steps > _LONGEST_GAP):
            i = int(np.argmax(steps))
            raise FrankaArmArgumentError(
                f"There is a gap of {steps[i]:.2f} s at {self.times[i]:.2f} s: expected samples at least each {_LONGEST_GAP} s. Give "
                "what is before it, or behind it"
            )
        self.times = self.times - self.times[0]
        if self.joints is None and self.positions is None:
            raise FrankaArmArgumentError("A demonstration has neither joints nor positions: expected one of them")
        for name, width, fastest, unit in (
            ("joints", 7, _FASTEST_JOINT, "rad"),
            ("positions", 3, _FASTEST, "m"),
            ("orientations", 4, np.inf, ""),
        ):
            if (values := getattr(self, name)) is None:
                continue
            values = _array(name, values, 2)
            if values.shape != (len(self.times), width):
                raise FrankaArmArgumentError(f"{name} has the shape {values.shape}: expected ({len(self.times)}, {width}), as times")
            speed = np.abs(np.diff(values, axis=0)).max(axis=1) / steps
            if np.any(speed > fastest):
                i = int(np.argmax(speed))
                raise FrankaArmArgumentError(
                    f"{name} jump by {np.abs(values[i + 1] - values[i]).max():.3f} {unit} in {steps[i]:.4f} s at {self.times[i]:.2f} s: "
                    "no arm does that"
                )
            setattr(self, name, values)
        if self.orientations is not None:
            if self.positions is None:
                raise FrankaArmArgumentError("A demonstration has orientations without positions: expected both")
            norms = np.linalg.norm(self.orientations, axis=1)
            if np.any(np.abs(norms - 1) > 0.05):
                raise FrankaArmArgumentError(f"orientations have norms of {norms.min():.3f} to {norms.max():.3f}: expected 1")
            signs = np.cumprod(np.where(np.sum(self.orientations[1:] * self.orientations[:-1], axis=1) < 0, -1, 1))
            self.orientations = self.orientations / norms[:, None]
            self.orientations[1:] *= signs[:, None]  # q and -q are one orientation
            turns = 2 * np.arccos(np.minimum(np.sum(self.orientations[1:] * self.orientations[:-1], axis=1), 1))
            if np.any(turns > _FASTEST_TURN * steps):
                i = int(np.argmax(turns / steps))
                raise FrankaArmArgumentError(
                    f"orientations turn by {turns[i]:.3f} rad in {steps[i]:.4f} s at {self.times[i]:.2f} s: no arm does that"
                )

    # --- from somewhere -----------------------------------------------------------------------------------------------

    @classmethod
    def from_recording(cls, recording: Recording, skill_id: int | None = None) -> Demonstration:
        """Take the states of one skill of a recording; None: of the last one."""
        states = recording.states
        ids = states.get("skill_id", np.zeros(0))
        wanted = skill_id if skill_id is not None else (ids[ids != 0][-1] if np.any(ids != 0) else None)
        rows = ids == wanted
        if wanted is None or not rows.any():
            raise FrankaArmArgumentError(f"{recording.path} has no states of {'a skill' if wanted is None else f'skill {wanted}'}")
        return cls.of_states(states["message_id"][rows] * 1e-3, states["q"][rows], states["O_T_EE"][rows])

    @classmethod
    def of_states(cls, times: np.ndarray, joints: np.ndarray, O_T_EE: np.ndarray) -> Demonstration:
        """Make one of the states of an arm: times (n,) s, q (n, 7), O_T_EE (n, 16) column by column.

        Of times with a gap the longest part without one, with a warning.
        """
        part = _longest_part(times)
        poses = np.asarray(O_T_EE, dtype=float).reshape(-1, 4, 4).transpose(0, 2, 1)[part]
        return cls(times[part], joints[part], poses[:, :3, 3], _quaternions(poses[:, :3, :3]))

    @classmethod
    def load(cls, path: str | Path) -> Demonstration:
        """Read what `save` wrote, a recording (.mcap), or a pickle of frankapy's scripts (.pkl): a list of poses at 100 Hz, or the
        dictionary of record_trajectory.py. Nothing in a pickle is run.
        """
        path = Path(path)
        try:
            data = path.read_bytes()
        except OSError as error:
            raise FrankaArmArgumentError(f"{path} cannot be read: {error.strerror}") from None
        if path.suffix == ".mcap" and not data.startswith(_ARCHIVE):
            from frankapy.recording import Recording

            return cls.from_recording(Recording(path))
        if path.suffix == ".npz" or data.startswith(_ARCHIVE):
            fields = {field.name for field in dataclasses.fields(cls)}
            return cls(**{name: value for name, value in read_npz(path, data, _FORMAT).items() if name in fields})
        return cls._of_script(path, unpickle(path, data))

    @classmethod
    def _of_script(cls, path: Path, data: Any) -> Demonstration:
        try:
            if isinstance(data, list) and data and all(isinstance(pose, _PickledPose) for pose in data):
                poses = np.array([pose.matrix for pose in data])
                return cls(np.arange(len(poses)) / _RATE, None, poses[:, :3, 3], _quaternions(poses[:, :3, :3]))
            if _is_recorded(data):
                states = next(iter(data.values()))["skill_state_dict"]
                poses = np.asarray(states["O_T_EE"], dtype=float).reshape(-1, 4, 4)
                return cls(states["time_since_skill_started"], states["q"], poses[:, :3, 3], _quaternions(poses[:, :3, :3]))
        except KeyError as error:
            raise FrankaArmArgumentError(
                f"{path} has no {error} in its skill_state_dict: expected q, O_T_EE, time_since_skill_started"
            ) from None
        except (AttributeError, IndexError, TypeError, ValueError) as error:
            raise FrankaArmArgumentError(f"{path} holds no motion of an arm: {error}") from None
        raise FrankaArmArgumentError(
            f"{path} holds {held(data)}: expected a list of poses, or what record_trajectory.py writes (a dictionary with "
            "skill_state_dict, in it q, O_T_EE and time_since_skill_started)"
        )

    def save(self, path: str | Path) -> None:
        """Write it as a NumPy archive (.npz). Raises FrankaArmArgumentError where the file cannot be written."""
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        write_npz(path, _FORMAT, {name: value for name, value in fields.items() if value is not None})

    # --- made ready ---------------------------------------------------------------------------------------------------

    @property
    def duration(self) -> float:
        """Its length, s."""
        return float(self.times[-1])

    def __len__(self) -> int:
        return len(self.times)

    def cut(self, begin: float, end: float) -> Demonstration:
        """Return what is between two times, s."""
        rows = np.flatnonzero((self.times >= begin) & (self.times <= end))
        if len(rows) < 2:
            raise FrankaArmArgumentError(f"{len(rows)} samples of {len(self)} are there: expected at least 2")
        return self._with(self.times[rows], lambda values: values[rows])

    def segments(self, least: float = 0.5) -> list[Demonstration]:
        """Return the parts in which the arm was moved, between rests of at least `least` (s), with a little of the rests."""
        moves = self._moves()
        edges = np.flatnonzero(np.diff(np.concatenate([[0], moves.astype(int), [0]])))
        parts = [(self.times[begin], self.times[end - 1]) for begin, end in edges.reshape(-1, 2)]
        joined: list[tuple[float, float]] = []
        for begin, end in parts:
            if joined and begin - joined[-1][1] < least:
                joined[-1] = joined[-1][0], end
            else:
                joined.append((begin, end))
        return [self.cut(begin - _MARGIN, end + _MARGIN) for begin, end in joined if end - begin > _MARGIN]

    def trimmed(self) -> Demonstration:
        """Return it without the rest before its first motion and after its last."""
        parts = self.segments(least=np.inf)
        if not parts:
            raise FrankaArmArgumentError(f"In this demonstration of {self.duration:.1f} s nothing moves")
        return parts[0]

    def smooth(self, width: float = 0.05) -> Demonstration:
        """Return it with what is quicker than about `width` (s) taken away: averaged with a Gaussian of that deviation."""
        if not 0 < width < self.duration:
            raise FrankaArmArgumentError(f"width is {width:g} s: expected more than 0 and less than the {self.duration:g} s of it")
        even = self.resampled(max(2, round(self.duration / min(width / 5, float(np.median(np.diff(self.times)))))) + 1)
        step = even.times[1]
        reach = int(np.ceil(4 * width / step))
        kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * step / width) ** 2)

        def average(values: np.ndarray) -> np.ndarray:
            # Mirrored about its ends, so that these stay.
            reach_in = min(reach, len(values) - 1)
            before = 2 * values[0] - values[reach_in:0:-1]
            after = 2 * values[-1] - values[-2 : -reach_in - 2 : -1]
            padded = np.concatenate([before, values, after])
            used = kernel[reach - reach_in : reach + reach_in + 1]
            return np.column_stack([np.convolve(column, used / used.sum(), mode="valid") for column in padded.T])

        return even._with(even.times, average)

    def resampled(self, samples: int) -> Demonstration:
        """Return it at so many even times."""
        times = np.linspace(0, self.duration, whole("samples", samples))
        return self._with(times, lambda values: np.column_stack([np.interp(times, self.times, column) for column in values.T]))

    def _with(self, times: np.ndarray, make: Callable[[np.ndarray], np.ndarray]) -> Demonstration:
        """Return one with what `make` makes of joints, positions and orientations, as far as they are there."""
        joints, positions, orientations = (
            None if values is None else make(values) for values in (self.joints, self.positions, self.orientations)
        )
        if orientations is not None:
            orientations = orientations / np.linalg.norm(orientations, axis=1, keepdims=True)
        return Demonstration(times, joints, positions, orientations)

    def _moves(self) -> np.ndarray:
        """Whether it moves at each sample, judged over 0.1 s."""
        span = max(1, int(np.searchsorted(self.times, 0.1)))
        late, early = np.minimum(np.arange(len(self)) + span, len(self) - 1), np.maximum(np.arange(len(self)) - span, 0)
        time = self.times[late] - self.times[early]
        moves = np.zeros(len(self), dtype=bool)
        for values, rest in ((self.joints, _REST_JOINT), (self.positions, _REST)):
            if values is not None:
                moves |= np.abs(values[late] - values[early]).max(axis=1) / time > rest
        return moves

    def __repr__(self) -> str:
        parts = [name for name in ("joints", "positions", "orientations") if getattr(self, name) is not None]
        return f"Demonstration({self.duration:.2f} s, {len(self)} samples of {', '.join(parts)})"


# --- files -----------------------------------------------------------------------------------------------------------


def write_npz(path: str | Path, kind: str, arrays: dict[str, Any]) -> None:
    """Write arrays into a NumPy archive that says what it is; raises as `write_file`."""
    archive = io.BytesIO()
    np.savez_compressed(archive, format=np.array(kind), **arrays)
    write_file(path, archive.getvalue())


def read_npz(path: Path, data: bytes, kind: str) -> dict[str, Any]:
    """Return the arrays of such an archive; raises FrankaArmArgumentError where it is another."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, OSError, EOFError, KeyError, pickle.UnpicklingError) as error:
        raise FrankaArmArgumentError(f"{path} is no NumPy archive: {error}") from None
    except Exception as error:  # zipfile's own, which it does not say all of
        raise FrankaArmArgumentError(f"{path} is a broken archive: {error}") from None
    if str(arrays.pop("format", "")) != kind:
        raise FrankaArmArgumentError(f"{path} is no {kind!r}")
    return arrays


class _PickledPose:
    """What stands for a pose of autolab_core or frankapy while a pickle is read: its fields, and none of its code."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        fields = {name.lstrip("_"): value for name, value in state.items()}
        self.matrix = np.eye(4)
        self.matrix[:3, :3], self.matrix[:3, 3] = fields["rotation"], fields["translation"]


_POSES = {("autolab_core.rigid_transformations", "RigidTransform"), ("frankapy.rigid_transform", "RigidTransform")}
_ARRAYS = {"_reconstruct", "ndarray", "dtype", "scalar", "_frombuffer"}


class _Unpickler(pickle.Unpickler):
    """Makes arrays, numbers, texts, lists, dictionaries and poses, and refuses everything else."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _POSES:
            return _PickledPose
        if module.split(".")[0] == "numpy" and name in _ARRAYS:
            return super().find_class(module.replace("numpy.core", "numpy._core"), name)
        if (module, name) == ("_codecs", "encode"):  # bytes of arrays that Python 2 wrote
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"it wants {module}.{name}, which is not made from files")


def _is_recorded(data: Any) -> bool:
    skill = next(iter(data.values()), None) if isinstance(data, dict) else None
    return isinstance(skill, dict) and isinstance(skill.get("skill_state_dict"), dict)


def unpickle(path: Path, data: bytes) -> Any:
    """Return what a pickle holds, without running code in it; raises FrankaArmArgumentError where it is broken or holds more."""
    try:
        return _Unpickler(io.BytesIO(data), encoding="latin1").load()
    except Exception as error:  # a broken pickle raises whatever it likes
        raise FrankaArmArgumentError(f"{path} cannot be read as a pickle of arrays: {error}") from None


def held(data: Any) -> str:
    """Name what a pickle holds, and who reads what old scripts wrote."""
    if _is_recorded(data):
        return "what record_trajectory.py writes, which Demonstration.load reads"
    if isinstance(data, list) and data and isinstance(data[0], _PickledPose):
        return "a list of poses, which Demonstration.load reads"
    if isinstance(data, dict) and set(KEYS) <= data.keys():
        return "the dictionary of a movement primitive, which dmp.load_script and Primitive.load read"
    if isinstance(data, dict):
        return f"a dictionary with {', '.join(map(str, data))}" if data else "an empty dictionary"
    if isinstance(data, list):
        return f"a list of {type(data[0]).__name__}" if data else "an empty list"
    return f"a {type(data).__name__}"


def _longest_part(times: np.ndarray) -> slice:
    """Return the longest part of some times (s) without a gap, or a clock that begins anew."""
    steps = np.diff(times)
    edges = [0, *(np.flatnonzero((steps > _LONGEST_GAP) | (steps < 0)) + 1), len(times)]
    if len(edges) > 2:
        longest = int(np.argmax(np.diff(edges)))
        part = slice(edges[longest], edges[longest + 1])
        logger.warning(
            "States are missing: of %d parts the longest is kept, %.1f s from %.1f s on.",
            len(edges) - 1, times[part][-1] - times[part][0], times[part.start] - times[0],
        )  # fmt: skip
        return part
    return slice(None)


def _array(name: str, values: Any, dimensions: int) -> np.ndarray:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise FrankaArmArgumentError(f"{name} are no numbers: expected an array") from None
    if array.ndim != dimensions:
        raise FrankaArmArgumentError(f"{name} has the shape {array.shape}: expected {dimensions} dimensions")
    if not np.all(np.isfinite(array)):
        i = np.argwhere(~np.isfinite(array))[0]
        raise FrankaArmArgumentError(f"{name}{list(map(int, i))} is {array[tuple(i)]}: expected finite numbers")
    return array


def _quaternions(rotations: np.ndarray) -> np.ndarray:
    return np.array([RigidTransform(rotation, np.zeros(3)).quaternion for rotation in rotations])
