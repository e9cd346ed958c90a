"""Laws that exert forces: what the arm then does to a plate, a hand, and itself, judged by the truth of the physics."""

import numpy as np
import pytest
from conftest import HOME, starting

from frankapy import FrankaArmArgumentError, proto
from frankapy.parts import (
    Admittance,
    CartesianImpedance,
    ForceAxisImpedance,
    HybridForcePosition,
    JointImpedance,
    MinJerkJoint,
    MinJerkPose,
    PassThrough,
    PassThroughJointTorque,
    RelativeMinJerkPose,
    StayJoint,
    StayPose,
    Time,
)

TRUTH_FILE = True
DOWN = [0, 0, 1, 0, 0, 0]


@pytest.fixture(scope="module", params=["fer", "fr3"])
def at_plate(request, tmp_path_factory):
    with starting(request, tmp_path_factory) as start:
        arm = start(robot=request.param, scene="plate")
        arm.simulation.set_friction("plate", 0.1)  # of something smooth; hard fingertips chatter on anything else
        yield arm


def above_plate(fa, height=0.02):
    """Bring the fingertips above the plate, whose top is at 0.2 m."""
    fa.run(MinJerkJoint(HOME, 1.5))
    goal = fa.get_pose(include_tool_offset=False)
    goal.translation = [0.48, -0.05, 0.2 + height]
    fa.run(MinJerkPose(goal, 2), CartesianImpedance(1500, 100))


def smooth(force, cycles=20):
    """Return the mean over so many cycles, as sensors with a bandwidth of some 20 Hz would have it."""
    return np.convolve(force, np.full(cycles, 1 / cycles), mode="valid")


def at_end(result):
    """Return where the tool was in the last cycle of a skill; a push may go on for longer than that."""
    return np.array(result.last_state.robot.O_T_EE[12:15])


def test_hybrid_control_comes_to_a_plate_gently_and_presses_while_it_wipes(at_plate):
    with at_plate.client() as fa:
        above_plate(fa)
        press = HybridForcePosition(DOWN, [0, 0, -10, 0, 0, 0])
        began = at_plate.cycle()
        with fa.states() as states:
            result = fa.run(StayPose(3.5), press)
            estimate = []
            for state in states:
                if state.skill_id == result.skill_id:
                    estimate.append(state.robot.O_F_ext_hat_K[2])
                elif estimate:
                    break
        assert result.ending == proto.TERMINATED, result.message
        rows = at_plate.truth(since=began)
        force = rows["contact_wrench"][:, 2]
        touched = np.argmax(force > 0.5)
        assert touched > 1000, "it began in the air, from which it comes slowly"
        assert smooth(force).max() < 12
        assert -np.min(estimate) < 12
        # What is estimated is held; in truth friction of the joints is in it.
        assert np.mean(estimate[-500:]) == pytest.approx(-10, abs=0.3)
        # A motion beside it, from contact on.
        with fa.sequence() as results, at_plate.standing_still():
            fa.run(StayPose(1), press)
            fa.run(RelativeMinJerkPose([0.02, 0.1, 0], frame="base", duration=2), press)
        assert [result.ending for result in results] == [proto.TERMINATED] * 2, results[-1].message
        rows = at_plate.truth(since=began)
        rows = rows[rows["moving"] > 0][-2000:]
        force = smooth(rows["contact_wrench"][:, 2])
        assert force.mean() == pytest.approx(10, abs=1)
        assert np.sqrt(np.mean((force - 10) ** 2)) < 2
        assert np.ptp(rows["O_T_TCP"][:, 13]) == pytest.approx(0.1, abs=0.01)


def test_an_admittance_lets_the_arm_be_led_and_one_with_a_spring_holds_against_it(ideal_arm):
    with ideal_arm.client() as fa:
        for stiffness, seconds, there in ((0, 1, 0.045), (400, 3, 5 / 400)):
            fa.run(MinJerkJoint(HOME, 1))
            began = ideal_arm.simulation.truth().O_T_TCP[:3, 3]
            ideal_arm.simulation.push([0, 5, 0, 0, 0, 0], duration=3600)
            try:
                result = fa.run(StayPose(seconds), Admittance(stiffness=[stiffness] * 3 + [stiffness / 10] * 3))
            finally:
                ideal_arm.simulation.push([0] * 6, duration=0)
            moved = at_end(result) - began
            assert moved[1] == pytest.approx(there, abs=0.01)
            assert np.abs(moved[[0, 2]]).max() < 0.01


