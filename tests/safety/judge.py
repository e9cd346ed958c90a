"""Whether a run kept what the campaign asks for: from the truth file, recordings, and datagrams, and by its own geometry.

Kinds of violation:
  wall        a capsule of the arm or what it held was more than 2 mm past a wall, or farther past one that it was in already
  limit       a command broke a limit of the robot (tests/interop/wire_limits.py), or the robot reports an error nobody provoked
  joints      a true joint position was outside its range
  unreported  a call raised something else than frankapy's exceptions, or a skill has no result
  hung        no answer, an arm that is not ready again, or walls that are gone
  recording   states, skills or the end of one are missing in the recordings
"""

import dataclasses
import itertools
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from frankapy import RigidTransform, proto
from frankapy.kinematics import DH_PARAMS, HAND_YAW
from frankapy.recording import Recording

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "tests" / "interop"))
import wire_limits  # noqa: E402

KINDS = ("wall", "limit", "joints", "unreported", "hung", "recording")
PAST = 0.002  # m, that a capsule may be past a wall
ROUNDING = 1e-6  # rad
IDLE_STEP = 10  # cycles of which one is recorded while the robot holds itself
NEAR = 0.05  # m; farther away a distance need not be exact
SEARCHES = 24  # for the place of a capsule that is nearest, each by the golden ratio
POINTS = 30  # of a capsule
RESTS = 0.05  # rad/s; faster, no motion has ended
APART = 3  # joints, from which on the robot minds that links meet
FLANGE = 8  # its frame, and the number of the hand as a link


@dataclasses.dataclass(frozen=True)
class Violation:
    """Something that must not be."""

    kind: str
    text: str
    event: int | None = None  # during which it was seen


@dataclasses.dataclass
class Standing:
    """A wall, or a body that was held, from and to (excluded) which cycle of the world it certainly was there."""

    wall: proto.Wall
    begin: int
    end: int | None = None


@dataclasses.dataclass(frozen=True)
class Capsule:
    """Of the arm, in a frame of frames()."""

    frame: int
    a: np.ndarray  # m, (3,), the ends of its axis
    b: np.ndarray
    radius: float


def capsules(with_base: bool = False) -> list[Capsule]:
    """Those of the arm and the hand that move and may meet walls, or all that may meet each other, from the one place that has them."""
    text = (REPOSITORY / "models" / "arm.cpp").read_text()
    (table,) = re.findall(r"kCapsules = \{\{(.*?)\}\};", text, re.DOTALL)
    if not with_base:
        (hull,) = re.findall(r"kHandHull = (.*);", (REPOSITORY / "models" / "arm.hpp").read_text())
        table += hull  # around the hand: it counts for walls alone
    rows = re.findall(r"\{(\d), \{([^}]*)\}, '(\w)', ([\d.]+), ([\d.]+)\}", table)
    found = []
    for link, centre, axis, radius, length in rows:
        if int(link) <= 1 and not with_base:  # the base, and what turns about its own axis
            continue
        turn = np.eye(3)
        if int(link) == FLANGE:
            turn = RigidTransform.z_axis_rotation(HAND_YAW)
        half = np.eye(3)["xyz".index(axis)] * float(length) / 2
        middle = np.array([float(x) for x in centre.split(",")])
        found.append(Capsule(int(link), turn @ (middle - half), turn @ (middle + half), float(radius)))
    return found


def frames(q: np.ndarray) -> np.ndarray:
    """Frames in the base of many postures (n, 7), rad: the base, joints 1 to 7, the flange; (9, n, 4, 4)."""
    out = np.tile(np.eye(4), (FLANGE + 1, len(q), 1, 1))
    for i in range(FLANGE):
        a, d, alpha, offset = DH_PARAMS[i]
        theta = (q[:, i] if i < 7 else 0) + offset
        c, s = np.broadcast_to(np.cos(theta), len(q)), np.broadcast_to(np.sin(theta), len(q))
        ca, sa = np.cos(alpha), np.sin(alpha)
        step = np.tile(np.eye(4), (len(q), 1, 1))
        step[:, 0, 0], step[:, 0, 1], step[:, 0, 3] = c, -s, a
        step[:, 1, 0], step[:, 1, 1], step[:, 1, 2], step[:, 1, 3] = s * ca, c * ca, -sa, -d * sa
        step[:, 2, 0], step[:, 2, 1], step[:, 2, 2], step[:, 2, 3] = s * sa, c * sa, ca, d * ca
        out[i + 1] = out[i] @ step
    return out


