"""Recordings of an arm, as franka-interface writes them: reading them into arrays, exporting and plotting them.

They are MCAP files with protobuf messages, which other programs (Foxglove, `mcap`) open as well.
"""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from google.protobuf.message import Message

from frankapy import proto
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.progress import progress
from frankapy.recording_file import RecordingFile
from frankapy.wire_arrays import columns
from frankapy.writing import writing_to

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STATES, _SKILLS, _LOG, _CLOCKS, _SENSORS = "/states", "/skills", "/log", "/clocks", "/sensors/"
_LATE = 0.0015  # s from one state to the next from which on a cycle came late
_DRIFT = 1e-3  # of a robot's clock against the server's; one that differs by more goes by another time, as a simulated arm's may
_LONG = 10.0  # s in which a clock's drift shows

States = dict[str, np.ndarray]


@dataclasses.dataclass
class Noted:
    """A message beside the states."""

    time: float  # s since the recording began
    topic: str
    kind: str  # of the message, without its package
    sequence: int
    sent: float  # s since the recording began, by the server's clock: see Recording.clocks
    data: bytes

    @functools.cached_property
    def message(self) -> Message:
        """The message; raises FrankaArmArgumentError for one of a kind that this frankapy does not know."""
        kind = getattr(proto, self.kind, None)
        if kind is None:
            raise FrankaArmArgumentError(f"{self.topic} has {self.kind}, a message that this frankapy does not know")
        message: Message = kind.FromString(self.data)
        return message