def test_forces_move_the_arm_along_them_until_it_has_gone_far_enough(ideal_arm):
    with ideal_arm.client() as fa:
        for apply in (
            lambda force: fa.apply_effector_forces_torques(1, 0.2, 0.03, 0.3, forces=force),
            lambda force: fa.apply_effector_forces_along_axis(1, 0.2, 0.03, force),
        ):
            fa.run(MinJerkJoint(HOME, 1))
            began = ideal_arm.simulation.truth().O_T_TCP[:3, 3]
            apply([0, 6, 0])
            moved = ideal_arm.simulation.truth().O_T_TCP[:3, 3] - began
            assert fa.last_skill_result.termination == "Time"
            assert 0.02 < moved[1] < 0.06
            assert np.abs(moved[[0, 2]]).max() < 0.02


def test_across_its_axis_the_arm_is_held_and_along_it_free(ideal_arm):
    with ideal_arm.client() as fa:
        for law, aside in ((ForceAxisImpedance("y"), 0.02), (PassThrough(), 0.2)):
            fa.run(MinJerkJoint(HOME, 1))
            began = ideal_arm.simulation.truth().O_T_TCP[:3, 3]
            ideal_arm.simulation.push([3, 3, 0, 0, 0, 0], duration=3600)
            try:
                result = fa.run(StayPose(0.5), law)
            finally:
                ideal_arm.simulation.push([0] * 6, duration=0)
            assert result.ending == proto.TERMINATED, result.message
            moved = np.abs(at_end(result) - began)
            assert moved[1] > 0.04
            assert moved[0] < aside


def test_joint_torques_move_their_joint_and_hold_the_others(ideal_arm):
    with ideal_arm.client() as fa:
        fa.goto_joints(HOME, 1)
        fa.execute_joint_torques([0, 0, 0, 0, 0, 0, 0.2], selection=[0] * 6 + [1], duration=0.4, buffer_time=0)
        assert fa.last_skill_result.ending == proto.TERMINATED
        moved = ideal_arm.simulation.truth().q - HOME
        assert moved[6] > 0.1
        assert np.abs(moved[:6]).max() < 0.01
        # An arm whose elbow feels gravity falls; one that does not stays.
        for heavy in (0, 1):
            fa.goto_joints(HOME, 1)
            fa.execute_joint_torques([0] * 7, [0, 0, 0, 1, 0, 0, 0], [0, 0, 0, heavy, 0, 0, 0], 0.3, buffer_time=0)
            fallen = abs(ideal_arm.simulation.truth().q[3] - HOME[3])
            assert (fallen > 0.1) == bool(heavy), fallen
        for wrong, says in (
            ({"joint_torques": [1] * 6}, "joint_torques has 6"),
            ({"selection": [2] * 7}, r"selection\[0\] is 2"),
            ({"remove_gravity": [-1] * 7}, r"remove_gravity\[0\] is -1"),
            ({"k_gains": [9e9] * 7}, r"stiffness\[0\] is"),
        ):
            with pytest.raises(FrankaArmArgumentError, match=says):
                fa.execute_joint_torques(**({"joint_torques": [0] * 7} | wrong))


def test_an_integral_brings_joints_to_their_reference_in_spite_of_a_load(default_arm):
    ends = []
    with default_arm.client() as fa:
        for rate in (0, 4):
            fa.run(MinJerkJoint(HOME, 1.5))
            default_arm.simulation.push([0, 0, -5, 0, 0, 0], duration=3600)
            fa.run(MinJerkJoint(HOME + 0.2, 1.5), JointImpedance(integral_rate=rate), Time(after_trajectory=1.5))
            ends.append(np.abs(default_arm.simulation.truth().q - HOME - 0.2).max())
            default_arm.simulation.push([0] * 6, duration=0)
    assert ends[0] > 2 * ends[1]
    assert ends[1] < 1e-3


def test_gains_that_a_loop_cannot_hold_are_refused(ideal_arm):
    with ideal_arm.client() as fa:
        for law, says in [
            (JointImpedance(damping=200), r"damping\[\d\] is 200"),
            (JointImpedance(stiffness=3000, damping=0.1), r"stiffness\[0\] is 3000"),
            (HybridForcePosition([0.5] + [0] * 5), r"force_axes\[0\] is 0.5"),
        ]:
            part = StayPose(1) if isinstance(law, proto.HybridForcePosition) else StayJoint(1)
            with pytest.raises(FrankaArmArgumentError, match=says):
                fa.run(part, law)
        assert fa.run(StayJoint(0.1), PassThroughJointTorque()).ending == proto.TERMINATED
