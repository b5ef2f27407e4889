"""A bag as a live source: what its tracker measured arrives with the delays of the recording."""

import json

import numpy as np
import pytest
from builders.bags import face_rows, write_bag

from gazempc.live import session as live
from gazempc.live.clock import SimulatedClock
from gazempc.live.sources.replay import BagSource
from gazempc.recordings.load import load
from gazempc.recordings.placement import place

T = np.arange(150) / 30.0
# Somebody walks to and fro, 2 m in front of a camera.
WALK = np.column_stack([np.full_like(T, 2.0), 0.8 * np.sin(0.6 * T), np.full_like(T, 0.3)])


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / "bag", face_rows("face_a", 1e9 + T, WALK, "camera_link"), delay_s=0.08)


def test_sightings_arrive_as_late_as_in_the_recording(bag):
    clock = SimulatedClock()
    clock.sleep_until_s(3.0)
    source = BagSource(place(load(bag), "recorded", 2.5, 1.2), clock)
    source.open()
    assert not source.finished
    clock.sleep_until_s(3.0 + T[10] + 0.079)
    early = source.poll().sightings
    assert [round(30 * (s.observation.capture_time_s - 3.0)) for s in early] == list(range(10))
    clock.sleep_until_s(3.0 + T[10] + 0.081)
    (sighting,) = source.poll().sightings
    np.testing.assert_allclose(sighting.observation.head_position_base_m, WALK[10], atol=1e-9)
    assert sighting.arrival_s - sighting.observation.capture_time_s == pytest.approx(0.08, abs=1e-5)
    assert not source.finished
    clock.sleep_until_s(3.0 + T[-1] + 0.1)
    assert not source.finished  # before the last have been asked for
    assert len(source.poll().sightings) == 139
    assert source.finished


def run(*words):
    return live.main([*map(str, words), "--robot", "simulated", "--no-figures"])


@pytest.mark.slow
def test_a_whole_live_run_on_a_bag(bag, tmp_path, capsys):
    words = ("--source", f"bag:{bag}", "--simulated-clock", "--out", tmp_path / "out")
    assert run(*words, "--predictor", "constant_velocity", "--controller", "lookahead", "--log", "npz") == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["observations"] == 150
    assert (summary["used"], summary["refused"]) == (150, {})
    assert summary["metrics_of_last_log"]["gaze_error_rms_deg"] < 3.0  # a neck that stands still: 16 deg
    said = capsys.readouterr().out
    assert "  face_a, 150 frames in camera_link" in said
    assert "against the tracker's own track, smoothed without lag" in said


def test_what_does_not_go_together_is_refused(bag, capsys):
    for words, expected in (
        (("--source", "bag:"), "bag:PATH, the folder of a ROS 2 bag"),
        (("--source", "bag:nowhere"), "nowhere"),
        (("--source", f"bag:{bag}", "--sensor", "reference"), f"--source replay --replay {bag}"),
        (("--source", f"bag:{bag}", "--mount.on", "head"), "accepted with source bag: mount.on base"),
    ):
        assert run(*words) == 2
        assert expected in capsys.readouterr().err
