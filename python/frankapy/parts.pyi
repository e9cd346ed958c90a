"""Parts of skills, by name: trajectory generators, feedback controllers, terminations, and what contact ends softly with.

Each kind of wire/proto is a function of this module that returns its message, checked. What it takes are the message's
fields, in their order or by name, in the units of `frankapy kinds`:

    MinJerkPose(goal, 3.0)                      a RigidTransform stands for position and quaternion
    JointWaypoints(q, times=[1, 2, 4])          q is an array (3, 7); a list of RigidTransforms is one of poses
    CartesianImpedance(600, 50)                 one number stands for all elements of a field that may be left out
    ForceAbove(10, axis="z", frame="base")      x, y and z are axes; enums are named in either case
    AnyOf(FinalPose(1e-3), Time(4))             parts in a part
    Contact(then=BackOff(0.01))                 what the arm does after a contact
"""

# Written by scripts/parts_stub.py from wire/proto.

from collections.abc import Sequence
from typing import Literal, overload

from google.protobuf.message import Message
from numpy.typing import ArrayLike

from frankapy import proto
from frankapy.kinds import Kind as Kind
from frankapy.kinds import Pose as Pose
from frankapy.kinds import check_fit as check_fit
from frankapy.kinds import describe as describe
from frankapy.kinds import kinds as kinds
from frankapy.kinds import make as make
from frankapy.kinds import robot_controllers as robot_controllers
from frankapy.kinds import text_of as text_of


def MinJerkJoint(q: ArrayLike, duration: float | None = None) -> proto.MinJerkJoint:
    """From the current reference to joint positions, quintic in each joint.

    Args:
        q: 7 numbers, rad, must be given.
        duration: s, 0.001 to 3600, default 5.0.
    """

def RelativeMinJerkJoint(delta_q: ArrayLike, duration: float | None = None) -> proto.RelativeMinJerkJoint:
    """As MinJerkJoint, to the reference at the start plus a difference.

    Args:
        delta_q: 7 numbers, rad, must be given.
        duration: s, 0.001 to 3600, default 5.0.
    """

@overload
def MinJerkPose(position: ArrayLike, quaternion: ArrayLike, duration: float | None = None) -> proto.MinJerkPose:
    """From the current reference to a pose: the position quintic, the orientation quintic along the shortest rotation.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        duration: s, 0.001 to 3600, default 3.0.
    """
@overload
def MinJerkPose(pose: Pose, duration: float | None = None) -> proto.MinJerkPose:
    """From the current reference to a pose: the position quintic, the orientation quintic along the shortest rotation.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        duration: s, 0.001 to 3600, default 3.0.
    """

@overload
def RelativeMinJerkPose(
    translation: ArrayLike,
    quaternion: ArrayLike | None = None,
    frame: Literal["end_effector", "base", "END_EFFECTOR", "BASE"] | None = None,
    duration: float | None = None,
) -> proto.RelativeMinJerkPose:
    """As MinJerkPose, to the pose at the start changed by a difference.

    Args:
        translation: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, default 1 0 0 0.
        frame: end_effector | base, default end_effector.
        duration: s, 0.001 to 3600, default 3.0.
    """
@overload
def RelativeMinJerkPose(
    pose: Pose,
    frame: Literal["end_effector", "base", "END_EFFECTOR", "BASE"] | None = None,
    duration: float | None = None,
) -> proto.RelativeMinJerkPose:
    """As MinJerkPose, to the pose at the start changed by a difference.

    Args:
        translation: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, default 1 0 0 0.
        frame: end_effector | base, default end_effector.
        duration: s, 0.001 to 3600, default 3.0.
    """

def LinearJoint(q: ArrayLike, duration: float | None = None) -> proto.LinearJoint:
    """With constant velocity to a pose or to joint positions; the limiter rounds its ends.

    Args:
        q: 7 numbers, rad, must be given.
        duration: s, 0.001 to 3600, default 5.0.
    """

@overload
def LinearPose(position: ArrayLike, quaternion: ArrayLike, duration: float | None = None) -> proto.LinearPose:
    """LinearPose, a kind of trajectory.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        duration: s, 0.001 to 3600, default 3.0.
    """
@overload
def LinearPose(pose: Pose, duration: float | None = None) -> proto.LinearPose:
    """LinearPose, a kind of trajectory.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        duration: s, 0.001 to 3600, default 3.0.
    """

@overload
def RelativeLinearPose(
    translation: ArrayLike,
    quaternion: ArrayLike | None = None,
    frame: Literal["end_effector", "base", "END_EFFECTOR", "BASE"] | None = None,
    duration: float | None = None,
) -> proto.RelativeLinearPose:
    """As LinearPose, to the pose at the start changed by a difference.

    Args:
        translation: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, default 1 0 0 0.
        frame: end_effector | base, default end_effector.
        duration: s, 0.001 to 3600, default 3.0.
    """
@overload
def RelativeLinearPose(
    pose: Pose,
    frame: Literal["end_effector", "base", "END_EFFECTOR", "BASE"] | None = None,
    duration: float | None = None,
) -> proto.RelativeLinearPose:
    """As LinearPose, to the pose at the start changed by a difference.

    Args:
        translation: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, default 1 0 0 0.
        frame: end_effector | base, default end_effector.
        duration: s, 0.001 to 3600, default 3.0.
    """

