"""Scripts that are killed, at whatever moment: the next one has the arm."""

import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest
from conftest import HOME

from frankapy import FrankaArm, connection, proto
from frankapy.sim import SimulatedArm, Simulation

LONG = 1000  # s of the robot's clock
# What a script does when it is killed, which is in the middle of it: it does so for ever.
MOMENTS = {
    "it connects": """
        while True:
            told(), FrankaArm(server=sys.argv[1]).close()
    """,
    "it reads": """
        while True:
            told(), fa.get_joints()
    """,
    "it moves": f"""
        fa.goto_joints(HOME + 0.2, {LONG}, block=False, ignore_virtual_walls=True)
        told(), fa.wait_for_skill()
    """,
    "it begins motions": """
        for i in itertools.count():
            fa.run(MinJerkJoint(HOME + 0.01 * (i % 2), 1), preempt=True, block=False), told()
    """,
    "its motions are queued": f"""
        with fa.sequence():
            for i in range(8):
                fa.run(MinJerkJoint(HOME + 0.1 * (i % 2), {LONG})), told()
            fa.wait_for_skill()
    """,
    "it streams": f"""
        fa.goto_joints(HOME, {LONG}, dynamic=True)
        with fa.publisher(FC.DEFAULT_SENSOR_PUBLISHER_TOPIC) as publisher:
            while True:
                publisher.publish(proto.JointPositionSensorMessage(joints=HOME + 0.05)), told()
    """,
    "it is led": f"""
        fa.run_guide_mode({LONG}, block=False)
        told(), fa.wait_for_skill()
    """,
    "its hand moves": """
        while True:
            fa.goto_gripper(0.08, block=False), told(), fa.goto_gripper(0.01, block=False)
    """,
    "it records": """
        with fa.recording():
            told(), fa.goto_joints(HOME + 0.1, 1000, ignore_virtual_walls=True)
    """,
}
SCRIPT = """
import itertools, sys
import numpy as np
from frankapy import FrankaArm, FrankaConstants as FC, proto
from frankapy.parts import MinJerkJoint

HOME = np.array(FC.HOME_JOINTS)
told = lambda: print("there", flush=True)
fa = FrankaArm(server=sys.argv[1])
"""


def kill_in_the_middle(server: str, moment: str, how: signal.Signals) -> None:
    script = SCRIPT + textwrap.dedent(MOMENTS[moment])
    with subprocess.Popen([sys.executable, "-c", script, server], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as child:
        for _ in range(3 if "while True" in script else 1):
            assert child.stdout.readline() == b"there\n"
        child.send_signal(how)


@pytest.mark.parametrize(
    ("moment", "how"),
    [
        *((moment, signal.SIGKILL) for moment in MOMENTS),
        ("it moves", signal.SIGTERM),
        ("it moves", signal.SIGINT),
        ("its motions are queued", signal.SIGINT),
        ("its hand moves", signal.SIGTERM),
    ],
)
def test_the_next_script_has_arm_and_hand(ideal_arm, moment, how, monkeypatch):
    monkeypatch.setattr(connection, "_LEASE_TIME", 60)  # s: a computer may stand still
    kill_in_the_middle(ideal_arm.server, moment, how)
    with ideal_arm.client() as fa:
        fa.goto_joints(HOME, 1)
        np.testing.assert_allclose(fa.get_joints(), HOME, atol=0.002)
        fa.goto_gripper(0.05, ignore_errors=False)
        assert fa.get_gripper_width() == pytest.approx(0.05, abs=2e-3)


def test_a_recording_ends_with_the_script_that_wanted_it(tmp_path):
    with Simulation(SimulatedArm(), recordings=tmp_path) as simulation:
        kill_in_the_middle(simulation.server, "it records", signal.SIGKILL)
        with FrankaArm(server=simulation.server) as fa:
            until = time.monotonic() + 60
            while fa._server.ask(proto.Request(record=proto.Record())).recording.open:
                assert time.monotonic() < until
                time.sleep(0.05)


@pytest.mark.wall
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_the_next_script_moves_the_arm_within_a_second(how):
    with Simulation(SimulatedArm()) as simulation:
        kill_in_the_middle(simulation.server, "it moves", how)
        killed = time.monotonic()
        with FrankaArm(server=simulation.server) as fa:
            fa.goto_joints(HOME, 5, block=False)
            assert time.monotonic() - killed < 1.5  # 1 s where nothing else runs
            fa.stop_skill()
