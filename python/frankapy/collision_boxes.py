"""The arm as twelve boxes, whether they meet others, and what is behind virtual walls: a quick check of the client's, with the
published interface's boxes. The server's own walls (docs/walls.md) are checked there, with the robot's capsules."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from frankapy import kinematics
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.rigid_transform import RigidTransform
from frankapy.validation import Floats, table, vector

# Figures of the public frankapy: sizes (m), the frame of kinematics.link_frames that carries each, and its pose there.
SHAPES = np.array(
    [
        [0.23, 0.2, 0.1],
        [0.13, 0.12, 0.1],
        [0.12, 0.1, 0.2],
        [0.15, 0.27, 0.11],
        [0.12, 0.1, 0.2],
        [0.13, 0.12, 0.25],
        [0.13, 0.23, 0.15],
        [0.12, 0.12, 0.4],
        [0.12, 0.12, 0.25],
        [0.13, 0.23, 0.12],
        [0.12, 0.12, 0.2],
        [0.08, 0.22, 0.17],
    ]
)
LINKS = [1, 1, 1, 1, 1, 3, 4, 5, 5, 5, 7, 7]


def _about(axis: str, degrees: float) -> np.ndarray:
    return getattr(RigidTransform, f"{axis}_axis_rotation")(np.radians(degrees))


def _poses() -> np.ndarray:
    tilt = np.degrees(np.arctan2(0.58589793, 0.81038486))
    places = [
        (np.eye(3), [-0.04, 0, -0.283]),
        (np.eye(3), [-0.009, 0, -0.183]),
        (_about("x", tilt), [0, -0.032, -0.082]),
        (np.eye(3), [-0.008, 0, 0]),
        (_about("x", tilt), [0, 0.042, 0.067]),
        (np.eye(3), [0.00687, 0, -0.139]),
        (_about("x", -90), [-0.008, 0.004, 0]),
        (_about("x", -10), [0.00422, 0.05367, -0.121]),
        (np.eye(3), [0.00422, 0.00367, -0.263]),
        (np.eye(3), [0.00328, 0.0176, -0.0055]),
        (_about("x", 180), [-0.0136, 0.0092, 0.0083]),
        (_about("z", -45), [0.0136, -0.0092, 0.1457]),
    ]
    poses = np.tile(np.eye(4), (12, 1, 1))
    for pose, (rotation, translation) in zip(poses, places, strict=True):
        pose[:3, :3], pose[:3, 3] = rotation, translation
    return poses


POSES = _poses()


# The corners of each box in its frame, m, (12, 8, 3).
_CORNERS = SHAPES[:, None, :] * np.array(list(itertools.product((-0.5, 0.5), repeat=3)))


def rotation_from_rpy(angles: np.ndarray) -> np.ndarray:
    """Return the matrices (..., 3, 3) of roll, pitch, yaw (rad, (..., 3)) about the fixed axes x, y, z, in this order."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles).T, np.cos(angles).T
    transposed = [
        [cy * cp, sy * cp, -sp],
        [cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr],
        [cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr],
    ]
    return np.array(transposed).T


def poses_at(joints: np.ndarray) -> np.ndarray:
    """Return the poses of the arm's boxes in the base at `joints` (rad, (7,)); (12, 4, 4)."""
    return kinematics.link_frames(joints)[LINKS] @ POSES


