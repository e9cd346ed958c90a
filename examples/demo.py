"""What `make demo` runs: a simulated arm moves, picks up a block and puts it elsewhere, and what happened is drawn.

Starts an arm and a server of its own on addresses that are free; with --lockstep as fast as this computer can. Ends with
an error when the block is not where it should be, judged by what the physics wrote down, not by what was commanded. Leaves
pictures in build/demo/.
"""

import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from frankapy import FrankaArm, FrankaArmException, FrankaConstants, RigidTransform, proto
from frankapy.sim import SimulatedArm, Simulation, program, read_truth

REPOSITORY = Path(__file__).resolve().parent.parent
FOLDER = REPOSITORY / "build" / "demo"
SCENE = REPOSITORY / "sim" / "scenes" / "table_with_block.xml"
TRUTH = FOLDER / "truth.npy"

CARRY = np.array([0.0, 0.3, 0.0])  # m, from where the block is to where it should be
ABOVE = np.array([0.0, 0.0, 0.12])  # m
ALLOWED = 0.01  # m beside the goal
LATE = 1.0  # ms, by which a cycle is
NAMED = 5  # of these, the worst
SHOWN = ("joint move", "pose delta, server's impedance", "grasp", "lift", "carry", "away")  # the ends of these


class Recorder:
    """Keeps one in four of the states that the server publishes, in a thread."""

    def __init__(self, fa: FrankaArm) -> None:
        self.states: list[proto.ArmState] = []
        self._stream = fa.states()
        self._quit = False
        self._thread = threading.Thread(target=self._record, daemon=True)
        self._thread.start()

    def _record(self) -> None:
        for i, state in enumerate(self._stream):
            if i % 4 == 0:
                self.states.append(state)
            if self._quit:
                return

    def stop(self) -> list[proto.ArmState]:
        """End, and return the states."""
        self._quit = True
        self._thread.join()
        self._stream.close()
        return self.states


def pointing_down(position: np.ndarray) -> RigidTransform:
    """Return the pose of the tool at a position, fingers down."""
    return RigidTransform(np.diag([1.0, -1.0, -1.0]), position, from_frame="franka_tool", to_frame="world")


def in_tool(x: float, y: float, z: float) -> RigidTransform:
    """Return a translation along the axes of the tool."""
    return RigidTransform(translation=[x, y, z], from_frame="franka_tool", to_frame="franka_tool")


def tasks(fa: FrankaArm, block: np.ndarray) -> list[tuple[str, Callable[[], None]]]:
    """Return what the arm does, by name; `block` is the middle of the block, m."""
    turned = np.array(FrankaConstants.HOME_JOINTS) + [0.4, 0.2, -0.2, 0.2, 0.3, 0.2, -0.4]
    goal = block + CARRY
    return [
        ("home", lambda: fa.reset_joints(duration=1.5)),
        ("joint move", lambda: fa.goto_joints(turned, duration=1.5)),
        ("home again", lambda: fa.reset_joints(duration=1.5)),
        ("pose delta, robot's impedance", lambda: fa.goto_pose_delta(in_tool(0, 0.1, 0.1), 1.5, use_impedance=False)),
        ("back", lambda: fa.goto_pose_delta(in_tool(0, -0.1, -0.1), 1.5, use_impedance=False)),
        ("pose delta, server's impedance", lambda: fa.goto_pose_delta(in_tool(0, 0.1, 0.1), 1.5)),
        ("open hand", fa.open_gripper),
        ("above the block", lambda: fa.goto_pose(pointing_down(block + ABOVE), 1.5)),
        ("down", lambda: fa.goto_pose(pointing_down(block), 1.2)),
        ("grasp", lambda: fa.goto_gripper(0.02, grasp=True, force=20, ignore_errors=False)),
        ("lift", lambda: fa.goto_pose(pointing_down(block + ABOVE), 1.2)),
        ("carry", lambda: fa.goto_pose(pointing_down(goal + ABOVE), 1.8)),
        ("put down", lambda: fa.goto_pose(pointing_down(goal), 1.2)),
        ("let go", fa.open_gripper),
        ("away", lambda: fa.goto_pose(pointing_down(goal + ABOVE), 1.2)),
    ]


