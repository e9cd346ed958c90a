"""Guarded moves that land on a plate of 10 N/mm, judged by the truth of the physics: how hard, and whether the robot minds. FER and
FR3, in lockstep; where one number is given, it is the worse arm's.

  landing_stiffness_n_per_mm  of the plate: how much harder it is pressed on for each mm that the fingers are lower
  landing_peak_ratio_fast     at 0.1 m/s: peak force of a move that ends with Contact (momentum observer) and backs off, over that
                              of an arm whose torque beyond gravity is cut in the cycle of its first touch, which comes down on the
                              same way; the worst of SPOTS
  landing_peak_ratio_slow     at 0.02 m/s
  landing_peak_ratio_fast_motion, _slow_motion   the same under the robot's own impedance, whose reference can only be braked
  landing_peak_ratio_fast_robot, _slow_robot     the same by the robot's estimate, which is low-passed
  landing_peak_n_fast, landing_peak_n_slow, landing_peak_n_fast_cut, ...   these peaks
  landing_peak_n_fast_50_n_per_mm, ...   on stiffer plates, under torque control
  landing_reflexes            of `landings` (200) at random spots, half of them fast, half under the robot's own impedance: those that
                              ended otherwise than with Contact
  landing_free_torque_nm, landing_free_force_n   the most that the observer finds in fast random motions of an arm that touches
                              nothing, of the joint or axis that is nearest to its threshold

    bench/landing.py [LANDINGS]
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from shared.arm import HOME, arm, rows_since
from tqdm import tqdm

from frankapy import FrankaArm, FrankaArmArgumentError, proto
from frankapy.parts import (
    BackOff,
    CartesianImpedance,
    CartesianVelocity,
    Contact,
    HybridForcePosition,
    InternalImpedance,
    JointImpedance,
    MinJerkPose,
    StayPose,
    Time,
    TimeOptimalJoint,
)
from frankapy.sim import Simulation, program, read_truth

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY / "tests" / "interop"))
from peer import simulated_arm  # noqa: E402

ROBOTS = ("fer", "fr3")
SCENE = REPOSITORY / "sim" / "scenes" / "sprung_plate.xml"
SPEEDS = {"fast": (0.1, 0.06), "slow": (0.02, 0.01)}  # m/s, and from how high, m
WAYS = {  # controller, and whose estimate of the force
    "": (CartesianImpedance, "observer"),
    "_motion": (InternalImpedance, "observer"),
    "_robot": (CartesianImpedance, "robot"),
}
SPOTS = [(0.5, 0.0), (0.44, 0.2), (0.6, -0.15)]  # m
TOP, CLEAR = 0.2, 0.012  # m: of the plate; that the fingertips are below EE
SOFTLY = [15, 15, 3, 5, 5, 5]  # N, N m
STIFFER = (50, 100)  # N/mm
TORQUES, FORCES = np.array([5, 5, 5, 5, 3, 3, 3]), np.array([12, 12, 12, 5, 5, 5])  # thresholds of the observer
FREE_MOTIONS = 40
CUT = REPOSITORY / "build" / "bench" / "cut_at_touch"


@contextmanager
def arm_at_plate(robot: str, scene: Path | str = SCENE) -> Iterator[tuple[Simulation, FrankaArm, Path]]:
    with arm(robot, scene=scene) as (simulation, fa, truth):
        fa.goto_gripper(0)
        yield simulation, fa, truth


def force_of(rows: np.ndarray) -> np.ndarray:
    return rows["contact_wrench"][:, 2]


def go_above(fa: FrankaArm, spot: tuple[float, float], height: float) -> None:
    above = fa.get_pose(include_tool_offset=False)
    above.translation = [*spot, TOP + CLEAR + height]
    fa.run(MinJerkPose(above, 1.5), CartesianImpedance(1500, 100, integral_rate=3))


def land(simulation: Simulation, fa: FrankaArm, truth: Path, spot: tuple[float, float], speed: str, way: str) -> np.ndarray:
    """Return what truly happened from the start of the move on."""
    v, height = SPEEDS[speed]
    go_above(fa, spot, height)
    began = simulation.truth().cycle
    law, estimate = WAYS[way]
    until = [Contact(force_thresholds=SOFTLY, estimate=estimate, then=BackOff(0.005)), Time(2 * height / v)]
    result = fa.run(CartesianVelocity([0, 0, -v, 0, 0, 0], [1] * 6, duration=2 * height / v), law(), until)
    if result.ending != proto.TERMINATED or result.termination != "Contact":
        raise RuntimeError(f"ended by {result.termination or result.errors}: {result.message}")
    return rows_since(truth, began, simulation.truth().cycle)


def peak_of_cut(robot: str, rows: np.ndarray) -> float:
    """Return the peak force of an arm that comes down as in these rows, and is cut off at its first touch."""
    touch = int(np.argmax(force_of(rows) > 0))
    moving = rows[:touch]
    ahead = np.arange(1, 301)[:, None] * 1e-3
    way = np.concatenate([moving["q"], moving["q"][-1] + ahead * moving["dq"][-1]])
    speed = np.concatenate([moving["dq"], np.repeat(moving["dq"][-1:], 300, axis=0)])
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.npy"
        options = ["--robot", robot, "--protocol", "10", "--lockstep", "--scene", str(SCENE), "--truth", str(truth)]
        with simulated_arm(program("fci-sim"), *options) as address:
            text = "\n".join(" ".join(f"{x:.9f}" for x in row) for row in np.hstack([way, speed]))
            height = rows["O_T_TCP"][touch][14]
            subprocess.run([CUT, address, f"{height:.6f}"], input=text, text=True, check=True, timeout=120)
        done = read_truth(truth)
    first = int(np.argmax(force_of(done) > 0))
    speeds = [np.gradient(each["O_T_TCP"][:, 14], 1e-3)[n - 2] for each, n in ((rows, touch), (done, first))]
    print(f"at the touch {1e3 * speeds[0]:.1f} mm/s, cut {1e3 * speeds[1]:.1f} mm/s", file=sys.stderr)
    if abs(speeds[1] / speeds[0] - 1) > 0.05:
        raise RuntimeError("the arm that is cut off did not come down as the other")
    return float(force_of(done)[first : first + 400].max())


def stiffness() -> dict[str, float]:
    with arm_at_plate(ROBOTS[0]) as (simulation, fa, truth):
        go_above(fa, SPOTS[0], 0.005)
        at = []
        for force in (5.0, 15.0):
            fa.run(StayPose(3), HybridForcePosition([0, 0, 1, 0, 0, 0], [0, 0, -force, 0, 0, 0]))
            now = simulation.truth().cycle
            rows = rows_since(truth, now - 300, now)
            at.append((force_of(rows).mean(), rows["O_T_TCP"][:, 14].mean()))
    (less, high), (more, low) = at
    return {"landing_stiffness_n_per_mm": (more - less) / (high - low) * 1e-3}


def ratios(robot: str) -> dict[str, float]:
    entries: dict[str, float] = {}

    def see(name: str, value: float) -> None:
        entries[name] = max(entries.get(name, 0), value)

    with arm_at_plate(robot) as (simulation, fa, truth):
        for speed in SPEEDS:
            for spot in SPOTS:
                landed = {way: land(simulation, fa, truth, spot, speed, way) for way in WAYS}
                cut = peak_of_cut(robot, landed[""])
                see(f"landing_peak_n_{speed}_cut", cut)
                for way, rows in landed.items():
                    peak = float(force_of(rows).max())
                    see(f"landing_peak_n_{speed}{way}", peak)
                    see(f"landing_peak_ratio_{speed}{way}", peak / cut)
                    print(f"{robot} {speed}{way} at {spot}: {peak:.1f} N, cut {cut:.1f} N", file=sys.stderr)
    return entries


def stiffer(robot: str) -> dict[str, float]:
    entries = {}
    for plate in STIFFER:
        with tempfile.TemporaryDirectory() as folder:
            scene = Path(folder) / "plate.xml"
            text = SCENE.read_text().replace('stiffness="10000"', f'stiffness="{1000 * plate}"')
            scene.write_text(text.replace('file="parts/', f'file="{SCENE.parent}/parts/'))
            with arm_at_plate(robot, scene) as (simulation, fa, truth):
                for speed in SPEEDS:
                    rows = land(simulation, fa, truth, SPOTS[0], speed, "")
                    entries[f"landing_peak_n_{speed}_{plate}_n_per_mm"] = float(force_of(rows).max())
    return entries


def reflexes(robot: str, landings: int) -> int:
    generator = np.random.default_rng(3)
    count = 0
    with arm_at_plate(robot) as (simulation, fa, truth):
        for n in tqdm(range(landings), unit="landing", desc=robot, disable=None):
            spot = (generator.uniform(0.38, 0.62), generator.uniform(-0.25, 0.25))
            try:
                land(simulation, fa, truth, spot, list(SPEEDS)[n % 2], list(WAYS)[n // 2 % 2])
            except Exception as error:
                print(f"{robot}: landing {n} at {spot}: {error}", file=sys.stderr)
                count += 1
                fa.reset_joints()
    return count


def free_motion(robot: str) -> dict[str, float]:
    """Let an arm go fast to random places and look at what the observer makes of it."""
    generator = np.random.default_rng(5)
    torques, forces = [], []
    with arm(robot) as (_, fa, _), fa.states(fields=["robot.message_id", "tau_ext_observed", "O_F_ext_observed"]) as states:
        done = 0
        while done < FREE_MOTIONS:
            motion = TimeOptimalJoint(HOME + generator.uniform(-0.7, 0.7, 7), 0.9)
            with suppress(FrankaArmArgumentError):  # where the arm would meet itself
                last = fa.run(motion, [JointImpedance(), InternalImpedance()][done % 2]).last_state.robot.message_id
                done += 1
            for state in states:
                torques.append(state.tau_ext_observed)
                forces.append(state.O_F_ext_observed)
                if state.robot.message_id >= last:
                    break
    for name, values in (("torque", np.array(torques)), ("force", np.array(forces))):
        for what, each in (("rms", np.sqrt(np.mean(values**2, axis=0))), ("most", np.abs(values).max(axis=0))):
            print(f"{robot}: free {name}, {what}: {' '.join(f'{x:.3f}' for x in each)} in {len(values)} cycles", file=sys.stderr)
    torque, force = np.max(np.abs(torques) / TORQUES), np.max(np.abs(forces) / FORCES)
    return {"landing_free_torque_nm": torque * TORQUES[0], "landing_free_force_n": force * FORCES[0]}


def main() -> None:
    landings = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    entries = stiffness()
    for robot in ROBOTS:
        for part in (free_motion, ratios, stiffer):
            for name, value in part(robot).items():
                entries[name] = max(float(value), entries.get(name, 0.0))
        print(robot, entries, file=sys.stderr)
    entries["landing_reflexes"] = sum(reflexes(robot, landings // len(ROBOTS)) for robot in ROBOTS)
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
