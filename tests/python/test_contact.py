"""What the arm does when it touches something: it is noticed at once, ends the skill softly, and no reflex is needed."""

import numpy as np
import pytest
from conftest import HOME, starting

from frankapy import FrankaArmArgumentError, FrankaArmException, proto
from frankapy.parts import (
    AllOf,
    BackOff,
    CartesianImpedance,
    CartesianVelocity,
    Comply,
    Contact,
    HybridForcePosition,
    InternalImpedance,
    JointImpedance,
    MinJerkJoint,
    MinJerkPose,
    StayJoint,
    StayPose,
    Time,
)
from frankapy.walls import Plane

TRUTH_FILE = True
TOP = 0.2  # m, of the plate
SOFTLY = [15, 15, 4, 5, 5, 5]  # N, N m
DOWN = CartesianVelocity([0, 0, -0.1, 0, 0, 0], duration=0.8)


@pytest.fixture(scope="module", params=["fer", "fr3"])
def at_plate(request, tmp_path_factory):
    with starting(request, tmp_path_factory) as start:
        yield start(robot=request.param, scene="sprung_plate", hold_time=600)  # as it has ended, until it is looked at


def above_plate(fa):
    fa.run(MinJerkJoint(HOME, 1.5))
    goal = fa.get_pose(include_tool_offset=False)
    goal.translation = [0.5, 0, TOP + 0.04]
    fa.run(MinJerkPose(goal, 1.5), CartesianImpedance(1500, 100))


def land(arm, fa, law, then=None, estimate="observer"):
    """Come down on the plate; return the result, the skill's states, and what truly happened up to its end."""
    above_plate(fa)
    began = arm.cycle()
    until = [Contact(force_thresholds=SOFTLY, estimate=estimate, then=then), Time(2)]
    with fa.states() as states:
        result = fa.run(DOWN, law, until)
        mine = []
        for state in states:
            if state.skill_id == result.skill_id:
                mine.append(state)
            elif mine:
                break
    assert result.ending == proto.TERMINATED and result.termination == "Contact", result
    rows = arm.truth(since=began)
    return result, mine, rows[rows["cycle"] <= arm.cycle(result.last_state.robot.message_id)]


@pytest.mark.parametrize("law", [CartesianImpedance(), InternalImpedance()], ids=["torque", "motion"])
def test_it_backs_off_as_far_as_it_was_told_and_is_noticed_in_the_cycle_of_its_threshold(at_plate, law):
    with at_plate.client() as fa:
        result, states, rows = land(at_plate, fa, law, BackOff(0.02))
        assert result.after_contact == proto.BACKED_OFF
        noticed = next(n for n, state in enumerate(states) if np.any(np.abs(state.O_F_ext_observed) > SOFTLY))
        assert states[noticed - 1].phase == proto.RUNNING and states[noticed].phase == proto.BRAKING
        height = rows["O_T_TCP"][:, 14]
        at_contact = height[rows["cycle"] == at_plate.cycle(states[noticed].robot.message_id)][0]
        assert height[-1] - at_contact == pytest.approx(0.02, abs=0.004)
        assert result.backed_off == pytest.approx(height[-1] - at_contact, abs=0.001)
        assert np.abs(rows["O_T_TCP"][-1, 12:14] - rows["O_T_TCP"][0, 12:14]).max() < 0.004, "straight"
        assert rows["contact_wrench"][:, 2].max() < 60 and rows["contact_wrench"][-1, 2] == 0


def test_what_holds_presses_no_longer(at_plate):
    with at_plate.client() as fa:
        for estimate in ("observer", "robot"):
            result, _, rows = land(at_plate, fa, CartesianImpedance(), estimate=estimate)
            assert result.after_contact == proto.HELD and not result.HasField("backed_off")
            began = at_plate.cycle(result.last_state.robot.message_id)
            fa.run(StayPose(0.3), CartesianImpedance())
            force = at_plate.truth(since=began)["contact_wrench"][:, 2]
            assert force[-100:].mean() < 4, estimate


def test_an_arm_that_complies_can_be_pushed_away_and_one_that_holds_can_not(at_plate):
    moved = {}
    with at_plate.client() as fa:
        for then in (None, Comply()):
            result, _, _ = land(at_plate, fa, CartesianImpedance(), then)
            assert result.after_contact == (proto.COMPLIED if then else proto.HELD)
            with at_plate.standing_still():
                began = at_plate.simulation.truth().O_T_TCP[:3, 3]
                at_plate.simulation.push([0, 8, 0, 0, 0, 0], duration=1)
                at_plate.simulation.step(900)
                moved[then is None] = at_plate.simulation.truth().O_T_TCP[1, 3] - began[1]
    assert moved[False] > 0.05 and moved[True] < 0.02