def CubicHermiteJoint(q: ArrayLike, duration: float | None = None) -> proto.CubicHermiteJoint:
    """A cubic Hermite spline: with the velocity of the reference at the start, at rest at the end.

    Args:
        q: 7 numbers, rad, must be given.
        duration: s, 0.001 to 3600, default 5.0.
    """

@overload
def CubicHermitePose(
    position: ArrayLike,
    quaternion: ArrayLike,
    duration: float | None = None,
) -> proto.CubicHermitePose:
    """CubicHermitePose, a kind of trajectory.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        duration: s, 0.001 to 3600, default 3.0.
    """
@overload
def CubicHermitePose(pose: Pose, duration: float | None = None) -> proto.CubicHermitePose:
    """CubicHermitePose, a kind of trajectory.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        duration: s, 0.001 to 3600, default 3.0.
    """

def SineJoint(q: ArrayLike, duration: float | None = None) -> proto.SineJoint:
    """Half a cosine from rest to rest.

    Args:
        q: 7 numbers, rad, must be given.
        duration: s, 0.001 to 3600, default 5.0.
    """

@overload
def SinePose(position: ArrayLike, quaternion: ArrayLike, duration: float | None = None) -> proto.SinePose:
    """SinePose, a kind of trajectory.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        duration: s, 0.001 to 3600, default 3.0.
    """
@overload
def SinePose(pose: Pose, duration: float | None = None) -> proto.SinePose:
    """SinePose, a kind of trajectory.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        duration: s, 0.001 to 3600, default 3.0.
    """

def StayJoint(duration: float | None = None) -> proto.StayJoint:
    """Where the reference is at the start, for a while.

    Args:
        duration: s, 0 to 1e+06, default 3.0.
    """

def StayPose(duration: float | None = None) -> proto.StayPose:
    """StayPose, a kind of trajectory.

    Args:
        duration: s, 0 to 1e+06, default 3.0.
    """

def JointVelocity(dq: ArrayLike, ddq: ArrayLike | None = None, duration: float | None = None) -> proto.JointVelocity:
    """One velocity for a while, from rest to rest; the accelerations that begin and end it, if not given, are half of what the
    arm can do.

    Args:
        dq: 7 numbers, rad/s, must be given.
        ddq: 7 numbers, rad/s^2, at least 0.001, may be left out.
        duration: s, 0.001 to 3600, default 1.0.
    """

def CartesianVelocity(
    O_dP_EE: ArrayLike,
    O_ddP_EE: ArrayLike | None = None,
    duration: float | None = None,
) -> proto.CartesianVelocity:
    """As JointVelocity, of EE along and about the axes of O.

    Args:
        O_dP_EE: 6 numbers, m/s, rad/s, must be given.
        O_ddP_EE: 6 numbers, m/s^2, rad/s^2, at least 0.001, may be left out.
        duration: s, 0.001 to 3600, default 1.0.
    """

def TimeOptimalJoint(q: ArrayLike, speed: float | None = None) -> proto.TimeOptimalJoint:
    """In the least time that this share of the arm's limits of velocity, acceleration and jerk allows, from rest or moving.

    Args:
        q: 7 numbers, rad, must be given.
        speed: of the limits, 0.01 to 1, default 0.5.
    """

@overload
def TimeOptimalPose(position: ArrayLike, quaternion: ArrayLike, speed: float | None = None) -> proto.TimeOptimalPose:
    """TimeOptimalPose, a kind of trajectory.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        speed: of the limits, 0.01 to 1, default 0.2.
    """
@overload
def TimeOptimalPose(pose: Pose, speed: float | None = None) -> proto.TimeOptimalPose:
    """TimeOptimalPose, a kind of trajectory.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        speed: of the limits, 0.01 to 1, default 0.2.
    """

def StreamJoint(
    topic: str,
    delay: float | None = None,
    timeout: float | None = None,
    speed: float | None = None,
) -> proto.StreamJoint:
    """Targets that are sent over a topic while the skill runs, made into a smooth motion inside a share of the arm's limits:
    joint positions (JointPositionSensorMessage, JointPositionVelocitySensorMessage, JointChunk) or poses
    (PosePositionSensorMessage, PosePositionVelocitySensorMessage, PoseChunk). It stays where it is until the first comes;
    where they cease it comes to rest at the last. It has no end of its own.

    Args:
        topic: must be given.
        delay: s, 0 to 1, may be left out. Targets are passed so long after they were sent, on a spline. 0: each is gone to
            at once, as fast as the limits allow. Not given: twice the time between them, as observed.
        timeout: s, 0 to 3600, may be left out. Without another target for so long the arm brakes where it is, whatever
            targets are left; 0: it goes on to the last. Not given: 0.5 s where each is gone to at once, else 0. A target
            that is older than this (not given: 0.5 s) when it comes, or when the skill begins, moves nothing.
        speed: of the limits, 0.01 to 1, default 0.5.
    """

