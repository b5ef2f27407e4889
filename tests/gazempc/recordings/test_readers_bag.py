"""Tracks of people in ROS 2 bags: what was written is read, in the sensor's frame."""

import numpy as np
import pytest
from builders.bags import face_rows, write_bag

from gazempc.errors import RecordingError
from gazempc.recordings.readers.bag import read_bag_tracks

TIMES_S = 1000.0 + np.arange(5) / 30.0


def test_repeated_stamps_are_counted_and_bad_rows_left_out(tmp_path):
    rows = face_rows("face_a", TIMES_S, [0.0, 0.0, 1.0])
    rows += [rows[2], (1001.0, rows[0][1], "face_a", [0, 0, np.nan], (1, 0, 0, 0))]
    rows += [(1002.0, rows[0][1], "face_a", [0, 0, 1.0], (0, 0, 0, 0))]
    ((seen, _),) = read_bag_tracks(write_bag(tmp_path / "bag", rows))
    assert (seen.poses.times_s.size, seen.repeated, seen.unusable) == (5, 1, 2)


def test_bags_that_have_nobody_are_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match=r"metadata\.yaml"):
        read_bag_tracks(tmp_path / "empty")
    nobody = write_bag(tmp_path / "nobody", face_rows("wheel_left", TIMES_S, [0.0, 0.0, 1.0]))
    with pytest.raises(RecordingError, match=r"topics are /humans/faces/tracked, /tf.*face_<id>"):
        read_bag_tracks(nobody)
    mapped = write_bag(tmp_path / "mapped", face_rows("person_a", TIMES_S, [0.0, 0.0, 1.0], "map"))
    with pytest.raises(RecordingError, match="person_a in map"):
        read_bag_tracks(mapped)


def test_damaged_bags_are_refused(tmp_path):
    bag = write_bag(tmp_path / "bag", face_rows("face_a", TIMES_S, [0.0, 0.0, 1.0]))
    (database,) = bag.glob("*.db3")
    database.write_bytes(b"not a database" * 100)
    with pytest.raises(RecordingError, match="cannot be read"):
        read_bag_tracks(bag)


def test_real_bags_have_their_people(bags_dir):
    for folder in sorted(bags_dir.iterdir()):
        if folder.is_dir():
            longest = read_bag_tracks(folder)[0][0].poses
            assert longest.times_s.size > 100
            assert 0.5 < np.median(longest.position_m[:, 0]) < 2.5
            assert np.abs(np.median(longest.position_m[:, 2])) < 0.5
