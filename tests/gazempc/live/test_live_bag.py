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
from gazempc.results.log_files import load_log
from gazempc.results.metrics import measure

T = np.arange(150) / 30.0
# A person walks to and fro, 2 m in front of a camera.
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
def test_a_whole_live_run_on_a_bag_writes_logs_that_join(bag, tmp_path, capsys):
    out = tmp_path / "out"
    words = ("--source", f"bag:{bag}", "--simulated-clock", "--out", out, "--log-s", "3", "--log", "npz")
    assert run(*words, "--predictor", "constant_velocity", "--controller", "lookahead") == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["stopped_by"] == "end of the source"
    assert (summary["observations"], summary["used"], summary["refused"]) == (150, 150, {})
    assert summary["skipped_ticks"] == summary["late_ticks"] == summary["limit_violations"] == 0
    assert summary["logs"] == ["log_000.npz", "log_001.npz"]
    logs = [load_log(out / name) for name in summary["logs"]]
    assert np.diff(np.concatenate([log.time_s for log in logs])) == pytest.approx(0.005, abs=1e-9)
    assert measure(logs[1]).gaze_error_rms_deg < 3.0  # a neck that stands still: 16 deg
    said = capsys.readouterr().out
    assert "  face_a, 150 frames in camera_link" in said
    assert "against the tracker's own track, smoothed without lag" in said
    (line,) = (line for line in said.splitlines() if line.startswith("Written to "))
    assert sorted(line.partition("/: ")[2].split(", ")) == sorted(path.name for path in out.iterdir())


def test_what_does_not_go_together_is_refused(bag, capsys):
    for words, named in (
        (("--source", "bag:"), "bag:PATH"),
        (("--source", "bag:nowhere"), "nowhere"),
        (("--source", f"bag:{bag}", "--sensor", "reference"), "--source replay"),
        (("--source", f"bag:{bag}", "--mount.on", "head"), "mount.on"),
    ):
        assert run(*words) == 2
        assert named in capsys.readouterr().err
