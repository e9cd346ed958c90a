"""Errors of the robot, user stops and lost connections: who brings the arm back, in which order, and what is told of it."""

import contextlib
import logging
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import HOME, server_processes

from frankapy import (
    FrankaArm,
    FrankaArmArgumentError,
    FrankaArmException,
    FrankaArmFrankaInterfaceNotReadyException,
    cli,
    connection,
    proto,
)
from frankapy.parts import JointImpedance, MinJerkJoint, RelativeMinJerkJoint
from frankapy.recording import Recording
from frankapy.sim import SimulatedArm, Simulation, program

LONG = 1000  # s
STEP = [0.1, 0, 0, 0, 0, 0, 0]
ERROR = "joint_velocity_violation"  # that the lab lets an arm recover from by itself
ITSELF, ASK, NEVER = proto.RecoveryPolicy.ITSELF, proto.RecoveryPolicy.ASK, proto.RecoveryPolicy.NEVER


@pytest.fixture(scope="module")
def sim(tmp_path_factory):
    with Simulation(SimulatedArm(lockstep=True, ideal=True), recordings=tmp_path_factory.mktemp("recordings")) as simulation:
        yield simulation


@pytest.fixture
def fa(sim):
    sim.guide(False)
    sim.user_stop(False)
    with FrankaArm(server=sim.server) as fa:
        until(lambda: fa.get_arm_state().robot.robot_mode not in (proto.USER_STOPPED, proto.GUIDING))
        fa.recover()
        fa.goto_joints(HOME, 0.5)
        yield fa


def until(condition, timeout=60):
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def fail(sim, fa, error=ERROR, **how):
    """Raise an error in the middle of a skill; return its result."""
    fa.run(RelativeMinJerkJoint(STEP, LONG), block=False, **how)
    fa.wait_for(lambda state: state.phase == proto.RUNNING and state.skill_time > 0.05, timeout=60)
    if error == "user stop":
        sim.user_stop()
    else:
        sim.inject(error)
    return fa._motions.running.result()


def test_the_published_methods_recover_and_warn(sim, fa, caplog):
    fa.goto_joints(np.array(HOME) + 0.2, LONG, block=False)
    fa.wait_for(lambda state: state.phase == proto.RUNNING, timeout=60)
    sim.inject(ERROR)
    with caplog.at_level(logging.WARNING, "frankapy"):
        fa.wait_for_skill()
    assert ERROR in caplog.text and "it has recovered by itself" in caplog.text
    recovery = fa.last_skill_result.recovery
    assert recovery.recovered and recovery.by_itself and recovery.in_a_row == 1 and recovery.time > 0
    fa.goto_joints(HOME, 0.5, ignore_errors=False)


def test_run_raises_and_leaves_the_arm_to_a_person(sim, fa):
    fa.run(RelativeMinJerkJoint(STEP, LONG), block=False)
    fa.wait_for(lambda state: state.phase == proto.RUNNING and state.skill_time > 0.05, timeout=60)
    sim.inject(ERROR)
    with pytest.raises(FrankaArmException, match=ERROR) as failed:
        while not fa.is_skill_done(ignore_errors=False):
            time.sleep(0.01)
    result = failed.value.result
    assert result.ending == proto.ROBOT_ERROR and list(result.errors) == [ERROR]
    assert result.recovery == failed.value.recovery and result.recovery.obstacle == proto.IN_REFLEX
    assert result.recovery.who == ASK
    with pytest.raises(FrankaArmFrankaInterfaceNotReadyException, match=r"fa\.recover\(\)"):
        fa.run(RelativeMinJerkJoint(STEP, 0.1))
    recovery = fa.recover()
    assert recovery.recovered and not recovery.by_itself
    assert fa.run(RelativeMinJerkJoint(STEP, 0.5)).ending == proto.TERMINATED


def test_a_skill_says_how_often_in_a_row_the_arm_recovers_by_itself(sim, fa):
    for n in (1, 2):
        recovery = fail(sim, fa, recover=2).recovery
        assert recovery.recovered and recovery.in_a_row == n
    recovery = fail(sim, fa, recover=2).recovery
    assert not recovery.recovered and recovery.who == ASK and "2 times in a row" in recovery.message
    fa.wait_for_skill()
    fa.recover()
    assert fail(sim, fa, recover=1).recovery.recovered


def test_never_is_for_people_at_the_robot(sim, fa):
    recovery = fail(sim, fa, recover="never").recovery
    assert not recovery.recovered and recovery.who == NEVER
    fa.wait_for_skill()
    for ask in (fa.recover, fa.wait_for_franka_interface):
        with pytest.raises(FrankaArmFrankaInterfaceNotReadyException, match="the skill leaves it to people at the robot"):
            ask()
    sim.user_stop()  # which clears it, as does Desk
    until(lambda: fa.get_arm_state().robot.robot_mode == proto.USER_STOPPED)
    sim.user_stop(False)
    until(lambda: fa.get_arm_state().robot.robot_mode == proto.IDLE)
    assert fa.recover().recovered


