"""Several clients, stops, polling, and what reaches the server's ports from strangers."""

import gc
import os
import random
import signal
import socket
import subprocess
import time

import numpy as np
import pytest
import zmq
from conftest import HOME, server_processes
from test_motions import GOAL

from frankapy import (
    FrankaArm,
    FrankaArmArgumentError,
    FrankaArmBusyException,
    FrankaArmCommException,
    FrankaArmException,
    SensorPublisher,
    connection,
    proto,
)
from frankapy.connection import list_arms
from frankapy.parts import InternalImpedance, Never, StreamJoint
from frankapy.sim import SimulatedArm, Simulation, free_address, program
from frankapy.walls import Sphere

LONG = 1000  # s of the robot's clock; in lockstep, many seconds of ours


def is_moving(fa) -> bool:
    return fa.get_arm_state().phase == proto.RUNNING


def wait_until(condition):
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_call_that_does_not_wait_returns_at_once_and_can_be_polled(fa, ideal_arm):
    with ideal_arm.standing_still():
        fa.goto_joints(GOAL, 1, block=False)
        assert not fa.is_skill_done()
    wait_until(fa.is_skill_done)
    np.testing.assert_allclose(fa.get_joints(), GOAL, atol=0.001)


def test_stop_brings_the_arm_to_rest_on_its_way(fa, ideal_arm):
    fa.goto_joints(GOAL, LONG, block=False)
    wait_until(lambda: np.abs(fa.get_joints() - HOME).max() > 1e-4)
    fa.stop_skill()
    assert fa.is_skill_done()
    assert fa.last_skill_result.ending == proto.STOPPED
    truth = ideal_arm.simulation.truth()
    assert np.abs(truth.dq).max() < 0.005
    assert np.abs(truth.q - GOAL).max() > 0.01


def test_stop_with_nothing_to_stop_is_harmless(fa):
    fa.stop_skill()
    fa.goto_joints(GOAL, 1)
    np.testing.assert_allclose(fa.get_joints(), GOAL, atol=0.001)


def test_while_one_client_commands_others_read_and_stop_but_do_not_command(fa, ideal_arm, monkeypatch):
    monkeypatch.setattr(connection, "_LEASE_TIME", 0)  # a client that is held up for as long loses the arm
    with ideal_arm.client() as other:
        fa.goto_joints(GOAL, LONG, block=False)
        assert other.get_joints().shape == (7,)
        with pytest.raises(FrankaArmBusyException, match="another client commands this arm"):
            other.goto_joints(HOME, 1)
        with pytest.raises(FrankaArmBusyException):
            other.open_gripper()
        other.stop_skill()
    fa.wait_for_skill()
    assert fa.last_skill_result.ending == proto.STOPPED


def test_the_next_client_commands_when_one_has_left(ideal_arm):
    with ideal_arm.client() as first:
        first.goto_joints(HOME, 1)
    with ideal_arm.client() as second:
        second.goto_joints(GOAL, 1)
        np.testing.assert_allclose(second.get_joints(), GOAL, atol=0.001)


def test_the_skill_of_a_client_that_left_holds_nobody_up(ideal_arm):
    with ideal_arm.client() as first:
        first.goto_joints(HOME, 1)
        first.goto_joints(GOAL, LONG, block=False)
    with ideal_arm.client() as second:
        wait_until(lambda: is_moving(second))
        second.goto_joints(HOME + 0.1, 1)
        np.testing.assert_allclose(second.get_joints(), HOME + 0.1, atol=0.001)


def test_an_arm_that_the_server_does_not_have_is_refused(ideal_arm):
    with pytest.raises(FrankaArmArgumentError, match="robot_num is 2.*arm1"):
        ideal_arm.client(robot_num=2)


def endpoints(arm) -> list[tuple[str, int]]:
    """Return host and port of everything that the server listens on for clients."""
    with arm.client() as fa:
        found = [arm.server, list_arms(arm.server)[0].endpoint, fa._connection.welcome.state_endpoint]
    pairs = [endpoint.removeprefix("tcp://").rsplit(":", 1) for endpoint in found]
    return [(host, int(port)) for host, port in pairs]


def test_garbage_on_its_ports_disturbs_nobody(ideal_arm):
    noise = random.Random(7)
    with ideal_arm.client() as fa:
        fa.goto_joints(HOME, 1)
        fa.goto_joints(GOAL, 20, block=False)
        for address in endpoints(ideal_arm):
            for size in (0, 1, 11, 64, 100_000):
                with socket.create_connection(address) as stranger:
                    stranger.sendall(noise.randbytes(size))
        fa.wait_for_skill()
        np.testing.assert_allclose(fa.get_joints(), GOAL, atol=0.001)
        fa.goto_joints(HOME, 1)


def test_messages_that_are_no_requests_are_answered_or_dropped(ideal_arm):
    noise = random.Random(8)
    context = zmq.Context()
    for host, port in endpoints(ideal_arm)[:2]:
        dealer = context.socket(zmq.DEALER)
        dealer.linger = 0
        dealer.connect(f"tcp://{host}:{port}")
        dealer.send(b"")
        dealer.send_multipart([b"a", b"b", b"c"])
        for size in (1, 10, 1000, 1_000_000):
            dealer.send(noise.randbytes(size))
        dealer.send(proto.Request(request_id=3).SerializeToString())
        dealer.send(proto.Request(request_id=4, get_state=proto.GetState()).SerializeToString())
        answered = []
        while not {3, 4} <= set(answered):
            assert dealer.poll(30_000)
            reply = proto.Reply.FromString(dealer.recv())
            assert reply.WhichOneof("answer") == "error"
            answered.append(reply.request_id)
        dealer.close()
    context.term()
    with ideal_arm.client() as fa:
        fa.goto_joints(GOAL, 1)
        fa.goto_joints(HOME, 1)


