"""Metrics of attention, framing and starts, against logs with metrics computed by hand."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from builders.attention import TICK_S, attention_log, error_in, of_motion

import gazempc as gz
from gazempc.neck.picture import Framing
from gazempc.results.attention import attention_lines, measure_attention
from gazempc.results.metrics import measure

TWO_SWITCHES = ((0.0, 1, "policy"), (4.0, 2, "policy"), (8.0, 0, "left"), (9.0, 3, "policy"))


def test_switches_and_the_time_to_contact_after_each():
    log = attention_log(error_in(12.0, 20.0, (0.5, 4.0), (4.7, 8.0), (10.1, 12.0)), TWO_SWITCHES)
    found = measure_attention(log)
    assert found.switches_per_minute == pytest.approx(2 / 12.0 * 60.0)
    assert found.time_to_contact_after_switch_s == pytest.approx(np.median([0.7, 1.1]))
    assert found.switches_without_contact == 0


def test_a_switch_without_contact_before_the_next_one_is_counted():
    log = attention_log(error_in(12.0, 20.0, (0.5, 4.0), (10.1, 12.0)), TWO_SWITCHES)
    found = measure_attention(log)
    assert found.switches_without_contact == 1
    assert found.time_to_contact_after_switch_s == pytest.approx(1.1)
    assert "1 without contact" in attention_lines(found)[0]


def test_overshoot_is_the_maximum_over_switches():
    """Overshoot of 0.5 deg at the first person, 3 deg at the second; a switch that starts near is excluded."""
    error_deg = error_in(12.0, 20.0)
    time_s = TICK_S * np.arange(error_deg.size)
    error_deg[time_s >= 5.0] = -0.5
    error_deg[time_s >= 8.0] = -30.0
    error_deg[time_s >= 10.0] = 3.0
    error_deg[time_s >= 11.5] = 9.0  # a second after arrival
    assert measure_attention(attention_log(error_deg, TWO_SWITCHES)).switch_overshoot_deg == pytest.approx(3.0)
    assert np.isnan(measure_attention(attention_log(error_deg, TWO_SWITCHES[:1])).switch_overshoot_deg)


def test_look_away_delays_are_relative_to_the_schedule():
    """Of 10 s, 9 are scored; the gaze leaves 0.1 s late and is back 0.2 s late, then 0.1 s early and 0.1 s late."""
    planned = ((2.0, 3.0, "listening"), (6.0, 8.0, "listening"))
    log = attention_log(error_in(10.0, 15.0, (0.0, 2.1), (3.2, 5.9), (8.1, 10.1)), away=planned)
    found = measure_attention(log)
    assert found.away_duration_ratio == pytest.approx((1.1 + 2.2) / 3.0, abs=0.01)
    assert found.away_interval_ratio == pytest.approx(3.8 / 4.0, abs=0.01)
    assert found.return_late_s == pytest.approx(np.median([0.2, 0.1]), abs=0.006)
    assert found.return_late_p95_s == pytest.approx(np.percentile([0.2, 0.1], 95), abs=0.006)
    assert found.away_share_planned == pytest.approx(3.0 / 9.0, abs=0.002)
    assert found.away_share == pytest.approx((0.9 + 2.0) / 9.0, abs=0.002)
    assert found.contact_attended == pytest.approx(1.0 - (0.2 + 0.1 + 0.1) / 6.0, abs=0.003)


def test_with_an_unknown_true_head_only_switches_are_counted():
    log = attention_log(error_in(12.0, 20.0), TWO_SWITCHES, kind="live")
    found = measure_attention(replace(log, head_true_base_m=np.full_like(log.head_true_base_m, np.nan)))
    assert found.switches_per_minute == pytest.approx(10.0)
    unknown = (found.contact_attended, found.identity_swaps, found.switches_without_contact)
    assert np.isnan(unknown).all()
    assert attention_lines(found) == ["10.0 switches a minute"]


# ---------------------------------------------------------------- the picture


def log_of(pan_deg, framing, captures_s=()):
    """6 s of a head straight ahead, with a camera at a given pan."""
    time_s = np.arange(0.0, 6.0, TICK_S)
    joints = np.radians(np.stack([pan_deg(time_s), np.zeros(time_s.size)], axis=-1))
    log = attention_log([0.0], captures_s=captures_s, settings={"framing": framing.model_dump(mode="json")})
    return of_motion(log, time_s, joints, np.tile([2.5, 0.0, 0.0], (time_s.size, 1)))


FRAMING = Framing(view_deg=(60.0, 34.0), zone=(0.2, 0.2), headroom=0.5)  # 6 deg to each side


def test_time_in_zone_is_the_share_of_ticks_within_half_the_zone():
    metrics = gz.measure(log_of(lambda t: 2.0 * t, FRAMING))  # 6 deg off at 3 s; 1 to 6 s are scored
    assert metrics.time_in_zone == pytest.approx(2.0 / 5.0, abs=0.01)


def test_headroom_shifts_the_zone():
    assert gz.measure(log_of(np.zeros_like, FRAMING)).time_in_zone == 1.0
    high = FRAMING.model_copy(update={"headroom": 0.3})  # 6.8 deg of 34, the zone has 3.4
    assert gz.measure(log_of(np.zeros_like, high)).time_in_zone == 0.0


def test_without_a_framed_person_time_in_zone_is_nan():
    for subject in ("no", "all"):
        off = FRAMING.model_copy(update={"subject": subject})
        assert np.isnan(gz.measure(log_of(np.zeros_like, off)).time_in_zone)


def test_reversals_and_travel_of_a_sine():
    """5 s of a sine of 2 deg and 1 s: two reversals and 8 deg a second."""
    metrics = gz.measure(log_of(lambda t: 2.0 * np.sin(2.0 * np.pi * t), FRAMING))
    assert metrics.reversals_per_min == pytest.approx(120.0, rel=0.11)
    assert metrics.travel_deg_per_min == pytest.approx(480.0, rel=0.01)
    calm = gz.measure(log_of(lambda t: 0.2 * np.sin(2.0 * np.pi * t), FRAMING))
    assert calm.reversals_per_min == 0.0


def test_time_to_reacquire_counts_from_the_first_observation_after_a_gap():
    captures = np.concatenate([np.arange(0.0, 2.0, 0.1), np.arange(3.0, 5.0, 0.1)])
    log = log_of(lambda t: np.where(t < 4.0, 10.0, 0.0), FRAMING, captures)
    assert gz.measure(log).time_to_reacquire_s == pytest.approx(4.0 - 3.1, abs=0.01)
    assert np.isnan(gz.measure(log_of(np.zeros_like, FRAMING)).time_to_reacquire_s)


# ---------------------------------------------------------------- starts


def gazing(off_deg, y_m=0.0, captures_s=(), **changes):
    """A run with the given gaze error about the vertical at each tick; y of the head may vary."""
    count = off_deg.size
    head_m = np.column_stack([np.full(count, 2.5), np.full(count, 1.0) * y_m, np.zeros(count)])
    pan_rad = np.arctan2(head_m[:, 1], head_m[:, 0]) + np.deg2rad(off_deg)
    joints, log = np.column_stack([pan_rad, np.zeros(count)]), attention_log([0.0], captures_s=captures_s)
    return of_motion(log, TICK_S * np.arange(count), joints, head_m, **changes)


def starter(seconds=8.0):
    """Times and y of a person who starts at 2.0 s with 1 m/s^2 up to 1 m/s: 0.3 m/s at 2.3 s."""
    t = TICK_S * np.arange(round(seconds / TICK_S))
    ramp_s = np.clip(t - 2.0, 0.0, 1.0)
    return t, 0.5 * ramp_s**2 + np.maximum(t - 3.0, 0.0)


@pytest.mark.parametrize(
    ("off", "expected_s"),
    [
        ([], 0.0),  # never
        ([(2.5, 3.1)], 0.8),
        ([(2.5, 3.1), (3.4, 4.0)], 1.7),  # 0.3 s between are not sustained
        ([(2.0, 3.0)], 0.7),  # contact lost before the start
        ([(4.0, 5.0)], 0.0),  # unrelated to the start
        ([(2.5, 8.0)], 5.7),  # to the end
        ([(2.5, 7.7)], 5.7),  # contact of 0.3 s at the end is not sustained
    ],
)
def test_time_to_contact_after_a_start(off, expected_s):
    t, y_m = starter()
    off_deg = np.zeros(t.size)
    for from_s, to_s in off:
        off_deg[(t >= from_s) & (t < to_s)] = 6.0
    assert measure(gazing(off_deg, y_m)).time_from_start_to_contact_s == pytest.approx(expected_s, abs=0.04)


def test_a_planned_look_away_does_not_lose_contact():
    t, y_m = starter()
    off_deg = np.where((t >= 2.5) & (t < 3.1), 6.0, 0.0)
    log = gazing(off_deg, y_m)
    away = {"away_start_s": np.array([2.4]), "away_end_s": np.array([3.2]), "away_why": np.array(["glance"])}
    assert measure(dataclasses.replace(log, **away)).time_from_start_to_contact_s == 0.0


def standing(off_m, seconds=12.0, rate_hz=30.0):
    """A run whose 0.5 s forecasts have a lateral error, `off_m` of the capture times."""
    captures_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    observed_m = np.tile([2.5, 0.0, 0.0], (captures_s.size, 1))
    means_m = np.repeat(observed_m[:, None], 3, axis=1)
    means_m[:, 1] += off_m(captures_s)
    means_m[:, 2] += 9.0  # the horizon of 1 s is ignored
    seen = {"head_observed_base_m": observed_m, "forecast_mean_base_m": means_m}
    return gazing(np.zeros(round(seconds / TICK_S)), captures_s=captures_s, **seen)


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
def test_false_starts_are_counted_per_minute(episodes, size_m, count):
    def off_m(capture_s):
        inside = np.zeros(capture_s.size, dtype=bool)
        for from_s, to_s in episodes:
            inside |= (capture_s >= from_s) & (capture_s < to_s)
        return np.where(inside[:, None], size_m, 0.0)

    minutes = (12.0 - 1 / 30) / 60.0
    assert measure(standing(off_m)).false_starts_per_min == pytest.approx(count / minutes)


def test_a_framing_of_an_older_version_has_no_metrics():
    log = log_of(np.zeros_like, FRAMING)
    old = log.run.model_copy(update={"settings": {"framing": {"subject": "one", "zone": "wide"}}})
    assert np.isnan(gz.measure(replace(log, run=old)).time_in_zone)
