"""Forecast errors over recordings: known motions give known errors."""

import json

import numpy as np
import pytest
from bs4 import BeautifulSoup
from builders.own_parts import own_module

from experiments.forecast.command import forecast, main
from experiments.forecast.errors import forecast_errors
from gazempc.recordings.load import load
from gazempc.recordings.recording import Recording, Track
from gazempc.recordings.truth import TrueHead
from gazempc.sim.sensor import load_sensor
from predictors import ConstantVelocity, Forecast, HeadPose, LastPosition, Perfect

pytestmark = pytest.mark.usefixtures("in_this_process")

HORIZONS = np.array([0.25, 0.5, 1.0])
KEYS = {
    "predictor",
    "cues",
    "ratio_to_constant_velocity",
    "n_people_seen_in_fitting",
    "group",
    "horizon_s",
    "error_true_mm",
    "error_filtered_mm",
    "coverage_68",
    "coverage_95",
    "nees",
    "update_us",
    "n_clips",
    "n_frames",
}


def straight_walk(speed=1.2, heading=0.7, seconds=4.0, name="line"):
    t = np.arange(0, seconds, 1 / 30)
    position = np.stack([speed * t * np.cos(heading), speed * t * np.sin(heading), np.full_like(t, 1.6)], axis=1)
    quat = np.tile([1.0, 0, 0, 0], (t.size, 1))
    track = Track(position, quat, position - [0, 0, 0.6], quat, np.ones(t.size, dtype=bool))
    return Recording(name, "made here", "motion capture", t, track, None, True)


def test_last_position_errs_by_speed_times_horizon_along_the_path():
    errors = forecast_errors(straight_walk(), LastPosition(), load_sensor("perfect"), HORIZONS, 0)
    for i, horizon in enumerate(HORIZONS):
        parts = errors.difference_m[:, i][np.isfinite(errors.difference_m[:, i, 0])]
        assert parts[:, 0] == pytest.approx(-1.2 * horizon)
        assert parts[:, 1:] == pytest.approx(0.0, abs=1e-9)


def test_perfect_has_no_error_and_constant_velocity_next_to_none_on_a_line():
    walk = straight_walk()
    perfect = forecast_errors(walk, Perfect(TrueHead(walk)), load_sensor("perfect"), HORIZONS, 0)
    assert np.nanmax(np.abs(perfect.difference_m)) < 1e-12
    assert np.all(np.isnan(perfect.nees))
    steady = forecast_errors(walk, ConstantVelocity(), load_sensor("perfect"), HORIZONS, 0)
    late = steady.difference_m[30:]
    assert np.nanmax(np.abs(late)) < 0.002


def test_a_calibrated_forecast_has_nees_3_and_nominal_coverage(tmp_path):
    """Forecasts that are the truth plus noise of the stated covariance."""
    walk = straight_walk(seconds=60.0)
    truth, rng = TrueHead(walk), np.random.default_rng(0)
    spread = np.diag([0.01, 0.04, 0.0025])

    class Honest(Perfect):
        def forecast(self, times_s):
            forecast = super().forecast(times_s)
            noise = rng.multivariate_normal(np.zeros(3), spread, size=len(times_s))
            return Forecast(
                forecast.times_s,
                forecast.means_base_m + noise,
                np.tile(spread, (len(times_s), 1, 1)),
                forecast.issued_at_s,
            )

    nees = forecast_errors(walk, Honest(truth), load_sensor("perfect"), HORIZONS, 0).nees
    assert np.nanmean(nees) == pytest.approx(3.0, rel=0.03)
    known = nees[np.isfinite(nees)]
    assert np.mean(known <= 3.5059) == pytest.approx(0.68, abs=0.015)
    assert np.mean(known <= 7.8147) == pytest.approx(0.95, abs=0.01)


