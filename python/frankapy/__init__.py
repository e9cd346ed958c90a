"""Commands Franka arms through franka-interface: skills from Python, at 1 kHz on the arm."""

from frankapy.exceptions import (
    FrankaArmArgumentError,
    FrankaArmBusyException,
    FrankaArmCommException,
    FrankaArmException,
    FrankaArmFrankaInterfaceNotReadyException,
    FrankaArmNotPermittedException,
)
from frankapy.franka_arm import FrankaArm
from frankapy.franka_arm_state_client import FrankaArmStateClient
from frankapy.franka_constants import FrankaConstants
from frankapy.franka_interface_common_definitions import (
    FeedbackControllerType,
    MetaSkillType,
    SensorDataMessageType,
    SkillStatus,
    SkillType,
    TerminationHandlerType,
    TrajectoryGeneratorType,
)
from frankapy.rigid_transform import RigidTransform
from frankapy.sensors import SensorPublisher

__all__ = [
    "FeedbackControllerType",
    "FrankaArm",
    "FrankaArmArgumentError",
    "FrankaArmBusyException",
    "FrankaArmCommException",
    "FrankaArmException",
    "FrankaArmFrankaInterfaceNotReadyException",
    "FrankaArmNotPermittedException",
    "FrankaArmStateClient",
    "FrankaConstants",
    "MetaSkillType",
    "RigidTransform",
    "SensorDataMessageType",
    "SensorPublisher",
    "SkillStatus",
    "SkillType",
    "TerminationHandlerType",
    "TrajectoryGeneratorType",
]
