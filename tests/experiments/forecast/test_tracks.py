"""Tracks of positions alone: smoothed truth, places, and coverage by hand."""

import json

import numpy as np
import pytest

from experiments.forecast.command import forecast, main
from experiments.forecast.errors import ForecastErrors
from experiments.forecast.summary import ClipResult, summarise
from gazempc.results.forecast_metrics import inside

pytestmark = pytest.mark.usefixtures("in_this_process")


def test_smoothed_truth_scores_what_the_track_hides(tmp_path):
    """Frames are off by 20 mm across, to and fro: so is the last position against the smooth truth."""
    times_s = np.arange(0, 4.0, 0.02)
    off_m = 0.02 * (-1.0) ** np.arange(times_s.size)
    rows = np.stack([times_s, 0.5 * times_s, 3.0 + off_m, np.full_like(times_s, 1.6)], axis=1)
    path = tmp_path / "walk.csv"
    np.savetxt(path, rows, "%.6f", ",", header="t,head_x,head_y,head_z", comments="")
    words = {"recordings": [str(path)], "predictors": ["last_position"], "jobs": 1}

    def across_mm(**more):
        (found,) = forecast(**words, horizons=[0.02], out=tmp_path / "out", **more).results
        return found.sensor, 1e3 * found.errors.difference_m[5:-20, 0, 1]

    sensor, off_mm = across_mm(truth_smoothing=0.16)
    assert sensor == "recorded"
    np.testing.assert_allclose(np.abs(off_mm), 20.0, atol=0.5)
    _, raw_mm = across_mm(sensors=["perfect"])
    assert set(np.round(np.abs(raw_mm))) == {40.0}
    sensor, off_mm = across_mm(truth_smoothing=0.16, sensors=["perfect"])
    assert sensor == "perfect"
    np.testing.assert_allclose(np.abs(off_mm), 20.0, atol=0.5)


def test_a_walk_that_comes_too_near_is_left_out_where_the_place_matters(tmp_path, capsys):
    """A circle of 2 m about its centre: beside it at 2.5 m the head comes within 0.5 m of a camera."""
    times_s = np.arange(0, 8.0, 0.05)
    angle_rad = 2.0 * np.pi * times_s / 8.0
    rows = np.stack([times_s, 2.0 * np.cos(angle_rad), 2.0 * np.sin(angle_rad), 0 * times_s + 1.6], axis=1)
    np.savetxt(tmp_path / "round.csv", rows, "%.6f", ",", header="t,head_x,head_y,head_z", comments="")
    words = ["--recordings", str(tmp_path / "round.csv"), "--sensors", "reference", "face_camera", "--jobs", "1"]
    assert main([*words, "--predictors", "last_position", "--out", str(tmp_path / "out")]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    (left_out,) = summary["left_out"]
    assert left_out["sensor"] == "face_camera"
    assert summary["n_left_out"] == 1
    assert {row["sensor"] for row in summary["rows"]} == {"reference"}
    assert f"- left out round: {left_out['left_out']}" in capsys.readouterr().out


def clip(recording, predictor, error_m, freedom=np.inf, nees=1.0):
    """One scored frame."""
    errors = ForecastErrors(
        np.array([0.5]),
        np.array([[[error_m, 0.0, 0.0]]]),
        np.array([[0.0]]),
        np.array([[nees]]),
        np.array([freedom]),
        np.array([1.0]),
    )
    return ClipResult(recording, "s", predictor, "both", "synthetic", recording, "turn", None, False, errors)


def test_coverage_in_the_table_is_that_of_the_stated_tails():
    """A NEES of 9 is beyond the 95 % of a normal distribution (7.8), and within those of t with 4 (9.9)."""
    (_, normal) = summarise([clip("a", "normal", 1.0, np.inf, 9.0)])
    (_, tailed) = summarise([clip("a", "tailed", 1.0, 4.0, 9.0)])
    assert (normal["coverage_95"], tailed["coverage_95"]) == (0.0, 1.0)
    assert inside(np.array([9.0]), np.array([4.0]), 0.90).tolist() == [False]
    assert tailed["coverage_90"] == 0.0
