"""How long a script waits to hear whether the way of a 5 s motion is clear.

  path_check_ms_p50        fa.check() of such a motion of joints, 20 boxes about the arm
  path_check_pose_ms_p50   the same of a motion of a pose, whose joints are found along the way
"""

import json
import time

import numpy as np

from frankapy import FrankaArm, FrankaConstants, proto
from frankapy.parts import MinJerkJoint, MinJerkPose
from frankapy.sim import SimulatedArm, Simulation
from frankapy.walls import Box

DURATION = 5.0  # s
CHECKS = 100


def main() -> None:
    home = np.array(FrankaConstants.HOME_JOINTS)
    with Simulation(SimulatedArm("fr3", lockstep=True)) as simulation, FrankaArm(server=simulation.server) as fa:
        fa.reset_joints(3)
        angles = np.arange(20) * np.pi / 10
        fa.walls.update({f"{a:.2f}": Box([0.1, 0.1, 0.1], [0.95 * np.cos(a), 0.95 * np.sin(a), 0.3 + 0.1 * a]) for a in angles})
        goal = fa.get_pose()
        goal.translation[:] += [0.1, 0.1, -0.1]
        motions = {
            "path_check_ms_p50": MinJerkJoint(home + [0.8, 0.1, 0, 0.1, 0, 0.1, 0], DURATION),
            "path_check_pose_ms_p50": MinJerkPose(goal, DURATION),
        }
        entries = {}
        for name, motion in motions.items():
            times = []
            for _ in range(CHECKS):
                start = time.perf_counter()
                checked: proto.SkillChecked = fa.check(motion)
                times.append(1e3 * (time.perf_counter() - start))
                if checked.duration < DURATION:
                    raise SystemExit(f"{name}: a motion of {DURATION} s would take {checked.duration} s")
            entries[name] = float(np.median(times))
    print(json.dumps(entries))


if __name__ == "__main__":
    main()
