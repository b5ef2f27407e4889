"""The study of people who cross and of crowds: it can tell a good tracker from a bad one."""

import numpy as np
import pytest

from experiments.people.identities import cross, crossing_walks, crowd_of, score
from experiments.people.study import main
from gazempc.recordings.truth import TrueHead


def test_the_walkers_cross_as_far_behind_each_other_as_said():
    for seed in range(8):
        heads = [TrueHead(walk) for walk in crossing_walks(seed)]
        at_m = np.array([head([0.0])[0] for head in heads])
        np.testing.assert_allclose(at_m[:, 1], 0.0, atol=1e-6)
        assert 0.3 <= at_m[1, 0] - at_m[0, 0] <= 1.5
        before, after = (np.array([head([t])[0, 1] for head in heads]) for t in (-0.8, 0.8))
        assert np.sign(before).tolist() == [-1.0, 1.0]
        assert np.sign(after).tolist() == [1.0, -1.0]


@pytest.mark.parametrize("sensor", ["reference", "body_tracker", "face_camera"])
def test_who_crosses_stays_who_they_are(sensor):
    assert [any(cross(seed, sensor, "people")) for seed in range(3)] == [False] * 3


def test_the_command_prints_and_writes_the_table(tmp_path, capsys):
    assert main(["--seeds", "2", "--sensors", "reference", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "| reference | people | 0 | 0 |" in said
    assert (tmp_path / "report.md").read_text().strip() in said


@pytest.mark.slow
def test_a_crowd_of_recorded_people_is_scored(tracks_dir):
    walks = crowd_of(tracks_dir, "hermes_boa-300", 2.0, 16)
    ours, nearest = score("hermes", walks, "reference", 0)
    assert (ours.tracker, nearest.tracker) == ("people", "nearest_neighbour")
    assert ours.people == 16
    assert ours.idf1 > nearest.idf1
    assert ours.switches < nearest.switches
    assert 0.7 < ours.mota <= 1.0
