"""Every trajectory with every controller in every robot controller, by the rule of wire/proto: what runs, and what is refused.

Kinds are those of frankapy.parts. Here each has an example, with where the arm then truly has to be; one that has none yet is drawn
by the rules of its fields, and the arm has to be where the reference ends. For test_combinations.py and bench/combinations.py.
"""

import itertools
import sys
from pathlib import Path

import numpy as np
from google.protobuf.message import Message

from frankapy import FrankaArm, FrankaArmArgumentError, FrankaArmException, FrankaConstants, RigidTransform, parts, proto
from frankapy.parts import (
    Admittance,
    CartesianImpedance,
    CartesianVelocity,
    CubicHermiteJoint,
    CubicHermitePose,
    ForceAxisImpedance,
    ForcePosition,
    FreeDrive,
    GoalPoseDmp,
    HybridForcePosition,
    Impulse,
    InternalImpedance,
    JointDmp,
    JointImpedance,
    JointSamples,
    JointVelocity,
    JointWaypoints,
    LinearForcePosition,
    LinearJoint,
    LinearPose,
    Lqr,
    MinJerkJoint,
    MinJerkPose,
    PassThrough,
    PassThroughJointTorque,
    PoseDmp,
    PoseSamples,
    PoseWaypoints,
    QuaternionPoseDmp,
    RelativeLinearPose,
    RelativeMinJerkJoint,
    RelativeMinJerkPose,
    SineJoint,
    SinePose,
    StayJoint,
    StayPose,
    StreamCartesianVelocity,
    StreamForcePosition,
    StreamJoint,
    StreamJointVelocity,
    StreamPose,
    Time,
    TimeOptimalJoint,
    TimeOptimalPose,
)
from frankapy.proto import rules_pb2
from frankapy.sim import Simulation
from frankapy.validation import rule_of, validate

sys.path.append(str(Path(__file__).resolve().parents[1] / "safety"))
from draw import Draw, is_led  # noqa: E402

HOME = np.array(FrankaConstants.HOME_JOINTS)
GOAL = HOME + [0.1, -0.1, 0.1, 0.1, -0.1, 0.1, 0.1]
SHIFT = np.array([0.03, 0.05, -0.04])  # m
LEAST = 0.002  # rad and m that a motion may end beside its goal, of a spring that is held by friction
LEAST_DRAWN = 0.02  # with gains that nobody chose

SPRING = (1, 200, 50)  # of a movement primitive that rises in 0.5 s
BASIS = ([1, 0.8], [50, 50])


def far(*ways: float) -> np.ndarray:
    """Return the weights of a movement primitive that ends so far from its start."""
    return np.column_stack([ways, np.zeros(len(ways))])


def fraction(samples: int) -> np.ndarray:
    s = np.linspace(0, 1, samples)[:, None]
    return s**3 * (10 - 15 * s + 6 * s**2)


def samples_to(goal: RigidTransform) -> proto.PoseSamples:
    position = goal.translation + (fraction(801) - 1) * SHIFT
    return PoseSamples(position, np.tile(goal.quaternion, (801, 1)))


