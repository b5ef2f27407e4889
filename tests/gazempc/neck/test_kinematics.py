"""Gaze ray and look-at, against chains of scipy rotations."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gazempc.neck.kinematics import (
    angle_deviations_rad,
    eye_angles_rad,
    gaze_error_rad,
    gaze_ray,
    look_at_rad,
    unwrap_pan,
)
from gazempc.neck.spec import Geometry

POINT = Geometry()
OFFSET = Geometry(tilt_axis_in_pan_m=(0.07, -0.03, 0.05), eye_in_tilt_m=(0.04, 0.035, 0.06))


def metres(limit_m):
    """Points on a grid of 0.1 mm, zero included."""
    steps = round(limit_m * 1e4)
    return st.tuples(*[st.integers(-steps, steps).map(lambda i: i * 1e-4)] * 3)


offsets = metres(0.1)
geometries = st.builds(Geometry, tilt_axis_in_pan_m=offsets, eye_in_tilt_m=offsets)


# ---------------------------------------------------------------- eyes and body


def turned(pan_rad, tilt_rad):
    return Rotation.from_euler("ZY", [pan_rad, -tilt_rad])


@pytest.mark.parametrize("joints", [2, 3, 4, 5])
def test_the_gaze_ray_equals_composed_rotations(joints):
    for angles in np.random.default_rng(3).uniform(-0.6, 0.6, (20, joints)):
        pan, tilt = angles[0] + (angles[-1] if joints in (3, 5) else 0.0), angles[1]
        head = turned(pan, tilt)
        eye = turned(*angles[2:4]) if joints >= 4 else Rotation.identity()
        position, direction = gaze_ray(OFFSET, angles)
        in_pan = np.add(OFFSET.tilt_axis_in_pan_m, turned(0.0, tilt).apply(OFFSET.eye_in_tilt_m))
        np.testing.assert_allclose(position, turned(pan, 0.0).apply(in_pan), atol=1e-12)
        np.testing.assert_allclose(direction, (head * eye).apply([1.0, 0.0, 0.0]), atol=1e-12)


def test_eye_angles_point_the_gaze_at_the_target():
    rng = np.random.default_rng(3)
    heads = rng.uniform(-0.6, 0.6, (50, 2))
    targets = rng.uniform([1.0, -1.0, -0.5], [3.0, 1.0, 0.8], (50, 3))
    joints = np.concatenate([heads, eye_angles_rad(OFFSET, heads, targets)], axis=1)
    assert gaze_error_rad(OFFSET, joints, targets).max() < 1e-7


# ---------------------------------------------------------------- look at


@given(
    geometry=geometries,
    direction=st.tuples(*[st.floats(-1, 1)] * 3),
    distance=st.floats(0.6, 10.0),  # beyond the reach of every part of the neck
)
def test_look_at_points_the_gaze_at_the_target(geometry, direction, distance):
    assume(np.linalg.norm(direction) > 0.1)
    target = distance * np.array(direction) / np.linalg.norm(direction)
    lateral = abs(geometry.tilt_axis_in_pan_m[1] + geometry.eye_in_tilt_m[1])
    ground = float(np.hypot(target[0], target[1]))
    # Closer to the cylinder of tangent gaze rays, angles are ill-conditioned.
    assume(ground > lateral + 0.02)
    assert gaze_error_rad(geometry, look_at_rad(geometry, target), target) < 1e-9


@pytest.mark.parametrize("z", [0.5, 3.0, -3.0])
@pytest.mark.parametrize(
    "geometry", [POINT, Geometry(tilt_axis_in_pan_m=(0.07, 0.0, 0.05), eye_in_tilt_m=(0.02, 0.0, 0.06))]
)
def test_look_at_handles_targets_on_the_pan_axis(geometry, z):
    angles = look_at_rad(geometry, [0.0, 0.0, z])
    assert np.all(np.isfinite(angles))
    assert gaze_error_rad(geometry, angles, [0.0, 0.0, z]) < 1e-9


# ---------------------------------------------------------------- unwrapping


@pytest.mark.parametrize("turns", [1.7, -1.7])
def test_pan_is_continuous_round_the_robot(turns):
    angle = 2.0 + np.linspace(0.0, 2 * np.pi * turns, 200)
    targets = np.stack([3 * np.cos(angle), 3 * np.sin(angle), 0.3 * np.sin(3 * angle)], axis=-1)
    wrapped = look_at_rad(POINT, targets)
    assert np.max(np.abs(np.diff(wrapped[:, 0]))) > 6.0
    continuous = unwrap_pan(wrapped, 2.0, -np.inf, np.inf)
    np.testing.assert_allclose(continuous[:, 0], angle, atol=1e-12)
    np.testing.assert_array_equal(continuous[:, 1], wrapped[:, 1])


@given(first=st.floats(-3.14, 3.14), near=st.floats(-12, 12))
def test_the_first_pan_is_within_half_a_turn_of_the_given_one(first, near):
    pan = unwrap_pan(np.array([[first, 0.2]]), near, -np.inf, np.inf)[0, 0]
    assert abs(pan - near) <= np.pi + 1e-12
    assert np.exp(1j * pan) == pytest.approx(np.exp(1j * first), abs=1e-12)


# ---------------------------------------------------------------- gaze error


@pytest.mark.parametrize("angle", [1e-9, 1e-6, 1e-3])
def test_small_gaze_errors_are_exact(angle):
    """arccos of a scalar product cannot resolve 1e-9 rad."""
    target = 3.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
    assert gaze_error_rad(POINT, [0.0, 0.0], target) == pytest.approx(angle, rel=1e-6)
    assert gaze_error_rad(POINT, [0.0, angle], [3.0, 0.0, 0.0]) == pytest.approx(angle, rel=1e-6)


def test_pan_is_unwrapped_to_the_reachable_side():
    """Limits of +-163.7 deg; the person walks behind the robot from 170 over 180 to -20 deg: pan changes sides."""
    limits = np.radians([-163.7, 163.7])
    path = np.radians([[170.0, 0.0], [175.0, 0.0], [-175.0, 0.0], [-120.0, 0.0], [-20.0, 0.0]])
    assert np.degrees(unwrap_pan(path, np.radians(160.0), *limits)[-1, 0]) == pytest.approx(-20.0)
    # Straight behind, both directions are equivalent: stay on the current side.
    behind = np.radians([[179.0, 0.0], [-179.0, 0.0]])
    for side in (-160.0, 160.0):
        assert np.sign(unwrap_pan(behind, np.radians(side), *limits)[:, 0]) == pytest.approx(np.sign(side))


# ---------------------------------------------------------------- how uncertain a direction is


@pytest.mark.parametrize("target", [[2.5, 0.0, 0.0], [1.5, 0.7, 0.4], [2.5, -1.0, -1.3], [-0.9, 0.2, 0.6]])
def test_direction_deviations_equal_propagation_by_finite_differences(target):
    """Propagated with a Jacobian by central differences, neck without offsets."""
    step_m = 1e-6
    moves = np.concatenate([np.eye(3), -np.eye(3)]) * step_m
    angles = look_at_rad(POINT, np.array(target) + moves)
    jacobian = (angles[:3] - angles[3:]).T / (2.0 * step_m)
    rng = np.random.default_rng(4)
    for _ in range(20):
        root = 0.1 * rng.normal(size=(3, 3))
        covariance = root @ root.T
        expected = np.sqrt(np.diag(jacobian @ covariance @ jacobian.T))
        assert angle_deviations_rad(np.array(target), covariance) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_direction_deviations_of_non_finite_input_are_nan(value):
    for target, covariance in (([2.0, value, 0.1], np.eye(3)), ([2.0, 0.3, 0.1], np.diag([1.0, value, 1.0]))):
        assert np.all(np.isnan(angle_deviations_rad(np.array(target), covariance)))
