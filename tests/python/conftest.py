"""Simulated arms with servers for the tests: one of each kind, started once, in lockstep."""

from pathlib import Path

import numpy as np
import pytest

from frankapy import FrankaArm, FrankaConstants
from frankapy.sim import SimulatedArm, Simulation, read_truth

REPOSITORY = Path(__file__).resolve().parents[2]
HOME = np.array(FrankaConstants.HOME_JOINTS)


class Arm:
    """A simulated arm, its server, and what really happened to it."""

    def __init__(self, simulation: Simulation, truth: Path):
        self.simulation = simulation
        self.server = simulation.server
        self._truth = truth

    def client(self, **arguments) -> FrankaArm:
        return FrankaArm(server=self.server, **arguments)

    def truth(self, since: int = 0) -> np.ndarray:
        """Return the rows from message_id `since` to now; waits until they are in the file."""
        with self.client() as reader:
            now = reader.get_arm_state().robot.message_id
        rows = read_truth(self._truth, until=now)
        return rows[rows["message_id"] >= since]


@pytest.fixture(scope="session")
def start(tmp_path_factory):
    """Return a function which starts simulated arms with a server, for the whole session."""
    running = []

    def start(**options) -> Arm:
        truth = tmp_path_factory.mktemp("truth") / "truth.npy"
        simulation = Simulation(SimulatedArm(lockstep=True, truth=truth, **options))
        running.append(simulation)
        return Arm(simulation, truth)

    yield start
    for simulation in running:
        simulation.close()


@pytest.fixture(scope="session")
def ideal_arm(start):
    return start(ideal=True)


@pytest.fixture(scope="session")
def default_arm(start):
    return start()


@pytest.fixture
def fa(ideal_arm):
    """Return a client of the ideal arm, which is brought home."""
    with ideal_arm.client() as fa:
        fa.wait_for_franka_interface()
        fa.goto_joints(HOME, 1)
        yield fa