def run(simulation: Simulation) -> tuple[list[tuple[str, float]], list[proto.ArmState]]:
    """Let the arm do its tasks; return each with the robot's time (s) at its begin, and the recorded states."""
    begins = []
    with FrankaArm(server=simulation.server) as fa:
        block = block_positions(read_truth(TRUTH, until=1))[0]
        recorder = Recorder(fa)
        try:
            for i, (name, do) in enumerate(todo := tasks(fa, block), 1):
                print(f"  {i:2} of {len(todo)}  {name:32}", end="", flush=True)
                begun = time.monotonic()
                begins.append((name, fa.get_arm_state().robot.message_id / 1000))
                do()
                print(f"{time.monotonic() - begun:5.2f} s", flush=True)
            begins.append(("", fa.get_arm_state().robot.message_id / 1000))
        except FrankaArmException:
            print()
            tell_late(simulation, recorder.stop())
            raise
        return begins, recorder.stop()


def tell_late(simulation: Simulation, states: list[proto.ArmState]) -> None:
    """Say whether this computer was too busy for an arm in real time, and when; nothing where it was not."""
    truth = simulation.truth()
    lost = [  # robot's time of the states in which commands of the last 100 cycles are missing
        state.robot.message_id / 1000
        for state in states
        if state.phase == proto.RUNNING and state.skill_time > 0.1 and state.robot.control_command_success_rate < 1
    ]
    if not lost and not truth.late_cycles:
        return
    print(
        f"This computer was too busy for an arm in real time: {truth.late_cycles} cycles of the arm came late, by "
        f"{1000 * truth.worst_delay:.1f} ms at the most.",
        file=sys.stderr,
    )
    # Of the computer and of the robot, ms.
    clocks = np.array([(1e-6 * state.time_ns, state.robot.message_id) for state in states]).reshape(-1, 2)
    behind = np.diff(clocks[:, 0]) - np.diff(clocks[:, 1])
    worst = [f"{clocks[k + 1, 1]:.0f} ({behind[k]:.1f} ms)" for k in np.sort(np.argsort(behind)[-NAMED:]) if behind[k] > LATE]
    if worst:
        print(f"Cycles that came latest after those before them: {', '.join(worst)}.", file=sys.stderr)
    if lost:
        starts = [t for before, t in zip([-1.0, *lost], lost, strict=False) if t > before + 0.1]
        print(f"Commands were missing at {', '.join(f'{t:.1f}' for t in starts)} s of the robot's clock.", file=sys.stderr)
    print("Try again when nothing else runs, or do without real time: `make demo-lockstep`.", file=sys.stderr)


def block_positions(truth: np.ndarray) -> np.ndarray:
    """Return where the middle of the block was in each cycle, m, (n, 3)."""
    return truth["object_block"][:, :3]


def judge(truth: np.ndarray) -> bool:
    """Say where the block is; return whether that is where it should be."""
    positions = block_positions(truth)
    goal = positions[0] + CARRY
    distance = np.linalg.norm(positions[-1] - goal)
    lifted = positions[:, 2].max() - positions[0, 2]
    is_there = distance <= ALLOWED and lifted > ABOVE[2] / 2
    print(
        f"The block is at {np.round(positions[-1], 4)} m, {1000 * distance:.1f} mm from where it should be, and was "
        f"lifted by {1000 * lifted:.0f} mm: {'good.' if is_there else 'WRONG.'}"
    )
    return is_there


