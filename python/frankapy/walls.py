"""Virtual walls: bodies that an arm must not touch, and that its server keeps it from."""

from __future__ import annotations

import logging
from collections.abc import Callable, ItemsView, Iterator, Mapping, Sequence, ValuesView
from pathlib import Path
from typing import Any

import numpy as np

from frankapy import proto
from frankapy.collision_boxes import as_boxes
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.rigid_transform import RigidTransform
from frankapy.validation import flag, number, text, validate, vector

logger = logging.getLogger("frankapy")

_LONGEST_NAME = 100  # bytes (kLongestName of src/server/wall_store.cpp)


def Plane(normal: Sequence[float] = (0, 0, 1), point: Sequence[float] = (0, 0, 0)) -> proto.Wall:  # noqa: N802
    """Return the half-space behind a plane through `point` (m), from which `normal` leads out."""
    z = vector("normal", normal, 3)
    if not np.linalg.norm(z) > 1e-6:
        raise FrankaArmArgumentError(f"normal is {list(z)}: expected a direction, such as [0, 0, 1]")
    z = z / np.linalg.norm(z)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    wall = proto.Wall(plane=proto.Wall.Plane())
    return _place(wall, RigidTransform(np.column_stack([x, np.cross(z, x), z]), vector("point", point, 3)))


def Box(size: Sequence[float], pose: RigidTransform | Sequence[float] = (0, 0, 0)) -> proto.Wall:  # noqa: N802
    """Return a box with edges `size` (m) whose centre is at `pose`: a pose, or a position (m)."""
    return _place(proto.Wall(box=proto.Wall.Box(size=vector("size", size, 3))), pose)


def from_boxes(boxes: Any, name: str = "box") -> dict[str, proto.Wall]:
    """Return boxes as FrankaConstants.WORKSPACE_WALLS and the collision methods have them as walls: "box 1", "box 2" and so on.

    Each is centre x, y, z, roll, pitch, yaw about fixed axes or a quaternion w, x, y, z, and size; m, rad, (n, 9) or (n, 10).
    """
    placed = enumerate(as_boxes(boxes), 1)
    return {f"{name} {i}": Box(list(size), RigidTransform(pose[:3, :3], pose[:3, 3])) for i, (pose, size) in placed}


def Sphere(radius: float, centre: Sequence[float] = (0, 0, 0)) -> proto.Wall:  # noqa: N802
    """Return a sphere; `radius` and `centre` in m."""
    return _place(proto.Wall(sphere=proto.Wall.Sphere(radius=number("radius", radius))), centre)


def Cylinder(radius: float, length: float, pose: RigidTransform | Sequence[float] = (0, 0, 0)) -> proto.Wall:  # noqa: N802
    """Return a cylinder about the z axis of `pose` (or of a position), which is its middle; lengths in m."""
    body = proto.Wall.Cylinder(radius=number("radius", radius), length=number("length", length))
    return _place(proto.Wall(cylinder=body), pose)


def Capsule(radius: float, length: float, pose: RigidTransform | Sequence[float] = (0, 0, 0)) -> proto.Wall:  # noqa: N802
    """Return a cylinder, as there, with half a sphere on each end."""
    body = proto.Wall.Capsule(radius=number("radius", radius), length=number("length", length))
    return _place(proto.Wall(capsule=body), pose)


