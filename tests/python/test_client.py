"""The client towards a server that misbehaves, and its own bookkeeping; no arm."""

import gc
import inspect
import logging
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import zmq
from scripted_server import HOME, ScriptedServer

from frankapy import (
    FrankaArm,
    FrankaArmArgumentError,
    FrankaArmBusyException,
    FrankaArmCommException,
    FrankaArmException,
    FrankaArmFrankaInterfaceNotReadyException,
    RigidTransform,
    channel,
    cli,
    connection,
    dmp,
    proto,
    proto_utils,
    states,
)
from frankapy.franka_interface_common_definitions import SensorDataMessageType
from frankapy.progress import progress
from frankapy.sim import free_address
from frankapy.states import NewestState, StateStream, as_dictionary


@pytest.fixture
def server():
    with ScriptedServer() as server:
        yield server


@pytest.fixture
def arm(server):
    with FrankaArm(server=server.address) as arm:
        yield arm


@pytest.fixture
def impatient(monkeypatch):
    """Take a server for gone after 1 s of silence."""
    monkeypatch.setattr(channel, "SILENCE", 1.0)


def wait_until(condition):
    deadline = time.monotonic() + 200
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def refusal(code, message="no"):
    return proto.Error(code=code, message=message)


def test_without_a_server_the_error_says_how_to_get_one():
    with pytest.raises(FrankaArmCommException, match="frankapy sim"):
        FrankaArm(server=f"{free_address()}:5757")


@pytest.mark.parametrize("name", ["127.0.0.1:x", ":5757", "127.0.0.1:0", "127.0.0.1:70000", "192.168.1..10", "x" * 70])
def test_an_address_that_is_none_is_refused_by_name(name):
    with pytest.raises(FrankaArmArgumentError, match="expected host or host:port"):
        FrankaArm(server=name)


def test_the_environment_names_the_server(server, monkeypatch):
    monkeypatch.setenv("FRANKA_INTERFACE_SERVER", server.address)
    with FrankaArm() as arm:
        assert list(arm.get_joints()) == HOME


def test_another_program_on_the_port_is_told_from_a_server(impatient):
    with socket.create_server((free_address(), 0)) as stranger:
        host, port = stranger.getsockname()
        with pytest.raises(FrankaArmCommException, match="another program"):
            FrankaArm(server=f"{host}:{port}")


def test_that_a_server_went_before_it_answered_is_known_at_once():
    with ScriptedServer() as server:
        found = connection.find_server(server.address)
    with pytest.raises(FrankaArmCommException, match="No server at"):  # and not that it does not answer
        connection.arms_of(found)


def test_another_version_is_refused(server):
    server.version = 0
    with pytest.raises(FrankaArmCommException, match="install the same version"):
        FrankaArm(server=server.address)


def test_an_arm_that_is_not_there_is_refused_with_those_that_are(server):
    with pytest.raises(FrankaArmArgumentError, match="arm1"):
        FrankaArm(server=server.address, robot_num=2)


@pytest.mark.parametrize(
    ("code", "exception"),
    [
        (proto.Error.INVALID_ARGUMENT, FrankaArmArgumentError),
        (proto.Error.BUSY, FrankaArmBusyException),
        (proto.Error.INTERNAL, FrankaArmException),
    ],
)
def test_a_refusal_raises_its_exception_with_the_servers_text(server, arm, code, exception, monkeypatch):
    monkeypatch.setattr(connection, "_LEASE_TIME", 0)
    server.refusals = [refusal(code, "the reason")]
    with pytest.raises(exception, match="the reason"):
        arm.goto_joints(HOME, 1)
    arm.goto_joints(HOME, 1)


def test_a_first_command_waits_for_the_arm_of_one_that_was_killed_and_no_other_does(server, arm, monkeypatch):
    monkeypatch.setattr(connection, "_LEASE_TIME", 60)  # s: a computer may stand still
    server.refusals = [refusal(proto.Error.BUSY, "another client commands this arm")] * 3
    arm.goto_joints(HOME, 1)
    assert len(server.calls("start_skill")) == 4
    server.refusals = [refusal(proto.Error.BUSY)]
    with pytest.raises(FrankaArmBusyException):
        arm.goto_joints(HOME, 1)
    assert len(server.calls("start_skill")) == 5


def test_an_arm_in_error_is_recovered_and_the_motion_made(server, arm):
    server.refusals = [refusal(proto.Error.NOT_READY)]
    server.phase = proto.ERROR
    arm.goto_joints(HOME, 1)
    assert len(server.calls("recover")) == 1
    assert len(server.calls("start_skill")) == 2


def test_an_arm_in_error_is_left_alone_when_errors_are_not_ignored(server, arm):
    server.refusals = [refusal(proto.Error.NOT_READY)]
    with pytest.raises(FrankaArmFrankaInterfaceNotReadyException):
        arm.goto_joints(HOME, 1, ignore_errors=False)
    assert not server.calls("recover")


