"""Laws of this package's own RigidTransform."""

import numpy as np
import pytest

from frankapy import RigidTransform, utils

rng = np.random.default_rng(4)


def random_transform(from_frame="a", to_frame="b"):
    q = rng.normal(size=4)
    return RigidTransform(
        RigidTransform.rotation_from_quaternion(q / np.linalg.norm(q)), rng.normal(size=3), from_frame, to_frame
    )


def test_a_product_is_the_product_of_the_matrices_and_joins_the_frames():
    for _ in range(50):
        a, b = random_transform("b", "c"), random_transform("a", "b")
        product = a * b
        np.testing.assert_allclose(product.matrix, a.matrix @ b.matrix, atol=1e-12)
        assert (product.from_frame, product.to_frame) == ("a", "c")


def test_frames_that_do_not_meet_are_refused():
    with pytest.raises(ValueError):
        random_transform("a", "b") * random_transform("a", "b")


def test_the_inverse_undoes():
    for _ in range(50):
        a = random_transform()
        product = a * a.inverse()
        np.testing.assert_allclose(product.matrix, np.eye(4), atol=1e-12)
        assert (product.from_frame, product.to_frame) == ("b", "b")


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0, -0.8]])
@pytest.mark.parametrize("angle", [0, 1e-9, 1, np.pi / 2, np.pi - 1e-9, np.pi, 4])
def test_quaternion_and_matrix_are_the_same_rotation(axis, angle):
    rotation = RigidTransform.rotation_from_axis_angle(np.array(axis) * angle)
    q = RigidTransform(rotation, np.zeros(3)).quaternion
    assert np.linalg.norm(q) == pytest.approx(1)
    np.testing.assert_allclose(RigidTransform.rotation_from_quaternion(q), rotation, atol=1e-12)
    # Rodrigues: what the axis is turned to, and what stands upright on it
    np.testing.assert_allclose(rotation @ axis, axis, atol=1e-12)
    assert np.trace(rotation) == pytest.approx(1 + 2 * np.cos(angle))


def test_rotations_about_axes_turn_right_handed():
    np.testing.assert_allclose(RigidTransform.x_axis_rotation(np.pi / 2) @ [0, 1, 0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(RigidTransform.y_axis_rotation(np.pi / 2) @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(RigidTransform.z_axis_rotation(np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_euler_angles_are_about_the_fixed_axes():
    for roll, pitch, yaw in [(0.3, -0.4, 1.2), (-3, 1.5, 3), (0.2, np.pi / 2, 0), (0.2, -np.pi / 2, 0), (0, 0, 0)]:
        rotation = (
            RigidTransform.z_axis_rotation(yaw)
            @ RigidTransform.y_axis_rotation(pitch)
            @ RigidTransform.x_axis_rotation(roll)
        )
        angles = RigidTransform(rotation, np.zeros(3)).euler_angles
        again = (
            RigidTransform.z_axis_rotation(angles[2])
            @ RigidTransform.y_axis_rotation(angles[1])
            @ RigidTransform.x_axis_rotation(angles[0])
        )
        np.testing.assert_allclose(again, rotation, atol=1e-7)


def test_a_copy_is_independent_and_float():
    original = RigidTransform(np.eye(3, dtype=np.float32), [1, 2, 3])
    copy = original.copy()
    copy.translation[2] -= 0.5
    copy.rotation[:] = RigidTransform.x_axis_rotation(1)
    assert original.translation[2] == 3
    np.testing.assert_array_equal(original.rotation, np.eye(3))
    assert copy.translation.dtype == copy.rotation.dtype == np.float64


def test_the_array_given_stays_the_callers():
    translation = np.zeros(3)
    pose = RigidTransform(np.eye(3), translation)
    pose.translation[0] = 1
    assert translation[0] == 0


@pytest.mark.parametrize(
    "rotation", [np.eye(3) * 1.1, np.diag([1, 1, -1]), np.full((3, 3), np.nan), np.eye(4), [1, 1, 0, 0], np.eye(2)]
)
def test_what_is_no_rotation_is_refused(rotation):
    with pytest.raises(ValueError):
        RigidTransform(rotation, np.zeros(3))


def test_interpolation_goes_straight_and_evenly_the_short_way():
    a, b = random_transform(), random_transform()
    np.testing.assert_allclose(a.interpolate_with(b, 0).matrix, a.matrix, atol=1e-9)
    np.testing.assert_allclose(a.interpolate_with(b, 1).matrix, b.matrix, atol=1e-9)
    poses = a.linear_trajectory_to(b, 11)
    assert len(poses) == 11
    steps = [p.rotation.T @ n.rotation for p, n in zip(poses, poses[1:])]
    angles = [np.arccos(np.clip((np.trace(step) - 1) / 2, -1, 1)) for step in steps]
    np.testing.assert_allclose(angles, np.mean(angles), atol=1e-6)
    whole = np.arccos(np.clip((np.trace(a.rotation.T @ b.rotation) - 1) / 2, -1, 1))
    assert sum(angles) == pytest.approx(whole, abs=1e-6)


def test_many_products_stay_rotations():
    pose, step = random_transform("a", "a"), random_transform("a", "a")
    for _ in range(2000):
        pose = pose * step
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)


def test_arrays_and_poses_turn_into_each_other():
    pose = random_transform("franka_tool", "world")
    array = utils.convert_rigid_transform_to_array(pose)
    assert array[3] == pose.translation[0]
    again = utils.convert_array_to_rigid_transform(array)
    np.testing.assert_array_equal(again.matrix, pose.matrix)
    column_major = utils.transform_to_list(pose)
    assert column_major[12] == pose.translation[0]
    np.testing.assert_allclose(utils.franka_pose_to_rigid_transform(column_major).matrix, pose.matrix)
    with pytest.raises(ValueError):
        utils.convert_array_to_rigid_transform(np.zeros((4, 4)))


def test_minimum_jerk_rests_at_both_ends():
    t = np.linspace(0, 2, 2001)
    x = utils.min_jerk(1.0, 3.0, t, 2.0)
    assert (x[0], x[-1]) == (1.0, 3.0)
    delta = utils.min_jerk_delta(1.0, 3.0, t, 2.0, 0.001)
    np.testing.assert_allclose(delta[1:-1], (x[2:] - x[:-2]) / 2, atol=1e-8)
    assert delta[0] == delta[-1] == 0
    assert utils.min_jerk_weight(1, 2) == 0.5
