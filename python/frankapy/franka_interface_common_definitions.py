"""Numbers of the published interface: kinds of skills and parts, statuses, sensor messages.

Scripts need SensorDataMessageType (see frankapy.proto_utils); the others only name what parts are called there.
"""

from __future__ import annotations


class SkillType:
    """What moves the arm in a skill."""

    (
        CartesianPoseSkill,
        CartesianVelocitySkill,
        ForceTorqueSkill,
        GripperSkill,
        ImpedanceControlSkill,
        JointPositionSkill,
        JointVelocitySkill,
    ) = range(7)


class MetaSkillType:
    """Whether a skill stands alone."""

    BaseMetaSkill, JointPositionContinuousSkill = range(2)


class TrajectoryGeneratorType:
    """Trajectory generators."""

    (
        CartesianVelocityTrajectoryGenerator,
        CubicHermiteSplineJointTrajectoryGenerator,
        CubicHermiteSplinePoseTrajectoryGenerator,
        GoalPoseDmpTrajectoryGenerator,
        GripperTrajectoryGenerator,
        ImpulseTrajectoryGenerator,
        JointDmpTrajectoryGenerator,
        JointVelocityTrajectoryGenerator,
        LinearForcePositionTrajectoryGenerator,
        LinearJointTrajectoryGenerator,
        LinearPoseTrajectoryGenerator,
        MinJerkJointTrajectoryGenerator,
        MinJerkPoseTrajectoryGenerator,
        PassThroughCartesianVelocityTrajectoryGenerator,
        PassThroughForcePositionTrajectoryGenerator,
        PassThroughJointTrajectoryGenerator,
        PassThroughJointVelocityTrajectoryGenerator,
        PassThroughPoseTrajectoryGenerator,
        PoseDmpTrajectoryGenerator,
        QuaternionPoseDmpTrajectoryGenerator,
        RelativeLinearPoseTrajectoryGenerator,
        RelativeMinJerkPoseTrajectoryGenerator,
        SineJointTrajectoryGenerator,
        SinePoseTrajectoryGenerator,
        StayInInitialJointsTrajectoryGenerator,
        StayInInitialPoseTrajectoryGenerator,
    ) = range(26)


class FeedbackControllerType:
    """Feedback controllers, spelt as published."""

    (
        CartesianImpedanceFeedbackController,
        EECartesianImpedanceFeedbackController,
        ForceAxisImpedenceFeedbackController,
        ForcePositionFeedbackController,
        JointImpedanceFeedbackController,
        NoopFeedbackController,
        PassThroughFeedbackController,
        PassThroughJointTorqueFeedbackController,
        SetInternalImpedanceFeedbackController,
    ) = range(9)


class TerminationHandlerType:
    """What ends a skill."""

    (
        ContactTerminationHandler,
        FinalJointTerminationHandler,
        FinalPoseTerminationHandler,
        NoopTerminationHandler,
        TimeTerminationHandler,
    ) = range(5)


class SkillStatus:
    """How far a skill is."""

    TO_START, RUNNING, FINISHED, VIRT_COLL_ERR = range(4)


class SensorDataMessageType:
    """Which message the bytes of a SensorData are."""

    (
        BOUNDING_BOX,
        CARTESIAN_IMPEDANCE,
        CARTESIAN_VELOCITY,
        FORCE_POSITION,
        FORCE_POSITION_GAINS,
        JOINT_POSITION_VELOCITY,
        JOINT_POSITION,
        JOINT_VELOCITY,
        JOINT_TORQUE,
        POSE_POSITION_VELOCITY,
        POSE_POSITION,
        SHOULD_TERMINATE,
    ) = range(12)
