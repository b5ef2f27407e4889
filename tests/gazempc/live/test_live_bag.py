"""A bag as a live source: what its tracker measured arrives with the delays of the recording."""

import json

import numpy as np
import pytest
from builders.bags import face_rows, write_bag

from gazempc.live import session as live
from gazempc.results.log_files import load_log
from gazempc.results.metrics import measure

T = np.arange(150) / 30.0
# A person walks to and fro, 2 m in front of a camera.
WALK = np.column_stack([np.full_like(T, 2.0), 0.8 * np.sin(0.6 * T), np.full_like(T, 0.3)])


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / "bag", face_rows("face_a", 1e9 + T, WALK, "camera_link"), delay_s=0.08)


def run(*words):
    return live.main([*map(str, words), "--robot", "simulated", "--no-figures"])


def test_a_live_run_on_a_bag_has_the_delays_of_the_recording_and_writes_logs_that_join(bag, tmp_path, capsys):
    out = tmp_path / "out"
    words = ("--source", f"bag:{bag}", "--simulated-clock", "--out", out, "--log-s", "3", "--log", "npz")
    assert run(*words, "--predictor", "constant_velocity", "--controller", "lookahead") == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["stopped_by"] == "end of the source"
    assert (summary["observations"], summary["used"], summary["refused"]) == (150, 150, {})
    assert summary["skipped_ticks"] == summary["late_ticks"] == summary["limit_violations"] == 0
    assert summary["logs"] == ["log_000.npz", "log_001.npz"]
    logs = [load_log(out / name) for name in summary["logs"]]
    time_s, captured_s, arrived_s, heads_m = (
        np.concatenate([getattr(log, name) for log in logs])
        for name in ("time_s", "capture_time_s", "arrival_time_s", "head_observed_base_m")
    )
    assert np.diff(time_s) == pytest.approx(0.005, abs=1e-9)
    assert captured_s - captured_s[0] == pytest.approx(T, abs=1e-5)
    # At the first tick after the arrival.
    assert np.all((arrived_s - captured_s > 0.08 - 1e-5) & (arrived_s - captured_s < 0.085 + 1e-5))
    np.testing.assert_allclose(heads_m, WALK, atol=1e-9)
    assert measure(logs[1]).gaze_error_rms_deg < 3.0  # a neck that stands still: 16 deg
    printed = capsys.readouterr().out
    assert "  face_a, 150 frames in camera_link" in printed
    assert "against the tracker's own track, smoothed without lag" in printed
    (line,) = (line for line in printed.splitlines() if line.startswith("Written to "))
    assert sorted(line.partition("/: ")[2].split(", ")) == sorted(path.name for path in out.iterdir())


@pytest.mark.parametrize(
    ("words", "named"),
    [("", "nowhere"), ("--sensor reference", "--source replay"), ("--mount.on head", "mount.on")],
)
def test_what_does_not_go_together_is_refused(words, named, capsys):
    assert run("--source", "bag:nowhere", *words.split()) == 2
    assert named in capsys.readouterr().err