def test_the_command_writes_the_table(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("experiments.forecast.command._draw", lambda *_: [])
    words = ["--recordings", "subject01_R1", "subject02_R4", "--out", str(tmp_path), "--horizons", "0.5"]
    assert main([*words, "--predictors", "default", "last_position", "constant_velocity"]) == 0
    rows = json.loads((tmp_path / "summary.json").read_text())["rows"]
    assert all(set(row) >= KEYS for row in rows)
    assert {row["predictor"] for row in rows} == {"constant_velocity", "last_position", "walker"}
    assert {row["group"] for row in rows} == {"straight", "turn", "all"}
    everything = next(r for r in rows if r["group"] == "all" and r["predictor"] == "constant_velocity")
    parts = [r for r in rows if r["group"] != "all" and r["predictor"] == "constant_velocity"]
    assert everything["error_true_mm"] == pytest.approx(np.mean([r["error_true_mm"] for r in parts]))
    assert everything["n_frames"] == sum(r["n_frames"] for r in parts)
    assert "constant_velocity" in capsys.readouterr().out
    report = BeautifulSoup((tmp_path / "report.html").read_text(encoding="utf-8"), "html.parser")
    assert f"constant_velocity {everything['error_true_mm']:.0f} mm" in report.find(class_="answer").text
    over_horizon, by_clip = (json.loads(d.text) for d in report.find_all("script", type="application/json"))
    errors = {curve["label"]: curve["ys"] for curve in over_horizon["curves"]}
    assert errors["constant_velocity"] == [pytest.approx(everything["error_true_mm"], rel=1e-4)]
    of_clips = {curve["label"]: curve for curve in by_clip["curves"]}["constant_velocity"]
    assert of_clips["xs"] == pytest.approx(sorted(r["error_true_mm"] for r in parts), rel=1e-4)
    assert sorted(of_clips["names"]) == ["subject01_R1", "subject02_R4"]


def test_hidden_cues_are_not_seen():
    """The paper's rule without one of its two angles is the filter alone; with both it is not."""
    walk = load("subject04_R5")
    sensor = load_sensor("reference")
    plain = forecast_errors(walk, ConstantVelocity(), sensor, HORIZONS, 0)
    for cues in ("head", "pelvis", "none"):
        blind = forecast_errors(walk, HeadPose(), sensor, HORIZONS, 0, cues)
        np.testing.assert_array_equal(blind.difference_m, plain.difference_m)
    assert not np.array_equal(forecast_errors(walk, HeadPose(), sensor, HORIZONS, 0).difference_m, plain.difference_m)


def test_people_who_stand_are_compared_with_the_last_position_too(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.forecast.command._draw", lambda *_: [])
    shown = ["--predictors", "constant_velocity", "last_position", "--horizons", "0.5", "--jobs", "1"]
    people = ["--recordings", "subject01_stand", "subject02_gesture", "subject01_R1"]
    assert main([*people, *shown, "--out", str(tmp_path)]) == 0
    rows = json.loads((tmp_path / "summary.json").read_text())["rows"]
    assert [r["group"] for r in rows[:5] if r["kind"] == "all"] == ["standing", "straight", "all"]
    error_mm = {(r["predictor"], r["group"], r["kind"]): r["error_true_mm"] for r in rows}
    for r in rows:
        for name in ("constant_velocity", "last_position"):
            own = r["error_true_mm"] / error_mm[name, r["group"], r["kind"]]
            assert r[f"ratio_to_{name}"] == pytest.approx(own)
    lines = [line.split(" | ") for line in (tmp_path / "summary.md").read_text().splitlines() if line.startswith("| ")]
    at = lines[0].index("ratio to last_position")
    of_cv = {line[2]: line[at] for line in lines if line[0] == "| constant_velocity" and line[3] == "all"}
    assert float(of_cv["standing"]) == pytest.approx(
        error_mm["constant_velocity", "standing", "all"] / error_mm["last_position", "standing", "all"], abs=0.005
    )
    assert float(of_cv["standing"]) > 1.0
    assert of_cv["straight"] == "-"


def test_one_table_has_the_errors_over_the_frame_rate(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.forecast.command._draw", lambda *_: [])
    words = ["--recordings", "subject01_R1", "--predictors", "constant_velocity", "last_position", "--jobs", "1"]
    assert (
        main([*words, "--rates", "10", "2.5", "--sensors", "reference", "--horizons", "0.4", "--out", str(tmp_path)])
        == 0
    )
    rows = json.loads((tmp_path / "summary.json").read_text())["rows"]
    text = (tmp_path / "summary.md").read_text()
    table = text.split("## By frame rate, sensor reference")[1].split("##")[0]
    header, _, cv, last = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("|")]
    assert header[3:] == ["2.5 Hz", "10 Hz"]
    for line, name in ((cv, "constant_velocity"), (last, "last_position")):
        for cell, rate in zip(line[3:], header[3:], strict=True):
            (row,) = [
                r for r in rows if (r["predictor"], r["group"], r["sensor"]) == (name, "all", f"reference at {rate}")
            ]
            assert cell == f"{row['error_true_mm']:.0f} ({row['ratio_to_constant_velocity']:.2f})"
    assert "By frame rate" in (tmp_path / "report.html").read_text()


def test_a_predictor_of_ones_own_is_compared_with_its_options_and_under_its_name(tmp_path, monkeypatch):
    """With the settings of `constant_velocity` it errs as that does; with others it does not."""
    own = own_module(tmp_path, monkeypatch)
    words = {"recordings": ["subject01_R4"], "predictors": ["constant_velocity", f"{own}:Steady"], "jobs": 1}
    plain, steady = forecast(**words, out=tmp_path / "out").results
    assert (plain.predictor, steady.predictor) == ("constant_velocity", "steady")
    np.testing.assert_array_equal(plain.errors.difference_m, steady.errors.difference_m)
    _, other = forecast(**words, options={"psd": 0.5}, out=tmp_path / "out").results
    assert not np.array_equal(plain.errors.difference_m, other.errors.difference_m)
    assert len(list((tmp_path / "out" / "runs").iterdir())) == 3


def test_a_predictor_that_fails_is_named_with_the_recordings(tmp_path, monkeypatch, capsys):
    fails = "\n\nclass Failing(Steady):\n    def forecast(self, times_s):\n        raise TypeError('no')\n"
    own = own_module(tmp_path, monkeypatch, "failing_parts", more=fails)
    words = ["--recordings", "subject01_R1", "subject01_R4", "--predictors", f"{own}:Failing", "last_position"]
    assert main([*words, "--jobs", "1", "--out", str(tmp_path / "out")]) == 4
    assert f"failed: {own}:Failing on subject01_R1: predictor steady: " in capsys.readouterr().out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert {(f["recording"], f["predictor"]) for f in summary["failed"]} == {
        (name, f"{own}:Failing") for name in ("subject01_R1", "subject01_R4")
    }
    assert all("no" in f["failed"] for f in summary["failed"])
    assert {(row["predictor"], row["group"]) for row in summary["rows"]} == {
        ("last_position", group) for group in ("straight", "turn", "all")
    }
