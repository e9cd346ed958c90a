"""What frankapy can do with an arm that is not ours: `motions.py SERVER`; a line `name <tab> OK or FAIL <tab> why` each."""

import math
import sys
import time
from collections.abc import Callable

import numpy as np

from frankapy import FrankaArm, RigidTransform
from frankapy import FrankaConstants as FC

ANGLE = 0.1  # rad
DISTANCE = 0.05  # m

# What a good arm's own controllers leave, and what a soft one of ours leaves where the peer has friction or lags.
STIFF = {"angle": 0.02, "distance": 0.01}
SOFT = {"angle": 0.05, "distance": 0.02}


def away(value: float, wanted: float, tolerance: float, unit: str) -> None:
    """Raise unless `value` is near what is wanted."""
    if not abs(value - wanted) <= tolerance:
        raise AssertionError(f"moved by {value:.4f} {unit}, and should have by {wanted:.4f} within {tolerance:g}")


def joints(fa: FrankaArm, *, tolerance: dict[str, float], **how) -> None:
    """Two joints there and back."""
    start = np.array(fa.get_joints())
    delta = np.array([0, 0, 0, ANGLE, 0, 0, -ANGLE])
    fa.goto_joints(start + delta, duration=1.5, ignore_virtual_walls=True, **how)
    for moved, wanted in zip(np.array(fa.get_joints()) - start, delta, strict=True):
        away(moved, wanted, tolerance["angle"], "rad")
    fa.goto_joints(start, duration=1.5, ignore_virtual_walls=True, **how)
    for moved in np.array(fa.get_joints()) - start:
        away(moved, 0, tolerance["angle"], "rad")


def pose(fa: FrankaArm, *, tolerance: dict[str, float], **how) -> None:
    """Up, and back with a turn."""
    start = fa.get_pose()
    goal = RigidTransform(start.rotation, start.translation + [0, 0, DISTANCE], start.from_frame, start.to_frame)
    fa.goto_pose(goal, duration=1.5, ignore_virtual_walls=True, **how)
    for moved, wanted in zip(fa.get_pose().translation - start.translation, [0, 0, DISTANCE], strict=True):
        away(moved, wanted, tolerance["distance"], "m")
    fa.goto_pose(start, duration=1.5, ignore_virtual_walls=True, **how)
    end = fa.get_pose()
    for moved in end.translation - start.translation:
        away(moved, 0, tolerance["distance"], "m")
    cosine = (np.trace(end.rotation @ start.rotation.T) - 1) / 2
    away(math.acos(np.clip(cosine, -1, 1)), 0, tolerance["angle"], "rad")


def stop(fa: FrankaArm) -> None:
    """A stop in the middle of a motion, and the next motion."""
    start = np.array(fa.get_joints())
    fa.goto_joints(start + [0.4, 0, 0, 0, 0, 0, 0], duration=4, block=False, ignore_virtual_walls=True)
    time.sleep(1.0)
    fa.stop_skill()
    moved = fa.get_joints()[0] - start[0]
    if not 0.001 < moved < 0.39:
        raise AssertionError(f"stopped after {moved:.4f} rad of 0.4")
    fa.goto_joints(start, duration=2, ignore_virtual_walls=True)
    away(fa.get_joints()[0], start[0], STIFF["angle"], "rad")


def switches(fa: FrankaArm) -> None:
    """From one robot controller to another while it moves."""
    start = np.array(fa.get_joints())
    for impedance in (False, True, False, True):
        fa.goto_joints(start + [0, 0, 0, 0, 0, 0, ANGLE], duration=0.5, use_impedance=impedance, ignore_virtual_walls=True)
        fa.goto_joints(start, duration=0.5, use_impedance=not impedance, ignore_virtual_walls=True)
    away(fa.get_joints()[6], start[6], SOFT["angle"], "rad")


def gripper(fa: FrankaArm) -> None:
    """Open and close."""
    for width in (0.06, 0.02):
        fa.goto_gripper(width)
        time.sleep(0.1)  # states of the hand come at their own rate
        away(fa.get_gripper_width(), width, 0.005, "m")


def home(fa: FrankaArm) -> None:
    """From wherever the peer begins to where there is room on all sides."""
    fa.reset_joints(duration=4)
    for q, wanted in zip(fa.get_joints(), FC.HOME_JOINTS, strict=True):
        away(q, wanted, STIFF["angle"], "rad")


CAPABILITIES: dict[str, Callable[[FrankaArm], None]] = {
    "read": lambda fa: away(float(np.isfinite(fa.get_joints()).all()), 1, 0, ""),
    "home": home,
    "joint motion, internal joint impedance": lambda fa: joints(fa, use_impedance=False, tolerance=STIFF),
    "pose motion, internal Cartesian impedance": lambda fa: pose(fa, use_impedance=False, tolerance=STIFF),
    "torque: joint impedance": lambda fa: joints(fa, use_impedance=True, tolerance=SOFT),
    "torque: Cartesian impedance": lambda fa: pose(fa, use_impedance=True, tolerance=SOFT),
    "mode switches": switches,
    "stop and go on": stop,
    "gripper": gripper,
}


def main() -> int:
    """Try each; 1 when one has failed."""
    failed = False
    with FrankaArm(server=sys.argv[1]) as fa:
        for name, attempt in CAPABILITIES.items():
            try:
                attempt(fa)
                print(name, "OK", "", sep="\t", flush=True)
            except Exception as error:  # noqa: BLE001 - whatever goes wrong with a peer is a result
                failed = True
                print(name, "FAIL", " ".join(f"{type(error).__name__}: {error}".split()), sep="\t", flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(main())
