"""How well the arm does what it is told, judged by the truth of the physics; FER, with the friction of its joints.

  figure_eight_rms_mm            of EE from a figure of eight, 0.2 m wide, that Cartesian impedance follows at 600 N/m, two
                                 rounds in 12 s; _panda_python: the law of panda-python 1.1.1, of the same stiffness
  hybrid_force_error_estimated_n, hybrid_force_error_truth_n
                                 root mean square from 10 N on a smooth plate that is wiped, as the robot estimates it and in
                                 truth (the mean over 20 ms: hard fingertips that slide on a hard plate chatter)
  hybrid_force_mean_n            in truth
  hybrid_force_overshoot_pct     of either, when the arm comes to the plate
  joint_impedance_end_error_rad  worst joint, 1 s after a motion, with 600 to 50 N m/rad; _panda_python; _integral: with it
  time_optimal_excess_cycles     of a point-to-point motion, over the duration that Ruckig plans

Ours in lockstep, the peer in real time, as it sleeps between the poses that it sends. It is left out where it is not
installed and cannot be.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import ruckig
from shared.arm import HOME, arm, rms, rows_since
from shared.figure_eight import figure_eight

from frankapy import parts, proto
from frankapy.parts import (
    CartesianImpedance,
    HybridForcePosition,
    InternalImpedance,
    JointImpedance,
    MinJerkJoint,
    MinJerkPose,
    RelativeMinJerkPose,
    StayPose,
    Time,
    TimeOptimalJoint,
)
from frankapy.sim import program, read_truth

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY / "tests" / "interop"))
from peer import environment, left_out, simulated_arm  # noqa: E402

GOAL = HOME + [0.4, -0.2, 0.3, 0.3, -0.3, 0.4, 0.5]
SECONDS = 12.0
FORCE = 10.0  # N
MOTION_SHARE = 0.94  # of the limits of the arm that motions use
SPEED = 0.5  # of these, so that EE stays within its own limits
LIMITS = {  # of the FER
    "max_velocity": [2.175] * 4 + [2.61] * 3,
    "max_acceleration": [15, 7.5, 10, 12.5, 15, 20, 20],
    "max_jerk": [7500, 3750, 5000, 6250, 7500, 10000, 10000],
}
PEER = ("panda-python", "1.1.1")
PEER_SCRIPT = """
import json, sys, time
import numpy as np
import panda_py
from panda_py import controllers

address, task, given = sys.argv[1], sys.argv[2], json.load(sys.stdin)
panda = panda_py.Panda(address)
panda.move_to_joint_position(given["home"], speed_factor=0.5)
if task == "joints":
    panda.move_to_joint_position(given["goal"], speed_factor=0.5)
    time.sleep(1)
    print(json.dumps({}))
else:
    start, quaternion = panda.get_position(), panda.get_orientation()
    way = np.array(given["way"])
    law = controllers.CartesianImpedance(damping_ratio=1.0, filter_coeff=1.0)
    panda.start_controller(law)
    sent = []
    with panda.create_context(frequency=1000, max_runtime=len(way) / 1000) as context:
        begin = None
        while context.ok():
            now = panda.get_state().time.to_msec()
            begin = now if begin is None else begin
            if now - begin >= len(way):
                break
            law.set_control(start + way[int(now - begin)], quaternion)
            sent.append([now, int(now - begin)])
    panda.stop_controller()
    print(json.dumps({"start": list(start), "sent": sent}))