def test_another_version_of_the_interface_is_refused(ideal_arm):
    context = zmq.Context()
    dealer = context.socket(zmq.DEALER)
    dealer.linger = 0
    dealer.connect(list_arms(ideal_arm.server)[0].endpoint)
    for hello in (proto.Hello(), proto.Hello(version=proto.UNSPECIFIED)):
        dealer.send(proto.Request(request_id=1, hello=hello).SerializeToString())
        assert dealer.poll(30_000)
        error = proto.Reply.FromString(dealer.recv()).error
        assert error.code == proto.Error.INCOMPATIBLE_VERSION
        assert "install the same version" in error.message
    dealer.close()
    context.term()


def test_what_is_left_to_the_garbage_collector_closes_in_whatever_order(ideal_arm):
    for _ in range(8):
        fa = ideal_arm.client()
        fa.get_joints(), fa.get_joints(), fa.get_joints()
        cycle = [fa, fa.states(), fa.publisher("left")]
        cycle.append(cycle)
        next(iter(cycle[1]))
        del fa, cycle
        gc.collect()
    with ideal_arm.client() as fa:
        assert len(fa.get_joints()) == 7


def test_a_crash_of_an_arms_process_is_told_and_the_arm_is_back_soon(start):
    arm = start()
    with arm.client() as fa:
        fa.goto_joints(GOAL, LONG, block=False)
        os.kill(server_processes(arm.simulation)[1], signal.SIGKILL)
        with pytest.raises(FrankaArmCommException):
            fa.wait_for_skill()
        fa.wait_for_franka_interface(60)
        fa.goto_joints(HOME, 1)
        np.testing.assert_allclose(fa.get_joints(), HOME, atol=0.002)


@pytest.mark.nightly
def test_a_computer_that_stands_still_for_a_while_makes_nobody_look_as_if_it_hung(start):
    arm = start()
    with arm.client() as fa:
        fa.goto_joints(GOAL, LONG, block=False)
        wait_until(lambda: is_moving(fa))
        starts = list_arms(arm.server)[0].starts
        supervisor, *of_arms = server_processes(arm.simulation)
        simulated = [process for process in arm.simulation.processes if process != supervisor]
        programs = [*simulated, *of_arms, supervisor]  # who looks after others comes last
        for program in reversed(programs):
            os.kill(program, signal.SIGSTOP)
        time.sleep(2)
        for program in programs:
            os.kill(program, signal.SIGCONT)
        time.sleep(1)
        assert is_moving(fa)
        assert list_arms(arm.server)[0].starts == starts
        fa.stop_skill()


def test_a_publisher_finds_a_server_that_was_started_anew_and_so_does_who_waits_for_it(monkeypatch):
    arm = SimulatedArm(lockstep=True, ideal=True, address=free_address())
    with Simulation(arm) as simulation:
        port = int(simulation.server.rpartition(":")[2])
        fa, publisher = FrankaArm(server=simulation.server), SensorPublisher("goal", server=simulation.server)
        publisher.publish(proto.JointPositionSensorMessage(joints=GOAL))
    with pytest.raises(FrankaArmCommException):
        while True:  # that the other end is gone is known a moment later
            publisher.publish(proto.JointPositionSensorMessage(joints=GOAL))
            time.sleep(0.01)
    with monkeypatch.context() as impatient, pytest.raises(FrankaArmCommException):
        impatient.setattr(connection, "_END_TIME", 0.1)
        fa.wait_for_franka_interface(0.1)
    with Simulation(arm, port=port), fa, publisher:
        fa.wait_for_franka_interface(60)
        fa.run(StreamJoint("goal", delay=0, timeout=0), InternalImpedance(), Never(), block=False)
        wait_until(lambda: publisher.publish(proto.JointPositionSensorMessage(joints=GOAL)) or np.abs(fa.get_joints() - GOAL).max() < 0.01)
        fa.stop_skill()


def test_a_robot_that_is_rebooted_is_connected_again_with_its_walls_and_limits():
    with Simulation(SimulatedArm(lockstep=True, ideal=True)) as simulation, FrankaArm(server=simulation.server) as fa:
        fa.walls.add("ball", Sphere(0.1, [0, 2, 0]))
        fa.limits.velocity = 0.2
        fa.goto_joints(GOAL, LONG, block=False)
        wait_until(lambda: is_moving(fa))
        os.kill(simulation.processes[0], signal.SIGKILL)
        fa.wait_for_skill()
        assert fa.last_skill_result.ending == proto.CONNECTION_LOST
        with pytest.raises(FrankaArmException, match=simulation.addresses[0]):
            fa.goto_joints(HOME, 1, ignore_errors=False)
        command = [program("fci-sim"), "--listen", simulation.addresses[0], "--lockstep", "--ideal"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as rebooted:
            try:
                fa.wait_for_franka_interface(60)
                fa.goto_joints(GOAL, 1)
                np.testing.assert_allclose(fa.get_joints(), GOAL, atol=0.002)
                assert list(fa.walls) == ["ball"] and fa.limits.velocity == 0.2
                assert fa.last_skill_result.stretch > 1.2
            finally:
                rebooted.kill()
