"""Forecast errors over recordings: known motions, places and smoothed truths give known errors."""

import io
import json
from contextlib import redirect_stdout
from dataclasses import replace

import numpy as np
import pytest
from bs4 import BeautifulSoup
from builders.own_parts import own_module

from experiments.forecast.command import forecast, main
from experiments.forecast.errors import ForecastErrors, forecast_errors, placed_for, smooth_truth
from experiments.forecast.page import summarise
from gazempc.recordings.load import load, recording_from_arrays
from gazempc.recordings.placement import place
from gazempc.recordings.recording import TrueHead
from gazempc.sim.sensor import load_sensor
from predictors import ConstantVelocity, Forecast, HeadPose, LastPosition, Perfect

pytestmark = pytest.mark.usefixtures("in_this_process")

HORIZONS = np.array([0.25, 0.5, 1.0])


def straight_walk(speed=1.2, heading=0.7, seconds=4.0):
    t = np.arange(0, seconds, 1 / 30)
    position = np.stack([speed * t * np.cos(heading), speed * t * np.sin(heading), np.full_like(t, 1.6)], axis=1)
    return recording_from_arrays("line", t, position, in_base_frame=True)


def test_last_position_error_is_speed_times_horizon():
    errors = forecast_errors(straight_walk(), LastPosition(), load_sensor("perfect"), HORIZONS, 0)
    for i, horizon in enumerate(HORIZONS):
        parts = errors.difference_m[:, i][np.isfinite(errors.difference_m[:, i, 0])]
        assert parts[:, 0] == pytest.approx(-1.2 * horizon)
        assert parts[:, 1:] == pytest.approx(0.0, abs=1e-9)


def test_on_a_line_perfect_is_exact_and_constant_velocity_nearly_so():
    walk = straight_walk()
    perfect = forecast_errors(walk, Perfect(TrueHead(walk)), load_sensor("perfect"), HORIZONS, 0)
    assert np.nanmax(np.abs(perfect.difference_m)) < 1e-12
    assert np.all(np.isnan(perfect.nees))
    steady = forecast_errors(walk, ConstantVelocity(), load_sensor("perfect"), HORIZONS, 0)
    late = steady.difference_m[30:]
    assert np.nanmax(np.abs(late)) < 0.002


def test_a_calibrated_forecast_has_nees_3_and_nominal_coverage():
    """Forecasts that are the truth plus noise of the stated covariance."""
    walk = straight_walk(seconds=30.0)
    truth, rng = TrueHead(walk), np.random.default_rng(0)
    spread = np.diag([0.01, 0.04, 0.0025])

    class Calibrated(Perfect):
        def forecast(self, times_s):
            forecast = super().forecast(times_s)
            noise = rng.multivariate_normal(np.zeros(3), spread, size=len(times_s))
            return Forecast(
                forecast.times_s,
                forecast.means_base_m + noise,
                np.tile(spread, (len(times_s), 1, 1)),
                forecast.issued_at_s,
            )

    nees = forecast_errors(walk, Calibrated(truth), load_sensor("perfect"), HORIZONS, 0).nees
    assert np.nanmean(nees) == pytest.approx(3.0, rel=0.04)
    known = nees[np.isfinite(nees)]
    assert np.mean(known <= 3.5059) == pytest.approx(0.68, abs=0.02)
    assert np.mean(known <= 7.8147) == pytest.approx(0.95, abs=0.015)


@pytest.fixture(scope="module")
def compared(tmp_path_factory, in_this_process):
    """Output folder and text of the command: standing and walking people, and a failing predictor."""
    folder, output = tmp_path_factory.mktemp("compared"), io.StringIO()
    words = ["--recordings", "subject01_stand", "subject01_R1", "subject02_R4", "--horizons", "0.5", "--jobs", "1"]
    words += ["--no-figures", "--predictors", "default", "last_position", "constant_velocity"]
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(output):
        own = own_module(folder, patch)
        assert main([*words, f"{own}:Failing", "--out", str(folder / "out")]) == 4
    return folder / "out", json.loads((folder / "out" / "summary.json").read_text()), output.getvalue()