def test_a_failed_skill_raises_or_warns_as_asked_for(server, arm, caplog):
    server.result = {"ending": proto.ROBOT_ERROR, "message": "cartesian_reflex: the arm hit something"}
    with pytest.raises(FrankaArmException, match="cartesian_reflex"):
        arm.goto_joints(HOME, 1, ignore_errors=False)
    with caplog.at_level(logging.WARNING, "frankapy"):
        server.result["recovery"] = proto.Recovery(recovered=True, by_itself=True)
        arm.goto_joints(HOME, 1)
    assert "cartesian_reflex" in caplog.text
    assert not server.calls("recover")
    assert [call.start_skill.skill.recovery.who for call in server.calls("start_skill")] == [
        proto.RecoveryPolicy.ASK,
        proto.RecoveryPolicy.ITSELF,
    ]


def test_is_skill_done_raises_when_errors_are_not_ignored(server, arm):
    server.result = {"ending": proto.REFUSED, "message": "the robot refused"}
    arm.goto_joints(HOME, 1, block=False)
    with pytest.raises(FrankaArmException, match="the robot refused"):
        while not arm.is_skill_done(ignore_errors=False):
            time.sleep(0.005)
    assert arm.is_skill_done()


def test_who_waits_is_told_of_a_failure_that_another_thread_has_seen(server, arm, caplog):
    arm.goto_joints(HOME, 1)
    server.result = {"ending": proto.ROBOT_ERROR, "message": "cartesian_reflex", "recovery": proto.Recovery(recovered=True)}
    arm.goto_joints(HOME, 1, block=False)
    motion = arm._motions.running
    wait_until(arm.is_skill_done)  # of a thread that looks, and ignores errors
    with pytest.raises(FrankaArmException, match="cartesian_reflex") as raised:
        arm._motions.wait(motion, ignore_errors=False)
    assert raised.value.result.skill_id == motion.id
    assert arm._motions.wait(motion, ignore_errors=True).skill_id == motion.id
    assert caplog.text.count("cartesian_reflex") == 1


def test_a_motion_that_failed_in_a_sequence_is_raised_by_it_however_it_was_looked_at(server, arm):
    server.result = {"ending": proto.ROBOT_ERROR, "message": "cartesian_reflex", "recovery": proto.Recovery(recovered=True)}
    with pytest.raises(FrankaArmException, match="cartesian_reflex"), arm.sequence():
        arm.goto_joints(HOME, 1, ignore_errors=False)
        arm.wait_for_skill()


def test_a_second_command_while_one_runs_is_refused(server, arm):
    server.skill_time = 10
    arm.goto_joints(HOME, 1, block=False)
    with pytest.raises(ValueError, match="previous skill is active"):
        arm.goto_joints(HOME, 1)
    arm.stop_skill()
    assert arm.is_skill_done()


def test_a_motion_that_was_stretched_is_told_of(server, arm, caplog):
    server.result = {"ending": proto.TERMINATED, "stretch": 2.5}
    with caplog.at_level(logging.WARNING, "frankapy"):
        arm.goto_joints(HOME, 1)
    assert "2.50 times" in caplog.text


def test_a_commanding_client_says_that_it_is_alive(server, arm):
    arm.goto_joints(HOME, 1)
    wait_until(lambda: len(server.calls("alive")) >= 4)


@pytest.mark.parametrize(
    "change",
    [
        proto.Request(change_walls=proto.ChangeWalls(put=[proto.Wall(name="table", plane=proto.Wall.Plane())])),
        proto.Request(change_walls=proto.ChangeWalls(remove=["table"])),
        proto.Request(change_limits=proto.ChangeLimits(reset=True)),
    ],
)
def test_a_client_that_changes_what_bounds_the_arm_says_that_it_is_alive(server, arm, change):
    arm._connection.ask(change)
    wait_until(lambda: len(server.calls("alive")) >= 4)


def test_a_reading_client_is_quiet(server, arm):
    arm.get_joints()
    list(arm.walls)
    repr(arm.limits)
    before = len(server.calls("alive"))
    time.sleep(0.5)
    assert len(server.calls("alive")) <= before + 1  # which may have been on its way


def test_closing_says_goodbye(server):
    FrankaArm(server=server.address).close()
    wait_until(lambda: len(server.calls("goodbye")) == 1)


def test_a_closed_arm_says_so(arm):
    arm.close()
    with pytest.raises(FrankaArmCommException, match="closed"):
        arm.get_joints()