JOINTS = {
    "MinJerkJoint": lambda: MinJerkJoint(GOAL, 0.8),
    "RelativeMinJerkJoint": lambda: RelativeMinJerkJoint(GOAL - HOME, 0.8),
    "LinearJoint": lambda: LinearJoint(GOAL, 0.8),
    "CubicHermiteJoint": lambda: CubicHermiteJoint(GOAL, 0.8),
    "SineJoint": lambda: SineJoint(GOAL, 0.8),
    "TimeOptimalJoint": lambda: TimeOptimalJoint(GOAL, 0.2),
    "JointVelocity": lambda: JointVelocity((GOAL - HOME) / 0.9, np.full(7, 0.1 / 0.09), 1.0),
    "JointDmp": lambda: JointDmp(*SPRING, *BASIS, far(*GOAL - HOME), duration=0.8),
    "JointWaypoints": lambda: JointWaypoints([HOME + 0.5 * (GOAL - HOME), GOAL], speed=0.2),
    "JointSamples": lambda: JointSamples(HOME + fraction(801) * (GOAL - HOME)),
    "StreamJoint": lambda: StreamJoint("nobody"),
    "StreamJointVelocity": lambda: StreamJointVelocity("nobody"),
    "StayJoint": lambda: StayJoint(0.3),
}
POSES = {
    "MinJerkPose": lambda goal: MinJerkPose(goal, 0.8),
    "RelativeMinJerkPose": lambda goal: RelativeMinJerkPose(SHIFT, frame="base", duration=0.8),
    "LinearPose": lambda goal: LinearPose(goal, 0.8),
    "RelativeLinearPose": lambda goal: RelativeLinearPose(SHIFT, frame="base", duration=0.8),
    "CubicHermitePose": lambda goal: CubicHermitePose(goal, 0.8),
    "SinePose": lambda goal: SinePose(goal, 0.8),
    "TimeOptimalPose": lambda goal: TimeOptimalPose(goal, 0.1),
    "CartesianVelocity": lambda goal: CartesianVelocity([*SHIFT / 0.7, 0, 0, 0], [0.25] * 3 + [1] * 3, 1.0),
    "PoseDmp": lambda goal: PoseDmp(*SPRING, *BASIS, far(*SHIFT, 0, 0, 0), duration=0.8),
    "GoalPoseDmp": lambda goal: GoalPoseDmp(1, 16, 4, *BASIS, far(*SHIFT), duration=1.6, position_only=True),
    "QuaternionPoseDmp": lambda goal: QuaternionPoseDmp(
        *SPRING, *BASIS, far(*SHIFT), None, 48, 12, *BASIS, far(0, 0, 0), goal.quaternion, 0.6, 0.8
    ),
    "LinearForcePosition": lambda goal: LinearForcePosition(goal, duration=0.8),
    "Impulse": lambda goal: Impulse([0, 0, 0.02], duration=0.3),
    "PoseWaypoints": lambda goal: PoseWaypoints([goal.translation - SHIFT / 2, goal.translation], [goal.quaternion] * 2),
    "PoseSamples": samples_to,
    "StreamPose": lambda goal: StreamPose("nobody"),
    "StreamForcePosition": lambda goal: StreamForcePosition("nobody"),
    "StreamCartesianVelocity": lambda goal: StreamCartesianVelocity("nobody"),
    "StayPose": lambda goal: StayPose(0.3),
}
STAY = {"StayJoint", "StayPose", "Impulse"}
CONTROLLERS = {
    "JointImpedance": lambda: JointImpedance(),
    "CartesianImpedance": lambda: CartesianImpedance(1500, 100),
    "CartesianImpedance of EE": lambda: CartesianImpedance([1500, 1200, 1000], 100, frame="end_effector"),
    "JointImpedance damped": lambda: JointImpedance(damping_ratio=1, inertia_scale=0.8, integral_rate=2),
    "Lqr": lambda: Lqr(),
    "Admittance": lambda: Admittance(stiffness=[1000] * 3 + [100] * 3),
    "ForcePosition": lambda: ForcePosition(position_kps_cart=[1500] * 3 + [100] * 3),
    "ForcePosition of joints": lambda: ForcePosition(use_cartesian_gains=False, position_kps_joint=[1500] * 4 + [250, 150, 100]),
    "HybridForcePosition": lambda: HybridForcePosition(),
    "FreeDrive": lambda: FreeDrive(),
    "PassThrough": lambda: PassThrough(),
    "ForceAxisImpedance": lambda: ForceAxisImpedance("z"),
    "PassThroughJointTorque": lambda: PassThroughJointTorque(),
    "InternalImpedance K_theta": lambda: InternalImpedance([3000] * 7),
    "InternalImpedance K_x": lambda: InternalImpedance(K_x=[2500] * 3 + [250] * 3),
}
ROBOT_CONTROLLERS = [name.lower() for name in proto.RobotController.keys() if name != "AUTO"]
RUNS = "runs"
Combination = tuple[str, str, str]  # trajectory, controller, robot controller


def combinations() -> list[Combination]:
    """Return all, whether the rule allows them or not."""
    trajectories, controllers = ([descriptor.name for _, descriptor in parts.kinds(role)] for role in ("trajectory", "controller"))
    examples = {name.split()[0] for name in CONTROLLERS}
    laws = [*CONTROLLERS, *(name for name in controllers if name not in examples)]
    return list(itertools.product(trajectories, laws, ROBOT_CONTROLLERS))