def StreamPose(
    topic: str,
    delay: float | None = None,
    timeout: float | None = None,
    speed: float | None = None,
) -> proto.StreamPose:
    """StreamPose, a kind of trajectory.

    Args:
        topic: must be given.
        delay: s, 0 to 1, may be left out.
        timeout: s, 0 to 3600, may be left out.
        speed: of the limits, 0.01 to 1, default 0.3.
    """

def StreamForcePosition(
    topic: str,
    delay: float | None = None,
    timeout: float | None = None,
    speed: float | None = None,
) -> proto.StreamForcePosition:
    """As StreamPose, with the wrench that EE is to exert (ForcePositionSensorMessage): it goes to what was sent last in 0.05
    s, and stays until nothing has come for the timeout (not given: 0.5 s; 0: for good); then it goes to zero likewise.

    Args:
        topic: must be given.
        delay: s, 0 to 1, may be left out.
        timeout: s, 0 to 3600, may be left out.
        speed: of the limits, 0.01 to 1, default 0.3.
    """

def StreamJointVelocity(
    topic: str,
    timeout: float | None = None,
    speed: float | None = None,
) -> proto.StreamJointVelocity:
    """Velocities that are sent over a topic while the skill runs (JointVelocitySensorMessage, CartesianVelocitySensorMessage).
    Each is kept until the next comes, for at most the timeout: then the arm stops. It has no end of its own.

    Args:
        topic: must be given.
        timeout: s, 0.001 to 3600, default 0.2.
        speed: of the limits, 0.01 to 1, default 0.5.
    """

def StreamCartesianVelocity(
    topic: str,
    timeout: float | None = None,
    speed: float | None = None,
) -> proto.StreamCartesianVelocity:
    """StreamCartesianVelocity, a kind of trajectory.

    Args:
        topic: must be given.
        timeout: s, 0.001 to 3600, default 0.2.
        speed: of the limits, 0.01 to 1, default 0.3.
    """

def JointDmp(
    tau: float,
    alpha: float,
    beta: float,
    mu: ArrayLike,
    h: ArrayLike,
    weights: ArrayLike,
    initial_sensor_values: ArrayLike | None = None,
    duration: float | None = None,
    topic: str | None = None,
) -> proto.JointDmp:
    """Dynamic movement primitive of each joint: y'' = tau^2 (alpha (beta (y0 - y) - y'/tau) + alpha beta f), where f is the
    sum of sensor value * weight * basis function over sensors and basis functions, and x' = -tau x. The first basis
    function is a minimum-jerk rise from 0 to 1 in 1/(2 tau) s, the others are exp(-h (x - mu)^2), normalised, times x.

    Args:
        tau: 1/s, 0.001 to 1000, must be given.
        alpha: 0.001 to 1e+06, must be given.
        beta: 0.001 to 1e+06, must be given.
        mu: numbers, -1000 to 1000, must be given.
        h: numbers, 0 to 1e+12, must be given.
        weights: numbers, -1e+06 to 1e+06, must be given. Of joint after joint; in it sensor after sensor; in it basis
            function after basis function. Another number of sensors than one is known by the sensor values.
        initial_sensor_values: numbers, -1e+06 to 1e+06, may be left out. of each sensor; none: 1
        duration: s, 0.001 to 120, default 5.0.
        topic: may be left out. Over which DmpSensorValues come while it runs, in place of the initial ones; of at most 8
            sensors.
    """

def PoseDmp(
    tau: float,
    alpha: float,
    beta: float,
    mu: ArrayLike,
    h: ArrayLike,
    weights: ArrayLike,
    initial_sensor_values: ArrayLike | None = None,
    duration: float | None = None,
    position_only: bool | None = None,
    orientation_only: bool | None = None,
    ee_frame: bool | None = None,
    topic: str | None = None,
) -> proto.PoseDmp:
    """As JointDmp, of the position of EE and its intrinsic XYZ Euler angles: six dimensions, or three of them with one of the
    two flags.

    Args:
        tau: 1/s, 0.001 to 1000, must be given.
        alpha: 0.001 to 1e+06, must be given.
        beta: 0.001 to 1e+06, must be given.
        mu: numbers, -1000 to 1000, must be given.
        h: numbers, 0 to 1e+12, must be given.
        weights: numbers, -1e+06 to 1e+06, must be given.
        initial_sensor_values: numbers, -1e+06 to 1e+06, may be left out. Of dimension after dimension, in it of each
            sensor; none: 1.
        duration: s, 0.001 to 120, default 5.0.
        position_only: may be left out.
        orientation_only: may be left out.
        ee_frame: may be left out. the translation is along the axes of EE at the start; else of O
        topic: may be left out. of DmpSensorValues, as with JointDmp
    """

def GoalPoseDmp(
    tau: float,
    alpha: float,
    beta: float,
    mu: ArrayLike,
    h: ArrayLike,
    weights: ArrayLike,
    initial_sensor_values: ArrayLike | None = None,
    duration: float | None = None,
    position_only: bool | None = None,
    orientation_only: bool | None = None,
    ee_frame: bool | None = None,
    topic: str | None = None,
) -> proto.GoalPoseDmp:
    """As PoseDmp, with a first basis function that is 1 all the time: what it weighs pulls from the beginning as a goal does.

    Args:
        tau: 1/s, 0.001 to 1000, must be given.
        alpha: 0.001 to 1e+06, must be given.
        beta: 0.001 to 1e+06, must be given.
        mu: numbers, -1000 to 1000, must be given.
        h: numbers, 0 to 1e+12, must be given.
        weights: numbers, -1e+06 to 1e+06, must be given.
        initial_sensor_values: numbers, -1e+06 to 1e+06, may be left out.
        duration: s, 0.001 to 120, default 5.0.
        position_only: may be left out.
        orientation_only: may be left out.
        ee_frame: may be left out.
        topic: may be left out. of DmpSensorValues, as with JointDmp
    """

