"""Exports of other programs: each is read without options and returns the written walk."""

from functools import partial

import numpy as np
import pytest
from builders import exports
from builders.exports import Walk, same_turns

from gazempc.errors import RecordingError, SettingsError
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions

OPTICAL = "camera_color_optical_frame"
CAMERA_M = np.array([-2.0, 0.0, 1.2])


def check(recording, head_m=Walk.head_m, head=Walk.head, pelvis_m=None, pelvis=None, times_s=Walk.times_s):
    """The recording equals the walk; missing parts are unknown."""
    track = recording.measured or recording.truth
    np.testing.assert_allclose(recording.times_s - recording.times_s[0], times_s, atol=2e-6)
    np.testing.assert_allclose(track.head_position_m, head_m, atol=2e-6)
    for given, found in ((head, track.head_quat_wxyz), (pelvis, track.pelvis_quat_wxyz)):
        if given is None:
            assert np.isnan(found).all()
        else:
            same_turns(found, given)
    if pelvis_m is None:
        assert np.isnan(track.pelvis_position_m).all()
    else:
        np.testing.assert_allclose(track.pelvis_position_m, pelvis_m, atol=2e-6)


@pytest.mark.parametrize(
    "write", [exports.motive, partial(exports.motive, unit="Meters"), exports.vicon_object, exports.rostopic]
)
def test_exports_with_heads_only_are_read(tmp_path, write):
    recording = load(write(tmp_path / "a.csv"))
    check(recording)
    assert not recording.has_robot


@pytest.mark.parametrize(
    ("name", "write"), [("a.csv", partial(exports.motive, name="Anna", skeleton=True)), ("a.mvnx", exports.mvnx)]
)
def test_exports_with_skeletons_are_read(tmp_path, name, write):
    check(load(write(tmp_path / name)), pelvis_m=Walk.pelvis_m, pelvis=Walk.pelvis)


def test_euler_angles_of_motive_are_omitted_with_a_note(tmp_path):
    path = exports.motive(tmp_path / "a.csv")
    text = path.read_text().replace("Rotation Type,Quaternion", "Rotation Type,XYZ").replace(",X,Y,Z,W,", ",X,Y,Z,,")
    path.write_text(text)
    recording = load(path)
    check(recording, head=None)
    assert any("Euler angles in the order XYZ" in note and "head_euler" in note for note in recording.notes)


def test_ambiguous_rigid_bodies_require_an_option(tmp_path):
    path = exports.motive(tmp_path / "a.csv", "Anna", others=["Bob"])
    with pytest.raises(RecordingError, match=r"Anna, Bob.*--reading\.person 'Anna'"):
        load(path)
    check(load(path, ReadOptions(person="anna")))
    with pytest.raises(SettingsError, match=r"--reading\.person Bib.*perhaps you meant 'Bob'"):
        load(path, ReadOptions(person="Bib"))


def test_hidden_markers_in_half_of_the_rows_are_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"25 of 45 rows.*at least 50%"):
        load(exports.motive(tmp_path / "b.csv", blank=range(25)))


@pytest.mark.parametrize("subject", ["Anna", "Anna-Maria", "P1+2", "a:b"])
def test_vicon_markers_are_read(subject, tmp_path):
    recording = load(exports.vicon_markers(tmp_path / "a.csv", subject, lost=[3]))
    known = np.arange(exports.FRAMES) != 3
    np.testing.assert_allclose(recording.truth.head_position_m, Walk.head_m, atol=2e-6)
    np.testing.assert_allclose(recording.truth.pelvis_position_m[known], Walk.pelvis_m[known], atol=2e-6)
    assert np.isnan(recording.truth.pelvis_position_m[3]).all()
    same_turns(recording.truth.head_quat_wxyz, Walk.head)
    same_turns(recording.truth.pelvis_quat_wxyz[known], Walk.pelvis[known])
    np.testing.assert_allclose(np.diff(recording.times_s), 1 / 30, atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "frame"),
    [("pose", OPTICAL), ("point", "base_link"), ("transform", "map"), ("covariance", OPTICAL)],
)
def test_ros2_topic_echo_is_read(tmp_path, kind, frame):
    recording = load(exports.ros2_echo(tmp_path / "a.csv", kind, frame))
    check(recording, Walk.head_m - [-1.0, 0.0, 1.2], None if kind == "point" else Walk.head * exports.BACK)
    assert recording.times_s[0] == pytest.approx(1_700_000_000.9, abs=1e-6)
    assert recording.has_robot == (frame != "map")
    assert recording.kind == "tracked"


@pytest.mark.parametrize("write", [exports.obsmat, exports.tracks])
def test_pedestrian_tracks_are_read(tmp_path, write):
    path = write(tmp_path / "obsmat.txt")
    recording = load(path)
    head_m = np.outer(np.arange(24), [0.5, 0.1, 0.0]) + np.array([5.0, 0.0, 1.6])
    check(recording, head_m, None, times_s=0.4 * np.arange(24))
    times_s = load(path, ReadOptions(person="3")).times_s
    np.testing.assert_allclose(times_s - times_s[0], 0.4 * np.array([0, 1, 2, 3, *range(4, 24, 2)]), atol=1e-9)


@pytest.mark.parametrize("names", ["{name}_{axis}", "landmark_{number}_{axis}", "{axis}{number}", None])
def test_mediapipe_world_landmarks_are_read(tmp_path, names):
    """With columns for all landmarks, or one row per landmark."""
    path = tmp_path / "a.csv"
    recording = load(exports.mediapipe(path, names) if names else exports.mediapipe_long(path))
    hips_m = np.tile([0.0, 0.0, 0.95], (exports.FRAMES, 1))
    check(recording, Walk.point_m("head", [0.1, 0.0, 0.0]) - Walk.pelvis_m + hips_m, Walk.head, hips_m, Walk.pelvis)
    # Columns may be named by number: those of one landmark stay side by side, as in files with columns for all.
    by_number = load(path, ReadOptions(columns="head=[#2,#3,#4]"))
    np.testing.assert_allclose(by_number.truth.head_position_m, recording.truth.head_position_m, atol=1e-9)


@pytest.mark.parametrize("unit_m", [1.0, 0.001])
def test_openpose_folders_are_read(tmp_path, unit_m):
    folder = exports.openpose(tmp_path / "walk", lost=[20], unit_m=unit_m)
    recording = load(folder, ReadOptions(columns="t=frame:30hz"))
    seen = np.arange(exports.FRAMES) != 20
    nose_m, hips_m = (each[seen] - CAMERA_M for each in (Walk.point_m("head", [0.1, 0.0, 0.0]), Walk.pelvis_m))
    check(recording, nose_m, Walk.head[seen], hips_m, Walk.pelvis[seen], Walk.times_s[seen])
    assert recording.name == "walk"
    with pytest.raises(RecordingError, match=r"no frame rate.*t=frame:60hz"):
        load(folder)


def test_lines_of_ros2_between_messages_are_dropped_and_counted(tmp_path):
    path = exports.ros2_echo(tmp_path / "a.csv")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:5], "A message was lost!!!", *lines[5:], "1700"]))
    recording = load(path)
    assert recording.times_s.size == exports.FRAMES
    assert "2 rows do not have 10 cells (first row 6): dropped" in recording.notes
