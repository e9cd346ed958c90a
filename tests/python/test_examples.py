"""The examples of docstrings and of examples/ run."""

import contextlib
import doctest
import os
import re
import shutil
import subprocess
import sys
import threading

import matplotlib.image
import numpy as np
import pytest
from conftest import REPOSITORY

import frankapy.franka_arm
from frankapy import FrankaArm
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


@contextlib.contextmanager
def led(simulation):
    """Lead the tool, a second after a demonstration has begun."""

    def takes_hold(state):
        if state.skill_description != "Demonstration" or state.skill_time < 1:
            return False
        simulation.pause()
        here = simulation.truth().O_T_TCP[:3, 3]
        simulation.hand(here + [[0, 0.1, 0], [0, 0.1, 0.08]], [2, 4])
        simulation.resume()
        return True

    def lead():
        with FrankaArm(server=simulation.server) as reader:
            reader.wait_for(lambda state: over.is_set() or takes_hold(state), 300)

    over = threading.Event()
    person = threading.Thread(target=lead)
    person.start()
    try:
        yield
    except BaseException:
        over.set()
        raise
    finally:
        person.join()


def test_the_readmes_scripts_run_one_after_the_other(start, monkeypatch):
    arm = start()
    monkeypatch.setenv("FRANKA_INTERFACE_SERVER", arm.server)
    scripts = re.findall(r"^```python\n(.*?)^```", (REPOSITORY / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    assert len(scripts) > 9
    variables: dict = {}
    with led(arm.simulation):
        for script in scripts:
            exec(compile(script, "README.md", "exec"), variables)
    variables["fa"].close()


PLATE = REPOSITORY / "sim" / "scenes" / "plate.xml"
SCENE = REPOSITORY / "sim" / "scenes" / "table_with_block.xml"
PICTURES = {"recording.py": ["recording.png"], "imitation.py": ["imitation.png"]}


@pytest.mark.parametrize(
    ("script", "arms"),
    [
        ("first_motion.py", [SimulatedArm(lockstep=True)]),
        pytest.param("pick_and_place.py", [SimulatedArm(lockstep=True, scene=SCENE)], marks=pytest.mark.nightly),
        ("stiffness.py", [SimulatedArm(lockstep=True)]),
        pytest.param("two_arms.py", [SimulatedArm("fr3", lockstep=True), SimulatedArm("fer", lockstep=True)], marks=pytest.mark.nightly),
        pytest.param("contact.py", [SimulatedArm(lockstep=True, scene=PLATE)], marks=pytest.mark.nightly),
        pytest.param("force_control.py", [SimulatedArm(lockstep=True, scene=PLATE)], marks=pytest.mark.nightly),
        pytest.param("recording.py", [SimulatedArm(lockstep=True)], marks=pytest.mark.nightly),
        pytest.param("imitation.py", [SimulatedArm(lockstep=True)], marks=pytest.mark.nightly),
        pytest.param("guidance_and_replay.py", [SimulatedArm(lockstep=True)], marks=pytest.mark.nightly),
    ],
)
def test_an_example_runs(script, arms, tmp_path):
    with Simulation(*arms) as simulation, contextlib.ExitStack() as helpers:
        if script in ("imitation.py", "guidance_and_replay.py"):
            helpers.enter_context(led(simulation))
        environment = os.environ | {"FRANKA_INTERFACE_SERVER": simulation.server}
        done = subprocess.run(
            [sys.executable, REPOSITORY / "examples" / script],
            env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert not done.stderr
        pictures = list(tmp_path.iterdir())
        assert [picture.name for picture in pictures] == PICTURES.get(script, [])
        for picture in pictures:
            assert np.ptp(matplotlib.image.imread(picture)) == 1  # from white to black


@pytest.mark.nightly
@pytest.mark.timeout(600)  # s: it compiles
def test_the_example_of_ones_own_controller_runs():
    # What was compiled before is found again, whatever the folder's name is.
    cache = {"CMAKE_CXX_COMPILER_LAUNCHER": "ccache", "CCACHE_BASEDIR": "/", "CCACHE_NOHASHDIR": "1"}
    done = subprocess.run(
        [sys.executable, REPOSITORY / "examples" / "own_controller.py"],
        env=os.environ | (cache if shutil.which("ccache") else {}), capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    stiff, soft = map(float, re.findall(r"ends ([0-9.]+) rad", done.stdout))
    assert stiff < soft


@pytest.mark.parametrize("script", ["streaming.py", "policy.py", "moveit.py"])
@pytest.mark.wall
def test_an_example_in_real_time_runs(script, tmp_path):
    test_an_example_runs(script, [SimulatedArm()], tmp_path)
