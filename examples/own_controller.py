"""A controller of your own: `frankapy new` writes it, CMake builds it, the server loads it. An arm is started for it.

What is written is a spring in each joint, and the beginning of yours: docs/your-own-part.md.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from frankapy import FrankaArm, FrankaConstants
from frankapy.new_part import package_folder
from frankapy.parts import RelativeMinJerkJoint
from frankapy.sim import SimulatedArm, Simulation


def run(*command: object) -> None:
    """Run a program, which must succeed."""
    subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)


with tempfile.TemporaryDirectory() as name:
    folder, build = Path(name) / "my_spring", Path(name) / "my_spring" / "build"
    run(sys.executable, "-m", "frankapy.cli", "new", "controller", "my_spring", "--folder", folder)
    run("cmake", "-S", folder, "-B", build, f"-Dfranka-interface_DIR={package_folder()}")
    run("cmake", "--build", build, "--parallel")
    run("ctest", "--test-dir", build)

    sys.path.append(str(build))  # its message, as Python
    from my_spring_pb2 import MySpring

    arm = SimulatedArm(lockstep=True)  # as fast as this computer can
    with Simulation(arm, load=[build / "libmy_spring.so"]) as simulation, FrankaArm(server=simulation.server) as fa:
        for stiffness in (1000, 100):
            fa.goto_joints(FrankaConstants.HOME_JOINTS, duration=2)
            goal = fa.get_joints() + [0, 0.1, 0, 0, 0, 0, 0]
            fa.run(RelativeMinJerkJoint([0, 0.1, 0, 0, 0, 0, 0], 2), MySpring(stiffness=[stiffness] * 7))
            print(f"{stiffness:4} Nm/rad: ends {np.abs(fa.get_joints() - goal).max():.4f} rad beside its goal")
