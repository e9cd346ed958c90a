"""Poses: RigidTransform, which is autolab_core's class where that is installed and this file's otherwise."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from frankapy.exceptions import FrankaArmArgumentError
from frankapy.validation import array

_ORTHONORMAL_TOLERANCE = 1e-3


class RigidTransform:
    """A rotation and a translation from one named frame to another.

    As a pose: where `from_frame` is, seen from `to_frame`. Rotations are 3x3 matrices, or quaternions w, x, y, z where
    they are given; translations in metres. `a * b` is b first, then a; the frames must meet (b.to_frame ==
    a.from_frame). The arrays are float64, belong to this object, and may be changed in place. Names and meanings are
    those of autolab_core's RigidTransform.
    """

    def __init__(
        self,
        rotation: Any = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        translation: Any = (0, 0, 0),
        from_frame: str = "unassigned",
        to_frame: str = "world",
    ) -> None:
        for name, frame in (("from_frame", from_frame), ("to_frame", to_frame)):
            if not isinstance(frame, str):
                raise FrankaArmArgumentError(f"{name} is {frame!r}: expected the name of a frame")
        self.rotation = rotation
        self.translation = translation
        self.from_frame = from_frame
        self.to_frame = to_frame

    def __setstate__(self, state: dict[str, Any]) -> None:
        # In autolab_core's pickles the frames have underscores too.
        vars(self).update({name.lstrip("_") if name.endswith("frame") else name: value for name, value in state.items()})

    @property
    def rotation(self) -> np.ndarray:
        """Rotation matrix, (3, 3)."""
        return self._rotation

    @rotation.setter
    def rotation(self, rotation: Any) -> None:
        rotation = array("rotation", rotation)
        if rotation.shape == (4,):
            rotation = self.rotation_from_quaternion(rotation)
        if rotation.shape != (3, 3):
            raise FrankaArmArgumentError(f"rotation has the shape {rotation.shape}: expected (3, 3), or a quaternion w, x, y, z")
        error = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if not error <= _ORTHONORMAL_TOLERANCE or np.linalg.det(rotation) < 0:
            raise FrankaArmArgumentError(f"this is no rotation matrix (orthonormal, determinant 1):\n{rotation}")
        self._rotation = rotation

    @property
    def translation(self) -> np.ndarray:
        """Translation in `to_frame`, (3,), m."""
        return self._translation

    @translation.setter
    def translation(self, translation: Any) -> None:
        translation = array("translation", translation)
        if translation.size != 3:
            raise FrankaArmArgumentError(f"translation has the shape {translation.shape}: expected (3,)")
        self._translation = translation.reshape(3)

    @property
    def position(self) -> np.ndarray:
        """The translation."""
        return self._translation

    @position.setter
    def position(self, position: Any) -> None:
        self.translation = position

    @property
    def quaternion(self) -> np.ndarray:
        """The rotation as a unit quaternion w, x, y, z, with w >= 0."""
        return _quaternion_of(self._rotation)

    @property
    def euler_angles(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw about the fixed axes x, y, z (in this order), rad."""
        r = self._rotation
        pitch = np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0]))
        if np.hypot(r[0, 0], r[1, 0]) > 1e-9:
            roll, yaw = np.arctan2(r[2, 1], r[2, 2]), np.arctan2(r[1, 0], r[0, 0])
        else:  # only roll -+ yaw is defined
            roll, yaw = np.arctan2(-r[1, 2], r[1, 1]), 0.0
        return float(roll), float(pitch), float(yaw)

    @property
    def matrix(self) -> np.ndarray:
        """The homogeneous matrix, (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self._rotation
        matrix[:3, 3] = self._translation
        return matrix

    @property
    def vec(self) -> np.ndarray:
        """Translation and quaternion, (7,)."""
        return np.r_[self._translation, self.quaternion]

    @property
    def x_axis(self) -> np.ndarray:
        """The x axis of `from_frame`, in `to_frame`."""
        return self._rotation[:, 0]

    @property
    def y_axis(self) -> np.ndarray:
        """The y axis of `from_frame`, in `to_frame`."""
        return self._rotation[:, 1]

    @property
    def z_axis(self) -> np.ndarray:
        """The z axis of `from_frame`, in `to_frame`."""
        return self._rotation[:, 2]

    def copy(self) -> RigidTransform:
        """Return an independent copy."""
        return RigidTransform(self._rotation, self._translation, self.from_frame, self.to_frame)

    def as_frames(self, from_frame: str, to_frame: str = "world") -> RigidTransform:
        """Return a copy with other names of frames."""
        return RigidTransform(self._rotation, self._translation, from_frame, to_frame)

    def inverse(self) -> RigidTransform:
        """Return the transform from `to_frame` to `from_frame`."""
        back = self._rotation.T
        return RigidTransform(back, -back @ self._translation, self.to_frame, self.from_frame)

    def dot(self, other: RigidTransform) -> RigidTransform:
        """Return `self * other`."""
        return self * other

    def __mul__(self, other: RigidTransform) -> RigidTransform:
        if not isinstance(other, RigidTransform):
            return NotImplemented
        if other.to_frame != self.from_frame:
            raise FrankaArmArgumentError(
                f"the frames of a product must meet: the right one leads to {other.to_frame!r}, the left one starts "
                f"at {self.from_frame!r}"
            )
        return RigidTransform(
            _orthonormal(self._rotation @ other._rotation),
            self._rotation @ other._translation + self._translation,
            other.from_frame,
            self.to_frame,
        )

    def interpolate_with(self, other_tf: RigidTransform, t: float) -> RigidTransform:
        """Return the pose at `t` (0 to 1) of the straight line and shortest rotation from this one to another."""
        if not 0 <= t <= 1:
            raise FrankaArmArgumentError(f"t is {t}: expected 0 to 1")
        between = _quaternion_of(self._rotation.T @ other_tf.rotation)
        half = np.arctan2(np.linalg.norm(between[1:]), between[0])
        axis = between[1:] / np.sin(half) if half > 1e-12 else np.zeros(3)
        turned = self.rotation_from_quaternion(np.r_[np.cos(t * half), np.sin(t * half) * axis])
        return RigidTransform(
            _orthonormal(self._rotation @ turned),
            (1 - t) * self._translation + t * other_tf.translation,
            self.from_frame,
            self.to_frame,
        )

    def linear_trajectory_to(self, target_tf: RigidTransform, traj_len: int) -> list[RigidTransform]:
        """Return `traj_len` equally spaced poses, of which this one is the first and the target the last."""
        if traj_len < 0:
            raise FrankaArmArgumentError(f"traj_len is {traj_len}: expected at least 0")
        return [self.interpolate_with(target_tf, t) for t in np.linspace(0, 1, traj_len)]

    def __repr__(self) -> str:
        with np.printoptions(precision=4, suppress=True):
            return (
                f"RigidTransform(translation={self._translation}, quaternion={self.quaternion}, "
                f"from_frame={self.from_frame!r}, to_frame={self.to_frame!r})"
            )

    @staticmethod
    def x_axis_rotation(theta: float) -> np.ndarray:
        """Return the matrix of a rotation by `theta` (rad) about x."""
        c, s = np.cos(theta), np.sin(theta)
        return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])

    @staticmethod
    def y_axis_rotation(theta: float) -> np.ndarray:
        """Return the matrix of a rotation by `theta` (rad) about y."""
        c, s = np.cos(theta), np.sin(theta)
        return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])

    @staticmethod
    def z_axis_rotation(theta: float) -> np.ndarray:
        """Return the matrix of a rotation by `theta` (rad) about z."""
        c, s = np.cos(theta), np.sin(theta)
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])

    @staticmethod
    def rotation_from_quaternion(q_wxyz: Any) -> np.ndarray:
        """Return the matrix of a unit quaternion w, x, y, z."""
        q = np.array(q_wxyz, dtype=float)
        norm = np.linalg.norm(q)
        if q.shape != (4,) or not abs(norm - 1) <= _ORTHONORMAL_TOLERANCE:
            raise FrankaArmArgumentError(f"{q_wxyz} is no unit quaternion w, x, y, z")
        w, x, y, z = q / norm
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )

    @staticmethod
    def quaternion_from_axis_angle(v: Any) -> np.ndarray:
        """Return the quaternion w, x, y, z of a rotation vector: axis times angle (rad)."""
        v = np.asarray(v, dtype=float)
        angle = np.linalg.norm(v)
        axis = v / angle if angle > 0 else v
        return np.r_[np.cos(angle / 2), np.sin(angle / 2) * axis]

    @staticmethod
    def rotation_from_axis_angle(v: Any) -> np.ndarray:
        """Return the matrix of a rotation vector: axis times angle (rad)."""
        return RigidTransform.rotation_from_quaternion(RigidTransform.quaternion_from_axis_angle(v))

    @staticmethod
    def rotation_from_axes(x_axis: Any, y_axis: Any, z_axis: Any) -> np.ndarray:
        """Return the matrix with these columns."""
        return np.column_stack([x_axis, y_axis, z_axis]).astype(float)

    @staticmethod
    def interpolate(T0: RigidTransform, T1: RigidTransform, t: float) -> RigidTransform:
        """Return `T0.interpolate_with(T1, t)`; the frames of both must be the same."""
        if (T0.from_frame, T0.to_frame) != (T1.from_frame, T1.to_frame):
            raise FrankaArmArgumentError(f"the frames differ: {T0!r} and {T1!r}")
        return T0.interpolate_with(T1, t)


def _quaternion_of(rotation: np.ndarray) -> np.ndarray:
    """Return w, x, y, z of a rotation matrix, by its largest component (Shepperd, 1978)."""
    r = rotation
    trace = np.trace(r)
    i = int(np.argmax([trace, r[0, 0], r[1, 1], r[2, 2]]))
    if i == 0:
        q = np.array([1 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    elif i == 1:
        q = np.array([r[2, 1] - r[1, 2], 1 + 2 * r[0, 0] - trace, r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]])
    elif i == 2:
        q = np.array([r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1 + 2 * r[1, 1] - trace, r[1, 2] + r[2, 1]])
    else:
        q = np.array([r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 + 2 * r[2, 2] - trace])
    return q / (np.linalg.norm(q) * (-1 if q[0] < 0 else 1))


def _orthonormal(rotation: np.ndarray) -> np.ndarray:
    """Return the nearest rotation, to first order: products of many rotations stay rotations."""
    return rotation @ (1.5 * np.eye(3) - 0.5 * rotation.T @ rotation)


class Point:
    """A point of a named frame, m, (3,); `transform * point` is the same point in the transform's `to_frame`."""

    def __init__(self, data: Any, frame: str = "unspecified") -> None:
        data = np.array(data, dtype=float)
        if data.size != 3:
            raise FrankaArmArgumentError(f"data has the shape {data.shape}: expected (3,)")
        self.data = data.reshape(3)
        self.frame = frame

    @property
    def x(self) -> float:
        """First coordinate, m."""
        return float(self.data[0])

    @property
    def y(self) -> float:
        """Second coordinate, m."""
        return float(self.data[1])

    @property
    def z(self) -> float:
        """Third coordinate, m."""
        return float(self.data[2])

    @property
    def vector(self) -> np.ndarray:
        """The coordinates, m, (3,)."""
        return self.data

    def __rmul__(self, transform: RigidTransform) -> Point:
        if transform.from_frame != self.frame:
            raise FrankaArmArgumentError(f"the frames must meet: the point is in {self.frame!r}, the transform from {transform.from_frame!r}")
        return Point(transform.rotation @ self.data + transform.translation, transform.to_frame)

    def __repr__(self) -> str:
        return f"Point({self.data}, frame={self.frame!r})"


# Scripts that use autolab_core's poses multiply them with ours, and its product takes nothing but its own class. Where
# frankapy/compat stands in for it, that one takes its classes from here, and may be the first to be imported.
with contextlib.suppress(ImportError):
    from autolab_core import RigidTransform  # type: ignore[no-redef]  # noqa: F811