def QuaternionPoseDmp(
    position_tau: float,
    position_alpha: float,
    position_beta: float,
    position_mu: ArrayLike,
    position_h: ArrayLike,
    position_weights: ArrayLike,
    initial_sensor_values: ArrayLike | None = None,
    quat_alpha: float | None = None,
    quat_beta: float | None = None,
    quat_mu: ArrayLike | None = None,
    quat_h: ArrayLike | None = None,
    quat_weights: ArrayLike | None = None,
    goal_quat: ArrayLike | None = None,
    goal_quat_time: float | None = None,
    duration: float | None = None,
    ee_frame: bool | None = None,
    topic: str | None = None,
) -> proto.QuaternionPoseDmp:
    """The position as with PoseDmp, the orientation by a movement primitive of its rotation vector r from the goal: r'' =
    (alpha (-beta r - r' T) + f) / T^2, T = goal_quat_time, with basis functions of x = exp(-t/T); f is 0 after T.

    Args:
        position_tau: 1/s, 0.001 to 1000, must be given.
        position_alpha: 0.001 to 1e+06, must be given.
        position_beta: 0.001 to 1e+06, must be given.
        position_mu: numbers, -1000 to 1000, must be given.
        position_h: numbers, 0 to 1e+12, must be given.
        position_weights: numbers, -1e+06 to 1e+06, must be given.
        initial_sensor_values: numbers, -1e+06 to 1e+06, may be left out. Of x, y and z, in each of each sensor; none: 1.
        quat_alpha: 0.001 to 1e+06, must be given.
        quat_beta: 0.001 to 1e+06, must be given.
        quat_mu: numbers, -1000 to 1000, must be given.
        quat_h: numbers, 0 to 1e+12, must be given.
        quat_weights: numbers, -1e+06 to 1e+06, must be given.
        goal_quat: 4 numbers, w,x,y,z, must be given.
        goal_quat_time: s, 0.001 to 120, must be given.
        duration: s, 0.001 to 120, default 5.0.
        ee_frame: may be left out.
        topic: may be left out. of DmpSensorValues for the position, as with JointDmp
    """

def Impulse(
    force: ArrayLike,
    torque: ArrayLike | None = None,
    acc_duration: float | None = None,
    duration: float | None = None,
) -> proto.Impulse:
    """Stays at the pose of the start and exerts a wrench at EE, along and about the axes of O: it rises for acc_duration,
    while what was exerted before falls, and falls for as long at the end.

    Args:
        force: 3 numbers, N, -200 to 200, must be given.
        torque: 3 numbers, N m, -50 to 50, default 0 0 0.
        acc_duration: s, 0 to 1800, default 0.1.
        duration: s, 0.001 to 3600, default 1.0.
    """

@overload
def LinearForcePosition(
    position: ArrayLike,
    quaternion: ArrayLike,
    force: ArrayLike | None = None,
    torque: ArrayLike | None = None,
    duration: float | None = None,
) -> proto.LinearForcePosition:
    """As LinearPose, while the wrench goes from that of the reference at the start to this one, which stays.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        force: 3 numbers, N, -200 to 200, default 0 0 0.
        torque: 3 numbers, N m, -50 to 50, default 0 0 0.
        duration: s, 0.001 to 3600, default 3.0.
    """
@overload
def LinearForcePosition(
    pose: Pose,
    force: ArrayLike | None = None,
    torque: ArrayLike | None = None,
    duration: float | None = None,
) -> proto.LinearForcePosition:
    """As LinearPose, while the wrench goes from that of the reference at the start to this one, which stays.

    Args:
        position: 3 numbers, m, -2 to 2, must be given.
        quaternion: 4 numbers, w,x,y,z, must be given.
        force: 3 numbers, N, -200 to 200, default 0 0 0.
        torque: 3 numbers, N m, -50 to 50, default 0 0 0.
        duration: s, 0.001 to 3600, default 3.0.
    """

def JointWaypoints(q: ArrayLike, times: ArrayLike | None = None, speed: float | None = None) -> proto.JointWaypoints:
    """Through waypoints to the last one, along a spline: at their times since the start, or with none given in the least time
    that this share of the arm's limits allows on it.

    Args:
        q: up to 1000 rows of 7 numbers, rad, must be given.
        times: numbers, s, 0.001 to 3600, may be left out.
        speed: of the limits, 0.01 to 1, default 0.5.
    """

@overload
def PoseWaypoints(
    position: ArrayLike,
    quaternion: ArrayLike,
    times: ArrayLike | None = None,
    speed: float | None = None,
) -> proto.PoseWaypoints:
    """PoseWaypoints, a kind of trajectory.

    Args:
        position: up to 1000 rows of 3 numbers, m, -2 to 2, must be given.
        quaternion: up to 1000 rows of 4 numbers, w,x,y,z, must be given.
        times: numbers, s, 0.001 to 3600, may be left out.
        speed: of the limits, 0.01 to 1, default 0.2.
    """
