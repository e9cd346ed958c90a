"""What bounds an arm's motions: the range and speed of its joints, and how far below them a lab, a script or people's nearness
keeps it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from frankapy import proto
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.validation import number, validate


@dataclasses.dataclass(frozen=True)
class BodyRegion:
    """What a part of the body bears when it is hit and can give way."""

    force: float  # N, greatest in transient contact
    stiffness: float  # N/m
    mass: float  # kg, effective


# ISO/TS 15066:2016, annex A: forces of table A.2 (twice the quasi-static ones), spring constants and effective masses of table
# A.3. Skull, forehead and face are not among them: there no transient contact is permissible.
BODY_REGIONS = {
    "neck": BodyRegion(300, 50e3, 1.2),
    "back": BodyRegion(420, 35e3, 40),
    "chest": BodyRegion(280, 25e3, 40),
    "abdomen": BodyRegion(220, 10e3, 40),
    "pelvis": BodyRegion(360, 25e3, 40),
    "upper arm": BodyRegion(300, 30e3, 3),
    "forearm": BodyRegion(320, 40e3, 2),
    "hand": BodyRegion(280, 75e3, 0.6),
    "thigh": BodyRegion(440, 50e3, 75),
    "lower leg": BodyRegion(260, 60e3, 75),
}
SHARED_SPACE_POWER = 80.0  # W: dynamic power for collaborative operation in ISO 10218-1:2006, 5.10.5 (later editions name none)


def contact_speed(region: str, moving_mass: float, load: float) -> float:
    """Return the greatest speed (m/s) at which an arm may hit a region of the body, one of BODY_REGIONS.

    By ISO/TS 15066, A.3.4: v = F / sqrt(mu k), 1/mu = 1/m_H + 1/m_R, m_R = moving_mass / 2 + load; of a blunt contact, whose
    pressure is not judged.

    Args:
        region: of the body.
        moving_mass: of the arm, kg.
        load: hand and what it holds, kg.

    """
    if region not in BODY_REGIONS:
        raise FrankaArmArgumentError(f"region is {region!r}: expected one of {', '.join(BODY_REGIONS)}; the head must not be hit")
    body = BODY_REGIONS[region]
    robot = number("moving_mass", moving_mass) / 2 + number("load", load)
    if not robot > 0:
        raise FrankaArmArgumentError(f"moving_mass / 2 + load is {robot:g} kg: expected more than 0")
    reduced = body.mass * robot / (body.mass + robot)
    return float(body.force / np.sqrt(reduced * body.stiffness))


def _bound(name: str, text: str) -> property:
    """Return one that can be reduced."""

    def now(limits: Limits) -> float:
        return float(getattr(limits.now, name))

    def reduce(limits: Limits, value: float) -> None:
        limits.update(**{name: value})

    return property(now, reduce, doc=text)


def _checked(limits: dict[str, float]) -> proto.Limits:
    unknown = set(limits) - set(proto.Limits.DESCRIPTOR.fields_by_name)
    if unknown:
        raise FrankaArmArgumentError(
            f"{', '.join(sorted(unknown))}: expected some of {', '.join(proto.Limits.DESCRIPTOR.fields_by_name)}"
        )
    given: dict[str, Any] = {name: number(name, value) for name, value in limits.items()}
    checked = proto.Limits(**given)
    validate(checked)
    return checked


class Limits:
    """The limits of an arm, as `fa.limits`.

    `velocity`, `acceleration`, `jerk` and `torque` are shares of the robot's own, 0.01 to 1; `tool_speed` is of the tool (m/s),
    `power` of the joints (W). Each can be set, up to what the robot and the server's configuration allow (`most`), at any time: a
    motion that runs is slowed inside the arm's limits and goes on. What is set holds for every client until it is set again or
    the arm's server is started anew.

    Example:
        >>> fa.limits.velocity = 0.3
        >>> fa.limits.update(tool_speed=0.25, power=80)
        >>> fa.limits.share_space("hand", "forearm")
        >>> fa.limits.reset()
    """

    __slots__ = ("_change", "_robot", "_welcome")  # a name that is misspelt reduces nothing

    velocity = _bound("velocity", "Of joints and poses, a share of the robot's own, 0.01 to 1.")
    acceleration = _bound("acceleration", "The same.")
    jerk = _bound("jerk", "The same.")
    torque = _bound("torque", "Of the server's controllers, beside gravity, a share of the robot's own, 0.01 to 1.")
    tool_speed = _bound("tool_speed", "Of the origin of EE, m/s.")
    power = _bound("power", "Of the joints together, beside gravity and friction, W.")

    def __init__(
        self,
        welcome: proto.Welcome,
        change: Callable[[proto.ChangeLimits], proto.LimitsInForce],
        robot: Callable[[], proto.RobotState],
    ) -> None:
        """Speak with a server through `change`; `robot` gives the arm's state."""
        self._welcome, self._change, self._robot = welcome, change, robot

    @property
    def q_min(self) -> np.ndarray:
        """The lower ends of the joints' ranges, rad, (7,)."""
        return np.array(self._welcome.limits.q_min)

    @property
    def q_max(self) -> np.ndarray:
        """The upper ends of the joints' ranges, rad, (7,)."""
        return np.array(self._welcome.limits.q_max)

    @property
    def rest_min(self) -> np.ndarray:
        """The lower ends of where motions may end, rad, (7,)."""
        return np.array(self._welcome.limits.rest_min)

    @property
    def rest_max(self) -> np.ndarray:
        """The upper ends of where motions may end, rad, (7,)."""
        return np.array(self._welcome.limits.rest_max)

    @property
    def dq_max(self) -> np.ndarray:
        """The greatest velocities of the joints that the server's configuration allows, rad/s, (7,)."""
        return np.array(self._welcome.limits.dq_max)

    @property
    def now(self) -> proto.Limits:
        """What is in force."""
        return self._change(proto.ChangeLimits()).now

    @property
    def most(self) -> proto.Limits:
        """The most that may be set."""
        return self._change(proto.ChangeLimits()).most

    def update(self, **limits: float) -> None:
        """Set some of them at once: all or none. Raises FrankaArmArgumentError for one that is above `most`."""
        self._change(proto.ChangeLimits(limits=_checked(limits)))

    def allow(self, **limits: float) -> None:
        """Set some of `most` at once, in place of the server's configuration: what everybody may ask for from now on.

        Needs the role lab (docs/keys.md), and no lease. At most what the robot allows, and of velocity, acceleration and jerk the
        configuration. Raises FrankaArmNotPermittedException, or FrankaArmArgumentError for more.
        """
        self._change(proto.ChangeLimits(most=_checked(limits)))

    def reset(self) -> None:
        """Set all of them to `most`."""
        self._change(proto.ChangeLimits(reset=True))

    def share_space(self, *regions: str) -> None:
        """Reduce `tool_speed` and `power` for a space that is shared with people, below what they are and never above.

        The tool's speed is that at which it may hit these regions of the body (of BODY_REGIONS; none: all of them) with the mass
        of this arm and its load, by ISO/TS 15066; the power is SHARED_SPACE_POWER. This is no certified safety function: see
        docs/limits.md.
        """
        robot = self._robot()
        speeds = [contact_speed(region, self._welcome.moving_mass, robot.m_ee + robot.m_load) for region in regions or BODY_REGIONS]
        now = self.now
        self.update(tool_speed=min(now.tool_speed, *speeds), power=min(now.power, SHARED_SPACE_POWER))

    def __repr__(self) -> str:
        """Return what is in force."""
        texts = [f"{field.name}={value:g}" for field, value in self.now.ListFields()]
        return f"Limits({', '.join(texts)})"
