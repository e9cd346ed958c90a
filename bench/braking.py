"""How far an arm goes on before it stands where a wall stops it at 0.5 m/s, by the least that its limits allow; in lockstep.

A velocity of the first joint is streamed that leads the tool towards a plane. What is measured is how far the foremost capsule of
the arm goes on, as its reference was commanded, from where that first slows to where it comes no nearer. The least is computed here
from the state where it slows: the joint goes to rest with the greatest jerk and acceleration that the robot allows.
  braking_ratio_joints_torque, _joints_motion
                 the one by the other, the greater of FER and FR3; under our torques (impedance), and by the robot's own control
  braking_ratio  the greater of these
"""

import contextlib
import json
import sys
import time
from pathlib import Path

import numpy as np
from google.protobuf.message import Message

from frankapy import FrankaArm, FrankaArmException, proto
from frankapy.kinematics import link_frames
from frankapy.parts import InternalImpedance, JointImpedance, MinJerkJoint, Never, StreamJointVelocity
from frankapy.sim import SimulatedArm, Simulation
from frankapy.walls import Plane

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY / "tests" / "safety"))
from judge import capsules, frames, wire_limits  # noqa: E402

TICK = 1e-3  # s
SPEED = 0.5  # m/s, of the tool
SLOWER = 0.002  # of the speed, that is not yet slowing
REST = 1e-3  # m/s
AFTER = 400  # cycles at a wall, in which the arm stands before it
TOPIC = "way"
FIELDS = ["robot.message_id", "phase", "q_ref", "held_by"]
BEGIN = np.array([-0.7, 0.1, 0, -2.1, 0, 2.2, 0.785])
WAY = np.array([0.0, 1, 0])
WALL = Plane(-WAY, [0, 0.2, 0])
LONGEST = 20  # s of the wall, until the arm rests


def tool(q: np.ndarray) -> np.ndarray:
    return link_frames(q)[-1][:3, 3]


def stop(speed: float, acceleration: float, jerk: float) -> float:
    """Return the way of the soonest stop from an even speed."""
    changing = min(acceleration / jerk, np.sqrt(speed / jerk))
    constant = speed / (jerk * changing) - changing
    return float(speed * (2 * changing + constant) / 2)


def reach(q: np.ndarray) -> np.ndarray:
    """Return how far the foremost capsule of the arm reaches towards the wall in postures (n, 7), m."""
    at = frames(q)
    return np.max(
        [
            np.maximum(*((at[each.frame, :, :3, :3] @ end + at[each.frame, :, :3, 3]) @ WAY for end in (each.a, each.b)))
            + each.radius
            for each in capsules()
        ],
        axis=0,
    )


def least_way(q: np.ndarray, dq: np.ndarray, limits: wire_limits.Limits) -> float:
    """Return how far the arm goes on (m) when each joint stops by itself."""
    rest = [np.sign(v) * stop(abs(v), a, j) if v else 0 for v, a, j in zip(dq, limits.ddq, limits.dddq, strict=True)]
    return float(np.diff(reach(np.array([q, q + rest])))[0])


def ratio(rows: list[proto.ArmState], limits: wire_limits.Limits) -> float:
    """Return how far the arm goes on towards the wall from where its reference first slows, by the least."""
    q = np.array([state.q_ref for state in rows])
    dt = TICK * np.diff([state.robot.message_id for state in rows])
    dq = np.diff(q, axis=0) / dt[:, None]
    place = reach(q)
    nearing = np.diff(place) / dt
    walled = next(k for k, state in enumerate(rows) if state.held_by & proto.WALL)
    speeds = np.linalg.norm(dq, axis=1)
    even = np.median(speeds[walled - 50 : walled - 10])
    stands = walled + int(np.flatnonzero(nearing[walled:] <= REST)[0])
    slows = int(np.flatnonzero(speeds[:stands] >= (1 - SLOWER) * even)[-1])
    speed = float(np.linalg.norm(tool(q[slows + 1]) - tool(q[slows])) / dt[slows])
    if abs(speed - SPEED) > 0.1 * SPEED:
        raise ValueError(f"the tool goes at {speed:.3f} m/s where it slows: expected {SPEED}")
    way, least = float(place[stands] - place[slows + 1]), least_way(q[slows + 1], dq[slows], limits)
    print(f"  {1e3 * way:.1f} mm at {speed:.3f} m/s; least {1e3 * least:.1f} mm", file=sys.stderr)
    return way / least


def towards_wall(fa: FrankaArm, controller: Message, robot_controller: str) -> list[proto.ArmState]:
    """Let the arm go to the wall; return the states of the skill until it stands there."""
    fa.walls.clear()
    fa.run(MinJerkJoint(BEGIN, 2))
    fa.walls["wall"] = WALL
    rows: list[proto.ArmState] = []
    walled = 0
    until = time.monotonic() + LONGEST
    with fa.states(fields=FIELDS) as states, fa.publisher(TOPIC) as publisher:
        stream = StreamJointVelocity(TOPIC, timeout=60, speed=1)
        fa.run(stream, controller, Never(), robot_controller=robot_controller, block=False)
        dq = SPEED / np.hypot(*tool(BEGIN)[:2])
        publisher.publish(proto.JointVelocitySensorMessage(joint_velocities=[dq, 0, 0, 0, 0, 0, 0]))
        for state in states:
            if state.phase == proto.RUNNING and len(state.q_ref):
                rows.append(state)
                walled += walled > 0 or bool(state.held_by & proto.WALL)
            elif rows:
                break
            if walled > AFTER or time.monotonic() > until:
                break
    with contextlib.suppress(FrankaArmException):
        fa.stop_skill()
    return rows


def main() -> None:
    entries: dict[str, float] = {}
    for robot, limits in wire_limits.LIMITS.items():
        with Simulation(SimulatedArm(robot=robot, lockstep=True)) as simulation, FrankaArm(server=simulation.server) as fa:
            ways = [("torque", JointImpedance(), "torque"), ("motion", InternalImpedance(), "joint_position")]
            for name, controller, mode in ways:
                print(f"{robot} {name}", file=sys.stderr)
                key = f"braking_ratio_joints_{name}"
                entries[key] = max(entries.get(key, 0), ratio(towards_wall(fa, controller, mode), limits))
    print(json.dumps(entries | {"braking_ratio": max(entries.values())}))


if __name__ == "__main__":
    main()