def fits(trajectory: str, controller: str, robot_controller: str) -> bool:
    """Return whether the rule allows it."""
    return robot_controller in parts.robot_controllers(trajectory, controller.split()[0])


def is_of_joints(trajectory: str) -> bool:
    """Return whether its references are of the joints."""
    kind = getattr(proto, trajectory).DESCRIPTOR.GetOptions().Extensions[rules_pb2.kind]
    return list(kind.references) == [rules_pb2.KindRule.JOINTS]


def is_stream(trajectory: str) -> bool:
    """Return whether it has no end of its own, as it listens; nobody sends it anything here."""
    return any(field.name == "topic" and rule_of(field).required for field in getattr(proto, trajectory).DESCRIPTOR.fields)


def parts_of(trajectory: str, controller: str, goal: RigidTransform) -> tuple[Message, Message]:
    """Return them, for an arm at HOME and a pose SHIFT away from there."""
    if trajectory in JOINTS or trajectory in POSES:
        motion = JOINTS[trajectory]() if trajectory in JOINTS else POSES[trajectory](goal)
    else:
        motion = _drawn(trajectory, goal)
    return motion, CONTROLLERS[controller]() if controller in CONTROLLERS else _drawn(controller, goal)


def _drawn(kind: str, goal: RigidTransform) -> Message:
    message: Message = getattr(proto, kind)()
    try:
        validate(message)
        return message  # its defaults do
    except FrankaArmArgumentError:
        began = RigidTransform(goal.rotation, goal.translation - SHIFT)
        q_range = np.array([FrankaConstants.JOINT_LIMITS_MIN, FrankaConstants.JOINT_LIMITS_MAX])
        return Draw([1], q_range, HOME, began).part(message.DESCRIPTOR)


def moves_as_told(simulation: Simulation, fa: FrankaArm, *combination: str) -> None:
    """Run a combination and compare with where the arm truly is; raises AssertionError."""
    trajectory, controller, robot_controller = combination
    what = f"{trajectory} with {controller} in {robot_controller}"
    fa.run(MinJerkJoint(HOME, 0.7), robot_controller="auto")
    began = fa.get_pose(include_tool_offset=False)
    goal = began.copy()
    goal.translation = began.translation + SHIFT
    stays = trajectory in STAY or is_stream(trajectory)
    until = Time(0.6) if is_stream(trajectory) else Time(after_trajectory=0.5)
    result = fa.run(*parts_of(trajectory, controller, goal), until, robot_controller=robot_controller)
    assert result.ending == proto.TERMINATED, f"{what}: {result.message}"
    assert result.termination == "Time", what
    last, truth = result.last_state, simulation.truth()
    exact = {trajectory, controller} <= {*JOINTS, *POSES, *CONTROLLERS}
    if not exact and is_led(controller.split()[0]):
        return  # by forces that nobody chose, to anywhere
    if is_of_joints(trajectory):
        there = GOAL if trajectory in JOINTS else np.array(last.q_ref)
        wanted, now = HOME if stays or is_led(controller.split()[0]) else there, truth.q
    else:
        there = goal.translation if trajectory in POSES else np.array(last.O_T_EE_ref)[12:15]
        wanted, now = began.translation if stays or is_led(controller.split()[0]) else there, truth.O_T_TCP[:3, 3]
    np.testing.assert_allclose(now, wanted, atol=LEAST if exact else LEAST_DRAWN, err_msg=what)


def tried(simulation: Simulation, fa: FrankaArm, *combination: str) -> str:
    """Return RUNS for one that the rule allows and that moves as told, or with what another is refused; else "WRONG: ..."."""
    trajectory, controller, robot_controller = combination
    try:
        if fits(*combination):
            moves_as_told(simulation, fa, *combination)
            return RUNS
        goal = fa.get_pose(include_tool_offset=False)
        fa.run(*parts_of(trajectory, controller, goal), robot_controller=robot_controller)
        return "WRONG: runs against the rule"
    except FrankaArmArgumentError as error:
        return str(error) if not fits(*combination) else f"WRONG: {' '.join(str(error).split())[:200]}"
    except (AssertionError, FrankaArmException) as error:
        fa.wait_for_franka_interface()
        return f"WRONG: {' '.join(str(error).split())[:200]}"
