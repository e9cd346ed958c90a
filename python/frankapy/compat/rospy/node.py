"""The life of a node: name, shutdown, sleeping, timers, log lines."""

from __future__ import annotations

import atexit
import dataclasses
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from frankapy.interrupts import stop_on_interrupt

from .rostime import Duration, Time

DEBUG, INFO, WARN, ERROR, FATAL = 1, 2, 4, 8, 16


class ROSException(Exception):
    """Root of what rospy raises."""


class ROSInitException(ROSException):
    """A node that cannot be."""


class ROSInterruptException(ROSException, KeyboardInterrupt):
    """Sleeping ended, as the node does."""


class _Node:
    name = "/unnamed"
    level = INFO
    initialized = False
    ended = threading.Event()
    interrupted = False  # by Ctrl-C: hooks are for the end of the program, not for a signal handler
    hooks: list[Callable[[], None]] = []
    once: set[tuple[Any, ...]] = set()

    @classmethod
    def stop_commands(cls) -> None:
        """Let what runs beside the main thread see that the node is to end, which that sees by KeyboardInterrupt."""
        cls.interrupted = True


stop_on_interrupt(_Node)


def init_node(name: str, argv: Any = None, anonymous: bool = False, log_level: int | None = None, **_: Any) -> None:
    """Give this program a name; Ctrl-C ends what sleeps with ROSInterruptException."""
    if not name or "/" in name.strip("/"):
        raise ValueError(f"{name!r} is no name of a node")
    _Node.name = f"/{name.strip('/')}" + (f"_{time.time_ns() // 1_000_000}" if anonymous else "")
    _Node.level = INFO if log_level is None else log_level
    _Node.initialized = True


def get_name() -> str:
    """Return the node's name."""
    return _Node.name


def get_caller_id() -> str:
    """Return the node's name."""
    return _Node.name


def is_shutdown() -> bool:
    """Return whether the node is to end."""
    return _Node.interrupted or _Node.ended.is_set()


def on_shutdown(hook: Callable[[], None]) -> None:
    """Call `hook` when the node ends."""
    _Node.hooks.append(hook)


@atexit.register
def _end() -> None:
    signal_shutdown("the program ends")


def signal_shutdown(reason: str = "") -> None:
    """End the node."""
    if _Node.ended.is_set():
        return
    _Node.ended.set()
    while _Node.hooks:
        _Node.hooks.pop(0)()


def sleep(duration: float | Duration) -> None:
    """Sleep for s, or a Duration. Raises ROSInterruptException when the node ends."""
    seconds = duration.to_sec() if isinstance(duration, Duration) else float(duration)
    if is_shutdown():
        raise ROSInterruptException("the node has ended")
    try:
        time.sleep(max(0.0, seconds))
    except KeyboardInterrupt as interrupt:
        signal_shutdown("Ctrl-C")
        raise ROSInterruptException("Ctrl-C") from interrupt


def spin() -> None:
    """Wait until the node ends."""
    try:
        while not is_shutdown():
            _Node.ended.wait(0.1)
    except KeyboardInterrupt:
        signal_shutdown("Ctrl-C")


class Rate:
    """Sleeps so that a loop runs at a rate."""

    def __init__(self, hz: float, reset: bool = False) -> None:
        """Begin now; `hz` > 0."""
        if not hz > 0:
            raise ValueError(f"hz is {hz}: expected more than 0")
        self.sleep_dur = Duration.from_sec(1.0 / hz)
        self._next = time.monotonic()

    def remaining(self) -> Duration:
        """Return what is left of this turn."""
        return Duration.from_sec(max(0.0, self._next + self.sleep_dur.to_sec() - time.monotonic()))

    def sleep(self) -> None:
        """Sleep until the next turn; a turn that was missed by more than one is not made up for."""
        period = self.sleep_dur.to_sec()
        self._next += period
        late = time.monotonic() - self._next
        if late > period:
            self._next += late
        sleep(max(0.0, -late))


@dataclasses.dataclass
class TimerEvent:
    """When a timer was to call, and did."""

    last_expected: Time | None
    last_real: Time | None
    current_expected: Time
    current_real: Time
    last_duration: float | None


class Timer(threading.Thread):
    """Calls a function at a rate, in a thread of its own."""

    def __init__(
        self, period: Duration, callback: Callable[[TimerEvent], Any], oneshot: bool = False, reset: bool = False
    ) -> None:
        """Begin now."""
        super().__init__(daemon=True)
        self._period, self._callback, self._oneshot = period, callback, oneshot
        self._stop_asked = threading.Event()
        self.start()

    def shutdown(self) -> None:
        """Call no more."""
        self._stop_asked.set()

    def run(self) -> None:
        """Call until shutdown."""
        last_expected = last_real = None
        last_duration = None
        expected = Time.now() + self._period
        while not (self._stop_asked.wait(max(0.0, (expected - Time.now()).to_sec())) or is_shutdown()):
            real = Time.now()
            self._callback(TimerEvent(last_expected, last_real, expected, real, last_duration))
            if self._oneshot:
                return
            last_duration = (Time.now() - real).to_sec()
            last_expected, last_real = expected, real
            expected += self._period


def _logger(level: int, title: str, stream: str) -> Any:
    def log(message: Any, *arguments: Any, **_: Any) -> None:
        if level >= _Node.level:
            text = str(message) % arguments if arguments else str(message)
            print(f"[{title}] [{time.time():.6f}]: {text}", file=getattr(sys, stream), flush=True)

    def once(message: Any, *arguments: Any, **_: Any) -> None:
        place = (level, sys._getframe(1).f_code, sys._getframe(1).f_lineno)
        if place not in _Node.once:
            _Node.once.add(place)
            log(message, *arguments)

    last: dict[Any, float] = {}

    def throttle(period: float, message: Any, *arguments: Any, **_: Any) -> None:
        place = (sys._getframe(1).f_code, sys._getframe(1).f_lineno)
        if time.monotonic() - last.get(place, -period) >= period:
            last[place] = time.monotonic()
            log(message, *arguments)

    return log, once, throttle


logdebug, logdebug_once, logdebug_throttle = _logger(DEBUG, "DEBUG", "stdout")
loginfo, loginfo_once, loginfo_throttle = _logger(INFO, "INFO", "stdout")
logwarn, logwarn_once, logwarn_throttle = _logger(WARN, "WARN", "stderr")
logerr, logerr_once, logerr_throttle = _logger(ERROR, "ERROR", "stderr")
logfatal, logfatal_once, logfatal_throttle = _logger(FATAL, "FATAL", "stderr")