def test_the_command_writes_the_table(compared):
    folder, summary, printed = compared
    rows = [row for row in summary["rows"] if row["kind"] == "all"]
    assert all({"cues", "coverage_68", "nees", "update_us", "ratio_to_constant_velocity"} <= row.keys() for row in rows)
    assert {row["predictor"] for row in rows} == {"constant_velocity", "last_position", "walker"}
    assert [row["group"] for row in rows[:4]] == ["standing", "straight", "turn", "all"]
    *parts, everything = (row for row in rows if row["predictor"] == "constant_velocity")
    assert everything["error_true_mm"] == pytest.approx(np.mean([r["error_true_mm"] for r in parts]))
    assert everything["n_frames"] == sum(r["n_frames"] for r in parts)
    assert "constant_velocity" in printed
    report = BeautifulSoup((folder / "report.html").read_text(encoding="utf-8"), "html.parser")
    assert f"constant_velocity {everything['error_true_mm']:.0f} mm" in report.find(class_="answer").text
    over_horizon, by_clip = (json.loads(d.text) for d in report.find_all("script", type="application/json"))
    errors = {curve["label"]: curve["ys"] for curve in over_horizon["curves"]}
    assert errors["constant_velocity"] == [pytest.approx(everything["error_true_mm"], rel=1e-4)]
    of_clips = {curve["label"]: curve for curve in by_clip["curves"]}["constant_velocity"]
    assert of_clips["xs"] == pytest.approx(sorted(r["error_true_mm"] for r in parts), rel=1e-4)
    assert sorted(of_clips["names"]) == ["subject01_R1", "subject01_stand", "subject02_R4"]


def test_standing_people_are_compared_with_last_position(compared):
    folder, summary, _ = compared
    error_mm = {(r["predictor"], r["group"], r["kind"]): r["error_true_mm"] for r in summary["rows"]}
    lines = [line.split(" | ") for line in (folder / "summary.md").read_text().splitlines() if line.startswith("| ")]
    at = lines[0].index("ratio to last_position")
    of_cv = {line[2]: line[at] for line in lines if line[0] == "| constant_velocity" and line[3] == "all"}
    last_mm = error_mm["last_position", "standing", "all"]
    assert float(of_cv["standing"]) == pytest.approx(
        error_mm["constant_velocity", "standing", "all"] / last_mm, abs=0.005
    )
    assert of_cv["straight"] == "-"


def test_a_failing_predictor_is_named_with_the_recordings(compared):
    _, summary, printed = compared
    own = "my_parts:Failing"
    assert f"failed: {own} on subject01_R1: TypeError" in printed
    recordings = ("subject01_stand", "subject01_R1", "subject02_R4")
    assert [(f["recording"], f["predictor"]) for f in summary["failed"]] == [(name, own) for name in recordings]
    assert all("too often" in f["failed"] for f in summary["failed"])


def test_hidden_cues_do_not_reach_the_predictor():
    """Without one of its two angles the paper's rule equals the filter; with both it differs."""
    walk = load("subject04_R5")
    sensor = load_sensor("reference")
    plain = forecast_errors(walk, ConstantVelocity(), sensor, HORIZONS, 0)
    for cues in ("head", "pelvis", "none"):
        blind = forecast_errors(walk, HeadPose(), sensor, HORIZONS, 0, cues)
        np.testing.assert_array_equal(blind.difference_m, plain.difference_m)
    assert not np.array_equal(forecast_errors(walk, HeadPose(), sensor, HORIZONS, 0).difference_m, plain.difference_m)


def test_a_user_defined_predictor_is_compared_with_its_options_and_name(tmp_path, monkeypatch):
    """With the settings of `constant_velocity` its errors are equal; with others they differ."""
    own = own_module(tmp_path, monkeypatch)
    words = {"recordings": ["subject01_R4"], "predictors": ["constant_velocity", f"{own}:Steady"], "jobs": 1}
    plain, steady = forecast(**words, out=tmp_path / "out")
    assert (plain["predictor"], steady["predictor"]) == ("constant_velocity", "steady")
    np.testing.assert_array_equal(plain["difference_m"], steady["difference_m"])
    _, other = forecast(**words, options={"psd": 0.5}, out=tmp_path / "out")
    assert not np.array_equal(plain["difference_m"], other["difference_m"])
    assert len(list((tmp_path / "out" / "runs").iterdir())) == 3


