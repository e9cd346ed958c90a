"""Commands Franka arms through franka-interface: skills from Python, at 1 kHz on the arm."""

from frankapy.exceptions import (
    FrankaArmArgumentError,
    FrankaArmBusyException,
    FrankaArmCommException,
    FrankaArmException,
    FrankaArmFrankaInterfaceNotReadyException,
    FrankaArmNotBuiltError,
)
from frankapy.franka_arm import FrankaArm
from frankapy.franka_constants import FrankaConstants
from frankapy.rigid_transform import RigidTransform

__all__ = [
    "FrankaArm",
    "FrankaArmArgumentError",
    "FrankaArmBusyException",
    "FrankaArmCommException",
    "FrankaArmException",
    "FrankaArmFrankaInterfaceNotReadyException",
    "FrankaArmNotBuiltError",
    "FrankaConstants",
    "RigidTransform",
]
