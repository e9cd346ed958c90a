"""Times and durations as rospy has them: seconds and nanoseconds of this computer's clock."""

from __future__ import annotations

import functools
import numbers
import time
from typing import Any

_BILLION = 1_000_000_000


@functools.total_ordering
class _Value:
    """A count of nanoseconds."""

    def __init__(self, secs: float = 0, nsecs: int = 0) -> None:
        whole = int(secs) * _BILLION if isinstance(secs, numbers.Integral) else round(float(secs) * _BILLION)
        self._ns = whole + int(nsecs)

    @classmethod
    def from_sec(cls, float_secs: float) -> Any:
        """Make one of so many seconds."""
        return cls(float(float_secs))

    @classmethod
    def from_seconds(cls, float_secs: float) -> Any:
        """Make one of so many seconds."""
        return cls.from_sec(float_secs)

    @property
    def secs(self) -> int:
        """Whole seconds."""
        return self._ns // _BILLION

    @property
    def nsecs(self) -> int:
        """What is left of a second, ns."""
        return self._ns % _BILLION

    def to_sec(self) -> float:
        """Return it in seconds."""
        return self._ns / _BILLION

    def to_nsec(self) -> int:
        """Return it in nanoseconds."""
        return self._ns

    def is_zero(self) -> bool:
        """Return whether it is zero."""
        return self._ns == 0

    def __bool__(self) -> bool:
        return self._ns != 0

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._ns == other._ns  # type: ignore[attr-defined]

    def __lt__(self, other: _Value) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return self._ns < other._ns

    def __hash__(self) -> int:
        return hash((type(self), self._ns))

    def __repr__(self) -> str:
        return f"rospy.{type(self).__name__}[{self._ns}]"

    def __str__(self) -> str:
        return str(self._ns)

    def _of(self, kind: type[_Value], ns: float) -> Any:
        return kind(0, round(ns))


class Duration(_Value):
    """A length of time."""

    def __neg__(self) -> Duration:
        return self._of(Duration, -self._ns)

    def __abs__(self) -> Duration:
        return self._of(Duration, abs(self._ns))

    def __add__(self, other: _Value) -> Any:
        return self._of(type(other), self._ns + other._ns) if isinstance(other, _Value) else NotImplemented

    def __sub__(self, other: Duration) -> Duration:
        return self._of(Duration, self._ns - other._ns) if isinstance(other, Duration) else NotImplemented

    def __mul__(self, factor: float) -> Duration:
        return self._of(Duration, self._ns * factor)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        return self._ns / other._ns if isinstance(other, Duration) else self._of(Duration, self._ns / other)


class Time(_Value):
    """A point in time, since 1970."""

    @classmethod
    def now(cls) -> Time:
        """Return the time now."""
        return cls(0, time.time_ns())

    def to_time(self) -> float:
        """Return it in seconds."""
        return self.to_sec()

    def __add__(self, other: Duration) -> Time:
        return self._of(Time, self._ns + other._ns) if isinstance(other, Duration) else NotImplemented

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, Time):
            return self._of(Duration, self._ns - other._ns)
        return self._of(Time, self._ns - other._ns) if isinstance(other, Duration) else NotImplemented


def get_rostime() -> Time:
    """Return the time now."""
    return Time.now()


def get_time() -> float:
    """Return the time now, s since 1970."""
    return time.time()
