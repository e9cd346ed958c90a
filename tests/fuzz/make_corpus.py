"""Write the corpora of the fuzz targets: whole sessions in the versions that differ. `make_corpus.py [FOLDER]`, of .venv."""

import itertools
import math
import struct
import sys
from pathlib import Path

import numpy as np
from google.protobuf.message import Message

from frankapy import RigidTransform, parts, proto
from frankapy.skill import make_skill

sys.path.append(str(Path(__file__).resolve().parents[1] / "python"))
from part_combinations import CONTROLLERS, GOAL, JOINTS, POSES, SHIFT, fits, parts_of  # noqa: E402

# Steps of client_to_arm.cpp and arm_to_client.cpp.
ROBOT_TCP, ROBOT_UDP, ROBOT_COMMAND, CYCLES, NEW_ROBOT_CLIENT, GRIPPER_TCP, NEW_GRIPPER_CLIENT = range(7)
TCP, UDP = range(2)
# And those of client_to_server.cpp.
REQUEST, REQUEST_OF_ANOTHER, SENSOR, TENS_OF_CYCLES = range(4)
ROBOT, HAND = b"\0", b"\1"

OLD_IDS = {"collision": 4, "joint": 5, "cartesian": 6, "guiding": 7, "k": 8, "ee": 9, "load": 10, "recovery": 12,
           "limit": 3, "filters": 11, "library": 13}  # fmt: skip
IDS = {
    5: OLD_IDS,
    6: {"collision": 3, "joint": 4, "cartesian": 5, "guiding": 6, "k": 7, "ee": 8, "load": 9, "recovery": 10, "library": 11},
    9: {"collision": 3, "joint": 4, "cartesian": 5, "guiding": 6, "k": 7, "ee": 8, "load": 9, "recovery": 10,
        "library": 11, "model": 12},
    10: {"collision": 3, "joint": 4, "cartesian": 5, "guiding": 6, "k": 7, "ee": 8, "load": 9, "recovery": 10, "model": 11},
}  # fmt: skip
COMMAND_SIZE = {5: 370, 6: 370, 9: 371, 10: 371}
STATE_SIZE = {5: 2373, 6: 2373, 9: 2373, 10: 1377}
HOME = [0, -math.pi / 4, 0, -3 * math.pi / 4, 0, math.pi / 2, math.pi / 4]
IDENTITY = [float(i % 5 == 0) for i in range(16)]


def step(what: int, payload: bytes = b"") -> bytes:
    """One step of a script."""
    return struct.pack("<BH", what, len(payload)) + payload


def request(command: int, number: int, body: bytes = b"") -> bytes:
    """A message to or from the robot."""
    return struct.pack("<III", command, number, 12 + len(body)) + body


def hand_request(command: int, number: int, body: bytes = b"") -> bytes:
    """A message to or from the hand."""
    return struct.pack("<HII", command, number, 10 + len(body)) + body


def doubles(*values: float) -> bytes:
    """Packed as on the wire."""
    return struct.pack(f"<{len(values)}d", *values)


def move(version: int, controller: int, generator: int) -> bytes:
    """A Move request's body."""
    body = struct.pack("<II", controller, generator) + doubles(10, 3.12, 2 * math.pi) * 2
    return body + (bytes([0]) + doubles(*[1.0] * 7) if version == 10 else b"")


def command(version: int, q: list[float], *, finished: bool = False) -> bytes:
    """A command datagram; its message_id is put in when it is sent."""
    bytes_ = struct.pack("<Q", 0) + doubles(*q, *[0.0] * 7, *IDENTITY, *[0.0] * 6, *[0.0] * 2)
    bytes_ += bytes([0, finished]) + doubles(*[0.0] * 7)
    return bytes_ + bytes([finished] if COMMAND_SIZE[version] == 371 else [])


