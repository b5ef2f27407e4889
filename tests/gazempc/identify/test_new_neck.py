"""A neck file from a data sheet, and from a URDF against forward kinematics of the whole chain."""

import datetime
import io
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gazempc.errors import SettingsError
from gazempc.identify.identify import main
from gazempc.identify.urdf import read_urdf
from gazempc.neck.kinematics import gaze_ray
from gazempc.neck.spec import load_neck

SHEET = ["--sheet.pan-deg", "-70", "80", "--sheet.tilt-deg", "-30", "40", "--sheet.speed", "60 rpm"]


def test_options_suffice_and_assumed_values_are_marked(tmp_path, capsys):
    path = tmp_path / "sub" / "mine.toml"
    words = [*SHEET, "--sheet.tilt-speed", "90 deg/s", "--sheet.head-view-deg", "69", "42"]
    assert main(["--new", str(path), *words]) == 0
    output = capsys.readouterr().out
    assert str(path) in output
    neck = load_neck(path)
    assert neck.name == "mine"
    assert datetime.date.today().isoformat() in neck.source
    assert "assumed" in neck.source
    assert (neck.pan.position_min_deg, neck.pan.position_max_deg) == (-70.0, 80.0)
    assert (neck.tilt.position_min_deg, neck.tilt.position_max_deg) == (-30.0, 40.0)
    assert neck.head_view_deg == (69.0, 42.0)
    # The rules: 0.8 of the top speed, reached in 0.2 s, its acceleration in 0.05 s.
    for axis, top_rad_s in ((neck.pan, 2 * math.pi), (neck.tilt, math.pi / 2)):
        assert axis.velocity_max_rad_s == pytest.approx(0.8 * top_rad_s, rel=1e-3)
        assert axis.velocity_max_rad_s / axis.acceleration_max_rad_s2 == pytest.approx(0.2, rel=1e-3)
        assert axis.acceleration_max_rad_s2 / axis.jerk_max_rad_s3 == pytest.approx(0.05, rel=1e-3)
        assert (axis.natural_frequency_rad_s, axis.damping_ratio, axis.dead_time_s) == (12.0, 0.9, 0.1)
    text = path.read_text(encoding="utf-8")
    assert (text.count("# assumed"), text.count("# data sheet")) == (13, 5)


def test_a_speed_unreachable_within_the_range_is_a_warning(tmp_path, capsys):
    """By the rules of thumb acceleration and braking take 0.25 s: of 150 and 70 deg, 10.5 and 4.9 rad/s at most."""
    sheet = ["--sheet.pan-deg", "-75", "75", *SHEET[3:-1], "11 rad/s"]
    assert main(["--new", str(tmp_path / "mine.toml"), *sheet]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert [line.split(": ")[1] for line in printed if line.startswith("Warning: ")] == ["tilt"]


def test_missing_values_are_prompted_for_until_valid(tmp_path, monkeypatch, capsys):
    answers = iter(["-70, 80", "fast", "0.2 s/60deg", "10 50", "40 -30", "5.2 rad/s"])
    monkeypatch.setattr("builtins.input", lambda question: next(answers))
    assert main(["--new", str(tmp_path / "asked.toml")]) == 0
    output = capsys.readouterr().out
    assert "'fast'" in output
    assert "'10 50'" in output
    assert list(answers) == []
    neck = load_neck(tmp_path / "asked.toml")
    assert (neck.pan.position_min_deg, neck.pan.position_max_deg) == (-70.0, 80.0)
    assert (neck.tilt.position_min_deg, neck.tilt.position_max_deg) == (-30.0, 40.0)
    assert neck.velocity_max_rad_s == pytest.approx([0.8 * (math.pi / 3) / 0.2, 0.8 * 5.2], rel=1e-3)


def test_invalid_data_sheets_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    new = str(tmp_path / "n.toml")
    for words, problem in (
        (["--new", new], "give --sheet.pan-deg"),
        (["--new", new, *SHEET[:7], "60"], "--sheet.speed: '60' is not a speed; expected: a number with its unit"),
        (["--new", new, "--sheet.pan-deg", "10", "80"], "--sheet.pan-deg: '10.0 80.0' does not contain 0"),
        (["--robot", "simulated", *SHEET, "--out", new], "--sheet"),
        (["--robot", "simulated", "--urdf", "robot.urdf", "--out", new], "--urdf: requires --new FILE"),
        (["--robot", "simulated", "--tilt-joint", "tilt", "--out", new], "--tilt-joint: requires --new FILE"),
    ):
        assert main(words) == 2
        assert problem in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert main(["--new", new, *SHEET]) == 0
    before = (tmp_path / "n.toml").read_text()
    assert main(["--new", new, *SHEET]) == 2
    assert "exists already" in capsys.readouterr().err
    assert (tmp_path / "n.toml").read_text() == before


# ---------------------------------------------------------------- a URDF


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
    """Eye position from the chain's matrices."""
    turn = Rotation.from_euler("z", pan_rad)
    at = np.array([0.182, 0.0, 0.0]) + turn.apply([0.005, 0.0, 0.098])
    turn = turn * Rotation.from_euler("xyz", [-1.5707963, 0, 0]) * Rotation.from_euler("z", tilt_rad)
    return at + turn.apply([0.107, 0.0802, 0.02])


def test_the_eye_pose_equals_forward_kinematics(tmp_path, capsys):
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
        ({"at": 1, "value": "fixed"}, "camera", "1 revolute joints"),
    ],
)
def test_a_chain_without_a_neck_is_refused(tmp_path, change, eye, why):
    with pytest.raises(SettingsError, match=why):
        read_urdf(tiago(tmp_path / "robot.urdf", **change), eye)


def test_an_invalid_urdf_is_refused(tmp_path):
    (tmp_path / "a.urdf").write_text("<robot")
    (tmp_path / "b.urdf").write_text('<!DOCTYPE r [<!ENTITY a "b">]><robot/>')
    (tmp_path / "c.urdf").write_text('<?xml version="1.0" encoding="none"?><robot/>')
    for name in ("a.urdf", "b.urdf", "c.urdf", "none.urdf"):
        with pytest.raises(SettingsError, match=f"--urdf .*{name}"):
            read_urdf(tmp_path / name, "camera")
    assert main(["--new", str(tmp_path / "n.toml"), "--urdf", str(tmp_path / "a.urdf")]) == 2