def test_a_silent_server_fails_what_waits_and_is_found_again(server, arm, monkeypatch):
    server.skill_time = 30
    arm.goto_joints(HOME, 1, block=False)
    server.silent = True
    with monkeypatch.context() as impatient, pytest.raises(FrankaArmCommException, match="not answered"):
        impatient.setattr(channel, "SILENCE", 1.0)
        arm.wait_for_skill()
    server.silent = False
    server.skill_time = 0.05
    arm.goto_joints(HOME, 1)


def test_a_server_that_forgot_this_client_is_greeted_again(server, arm):
    server.forgets_clients = True
    arm.goto_joints(HOME, 1)
    assert len(server.calls("hello")) == 2


def test_a_motion_without_an_answer_is_not_sent_twice(server, arm, impatient):
    server.silent = True
    with pytest.raises(FrankaArmCommException):
        arm.goto_joints(HOME, 1, ignore_virtual_walls=True)
    wait_until(lambda: server.calls("start_skill"))
    assert len(server.calls("start_skill")) == 1


def test_a_server_that_ends_fails_what_waits_at_once():
    with ScriptedServer(skill_time=30) as server:
        arm = FrankaArm(server=server.address)
        arm.goto_joints(HOME, 1, block=False)
    with pytest.raises(FrankaArmCommException, match="has ended"):  # and not: has not answered for 3 s
        arm.wait_for_skill()
    with pytest.raises(FrankaArmCommException, match="frankapy sim"):
        arm.goto_joints(HOME, 1)
    arm.close()


def test_what_is_lost_with_its_server_writes_into_no_file_that_was_opened_since():
    with ScriptedServer() as server:
        arm = FrankaArm(server=server.address)
    lost = arm._connection._channel
    lost._thread.join()
    pairs = [socket.socketpair() for _ in range(20)]  # take the numbers that are free
    ends = [end for pair in pairs for end in pair]
    arm.close()
    assert not select.select(ends, [], [], 0)[0]
    for end in ends:
        end.close()


def test_a_channel_that_nobody_has_leaves_no_files_open(server):
    def open_files():
        return len(os.listdir("/proc/self/fd"))

    FrankaArm(server=server.address).close()
    before = open_files()
    for _ in range(5):
        FrankaArm(server=server.address).close()
    wait_until(lambda: gc.collect() >= 0 and open_files() <= before)


