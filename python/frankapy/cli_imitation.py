"""The commands from a hand to a motion: frankapy demonstrate, segment, learn, imitate (docs/imitation.md)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from frankapy.exceptions import FrankaArmArgumentError, FrankaArmException
from frankapy.writing import require_picture, require_writable, write_picture

_AXES = ("x", "y", "z", "roll", "pitch", "yaw")
_STIFF = (600, 600, 600, 50, 50, 50)  # N/m and Nm/rad along and about those that do not yield
Add = Callable[[str, object, str], argparse.ArgumentParser]


def add_commands(add: Add, add_arm: Callable[[argparse.ArgumentParser], None]) -> None:
    """Add them to the command line."""
    demonstrate = add("demonstrate", _demonstrate, "let somebody lead an arm by hand, until Ctrl-C, and write down what they do")
    demonstrate.add_argument("file", type=Path, help="FILE.npz")
    add_arm(demonstrate)
    demonstrate.add_argument("--seconds", type=float, default=600, help="and no longer than this (default 600)")
    demonstrate.add_argument(
        "--yield", dest="yields", nargs="+", choices=_AXES, help="along and about these axes only (default: freely)"
    )
    demonstrate.add_argument("--frame", choices=["base", "tool"], default="base", help="whose axes these are (default base)")

    segment = add("segment", _segment, "part a demonstration where the arm rests in it, and smooth the parts")
    segment.add_argument("file", type=Path, help="a demonstration (.npz, .mcap, or .pkl of old scripts)")
    segment.add_argument("--rest", type=float, default=0.5, help="s without a motion that part it (default 0.5)")
    _add_smooth(segment)
    segment.add_argument("--output", "-o", type=Path, help="NAME.npz, of which NAME-1.npz and so on are made (default: FILE)")

    learn = add("learn", _learn, "learn a movement primitive from demonstrations")
    learn.add_argument("files", type=Path, nargs="+", help="of one motion (.npz, .mcap, or .pkl of old scripts)")
    learn.add_argument("--output", "-o", type=Path, required=True, help="FILE.npz, or FILE.pkl for old scripts")
    learn.add_argument("--kind", default="joint", choices=["joint", "position", "pose"], help="of joints (default), or of the tool")
    learn.add_argument("--basis", type=int, default=25, help="functions (default 25)")
    learn.add_argument(
        "--method", default="ridge", choices=["ridge", "local"], help="ridge regression (default), or locally weighted"
    )
    learn.add_argument("--ridge", type=float, default=1e-8, help="against large weights (default 1e-8)")
    learn.add_argument(
        "--sensors", type=float, nargs="+",
        help="values of the sensors in the first file, then in the next (default: one sensor, 1)",
    )  # fmt: skip
    _add_smooth(learn)
    learn.add_argument(
        "--plot", type=Path, metavar="PICTURE",
        help="draw what was learned over what was shown; with --sensors over the first",
    )  # fmt: skip

    imitate = add("imitate", _imitate, "let an arm do what it has learned, from where it began")
    imitate.add_argument("file", type=Path, help="what `frankapy learn` wrote, or the .pkl of old scripts")
    add_arm(imitate)
    imitate.add_argument("--duration", type=float, help="s (default: as it was shown)")
    imitate.add_argument("--goal", type=float, nargs="+", help="where to end: rad of 7 joints, or m (default: as it was shown)")
    imitate.add_argument(
        "--start", type=float, nargs="+", help="where to begin, rad or m (default: as it was shown; of a .pkl: here)"
    )
    imitate.add_argument("--goal-orientation", type=float, nargs=4, metavar=("W", "X", "Y", "Z"), help="of a pose (default: as it was shown)")
    imitate.add_argument("--sensors", type=float, nargs="+", help="weights of its sensors (default 1)")
    imitate.add_argument("--loops", type=int, default=1, help="how often (default 1)")
    imitate.add_argument("--plot", type=Path, metavar="PICTURE", help="draw what it will do, before it does")
    imitate.add_argument("--over", type=Path, nargs="+", default=[], metavar="FILE", help="over these demonstrations")
    imitate.add_argument("--check", action="store_true", help="say what of it the arm cannot do, and leave the arm where it is")


def _add_smooth(command: argparse.ArgumentParser) -> None:
    command.add_argument("--smooth", type=float, default=0.05, help="s, of what is taken for tremor (default 0.05; 0: nothing)")


def _demonstrate(options: argparse.Namespace) -> int:
    from frankapy import FrankaArm

    if options.file.suffix != ".npz":
        raise FrankaArmArgumentError(f"{options.file}: expected a name that ends in .npz")
    require_writable(options.file)
    guidance: dict[str, Any] = {}
    if options.yields:
        stiffness = [0 if axis in options.yields else stiff for axis, stiff in zip(_AXES, _STIFF, strict=True)]
        guidance = dict(use_impedance=True, use_ee_frame=options.frame == "tool", cartesian_impedances=stiffness)
    with FrankaArm(server=options.server, robot_num=options.arm) as fa:
        print("Lead the arm; Ctrl-C ends it.", file=sys.stderr)
        demonstration = fa.demonstrate(options.seconds, **guidance)
    demonstration.save(options.file)
    print(f"{options.file}: {demonstration!r}")
    return 0


def _segment(options: argparse.Namespace) -> int:
    from frankapy.demonstration import Demonstration

    name = options.output or options.file
    require_writable(name.with_name(f"{name.stem}-1.npz"))
    segments = Demonstration.load(options.file).segments(options.rest)
    if not segments:
        raise FrankaArmArgumentError(f"{options.file}: nothing moves in it")
    for number, segment in enumerate(segments, 1):
        file = name.with_name(f"{name.stem}-{number}.npz")
        smooth = segment.smooth(options.smooth) if options.smooth > 0 else segment
        smooth.save(file)
        print(f"{file}: {smooth!r}")
    return 0


def _learn(options: argparse.Namespace) -> int:
    from frankapy import dmp
    from frankapy.demonstration import Demonstration

    require_writable(options.output)
    if options.plot:
        require_picture(options.plot)
    demonstrations = [Demonstration.load(file).trimmed() for file in options.files]
    if options.smooth > 0:
        demonstrations = [demonstration.smooth(options.smooth) for demonstration in demonstrations]
    sensors = options.sensors
    if sensors is not None:
        if len(sensors) % len(options.files):
            raise FrankaArmArgumentError(
                f"--sensors has {len(sensors)} values: expected as many for each of {len(options.files)} files"
            )
        sensors = np.reshape(sensors, (len(options.files), -1))
    primitive = dmp.fit(demonstrations, options.kind, options.basis, options.method, options.ridge, sensors)
    files = primitive.save(options.output)
    print(f"{', '.join(map(str, files))}: {primitive!r}")
    if options.plot:
        if sensors is None:
            _draw(options.plot, primitive.plot, demonstrations)
        else:
            _draw(options.plot, primitive.plot, demonstrations[:1], sensor_values=sensors[0])
    return 0


def _draw(file: Path, plot: Callable[..., Any], *arguments: Any, **named: Any) -> None:
    try:
        figure = plot(*arguments, **named)
    except ImportError:
        raise FrankaArmException("Pictures need matplotlib: pip install 'frankapy[plots]'") from None
    write_picture(figure, file, dpi=120)


def _imitate(options: argparse.Namespace) -> int:
    from frankapy import FrankaArm, imitation
    from frankapy.demonstration import Demonstration
    from frankapy.dmp import Primitive

    primitive = Primitive.load(options.file)
    with FrankaArm(server=options.server, robot_num=options.arm) as fa:
        changed = dict(
            duration=options.duration, start=imitation.begin(fa, primitive, options.start)[0], goal=options.goal,
            goal_orientation=options.goal_orientation, sensor_values=options.sensors,
        )  # fmt: skip
        if options.plot:
            require_picture(options.plot)
            shown = [Demonstration.load(file).trimmed() for file in options.over]
            _draw(options.plot, primitive.plot, shown, limits=fa.limits, **changed)
            print(options.plot)
        beyond = primitive.beyond(fa, **changed)
        for line in beyond or ["nothing"] * options.check:
            print(f"slower, or not at all: {line}", file=sys.stderr)
        loops = 0 if options.check else options.loops
        fa.imitate(primitive, **changed, loops=loops, skill_desc=f"imitation of {options.file.name}")
    return 0
