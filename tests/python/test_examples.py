"""The examples of docstrings and of examples/ run."""

import doctest
import os
import subprocess
import sys

import pytest
from conftest import REPOSITORY

import frankapy.franka_arm
from frankapy.sim import SimulatedArm, Simulation


def docstrings():
    finder = doctest.DocTestFinder(exclude_empty=True)
    return [test for test in finder.find(frankapy.franka_arm) if test.examples]


@pytest.mark.parametrize("test", docstrings(), ids=lambda test: test.name.removeprefix("frankapy.franka_arm."))
def test_a_docstrings_example_runs(test, ideal_arm, monkeypatch):
    monkeypatch.setenv("FRANKA_INTERFACE_SERVER", ideal_arm.server)
    with ideal_arm.client() as fa:
        fa.reset_joints(1)
        test.globs = {"fa": fa}
        if any("FrankaArm()" in example.source for example in test.examples):
            fa.close()
        failures = []
        doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=failures.append, clear_globs=False)
        # What is printed differs from run to run; an exception does not.
        assert not [text for text in failures if "Traceback" in text]
        test.globs["fa"].close()


SCENE = REPOSITORY / "sim" / "scenes" / "table_with_block.xml"


@pytest.mark.parametrize(
    ("script", "arms"),
    [
        ("first_motion.py", [SimulatedArm(lockstep=True)]),
        ("pick_and_place.py", [SimulatedArm(lockstep=True, scene=SCENE)]),
        ("stiffness.py", [SimulatedArm(lockstep=True)]),
        ("two_arms.py", [SimulatedArm("fr3", lockstep=True), SimulatedArm("fer", lockstep=True)]),
    ],
)
def test_an_example_runs(script, arms):
    with Simulation(*arms) as simulation:
        environment = os.environ | {"FRANKA_INTERFACE_SERVER": simulation.server}
        done = subprocess.run(
            [sys.executable, REPOSITORY / "examples" / script],
            env=environment, capture_output=True, text=True, timeout=120, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert not done.stderr
