"""Metrics of whom the gaze was on, against logs whose figures are known by hand."""

from dataclasses import replace

import numpy as np
import pytest
from builders.attention import TICK_S, attention_log, error_in

from gazempc.results.attention import attention_lines, measure_attention

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


def test_overshoot_is_that_of_the_worst_switch():
    """Past the first person by 0.5 deg, past the second by 3 deg; a person who was near from the start counts not."""
    error_deg = error_in(12.0, 20.0)
    time_s = TICK_S * np.arange(error_deg.size)
    error_deg[time_s >= 5.0] = -0.5
    error_deg[time_s >= 8.0] = -30.0
    error_deg[time_s >= 10.0] = 3.0
    error_deg[time_s >= 11.5] = 9.0  # a second after arrival
    assert measure_attention(attention_log(error_deg, TWO_SWITCHES)).switch_overshoot_deg == pytest.approx(3.0)
    assert np.isnan(measure_attention(attention_log(error_deg, TWO_SWITCHES[:1])).switch_overshoot_deg)


def test_looks_away_against_their_schedule():
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