"""


# --- following -----------------------------------------------------------------------------------------------------------


def follow_eight() -> dict[str, float]:
    if not hasattr(proto, "PoseSamples"):
        return {}
    way = figure_eight(SECONDS)
    with arm() as (_, fa, truth):
        start = fa.get_pose(include_tool_offset=False)
        samples = parts.PoseSamples(start.translation + way, np.tile(start.quaternion, (len(way), 1)))
        with fa.states() as states:
            result = fa.run(samples, CartesianImpedance(600, [30] * 3))
            # The reference that was commanded in the cycle of a state is the sample of its time.
            when = {}
            for state in states:
                if state.skill_id == result.skill_id:
                    when[state.robot.message_id] = round(1000 * state.skill_time)
                elif when:
                    break
        rows = rows_since(truth, min(when), max(when))
    wanted = np.array([start.translation + way[min(when.get(cycle, 0), len(way) - 1)] for cycle in rows["cycle"]])
    return {"figure_eight_rms_mm": 1e3 * rms(np.linalg.norm(rows["O_T_TCP"][:, 12:15] - wanted, axis=1))}


def time_optimal() -> dict[str, float]:
    with arm(ideal=True) as (_, fa, _):
        planner = ruckig.Ruckig(7)
        plan, limits = ruckig.Trajectory(7), ruckig.InputParameter(7)
        limits.current_position, limits.target_position = list(HOME), list(GOAL)
        for name, values in LIMITS.items():
            setattr(limits, name, list(SPEED * MOTION_SHARE * np.array(values)))
        planner.calculate(limits, plan)
        worst = 0.0
        for law in (InternalImpedance(), JointImpedance()):
            fa.run(MinJerkJoint(HOME, 2), InternalImpedance())
            result = fa.run(TimeOptimalJoint(GOAL, SPEED), law)
            worst = max(worst, 1000 * (result.time - plan.duration))
    return {"time_optimal_excess_cycles": worst}


def end_of_joints() -> dict[str, float]:
    entries = {}
    with arm() as (simulation, fa, _):
        for name, law in (("", JointImpedance()), ("_integral", JointImpedance(integral_rate=4))):
            fa.run(MinJerkJoint(HOME, 2))
            fa.run(MinJerkJoint(GOAL, 2), law, Time(after_trajectory=1))
            entries[f"joint_impedance_end_error_rad{name}"] = float(np.abs(simulation.truth().q - GOAL).max())
    return entries


# --- pressing ------------------------------------------------------------------------------------------------------------


def press() -> dict[str, float]:
    law = HybridForcePosition([0, 0, 1, 0, 0, 0], [0, 0, -FORCE, 0, 0, 0])
    with arm(scene="plate") as (simulation, fa, truth):
        simulation.set_friction("plate", 0.1)
        above = fa.get_pose(include_tool_offset=False)
        above.translation = [0.48, -0.08, 0.22]
        fa.run(MinJerkPose(above, 2), CartesianImpedance(1500, 100))
        began = fa.get_arm_state().robot.message_id
        with fa.states() as states:
            with fa.sequence() as results:
                fa.run(StayPose(3), law)
                for way in ([0.02, 0.16, 0], [0.02, -0.16, 0], [0, 0.16, 0]):
                    fa.run(RelativeMinJerkPose(way, frame="base", duration=2), law)
            total = round(1000 * sum(result.time for result in results))
            estimated = {}
            for state in states:
                estimated[state.robot.message_id] = -state.robot.O_F_ext_hat_K[2]
                if state.robot.message_id >= began + total:
                    break
        rows = rows_since(truth, began, began + total)
    real = np.convolve(rows["contact_wrench"][:, 2], np.full(20, 0.05), mode="same")
    felt = np.array([estimated.get(cycle, np.nan) for cycle in rows["cycle"]])
    coming, wiping = slice(0, 3000), slice(3000, None)
    most = max(np.nanmax(felt[coming]), real[coming].max())
    return {
        "hybrid_force_error_estimated_n": rms(felt[wiping][np.isfinite(felt[wiping])] - FORCE),
        "hybrid_force_error_truth_n": rms(real[wiping][:-20] - FORCE),
        "hybrid_force_mean_n": float(real[wiping][:-20].mean()),
        "hybrid_force_overshoot_pct": float(max(0, most / FORCE - 1) * 100),
    }


# --- the peer ------------------------------------------------------------------------------------------------------------


def peer_does(python: Path, task: str, given: dict) -> tuple[dict, np.ndarray]:
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.npy"
        with simulated_arm(program("fci-sim"), "--robot", "fer", "--truth", str(truth)) as address:
            command = [python, "-c", PEER_SCRIPT, address, task]
            done = subprocess.run(command, input=json.dumps(given), check=True, capture_output=True, text=True, timeout=120)
            time.sleep(0.3)
            rows = read_truth(truth)
    return json.loads(done.stdout.strip().splitlines()[-1]), rows


def peer() -> dict[str, float]:
    with left_out(*PEER):
        return peer_entries(environment(*PEER))
    return {}


def peer_entries(python: Path) -> dict[str, float]:
    _, rows = peer_does(python, "joints", {"home": HOME.tolist(), "goal": GOAL.tolist()})
    entries = {"joint_impedance_end_error_rad_panda_python": float(np.abs(rows["q"][-1] - GOAL).max())}
    way = figure_eight(SECONDS)
    told, rows = peer_does(python, "eight", {"home": HOME.tolist(), "way": way.tolist()})
    place = dict(told["sent"])
    rows = rows[np.isin(rows["cycle"], list(place))]
    wanted = np.array([np.array(told["start"]) + way[place[cycle]] for cycle in rows["cycle"]])
    # At most as old as its Python loop is slow; what is lost there is its own way to be commanded.
    away = np.linalg.norm(rows["O_T_TCP"][:, 12:15] - wanted, axis=1)
    return entries | {"figure_eight_rms_mm_panda_python": 1e3 * rms(away)}


def main() -> None:
    entries = {}
    for part in (press, end_of_joints, time_optimal, follow_eight, peer):
        entries |= part()
        print(part.__name__, entries, file=sys.stderr)
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