def test_many_threads_may_read(arm):
    failures = []

    def read():
        for _ in range(50):
            if list(arm.get_joints()) != HOME:
                failures.append("wrong joints")

    threads = [threading.Thread(target=read) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures


def in_child(check) -> int:
    """Return with which status a forked child ends: 0 when `check` returned True."""
    child = os.fork()
    if child == 0:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(100)
        try:
            os._exit(0 if check() else 1)
        finally:
            os._exit(2)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def test_a_forked_child_makes_a_connection_of_its_own(server, arm):
    arm.get_joints()
    assert in_child(lambda: list(arm.get_joints()) == HOME) == 0
    assert len(server.calls("hello")) == 2
    assert list(arm.get_joints()) == HOME


def test_a_forked_child_waits_for_no_thread_of_its_parent(server, arm):
    server.withholds = {"skill_started"}
    thread = threading.Thread(target=arm.goto_joints, args=(HOME, 1))
    thread.start()
    wait_until(lambda: server.calls("start_skill"))

    def check() -> bool:
        arm._connection.start(proto.Request(check_skill=proto.CheckSkill()))
        return True

    assert in_child(check) == 0
    server.withholds = set()
    thread.join()


def test_a_forked_child_may_wait_for_the_motion_of_its_parent(server, arm):
    server.skill_time = 30
    arm.goto_joints(HOME, 1, block=False)

    def check() -> bool:
        if arm.is_skill_done():
            return False
        arm.stop_skill()
        return arm.is_skill_done() and arm.last_skill_result.ending == proto.TERMINATED

    assert in_child(check) == 0
    arm.wait_for_skill()


def test_a_forked_child_is_told_who_knows_of_the_hand(server, arm):
    server.gripper_time = 30
    arm.open_gripper(block=False)

    def check() -> bool:
        with pytest.raises(FrankaArmCommException, match="before the program forked"):
            arm.wait_for_gripper()
        return arm.is_gripper_skill_done()

    assert in_child(check) == 0
    arm.stop_gripper()


INTERRUPTED = """
import signal, sys, time
from frankapy import FrankaArm, channel
channel.SILENCE = 60  # s: a computer may stand still
arm = FrankaArm(server=sys.argv[1])
{first}
try:
    arm.{call}
    print('returned', flush=True)
    time.sleep(60)
except KeyboardInterrupt:
    print('interrupted', arm.is_skill_done(), flush=True)
except SystemExit:
    print('left', flush=True)
    raise
"""
IN_A_LOOP = """
import asyncio, sys
from frankapy import FrankaArm, channel
channel.SILENCE = 60
async def main():
    arm = FrankaArm(server=sys.argv[1])
    {first}
    arm.{call}
    print('returned', flush=True)
    await asyncio.sleep(60)
try:
    asyncio.run(main())
except KeyboardInterrupt:
    print('interrupted', flush=True)
"""
SIGNALS = [(signal.SIGINT, "interrupted", 0), (signal.SIGHUP, "left", 128 + signal.SIGHUP)]


@pytest.fixture
def script(server):
    """Give a function which starts a script that makes one call of an arm."""
    children = []

    def start(call, first="", program=INTERRUPTED):
        command = [sys.executable, "-c", program.format(call=call, first=first), server.address]
        children.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        return children[-1]

    yield start
    for child in children:
        child.kill()
        child.communicate()


def wait_until_sent(child, server, call, block):
    """Wait until a script has made its call, or, where that does not block, has gone on from it."""
    if block:
        wait_until(lambda: server.calls(call))
    else:
        assert child.stdout.readline() == "returned\n"


@pytest.mark.parametrize(("number", "word", "status"), SIGNALS, ids=["Ctrl-C", "SIGHUP"])
@pytest.mark.parametrize("block", [True, False])
def test_a_signal_stops_the_skill(server, script, block, number, word, status):
    server.skill_time = 60
    child = script(f"goto_joints({HOME}, 1, block={block})")
    wait_until_sent(child, server, "start_skill", block)
    child.send_signal(number)
    output, _ = child.communicate(timeout=300)
    assert word in output
    assert child.returncode == status
    assert server.calls("stop_skill")


@pytest.mark.parametrize(("number", "word", "status"), SIGNALS, ids=["Ctrl-C", "SIGHUP"])
@pytest.mark.parametrize("block", [True, False])
def test_a_signal_stops_a_skill_that_has_not_been_confirmed_yet(server, script, block, number, word, status):
    server.skill_time = 60
    server.withholds = {"skill_started"}
    child = script(f"goto_joints({HOME}, 1, block={block})")
    wait_until(lambda: server.calls("start_skill"))
    child.send_signal(number)
    wait_until(lambda: server.calls("stop_skill"))
    server.withholds = set()
    output, _ = child.communicate(timeout=300)
    assert word in output
    assert child.returncode == status


NOTEBOOK = "signal.signal(signal.SIGINT, signal.default_int_handler)"  # each of its cells begins so


@pytest.mark.parametrize(
    ("block", "how"),
    [(True, {"program": IN_A_LOOP}), (False, {"program": IN_A_LOOP}), (False, {"first": NOTEBOOK})],
    ids=["coroutine waits", "coroutine", "notebook"],
)
def test_ctrl_c_stops_a_skill_where_a_framework_has_its_own_handler(server, script, block, how):
    server.skill_time = 60
    child = script(f"goto_joints({HOME}, 1, block={block})", **how)
    wait_until_sent(child, server, "start_skill", block)
    child.send_signal(signal.SIGINT)
    output, _ = child.communicate(timeout=300)
    assert "interrupted" in output
    assert server.calls("stop_skill")


def test_a_handler_of_the_scripts_own_stops_a_skill_that_has_not_been_confirmed_yet(server, script):
    server.skill_time = 60
    server.withholds = {"skill_started"}
    own = "def own(*_): raise KeyboardInterrupt\nsignal.signal(signal.SIGINT, own)"
    child = script(f"goto_joints({HOME}, 1)", first=own)
    wait_until(lambda: server.calls("start_skill"))
    child.send_signal(signal.SIGINT)
    wait_until(lambda: server.calls("stop_skill"))
    server.withholds = set()
    output, _ = child.communicate(timeout=300)
    assert "interrupted" in output


@pytest.mark.parametrize("call", ["recover()", f"goto_joints({HOME}, 1)"])
def test_a_signal_stops_what_moves_the_arm_to_recover_it(server, script, call):
    server.recovers, server.phase = False, proto.ERROR
    error = proto.Error(code=proto.Error.NOT_READY, message="the arm is in error")
    server.refusals = [error]
    child = script(call, first="arm.recovery = 'itself'")
    wait_until(lambda: server.calls("recover"))
    child.send_signal(signal.SIGINT)
    wait_until(lambda: server.calls("stop_skill"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP], ids=["Ctrl-C", "SIGHUP"])
@pytest.mark.parametrize("block", [True, False])
def test_a_signal_stops_the_hand(server, script, block, number):
    server.gripper_time = 60
    child = script(f"close_gripper(block={block})")
    wait_until_sent(child, server, "gripper", block)
    child.send_signal(number)
    child.communicate(timeout=300)
    assert server.calls("gripper")[-1].gripper.HasField("stop")


def test_a_signal_lets_the_hand_hold_what_it_has(server, script):
    child = script("close_gripper(block=True)")
    assert child.stdout.readline() == "returned\n"
    child.send_signal(signal.SIGINT)
    child.communicate(timeout=300)
    assert len(server.calls("gripper")) == 1


def test_programs_that_tests_start_end_with_them():
    asks = "import ctypes; n = ctypes.c_int(); ctypes.CDLL(None).prctl(2, ctypes.byref(n)); print(n.value)"
    done = subprocess.run([sys.executable, "-c", asks], capture_output=True, text=True, check=True)
    assert int(done.stdout) == signal.SIGTERM


def test_a_hang_up_that_is_ignored_stays_so(server):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with FrankaArm(server=server.address):
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_of_two_threads_that_start_a_motion_one_is_refused_as_documented(server, arm):
    server.skill_time = 30
    server.withholds = {"skill_started"}
    refused = []

    def start():
        try:
            arm.goto_joints(HOME, 1, block=False)
        except Exception as error:
            refused.append(error)

    threads = [threading.Thread(target=start) for _ in range(2)]
    threads[0].start()
    wait_until(lambda: server.calls("start_skill"))
    threads[1].start()
    threads[1].join(0.2)  # however far it comes
    server.withholds = set()
    for thread in threads:
        thread.join()
    assert [type(error) for error in refused] == [FrankaArmArgumentError]
    assert "previous skill is active" in refused[0].message
    assert len(server.calls("start_skill")) == 1
    arm.stop_skill()


def test_threads_whose_skills_the_server_builds_wait_for_each_other_and_for_no_motion(server, arm):
    server.skill_time = 30
    server.withholds = {"skill_started"}
    threads = [
        threading.Thread(target=lambda: arm.goto_joints(HOME, 1, block=False)),
        threading.Thread(target=lambda: arm.check(proto.StayJoint())),
    ]
    threads[0].start()
    wait_until(lambda: server.calls("start_skill"))
    threads[1].start()
    threads[1].join(0.2)  # however far it comes
    assert not server.calls("check_skill")
    assert list(arm.get_joints()) == HOME
    server.withholds = set()
    for thread in threads:
        thread.join()
    assert len(server.calls("check_skill")) == 1 and not arm.is_skill_done()
    arm.stop_skill()


LOST = {
    "motion": (lambda arm: arm.goto_joints(HOME, 1, block=False), lambda arm: arm.is_skill_done()),
    "hand": (lambda arm: arm.open_gripper(block=False), lambda arm: arm.is_gripper_skill_done()),
}


@pytest.mark.parametrize("what", LOST)
def test_what_was_lost_with_its_server_is_told_once(what):
    start, is_done = LOST[what]
    with ScriptedServer(skill_time=30) as server:
        server.gripper_time = 30
        arm = FrankaArm(server=server.address)
        start(arm)

    def told():
        try:
            return is_done(arm)
        except FrankaArmCommException:
            return True

    wait_until(told)
    with ScriptedServer(port=int(server.address.rpartition(":")[2])) as server:
        assert is_done(arm)
        start(arm)
        wait_until(lambda: is_done(arm))
        arm.goto_joints(HOME, 1)
        arm.close()


def test_status_names_what_of_the_robot_was_not_taken(server, capsys):
    assert cli.main(["status", "--server", server.address]) == 0
    assert "not taken" not in capsys.readouterr().out
    server.not_taken = proto.NotTaken(bad_values=12, unsent=3)
    assert cli.main(["status", "--server", server.address]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "not taken 12 states with values that are no numbers, or unknown modes, 3 commands that the network did not take" in told


def test_status_tells_who_commands_and_what_came_over_topics(server, capsys):
    counts = {"received": 40, "lost": 3, "late": 2, "stale": 1, "refused": 5, "why_refused": "joint 1 is 9"}
    server.topics = [proto.Topics.Topic(topic="policy", message="JointChunk", age=0.04, period=0.1, skills=[7], **counts)]
    assert cli.main(["status", "--server", server.address]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "commanded by somebody" in told
    assert "policy: JointChunk, 10.0 Hz, 0.0 s old; 40 received, 3 lost, 2 late, 1 stale, 5 refused; skill 7 listens" in told
    assert "refused last: joint 1 is 9" in told


def test_a_read_whose_server_ended_asks_the_next_one(monkeypatch):
    monkeypatch.setattr(connection, "_END_TIME", 1.0)  # s: nobody says how a server ended that scripts make
    joints = []
    with ScriptedServer() as server:
        arm = FrankaArm(server=server.address)
        asked = len(server.calls("get_state"))
        server.silent = True
        reader = threading.Thread(target=lambda: joints.extend(arm.get_joints()))
        reader.start()
        wait_until(lambda: len(server.calls("get_state")) > asked)
    with ScriptedServer(port=int(server.address.rpartition(":")[2])):
        reader.join()
        assert joints == HOME
        arm.close()


@pytest.fixture
def sensors():
    """Give two sockets to which sensor messages come."""
    with zmq.Context() as context, context.socket(zmq.PULL) as one, context.socket(zmq.PULL) as other:
        for each in (one, other):
            each.linger = 0
            each.bind("tcp://127.0.0.1:*")
        yield one, other


def publish_joints(arm):
    message = proto.JointPositionSensorMessage(id=1, timestamp=0, joints=HOME)
    packed = proto_utils.sensor_proto2ros_msg(message, SensorDataMessageType.JOINT_POSITION)
    arm.publish_sensor_values(proto_utils.make_sensor_group_msg(packed))


def publisher_heard_at(sensors) -> int:
    assert sensors.poll(10_000)
    return proto.SensorMessage.FromString(sensors.recv()).publisher


def test_what_is_published_goes_to_the_server_that_there_is(sensors):
    old, new = sensors
    with ScriptedServer() as server:
        server.sensor_endpoint = old.last_endpoint.decode()
        arm = FrankaArm(server=server.address)
        for _ in range(2):
            publish_joints(arm)
        assert publisher_heard_at(old) == publisher_heard_at(old)
        old.close()
    wait_until(lambda: arm._connection._channel.lost)
    with ScriptedServer(port=int(server.address.rpartition(":")[2])) as server:
        server.sensor_endpoint = new.last_endpoint.decode()
        wait_until(lambda: publish_joints(arm) or new.poll(10))  # that the old one is gone is known a moment later
        assert publisher_heard_at(new)
        arm.close()


def test_a_forked_child_publishes_over_a_socket_of_its_own(server, sensors):
    server.sensor_endpoint = sensors[0].last_endpoint.decode()
    with FrankaArm(server=server.address) as arm:
        publish_joints(arm)
        own = publisher_heard_at(sensors[0])

        def check() -> bool:
            publish_joints(arm)
            arm._sensors.close()
            return True

        assert in_child(check) == 0
        assert publisher_heard_at(sensors[0]) != own
        publish_joints(arm)
        assert publisher_heard_at(sensors[0]) == own


@pytest.mark.nightly
def test_a_slow_reader_loses_what_comes_while_too_many_wait():
    waiting, count = 10_000, 60_000  # more than wait at both ends and in the operating system between them
    with zmq.Context() as context, context.socket(zmq.XPUB) as publisher:
        publisher.sndhwm, publisher.linger = waiting, 0
        publisher.bind("tcp://127.0.0.1:*")
        with StateStream(publisher.last_endpoint.decode(), timeout=5) as stream:
            topic = publisher.recv()[1:]
            for i in range(count):
                publisher.send(topic + proto.ArmState(skill_id=i + 1, skill_description="x" * 1000).SerializeToString())
            received = [state.skill_id for state in stream]
    assert received[:waiting] == list(range(1, waiting + 1))
    assert received == sorted(set(received))
    assert len(received) < count


def test_each_read_of_the_newest_state_gives_a_message_of_its_own(monkeypatch):
    monkeypatch.setattr(states, "_NEW", 60.0)
    with zmq.Context() as context, context.socket(zmq.XPUB) as publisher:
        publisher.linger = 0
        publisher.bind("tcp://127.0.0.1:*")
        newest = NewestState(publisher.last_endpoint.decode())
        publisher.send(publisher.recv()[1:] + proto.ArmState(skill_id=1).SerializeToString())
        wait_until(newest.read)
        first = newest.read()
        first.age = 0.5
        assert not newest.read().HasField("age") and newest.read().skill_id == 1
        monkeypatch.setattr(states, "_NEW", 0.0)
        assert newest.read() is None  # no more come
        newest.close()


@pytest.mark.parametrize("stderr", [None, object()], ids=["none", "what has no isatty"])
def test_a_program_without_a_standard_error_shows_no_bar(stderr, monkeypatch):
    monkeypatch.setattr(sys, "stderr", stderr)
    with progress(10, "moving", unit="s") as bar:
        bar.update(1)
    assert bar.n == 0


def test_errors_name_what_python_calls_what_is_to_be_done(server, arm, monkeypatch):
    monkeypatch.setattr(connection, "_LEASE_TIME", 0)
    server.refusals = [refusal(proto.Error.NOT_READY, "the user stop is pressed: release it, then recover")]
    with pytest.raises(FrankaArmException, match=r"fa\.recover\(\)"):
        arm.goto_joints(HOME, 1, ignore_errors=False)
    server.refusals = [refusal(proto.Error.BUSY, "skill 3 still runs: wait for it, preempt it or queue behind it")]
    with pytest.raises(FrankaArmBusyException, match=r"fa\.run\(\.\.\., preempt=True\)"):
        arm.goto_joints(HOME, 1)
    server.result = {"ending": proto.ROBOT_ERROR, "message": "clear what caused it, then recover"}
    with pytest.raises(FrankaArmException, match=r"fa\.recover\(\)"):
        arm.goto_joints(HOME, 1, ignore_errors=False)


def test_a_text_that_is_too_long_is_refused_and_the_connection_stays(server, arm):
    with pytest.raises(FrankaArmArgumentError, match="skill_desc has 4500000 bytes: expected at most 1000"):
        arm.goto_joints(HOME, 1, skill_desc="x" * 4_500_000)
    long = proto.Skill(description="x" * (9 << 20))
    with pytest.raises(FrankaArmArgumentError, match="start_skill has .* bytes: expected at most"):
        arm._connection.ask(proto.Request(start_skill=proto.StartSkill(skill=long)))
    arm.goto_joints(HOME, 1)
    assert len(server.calls("hello")) == 1


JUNK = [
    10**400, "1", b"1", None, object(), np.array([1, 2]), np.zeros((7, 7)), 1j, [1j] * 7, ["0"] * 7, [10**400] * 7, {}, {1},
    np.ma.array(np.zeros(7), mask=[1] + [0] * 6), np.nan, -1, np.datetime64("2020-01-01"), len, [], [[]], [None] * 6, "\ud800",
]  # fmt: skip
GOOD = {
    "joints": HOME, "joint_velocities": [0.1] * 7, "joint_accelerations": [1] * 7, "cartesian_velocities": [0.1] * 6,
    "cartesian_accelerations": [1] * 6, "joint_torques": [0] * 7, "torques": [0] * 7, "run_duration": 1, "acc_duration": 0.2,
    "max_translation": 0, "max_rotation": 0, "forces": [0, 0, 1], "duration": 1, "goal_quat": [1, 0, 0, 0], "width": 0.04,
    "goal_quat_time": 0.5, "box": [1] * 9, "message": "", "topic": "t", "speed": 0.5, "blend": 0.1, "near": HOME,
}  # fmt: skip
POSE = RigidTransform(np.diag([1.0, -1, -1]), [0.4, 0, 0.4], "franka_tool", "world")
GOOD |= {"tool_pose": POSE, "delta_tool_pose": RigidTransform(from_frame="world", to_frame="world")}
GOOD |= {"tool_delta_pose": RigidTransform(from_frame="franka_tool", to_frame="franka_tool_base")}
DMP = {"tau": 1, "alpha": 60, "beta": 15, "num_basis": 1, "num_sensors": 1, "mu": [1], "h": [1]}
GOOD |= {f"{kind}_dmp_info": DMP | {"weights": [0] * n} for kind, n in [("joint", 7), ("pose", 6), ("position", 3), ("quat", 3)]}
GOOD |= {"trajectory": proto.StayJoint(), "condition": bool}
GOOD |= {"primitive": dmp.Primitive("joint", 1, HOME, np.ones(2), np.ones(2), np.zeros((7, 1, 2)))}
TAKES_ANYTHING = {"log_info", "get_speed", "publish_sensor_data", "publish_sensor_values"}  # or hands it on
METHODS = [
    name
    for name, method in inspect.getmembers(FrankaArm, inspect.isfunction)
    if not name.startswith("_")
    and name not in TAKES_ANYTHING
    and not inspect.iscoroutinefunction(inspect.unwrap(method))
    and len(inspect.signature(method).parameters) > 1
]


@pytest.mark.parametrize("name", METHODS)
def test_whatever_is_given_what_is_raised_is_of_frankapy(name):
    arm = FrankaArm(offline=True)
    method = getattr(arm, name)
    parameters = inspect.signature(method).parameters
    good = {each: GOOD[each] for each, p in parameters.items() if p.default is p.empty and p.kind is not p.VAR_KEYWORD}
    for parameter in parameters:
        for junk in JUNK:
            try:
                method(**good | {parameter: junk})
            except FrankaArmException:
                pass
            except Exception as error:
                pytest.fail(f"{name}({parameter}={str(junk)[:60]!r}) raises {error!r}")


@pytest.mark.parametrize("what", ["robot_num", "server"])
def test_whatever_it_is_made_with_what_is_raised_is_of_frankapy(what):
    for junk in JUNK[:-1]:
        if junk is not None:
            with pytest.raises(FrankaArmException):
                FrankaArm(**{what: junk})


def test_a_bad_flag_is_refused_before_anything_moves(server, arm):
    for flag in ("block", "ignore_errors"):
        with pytest.raises(FrankaArmArgumentError, match=f"{flag} is array.*expected True or False"):
            arm.goto_joints(HOME, 1, **{flag: np.array([1, 2])})
    with pytest.raises(FrankaArmArgumentError, match="block is array"):
        arm.open_gripper(block=np.array([1, 2]))
    assert not server.calls("start_skill") and not server.calls("gripper")


def test_a_thread_may_make_an_arm(server):
    joints = []

    def make():
        with FrankaArm(server=server.address) as arm:
            joints.extend(arm.get_joints())

    thread = threading.Thread(target=make)
    thread.start()
    thread.join()
    assert joints == HOME


def test_a_handler_of_the_script_stays(server):
    def handler(signum, frame):
        pass

    before = signal.signal(signal.SIGINT, handler)
    try:
        with FrankaArm(server=server.address):
            assert signal.getsignal(signal.SIGINT) is handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_sequence_does_not_wait_for_what_failed_before_it(server, arm, caplog):
    server.result = {"ending": proto.CANCELLED}
    arm.goto_joints(HOME, 1, block=False)
    wait_until(lambda: server._results)
    server.result = {"ending": proto.TERMINATED}
    with arm.sequence():
        arm.goto_joints(HOME, 1)
    assert [request.start_skill.after for request in server.calls("start_skill")] == [0, 0]
    assert "CANCELLED" in caplog.text


@pytest.mark.parametrize("tool", [(0, 0, 0), (0.02, -0.01, 0.2)])
def test_its_own_kinematics_are_of_the_tool_that_the_robot_has(server, arm, tool):
    server.tool = tool

    def place(q):
        return arm.get_links_transforms(q, use_rigid_transforms=True)[-1].translation

    numeric = np.transpose([(place(HOME + e) - place(HOME - e)) / 2e-6 for e in 1e-6 * np.eye(7)])
    np.testing.assert_allclose(arm.get_jacobian(HOME)[:3], numeric, atol=1e-6)
    flange = arm.get_links_transforms(HOME)[8]
    np.testing.assert_allclose(np.linalg.inv(flange) @ [*place(HOME), 1], [*tool, 1], atol=1e-9)
    state = proto.ArmState(robot=arm.get_arm_state().robot)
    state.robot.dq.extend([0.1] * 7)
    state.robot.O_T_EE_d.extend(state.robot.O_T_EE)
    np.testing.assert_allclose(as_dictionary(state)["cartesian_velocities"][:3], numeric @ np.full(7, 0.1), atol=1e-6)


def test_parts_that_are_none_are_refused_in_a_change_too(server, arm):
    server.skill_time = 60
    arm.goto_joints(HOME, 1, block=False)
    for change in (dict(trajectory=7), dict(controller="stiff"), dict(until=[5])):
        with pytest.raises(FrankaArmArgumentError, match="expected a part of a skill"):
            arm.change(**change)
    arm.stop_skill()


def test_a_limit_that_is_misspelt_is_refused(arm):
    with pytest.raises(AttributeError, match="max_velocity"):
        arm.limits.max_velocity = 0.1


def test_a_line_for_people_is_seen(capsys):
    FrankaArm(offline=True).log_info("put the block down")
    assert "put the block down" in capsys.readouterr().out


@pytest.mark.parametrize("for_ever", [1e8, 1e9, 1e12])
@pytest.mark.parametrize(
    "move",
    [
        lambda arm, for_ever: arm.goto_joints(HOME, 3, dynamic=True, buffer_time=for_ever),
        lambda arm, for_ever: arm.goto_joints(HOME, 3, buffer_time=for_ever),
        lambda arm, for_ever: arm.run_guide_mode(for_ever),
        lambda arm, for_ever: arm.selective_guidance_mode(for_ever),
        lambda arm, for_ever: arm.selective_guidance_mode(for_ever, use_joints=True),
        lambda arm, for_ever: arm.execute_joint_torques([0] * 7, duration=for_ever),
    ],
    ids=["stream", "goal", "guided", "held", "joints held", "torques"],
)
def test_numbers_that_mean_for_ever_are_taken(move, for_ever):
    move(FrankaArm(offline=True), for_ever)


@pytest.mark.parametrize("kind", ["joint", "cartesian"])
def test_velocities_that_are_published_are_followed_in_their_own_time(server, arm, kind):
    arm.speed = 0.2
    zeros = [0] * (7 if kind == "joint" else 6)
    for dynamic, speed in ((False, 0.2), (True, 1)):
        getattr(arm, f"execute_{kind}_velocities")(zeros, zeros, dynamic=dynamic)
        assert server.calls("start_skill")[-1].start_skill.skill.speed == speed


def test_an_offline_arm_checks_and_moves_nothing(caplog):
    arm = FrankaArm(offline=True)
    assert list(arm.get_joints()) == [0] * 7
    assert (arm.get_pose().matrix == arm.get_pose(include_tool_offset=False).matrix).all()
    assert len(arm.get_robot_state()) == 11
    arm.goto_joints(HOME)
    arm.close_gripper()
    arm.stop_skill()
    assert "offline" in caplog.text
    with pytest.raises(ValueError):
        arm.goto_joints([9] * 7)
