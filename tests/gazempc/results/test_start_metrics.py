"""Contact after a start of motion, and forecasts of steps that are not taken: logs made by hand, counted by hand."""

import dataclasses

import numpy as np
import pytest
from builders.attention import attention_log, of_motion
from builders.replays import run_info

from gazempc.results.metrics import measure

TICK_S = 0.005
TEMPLATE = attention_log(np.zeros(10))


def gazing(off_deg, x_m=2.5, y_m=0.0):
    """A run whose gaze is off the head by angles about the vertical, a tick each; x and y of the head may vary."""
    count = off_deg.size
    time_s = TICK_S * np.arange(count)
    head_m = np.column_stack([np.full(count, 1.0) * x_m, np.full(count, 1.0) * y_m, np.zeros(count)])
    pan_rad = np.arctan2(head_m[:, 1], head_m[:, 0]) + np.deg2rad(off_deg)
    return of_motion(TEMPLATE, time_s, np.column_stack([pan_rad, np.zeros(count)]), head_m, run=run_info())


def starter(seconds=8.0):
    """Times, and y of one who starts at 2.0 s with 1 m/s^2 up to 1 m/s, whose speed passes 0.3 m/s at 2.3 s."""
    t = TICK_S * np.arange(round(seconds / TICK_S))
    ramp_s = np.clip(t - 2.0, 0.0, 1.0)
    return t, 0.5 * ramp_s**2 + np.maximum(t - 3.0, 0.0)


def time_to_contact_s(off_deg):
    _, y_m = starter()
    return measure(gazing(off_deg, y_m=y_m)).time_from_start_to_contact_s


@pytest.mark.parametrize(
    ("off", "expected_s"),
    [
        ([], 0.0),  # never
        ([(2.5, 3.1)], 0.8),
        ([(2.5, 3.1), (3.4, 4.0)], 1.7),  # 0.3 s between are not sustained
        ([(2.0, 3.0)], 0.7),  # out of contact before the start already
        ([(4.0, 5.0)], 0.0),  # nothing to do with the start
        ([(2.5, 8.0)], 5.7),  # to the end
        ([(2.5, 7.7)], 5.7),  # contact of 0.3 s at the end is not sustained
    ],
)
def test_contact_after_a_start(off, expected_s):
    t, _ = starter()
    off_deg = np.zeros(t.size)
    for from_s, to_s in off:
        off_deg[(t >= from_s) & (t < to_s)] = 6.0
    assert time_to_contact_s(off_deg) == pytest.approx(expected_s, abs=0.04)


def test_a_planned_look_away_does_not_lose_contact():
    t, y_m = starter()
    off_deg = np.where((t >= 2.5) & (t < 3.1), 6.0, 0.0)
    log = gazing(off_deg, y_m=y_m)
    away = {"away_start_s": np.array([2.4]), "away_end_s": np.array([3.2]), "away_why": np.array(["glance"])}
    assert measure(dataclasses.replace(log, **away)).time_from_start_to_contact_s == 0.0


def standing(off_m, seconds=12.0, y_m=0.0, rate_hz=30.0):
    """A run whose forecasts for 0.5 s lie aside of the observed head, by `off_m` of the capture times."""
    log = gazing(np.zeros(round(seconds / TICK_S)), y_m=y_m)
    capture_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    observed_m = np.column_stack([np.full(capture_s.size, 2.5), np.zeros((capture_s.size, 2))])
    means_m = np.repeat(observed_m[:, None], 3, axis=1)
    means_m[:, 1] += off_m(capture_s)
    means_m[:, 2] += 9.0  # the horizon of 1 s does not count
    return dataclasses.replace(
        log,
        capture_time_s=capture_s,
        arrival_time_s=capture_s,
        head_observed_base_m=observed_m,
        person_id=np.full(capture_s.size, ""),
        forecast_mean_base_m=means_m,
        forecast_true_base_m=np.full(means_m.shape, np.nan),
        forecast_covariance_m2=np.full((*means_m.shape, 3), np.nan),
        forecast_degrees_of_freedom=np.full(capture_s.size, np.nan),
    )


@pytest.mark.parametrize(
    ("episodes", "size_m", "count"),
    [
        ([], 0.0, 0),
        ([(2.0, 3.0)], (0.0, 0.35, 0.0), 1),
        ([(2.0, 3.0), (3.3, 4.0)], (0.35, 0.0, 0.0), 1),  # 0.3 s apart
        ([(2.0, 3.0), (4.0, 4.2), (9.0, 9.1)], (0.25, -0.25, 0.0), 3),
        ([(2.0, 3.0)], (0.28, 0.0, 0.0), 0),  # too short
        ([(2.0, 3.0)], (0.0, 0.0, 5.0), 0),  # upward
    ],
)
def test_false_starts_are_episodes_a_minute(episodes, size_m, count):
    def off_m(capture_s):
        inside = np.zeros(capture_s.size, dtype=bool)
        for from_s, to_s in episodes:
            inside |= (capture_s >= from_s) & (capture_s < to_s)
        return np.where(inside[:, None], size_m, 0.0)

    minutes = (12.0 - 1 / 30) / 60.0
    assert measure(standing(off_m)).false_starts_per_min == pytest.approx(count / minutes)
