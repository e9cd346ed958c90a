"""An arm in lockstep, at home, with the truth of its physics: what programs begin with that judge by that."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from frankapy import FrankaArm, FrankaConstants
from frankapy.parts import MinJerkJoint
from frankapy.sim import SimulatedArm, Simulation, read_truth

HOME = np.array(FrankaConstants.HOME_JOINTS)


@contextmanager
def arm(robot: str = "fer", **options) -> Iterator[tuple[Simulation, FrankaArm, Path]]:
    """Give it, its client, and the file of its truth; `options` are those of SimulatedArm."""
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.npy"
        simulated = SimulatedArm(robot, lockstep=True, truth=truth, **options)
        with Simulation(simulated, record="off") as simulation, FrankaArm(server=simulation.server) as fa:
            fa.run(MinJerkJoint(HOME, 1.5))
            yield simulation, fa, truth


def rows_since(truth: Path, cycle: int, until: int) -> np.ndarray:
    """Return what truly happened from a cycle on, and before another."""
    rows = read_truth(truth, until=until)
    return rows[(rows["cycle"] >= cycle) & (rows["cycle"] < until)]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