def to_arm(version: int) -> dict[str, bytes]:
    """Sessions of a client of this version."""
    ids = IDS[version]
    connect = step(ROBOT_TCP, request(0, 0, struct.pack("<HH", version, 40000)))
    settings = b"".join(
        step(ROBOT_TCP, request(ids[name], number, body))
        for number, (name, body) in enumerate(
            {
                "collision": doubles(*[20.0] * 52),
                "joint": doubles(*[3000.0] * 7),
                "cartesian": doubles(*[300.0] * 6),
                "guiding": bytes([1] * 7),
                "k": doubles(*IDENTITY),
                "ee": doubles(*IDENTITY),
                "load": doubles(0.5, 0, 0, 0.1, *[0.001 * (i % 4 == 0) for i in range(9)]),
                "recovery": b"",
            }.items(),
            1,
        )
    )
    if "model" in ids:
        settings += step(ROBOT_TCP, request(ids["model"], 20))
    if "filters" in ids:
        settings += step(ROBOT_TCP, request(ids["filters"], 21, doubles(*[100.0] * 5)))
        settings += step(ROBOT_TCP, request(ids["limit"], 22, struct.pack("<i", 1)))
    out = {"settings": connect + settings}
    for controller in (0, 1, 2):
        for generator in range(5 if COMMAND_SIZE[version] == 371 else 4):
            motion = connect + step(ROBOT_TCP, request(1, 30, move(version, controller, generator)))
            for i in range(4):
                motion += step(ROBOT_COMMAND, command(version, [q + 1e-5 * i for q in HOME]))
            out[f"finish-{controller}{generator}"] = motion + step(ROBOT_COMMAND, command(version, HOME, finished=True))
            out[f"stop-{controller}{generator}"] = motion + step(ROBOT_TCP, request(2, 31)) + step(CYCLES, bytes(50))
    out["leave"] = motion + step(NEW_ROBOT_CLIENT) + connect + step(ROBOT_TCP, request(ids["recovery"], 1))
    out["pieces"] = connect + b"".join(step(ROBOT_TCP, bytes([b])) for b in request(2, 1)) + step(ROBOT_UDP, bytes(40))
    return out


def to_hand() -> dict[str, bytes]:
    """A client of the hand."""
    messages = [(0, struct.pack("<HH", 3, 40000)), (1, b""), (3, doubles(0.04, 0.1)),
                (2, doubles(0.02, 0.005, 0.005, 0.1, 20)), (4, b"")]  # fmt: skip
    session = b"".join(step(GRIPPER_TCP, hand_request(c, i, body)) + step(CYCLES, bytes(40)) for i, (c, body) in enumerate(messages))
    return {"hand": session + step(NEW_GRIPPER_CLIENT) + session}


def state(version: int, message_id: int, mode: int, controller: int = 0, generator: int = 0) -> bytes:
    """A state datagram: an arm at home that does nothing."""
    number = "f" if version == 10 else "d"
    at = {"q": 596, "mg": 1288, "mode": 1372} if version == 10 else {"q": 1184, "mg": 2280, "mode": 2364}
    out = bytearray(STATE_SIZE[version])
    struct.pack_into(f"<Q16{number}", out, 0, message_id, *IDENTITY)
    struct.pack_into(f"<7{number}", out, at["q"], *HOME)
    struct.pack_into("<BB", out, at["mg"], generator, controller)
    out[at["mode"]] = mode
    return bytes(out)


def from_arm(version: int) -> dict[str, bytes]:
    """What a robot of this version says."""
    connected = step(TCP, request(0, 0, struct.pack("<BH", 0, version)))
    states = b"".join(step(UDP, state(version, 1 + i, 1)) for i in range(3))
    model = step(TCP, request(IDS[version].get("model", 12), 1, b"\0<robot name='x'><link name='link0'/></robot>"))
    moving = b"".join(step(UDP, state(version, 10 + i, 2, 2, 1)) for i in range(5))
    answers = step(TCP, request(1, 2, b"\1")) + step(TCP, request(2, 3, b"\0"))
    return {
        "session": ROBOT + connected + states + model + moving + answers,
        "refused": ROBOT + step(TCP, request(0, 0, struct.pack("<BH", 1, version))),
        "cut": ROBOT + connected + states + step(UDP, state(version, 20, 1)[:-7]) + step(TCP, request(1, 2, b"\1")[:9]),
    }


def from_hand() -> dict[str, bytes]:
    """What a hand says."""
    hand_state = struct.pack("<IddBH", 1, 0.04, 0.08, 0, 30)
    session = step(TCP, hand_request(0, 0, struct.pack("<HH", 0, 3))) + step(UDP, hand_state)
    return {"hand": HAND + session + step(TCP, hand_request(3, 1, struct.pack("<H", 0)))}