@overload
def PoseWaypoints(
    pose: Sequence[Pose],
    times: ArrayLike | None = None,
    speed: float | None = None,
) -> proto.PoseWaypoints:
    """PoseWaypoints, a kind of trajectory.

    Args:
        position: up to 1000 rows of 3 numbers, m, -2 to 2, must be given.
        quaternion: up to 1000 rows of 4 numbers, w,x,y,z, must be given.
        times: numbers, s, 0.001 to 3600, may be left out.
        speed: of the limits, 0.01 to 1, default 0.2.
    """

def JointSamples(q: ArrayLike) -> proto.JointSamples:
    """One sample for each ms. The arm must be near to the first one.

    Args:
        q: up to 120000 rows of 7 numbers, rad, must be given.
    """

@overload
def PoseSamples(position: ArrayLike, quaternion: ArrayLike) -> proto.PoseSamples:
    """PoseSamples, a kind of trajectory.

    Args:
        position: up to 120000 rows of 3 numbers, m, -2 to 2, must be given.
        quaternion: up to 120000 rows of 4 numbers, w,x,y,z, must be given.
    """
@overload
def PoseSamples(pose: Sequence[Pose]) -> proto.PoseSamples:
    """PoseSamples, a kind of trajectory.

    Args:
        position: up to 120000 rows of 3 numbers, m, -2 to 2, must be given.
        quaternion: up to 120000 rows of 4 numbers, w,x,y,z, must be given.
    """

def JointImpedance(
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
    damping_ratio: float | None = None,
    inertia_scale: float | None = None,
    integral_rate: float | None = None,
    integral_limit: float | None = None,
) -> proto.JointImpedance:
    """tau_J_d = K (q_ref - q) + D (dq_ref - dq) + coriolis + M ddq_ref + friction(dq_ref). Gains that no loop of 1 ms can hold
    in the posture at the start are refused; those that it can not hold where the arm comes to are softened there.

    Args:
        stiffness: 7 numbers, N m/rad, 0 to 3000, default 600 600 600 600 250 150 50.
        damping: 7 numbers, N m s/rad, 0 to 200, default 50 50 50 50 30 25 15.
        damping_ratio: 0.1 to 3, may be left out. In place of damping: of each mode of the arm's inertia on this stiffness;
            1 is critical.
        inertia_scale: 0.5 to 4, default 1.0. Of the inertia that a hand feels to that of the arm; other than 1 by what the
            robot estimates that its joints exert.
        integral_rate: 1/s, 0 to 10, default 0.0. An integral of rate K (q_ref - q), bounded: it takes away what friction
            leaves. It stands still while limits hold the torque back, and is slowed where the stiffness asks for that.
        integral_limit: N m, 0 to 20, default 5.0.
    """

def CartesianImpedance(
    translational_stiffness: ArrayLike | None = None,
    rotational_stiffness: ArrayLike | None = None,
    damping_ratio: float | None = None,
    nullspace_stiffness: float | None = None,
    frame: Literal["base", "end_effector", "BASE", "END_EFFECTOR"] | None = None,
    topic: str | None = None,
    integral_rate: float | None = None,
    integral_limit: ArrayLike | None = None,
    posture: ArrayLike | None = None,
) -> proto.CartesianImpedance:
    """Spring and damper between EE and its reference, whose acceleration and friction are met ahead, with the redundant joint
    held to the joints that the reference means. Translation along, rotation about the axes of a frame. Over the topic,
    CartesianImpedanceSensorMessage sets the stiffness anew, in 0.1 s.

    Args:
        translational_stiffness: 3 numbers, N/m, 0 to 3000, default 600 600 600.
        rotational_stiffness: 3 numbers, N m/rad, 0 to 300, default 50 50 50.
        damping_ratio: 0.1 to 3, default 1.0. Of each mode of the arm's inertia at EE on this stiffness; 1 is critical.
        nullspace_stiffness: N m/rad, 0 to 100, default 10.0. Of the joints, towards those of the reference, in what does
            not move EE; next to a singularity also in what hardly does.
        frame: base | end_effector, default base.
        topic: may be left out.
        integral_rate: 1/s, 0 to 10, default 0.0. An integral of rate K e along and about each axis, bounded: it takes away
            what friction and a load that the robot does not know leave. It stands still while limits hold the torque back,
            and is slowed where the stiffness asks for that.
        integral_limit: 6 numbers, N, N m, 0 to 100, default 20 20 20 5 5 5.
        posture: 7 numbers, rad, -6.3 to 6.3, may be left out. Joints that the arm is led near, at most at 0.1 rad/s,
            without moving EE, and held to with nullspace_stiffness; left out: the elbow stays where it is. It ends where it
            is nearest to them, short of the ends of joints, of walls and of the arm itself: joints that would move EE are
            never met, and the farther they are, the more is left (FrankaArm.ik(pose, near=posture) says where). For the
            robot controllers in which the robot does not make joints of the pose itself.
    """