@pytest.mark.parametrize("error", ["cartesian_reflex", "joint_reflex", "self_collision_avoidance_violation"])
def test_from_a_collision_nothing_recovers_by_itself(sim, fa, error, monkeypatch):
    monkeypatch.setattr(connection, "_LEASE_TIME", 0)  # a client that is held up for as long loses the arm
    fa.recovery = "itself"
    recovery = fail(sim, fa, error).recovery
    assert not recovery.recovered and recovery.who == ASK and recovery.obstacle == proto.IN_REFLEX
    with pytest.raises(FrankaArmFrankaInterfaceNotReadyException, match="look at the arm"):
        fa.goto_joints(HOME, 0.5)
    with pytest.raises(FrankaArmFrankaInterfaceNotReadyException, match="look at the arm"):
        fa.wait_for_franka_interface()
    assert cli.main(["recover", "--server", sim.server]) == 1  # another client has the arm
    fa.recover()
    fa.goto_joints(HOME, 0.5, ignore_errors=False)


def test_the_command_recovers_an_arm_that_nobody_commands(sim, fa, capsys):
    fail(sim, fa)
    fa.close()
    assert cli.main(["recover", "--server", sim.server]) == 0
    assert "the arm is ready after" in capsys.readouterr().out


def test_a_user_stop_is_told_and_waits_for_its_release_and_a_person(sim, fa, capsys):
    result = fail(sim, fa, "user stop", recover="itself")
    assert result.ending == proto.ROBOT_ERROR and not result.errors
    assert result.last_state.robot.robot_mode == proto.USER_STOPPED
    assert result.recovery.obstacle == proto.STOPPED_BY_USER
    assert result.black_box, "its own, or that of an error just before"
    fa.wait_for_skill()
    with pytest.raises(FrankaArmFrankaInterfaceNotReadyException, match="release the user stop") as refused:
        fa.recover()
    assert refused.value.recovery.obstacle == proto.STOPPED_BY_USER
    sim.user_stop(False)
    until(lambda: fa.get_arm_state().robot.robot_mode == proto.IDLE)
    assert fa.get_arm_state().phase == proto.ERROR
    with pytest.raises(FrankaArmFrankaInterfaceNotReadyException, match="the user stop|look at the arm"):
        fa.goto_joints(HOME, 0.5)
    assert fa.recover().recovered
    fa.goto_joints(HOME, 0.5, ignore_errors=False)


def test_guiding_comes_before_the_user_stop(sim, fa):
    fail(sim, fa, "user stop")
    fa.wait_for_skill()
    obstacles = []
    for hand in (True, False):
        mode = proto.GUIDING if hand else proto.USER_STOPPED
        # The buttons act once the arm stands.
        until(lambda hand=hand, mode=mode: sim.guide(hand) or fa.get_arm_state().robot.robot_mode == mode)
        with pytest.raises(FrankaArmFrankaInterfaceNotReadyException) as refused:
            fa.recover()
        obstacles.append(refused.value.recovery.obstacle)
    assert obstacles == [proto.HELD_BY_HAND, proto.STOPPED_BY_USER]


def test_the_lab_may_allow_more_or_less():
    lab = {"errors": "never", "collisions": "itself", "user_stop": "itself", "times": 1}
    with Simulation(SimulatedArm(lockstep=True, ideal=True), settings={"recovery": lab}) as sim, FrankaArm(server=sim.server) as fa:
        recovery = fail(sim, fa, "joint_reflex", recover="itself").recovery
        assert recovery.recovered and recovery.by_itself
        assert not fail(sim, fa, "joint_reflex", recover="itself").recovery.recovered  # twice
        fa.wait_for_skill()
        fa.recover()
        fail(sim, fa, "user stop")
        fa.wait_for_skill()
        sim.user_stop(False)
        fa.goto_joints(HOME, 0.5)  # which recovers the arm
        assert fa.last_skill_result.ending == proto.TERMINATED
        recovery = fail(sim, fa, recover="itself").recovery
        assert not recovery.recovered and recovery.who == NEVER
        fa.wait_for_skill()
        with pytest.raises(FrankaArmFrankaInterfaceNotReadyException, match="arm.recovery.errors"):
            fa.recover()


def test_a_result_names_the_place_and_the_file_with_what_was_before(sim, fa):
    result = fail(sim, fa)
    assert len(result.last_state.robot.q) == 7 and len(result.last_state.robot.O_T_EE) == 16
    assert 0.05 < result.path_time <= result.time
    assert ERROR in result.black_box
    recording = None

    def complete():
        nonlocal recording
        with contextlib.suppress(FrankaArmException, OSError):
            recording = Recording(result.black_box)
        return recording is not None and recording.complete

    until(complete)
    assert recording.errors[-1][1] == ERROR
    moving = recording.states["skill_id"] == result.skill_id
    assert moving.sum() >= 50


