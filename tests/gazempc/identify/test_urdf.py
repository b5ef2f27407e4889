"""A neck from a URDF, against forward kinematics of the whole chain."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gazempc.errors import SettingsError
from gazempc.identify.identify import main
from gazempc.identify.urdf import read_urdf
from gazempc.neck.kinematics import gaze_ray
from gazempc.neck.spec import load_neck

JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="{low}" upper="{high}" velocity="{speed}"/></joint>"""


# A lifted torso, a tilt joint drawn about its own z axis and positive down, a camera with a bracket.
JOINTS = [
    ["lift", "prismatic", "base_link", "torso", "-0.062 0 0.193", "0 0 0", "0 0 1", 0, 0.35, 0.07],
    ["head_1_joint", "revolute", "torso", "head_1", "0.182 0 0", "0 0 0", "0 0 1", -1.309, 1.309, 3.0],
    ["head_2_joint", "revolute", "head_1", "head_2", "0.005 0 0.098", "-1.5707963 0 0", "0 0 1", -1.0, 0.785, 2.0],
    ["bracket", "fixed", "head_2", "mount", "0.107 0.0802 0", "0 0 0", "1 0 0", 0, 0, 0],
    ["camera_joint", "fixed", "mount", "camera", "0 0 0.02", "1.57 0.1 0", "1 0 0", 0, 0, 0],
]


def tiago(path, at=0, value="head_1_joint"):
    """The file, with another value of the pan joint."""
    keys = ("name", "kind", "parent", "child", "xyz", "rpy", "axis", "low", "high", "speed")
    joints = [dict(zip(keys, joint, strict=True)) for joint in JOINTS]
    joints[1][keys[at]] = value
    path.write_text(f"<robot name='r'>{''.join(JOINT.format(**joint) for joint in joints)}</robot>")
    return path


def eye_in_torso(pan_rad, tilt_rad):
    """By the chain's matrices."""
    turn = Rotation.from_euler("z", pan_rad)
    at = np.array([0.182, 0.0, 0.0]) + turn.apply([0.005, 0.0, 0.098])
    turn = turn * Rotation.from_euler("xyz", [-1.5707963, 0, 0]) * Rotation.from_euler("z", tilt_rad)
    return at + turn.apply([0.107, 0.0802, 0.02])


def test_the_eye_is_where_the_chain_puts_it(tmp_path, capsys):
    neck = read_urdf(tiago(tmp_path / "robot.urdf"), "camera")
    assert (neck.base_frame, neck.joint_names) == ("torso", ("head_1_joint", "head_2_joint"))
    assert (neck.joint_signs, neck.speed_rad_s) == ((1, -1), (3.0, 2.0))
    np.testing.assert_allclose(neck.range_deg, np.rad2deg([[-1.309, 1.309], [-0.785, 1.0]]))
    words = ["--urdf", str(tmp_path / "robot.urdf"), "--eye-frame", "camera"]
    assert main(["--new", str(tmp_path / "n.toml"), *words]) == 0
    options = capsys.readouterr().out
    assert "--options.ros2.joint-names head_1_joint head_2_joint --options.ros2.joint-signs 1 -1" in options
    assert "--options.ros2.base-frame torso --mount.position-m -0.182" in options
    spec = load_neck(tmp_path / "n.toml")
    rng = np.random.default_rng(1)
    for joints_rad in rng.uniform(-1.0, 1.0, (20, 2)):
        own_rad = joints_rad * neck.joint_signs
        eye_m, _ = gaze_ray(spec.geometry, own_rad)
        np.testing.assert_allclose(eye_m + neck.pan_in_base_m, eye_in_torso(*joints_rad), atol=1e-4)


def test_a_pan_axis_that_points_down_turns_to_the_right(tmp_path):
    neck = read_urdf(tiago(tmp_path / "robot.urdf", at=6, value="0 0 -1"), "camera")
    assert neck.joint_signs == (-1, -1)


@pytest.mark.parametrize(
    ("change", "eye", "why"),
    [
        ({}, "nose", "has no such link"),
        ({"at": 6, "value": "0 1 0"}, "camera", "vertical"),
        ({"at": 7, "value": "low"}, "camera", "needs a <limit>"),
        ({"at": 1, "value": "fixed"}, "camera", "1 joints turn"),
    ],
)
def test_a_chain_without_a_neck_is_refused(tmp_path, change, eye, why):
    with pytest.raises(SettingsError, match=why):
        read_urdf(tiago(tmp_path / "robot.urdf", **change), eye)


def test_a_file_that_is_no_urdf_is_refused(tmp_path):
    (tmp_path / "a.urdf").write_text("<robot")
    (tmp_path / "b.urdf").write_text('<!DOCTYPE r [<!ENTITY a "b">]><robot/>')
    for name in ("a.urdf", "b.urdf", "none.urdf"):
        with pytest.raises(SettingsError, match=f"--urdf .*{name}"):
            read_urdf(tmp_path / name, "camera")
    assert main(["--new", str(tmp_path / "n.toml"), "--urdf", str(tmp_path / "a.urdf")]) == 2