def test_a_push_while_it_stays_is_gone_along_with(ideal_arm):
    with ideal_arm.client() as fa:
        for law, stay in ((JointImpedance(), StayJoint(3600)), (InternalImpedance(), StayPose(3600))):
            fa.run(MinJerkJoint(HOME, 1))
            began = ideal_arm.simulation.truth().O_T_TCP[:3, 3]
            fa.run(stay, law, Contact(estimate="observer", then=BackOff(0.03)), block=False)
            ideal_arm.simulation.push([0, 20, 0, 0, 0, 0], duration=0.1)
            fa.wait_for_skill()
            result = fa.last_skill_result
            assert result.termination == "Contact" and result.after_contact == proto.BACKED_OFF, result
            moved = np.array(result.last_state.robot.O_T_EE[12:15]) - began
            assert moved[1] == pytest.approx(0.03, abs=0.01) and np.abs(moved[[0, 2]]).max() < 0.01


def test_the_observer_finds_what_pushes_in_any_controller_and_calls_it_a_collision(ideal_arm):
    with ideal_arm.client() as fa:
        for law in (JointImpedance(), InternalImpedance()):
            fa.run(MinJerkJoint(HOME, 1), law)
            fa.run(StayJoint(3600), law, block=False)
            ideal_arm.simulation.push([0, 15, 0, 0, 0, 0], duration=3600)
            try:
                state = fa.wait_for(lambda state: state.collision, timeout=60)
                assert np.any(np.abs(state.tau_ext_observed) > [5, 5, 5, 5, 3, 3, 3])
            finally:
                ideal_arm.simulation.push([0] * 6, duration=0)
            state = fa.wait_for(lambda state: not state.collision and np.abs(state.tau_ext_observed).max() < 0.5, timeout=60)
            fa.stop_skill()


@pytest.mark.parametrize("law", [JointImpedance(), InternalImpedance()], ids=["torque", "robot"])
def test_the_way_back_ends_at_a_wall(ideal_arm, law):
    with ideal_arm.client() as fa:
        fa.run(MinJerkJoint(HOME, 1))
        beside = fa.get_pose(include_tool_offset=False).translation[1] + 0.127  # the hand is 0.127 m from its middle to its side
        fa.walls["beside"] = Plane([0, -1, 0], [0, beside + 0.04, 0])
        try:
            fa.run(StayJoint(3600), law, Contact(estimate="observer", then=BackOff(0.1)), block=False)
            ideal_arm.simulation.push([0, 20, 0, 0, 0, 0], duration=0.05)
            fa.wait_for_skill()
        finally:
            del fa.walls["beside"]
        result = fa.last_skill_result
        assert result.after_contact == proto.BACKED_OFF and result.held_by & proto.WALL, result
        assert 0.01 < result.backed_off < 0.05, "and not on to where it was told to"


def test_it_can_be_stopped_while_it_backs_off(at_plate):
    with at_plate.client() as fa:
        above_plate(fa)
        until = Contact(force_thresholds=SOFTLY, estimate="observer", then=BackOff(0.1, speed=0.001))
        fa.run(DOWN, CartesianImpedance(), until, block=False)
        fa.wait_for(lambda state: state.phase == proto.BRAKING, timeout=60)
        fa.stop_skill()
        fa.wait_for_skill()
        result = fa.last_skill_result
        assert result.termination == "Contact" and result.backed_off < 0.09
        fa.run(MinJerkJoint(HOME, 1.5))


def test_what_cannot_be_is_refused_with_words(fa):
    with pytest.raises(FrankaArmArgumentError, match=r"Contact.then is .*: expected Comply or BackOff"):
        Contact(then=Time(1))
    with pytest.raises(FrankaArmArgumentError, match=r"BackOff.distance"):
        BackOff()
    with pytest.raises(FrankaArmException, match="use TORQUE, or BackOff"):
        fa.run(MinJerkJoint(HOME, 1), InternalImpedance(), Contact(then=Comply()))
    with pytest.raises(FrankaArmException, match="does not lead all of the arm"):
        fa.run(StayPose(1), HybridForcePosition([0, 0, 1, 0, 0, 0], [0, 0, -5, 0, 0, 0]), Contact(then=BackOff(0.01)))
    with pytest.raises(FrankaArmException, match="only where it ends the skill by itself"):
        fa.run(MinJerkJoint(HOME, 1), until=AllOf(Contact(then=BackOff(0.01)), Time(1)))
