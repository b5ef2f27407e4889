"""Errors at frames, compared with the predictor at each weight and with walks of known errors."""

import numpy as np
import pytest
from builders.paper import VELOCITY_M_S, execute, line_m, made_errors

from experiments.paper.filters import TUNED_TIME_S
from experiments.paper.frames import HORIZONS_S, RULES, FrameJob, frames_of
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.recording import TrueHead
from gazempc.sim.sensor import load_sensor, observe
from predictors import ConstantVelocity, HeadObservation, HeadPose

N = 15  # the paper's steps, at 30 frames a second
FRAME_S = 1 / 30


def position_at(time_s, times_s, positions_m):
    """Position at a frame, or between two frames at most 0.1 s apart; None elsewhere."""
    later = [i for i, t in enumerate(times_s) if t >= time_s - 1e-6]
    if not later:
        return None
    i = later[0]
    if abs(times_s[i] - time_s) <= 1e-6:
        return positions_m[i]
    span_s = times_s[i] - times_s[i - 1]
    part = (time_s - times_s[i - 1]) / span_s
    return (1 - part) * positions_m[i - 1] + part * positions_m[i] if span_s <= 0.1 + 1e-9 else None


def sightings_of(name, seed=0):
    recording = load(name)
    placed = place(recording, "recorded" if recording.has_robot else "side", 2.5, 1.2)
    sensor = load_sensor("recorded" if recording.measured is not None else "reference")
    sensor = sensor.model_copy(update={"range_min_m": 0.5, "range_max_m": 5.46})
    return placed, [s.observation for s in observe(placed, sensor, seed)]


@pytest.mark.parametrize(
    ("name", "rule", "options"),
    [
        ("subject01_R4", "paper", {}),
        ("subject04_R5", "both", {"yaw_from": "travel", "offset_removed": True}),
    ],
)
def test_the_error_at_any_weight_is_that_of_the_predictor_run_with_it(name, rule, options):
    """For the paper's rule also against equations 1 to 5, d_kalman computed from the filter's state."""
    psd, weight = 0.01**2 / 30 / TUNED_TIME_S**4, 0.3
    placed, observations = sightings_of(name)
    kalman = ConstantVelocity(psd, 0.01, gated=False)
    head = HeadPose(weight, psd, 0.01, gated=False, **options)
    times_s, filtered, forecasts, by_hand = [], [], [], []
    F = np.eye(6) + FRAME_S * np.eye(6, k=3)
    for o in observations:
        kalman.update(o)
        head.update(o)
        _, x, _ = kalman.state()
        times_s.append(o.capture_time_s)
        filtered.append(x[:3])
        forecasts.append(head.forecast(o.capture_time_s + np.array(HORIZONS_S)).means_base_m)
        d_kalman = (F @ x - x)[:3]
        angle = head.relative_yaw_rad() or 0.0
        R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        by_hand.append(x[:3] + N * ((1 - weight) * d_kalman + weight * R @ d_kalman))
    row = execute(FrameJob(name, TUNED_TIME_S, tuple(RULES), 0))
    true_head = TrueHead(placed)
    for k, horizon_s in enumerate(HORIZONS_S):
        after = [position_at(t + horizon_s, times_s, filtered) for t in times_s]
        scored = [i for i, position in enumerate(after) if position is not None]
        assert len(scored) > 20
        (own,) = frames_of([row], rule=rule, horizon_s=horizon_s)
        expected = [1e3 * np.linalg.norm(forecasts[i][k] - after[i]) for i in scored]
        np.testing.assert_allclose(own.error_mm(weight), expected, atol=1e-3)
        (true,) = frames_of([row], "true", rule, horizon_s)
        then_m = true_head(np.array([times_s[i] for i in scored]) + horizon_s)
        expected = [1e3 * np.linalg.norm(forecasts[i][k] - m) for i, m in zip(scored, then_m, strict=True)]
        np.testing.assert_allclose(true.error_mm(weight), expected, atol=1e-3)
        if horizon_s == N * FRAME_S:
            expected = [1e3 * np.linalg.norm(by_hand[i] - after[i]) for i in scored]
            np.testing.assert_allclose(own.error_mm(weight), expected, atol=1e-3)
    assert np.abs(own.turn_m).max() > 0.01


def test_a_constant_head_yaw_rotates_the_step_by_that_angle(monkeypatch):
    """Rotating s by a moves its end by 2 s sin(a / 2), to the left of travel; the body faces x, travel is aside."""
    row = made_errors(monkeypatch, line_m(), rules=tuple(RULES), head_deg=20.0)
    heading_deg = np.degrees(np.arctan2(VELOCITY_M_S[1], VELOCITY_M_S[0]))
    for horizon_s in HORIZONS_S:
        for rule, angle_deg in (("paper", 20.0), ("travel direction", 20.0 - heading_deg)):
            (video,) = frames_of([row], rule=rule, horizon_s=horizon_s)
            np.testing.assert_allclose(video.yaw_deg[45:], angle_deg, atol=0.01)
            a = np.deg2rad(angle_deg)
            R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
            expected = horizon_s * (R @ VELOCITY_M_S - VELOCITY_M_S)
            np.testing.assert_allclose(video.turn_m[45:], np.tile(expected, (len(video.turn_m) - 45, 1)), atol=1e-5)
            error_mm = 2e3 * horizon_s * np.linalg.norm(VELOCITY_M_S) * np.sin(a / 2)
            np.testing.assert_allclose(video.error_mm(1.0)[45:], error_mm, atol=0.05)
    for rule in ("offset removed", "both"):
        (removed,) = frames_of([row], rule=rule)
        assert np.all(np.diff(np.abs(removed.yaw_deg[10:])) < 0)


def test_a_frame_without_observed_future_is_not_scored(monkeypatch):
    """Half a second is missing: earlier frames are scored only if the frame 15 later exists."""
    valid = np.ones(120, dtype=bool)
    valid[60:75] = False
    row = made_errors(monkeypatch, line_m(), valid=valid)
    scored = [i for i in range(105) if valid[i] and valid[i + 15]]
    (video,) = frames_of([row])
    kalman = ConstantVelocity(0.01**2 / 30 / TUNED_TIME_S**4, 0.01, gated=False)
    states = {}
    for i in np.flatnonzero(valid):
        kalman.update(HeadObservation(i / 30, line_m()[i]))
        states[i] = kalman.state()[1]
    expected = [states[i][:3] + 0.5 * states[i][3:] - states[i + 15][:3] for i in scored]
    np.testing.assert_allclose(video.base_m, expected, atol=1e-6)