def test_a_line_of_sight_sensor_without_robot_is_placed_beside_the_walk():
    """Other sensors, and recordings made by a robot, use the recording's own frame."""
    own = load("subject01_R4")
    elsewhere, camera = replace(own, has_robot=False), load_sensor("face_camera")
    for name in ("perfect", "reference", "body_tracker", "street"):
        assert placed_for(elsewhere, load_sensor(name)) is elsewhere
    expected = place(elsewhere, "side", 2.5, 1.2).truth.head_position_m
    np.testing.assert_array_equal(placed_for(elsewhere, camera).truth.head_position_m, expected)
    np.testing.assert_array_equal(placed_for(own, camera).truth.head_position_m, own.truth.head_position_m)


OVER_S = 0.4


def smoothed_m(times_s, head_m, valid=True):
    """The smoothed truth of a head with these frames."""
    made = recording_from_arrays("made", times_s, head_m)
    valid = np.broadcast_to(valid, times_s.shape)
    truth = replace(made.truth, head_position_m=np.where(valid[:, None], head_m, np.nan))
    return smooth_truth(replace(made, truth=truth), OVER_S).truth.head_position_m


def test_smoothing_keeps_a_steady_walk_at_uneven_frames():
    times_s = np.sort(np.random.default_rng(0).uniform(0.0, 3.0, 90))
    head_m = np.array([1.0, 2.0, 1.6]) + np.outer(times_s, [1.2, -0.3, 0.0])
    np.testing.assert_allclose(smoothed_m(times_s, head_m), head_m, atol=1e-12)


def test_smoothing_scales_a_sine_by_its_sinc_without_lag():
    times_s = np.arange(0.0, 6.0, 0.01)
    rate_rad_s = 2.0 * np.pi * 1.5
    wave_m = np.stack([np.sin(rate_rad_s * times_s), np.cos(rate_rad_s * times_s), 0 * times_s], axis=1)
    smooth = smoothed_m(times_s, wave_m)
    inner = (times_s > OVER_S) & (times_s < 6.0 - OVER_S)
    lowered = np.sinc(rate_rad_s * OVER_S / 2.0 / np.pi)
    np.testing.assert_allclose(smooth[inner], lowered * wave_m[inner], atol=1e-3)


def test_smoothing_does_not_cross_a_gap():
    times_s = np.arange(0.0, 2.0, 0.02)
    side_m = np.where(times_s < 1.0, 0.0, 5.0)
    head_m = np.stack([side_m, side_m, 0 * side_m], axis=1)
    valid = (times_s < 0.8) | (times_s > 1.1)
    smooth = smoothed_m(times_s, head_m, valid)
    np.testing.assert_allclose(smooth[valid], head_m[valid], atol=1e-12)
    assert np.isnan(smooth[~valid]).all()


def test_errors_against_smoothed_truth_exclude_track_noise(tmp_path):
    """Frames alternate by 20 mm across the path; so does the error of the last position against the smoothed truth."""
    times_s = np.arange(0, 4.0, 0.02)
    off_m = 0.02 * (-1.0) ** np.arange(times_s.size)
    rows = np.stack([times_s, 0.5 * times_s, 3.0 + off_m, np.full_like(times_s, 1.6)], axis=1)
    path = tmp_path / "walk.csv"
    np.savetxt(path, rows, "%.6f", ",", header="t,head_x,head_y,head_z", comments="")
    words = {"recordings": [str(path)], "predictors": ["last_position"], "jobs": 1}

    def across_mm(**more):
        (found,) = forecast(**words, horizons=[0.02], out=tmp_path / "out", **more)
        return found["sensor"], 1e3 * found["difference_m"][5:-20, 0, 1]

    sensor, off_mm = across_mm(truth_smoothing=0.16)
    assert sensor == "recorded"
    np.testing.assert_allclose(np.abs(off_mm), 20.0, atol=0.5)
    _, raw_mm = across_mm(sensors=["perfect"])
    assert set(np.round(np.abs(raw_mm))) == {40.0}


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
    labels = {"recording": recording, "sensor": "s", "predictor": predictor, "cues": "both", "subject": recording}
    return labels | {"group": "turn", "kind": None, "seen": False} | vars(errors)


def test_table_coverage_uses_the_stated_degrees_of_freedom():
    """A NEES of 9 is beyond the 95 % of a normal distribution (7.8), and within those of t with 4 (9.9)."""
    (_, normal) = summarise([clip("a", "normal", 1.0, np.inf, 9.0)])
    (_, tailed) = summarise([clip("a", "tailed", 1.0, 4.0, 9.0)])
    assert (normal["coverage_95"], tailed["coverage_95"]) == (0.0, 1.0)
    assert tailed["coverage_90"] == 0.0
