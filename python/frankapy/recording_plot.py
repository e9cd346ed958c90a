"""A recording as a page for people."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from frankapy import proto

if TYPE_CHECKING:
    from frankapy.recording import Recording, States

_MOST_POINTS = 4000  # of a line
_JOINT_COLORS = ["#4477aa", "#66ccee", "#228833", "#ccbb44", "#ee6677", "#aa3377", "#777777"]
_SHADES = {"skill": "#eef3fa", "error": "#d62728"}
_HELD_BY = {
    proto.MOTION_LIMITS: ("motion limits", "#f5a623"),
    proto.TORQUE_LIMITS: ("torque limits", "#8c564b"),
    proto.JOINT_LIMITS: ("joint limits", "#e377c2"),
    proto.WALL: ("a wall", "#2ca02c"),
    proto.HELD_ARM: ("a held arm", "#9467bd"),
    proto.ITSELF: ("the arm itself", "#17becf"),
    proto.TOOL_SPEED: ("the tool's greatest speed", "#d62728"),
    proto.POWER: ("the greatest power", "#7f7f7f"),
}


def page(recording: Recording) -> Figure:
    """Return the page; `figure.savefig` writes it as PNG or PDF."""
    states = recording.states
    figure = Figure(figsize=(15, 12), layout="constrained")
    about = recording.about
    figure.suptitle(
        f"{about.get('arm', 'arm')}: {about.get('why', '')}, {np.datetime64(int(recording.start * 1e3), 'ms')} UTC, "
        f"{states['time'][-1]:.1f} s" if len(recording) else "an empty recording"
    )  # fmt: skip
    if not len(recording):
        return figure
    grid = figure.add_gridspec(4, 3, width_ratios=[1, 1, 0.9], height_ratios=[1, 1, 1, 0.5])
    first = figure.add_subplot(grid[0, 0])
    axes = {
        "q": first,
        "tau": figure.add_subplot(grid[0, 1], sharex=first),
        "dq": figure.add_subplot(grid[1, 0], sharex=first),
        "tau_ext": figure.add_subplot(grid[1, 1], sharex=first),
        "position": figure.add_subplot(grid[2, 0], sharex=first),
        "force": figure.add_subplot(grid[2, 1], sharex=first),
        "timing": figure.add_subplot(grid[3, :2], sharex=first),
    }
    every = max(1, len(recording) // _MOST_POINTS)
    time = states["time"][::every]

    def lines(axis: Any, values: np.ndarray, names: list[str], colors: list[str], **style: Any) -> None:
        for i, name in enumerate(names):
            axis.plot(time, values[::every, i], color=colors[i], label=name, linewidth=1, **style)

    joints = [f"{i + 1}" for i in range(7)]
    lines(axes["q"], states["q"], joints, _JOINT_COLORS)
    reference = states.get("q_ref")
    if reference is not None:
        lines(axes["q"], reference, ["" for _ in joints], ["black"] * 7, linestyle=":")
    axes["q"].set_title("joint positions, rad (dotted: commanded)")
    axes["q"].legend(ncol=7, fontsize="x-small", loc="upper center", handlelength=1)
    lines(axes["dq"], states["dq"], joints, _JOINT_COLORS)
    axes["dq"].set_title("joint velocities, rad/s")
    lines(axes["tau"], states["tau_J"], joints, _JOINT_COLORS)
    axes["tau"].set_title("joint torques, N m")
    lines(axes["tau_ext"], states["tau_ext_hat_filtered"], joints, _JOINT_COLORS)
    axes["tau_ext"].set_title("external torques, as estimated, N m")
    position = states["O_T_EE"][:, 12:15]
    colors = ["#d62728", "#2ca02c", "#1f77b4"]
    lines(axes["position"], position, ["x", "y", "z"], colors)
    axes["position"].set_title("tool in the base frame, m")
    axes["position"].legend(ncol=3, fontsize="x-small", handlelength=1)
    force = states["O_F_ext_hat_K"][:, :3]
    lines(axes["force"], force, ["x", "y", "z"], colors)
    axes["force"].plot(time, np.linalg.norm(force, axis=1)[::every], color="black", linewidth=0.8, label="norm")
    axes["force"].set_title("external force on the tool, as estimated, N")
    axes["force"].legend(ncol=4, fontsize="x-small", handlelength=1)
    _timing(axes["timing"], recording)
    for name in ("position", "force"):
        axes[name].set_xlabel("s")
    for axis in axes.values():
        _shade(axis, recording)
        axis.grid(visible=True, alpha=0.3)
        axis.tick_params(labelsize="small")
    first.set_xlim(states["time"][0], states["time"][-1])

    path = figure.add_subplot(grid[:2, 2], projection="3d")
    path.plot(*position[::every].T, color="#4477aa", linewidth=1)
    path.scatter(*position[0], color="#228833", label="begin")
    path.scatter(*position[-1], color="#d62728", label="end")
    path.set_title("path of the tool, m")
    path.set_aspect("equal", adjustable="datalim")
    path.legend(fontsize="small")
    text = figure.add_subplot(grid[2:, 2])
    text.axis("off")
    rows = [f"{name}:  {value}" for name, value in recording.summary()]
    shown = rows[:24] + ([f"... and {len(rows) - 24} more: frankapy info"] if len(rows) > 24 else [])
    text.text(0, 1, "\n".join(_cut(row, 76) for row in shown), va="top", family="monospace", fontsize=6.5, transform=text.transAxes)
    return figure


def _cut(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 1] + "…"


def _spans(time: np.ndarray, on: np.ndarray) -> list[tuple[float, float]]:
    """From when to when something was on."""
    edges = np.diff(np.concatenate([[0], on.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(float(time[a]), float(time[min(b, len(time) - 1)])) for a, b in zip(starts.tolist(), ends.tolist(), strict=True)]


def _is_in_error(states: States) -> np.ndarray:
    return np.isin(states["phase"], [proto.ERROR, proto.RECOVERING])


def _shade(axis: Any, recording: Recording) -> None:
    states = recording.states
    for begin, end in _spans(states["time"], states["skill_id"] > 0)[:500]:
        axis.axvspan(begin, end, color=_SHADES["skill"], zorder=-3, linewidth=0)
    for begin, end in _spans(states["time"], _is_in_error(states))[:500]:
        axis.axvspan(begin, end, color=_SHADES["error"], alpha=0.15, zorder=-2, linewidth=0)


def _timing(axis: Any, recording: Recording) -> None:
    states = recording.states
    time = states["time"]
    computed = states["compute_us"] > 0
    axis.plot(time[computed], states["compute_us"][computed], ".", markersize=1.5, color="#777777", label="computing, µs")
    axis.set_yscale("symlog", linthresh=100)
    top = axis.get_ylim()[1]
    for place, (bit, (why, colour)) in enumerate(_HELD_BY.items()):
        spans = _spans(time, recording.held_by & bit > 0)[:500]
        for begin, end in spans:
            axis.axvspan(begin, end, 0.04 * place, 0.04 * place + 0.03, color=colour, linewidth=0)
        if spans:
            axis.plot([], [], "s", color=colour, label=f"held back by {why}")
    late = recording.late
    axis.plot(late, np.full(len(late), top), "v", color=_SHADES["error"], markersize=4, label=f"late cycle ({len(late)})")
    missed = time[1:][np.diff(states["lost_states"]) > 0]
    axis.plot(missed, np.full(len(missed), top), "x", color="#aa3377", markersize=5, label=f"state lost ({len(missed)})")
    axis.plot([], [], "s", color=_SHADES["skill"], label="a skill")
    axis.plot([], [], "s", color=_SHADES["error"], alpha=0.3, label="error")
    axis.set_title("the loop", fontsize="medium")
    axis.set_xlabel("s")
    axis.legend(ncol=3, fontsize="x-small", loc="upper left")