def to_control() -> dict[str, bytes]:
    """What scripts ask of a simulated arm's control channel."""
    button = proto.PressButton
    way = proto.SetNetwork.Way
    box = proto.AddObject(name="box", shape="BOX", size=[0.04, 0.04, 0.04], mass=0.1, position=[0.4, 0.3, 0.1])
    calls = {
        "people": [
            {"push": proto.Push(wrench=[0, 0, -20, 0, 0, 1], duration=0.05)},
            {"push": proto.Push(wrench=[5, 0, 0, 0, 0, 0], duration=0.05, at=proto.Hold(link=4, point=[0.1, 0, 0.5]))},
            {"pull": proto.Pull(times=[0.1, 0.2], positions=[0.5, 0, 0.4, 0.4, 0.1, 0.4], duration=0.3)},
            {"get_truth": proto.GetTruth()},
        ],
        "things": [
            {"move_object": proto.MoveObject(name="block", position=[0.4, 0.2, 0.1], quaternion=[1, 0, 0, 0])},
            {"set_friction": proto.SetFriction(name="block", friction=0.1)},
            {"add_object": box},
            {"add_object": box},
        ],
        "buttons": [
            {"press_button": button(button=button.USER_STOP)},
            {"press_button": button(button=button.GUIDING)},
            {"press_button": button(button=button.GUIDING, pressed=False)},
            {"press_button": button(button=button.USER_STOP, pressed=False)},
            {"press_button": button(button=button.ENABLING_DEVICE, pressed=False)},
            {"press_button": button(button=button.JOINT_LOCK)},
        ],
        "robot": [
            {"inject_error": proto.InjectError(name="joint_reflex")},
            {"set_virtual_wall": proto.SetVirtualWall(id=1, size=[1, 1, 1], position=[0, 0.3, 0])},
            {"set_network": proto.SetNetwork(to_arm=way(loss=0.1), from_arm=way(delayed=0.1, delay=0.002), seed=3)},
        ],
        "time": [
            {"pause": proto.Pause()},
            {"save": proto.SaveMoment()},
            {"step": proto.StepCycles(cycles=20)},
            {"restore": proto.RestoreMoment(moment=2)},
            {"forget": proto.ForgetMoment(moment=2)},
            {"pause": proto.Pause(kind=proto.Pause.BETWEEN_MOTIONS)},
            {"resume": proto.Resume()},
        ],
    }
    sessions = {
        name: b"".join(step(0, proto.SimulationCall(**call).SerializeToString()) for call in session)
        for name, session in calls.items()
    }
    return sessions | {"garbage": step(0, b"\xff" * 40) + step(0) + step(0, b"\x0a\x02\x08\x01")}


def goal() -> RigidTransform:
    """Return a pose near the flange's at home."""
    return RigidTransform(np.diag([1.0, -1, -1]), SHIFT + [0.307, 0, 0.59])


def skills() -> dict[str, list[proto.Skill]]:
    """Each trajectory with two controllers that it fits, and each controller, in turns; what takes thousands of numbers is left out."""
    out: dict[str, list[proto.Skill]] = {}
    laws = itertools.cycle(CONTROLLERS)
    for kind in (*JOINTS, *POSES):
        if kind.endswith("Samples"):
            continue
        found: list[proto.Skill] = []
        for law in itertools.islice(laws, len(CONTROLLERS)):
            modes = [mode for mode in proto.RobotController.keys()[1:] if fits(kind, law, mode.lower())]
            if modes and len(found) < 2:
                trajectory, controller = parts_of(kind, law, goal())
                until = [parts.Time(0.3), parts.Contact([20] * 7, [20] * 6)][: 1 + len(found)]
                found.append(make_skill(trajectory, controller, until, robot_controller=modes[len(found) % len(modes)].lower()))
        next(laws)
        out[kind] = found
    return out