class Recording:
    """A recording, read when it is made; one that was cut off is read as far as it goes, and without what is damaged (`damaged`).

    Times are seconds since its first message; `start` is when that was, in seconds since 1970 by the server's clock. Of what
    was sent to the server they are the sender's, less what its clock was ahead (`clocks`).

    Example:
        >>> recording = Recording("2026-11-22T14-53-10.123Z-skill.mcap")
        >>> recording.states["q"]  # (n, 7)
    """

    def __init__(self, path: str | Path) -> None:
        """Read a file; raises FrankaArmArgumentError where it cannot be read, or is no MCAP file."""
        file = RecordingFile(path)
        self.path = file.path
        self.about = file.about
        self.complete = file.complete
        self.damaged = file.damaged
        first = min([*file.times[:1], *(entry[0] for entry in file.noted)], default=0)
        self.start = first * 1e-9
        self._raw = file.states
        self._times = (np.array(file.times, dtype=np.int64) - first) * 1e-9
        self.noted = [
            Noted((time - first) * 1e-9, topic, kind, sequence, (sent - first) * 1e-9, data)
            for time, sent, topic, kind, sequence, data in sorted(file.noted, key=lambda entry: entry[0])
        ]

    @functools.cached_property
    def states(self) -> States:
        """All states as arrays, one row each: "time" (s), the robot's own under libfranka's names ("q", "tau_J", "O_T_EE"...),
        the server's ("phase", "skill_id", "q_ref", "limited", "compute_us"...) and what was sent ("command.tau_J_d"...).

        What a state does not have is NaN, or 0 of integers.
        """
        found = columns(proto.ArmState.DESCRIPTOR, self._raw)  # type: ignore[arg-type]
        states = {name.removeprefix("robot."): values for name, values in found.items()}
        return {"time": self._times} | states

    @property
    def skills(self) -> list[tuple[float, proto.SkillEvent]]:
        """What happened to skills, with the times."""
        return [(noted.time, noted.message) for noted in self.noted if noted.topic == _SKILLS]  # type: ignore[misc]

    @property
    def log(self) -> list[tuple[float, str, str]]:
        """The server's log: time, level, text."""
        return [
            (noted.time, noted.message.level, noted.message.text)  # type: ignore[attr-defined]
            for noted in self.noted
            if noted.topic == _LOG
        ]

    @property
    def sensors(self) -> dict[str, list[Noted]]:
        """What came over each sensor topic."""
        topics: dict[str, list[Noted]] = {}
        for noted in self.noted:
            if noted.topic.startswith(_SENSORS):
                topics.setdefault(noted.topic.removeprefix(_SENSORS), []).append(noted)
        return topics

    @property
    def clocks(self) -> dict[str, tuple[float, float]]:
        """Senders' clocks: by how much (s) each was ahead of the server's when last looked at, and how uncertain that is.

        Senders are "client NAME" and "topic NAME", a second publisher of a topic "topic NAME (2)". Where a sender does not know how
        long its messages take, the uncertainty is NaN, and it seems behind by that much.
        """
        found: dict[str, tuple[float, float]] = {}
        publishers: dict[str, list[int]] = {}
        for noted in self.noted:
            if noted.topic != _CLOCKS:
                continue
            told: proto.ClockDifference = noted.message  # type: ignore[assignment]
            name = f"client {told.sender}"
            if told.HasField("publisher"):
                known = publishers.setdefault(told.sender, [])
                if told.publisher not in known:
                    known.append(told.publisher)
                number = known.index(told.publisher)
                name = f"topic {told.sender}" + (f" ({number + 1})" if number else "")
            found[name] = told.ahead, told.uncertain if told.HasField("uncertain") else np.nan
        return found

    @functools.cached_property
    def robot_clock(self) -> tuple[float, float] | None:
        """When the robot's clock (`message_id`) began, s since the recording did, and how many seconds of the server each ms takes.

        So that no state came before it was measured, and the quickest took no time. None where the robot's time is another, as of
        a simulated arm in lockstep.
        """
        if len(self) < 2:
            return None
        time, clock = self._times, self.states["message_id"].astype(float)
        if np.any(np.diff(clock) <= 0):  # it has begun anew
            return None
        parts = np.array_split(np.arange(len(self)), max(2, min(60, len(self) // 1000)))
        lowest = [part[np.argmin((time - 1e-3 * clock)[part])] for part in parts]
        second = float(np.polyfit(clock[lowest] - clock[0], time[lowest], 1)[0])
        if abs(second / 1e-3 - 1) > _DRIFT:
            return None
        if time[-1] - time[0] < _LONG:
            second = 1e-3
        return float((time - second * clock).min()), second

    @property
    def measured(self) -> np.ndarray:
        """When the robot measured each state, s since the recording began: by its own, even clock, put beside the server's.

        Where the robot's time is another (`robot_clock`), when the states came.
        """
        if self.robot_clock is None:
            return self._times
        began, second = self.robot_clock
        return began + second * self.states["message_id"].astype(float)

    @property
    def errors(self) -> list[tuple[float, str]]:
        """Errors of the robot: when each began, and its name."""
        found = []
        before: set[str] = set()
        names = self.states.get("errors")
        for time, now in zip(self._times, names if names is not None else [], strict=False):
            if now or before:
                found += [(float(time), name) for name in now if name not in before]
                before = set(now)
        return found

    @property
    def held_by(self) -> np.ndarray:
        """What held motions back: bits of proto.HeldBy for each state; 0 where a recording is older than they."""
        return self.states.get("held_by", np.zeros(len(self))).astype(int)

    @property
    def late(self) -> np.ndarray:
        """Times (s) of states that came more than half a cycle late."""
        time, phase = self._times, self.states["phase"]
        moving = (phase[1:] != proto.READY) & (phase[:-1] != proto.READY)
        return time[1:][moving & (np.diff(time) > _LATE)]

    def __len__(self) -> int:
        return len(self._raw)

    def __repr__(self) -> str:
        duration = float(self._times[-1]) if len(self) else 0.0
        return f"Recording({self.path.name}: {duration:.3f} s, {len(self)} states{'' if self.complete else ', cut off'})"

    # --- to other formats ---

    def export(self, path: str | Path) -> Path:
        """Write the states to a file that other programs read, .csv or .parquet by its name; vectors become columns q_0, q_1, ...

        Raises FrankaArmArgumentError for another name, or where nothing can be written.
        """
        path = Path(path)
        if path.suffix not in (".csv", ".parquet"):
            raise FrankaArmArgumentError(f"export to {path}: expected a name that ends in .csv or .parquet")
        try:
            import pyarrow
            import pyarrow.csv
            import pyarrow.parquet
        except ImportError:
            raise FrankaArmArgumentError(
                "Exports are written with pyarrow, which is not there: pip install 'frankapy[recordings]'"
            ) from None
        table: dict[str, Any] = {}
        for name, values in self.states.items():
            if values.dtype == object:
                table[name] = [", ".join(row) for row in values]
            elif values.ndim == 1:
                table[name] = values
            else:
                table |= {f"{name}_{i}": np.ascontiguousarray(values[:, i]) for i in range(values.shape[1])}
        batch = pyarrow.table(table)
        rows = 100_000
        with writing_to(path), progress(len(self), f"writing {path.name}", unit="states") as bar:
            writer: Any = (
                pyarrow.csv.CSVWriter(path, batch.schema)
                if path.suffix == ".csv"
                else pyarrow.parquet.ParquetWriter(path, batch.schema, compression="zstd")
            )
            with writer:
                for first in range(0, max(len(self), 1), rows):
                    part = batch.slice(first, rows)
                    writer.write_table(part)
                    bar.update(part.num_rows)
        return path

    # --- for people ---

    def summary(self) -> list[tuple[str, str]]:
        """What is in it, line by line: a name and a text."""
        duration = float(self._times[-1]) if len(self) else 0.0
        rows = [("arm", self.about.get("arm", "not named")), ("because of", self.about.get("why", "not said"))]
        if len(self) or self.noted:
            rows.append(("begins", f"{np.datetime64(int(self.start * 1e3), 'ms')} UTC"))
        cut_off = "" if self.complete or self.damaged else "; it was cut off"
        rows.append(("takes", f"{duration:.3f} s, {len(self)} states{cut_off}"))
        if self.damaged:
            rows.append(("damaged", f"{self.damaged} parts of the file cannot be read: what happened then is missing"))
        lost = int(self.about.get("lost", "0"))
        if lost:
            rows.append(("lost", f"{lost} states: the disk was too slow"))
        lost_bytes = int(self.about.get("lost_bytes", "0"))
        if lost_bytes:
            what = f"{lost_bytes / 1e3:.0f} kB of sensor messages, skills and log lines"
            rows.append(("lost", f"{what}: the disk was too slow, or they were of more than 1000 topics"))
        if len(self):
            states = self.states
            missed = int(states["lost_states"][-1] - states["lost_states"][0])
            held = [
                f"{np.count_nonzero(self.held_by & bit)} by {name.lower().replace('_', ' ')}"
                for name, bit in proto.HeldBy.items()
                if (self.held_by & bit).any()
            ]
            held_back = f"{int(states['limited'].sum())} held back" + (f" ({', '.join(held)})" if held else "")
            if self.robot_clock is not None:
                _, second = self.robot_clock
                behind = float(np.percentile(self._times - self.measured, 99))
                drift = f"{1e6 * (1e-3 / second - 1):+.0f} ppm, " if second != 1e-3 else ""
                rows.append(("robot's clock", f"{drift}99 of 100 states came within {1e3 * behind:.2f} ms of the quickest"))
            rows.append(("cycles", f"{len(self.late)} late, {missed} states did not arrive, {held_back}"))
        for sender, (ahead, uncertain) in self.clocks.items():
            about = "" if np.isnan(uncertain) else f" (± {1e3 * uncertain:.2f} ms)"
            difference = f"{1e3 * abs(ahead):.2f} ms {'ahead' if ahead > 0 else 'behind'}{about}"
            rows.append(("clock", f"{sender}: {difference}; its times here are the server's"))
        descriptions = {event.skill_id: event.started.description for _, event in self.skills if event.HasField("started")}
        for time, event in self.skills:
            what = event.WhichOneof("what")
            name = f"skill {event.skill_id} {descriptions.get(event.skill_id, '')}".rstrip()
            if what == "ended":
                result = event.ended
                end = proto.Ending.Name(result.ending).lower().replace("_", " ")
                by = f" by {result.termination}" if result.termination else ""
                rows.append((f"{time:9.3f} s", f"{name} {end}{by} after {result.time:.3f} s{': ' if result.message else ''}{result.message}"))
            else:
                skill = event.started if what == "started" else event.changed
                parts = [skill.trajectory, skill.controller, *skill.terminations]
                rows.append((f"{time:9.3f} s", f"{name} {what}: {', '.join(part.TypeName().rsplit('.', 1)[-1] for part in parts if part.type_url)}"))
        rows += [(f"{time:9.3f} s", f"error {name}") for time, name in self.errors]
        for topic, messages in self.sensors.items():
            kinds = ", ".join(sorted({noted.kind for noted in messages}))
            span = messages[-1].time - messages[0].time
            rate = f", {(len(messages) - 1) / span:.0f} Hz" if span > 0 else ""
            rows.append(("sensor", f"{topic}: {len(messages)} {kinds}{rate}"))
        return rows

    def plot(self) -> Figure:
        """Return a page for people: joints, torques, the tool's path, forces, and what held the arm back."""
        from frankapy.recording_plot import page

        return page(self)

    def motion(self) -> np.ndarray:
        """Return joint positions (n, 7), rad, one for each ms of what the arm did, from its first motion to its last.

        Those that were commanded where joints were, else the measured ones, smoothed over 50 ms. Raises FrankaArmArgumentError
        where the arm did not move.
        """
        states = self.states
        moving = np.flatnonzero(np.isin(states["phase"], [proto.RUNNING, proto.HOLDING, proto.BRAKING]))
        if len(moving) < 2 or float(np.ptp(states["q"][moving], axis=0).max()) < 1e-3:
            raise FrankaArmArgumentError(f"{self.path.name}: the arm does not move in it")
        span = slice(moving[0], moving[-1] + 1)
        # By the robot's clock, which goes on by 1 ms a state.
        clock = states["message_id"][span].astype(float) * 1e-3
        if np.any(np.diff(clock) <= 0):
            raise FrankaArmArgumentError(f"{self.path.name}: the robot was started anew in it, between motions: they are not one")
        steady = np.arange(clock[0], clock[-1] + 5e-4, 1e-3)
        reference = states.get("q_ref")
        if reference is not None and np.isfinite(reference[span]).all():
            q, window = reference[span], 0
        else:
            q, window = states["q"][span], 51
        path = np.stack([np.interp(steady, clock, q[:, i]) for i in range(7)], axis=1)
        if window and len(path) > window:
            # Twice a moving average, with the ends held so that they stay where they are.
            for _ in range(2):
                held = np.concatenate([np.repeat(path[:1], window // 2, 0), path, np.repeat(path[-1:], window // 2, 0)])
                sums = np.cumsum(np.concatenate([np.zeros((1, 7)), held]), axis=0)
                path = (sums[window:] - sums[:-window]) / window
        return path