def Mesh(  # noqa: N802
    corners: Sequence[Sequence[float]] | np.ndarray,
    triangles: Sequence[Sequence[int]] | np.ndarray,
    pose: RigidTransform | Sequence[float] = (0, 0, 0),
) -> proto.Wall:
    """Return a convex body whose surface is triangles, in the frame of `pose` (or at a position).

    corners: (n, 3), m. triangles: (k, 3), the numbers of three corners each, from 0 on, counter-clockwise seen from outside. Of a file:
    `Mesh(*read_stl("fixture.stl"))`. What is not convex is refused: give its hull, or several bodies.
    """
    points, faces = _rows("corners", corners), _rows("triangles", triangles)
    for name, array, kinds in (("corners", points, "iuf"), ("triangles", faces, "iu")):
        if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in kinds:
            raise FrankaArmArgumentError(f"{name} has shape {array.shape} of {array.dtype}: expected rows of 3 {'whole ' * (kinds == 'iu')}numbers")
    for corner in (faces.min(), faces.max()) if faces.size else ():
        if not 0 <= corner < len(points):
            raise FrankaArmArgumentError(f"triangles has {corner}: expected numbers of the {len(points)} corners, from 0 on")
    mesh = proto.Wall.Mesh(corners=points.ravel().astype(float), triangles=faces.ravel())
    return _place(proto.Wall(mesh=mesh), pose)