def to_server() -> dict[str, bytes]:
    """What clients ask of an arm's server, and publishers send to it."""
    numbers = itertools.count(1)

    def ask(what: int = REQUEST, **call: Message) -> bytes:
        return step(what, proto.Request(request_id=next(numbers), **call).SerializeToString())

    def cycles(tens: int) -> bytes:
        return step(TENS_OF_CYCLES, bytes([tens]))

    def sensor(topic: str, message: Message, sequence: int) -> bytes:
        out = proto.SensorMessage(topic=topic, publisher=1, sequence=sequence, sent_ns=sequence * 10**7)
        out.message.Pack(message)
        return step(SENSOR, out.SerializeToString())

    start, walls, limits = proto.StartSkill, proto.ChangeWalls, proto.Limits
    out = {}
    for kind, (first, second) in skills().items():
        checked = ask(check_skill=proto.CheckSkill(skill=first))
        out[kind] = checked + ask(start_skill=start(skill=first)) + cycles(10) + ask(start_skill=start(skill=second, preempt=True))
        out[kind] += cycles(20)

    first, second = skills()["MinJerkJoint"]
    change = proto.ChangeSkill(skill_id=1)
    change.trajectory.Pack(parts.TimeOptimalJoint(GOAL, 0.5))
    change.terminations.add().Pack(parts.FinalJoint())
    out["queue"] = (
        ask(start_skill=start(skill=first))
        + ask(start_skill=start(skill=second, after=1, blend=0.1))
        + cycles(5)
        + ask(change_skill=change)
        + cycles(60)
        + ask(skill_status=proto.SkillStatus(skill_id=1))
        + ask(stop_skill=proto.StopSkill(), what=REQUEST_OF_ANOTHER)
        + ask(start_skill=start(skill=first), what=REQUEST_OF_ANOTHER)
        + ask(goodbye=proto.Goodbye())
        + ask(start_skill=start(skill=first), what=REQUEST_OF_ANOTHER)
    )
    for kind, messages in {
        "StreamJoint": [
            proto.JointPositionSensorMessage(joints=GOAL),
            proto.JointChunk(times=[0.01, 0.02], joints=[*GOAL, *GOAL]),
        ],
        "StreamPose": [
            proto.PosePositionSensorMessage(position=goal().translation, quaternion=goal().quaternion),
            proto.PoseChunk(times=[0.01], positions=goal().translation, quaternions=goal().quaternion),
        ],
        "StreamJointVelocity": [proto.JointVelocitySensorMessage(joint_velocities=[0.1] * 7)],
        "StreamCartesianVelocity": [proto.CartesianVelocitySensorMessage(cartesian_velocities=[0.05, 0, 0, 0, 0, 0.1])],
        "StreamForcePosition": [
            proto.ForcePositionSensorMessage(seg_run_time=0.05, pose=goal().matrix.T.ravel(), force=[0, 0, 5, 0, 0, 0])
        ],
    }.items():
        out[f"sensors-{kind}"] = ask(start_skill=start(skill=skills()[kind][0])) + b"".join(
            sensor("nobody", message, number) + cycles(3) for number, message in enumerate(messages * 3, 1)
        )
        out[f"sensors-{kind}"] += sensor("nobody", proto.ShouldTerminateSensorMessage(should_terminate=True), 99) + cycles(10)
        out[f"sensors-{kind}"] += ask(list_topics=proto.ListTopics())

    box = proto.Wall(name="box", box=proto.Wall.Box(size=[0.1, 0.2, 0.3]), position=[0.6, 0.1, 0.2])
    corners = [0, 0, 0, 0.1, 0, 0, 0, 0.1, 0, 0, 0, 0.1]
    mesh = proto.Wall.Mesh(corners=corners, triangles=[0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3])
    shapes = [
        box,
        proto.Wall(name="floor", plane=proto.Wall.Plane(), position=[0, 0, -0.1]),
        proto.Wall(name="ball", sphere=proto.Wall.Sphere(radius=0.05), position=[0.4, 0.3, 0.2]),
        proto.Wall(name="post", cylinder=proto.Wall.Cylinder(radius=0.05, length=0.8), position=[0.3, 0.4, 0.4]),
        proto.Wall(name="tool", capsule=proto.Wall.Capsule(radius=0.02, length=0.1), position=[0, 0, 0.15], held=True),
        proto.Wall(name="wedge", mesh=mesh, position=[0.5, -0.3, 0.1], orientation=[1, 0, 0, 0]),
    ]
    out["walls"] = (
        b"".join(ask(change_walls=walls(put=[shape])) for shape in shapes)
        + ask(start_skill=start(skill=first))
        + cycles(20)
        + ask(change_walls=walls(remove=["ball"], put=[box, proto.Wall(name="near", sphere=proto.Wall.Sphere(radius=0.1), position=[0.4, 0, 0.6])]))
        + cycles(30)
        + ask(change_walls=walls())
    )
    out["limits"] = (
        ask(change_limits=proto.ChangeLimits(limits=limits(velocity=0.2, acceleration=0.5, jerk=0.5, torque=0.5)))
        + ask(start_skill=start(skill=first))
        + cycles(20)
        + ask(change_limits=proto.ChangeLimits(limits=limits(tool_speed=0.1, power=10)))
        + cycles(20)
        + ask(change_limits=proto.ChangeLimits(reset=True))
    )
    out["other"] = (
        ask(get_state=proto.GetState())
        + ask(get_server_status=proto.GetServerStatus())
        + ask(record=proto.Record())
        + ask(gripper=proto.GripperCommand(move=proto.GripperCommand.Move(width=0.04)))
        + ask(recover=proto.Recover())
        + cycles(3)
        + ask(alive=proto.Alive())
        + ask(list_arms=proto.ListArms())
        + ask(hello=proto.Hello(version=proto.CURRENT, client="another"))
    )
    return out | {"garbage": step(REQUEST, b"\xff" * 40) + step(REQUEST) + step(SENSOR, b"\x0a\x02\x08\x01")}


def main() -> None:
    """Write them all."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "corpus"
    for target, one_version, hand in (("client_to_arm", to_arm, to_hand), ("arm_to_client", from_arm, from_hand)):
        (folder / target).mkdir(parents=True, exist_ok=True)
        sessions = {
            f"v{version}-{name}": data
            for version in IDS
            for name, data in one_version(version).items()
            if version in (5, 10) or name in ("settings", "leave", "session")
        }
        for name, data in (sessions | hand()).items():
            (folder / target / name).write_bytes(data)
    for target, sessions in {"control_channel": to_control(), "client_to_server": to_server()}.items():
        (folder / target).mkdir(parents=True, exist_ok=True)
        for name, data in sessions.items():
            (folder / target / name).write_bytes(data)


if __name__ == "__main__":
    main()
