"""Eyes in the head and a body under the neck: kinematics against rotations of another library."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gazempc.neck.kinematics import eye_angles_rad, gaze_error_rad, gaze_ray, head_angles_rad
from gazempc.neck.spec import Geometry, load_neck

GEOMETRY = Geometry(tilt_axis_in_pan_m=(0.02, 0.01, 0.1), eye_in_tilt_m=(0.05, -0.03, 0.04))
RNG = np.random.default_rng(3)


def turned(pan_rad, tilt_rad):
    return Rotation.from_euler("ZY", [pan_rad, -tilt_rad])


@pytest.mark.parametrize("joints", [2, 3, 4, 5])
def test_the_gaze_ray_is_that_of_composed_rotations(joints):
    for angles in RNG.uniform(-0.6, 0.6, (20, joints)):
        pan, tilt = angles[0] + (angles[-1] if joints in (3, 5) else 0.0), angles[1]
        head = turned(pan, tilt)
        eye = turned(*angles[2:4]) if joints >= 4 else Rotation.identity()
        position, direction = gaze_ray(GEOMETRY, angles)
        in_pan = np.add(GEOMETRY.tilt_axis_in_pan_m, turned(0.0, tilt).apply(GEOMETRY.eye_in_tilt_m))
        np.testing.assert_allclose(position, turned(pan, 0.0).apply(in_pan), atol=1e-12)
        np.testing.assert_allclose(direction, (head * eye).apply([1.0, 0.0, 0.0]), atol=1e-12)


def test_the_eyes_angles_look_at_the_target():
    heads = RNG.uniform(-0.6, 0.6, (50, 2))
    targets = RNG.uniform([1.0, -1.0, -0.5], [3.0, 1.0, 0.8], (50, 3))
    joints = np.concatenate([heads, eye_angles_rad(GEOMETRY, heads, targets)], axis=1)
    assert gaze_error_rad(GEOMETRY, joints, targets).max() < 1e-7


def test_the_joints_have_names_in_the_order_of_the_arrays():
    neck = load_neck("reference_eyes")
    assert neck.joint_names == ("pan", "tilt", "eye_pan", "eye_tilt")
    assert neck.dead_time_s.tolist() == [0.4, 0.4, 0.06, 0.06]
    both = neck.model_copy(update={"body": neck.pan})
    assert both.joint_names[-1] == "body_yaw"
    assert both.joints == 5


def test_a_body_turns_the_head():
    assert head_angles_rad([0.1, 0.2, 0.3]).tolist() == pytest.approx([0.4, 0.2])
    assert head_angles_rad([0.1, 0.2, 0.5, 0.6, 0.3]).tolist() == pytest.approx([0.4, 0.2])
    assert head_angles_rad([0.1, 0.2, 0.5, 0.6]).tolist() == pytest.approx([0.1, 0.2])


def test_a_joint_rests_where_its_file_says():
    neck = load_neck("reference")
    tilted = neck.tilt.model_copy(update={"rest_deg": 10.0})
    assert neck.model_copy(update={"tilt": tilted}).rest_rad.tolist() == pytest.approx([0.0, np.deg2rad(10.0)])