def FreeDrive(damping: ArrayLike | None = None, friction: ArrayLike | None = None) -> proto.FreeDrive:
    """Lets the arm be led by hand, whatever the reference is: tau_J_d = coriolis - D dq + friction. For torque alone.

    Args:
        damping: 7 numbers, N m s/rad, 0 to 200, default 0 0 0 0 0 0 0.
        friction: 7 numbers, N m, 0 to 10, default 0.6 0.6 0.6 0.6 0.2 0.2 0.2. Dry friction, which holds what nobody leads
            against what the robot knows wrongly of its load.
    """

def Lqr(
    position_weight: ArrayLike | None = None,
    velocity_weight: ArrayLike | None = None,
    torque_weight: ArrayLike | None = None,
) -> proto.Lqr:
    """A linear-quadratic regulator of the joints about their posture at the start: its gains minimise the sum of
    position_weight (q - q_ref)^2 + velocity_weight (dq - dq_ref)^2 + torque_weight tau^2, coriolis and M ddq_ref apart.

    Args:
        position_weight: 7 numbers, 1/rad^2, 0.001 to 1e+08, default 360000 360000 360000 360000 62500 22500 2500.
        velocity_weight: 7 numbers, s^2/rad^2, 0 to 1e+06, default 400 400 400 400 100 50 10.
        torque_weight: 7 numbers, 1/(N m)^2, 0.001 to 1e+06, default 1 1 1 1 1 1 1.
    """

def Admittance(
    mass: ArrayLike | None = None,
    damping: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    translational_tracking: float | None = None,
    rotational_tracking: float | None = None,
) -> proto.Admittance:
    """EE moves as a mass with a damper, and a spring to the reference, would under what the surroundings exert on it; a stiff
    impedance follows. Translation along, rotation about the axes of O. Without stiffness the arm stays where it is led.

    Args:
        mass: 6 numbers, kg, kg m^2, 0.01 to 100, default 10 10 10 0.5 0.5 0.5. 0.5 to 100 kg and 0.01 to 10 kg m^2.
        damping: 6 numbers, N s/m, N m s/rad, 0 to 2000, default 100 100 100 5 5 5. At most 200 N m s/rad.
        stiffness: 6 numbers, N/m, N m/rad, 0 to 3000, default 0 0 0 0 0 0. At most 300 N m/rad.
        translational_tracking: N/m, 100 to 3000, default 2000.0. Stiffness of what follows.
        rotational_tracking: N m/rad, 10 to 300, default 200.0.
    """

def PassThrough(max_translation: float | None = None, max_rotation: float | None = None) -> proto.PassThrough:
    """Exerts the wrench of the trajectory and holds nothing. For torque alone.

    Args:
        max_translation: m, 0 to 2, default 0.0. How far EE may go from where it was before the wrench fades to nothing; 0:
            any way.
        max_rotation: rad, 0 to 3, default 0.0.
    """

def ForceAxisImpedance(
    axis: ArrayLike,
    translational_stiffness: float | None = None,
    rotational_stiffness: float | None = None,
    max_translation: float | None = None,
) -> proto.ForceAxisImpedance:
    """Exerts the force of the trajectory along an axis of O, with springs across it and against turning. For torque alone.

    Args:
        axis: 3 numbers, any length but 0, must be given.
        translational_stiffness: N/m, 0 to 3000, default 600.0.
        rotational_stiffness: N m/rad, 0 to 300, default 20.0.
        max_translation: m, 0 to 2, default 0.0. How far EE may go from where it was before the force fades to nothing; 0:
            any way.
    """

def PassThroughJointTorque(
    torque: ArrayLike | None = None,
    selection: ArrayLike | None = None,
    remove_gravity: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
    topic: str | None = None,
    timeout: float | None = None,
) -> proto.PassThroughJointTorque:
    """Joints with selection 1 get this torque and that of the trajectory, those with 0 are held where they are at the start;
    with remove_gravity 1 a joint feels gravity, which the robot compensates otherwise. For torque alone. Over the topic,
    JointTorqueControllerSensorMessage sets all of them anew: the torque at once, the rest in 0.1 s. After `timeout` without
    a message (0: never) the torque gives way to the damping. Gains are refused and softened as for JointImpedance.

    Args:
        torque: 7 numbers, N m, -100 to 100, default 0 0 0 0 0 0 0.
        selection: 7 numbers, 0: held, 1: torque, 0 to 1, default 0 0 0 0 0 0 0.
        remove_gravity: 7 numbers, 0: compensated, 1: felt, 0 to 1, default 0 0 0 0 0 0 0.
        stiffness: 7 numbers, N m/rad, 0 to 3000, default 600 600 600 600 250 150 50.
        damping: 7 numbers, N m s/rad, 0 to 200, default 50 50 50 50 30 25 15.
        topic: may be left out.
        timeout: s, 0 to 3600, default 0.5.
    """

