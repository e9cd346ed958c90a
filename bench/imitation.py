"""Movement primitives: how long learning takes, and how near what the arm does is to what was shown, beside another package.

  dmp_fit_s                    of a demonstration of 10 s of seven joints
  dmp_rms_mm, dmp_rms_deg      of a pose that turns by 150 degrees, in the truth file, beside what was shown
  dmp_goal_mm                  from another goal that was asked for, where the tool ends
  dmp_rms_mm_movement_primitives   of that package's reproduction of the same positions, without an arm
  dmp_rollout_rms_mm           of ours, without an arm
  import_s                     of `import frankapy`, the least of several
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from frankapy import FrankaArm, FrankaConstants, RigidTransform, dmp
from frankapy.demonstration import Demonstration
from frankapy.parts import InternalImpedance
from frankapy.sim import SimulatedArm, Simulation, read_truth

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY / "tests" / "interop"))
from peer import environment, left_out  # noqa: E402

PEER = "movement-primitives", "0.9.1"
PEER_SCRIPT = """
import sys
import numpy as np
from movement_primitives.dmp import DMP
data = np.load(sys.argv[1])
dmp = DMP(n_dims=3, execution_time=data["times"][-1], dt=data["times"][1], n_weights_per_dim=25)
dmp.imitate(data["times"], data["positions"])
times, made = dmp.open_loop(run_t=data["times"][-1])
made = np.column_stack([np.interp(data["times"], times, column) for column in made.T])
print(1000 * np.sqrt(np.mean(np.sum((made - data["positions"]) ** 2, axis=1))))
"""


def rise(s: np.ndarray) -> np.ndarray:
    return s**3 * (10 - 15 * s + 6 * s**2)


def pouring(start: np.ndarray, rotation: np.ndarray) -> Demonstration:
    """Return a motion of the tool with a bow and a loop, that turns by 150 degrees, as fast as the arm can be led along it.

    What is faster than the arm's joints may accelerate would be slowed there, and be late beside what was shown from then on.
    """
    s = np.linspace(0, 1, 1001)
    p = rise(s)
    bow = 4 * p * (1 - p)
    positions = start + np.outer(p, [0.1, -0.15, -0.1]) + np.outer(bow, [0, 0.05, 0.08]) + np.outer(bow * np.sin(6 * np.pi * p), [0.02, 0, 0.02])
    turns = [RigidTransform.z_axis_rotation(np.radians(150) * each) @ rotation for each in p]
    orientations = np.array([RigidTransform(turn, np.zeros(3)).quaternion for turn in turns])
    return Demonstration(5 * s, None, positions, orientations)


def peer_rms(demonstration: Demonstration) -> float:
    """Let the independent package learn the same positions."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "shown.npz"
        np.savez(file, times=demonstration.times, positions=demonstration.positions)
        done = subprocess.run([environment(*PEER), "-c", PEER_SCRIPT, str(file)], capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def on_the_arm(entries: dict[str, float]) -> Demonstration:
    """Let a simulated arm do what was learned; return what was shown."""
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.npy"
        with Simulation(SimulatedArm(lockstep=True, truth=truth)) as simulation, FrankaArm(server=simulation.server) as fa:
            home = np.array(FrankaConstants.HOME_JOINTS)
            fa.goto_joints(home + [0, 0, 0, 0, 0, 0, 1.2], 3, ignore_virtual_walls=True)
            pose = fa.get_pose(include_tool_offset=False)
            shown = pouring(pose.translation, pose.rotation)
            primitive = dmp.fit(shown, "pose")
            first = simulation.truth().cycle
            stretch = fa.run(primitive.part(), InternalImpedance()).stretch
            print(f"what was learned of a pose took {stretch:.4f} times as long as was shown", file=sys.stderr)
            rows = read_truth(truth, until=simulation.truth().cycle)
            rows = rows[rows["cycle"] > first]
            matrices = rows["O_T_TCP"].reshape(-1, 4, 4).transpose(0, 2, 1)
            count = round(1000 * shown.duration)
            even = shown.resampled(count + 1)
            best = np.inf, np.inf
            for begin in range(len(matrices) - count):  # the truth begins before the motion, and lags it a little
                part = matrices[begin : begin + count + 1]
                distance = np.sqrt(np.mean(np.sum((part[:, :3, 3] - even.positions) ** 2, axis=1)))
                if distance < best[0]:
                    q = np.array([RigidTransform(matrix[:3, :3], np.zeros(3)).quaternion for matrix in part[::20]])
                    cosines = np.abs(np.sum(q * even.orientations[::20], axis=1))
                    best = distance, np.sqrt(np.mean(np.square(2 * np.arccos(np.minimum(cosines, 1)))))
            entries["dmp_rms_mm"], entries["dmp_rms_deg"] = 1000 * best[0], float(np.degrees(best[1]))

            fa.goto_joints(home, 3)
            start = fa.get_pose(include_tool_offset=False).translation
            goal = start + [0.12, 0.1, -0.12]
            fa.run(dmp.fit(shown, "position").part(3, start=start, goal=goal), InternalImpedance())
            end = read_truth(truth, until=simulation.truth().cycle)["O_T_TCP"][-1].reshape(4, 4)[3, :3]
            entries["dmp_goal_mm"] = 1000 * float(np.linalg.norm(end - goal))
    return shown


def main() -> None:
    s = np.linspace(0, 1, 10_000)
    long = Demonstration(10 * s, np.outer(rise(s), np.linspace(0.1, 0.7, 7)) + 0.05 * np.outer(np.sin(20 * s), np.ones(7)))
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        dmp.fit(long, "joint")
        times.append(time.perf_counter() - begin)
    entries: dict[str, float] = {"dmp_fit_s": min(times)}
    shown = on_the_arm(entries)
    entries["dmp_rollout_rms_mm"] = 1000 * dmp.fit(shown, "position").rms
    with left_out(*PEER):
        entries["dmp_rms_mm_movement_primitives"] = peer_rms(shown)
    imports = []
    for _ in range(5):
        code = "import time; t = time.perf_counter(); import frankapy; print(time.perf_counter() - t)"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        imports.append(float(done.stdout))
    entries["import_s"] = min(imports)
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
