"""Simulated arms with servers for the tests: in lockstep."""

import collections
import functools
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from frankapy import FrankaArm, FrankaArmException, FrankaConstants, channel, connection, sim
from frankapy.sim import SimulatedArm, Simulation, die_with_parent, read_truth

REPOSITORY = Path(__file__).resolve().parents[2]
HOME = np.array(FrankaConstants.HOME_JOINTS)
# rad/s: of FER and, beyond its envelope, FR3 (frankarobotics.github.io, robot and interface specifications).
FASTEST = {"fer": [2.175] * 4 + [2.61] * 3, "fr3": [2.62] * 4 + [5.26, 4.18, 5.26]}


def pytest_collection_modifyitems(items):
    """Of tests that run on both models leave the FER's to `make nightly`: most others run on that one alone."""

    def model(item) -> set[str]:
        parameters = item.callspec.params.values() if hasattr(item, "callspec") else ()
        return {each for each in parameters if isinstance(each, str)} & {"fer", "fr3"}

    models = collections.defaultdict(set)
    for item in items:
        models[item.function] |= model(item)
    for item in items:
        if len(models[item.function]) == 2 and "fer" in model(item):
            item.add_marker(pytest.mark.nightly)


@pytest.fixture(scope="session", autouse=True)
def recordings_folder(tmp_path_factory):
    """Let no test leave recordings in its user's data, or find its user's keys."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_DATA_HOME", str(tmp_path_factory.mktemp("data")))
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        patch.delenv("FRANKAPY_KEY", raising=False)
        yield


@pytest.fixture(scope="session", autouse=True)
def black_boxes_folder():
    """Let no server of another run take what these leave, or the other way round."""
    folder = tempfile.mkdtemp(prefix="frankapy-tests-", dir="/dev/shm")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FRANKA_INTERFACE_BLACK_BOXES", folder)
        yield
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session", autouse=True)
def patient_clients():
    """Let a computer that stands still for a while look like no server that has gone: where that is tested, tests say so."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(channel, "SILENCE", 60.0)
        patch.setattr(connection, "_START_TIME", 120.0)
        patch.setattr(connection, "_END_TIME", 30.0)
        patch.setattr(sim, "_START_TIME", 120.0)
        yield


@pytest.fixture(scope="session", autouse=True)
def programs_end_with_the_tests():
    """Let whatever a test starts end when the tests are killed, and by the signals that tests in the background are started without."""

    def before_start():
        die_with_parent()
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(subprocess.Popen, "__init__", functools.partialmethod(subprocess.Popen.__init__, preexec_fn=before_start))
        yield


class Arm:
    """A simulated arm, its server, and what really happened to it."""

    def __init__(self, simulation: Simulation, truth: Path | None):
        self.simulation = simulation
        self.server = simulation.server
        self._truth = truth

    def client(self, **arguments) -> FrankaArm:
        return FrankaArm(server=self.server, **arguments)

    @contextmanager
    def standing_still(self, **how):
        """Let the world stand still meanwhile, as Simulation.pause() says; what moves waits for at most ten seconds."""
        self.simulation.pause(**how)
        try:
            yield
        finally:
            self.simulation.resume()

    def end_motion(self, fa: FrankaArm) -> None:
        """End what the server still holds the arm with."""
        fa.stop_skill()
        deadline = time.monotonic() + 60
        while self.simulation.truth().moving:
            assert time.monotonic() < deadline
            time.sleep(0.005)

    def cycle(self, message_id: int | None = None) -> int:
        """Return the world's cycle: now, or in the state with that message_id, since which it has not stood still."""
        now = self.simulation.truth()
        return now.cycle if message_id is None else now.cycle - (now.message_id - message_id)

    def truth(self, since: int = 0) -> np.ndarray:
        """Return the rows of the truth since that cycle; waits until those up to now are in the file, see `starting`."""
        assert self._truth, "this arm writes no truth: say TRUTH_FILE = True in the module, or start(truth=True)"
        rows = read_truth(self._truth, until=self.cycle(), timeout=60)
        return rows[rows["cycle"] >= since]


def server_processes(simulation: Simulation) -> list[int]:
    """Return the server's supervisor, and then the process of each arm."""
    supervisor = simulation.processes[-1]
    children = Path(f"/proc/{supervisor}/task/{supervisor}/children").read_text().split()
    return [supervisor, *map(int, children)]


@contextmanager
def client_after_crash(arm: Arm) -> Iterator[FrankaArm]:
    """Kill the process of an arm, and give a client of the one that takes its place once that is ready."""
    os.kill(server_processes(arm.simulation)[1], signal.SIGKILL)
    deadline = time.monotonic() + 60
    while True:
        try:
            again = arm.client()
            break
        except FrankaArmException:
            assert time.monotonic() < deadline
            time.sleep(0.2)
    with again:
        again.wait_for_franka_interface(60)
        yield again


@contextmanager
def starting(request, tmp_path_factory):
    """Give a function which starts simulated arms with a server; they run until the end of this, and one that idles takes a fifth of
    a processor.

    An arm writes a truth file, 15 MB in a second of lockstep, where its module says TRUTH_FILE = True or start() is told to.
    """
    started = []
    with ExitStack() as running:

        def start(truth: bool = getattr(request.module, "TRUTH_FILE", False), hold_time: float | None = None, settings=None, **options) -> Arm:
            truth = tmp_path_factory.mktemp("truth") / "truth.npy" if truth else None
            arm = SimulatedArm(lockstep=True, truth=truth, **options)
            simulation = running.enter_context(Simulation(arm, hold_time=hold_time, settings=settings))
            started.append(simulation)
            return Arm(simulation, truth)

        yield start
        for simulation in started:
            simulation.check()  # one that has ended says why


@pytest.fixture
def start(request, tmp_path_factory):
    with starting(request, tmp_path_factory) as start:
        yield start


@pytest.fixture(scope="module")
def start_for_module(request, tmp_path_factory):
    with starting(request, tmp_path_factory) as start:
        yield start


@pytest.fixture(scope="module")
def ideal_arm(start_for_module):
    return start_for_module(ideal=True)


@pytest.fixture(scope="module")
def default_arm(start_for_module):
    return start_for_module()


@pytest.fixture
def fa(ideal_arm):
    """Return a client of the ideal arm, which is brought home."""
    with ideal_arm.client() as fa:
        fa.recover()
        fa.goto_joints(HOME, 1)
        yield fa
