"""FrankaConstants: postures, limits and defaults under the names of the published interface."""

from __future__ import annotations

import logging
import math

import numpy as np

from frankapy import collision_boxes
from frankapy.kinematics import DH_PARAMS
from frankapy.rigid_transform import RigidTransform


class FrankaConstants:
    """Constants; SI units. Limits of the joints are the FER's (Panda's): those of the connected arm are checked."""

    LOGGING_LEVEL = logging.INFO

    HOME_JOINTS = [0, -math.pi / 4, 0, -3 * math.pi / 4, 0, math.pi / 2, math.pi / 4]
    HOME_POSE = RigidTransform(
        rotation=np.diag([1.0, -1.0, -1.0]),
        translation=np.array([0.3069, 0, 0.4867]),
        from_frame="franka_tool",
        to_frame="world",
    )
    READY_JOINTS = [0, -math.pi / 4, 0, -2.85496998, 0, 2.09382820, math.pi / 4]
    # Not the pose of READY_JOINTS, which is 9 mm above it and tilted by 1.4 degrees.
    READY_POSE = RigidTransform(
        rotation=np.diag([1.0, -1.0, -1.0]),
        translation=np.array([0.3069, 0, 0.2867]),
        from_frame="franka_tool",
        to_frame="world",
    )

    JOINT_LIMITS_MIN = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
    JOINT_LIMITS_MAX = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])

    DEFAULT_FRANKA_INTERFACE_TIMEOUT = 10
    ACTION_WAIT_LOOP_TIME = 0.001
    GRIPPER_CMD_SLEEP_TIME = 0.2
    DEFAULT_TERM_BUFFER_TIME = 0.2
    DYNAMIC_SKILL_WAIT_TIME = 0.3

    DEFAULT_POSE_THRESHOLDS = [1e-4] * 6
    DEFAULT_JOINT_THRESHOLDS = [1e-4] * 7

    GRIPPER_WIDTH_MAX = 0.08
    GRIPPER_WIDTH_MIN = 0
    GRIPPER_MAX_FORCE = 60

    MAX_LIN_MOMENTUM = 20
    MAX_ANG_MOMENTUM = 2
    MAX_LIN_MOMENTUM_CONSTRAINED = 100

    DEFAULT_K_GAINS = [600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0]
    DEFAULT_D_GAINS = [50.0, 50.0, 50.0, 50.0, 30.0, 25.0, 15.0]
    DEFAULT_TRANSLATIONAL_STIFFNESSES = [600.0] * 3
    DEFAULT_ROTATIONAL_STIFFNESSES = [50.0] * 3
    DEFAULT_JOINT_IMPEDANCES = [3000, 3000, 3000, 2500, 2500, 2000, 2000]
    DEFAULT_CARTESIAN_IMPEDANCES = [3000, 3000, 3000, 300, 300, 300]
    DEFAULT_FORCE_AXIS_TRANSLATIONAL_STIFFNESS = 600
    DEFAULT_FORCE_AXIS_ROTATIONAL_STIFFNESS = 20
    DEFAULT_HFPC_FORCE_GAIN = [0.1] * 6
    DEFAULT_HFPC_S = [1] * 6

    DEFAULT_LOWER_TORQUE_THRESHOLDS_ACCEL = [20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0]
    DEFAULT_UPPER_TORQUE_THRESHOLDS_ACCEL = [120.0, 120.0, 120.0, 118.0, 116.0, 114.0, 112.0]
    DEFAULT_LOWER_TORQUE_THRESHOLDS_NOMINAL = [20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0]
    DEFAULT_UPPER_TORQUE_THRESHOLDS_NOMINAL = [120.0, 120.0, 118.0, 118.0, 116.0, 114.0, 112.0]
    DEFAULT_LOWER_FORCE_THRESHOLDS_ACCEL = [10.0] * 6
    DEFAULT_UPPER_FORCE_THRESHOLDS_ACCEL = [120.0, 120.0, 120.0, 125.0, 125.0, 125.0]
    DEFAULT_LOWER_FORCE_THRESHOLDS_NOMINAL = [10.0] * 6
    DEFAULT_UPPER_FORCE_THRESHOLDS_NOMINAL = [120.0, 120.0, 120.0, 125.0, 125.0, 125.0]

    N_REV_JOINTS = 7
    DH_PARAMS = DH_PARAMS
    JOINT_NAMES = [
        "panda_joint1",
        "panda_joint2",
        "panda_joint3",
        "panda_joint4",
        "panda_joint5",
        "panda_joint6",
        "panda_joint7",
        "panda_finger_joint1",
        "panda_finger_joint2",
    ]

    # The arm as boxes: sizes (m), numbers of the frames of FrankaArm.get_links_transforms that carry them, poses in those.
    COLLISION_BOX_SHAPES = collision_boxes.SHAPES
    COLLISION_BOX_LINKS = collision_boxes.LINKS
    COLLISION_BOX_POSES = collision_boxes.POSES

    # Walls of the workspace as boxes: centre x, y, z (m), roll, pitch, yaw (rad), size (m); two sides, back, front,
    # top, bottom.
    WORKSPACE_WALLS = np.array(
        [
            [0.15, 0.46, 0.5, 0, 0, 0, 1.2, 0.01, 1.1],
            [0.15, -0.46, 0.5, 0, 0, 0, 1.2, 0.01, 1.1],
            [-0.41, 0, 0.5, 0, 0, 0, 0.01, 1, 1.1],
            [0.75, 0, 0.5, 0, 0, 0, 0.01, 1, 1.1],
            [0.2, 0, 1, 0, 0, 0, 1.2, 1, 0.01],
            [0.2, 0, -0.05, 0, 0, 0, 1.2, 1, 0.01],
        ]
    )

    EMPTY_SENSOR_VALUES = [0]
    DEFAULT_SENSOR_PUBLISHER_TOPIC = "franka_ros_interface/sensor"
