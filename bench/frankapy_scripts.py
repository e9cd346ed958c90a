"""Scripts published with frankapy, unchanged, on a simulated arm in real time, each judged by what the arm really did.

FRANKAPY_SCRIPTS names the folder with their `examples/` and `scripts/`; without it there is no entry.
  scripts_unchanged   that did what they do on an arm: all but the one that needs a camera; of the one with a syntax error a copy
                      without its stray character

A FER stands for the arm that they were written for. Where one asks for Enter it gets it; where one reads a demonstration a
virtual hand makes it. What the last of three attempts of each did is judged: a computer that stands still is not its fault.
"""

import json
import os
import pickle
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from frankapy import FrankaArm, FrankaConstants
from frankapy.cli import COMPAT
from frankapy.sim import SimulatedArm, Simulation, read_truth

HOME = np.array(FrankaConstants.HOME_JOINTS)
READY = np.array(FrankaConstants.READY_JOINTS)
ATTEMPTS = 3
LONGEST = 300  # s
HAND_TIME = 6.0  # s of a demonstration
Rows = np.ndarray


def position(rows: Rows) -> np.ndarray:
    """Return where the tool was, (n, 3)."""
    return rows["O_T_TCP"].reshape(-1, 4, 4)[:, 3, :3]


def at(q: Sequence[float], tolerance: float = 0.01) -> Callable[[Rows], bool]:
    """Ask whether the arm ended there."""
    return lambda rows: bool(np.abs(rows["q"][-1] - q).max() < tolerance)


def through(*stops: Sequence[float], tolerance: float = 0.01) -> Callable[[Rows], bool]:
    """Ask whether the joints went through these, in their order."""

    def judge(rows: Rows) -> bool:
        after = 0
        for stop in stops:
            hits = np.flatnonzero(np.abs(rows["q"][after:] - np.asarray(stop)).max(axis=1) < tolerance)
            if hits.size == 0:
                return False
            after += hits[0]
        return True

    return judge


def fingers(width: float) -> Callable[[Rows], bool]:
    """Ask whether the fingers ended that wide apart, m."""
    return lambda rows: bool(abs(rows["finger"][-1].sum() - width) < 0.003)


def both(*judges: Callable[[Rows], bool]) -> Callable[[Rows], bool]:
    """Ask all."""
    return lambda rows: all(judge(rows) for judge in judges)


def stays(tolerance: float) -> Callable[[Rows], bool]:
    """Ask whether nothing moved the tool by more, m."""
    return lambda rows: bool(np.linalg.norm(position(rows) - position(rows)[0], axis=1).max() < tolerance)


def down_and_up(rows: Rows) -> bool:
    """Ask whether the tool was 0.2 m lower, and is back."""
    z = position(rows)[:, 2]
    high = z.max()
    lowest = int(np.argmin(z))
    return bool(abs(high - z[lowest] - 0.2) < 0.03 and abs(z[-1] - z[0]) < 0.05 and z[lowest:].max() > high - 0.05)


def twice_down(rows: Rows) -> bool:
    """Ask whether the tool was lowered by 0.2 m twice, the second time by velocities that were streamed."""
    z = position(rows)[:, 2]
    low = z < z[0] - 0.15
    return int(np.sum(np.diff(low.astype(int)) == 1)) == 2


def turned(rows: Rows) -> bool:
    """Ask whether the selected joint alone was moved by its torque."""
    home = np.flatnonzero(np.abs(rows["q"] - HOME).max(axis=1) < 0.01)[-1]
    moved = np.abs(rows["q"][home:] - rows["q"][home]).max(axis=0)
    return bool(moved[5] > 0.05 and np.delete(moved, 5).max() < 0.1)


def circle(rows: Rows) -> bool:
    """Ask whether the tool went around a circle of 0.07 m twice."""
    p = position(rows)
    far = np.linalg.norm(p[:, :2] - p[0, :2], axis=1) > 0.12
    return int(np.sum(np.diff(far.astype(int)) == 1)) == 2


def lifted(by: Sequence[float]) -> Callable[[Rows], bool]:
    """Ask whether the tool ended so far from where it began, m."""
    return lambda rows: bool(np.abs(position(rows)[-1] - position(rows)[0] - by).max() < 0.01)


@dataclass
class Script:
    """How one is run, and judged."""

    name: str
    judge: Callable[[Rows], bool]
    arguments: Sequence[str] = ()
    lines: str = ""  # typed where it asks
    ends_with: str = ""  # the exception that it ends with, as on an arm
    hand: bool = False  # whether somebody demonstrates meanwhile
    start: Sequence[float] = tuple(HOME)


def demonstrated(rows: Rows) -> bool:
    """Ask whether the hand moved the tool by some centimetres."""
    return bool(np.linalg.norm(position(rows) - position(rows)[0], axis=1).max() > 0.05)