def read_stl(path: str | Path, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (n, 3), in m, and triangles (k, 3) of an STL file, text or binary, whose unit is `scale` m (0.001: mm)."""
    scale = number("scale", scale)
    try:
        data = Path(path).read_bytes()
    except (OSError, TypeError, ValueError) as error:
        raise FrankaArmArgumentError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    count = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + 50 * count:
        rows = np.frombuffer(data, [("normal", "<f4", 3), ("corners", "<f4", 9), ("color", "<u2")], offset=84)
        points = rows["corners"].astype(float).reshape(-1, 3)
    else:
        lines = [line.split() for line in data.decode("utf-8", "replace").splitlines()]
        try:
            points = np.array([line[1:4] for line in lines if line[:1] == ["vertex"]], dtype=float).reshape(-1, 3)
        except ValueError:
            points = np.empty((0, 3))
        if not len(points) or len(points) % 3:
            raise FrankaArmArgumentError(f"{path} is no STL file: expected triangles, in text or binary")
    # Each triangle has corners of its own there.
    corners, index = np.unique(np.round(points * scale, 7), axis=0, return_inverse=True)
    return corners, index.reshape(-1, 3)


def _rows(name: str, values: Any) -> np.ndarray:
    try:
        return np.asarray(values)
    except (TypeError, ValueError):  # rows of different lengths
        raise FrankaArmArgumentError(f"{name} is no array: expected rows of 3 numbers each") from None


def _place(wall: proto.Wall, pose: RigidTransform | Sequence[float]) -> proto.Wall:
    given: Any = pose
    if hasattr(pose, "quaternion"):
        position, quaternion = given.translation, given.quaternion
    else:
        position, quaternion = vector("position", pose, 3), (1.0, 0.0, 0.0, 0.0)
    wall.ClearField("position")
    wall.ClearField("orientation")
    wall.position.extend(map(float, position))
    wall.orientation.extend(map(float, quaternion))
    return wall


class Walls(Mapping[str, proto.Wall]):
    """The walls of an arm by name, as `fa.walls`.

    Motions end 10 mm before a wall, or slide along it; under torque control it pushes back. What is added holds at once, also for
    the skill that runs, until it is removed or, unless it is to be kept, the arm's server is started again. An arm that is nearer
    already may go away only; where a wall that comes finds it so, a warning says which link.

    Example:
        >>> fa.walls.add("table", Box([1, 1, 0.1], [0.5, 0, -0.05]))
        >>> fa.walls.hold("screwdriver", Capsule(0.01, 0.1, [0, 0, 0.05]))
        >>> del fa.walls["table"]
    """

    def __init__(self, change: Callable[[proto.ChangeWalls], proto.Walls], flange_to_tool: Callable[[], np.ndarray]) -> None:
        """Speak with a server through `change`; `flange_to_tool` gives F_T_EE, shape (4, 4)."""
        self._change = change
        self._flange_to_tool = flange_to_tool

    def add(self, name: str, wall: proto.Wall, keep: bool = False, protect: bool = False) -> None:
        """Add one, or put it in the place of that name; with `keep` it is there when the server is started again, until removed.

        With `protect` only role lab changes or removes it, who alone may say so (docs/keys.md).

        Raises FrankaArmArgumentError for what the server refuses, FrankaArmNotPermittedException for what needs another role.
        """
        self.update({name: wall}, keep, protect)

    def update(self, walls: Mapping[str, proto.Wall], keep: bool = False, protect: bool = False) -> None:
        """Add several at once, as `add`: all or none."""
        if not isinstance(walls, Mapping):
            raise FrankaArmArgumentError(f"walls is a {type(walls).__name__}: expected a dictionary, name: wall")
        self._put([self._named(name, wall, keep, protect) for name, wall in walls.items()])

    def hold(self, name: str, body: proto.Wall, keep: bool = False, protect: bool = False) -> None:
        """Add a body to the arm itself: a tool, or what the hand holds. It is given in the frame of the tool (EE)."""
        named = self._named(name, body, keep, protect)
        tool = self._flange_to_tool()
        rotation = tool[:3, :3] @ RigidTransform.rotation_from_quaternion(named.orientation)
        _place(named, RigidTransform(rotation, tool[:3, :3] @ named.position + tool[:3, 3])).held = True
        self._put([named])

    def warn_of_near(self) -> None:
        """Warn of each wall that the arm is in, or nearer to than motions keep, as a new client does."""
        self._warn(self._change(proto.ChangeWalls()))

    def remove(self, *names: str) -> None:
        """Remove these.

        Raises FrankaArmArgumentError where one is not there, FrankaArmNotPermittedException where one is protected, as those of the
        server's configuration are, and this client has not the role lab.
        """
        self._change(proto.ChangeWalls(remove=[text("name", name, _LONGEST_NAME) for name in names]))

    def clear(self) -> None:
        """Remove all that are not protected."""
        self.remove(*(name for name, wall in self._all().items() if not wall.fixed))

    def __delitem__(self, name: str) -> None:
        """Remove one."""
        self.remove(name)

    def __setitem__(self, name: str, wall: proto.Wall) -> None:
        """Add one."""
        self.add(name, wall)

    def __getitem__(self, name: str) -> proto.Wall:
        """Return one."""
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over their names."""
        return iter(self._all())

    def items(self) -> ItemsView[str, proto.Wall]:
        """Return names and walls as they are now."""
        return self._all().items()

    def values(self) -> ValuesView[proto.Wall]:
        """Return the walls as they are now."""
        return self._all().values()

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._all())

    def __repr__(self) -> str:
        """Return names and shapes."""
        texts = [f"{name}: {wall.WhichOneof('shape')}{' (held)' if wall.held else ''}" for name, wall in self._all().items()]
        return f"Walls({', '.join(texts)})"

    def _put(self, walls: list[proto.Wall]) -> None:
        self._warn(self._change(proto.ChangeWalls(put=walls)))

    def _warn(self, walls: proto.Walls) -> None:
        for near in walls.nearer:
            where = f"{-1e3 * near.distance:.0f} mm inside of" if near.distance < 0 else f"{1e3 * near.distance:.0f} mm before"
            logger.warning("%s is %s the wall %r: until it is 10 mm away the arm may only go away from it", near.link, where, near.wall)

    def _all(self) -> dict[str, proto.Wall]:
        return {wall.name: wall for wall in self._change(proto.ChangeWalls()).walls}

    def _named(self, name: str, wall: proto.Wall, keep: bool, protect: bool) -> proto.Wall:
        if not isinstance(wall, proto.Wall):
            raise FrankaArmArgumentError(f"wall is {wall!r}: expected Plane(...), Box(...), Sphere(...), Cylinder(...), Capsule(...) or Mesh(...)")
        named = proto.Wall()
        named.CopyFrom(wall)
        named.name = text("name", name, _LONGEST_NAME)
        named.keep = flag("keep", keep)
        named.fixed = flag("protect", protect)
        validate(named)
        return named
