"""The command line: frankapy status, sim, compat, record, info, plot, replay, export, demonstrate, segment,
learn, imitate, walls, latency, keys, kinds, new, doctor, recover."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import textwrap
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from frankapy import cli_imitation, cli_keys, cli_status, parts
from frankapy.cli_status import TITLES
from frankapy.client_key import KEY_VARIABLE, usual_file
from frankapy.connection import DEFAULT_PORT, SERVER_VARIABLE, Connection
from frankapy.doctor import BAD, NOTE, OK, WARN, Finding
from frankapy.exceptions import FrankaArmArgumentError, FrankaArmCommException, FrankaArmException
from frankapy.recording import Recording
from frankapy.terminal import colored, print_rows
from frankapy.writing import write_picture, writing_to

COMPAT = Path(__file__).resolve().parent / "compat"  # the folder that stands in for ROS


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return the exit status."""
    parser = argparse.ArgumentParser(prog="frankapy", description="Franka arms from the command line.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def add(name: str, run: object, text: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        command.set_defaults(run=run)
        return command

    def add_server(command: argparse.ArgumentParser) -> None:
        command.add_argument("--server", help=f"host[:port]; else ${SERVER_VARIABLE}, else 127.0.0.1:{DEFAULT_PORT}")
        command.add_argument("--key", metavar="FILE", help=f"your key, where the server has keys; else ${KEY_VARIABLE}, else {usual_file()}")

    def add_arm(command: argparse.ArgumentParser) -> None:
        add_server(command)
        command.add_argument("--arm", type=int, default=1, help="its number (default 1)")

    status = add("status", cli_status.show, "show the arms of a server and what they do")
    add_server(status)

    recover = add("recover", _recover, "bring an arm back after an error or a user stop, once you have looked at it")
    add_arm(recover)

    sim = add("sim", _sim, "start simulated arms and a server for them, until Ctrl-C")
    sim.add_argument("--robot", action="append", choices=list(TITLES), help="fr3 (default); once for each arm")
    sim.add_argument(
        "--protocol", default="auto", choices=["auto", *map(str, range(5, 11))], help="version of the robot"
    )
    sim.add_argument("--scene", help="what stands around the arms: a name of sim/scenes, or an MJCF file")
    sim.add_argument("--truth", help="FILE.npy for what really happens, every cycle; FILE.2.npy of the second arm")
    sim.add_argument("--speed", type=float, default=1.0, help="of the robot's time over the wall's (default 1)")
    sim.add_argument("--ideal", action="store_true", help="no joint friction, no noise")
    sim.add_argument("--lockstep", action="store_true", help="as fast as this computer can")
    sim.add_argument("--listen", default="127.0.0.1", help="address of the server (default %(default)s)")
    sim.add_argument(
        "--port", type=int, default=DEFAULT_PORT, help="of the server (default %(default)s; 0: a free one)"
    )
    sim.add_argument("--load", action="append", default=[], help="library of parts of your own; once for each")
    sim.add_argument("--record", choices=["off", "errors", "skills", "always"], help="what the server records (default: errors)")
    sim.add_argument("--recordings", type=Path, help="folder of its recordings")
    sim.add_argument("--keys", help="folder of the server's keys (`frankapy keys`); and have a key of it yourself")
    sim.add_argument("--verbose", action="store_true", help="show what the programs write")

    add("compat", _compat, "show the folder that stands in for ROS: PYTHONPATH=$(frankapy compat) python SCRIPT")

    record = add("record", _record, "record an arm, on its server's computer, until Ctrl-C")
    add_arm(record)
    record.add_argument("--seconds", type=float, help="and no longer than this")

    def add_file(name: str, run: object, text: str, file: str = "a recording") -> argparse.ArgumentParser:
        command = add(name, run, text)
        command.add_argument("file", type=Path, help=file)
        return command

    add_file("info", _info, "say what is in a recording")
    plot = add_file("plot", _plot, "show a recording as a page: joints, torques, tool, forces, timing")
    plot.add_argument("--save", type=Path, metavar="FILE", help="write it as .png, .pdf or .svg instead of showing it")
    export = add_file("export", _export, "write the states of a recording as .csv or .parquet")
    export.add_argument("to", type=Path, nargs="?", help="default: the recording's name, .parquet")
    latency = add("latency", _latency, "measure the way between this computer, the server and the arm, and say if it is good enough")
    add_arm(latency)
    latency.add_argument("--hold", action="store_true", help="also hold the arm still under control for some seconds")

    replay = add_file("replay", _replay, "let an arm do what it does in a recording")
    add_arm(replay)
    replay.add_argument("--speed", type=float, default=1.0, help="0.1 takes ten times as long (default 1)")

    cli_imitation.add_commands(add, add_arm)

    walls = add("walls", _walls, "list what an arm must not touch, add to it, or remove from it")
    add_arm(walls)
    change = walls.add_subparsers(dest="change", metavar="add|remove")
    wall = change.add_parser("add", help="add a wall, or put it in the place of that name")
    wall.add_argument("name")
    wall.add_argument("shape", choices=list(_SHAPES))
    wall.add_argument("size", type=float, nargs="*", help="m: box X Y Z, sphere RADIUS, cylinder and capsule RADIUS LENGTH; plane and mesh: none")
    wall.add_argument("--at", type=float, nargs=3, default=[0, 0, 0], metavar=("X", "Y", "Z"), help="its middle, m (default 0 0 0)")
    wall.add_argument("--file", help="of a mesh: STL")
    wall.add_argument("--scale", type=float, default=1.0, help="of that file: m that its unit is (default 1; 0.001: it is in mm)")
    wall.add_argument("--normal", type=float, nargs=3, default=[0, 0, 1], metavar=("X", "Y", "Z"), help="of a plane (default 0 0 1)")
    wall.add_argument("--turn", type=float, nargs=3, default=[0, 0, 0], metavar=("ROLL", "PITCH", "YAW"),
                      help="degrees about fixed axes x, y, z, in this order (default 0 0 0); of a box, cylinder, capsule")  # fmt: skip
    wall.add_argument("--held", action="store_true", help="a part of the arm itself, given in the frame of the tool")
    wall.add_argument("--keep", action="store_true", help="it outlives the server")
    wall.add_argument("--protect", action="store_true", help="only role lab changes it (which this needs)")
    change.add_parser("remove", help="remove walls").add_argument("names", nargs="+", metavar="name")

    cli_keys.add_commands(add)

    kinds = add("kinds", _kinds, "list the parts that skills are made of, with their fields; a server's own too")
    kinds.add_argument("role", nargs="?", choices=["trajectory", "controller", "termination", "ending"], help="only these")
    add_arm(kinds)
    kinds.add_argument("--fits", action="store_true", help="which trajectory fits which controller, and in which robot controllers")

    new = add("new", _new, "begin a part of your own: a project with its C++ file, message, test and build file")
    new.add_argument("role", choices=["controller", "trajectory", "termination"])
    new.add_argument("name", help="in words such as spiral_search")
    new.add_argument("--folder", type=Path, help="a new one (default: the name)")

    doctor = add("doctor", _doctor, "say what is wrong on this computer, and what to do")
    add_server(doctor)
    doctor.add_argument("--robot", metavar="ADDRESS", help="look for a real arm at this address")

    options = parser.parse_args(arguments)
    if getattr(options, "key", None):
        os.environ[KEY_VARIABLE] = options.key
    try:
        return int(options.run(options))
    except FrankaArmException as error:
        print(error.message, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # `frankapy status | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


# --- recordings ------------------------------------------------------------------------------------------------------


def _compat(options: argparse.Namespace) -> int:
    print(COMPAT)
    return 0


def _record(options: argparse.Namespace) -> int:
    from frankapy import FrankaArm

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # else the server would record on
    with FrankaArm(server=options.server, robot_num=options.arm) as fa:
        begun, told = time.monotonic(), ""
        with fa.recording() as status:
            try:
                while options.seconds is None or time.monotonic() - begun < options.seconds:
                    now = status()
                    if now.file != told:
                        told = now.file
                        print(f"recording to {told} on the server's computer; Ctrl-C ends it", flush=True)
                    if sys.stdout.isatty():
                        print(f"\r{now.time:8.1f} s  {now.bytes / 1e6:8.1f} MB  {now.lost} lost ", end="", flush=True)
                    time.sleep(0.2)
            except KeyboardInterrupt:
                pass
        now = status()
        print(f"{chr(10) if sys.stdout.isatty() else ''}{now.file}: {now.time:.1f} s, {now.states} states")
    return 0


def _info(options: argparse.Namespace) -> int:
    print_rows(options.file.name, Recording(options.file).summary())
    return 0


def _plot(options: argparse.Namespace) -> int:
    recording = Recording(options.file)
    try:
        figure = recording.plot()
    except ImportError:
        raise FrankaArmException("Pictures need matplotlib: pip install 'frankapy[recordings]'") from None
    if options.save:
        write_picture(figure, options.save, dpi=110)
        print(options.save)
        return 0
    import matplotlib.pyplot as plt

    if plt.get_backend().lower() == "agg":
        raise FrankaArmException("There is no screen to show it on: write it to a file with --save FILE.png")
    manager: Any = plt.figure().canvas.manager
    manager.canvas.figure = figure
    figure.set_canvas(manager.canvas)
    plt.show()
    return 0


def _export(options: argparse.Namespace) -> int:
    print(Recording(options.file).export(options.to or options.file.with_suffix(".parquet")))
    return 0


def _replay(options: argparse.Namespace) -> int:
    from frankapy import FrankaArm

    path = Recording(options.file).motion()
    most = 100_000  # samples of one skill
    with FrankaArm(server=options.server, robot_num=options.arm) as fa:
        fa.speed = options.speed
        print(f"{len(path) / 1000 / options.speed:.1f} s of motion, after the way to where it begins")
        fa.goto_joints(path[0], ignore_virtual_walls=True)
        with fa.sequence():
            for first in range(0, len(path), most):
                fa.run(parts.JointSamples(path[first : first + most]), skill_desc=f"replay of {options.file.name}")
    return 0


# --- kinds -----------------------------------------------------------------------------------------------------------


def _kinds(options: argparse.Namespace) -> int:
    loaded = None
    try:
        connection = Connection(options.server, options.arm)
        loaded = connection.welcome.loaded
        connection.close()
    except FrankaArmCommException as error:
        if options.server or os.environ.get(SERVER_VARIABLE):
            raise
        print(f"Those of this package; what a server has loaded is not among them. {error.message}\n", file=sys.stderr)
    last = None
    for kind in parts.describe(options.role, loaded):
        if kind.role != last:
            print(kind.role if last is None else f"\n{kind.role}")
            last = kind.role
        print(textwrap.indent(str(kind), "  "))
        if options.fits:
            for other, robot_controllers in kind.fits.items():
                print(f"    with {other:25}{', '.join(robot_controllers)}".rstrip())
    return 0


# --- walls -----------------------------------------------------------------------------------------------------------

_SHAPES = {"plane": 0, "box": 3, "sphere": 1, "cylinder": 2, "capsule": 2, "mesh": 0}  # and how many lengths each has


def _walls(options: argparse.Namespace) -> int:
    from frankapy import FrankaArm, RigidTransform, walls
    from frankapy.collision_boxes import rotation_from_rpy

    with FrankaArm(server=options.server, robot_num=options.arm) as fa:
        if options.change == "add":
            if len(options.size) != _SHAPES[options.shape]:
                raise FrankaArmArgumentError(f"{options.shape} has {_SHAPES[options.shape]} lengths, and not {len(options.size)}")
            pose = RigidTransform(rotation_from_rpy(np.radians(options.turn)), options.at)
            if options.shape == "plane":
                wall = walls.Plane(options.normal, options.at)
            elif options.shape == "box":
                wall = walls.Box(options.size, pose)
            elif options.shape == "sphere":
                wall = walls.Sphere(options.size[0], options.at)
            elif options.shape == "mesh":
                if options.file is None:
                    raise FrankaArmArgumentError("mesh needs --file, an STL file of it")
                wall = walls.Mesh(*walls.read_stl(options.file, options.scale), pose)
            else:
                wall = getattr(walls, options.shape.capitalize())(*options.size, pose)
            (fa.walls.hold if options.held else fa.walls.add)(options.name, wall, options.keep, options.protect)
        elif options.change == "remove":
            fa.walls.remove(*options.names)
        rows = []
        for name, wall in fa.walls.items():
            shape = wall.WhichOneof("shape")
            size = [value for _, value in getattr(wall, shape).ListFields()]
            lengths = " x ".join(f"{x:g}" for x in np.hstack([*size, []]))
            if shape == "mesh":
                lengths = f"of {len(wall.mesh.triangles) // 3} triangles"
            place = ", ".join(f"{x:g}" for x in wall.position)
            angles = RigidTransform(RigidTransform.rotation_from_quaternion(wall.orientation), np.zeros(3)).euler_angles
            degrees = np.degrees(angles).round(2) + 0.0  # + 0.0: no "-0"
            turned = f", turned {' '.join(f'{angle:g}' for angle in degrees)} degrees" if degrees.any() else ""
            kinds = ", held" * wall.held + ", protected" * wall.fixed + ", kept" * wall.keep
            rows.append((name, f"{shape} {lengths} at {place} m{turned}{kinds}"))
        print_rows("walls" if rows else "no walls", rows)
    return 0


# --- new -------------------------------------------------------------------------------------------------------------


def _new(options: argparse.Namespace) -> int:
    from frankapy.new_part import package_folder, write_project

    folder = options.folder or Path(options.name)
    with writing_to(folder):
        files = write_project(options.role, options.name, folder)
    print(*files, sep="\n")
    print("\nBuild and test it:")
    print(f"    cd {folder}\n    cmake -S . -B build -Dfranka-interface_DIR={package_folder()}")
    print("    cmake --build build\n    ctest --test-dir build")
    print("README.md there says how to load and to run it.")
    return 0


# --- recover ---------------------------------------------------------------------------------------------------------


def _recover(options: argparse.Namespace) -> int:
    from frankapy.interrupts import stop_on_interrupt
    from frankapy.recovery import told

    connection = Connection(options.server, options.arm)
    stop_on_interrupt(connection)
    try:
        recovery = connection.recover()
    finally:
        connection.close()
    print(told(recovery), file=sys.stdout if recovery.recovered else sys.stderr)
    return 0 if recovery.recovered else 1


# --- sim -------------------------------------------------------------------------------------------------------------


def _sim(options: argparse.Namespace) -> int:
    from frankapy.sim import SimulatedArm, Simulation, left_over_arms

    for pid in left_over_arms():
        print(f"note: a simulated arm of another run is left over and takes processor time: `kill {pid}` ends it", file=sys.stderr)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    robots = options.robot or ["fr3"]
    arms = SimulatedArm(
        robot=",".join(robots),
        protocol=options.protocol,
        lockstep=options.lockstep,
        ideal=options.ideal,
        speed=options.speed,
        scene=options.scene,
        truth=options.truth,
    )
    log = sys.stderr if options.verbose else None
    with Simulation(arms, listen=options.listen, port=options.port, load=options.load,
                    record=options.record, recordings=options.recordings, keys=options.keys, log=log) as simulation:
        for i, address in enumerate(simulation.addresses):
            print(f"arm {i + 1}: simulated {TITLES[robots[i % len(robots)]]} at {address}")
        server = simulation.server
        print(f"server: {server}")
        print()
        is_default = server == f"127.0.0.1:{DEFAULT_PORT}"
        argument = "" if is_default else f'server="{server}"'
        print("In Python:")
        print(f"    from frankapy import FrankaArm\n    fa = FrankaArm({argument})\n    fa.reset_joints()")
        if not is_default:
            print(f"or, for scripts as they are: export {SERVER_VARIABLE}={server}")
        print("\nCtrl-C ends the arm and the server.", flush=True)
        try:
            while True:
                simulation.check()
                time.sleep(0.5)
        except KeyboardInterrupt:
            print("\nstopping", flush=True)
    return 0


# --- latency ---------------------------------------------------------------------------------------------------------


def _latency(options: argparse.Namespace) -> int:
    from frankapy import FrankaArm, latency

    with FrankaArm(server=options.server, robot_num=options.arm) as fa:
        return _tell(latency.measure(fa, options.hold))


# --- doctor ----------------------------------------------------------------------------------------------------------


def _doctor(options: argparse.Namespace) -> int:
    from frankapy import doctor

    return _tell(doctor.examine(options.server, options.robot))


def _tell(findings: Iterable[Finding]) -> int:
    marks = {OK: ("ok  ", "32"), NOTE: ("--  ", "2"), WARN: ("warn", "33"), BAD: ("BAD ", "31")}
    counts = dict.fromkeys(marks, 0)
    for finding in findings:
        counts[finding.level] += 1
        mark, color = marks[finding.level]
        print(f"{colored(mark, color)}  {finding.what:18}{finding.found}", flush=True)
        if finding.advice:
            print(textwrap.indent(_filled(finding.advice), " " * 8))
    print()
    if counts[BAD]:
        print(f"BAD: {counts[BAD]} to put right.")
    if counts[WARN]:
        print(f"warn: {counts[WARN]} to put right before you use a real arm; a simulated one does not mind.")
    if not counts[BAD] and not counts[WARN]:
        print("Nothing is wrong.")
    return 1 if counts[BAD] else 0


def _filled(text: str) -> str:
    # A command is to be pasted: it stays on one line.
    return text if "sudo groupadd" in text else textwrap.fill(text, 104, break_long_words=False, break_on_hyphens=False)


if __name__ == "__main__":
    sys.exit(main())