def ForcePosition(
    selection: ArrayLike | None = None,
    use_cartesian_gains: bool | None = None,
    position_kps_cart: ArrayLike | None = None,
    force_kps_cart: ArrayLike | None = None,
    position_kps_joint: ArrayLike | None = None,
    force_kps_joint: ArrayLike | None = None,
    max_speed: float | None = None,
    topic: str | None = None,
) -> proto.ForcePosition:
    """Each axis of O in position (selection 1), in force (0), or in parts in both, with gains of EE or of the joints; the
    force is the wrench of the trajectory. With an axis of force for torque alone. Over the topic,
    ForcePositionControllerSensorMessage sets gains and selection anew, in 0.1 s: then for torque alone too. Joint gains
    that no loop of 1 ms can hold in the posture at the start are refused, or softened later, as for JointImpedance.

    Args:
        selection: 6 numbers, 1: position, 0: force, 0 to 1, default 1 1 1 1 1 1.
        use_cartesian_gains: default True.
        position_kps_cart: 6 numbers, N/m, N m/rad, 0 to 3000, default 600 600 600 50 50 50.
        force_kps_cart: 6 numbers, 0 to 2, default 0.1 0.1 0.1 0.1 0.1 0.1.
        position_kps_joint: 7 numbers, N m/rad, 0 to 3000, default 600 600 600 600 250 150 50.
        force_kps_joint: 7 numbers, 0 to 2, default 0.1 0.1 0.1 0.1 0.1 0.1 0.1.
        max_speed: m/s, 0.001 to 0.2, default 0.01. Along axes of force with nothing to touch.
        topic: may be left out.
    """

def HybridForcePosition(
    force_axes: ArrayLike | None = None,
    force: ArrayLike | None = None,
    frame: Literal["base", "end_effector", "BASE", "END_EFFECTOR"] | None = None,
    translational_stiffness: ArrayLike | None = None,
    rotational_stiffness: ArrayLike | None = None,
    damping_ratio: float | None = None,
    nullspace_stiffness: float | None = None,
    gain: float | None = None,
    integral_gain: float | None = None,
    max_speed: float | None = None,
    max_turning_speed: float | None = None,
) -> proto.HybridForcePosition:
    """Force along some axes, motion along the others, decoupled by the arm's inertia at EE. With a force axis for torque
    alone.

    Args:
        force_axes: 6 numbers, 1: force, 0: motion, 0 to 1, default 0 0 0 0 0 0. 1: EE exerts the force along, or the torque
            about, this axis of the frame; 0: it follows the reference.
        force: 6 numbers, N, N m, -100 to 100, default 0 0 0 0 0 0. Along and about the axes of the frame, to which the
            wrench of the trajectory is added; torques of at most 20 N m.
        frame: base | end_effector, default base.
        translational_stiffness: 3 numbers, N/m, 0 to 3000, default 1500 1500 1500.
        rotational_stiffness: 3 numbers, N m/rad, 0 to 300, default 100 100 100.
        damping_ratio: 0.1 to 3, default 1.0.
        nullspace_stiffness: N m/rad, 0 to 100, default 10.0.
        gain: 0 to 2, default 0.5. Of the force that is missing, beside the force itself.
        integral_gain: 1/s, 0 to 20, default 5.0.
        max_speed: m/s, 0.001 to 0.2, default 0.01. Along and about force axes with nothing to touch.
        max_turning_speed: rad/s, 0.01 to 1, default 0.1.
    """

def InternalImpedance(K_theta: ArrayLike | None = None, K_x: ArrayLike | None = None) -> proto.InternalImpedance:
    """The robot's own controller, with its stiffness set before the motion. At most one of the two is given; neither: joint
    impedance at the robot's default.

    Args:
        K_theta: 7 numbers, N m/rad, 0 to 14250, may be left out.
        K_x: 6 numbers, N/m, N m/rad, 1 to 3000, may be left out. Translation 10 to 3000 N/m, rotation 1 to 300 N m/rad,
            about the axes of the stiffness frame K.
    """

def Time(seconds: float | None = None, after_trajectory: float | None = None) -> proto.Time:
    """At a time of the skill, or a while after its trajectory is over (wherever a stretch put that). One of the two is given.

    Args:
        seconds: s, 0 to 1e+09, may be left out.
        after_trajectory: s, 0 to 1e+09, may be left out.
    """

def FinalJoint(
    threshold: ArrayLike | None = None,
    judged: Literal["reference", "arm", "REFERENCE", "ARM"] | None = None,
) -> proto.FinalJoint:
    """When the joints are within the threshold of the trajectory's goal: those of the reference, which waits for an arm that
    is held, or those of the arm, which friction and what it touches may keep from it for ever: give it a threshold that
    allows for that. Where limits or walls keep the reference from its goal, a skill that has nothing else to end it ends
    there.

    Args:
        threshold: 7 numbers, rad, 0 to 6.3, default 0.0001 0.0001 0.0001 0.0001 0.0001 0.0001 0.0001.
        judged: reference | arm, default reference.
    """

def FinalPose(
    position_threshold: ArrayLike | None = None,
    orientation_threshold: float | None = None,
    judged: Literal["reference", "arm", "REFERENCE", "ARM"] | None = None,
) -> proto.FinalPose:
    """When the pose, of reference or arm as for FinalJoint, is within the thresholds of the trajectory's goal: position along
    each axis of O, orientation by the angle between the two.

    Args:
        position_threshold: 3 numbers, m, 0 to 2, default 0.0001 0.0001 0.0001.
        orientation_threshold: rad, 0 to 3.2, default 0.0001.
        judged: reference | arm, default reference.
    """

