"""What the client finds in the way: the workspace's walls, with the arm's boxes and the tool; no arm."""

import numpy as np
import pytest
from conftest import HOME

from frankapy import FrankaArm, FrankaArmArgumentError, FrankaConstants, RigidTransform, kinematics

WALLS = FrankaConstants.WORKSPACE_WALLS
DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture
def fa():
    return FrankaArm(offline=True)


def tool(x=0.0, y=0.0, z=0.0):
    return RigidTransform(translation=[x, y, z], from_frame="franka_tool", to_frame="franka_tool_base")


def pose(x, y, z):
    return RigidTransform(DOWN, [x, y, z], "franka_tool", "world")


def wall(*box):
    return np.array([box], dtype=float)


def is_refused(fa, joints) -> bool:
    try:
        fa.goto_joints(joints)
    except FrankaArmArgumentError as error:
        assert "virtual walls" in error.message
        return True
    return False


def random_joints(count):
    draw = np.random.default_rng(5).uniform(0.02, 0.98, (count, 7))
    return FrankaConstants.JOINT_LIMITS_MIN + draw * (FrankaConstants.JOINT_LIMITS_MAX - FrankaConstants.JOINT_LIMITS_MIN)


def test_home_is_before_all_walls(fa):
    fa.goto_joints(HOME)
    fa.goto_pose(FrankaConstants.HOME_POSE)


def test_joints_at_which_a_box_of_the_arm_meets_a_wall_are_refused(fa):
    met = [joints for joints in random_joints(50) if fa.is_joints_in_collision_with_boxes(joints)]
    assert len(met) > 10
    assert all(is_refused(fa, joints) for joints in met)
    for joints in met:
        fa.goto_joints(joints, ignore_virtual_walls=True)


def test_links_are_more_than_their_origins(fa):
    lower, upper = np.array([-0.41, -0.46, -0.05]), np.array([0.75, 0.46, 1.0])
    inside = [
        joints
        for joints in random_joints(400)
        if np.all((lower < (origins := kinematics.link_frames(joints)[1:, :3, 3])) & (origins < upper))
    ]
    assert any(is_refused(fa, joints) for joints in inside)
    assert not all(is_refused(fa, joints) for joints in inside)


def test_what_is_behind_a_wall_without_meeting_it_is_refused(fa, monkeypatch):
    monkeypatch.setattr(FrankaConstants, "WORKSPACE_WALLS", wall(0.2, 0, 0.1, 0, 0, 0, 0.001, 0.001, 0.001))
    assert not fa.is_joints_in_collision_with_boxes(HOME)
    assert is_refused(fa, HOME)


def test_a_tool_is_seen(fa):
    fa.set_tool_delta_pose(tool(z=0.6))
    with pytest.raises(FrankaArmArgumentError, match="goto_joints would bring the tool to z = -0.113 m, and one of the virtual walls"):
        fa.goto_joints(HOME)
    with pytest.raises(FrankaArmArgumentError, match="goto_pose would bring the tool to z = -0.100 m.*at -0.05 m"):
        fa.goto_pose(pose(0.3, 0, -0.1))
    fa.set_tool_delta_pose(tool(y=0.4))
    with pytest.raises(FrankaArmArgumentError, match="goto_pose would bring the tool base to y = 0.700 m"):
        fa.goto_pose(pose(0.3, 0.3, 0.4))


def test_the_rotation_of_a_wall_counts(fa, monkeypatch):
    # Through (0.5, 0, 0) at 45 degrees: x + y < 0.5 is free.
    monkeypatch.setattr(FrankaConstants, "WORKSPACE_WALLS", wall(0.5, 0, 0.5, 0, 0, np.pi / 4, 0.01, 2, 2))
    fa.goto_pose(pose(0.3, 0.15, 0.4))
    fa.goto_pose(pose(0.6, -0.15, 0.4))
    with pytest.raises(FrankaArmArgumentError, match=r"\[0.300, 0.250, 0.400\] m, 0.035 m behind .*virtual walls.*WALLS\[0\]"):
        fa.goto_pose(pose(0.3, 0.25, 0.4))
    assert not is_refused(fa, HOME - [0.7, 0, 0, 0, 0, 0, 0])
    assert is_refused(fa, HOME + [0.7, 0, 0, 0, 0, 0, 0])


def test_one_wall_alone_parts_space_in_two(fa, monkeypatch):
    monkeypatch.setattr(FrankaConstants, "WORKSPACE_WALLS", WALLS[3:4])
    fa.goto_pose(pose(-1, 0.9, 1.5))
    with pytest.raises(FrankaArmArgumentError, match="x = 0.750 m"):
        fa.goto_pose(pose(0.75, 0, 0.4))
