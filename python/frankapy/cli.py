"""The command line: frankapy status, sim, doctor."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import textwrap
import time
from collections.abc import Sequence

import numpy as np

from frankapy import proto
from frankapy.connection import DEFAULT_PORT, SERVER_VARIABLE, Connection, list_arms, server_address
from frankapy.exceptions import FrankaArmException
from frankapy.utils import franka_pose_to_rigid_transform

_TITLES = {"fer": "FER (Panda)", "fr3": "FR3", "fr3v2": "FR3v2"}
_PHASES = {
    proto.CONNECTING: "connecting",
    proto.READY: "ready",
    proto.CONFIGURING: "sending settings",
    proto.STARTING: "starting a motion",
    proto.RUNNING: "running a skill",
    proto.HOLDING: "holding its reference",
    proto.BRAKING: "braking",
    proto.FINISHING: "finishing a motion",
    proto.ERROR: "in error: takes no motion until recovered",
    proto.RECOVERING: "recovering",
}


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

    status = add("status", _status, "show the arms of a server and what they do")
    add_server(status)

    sim = add("sim", _sim, "start simulated arms and a server for them, until Ctrl-C")
    sim.add_argument("--robot", action="append", choices=list(_TITLES), help="fr3 (default); once for each arm")
    sim.add_argument(
        "--protocol", default="auto", choices=["auto", *map(str, range(5, 11))], help="version of the robot"
    )
    sim.add_argument("--scene", help="MJCF file around the arms")
    sim.add_argument("--truth", help="file for what really happens, every cycle (of the first arm)")
    sim.add_argument("--ideal", action="store_true", help="no joint friction, no noise")
    sim.add_argument("--lockstep", action="store_true", help="as fast as this computer can")
    sim.add_argument("--listen", default="127.0.0.1", help="address of the server (default %(default)s)")
    sim.add_argument(
        "--port", type=int, default=DEFAULT_PORT, help="of the server (default %(default)s; 0: a free one)"
    )
    sim.add_argument("--verbose", action="store_true", help="show what the programs write")

    doctor = add("doctor", _doctor, "say what is wrong on this computer, and what to do")
    add_server(doctor)
    doctor.add_argument("--robot", metavar="ADDRESS", help="look for a real arm at this address")

    options = parser.parse_args(arguments)
    try:
        return options.run(options)
    except FrankaArmException as error:
        print(error.message, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # `frankapy status | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


# --- status ----------------------------------------------------------------------------------------------------------


def _status(options: argparse.Namespace) -> int:
    host, port = server_address(options.server)
    arms = list_arms(options.server)
    print(f"franka-interface at {host}:{port}: {len(arms)} arm{'s' * (len(arms) != 1)}")
    good = True
    deficiencies: list[str] = []
    for number, arm in enumerate(arms, 1):
        print()
        if not arm.endpoint:
            good = False
            _print_rows(
                f"{number}  {arm.name}", [("robot", arm.address), ("not ready", arm.status or "no reason given")]
            )
            continue
        connection = Connection(options.server, number)
        try:
            state = connection.ask(proto.Request(get_state=proto.GetState())).state
        finally:
            connection.close()
        good = good and state.phase not in (proto.ERROR, proto.CONNECTING)
        _print_rows(f"{number}  {arm.name}", _rows(connection.welcome, state))
        deficiencies += [text for text in connection.welcome.deficiencies if text not in deficiencies]
    if deficiencies:
        print()
        _print_rows("The server's computer could be better", [("", text) for text in deficiencies])
    return 0 if good else 1


def _rows(welcome: proto.Welcome, state: proto.ArmState) -> list[tuple[str, str]]:
    robot = state.robot
    rows = [
        (
            "robot",
            f"{_TITLES.get(welcome.model, welcome.model)} at {welcome.address}, protocol {welcome.protocol_version}",
        )
    ]
    mode = proto.RobotMode.Name(robot.robot_mode).lower().replace("_", " ")
    rows.append(("mode", f"{mode}; the server is {_PHASES.get(state.phase, str(state.phase))}"))
    if state.skill_id:
        rows.append(("skill", f"{state.skill_description or 'without a name'}, since {state.skill_time:.1f} s"))
    rows.append(("joints", "  ".join(f"{q:7.3f}" for q in np.round(robot.q, 3) + 0.0) + "  rad"))
    limits = welcome.limits
    if len(limits.q_min) == 7:
        share = (np.array(robot.q) - limits.q_min) / (np.array(limits.q_max) - np.array(limits.q_min))
        rows.append(("of range", "  ".join(f"{100 * s:5.0f} %" for s in share)))
    pose = franka_pose_to_rigid_transform(robot.O_T_EE)
    x, y, z = pose.translation.round(4) + 0.0  # + 0.0: no "-0"
    roll, pitch, yaw = np.degrees(pose.euler_angles).round(1) + 0.0
    rows.append(
        ("tool", f"x {x:.4f}  y {y:.4f}  z {z:.4f} m   roll {roll:.1f}  pitch {pitch:.1f}  yaw {yaw:.1f} degrees")
    )
    force = np.array(robot.O_F_ext_hat_K)
    rows.append(
        ("forces", f"{np.linalg.norm(force[:3]):.1f} N, {np.linalg.norm(force[3:]):.1f} Nm on the tool, as estimated")
    )
    if state.HasField("gripper"):
        held = ", holds something" if state.gripper.is_grasped else ""
        rows.append(("hand", f"{1000 * state.gripper.width:.1f} mm open{held}"))
    else:
        rows.append(("hand", "none"))
    if robot.robot_mode == proto.MOVE:
        rows.append(
            ("packets", f"{100 * robot.control_command_success_rate:.0f} % of the last 100 commands arrived in time")
        )
    errors = list(robot.errors) or list(robot.reflex_reason)
    rows.append(("errors", ", ".join(errors) or "none"))
    return rows


def _print_rows(title: str, rows: Sequence[tuple[str, str]]) -> None:
    print(_bold(title))
    for name, value in rows:
        first = f"   {name:16}" if name else "   "
        print(textwrap.fill(value, 112, initial_indent=first, subsequent_indent=" " * len(first)))


# --- sim -------------------------------------------------------------------------------------------------------------


def _sim(options: argparse.Namespace) -> int:
    from frankapy.sim import SimulatedArm, Simulation

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    arms = [
        SimulatedArm(
            robot=robot,
            protocol=options.protocol,
            lockstep=options.lockstep,
            ideal=options.ideal,
            scene=options.scene,
            truth=options.truth if i == 0 else None,
        )
        for i, robot in enumerate(options.robot or ["fr3"])
    ]
    log = sys.stderr if options.verbose else None
    with Simulation(*arms, listen=options.listen, port=options.port, log=log) as simulation:
        for number, (arm, address) in enumerate(zip(arms, simulation.addresses, strict=True), 1):
            print(f"arm {number}: simulated {_TITLES[arm.robot]} at {address}")
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


# --- doctor ----------------------------------------------------------------------------------------------------------


def _doctor(options: argparse.Namespace) -> int:
    from frankapy import doctor

    marks = {
        doctor.OK: ("ok  ", "32"),
        doctor.NOTE: ("--  ", "2"),
        doctor.WARN: ("warn", "33"),
        doctor.BAD: ("BAD ", "31"),
    }
    counts = dict.fromkeys(marks, 0)
    for finding in doctor.examine(options.server, options.robot):
        counts[finding.level] += 1
        mark, color = marks[finding.level]
        print(f"{_colored(mark, color)}  {finding.what:18}{finding.found}")
        if finding.advice:
            print(textwrap.indent(_filled(finding.advice), " " * 8))
    print()
    if counts[doctor.BAD]:
        print(f"BAD: {counts[doctor.BAD]} to put right.")
    if counts[doctor.WARN]:
        print(f"warn: {counts[doctor.WARN]} to put right before you use a real arm; a simulated one does not mind.")
    if not counts[doctor.BAD] and not counts[doctor.WARN]:
        print("Nothing is wrong.")
    return 1 if counts[doctor.BAD] else 0


def _filled(text: str) -> str:
    # A command is to be pasted: it stays on one line.
    return text if "sudo groupadd" in text else textwrap.fill(text, 104, break_long_words=False, break_on_hyphens=False)


def _bold(text: str) -> str:
    return _colored(text, "1")


def _colored(text: str, code: str) -> str:
    return f"\033[{code}m{text}\033[0m" if sys.stdout.isatty() else text


if __name__ == "__main__":
    sys.exit(main())