def scripts() -> list[Script]:
    """Return all, in an order in which what one writes another reads."""
    desired = [-0.52733715, 0.25603565, 0.47721503, -1.26705864, 0.00600359, 1.60788199, 0.63019184]
    turn = HOME + [0, 0, 0, 0, 0, 0, np.pi / 4]
    return [
        Script("scripts/reset_arm.py", both(at(HOME), fingers(0.08)), start=READY),
        Script("scripts/close_gripper.py", fingers(0)),
        Script("scripts/open_gripper.py", fingers(0.08)),
        # The last goal of this one is beyond its own walls.
        Script("examples/example_movements.py", both(through(HOME, desired), at(desired)), ends_with="walls"),
        Script("examples/execute_joint_torques.py", turned, ["-t", "2"]),
        Script("examples/go_to_joints_with_joint_impedances.py", both(through(HOME, READY, HOME, READY, HOME), at(HOME)), lines="\n\n\n"),
        Script("examples/move_robot.py", both(through(HOME, turn, HOME), at(HOME), fingers(0.08))),
        Script("scripts/test_virtual_walls.py", at(HOME), ends_with="walls"),
        Script("scripts/run_guide_mode.py", stays(0.01), ["-t", "5"]),
        Script("scripts/run_guide_mode_ee_frame.py", stays(0.01), ["-t", "5"]),
        Script("examples/record_trajectory.py", demonstrated, hand=True),
        Script("examples/run_recorded_trajectory.py", demonstrated),
        Script("scripts/record_trajectory.py", demonstrated, ["-t", "8", "-f", "guided.pkl"], hand=True),
        Script("scripts/run_recorded_trajectory.py", demonstrated, ["-t", "guided.pkl"]),
        Script("examples/run_dynamic_joints.py", down_and_up),
        Script("examples/run_dynamic_pose.py", down_and_up),
        Script("examples/run_dynamic_joint_velocities.py", twice_down),
        Script("examples/run_dynamic_cartesian_velocities.py", twice_down),
        Script("examples/run_hfpc.py", both(circle, at(HOME), fingers(0.08)), lines="\nc\n"),
        Script("examples/run_pose_dmp.py", lifted([0, 0, 0.08]), ["-f", "pose.pkl"]),
        Script("examples/run_quaternion_pose_dmp.py", lifted([0, 0.05, 0]), ["-p", "position.pkl", "-q", "turn.pkl"]),
    ]


def primitive(duration: float, ways: Sequence[float], alpha: float = 200.0) -> dict[str, object]:
    """Return the dictionary of a movement primitive that goes straight along `ways`."""
    basis = 6
    weights = np.zeros((len(ways), 1, basis))
    weights[:, 0, 0] = ways
    mu = np.exp(-0.5 * np.arange(basis) / (basis - 1))
    return dict(
        tau=0.5 / duration, alpha=alpha, beta=alpha / 4, num_basis=basis, num_sensors=1, mu=mu.tolist(), h=[50.0] * basis,
        weights=weights,
    )  # fmt: skip


def demonstrate(simulation: Simulation) -> None:
    """Lead the tool 0.1 m to the side and back, once the arm lets itself be led."""
    with FrankaArm(server=simulation.server) as fa:
        fa.wait_for(lambda state: state.skill_description == "GuideMode" and state.skill_time > 0.5, 60)
    here = simulation.truth().O_T_TCP[:3, 3]
    side = [here + [0, 0.1 * np.sin(np.pi * t / HAND_TIME) ** 2, 0.03 * np.sin(np.pi * t / HAND_TIME)] for t in np.linspace(0, HAND_TIME, 60)]
    simulation.hand(side, np.linspace(0.01, HAND_TIME, 60))


def run(script: Script, path: Path, folder: Path, simulation: Simulation, truth: Path) -> str:
    """Run a script; return what was wrong, or nothing."""
    with FrankaArm(server=simulation.server) as fa:
        fa.wait_for_franka_interface()
        fa.goto_joints(script.start, 3, ignore_virtual_walls=True)
        fa.open_gripper()
    first = simulation.truth().cycle
    helper = threading.Thread(target=demonstrate, args=(simulation,)) if script.hand else None
    if helper is not None:
        helper.start()
    environment = os.environ | {"FRANKA_INTERFACE_SERVER": simulation.server, "PYTHONPATH": str(COMPAT)}
    command = [sys.executable, str(path), *script.arguments]
    done = subprocess.run(
        command, input=script.lines, capture_output=True, text=True, cwd=folder, env=environment, timeout=LONGEST, check=False
    )
    if helper is not None:
        helper.join()
    errors = done.stderr.strip()
    if bool(done.returncode) != bool(script.ends_with) or script.ends_with not in errors:
        return f"ended with status {done.returncode}: {errors[-300:]}"
    last = simulation.truth().cycle
    rows = read_truth(truth, until=last)
    rows = rows[(rows["cycle"] > first) & (rows["cycle"] <= last)]
    return "" if script.judge(rows) else f"did something else ({errors[-200:]})"


def main() -> None:
    source = os.environ.get("FRANKAPY_SCRIPTS")
    if not source:
        print("FRANKAPY_SCRIPTS is not set: nothing is run", file=sys.stderr)
        print("{}")
        return
    good = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truth = folder / "truth.npy"
        for file, ways, alpha, duration in (
            ("pose.pkl", [0, 0, 0.08, 0, 0, 0], 200, 8),
            ("position.pkl", [0, 0.05, 0], 200, 20),
            ("turn.pkl", [0, 0, 0], 48, 20),
        ):
            (folder / file).write_bytes(pickle.dumps(primitive(duration, ways, alpha)))
        with Simulation(SimulatedArm(robot="fer", truth=truth)) as simulation:
            for script in scripts():
                path = Path(source) / script.name
                if script.name.endswith("run_quaternion_pose_dmp.py"):
                    text = re.sub(r"\):\s*\Z", ")\n", path.read_text())
                    path = Path(shutil.copy(path, folder))
                    path.write_text(text)
                for attempt in range(ATTEMPTS):
                    wrong = run(script, path, folder, simulation, truth)
                    if not wrong:
                        break
                    print(f"{script.name}, attempt {attempt + 1}: {wrong}", file=sys.stderr)
                good += not wrong
                print(f"{script.name}: {wrong or 'as on an arm'}", file=sys.stderr)
    print(json.dumps({"scripts_unchanged": good}))


if __name__ == "__main__":
    main()
