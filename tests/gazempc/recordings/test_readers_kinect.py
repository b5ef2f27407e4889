"""Azure Kinect JSON: known motion in level axes; errors with file, place and remedy."""

import json

import numpy as np
import pytest
from builders.exports import FRAMES, KINECT, Walk, kinect, same_turns
from builders.recordings import assert_refused
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions


def write(path, content):
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.mark.parametrize(("pitch", "joint"), [(12.0, "nose"), (-20.0, "head")])
def test_a_known_walk_is_read_back_in_level_axes(tmp_path, pitch, joint):
    path = write(tmp_path / "eva_R3.json", kinect(pitch))
    options = ReadOptions.model_validate({"kinect_camera_pitch_deg": pitch, "kinect_head_joint": joint})
    recording = load(path, options)
    np.testing.assert_allclose(recording.times_s, Walk.times_s, atol=1e-6)
    track = recording.measured
    np.testing.assert_allclose(track.pelvis_position_m, Walk.pelvis_m, atol=1e-6)
    np.testing.assert_allclose(track.head_position_m, Walk.point_m(*KINECT[joint.upper()]), atol=1e-6)
    same_turns(track.pelvis_quat_wxyz, Walk.pelvis, 1e-4)
    same_turns(track.head_quat_wxyz, Walk.head, 1e-4)
    assert recording.has_robot
    assert recording.kind == "body tracking"
    assert (recording.name, recording.labels.subject, recording.labels.group) == ("eva_R3", "eva", "straight")


def test_missing_bodies_are_gaps_inside_and_trimmed_at_the_ends(tmp_path):
    content = kinect()
    for k in [0, 1, 10, 11, 12, FRAMES - 1]:
        content["frames"][k]["bodies"] = []
    recording = load(write(tmp_path / "a.json", content))
    np.testing.assert_allclose(recording.times_s, Walk.times_s[: FRAMES - 3], atol=1e-6)
    np.testing.assert_array_equal(np.flatnonzero(~recording.truth.valid), [8, 9, 10])
    for track in (recording.truth, recording.measured):
        for values in (track.head_position_m, track.pelvis_quat_wxyz):
            np.testing.assert_array_equal(np.isnan(values).any(axis=1), ~track.valid)
    np.testing.assert_allclose(recording.measured.pelvis_position_m[-1], Walk.pelvis_m[FRAMES - 2], atol=1e-6)


def test_the_longest_or_the_selected_body_is_read(tmp_path):
    content, other = kinect(), kinect(body_id=3, shift_m=[0.0, -2.0, 0.0])
    for frame, more in list(zip(content["frames"], other["frames"], strict=True))[5:30]:
        frame["bodies"].insert(0, more["bodies"][0])
    path = write(tmp_path / "a.json", content)
    assert len(load(path).times_s) == FRAMES
    found = load(path, ReadOptions(kinect_body_id=3)).measured.pelvis_position_m
    np.testing.assert_allclose(found, Walk.pelvis_m[5:30] - [0.0, 2.0, 0.0], atol=1e-9)
    with pytest.raises(RecordingError, match=r"no body with id 5.*3 \(25 frames\), 7 \(45 frames\)"):
        load(path, ReadOptions(kinect_body_id=5))


def joints(content, frame, key="joint_positions"):
    return content["frames"][frame]["bodies"][0][key]


def _metres(content):
    for k in range(FRAMES):
        joints(content, k)[:] = [[1e-3 * v for v in xyz] for xyz in joints(content, k)]


def _turn_noses(content):
    """The axes of the joint NOSE are rotated by 90 degrees about the vertical."""
    for k in range(FRAMES):
        entry = joints(content, k, "joint_orientations")[list(KINECT).index("NOSE")]
        turn = Rotation.from_quat(entry, scalar_first=True) * Rotation.from_euler("x", 90.0, degrees=True)
        entry[:] = turn.as_quat(scalar_first=True).tolist()


def _put(value, *keys):
    """Replace a value; None removes the key."""

    def change(content):
        for key in keys[:-1]:
            content = content[key]
        content[keys[-1]] = value
        if value is None and isinstance(content, dict):
            del content[keys[-1]]

    return change


NOSE = list(KINECT).index("NOSE")


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (_put(None, "joint_names"), ["joint_names"]),
        (_put("SPINE", "joint_names", NOSE), ["joint_names", "NOSE"]),
        (_put(10**400, "frames", 4, "timestamp_usec"), ["frame 4", "timestamp_usec"]),
        (_put(5_000_100_000, "frames", 4, "timestamp_usec"), ["frame 4", "frame 3"]),
        (lambda content: joints(content, 4).pop(), ["frame 4, body 7", "5 joint_positions for 6"]),
        (_put("1", "frames", 4, "bodies", 0, "joint_positions", NOSE, 1), ["frame 4", "joint_positions"]),
        (_put(None, "frames", 4, "bodies", 0, "joint_positions", NOSE, 1), ["frame 4, body 7", "NOSE", "y", "nan"]),
        (_put(9.0, "frames", 4, "bodies", 0, "joint_orientations", NOSE, 0), ["frame 4", "NOSE", "norm"]),
        (lambda content: content["frames"][4]["bodies"].append(content["frames"][4]["bodies"][0]), ["frame 4"]),
        (lambda content: content["frames"].__delitem__(slice(4, None)), ["4 frame(s)", "at least 5"]),
        (_metres, ["0.0006", "the format has microseconds and millimetres"]),
        (_turn_noses, ["NOSE", "90 deg from the face"]),
    ],
)
def test_damage_is_reported_with_its_place(tmp_path, change, named):
    content = kinect()
    change(content)
    path = write(tmp_path / "walk.json", content)
    assert_refused(path, str(path), *named)