def Contact(
    cartesian: bool | None = None,
    joint: bool | None = None,
    force_thresholds: ArrayLike | None = None,
    torque_thresholds: ArrayLike | None = None,
    estimate: Literal["robot", "observer", "ROBOT", "OBSERVER"] | None = None,
    then: proto.Comply | proto.BackOff | None = None,
) -> proto.Contact:
    """At a contact: when a component of the external wrench at the stiffness frame K (`cartesian`), or a joint's external
    torque (`joint`), is above its threshold in either direction. It is looked at before anything is commanded, and the
    motion is taken away in that cycle.

    Args:
        cartesian: default True.
        joint: default False.
        force_thresholds: 6 numbers, N, N m, 0 to 125, may be left out. Along and about the axes of O. With one of the two
            given, the other is the lower threshold of the robot's collision behaviour: 20 N and 25 N m, and 20 20 18 18 16
            14 12 N m, where the server's configuration has no others (arm.collision). With neither, the robot says when:
            above the lower ones. At most the upper ones, above which it stops with a reflex. Of the observer what is not
            given is 12 N and 5 N m, and 5 5 5 5 3 3 3 N m.
        torque_thresholds: 7 numbers, N m, 0 to 120, may be left out.
        estimate: robot | observer, default robot.
        then: part, may be left out. what the arm does: a kind of endings.proto; not given: it holds. Not within AllOf or
            AnyOf
    """

def ForceAbove(
    threshold: float,
    axis: ArrayLike | None = None,
    frame: Literal["base", "stiffness", "BASE", "STIFFNESS"] | None = None,
    relative: bool | None = None,
) -> proto.ForceAbove:
    """When the external force that the robot estimates at the stiffness frame K is above a threshold, along an axis in either
    direction; no axis: its magnitude.

    Args:
        threshold: N, 0 to 1000, must be given.
        axis: 3 numbers, may be left out.
        frame: base | stiffness, default base.
        relative: default False. to the estimate when the skill began
    """

def TorqueAbove(
    threshold: float,
    axis: ArrayLike | None = None,
    frame: Literal["base", "stiffness", "BASE", "STIFFNESS"] | None = None,
    relative: bool | None = None,
) -> proto.TorqueAbove:
    """As ForceAbove, of the torque.

    Args:
        threshold: N m, 0 to 300, must be given.
        axis: 3 numbers, may be left out.
        frame: base | stiffness, default base.
        relative: default False.
    """

def Moved(distance: float | None = None, angle: float | None = None) -> proto.Moved:
    """When the measured pose is a distance, or an angle, away from where it was when the skill began. At least one is given.

    Args:
        distance: m, 1e-06 to 2, may be left out.
        angle: rad, 1e-06 to 3.1, may be left out.
    """

def OutsideBox(lower: ArrayLike, upper: ArrayLike) -> proto.OutsideBox:
    """When the measured position of EE is outside of a box along the axes of O.

    Args:
        lower: 3 numbers, m, -10 to 10, must be given.
        upper: 3 numbers, m, -10 to 10, must be given.
    """

def VelocityBelow(
    threshold: float | None = None,
    duration: float | None = None,
    after: float | None = None,
) -> proto.VelocityBelow:
    """When every measured joint velocity has been below a threshold for a while; the first `after` seconds do not count.

    Args:
        threshold: rad/s, 0.0001 to 10, default 0.01.
        duration: s, 0 to 3600, default 0.1.
        after: s, 0 to 3600, default 0.5.
    """

def Never() -> proto.Never:
    """At no time: the skill goes on until it is stopped, or another takes over.
    """

def AnyOf(*of: Message) -> proto.AnyOf:
    """When one of them would end it.
    """

def AllOf(*of: Message) -> proto.AllOf:
    """When all of them would end it, in the same cycle.
    """

def SensorSays(topic: str) -> proto.SensorSays:
    """When a ShouldTerminateSensorMessage that says so comes over the topic.

    Args:
        topic: must be given.
    """

def Silence(topic: str, seconds: float) -> proto.Silence:
    """When no message has come over the topic for so long; counted from the start of the skill, and from each message.

    Args:
        topic: must be given.
        seconds: s, 0.001 to 3600, must be given.
    """

def Comply(stiffness: ArrayLike | None = None, damping_ratio: float | None = None) -> proto.Comply:
    """It becomes compliant where it is: a spring and a damper in each joint, for as long as the server holds (hold_time); then
    the robot holds it where it is. In the robot controller TORQUE alone: the stiffness of the robot's own controllers
    cannot be changed while it moves.

    Args:
        stiffness: 7 numbers, N m/rad, 0 to 300, default 20 20 20 20 5 5 5.
        damping_ratio: 0.1 to 3, default 1.0.
    """

def BackOff(distance: float, speed: float | None = None) -> proto.BackOff:
    """It goes back as it came, straight against the motion that EE had (of joints: as they came), and, where EE hardly moved,
    with the force that pushes it; then it holds. `speed` is the greatest on that way. Not with controllers that do not lead
    all of the arm.

    Args:
        distance: m, 0.0001 to 0.1, must be given.
        speed: m/s, 0.001 to 0.25, default 0.05.
    """
