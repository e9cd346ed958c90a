"""How fast a skill starts and a blocking call returns, and how near to its goal a motion ends.

Times are of a server and a simulated arm in real time, on one clock (CLOCK_MONOTONIC):
  skill_start_hold_ms_p50   from the Python call to the skill's first command, the loop holding
  skill_start_idle_ms_p50   the same, the robot idle and the settings in force
  skill_return_ms_p50       from the skill's last cycle to the return of the blocking call
each of the kind of skill that is worst. Ends are judged by the truth of the physics, in lockstep, the worst of several:
  internal_joint_end_error_rad          of the default arm and of the ideal one
  cartesian_end_error_{ideal,default}_{mm,deg}   of Cartesian impedance at 600 N/m and 50 Nm/rad
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from frankapy import FrankaArm, FrankaConstants, RigidTransform
from frankapy.sim import SimulatedArm, Simulation, read_truth

HOME = np.array(FrankaConstants.HOME_JOINTS)
STARTS = 60  # of each kind
GOALS = 8


def kinds(fa: FrankaArm) -> dict[str, Callable[[int], None]]:
    """Return short motions, there and back by turns, each with another controller."""

    def pose(i: int) -> RigidTransform:
        moved = FrankaConstants.HOME_POSE.copy()
        moved.translation[0] += 0.01 * (i % 2)
        return moved

    def joints(i: int) -> np.ndarray:
        return HOME + 0.01 * (i % 2)

    return {
        "internal impedance, joints": lambda i: fa.goto_joints(joints(i), 0.2),
        "internal impedance, pose": lambda i: fa.goto_pose(pose(i), 0.2, use_impedance=False),
        "joint impedance": lambda i: fa.goto_joints(joints(i), 0.2, use_impedance=True),
        "Cartesian impedance": lambda i: fa.goto_pose(pose(i), 0.2, buffer_time=0),
    }


def latencies(hold_time: float, pause: float) -> tuple[float, float]:
    """Return the median of the start and of the return in ms, each of the worst kind."""
    starts, returns = [], []
    with Simulation(hold_time=hold_time) as simulation, FrankaArm(server=simulation.server) as fa:
        fa.reset_joints(1)
        for name, move in kinds(fa).items():
            before, after = [], []
            for i in range(STARTS + 2):
                time.sleep(pause)
                called = time.monotonic_ns()
                move(i)
                returned = time.monotonic_ns()
                result = fa.last_skill_result
                before.append((result.first_command_ns - called) / 1e6)
                after.append((returned - result.last_cycle_ns) / 1e6)
            # The first two change the controller or its settings.
            starts.append(np.median(before[2:]))
            returns.append(np.median(after[2:]))
            print(
                f"hold {hold_time:g} s, {name}: start p50 {starts[-1]:.2f} p90 {np.percentile(before[2:], 90):.2f} ms, "
                f"return p50 {returns[-1]:.2f} p90 {np.percentile(after[2:], 90):.2f} ms",
                file=sys.stderr,
            )
    return float(max(starts)), float(max(returns))


def ends(ideal: bool) -> tuple[float, float, float]:
    """Return the worst ends: of an internal joint motion in rad, of Cartesian impedance in mm and degrees."""
    random = np.random.default_rng(1)
    joint, distance, angle = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.npy"

        def last_row(fa: FrankaArm) -> np.ndarray:
            return read_truth(truth, until=fa.get_arm_state().robot.message_id)[-1]

        arm = SimulatedArm(ideal=ideal, lockstep=True, truth=truth)
        with Simulation(arm) as simulation, FrankaArm(server=simulation.server) as fa:
            for _ in range(GOALS):
                goal = HOME + random.uniform(-0.5, 0.5, 7)
                fa.goto_joints(goal, 2, ignore_virtual_walls=True)
                joint.append(np.abs(last_row(fa)["q"] - goal).max())
                fa.reset_joints(2)
                pose = fa.get_pose()
                pose.translation += random.uniform(-0.12, 0.12, 3)
                pose.rotation = pose.rotation @ RigidTransform.rotation_from_axis_angle(random.uniform(-0.4, 0.4, 3))
                fa.goto_pose(pose, 3)
                end = last_row(fa)["O_T_TCP"].reshape(4, 4).T
                distance.append(1000 * np.linalg.norm(end[:3, 3] - pose.translation))
                turn = end[:3, :3].T @ pose.rotation
                angle.append(np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))))
    print(f"{'ideal' if ideal else 'default'} arm: joints {np.array(joint)} rad", file=sys.stderr)
    print(f"  Cartesian {np.round(distance, 2)} mm, {np.round(angle, 3)} degrees", file=sys.stderr)
    return float(max(joint)), float(max(distance)), float(max(angle))


def main() -> None:
    start_hold, return_hold = latencies(hold_time=5, pause=0.02)
    start_idle, return_idle = latencies(hold_time=0.02, pause=0.3)
    ideal, default = ends(ideal=True), ends(ideal=False)
    entries = {
        "skill_start_hold_ms_p50": start_hold,
        "skill_start_idle_ms_p50": start_idle,
        "skill_return_ms_p50": max(return_hold, return_idle),
        "internal_joint_end_error_rad": max(ideal[0], default[0]),
        "cartesian_end_error_ideal_mm": ideal[1],
        "cartesian_end_error_ideal_deg": ideal[2],
        "cartesian_end_error_default_mm": default[1],
        "cartesian_end_error_default_deg": default[2],
    }
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
