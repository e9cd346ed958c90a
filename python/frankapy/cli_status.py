"""The command frankapy status."""

from __future__ import annotations

import argparse

import numpy as np

from frankapy import proto
from frankapy.connection import Connection, arms_of, find_server
from frankapy.terminal import print_rows
from frankapy.utils import franka_pose_to_rigid_transform

TITLES = {"fer": "FER (Panda)", "fr3": "FR3", "fr3v2": "FR3v2"}
_NOT_TAKEN = {  # by the fields of the message
    "wrong_size": "datagrams of the wrong size",
    "bad_values": "states with values that are no numbers, or unknown modes",
    "old": "states that were not newer than the last",
    "foreign": "datagrams from another address",
    "unsent": "commands that the network did not take",
    "unasked": "answers that nobody had asked for",
}
_TOPIC_COUNTS = {  # by the fields of Topics.Topic
    "received": "received",
    "lost": "lost",
    "out_of_order": "out of order",
    "late": "late",
    "stale": "stale",
    "refused": "refused",
    "overrun": "too many for the loop",
    "silences": "times silent",
}
_PHASES = {
    proto.CONNECTING: "connecting",
    proto.READY: "ready",
    proto.CONFIGURING: "sending settings",
    proto.STARTING: "starting a motion",
    proto.RUNNING: "running a skill",
    proto.HOLDING: "holding its reference",
    proto.BRAKING: "braking",
    proto.FINISHING: "finishing a motion",
    proto.ERROR: "in error: takes no motion until recovered",
    proto.RECOVERING: "recovering",
}


def show(options: argparse.Namespace) -> int:
    """Show the arms of a server and what they do; return 0 where all can move, else 1."""
    server = find_server(options.server)
    answer = arms_of(server)
    arms = answer.arms
    refused = f"; {answer.refused_keys} connections with unknown keys refused" if answer.refused_keys else ""
    print(f"franka-interface at {server.address}: {len(arms)} arm{'s' * (len(arms) != 1)}{refused}")
    good = True
    deficiencies: list[str] = []
    for number, arm in enumerate(arms, 1):
        print()
        if not arm.endpoint:
            good = False
            print_rows(
                f"{number}  {arm.name}", [("robot", arm.address), ("not ready", arm.status or "no reason given")]
            )
            continue
        connection = Connection(options.server, number)
        try:
            state = connection.ask(proto.Request(get_state=proto.GetState())).state
            server_status = connection.ask(proto.Request(get_server_status=proto.GetServerStatus())).server_status
            topics = connection.ask(proto.Request(list_topics=proto.ListTopics())).topics
        finally:
            connection.close()
        good = good and state.phase not in (proto.ERROR, proto.CONNECTING)
        rows = _rows(connection.welcome, state) + _server_rows(server_status, state) + _topic_rows(topics)
        print_rows(f"{number}  {arm.name}", rows)
        deficiencies += [text for text in connection.welcome.deficiencies if text not in deficiencies]
    if deficiencies:
        print()
        print_rows("The server's computer could be better", [("", text) for text in deficiencies])
    return 0 if good else 1


def _rows(welcome: proto.Welcome, state: proto.ArmState) -> list[tuple[str, str]]:
    robot = state.robot
    rows = [
        (
            "robot",
            f"{TITLES.get(welcome.model, welcome.model)} at {welcome.address}, protocol {welcome.protocol_version}",
        )
    ]
    if welcome.key:
        rows.append(("you", f"{welcome.key}, role {proto.Role.Name(welcome.role).lower()}"))
    mode = proto.RobotMode.Name(robot.robot_mode).lower().replace("_", " ")
    rows.append(("mode", f"{mode}; the server is {_PHASES.get(state.phase, str(state.phase))}"))
    if state.skill_id:
        rows.append(("skill", f"{state.skill_description or 'without a name'}, since {state.skill_time:.1f} s"))
    rows.append(("joints", "  ".join(f"{q:7.3f}" for q in np.round(robot.q, 3) + 0.0) + "  rad"))
    limits = welcome.limits
    if len(limits.q_min) == 7:
        share = (np.array(robot.q) - limits.q_min) / (np.array(limits.q_max) - np.array(limits.q_min))
        rows.append(("of range", "  ".join(f"{100 * s:5.0f} %" for s in share)))
    pose = franka_pose_to_rigid_transform(robot.O_T_EE)
    x, y, z = pose.translation.round(4) + 0.0  # + 0.0: no "-0"
    roll, pitch, yaw = np.degrees(pose.euler_angles).round(1) + 0.0
    rows.append(
        ("tool", f"x {x:.4f}  y {y:.4f}  z {z:.4f} m   roll {roll:.1f}  pitch {pitch:.1f}  yaw {yaw:.1f} degrees")
    )
    force = np.array(robot.O_F_ext_hat_K)
    rows.append(
        ("forces", f"{np.linalg.norm(force[:3]):.1f} N, {np.linalg.norm(force[3:]):.1f} Nm on the tool, as estimated")
    )
    if state.HasField("gripper"):
        held = ", holds something" if state.gripper.is_grasped else ""
        rows.append(("hand", f"{1000 * state.gripper.width:.1f} mm open{held}"))
    else:
        rows.append(("hand", "none"))
    if robot.robot_mode == proto.MOVE:
        rows.append(
            ("packets", f"{100 * robot.control_command_success_rate:.0f} % of the last 100 commands arrived in time")
        )
    counts = {what: getattr(state.not_taken, field) for field, what in _NOT_TAKEN.items()}
    if not_taken := [f"{count} {what}" for what, count in counts.items() if count]:
        rows.append(("not taken", ", ".join(not_taken) + "; since the robot was connected"))
    errors = list(robot.errors) or list(robot.reflex_reason)
    rows.append(("errors", ", ".join(errors) or "none"))
    return rows


def _server_rows(status: proto.ServerStatus, state: proto.ArmState) -> list[tuple[str, str]]:
    late = f"{status.late_cycles} late of {status.motion_cycles} in motions"
    cycles = f"{late}; {state.lost_states} states of the robot did not arrive"
    return [("commanded by", status.commander or "nobody"), ("cycles", cycles)]


def _topic_rows(topics: proto.Topics) -> list[tuple[str, str]]:
    rows = []
    for topic in topics.topics:
        rate = f"{1 / topic.period:.1f} Hz, " if topic.period else ""
        newest = f"{topic.message}, {rate}{topic.age:.1f} s old" if topic.HasField("age") else "nothing has come"
        counts = ", ".join(f"{getattr(topic, field)} {what}" for field, what in _TOPIC_COUNTS.items() if getattr(topic, field))
        listens = f"skill {', '.join(map(str, topic.skills))} listens" if topic.skills else "no skill listens"
        rows.append(("topic", f"{topic.topic}: {'; '.join(filter(None, (newest, counts, listens)))}"))
        if topic.why_refused:
            rows.append(("", f"refused last: {topic.why_refused}"))
    if topics.garbage:
        rows.append(("topic", f"{topics.garbage} messages that could not be read"))
    return rows