def distance(wall: proto.Wall, points: np.ndarray) -> np.ndarray:
    """From points (n, 3), m in the base, to the surface of a wall; negative inside."""
    rotation = RigidTransform.rotation_from_quaternion(wall.orientation)
    at = (points - np.array(wall.position)) @ rotation
    kind = wall.WhichOneof("shape")
    if kind == "plane":
        return at[:, 2]
    if kind == "sphere":
        return np.linalg.norm(at, axis=1) - wall.sphere.radius
    if kind == "capsule":
        at[:, 2] -= np.clip(at[:, 2], -wall.capsule.length / 2, wall.capsule.length / 2)
        return np.linalg.norm(at, axis=1) - wall.capsule.radius
    if kind == "mesh":
        return _distance_to_mesh(np.reshape(wall.mesh.corners, (-1, 3))[np.reshape(wall.mesh.triangles, (-1, 3))], at)
    if kind == "box":
        beyond = np.abs(at) - np.array(wall.box.size) / 2
    else:
        radial = np.linalg.norm(at[:, :2], axis=1) - wall.cylinder.radius
        beyond = np.stack([radial, np.abs(at[:, 2]) - wall.cylinder.length / 2], axis=1)
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


def _distance_to_mesh(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """From points (n, 3) to the surface of a convex body of triangles (k, 3, 3)."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    heights = points @ normals.T - (normals * triangles[:, 0]).sum(axis=1)  # (n, k)
    inside, nearest = heights.max(axis=1), np.full(len(points), np.inf)
    for corners, normal, height in zip(triangles, normals, heights.T, strict=True):
        # Above a triangle its plane is nearest, elsewhere one of its edges.
        above = np.ones(len(points), dtype=bool)
        to_edges = np.full(len(points), np.inf)
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            above &= (points - a) @ np.cross(normal, b - a) >= 0
            along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            to_edges = np.minimum(to_edges, np.linalg.norm(points - a - along[:, None] * (b - a), axis=1))
        away = np.where(above, np.abs(height), to_edges)
        nearest = np.minimum(nearest, away)
    return np.where(inside > 0, nearest, inside)


def gap(wall: proto.Wall, capsule: Capsule, at: np.ndarray, exact: float = NEAR) -> np.ndarray:
    """Between a wall and a capsule whose frame (n, 4, 4) is there, m; where that is more than `exact`, at most that."""
    a = at[:, :3, :3] @ capsule.a + at[:, :3, 3]
    way = at[:, :3, :3] @ (capsule.b - capsule.a)
    # From the middle no point of it is farther away than half of its length.
    out = distance(wall, a + way / 2) - np.linalg.norm(capsule.b - capsule.a) / 2 - capsule.radius
    near = out < exact
    if not near.any():
        return out
    a, way = a[near], way[near]

    def at_share(share: np.ndarray) -> np.ndarray:
        return distance(wall, a + share[:, None] * way)

    low, high = np.zeros(len(a)), np.ones(len(a))
    golden = (np.sqrt(5) - 1) / 2
    left, right = np.full(len(a), 1 - golden), np.full(len(a), golden)
    of_left, of_right = at_share(left), at_share(right)
    for _ in range(SEARCHES):  # the distance is convex along a segment
        further = of_left > of_right
        low, high = np.where(further, left, low), np.where(further, high, right)
        kept, of_kept = np.where(further, right, left), np.minimum(of_left, of_right)
        new = low + high - kept
        of_new = at_share(new)
        left, of_left = np.where(further, kept, new), np.where(further, of_kept, of_new)
        right, of_right = np.where(further, new, kept), np.where(further, of_new, of_kept)
    out[near] = np.minimum(of_left, of_right) - capsule.radius
    return out


def held_capsule(body: proto.Wall) -> Capsule:
    """Of a capsule that is held, which has the frame of the flange."""
    half = RigidTransform.rotation_from_quaternion(body.orientation)[:, 2] * body.capsule.length / 2
    return Capsule(FLANGE, body.position - half, body.position + half, body.capsule.radius)


def clearance(wall: proto.Wall, q: np.ndarray, bodies: Sequence[Capsule] = ()) -> float:
    """Least gap between a wall and some capsules, or else those of the arm, at a posture (7,), rad; m."""
    at = frames(q[None])
    return min(float(gap(wall, capsule, at[capsule.frame])[0]) for capsule in bodies or capsules())


def self_distance(q: np.ndarray, held: Sequence[Capsule] = ()) -> float:
    """Least distance, within 5 mm, between capsules of the arm and what it holds at a posture (7,), rad, that are three joints apart; m."""
    at = frames(q[None])[:, 0]
    bodies = [*capsules(with_base=True), *held]
    shares = np.linspace(0, 1, POINTS)[:, None]
    points = []
    for capsule in bodies:
        frame = at[capsule.frame]
        points.append((capsule.a + shares * (capsule.b - capsule.a)) @ frame[:3, :3].T + frame[:3, 3])
    least = np.inf
    for (one, of_one), (other, of_other) in itertools.combinations(zip(bodies, points, strict=True), 2):
        if other.frame - one.frame >= APART:
            away = np.linalg.norm(of_one[:, None] - of_other[None], axis=2).min() - one.radius - other.radius
            least = min(least, float(away))
    return least


def own_stops(truth: np.ndarray) -> np.ndarray:
    """In which rows the robot stops an arm by itself: from the end of a motion in which it was fast to the next motion."""
    moving = truth["moving"].astype(bool)
    ends = np.flatnonzero(moving[:-1] & ~moving[1:] & (np.abs(truth["dq"][1:]).max(axis=1) > RESTS)) + 1
    begins = np.append(np.flatnonzero(~moving[:-1] & moving[1:]) + 1, len(moving))
    out = np.zeros(len(moving), dtype=bool)
    for end in ends:
        out[end : begins[np.searchsorted(begins, end)]] = True
    return out


def judge_walls(truth: np.ndarray, standing: list[Standing]) -> list[Violation]:
    """No capsule past a wall, nor what is held; of one that was in it when it came, or when the robot has stopped it, no deeper."""
    at = frames(truth["q"]) if standing else None
    stops = own_stops(truth)
    times = np.cumsum(np.diff(stops.astype(int), prepend=0) > 0)  # that it has been stopped
    always = Standing(proto.Wall(), 0)
    bodies = [(always, capsule) for capsule in capsules()] + [(each, held_capsule(each.wall)) for each in standing if each.wall.held]
    found = []
    for each in (each for each in standing if not each.wall.held):
        worst: tuple[float, int, int] | None = None
        for body, capsule in bodies:
            begin, end = max(each.begin, body.begin), min(each.end or np.inf, body.end or np.inf)
            rows = np.flatnonzero((truth["cycle"] >= begin) & (truth["cycle"] < end) & ~stops)
            if not len(rows):
                continue
            depth = -gap(each.wall, capsule, at[capsule.frame][rows], exact=0)
            parts = np.split(depth, np.flatnonzero(np.diff(times[rows])) + 1)
            beyond = np.concatenate([part - np.maximum(np.minimum.accumulate(part), 0) for part in parts])
            k = int(beyond.argmax())
            if beyond[k] > PAST and (worst is None or beyond[k] > worst[0]):
                worst = float(beyond[k]), capsule.frame, int(truth["cycle"][rows[k]])
        if worst is not None:
            link = "hand or what it holds" if worst[1] == FLANGE else f"link {worst[1]}"
            name = f"{each.wall.WhichOneof('shape')} {each.wall.name!r}"
            found.append(Violation("wall", f"{link} {1e3 * worst[0]:.1f} mm past {name} in cycle {worst[2]}"))
    return found


def judge_joints(truth: np.ndarray, limits: wire_limits.Limits) -> list[Violation]:
    """Each true joint position in its range."""
    beyond = np.maximum(truth["q"] - limits.q[1], limits.q[0] - truth["q"])
    worst = np.unravel_index(beyond.argmax(), beyond.shape)
    if beyond[worst] <= ROUNDING:
        return []
    cycle = truth["cycle"][worst[0]]
    return [Violation("joints", f"joint {worst[1] + 1} is {beyond[worst]:.2g} rad outside its range in cycle {cycle}")]


def _lacks(cycles: np.ndarray, phase: np.ndarray) -> np.ndarray:
    """Whether something is missing behind each state but the last: one state in IDLE_STEP is there of an idle arm."""
    steps = np.diff(cycles)
    moving = np.isin(phase, [proto.STARTING, proto.RUNNING, proto.HOLDING, proto.BRAKING])
    in_motion = moving[:-1] & (phase[1:] != proto.READY)
    at_ten = (cycles[1:] - 1) // IDLE_STEP > cycles[:-1] // IDLE_STEP
    return (steps != 1) & (in_motion | at_ten | (steps < 1))


def judge_recordings(folder: Path, skills: list[int], processes: int) -> list[Violation]:
    """Every cycle, every skill and its end, and each crash: of `processes` of the arm that ran one after another.

    `skills`: those that the last of them has started.
    """
    recordings = [Recording(path) for path in sorted(folder.glob("*/*-all*.mcap"))]
    if not recordings:
        return [Violation("recording", "there is none")]
    found = []
    crashes = len(list(folder.glob("*/*-crash-*.mcap")))
    if crashes < processes - 1:
        found.append(Violation("recording", f"{crashes} of {processes - 1} crashes"))
    whole = [recording for recording in recordings if recording.complete]
    if not whole:
        found.append(Violation("recording", f"none of {len(recordings)} has its end"))
    started: set[int] = set()
    ended: set[int] = set()
    for recording in recordings:
        states = recording.states
        if int(recording.about.get("lost", "0")):
            found.append(Violation("recording", f"{recording.about['lost']} states lost"))
        if len(recording):
            missing = np.flatnonzero(_lacks(states["cycles"], states["phase"]))
            if len(missing):
                after, then = states["cycles"][missing[0] : missing[0] + 2]
                found.append(Violation("recording", f"cycles after {after} and before {then} are missing"))
        of_file = {what: {event.skill_id for _, event in recording.skills if event.HasField(what)} for what in ("started", "ended")}
        if recording.complete or processes == 1:
            started |= of_file["started"]
            ended |= of_file["ended"]
    if lacking := started - ended:
        found.append(Violation("recording", f"no end of skills {sorted(lacking)}"))
    if lacking := set(skills) - started:
        found.append(Violation("recording", f"nothing of skills {sorted(lacking)}"))
    return found