def test_late_commands_are_counted_and_recovered_from(sim, fa):
    fa.recovery = "itself"
    fa.run(RelativeMinJerkJoint(STEP, LONG), block=False)
    fa.wait_for(lambda state: state.phase == proto.RUNNING and state.skill_time > 0.2, timeout=60)
    sim.network(loss_in=1.0)
    result = fa._motions.running.result()
    sim.network()
    assert list(result.errors) == ["communication_constraints_violation"]
    assert result.black_box, "its own, or that of an error just before"
    assert 15 <= result.lost_commands <= 40 and f"of the last 100 commands {result.lost_commands})" in result.message
    assert result.recovery.recovered and result.recovery.by_itself


def test_joints_that_are_outside_their_range_are_moved_back(start):
    """A hand leads a joint to just beyond its limit, where the robot still lets a motion begin."""
    arm = start(ideal=True, robot="fer")
    with arm.client() as fa:
        most = fa._server.welcome.limits.q_max[6]
        near = np.array(HOME)
        near[6] = most - 0.002
        fa.goto_joints(near, 3, ignore_errors=False)
        sim = arm.simulation
        sim.user_stop()
        until(lambda: sim.guide() or fa.get_arm_state().robot.robot_mode == proto.GUIDING)
        sim.pause()
        sim.push([0, 0, 0, *(0.05 * sim.truth().O_T_TCP[:3, 2])], duration=60)
        while sim.truth().q[6] < most + 0.003:
            sim.step(5)
        sim.push([0] * 6, duration=0.001)
        sim.resume()
        sim.guide(False)
        sim.user_stop(False)
        until(lambda: fa.get_arm_state().robot.robot_mode == proto.IDLE)
        assert sim.truth().q[6] > most
        recovery = fa.recover()
        assert list(recovery.moved_back) == [7]
        assert most - 0.01 < sim.truth().q[6] < most
        fa.goto_joints(HOME, 3, ignore_errors=False)


def test_an_arm_that_reboots_in_the_middle_of_a_skill_is_there_again():
    with Simulation(SimulatedArm(lockstep=True, ideal=True)) as sim, FrankaArm(server=sim.server) as fa:
        fa.run(MinJerkJoint(np.array(HOME) + 0.2, LONG), block=False)
        fa.wait_for(lambda state: state.phase == proto.RUNNING and state.skill_time > 0.05, timeout=60)
        os.kill(sim.processes[0], signal.SIGKILL)
        result = fa._motions.running.result()
        assert result.ending == proto.CONNECTION_LOST and "connection-lost" in result.black_box
        fa.wait_for_skill()
        with pytest.raises(FrankaArmFrankaInterfaceNotReadyException, match="connection to the robot|refused"):
            fa.recover()
        command = [program("fci-sim"), "--listen", sim.addresses[0], "--lockstep", "--ideal"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as rebooted:
            try:
                fa.wait_for_franka_interface(60)
                assert fa.recover().recovered
                assert fa.run(MinJerkJoint(HOME, 1)).ending == proto.TERMINATED
            finally:
                rebooted.kill()


def test_the_result_of_a_client_that_was_killed_says_so(sim, fa):
    script = (
        "import sys, time; from frankapy import FrankaArm; from frankapy.parts import RelativeMinJerkJoint\n"
        "fa = FrankaArm(server=sys.argv[1]); fa.run(RelativeMinJerkJoint([0.01] * 7, 3600), block=False)\n"
        "print(fa._motions.running.id, flush=True); time.sleep(1000)"
    )
    fa.close()
    with subprocess.Popen([sys.executable, "-c", script, sim.server], stdout=subprocess.PIPE, text=True) as victim:
        skill = int(victim.stdout.readline())
        victim.kill()
    with FrankaArm(server=sim.server) as other:

        def result():
            reply = other._server.ask(proto.Request(skill_status=proto.SkillStatus(skill_id=skill)))
            return reply.skill_result if reply.HasField("skill_result") else None

        until(lambda: other.server_status().commander == "")
        other.stop_skill()
        until(lambda: result() is not None)
        assert result().ending == proto.STOPPED and result().client_is_gone and "a-client-is-gone" in result().black_box


@pytest.mark.parametrize("word", ["sometimes", 0, 1001, -1, 1.5, True, ["ask"]])
def test_what_is_no_policy_is_refused_by_name(sim, fa, word):
    with pytest.raises(FrankaArmArgumentError, match="recover is"):
        fa.run(RelativeMinJerkJoint(STEP, 0.1), JointImpedance(), recover=word)
    with pytest.raises(FrankaArmArgumentError, match="recover is"):
        fa.recovery = word
    assert fa.recovery is None


def test_the_process_that_crashes_leaves_an_arm_that_recovers(sim, fa):
    fa.run(RelativeMinJerkJoint(STEP, LONG), block=False)
    fa.wait_for(lambda state: state.phase == proto.RUNNING, timeout=60)
    os.kill(server_processes(sim)[1], signal.SIGKILL)
    with pytest.raises(FrankaArmException):
        fa.run(RelativeMinJerkJoint(STEP, 0.1), preempt=True)
        fa.wait_for_skill()
    with contextlib.suppress(FrankaArmException):
        fa.wait_for_skill()
    fa.wait_for_franka_interface(60)
    fa.goto_joints(HOME, 0.5, ignore_errors=False)
