"""The client towards a server that misbehaves, and its own bookkeeping; no arm."""

import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from scripted_server import HOME, ScriptedServer

from frankapy import (
    FrankaArm,
    FrankaArmArgumentError,
    FrankaArmBusyException,
    FrankaArmCommException,
    FrankaArmException,
    FrankaArmFrankaInterfaceNotReadyException,
    connection,
    proto,
)
from frankapy.sim import free_address


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
    monkeypatch.setattr(connection, "_SILENCE", 1.0)


def wait_until(condition):
    deadline = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def refusal(code, message="no"):
    return proto.Error(code=code, message=message)


def test_without_a_server_the_error_says_how_to_get_one():
    with pytest.raises(FrankaArmCommException, match="frankapy sim"):
        FrankaArm(server=f"{free_address()}:5757")


@pytest.mark.parametrize("name", ["127.0.0.1:x", ":5757", "127.0.0.1:0", "127.0.0.1:70000"])
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
def test_a_refusal_raises_its_exception_with_the_servers_text(server, arm, code, exception):
    server.refusals = [refusal(code, "the reason")]
    with pytest.raises(exception, match="the reason"):
        arm.goto_joints(HOME, 1)
    arm.goto_joints(HOME, 1)


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
    server.phase = proto.ERROR
    with caplog.at_level(logging.WARNING, "frankapy"):
        arm.goto_joints(HOME, 1)
    assert "cartesian_reflex" in caplog.text
    assert len(server.calls("recover")) == 1


def test_is_skill_done_raises_when_errors_are_not_ignored(server, arm):
    server.result = {"ending": proto.REFUSED, "message": "the robot refused"}
    arm.goto_joints(HOME, 1, block=False)
    with pytest.raises(FrankaArmException, match="the robot refused"):
        while not arm.is_skill_done(ignore_errors=False):
            time.sleep(0.005)
    assert arm.is_skill_done()


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


def test_a_reading_client_is_quiet(server, arm):
    arm.get_joints()
    time.sleep(0.5)
    assert len(server.calls("alive")) <= 1


def test_closing_says_goodbye(server):
    FrankaArm(server=server.address).close()
    wait_until(lambda: len(server.calls("goodbye")) == 1)


def test_a_closed_arm_says_so(arm):
    arm.close()
    with pytest.raises(FrankaArmCommException, match="closed"):
        arm.get_joints()


def test_a_silent_server_fails_what_waits_and_is_found_again(server, arm, impatient):
    server.skill_time = 30
    arm.goto_joints(HOME, 1, block=False)
    server.silent = True
    with pytest.raises(FrankaArmCommException, match="not answered"):
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
        arm.goto_joints(HOME, 1)
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


def test_a_forked_child_makes_a_connection_of_its_own(server, arm):
    arm.get_joints()
    child = os.fork()
    if child == 0:
        try:
            os._exit(0 if list(arm.get_joints()) == HOME else 1)
        finally:
            os._exit(2)
    assert os.waitpid(child, 0) == (child, 0)
    assert len(server.calls("hello")) == 2
    assert list(arm.get_joints()) == HOME


INTERRUPTED = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests run in the background
from frankapy import FrankaArm
arm = FrankaArm(server=sys.argv[1])
try:
    arm.goto_joints({home}, 1, block={block})
    print('started', flush=True)
    time.sleep(30)
except KeyboardInterrupt:
    print('interrupted', arm.is_skill_done(), flush=True)
"""


@pytest.mark.parametrize("block", [True, False])
def test_ctrl_c_stops_the_skill(server, block):
    server.skill_time = 30
    script = INTERRUPTED.format(home=HOME, block=block)
    child = subprocess.Popen([sys.executable, "-c", script, server.address], stdout=subprocess.PIPE, text=True)
    wait_until(lambda: server.calls("start_skill"))
    if block:
        time.sleep(0.3)  # it waits in the call, mostly; what is asked for below holds in any case
    else:
        assert child.stdout.readline() == "started\n"
    child.send_signal(signal.SIGINT)
    output, _ = child.communicate(timeout=60)
    assert "interrupted" in output
    assert child.returncode == 0
    assert server.calls("stop_skill")
    if block:
        assert "interrupted True" in output


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