def draw(begins: list[tuple[str, float]], states: list[proto.ArmState], truth: np.ndarray) -> None:
    """Draw reference, command and truth over time into demo.png."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    start = begins[0][1]
    truth = truth[::4]
    t_truth = truth["cycle"] / 1000 - start
    t = np.array([s.robot.message_id for s in states]) / 1000 - start

    def column(get: Callable[[proto.ArmState], object], size: int) -> np.ndarray:
        rows = [get(s) for s in states]
        return np.array([row if len(row) == size else [np.nan] * size for row in rows])

    figure, (joints, tool, error, force) = plt.subplots(
        4, 1, figsize=(14, 13), sharex=True, layout="constrained", height_ratios=[3, 3, 2, 2]
    )
    colors = plt.get_cmap("tab10").colors

    q_ref, q_d = column(lambda s: s.q_ref, 7), column(lambda s: s.robot.q_d, 7)
    for i in range(7):
        joints.plot(t_truth, truth["q"][:, i], color=colors[i], lw=1.2, label=f"joint {i + 1}")
        joints.plot(t, q_d[:, i], color=colors[i], lw=3, alpha=0.25)
        joints.plot(t, q_ref[:, i], color="black", lw=0.8, ls=(0, (2, 3)))
    joints.set_ylabel("joints (rad)")

    pose_ref, pose_d = column(lambda s: s.O_T_EE_ref, 16), column(lambda s: s.robot.O_T_EE_c, 16)
    position = truth["O_T_TCP"][:, 12:15]
    block = block_positions(truth)
    for i, name in enumerate("xyz"):
        tool.plot(t_truth, position[:, i], color=colors[i], lw=1.2, label=f"tool {name}")
        tool.plot(t, pose_d[:, 12 + i], color=colors[i], lw=3, alpha=0.25)
        tool.plot(t, pose_ref[:, 12 + i], color="black", lw=0.8, ls=(0, (2, 3)))
        tool.plot(t_truth, block[:, i], color=colors[i], lw=0.9, ls="-.", alpha=0.7, label=f"block {name}")
    tool.set_ylabel("tool and block (m)")

    for i, name in enumerate("xyz"):
        at = np.interp(t, t_truth, position[:, i])
        error.plot(t, 1000 * (at - pose_ref[:, 12 + i]), color=colors[i], lw=1, label=f"tool {name} (mm)")
    off = np.array([np.interp(t, t_truth, truth["q"][:, i]) for i in range(7)]).T - q_ref
    error.plot(t, 1000 * np.abs(off).max(axis=1), color="black", lw=1, label="worst joint (mrad)")
    error.axhline(0, color="0.7", lw=0.6)
    error.set_ylabel("truth minus reference")

    wrench = column(lambda s: s.robot.O_F_ext_hat_K, 6)
    for i, name in enumerate("xyz"):
        # The robot's estimate is of what it does to the world, the truth is what the world does to it.
        force.plot(t, wrench[:, i], color=colors[i], lw=1, label=f"estimate {name}")
        force.plot(t_truth, -truth["contact_wrench"][:, i], color=colors[i], lw=0.8, ls="--", label=f"truth {name}")
    force.plot(t_truth, np.abs(truth["finger_force"]).max(axis=1), color="0.4", lw=1, label="grip")
    force.set_ylabel("forces on the world (N)")
    force.set_xlabel("time of the robot (s)")

    figure.suptitle(
        "What the arm was told and what it did.  Thin: truth from the physics.  Broad and pale: the robot's command.  "
        "Black dots: the server's reference"
    )
    for axes in (joints, tool, error, force):
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
        axes.grid(alpha=0.25)
        for i, ((_, begin), (_, end)) in enumerate(zip(begins, begins[1:], strict=False)):
            if i % 2:
                axes.axvspan(begin - start, end - start, color="0.94", zorder=-1)
    for (name, begin), (_, end) in zip(begins, begins[1:], strict=False):
        joints.text(
            (begin + end) / 2 - start, 1.02, name, transform=joints.get_xaxis_transform(), rotation=35, fontsize=9
        )
    joints.set_xlim(0, begins[-1][1] - start)
    figure.savefig(FOLDER / "demo.png", dpi=90)


def main() -> int:
    begun = time.monotonic()
    FOLDER.mkdir(parents=True, exist_ok=True)
    print("A simulated FR3, a server for it, and a Python script that moves it.", flush=True)
    arm = SimulatedArm(scene=SCENE, truth=TRUTH, lockstep="--lockstep" in sys.argv[1:])
    with Simulation(arm) as simulation:
        print(f"arm at {simulation.addresses[0]}, server at {simulation.server}", flush=True)
        try:
            begins, states = run(simulation)
        except FrankaArmException as error:
            print(f"The arm did not get through: {error}", file=sys.stderr)
            return 1
        truth = read_truth(TRUTH)
        is_there = judge(truth)
        if not is_there or any(state.phase == proto.ERROR for state in states):
            tell_late(simulation, states)

    ends = {name: end for (name, _), (_, end) in zip(begins, begins[1:], strict=False)}
    times = ",".join(f"{ends[name]:.3f}" for name in SHOWN)
    strip = FOLDER / "arm.png"
    command = [program("fci-render"), "--scene", SCENE, "--times", times, "--output", strip, "--truth", TRUTH]
    with subprocess.Popen(command) as renderer:  # beside the drawing: there are two cores
        draw(begins, states, truth)
    if renderer.returncode != 0:
        print("fci-render could not draw the arm; see above.", file=sys.stderr)
        return 1
    print(f"{(FOLDER / 'demo.png').relative_to(REPOSITORY)}: what it was told and what it did")
    print(f"{strip.relative_to(REPOSITORY)}: the arm at work")
    print(f"{time.monotonic() - begun:.0f} s")
    return 0 if is_there else 1


if __name__ == "__main__":
    sys.exit(main())
