"""How much faster than real time official libfranka runs the simulated arm in lockstep: its binary in pylibfranka 0.21.3,
joint positions at 1 kHz from Python.

  lockstep_pylibfranka_factor   robot's time by the time it took, over 20 s of a motion
"""

import json
import subprocess
import sys
from pathlib import Path

from frankapy.sim import program

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY / "tests" / "interop"))
from peer import environment, simulated_arm  # noqa: E402

CLIENT = """
import sys, time
import numpy as np
import pylibfranka as franka

robot = franka.Robot(sys.argv[1], franka.RealtimeConfig.kIgnore)
start = np.array(robot.read_once().q_d)
control = robot.start_joint_position_control(franka.ControllerMode.JointImpedance)
t, begin, period = 0.0, None, 4.0
while True:
    state, duration = control.readOnce()
    if begin is None:
        begin = time.perf_counter()
    else:
        t += duration.to_sec()
    command = franka.JointPositions(list(start + 0.05 * (1 - np.cos(2 * np.pi * t / period)) ** 2))
    command.motion_finished = t >= 20.0
    control.writeOnce(command)
    if command.motion_finished:
        break
took = time.perf_counter() - begin
if abs(np.array(robot.read_once().q) - start).max() > 0.01:
    sys.exit("the arm is not where it was told to go")
print(t / took)
"""


def main() -> None:
    python = environment("pylibfranka", "0.21.3")
    with simulated_arm(program("fci-sim"), "--lockstep") as address:
        done = subprocess.run([python, "-c", CLIENT, address], stdout=subprocess.PIPE, text=True, check=True)
    print(json.dumps({"lockstep_pylibfranka_factor": float(done.stdout.split()[-1])}))


if __name__ == "__main__":
    main()