def as_box(box: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return pose (4, 4) and size (3,) of a box: centre x, y, z, roll, pitch, yaw about fixed axes, size; m, rad, (9,).

    In place of the angles there may be a quaternion w, x, y, z: (10,).
    """
    box = vector("box", box, 10 if np.size(box) == 10 else 9)
    if (box[-3:] < 0).any():
        raise FrankaArmArgumentError(f"box has the size {box[-3:]}: expected at least 0 m along each axis")
    pose = np.eye(4)
    pose[:3, :3] = RigidTransform.rotation_from_quaternion(box[3:7]) if len(box) == 10 else rotation_from_rpy(box[3:6])
    pose[:3, 3] = box[:3]
    return pose, box[-3:]


def as_boxes(boxes: Any) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return pose and size of each box, as `as_box`; (n, 9) or (n, 10), one row may be given without brackets, or none at all."""
    return [as_box(row) for row in _rows("boxes", boxes)]


def _rows(name: str, boxes: Any) -> Floats:
    if np.size(boxes) == 0:
        return np.zeros((0, 9))
    return table(name, boxes, 10 if np.shape(boxes)[-1:] == (10,) else 9)


def meet(pose: np.ndarray, size: np.ndarray, other: np.ndarray, other_size: np.ndarray) -> bool:
    """Return whether two boxes overlap: no plane along a face of one, or along an edge of each, lies between them.

    Separating axes after Gottschalk, Lin and Manocha, "OBBTree", 1996.
    """
    A, B = pose[:3, :3], other[:3, :3]
    crossed = np.cross(A.T[:, None, :], B.T[None, :, :]).reshape(9, 3)
    axes = np.vstack([A.T, B.T, crossed[np.linalg.norm(crossed, axis=1) > 1e-9]])
    reach = np.abs(axes @ A) @ (size / 2) + np.abs(axes @ B) @ (other_size / 2)
    return bool(np.all(np.abs(axes @ (other[:3, 3] - pose[:3, 3])) <= reach))


def arm_meets(box: Any, joints: np.ndarray) -> bool:
    """Return whether the arm at `joints` (rad, (7,)) meets a box (see `as_box`)."""
    return arm_meets_any([as_box(box)], joints)


def arm_meets_any(boxes: Sequence[tuple[np.ndarray, np.ndarray]], joints: np.ndarray) -> bool:
    """Return whether the arm at `joints` (rad, (7,)) meets one of some boxes, of which there are poses and sizes."""
    own = list(zip(poses_at(joints), SHAPES, strict=True))
    return any(meet(pose, size, *each) for pose, size in boxes for each in own)


def behind(walls: Any, points: Floats, whole_wall: bool = False) -> tuple[int, int] | None:
    """Return the numbers of the first wall and point that is behind it; None when all points are before all walls.

    Args:
        walls: boxes (see `as_boxes`). Behind is what the plane of its two longer sides parts from the base of the arm.
        points: m, in the base, (m, 3).
        whole_wall: also what is in the half of it that is nearer to the base.
    """
    rows = _rows("walls", walls)
    outward, distance, half = _planes(rows.tobytes(), rows.shape[1])
    found = (points @ outward.T >= distance - (half if whole_wall else 0)) & (distance != 0)
    if not found.any():
        return None
    number = int(found.any(axis=0).argmax())
    return number, int(found[:, number].argmax())


@functools.lru_cache(maxsize=8)
def _planes(walls: bytes, columns: int) -> tuple[Floats, Floats, Floats]:
    """Return the middle planes of walls, the bytes of their rows: normals away from the base, distances from it; half thicknesses.

    Every motion asks for those of the same walls.
    """
    boxes = [as_box(row) for row in np.frombuffer(walls).reshape(-1, columns)]
    thin = [int(size.argmin()) for _, size in boxes]
    normal = np.array([pose[:3, k] for (pose, _), k in zip(boxes, thin, strict=True)]).reshape(-1, 3)
    distance = np.array([normal @ pose[:3, 3] for normal, (pose, _) in zip(normal, boxes, strict=True)])  # either side of the base
    half = np.array([size[k] / 2 for (_, size), k in zip(boxes, thin, strict=True)])
    return normal * np.sign(distance)[:, None], np.abs(distance), half


def corners_at(joints: Floats) -> Floats:
    """Return the corners of the arm's boxes in the base at `joints` (rad, (7,)); m, (12 * 8, 3), box after box."""
    poses = poses_at(joints)
    corners: Floats = _CORNERS @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    return corners.reshape(-1, 3)


def place(wall: Any, point: Floats) -> str:
    """Say where a point (m, (3,)) is and where the wall that it is behind."""
    pose, size = as_box(wall)
    outward = pose[:3, int(np.argmin(size))]
    axis = int(np.argmax(np.abs(outward)))
    if abs(outward[axis]) > 1 - 1e-9:
        return f"{'xyz'[axis]} = {point[axis]:.3f} m, and one of the virtual walls is at {pose[axis, 3]:g} m"
    text = ", ".join(f"{value:.3f}" for value in point)
    return f"[{text}] m, {abs(outward @ (point - pose[:3, 3])):.3f} m behind the middle of one of the virtual walls"


def check(walls: Any, what: str, **points: np.ndarray) -> None:
    """Raise FrankaArmArgumentError where `what` brings points (m, (n, 3), by what is there) behind the WORKSPACE_WALLS."""
    for name, where in points.items():
        found = behind(walls, where, whole_wall=name == "arm")
        if found is not None:
            wall, point = found
            raise FrankaArmArgumentError(
                f"{what} would bring the {name.replace('_', ' ')} to {place(walls[wall], where[point])} "
                f"(FrankaConstants.WORKSPACE_WALLS[{wall}]). ignore_virtual_walls=True goes there all the same"
            )
