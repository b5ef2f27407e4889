"""Metrics of the picture, on logs whose answers are known."""

import dataclasses

import numpy as np
import pytest
from builders.attention import of_motion
from builders.recordings import reordered, synthetic
from builders.replays import QUICK, replayed

import gazempc as gz
from gazempc.neck.picture import Framing

NECK = gz.load_neck("reference")
TICKS = 1200


@pytest.fixture(scope="module")
def replay_log():
    return replayed(reordered(synthetic("subject03_R1"), range(60)), "reactive", settings=QUICK, neck=NECK)


def log_of(replay_log, pan_deg, framing, capture_time_s=None):
    """A head straight ahead, seen by a camera with a given pan."""
    time_s = np.arange(TICKS) * NECK.servo_period_s
    joints = np.radians(np.stack([pan_deg(time_s), np.zeros(TICKS)], axis=-1))
    settings = {"framing": framing.model_dump(mode="json")}
    run = replay_log.run.model_copy(update={"settings": settings})
    log = of_motion(replay_log, time_s, joints, np.tile([2.5, 0.0, 0.0], (TICKS, 1)), run=run)
    if capture_time_s is None:
        return log
    fields = ("head_observed_base_m", "person_id", "forecast_mean_base_m", "forecast_covariance_m2")
    fields += ("forecast_degrees_of_freedom", "forecast_true_base_m")
    few = {name: getattr(log, name)[: capture_time_s.size] for name in fields}
    return dataclasses.replace(log, capture_time_s=capture_time_s, arrival_time_s=capture_time_s + 0.1, **few)


FRAMING = Framing(view_deg=(60.0, 34.0), zone=(0.2, 0.2), headroom=0.5)  # 6 deg to each side


def test_time_in_zone_is_the_share_of_ticks_within_half_the_zone(replay_log):
    metrics = gz.measure(log_of(replay_log, lambda t: 2.0 * t, FRAMING))  # 6 deg off at 3 s; 1 to 6 s are scored
    assert metrics.time_in_zone == pytest.approx(2.0 / 5.0, abs=0.01)


def test_headroom_moves_the_zone(replay_log):
    assert gz.measure(log_of(replay_log, np.zeros_like, FRAMING)).time_in_zone == 1.0
    high = FRAMING.model_copy(update={"headroom": 0.3})  # 6.8 deg of 34, the zone has 3.4
    assert gz.measure(log_of(replay_log, np.zeros_like, high)).time_in_zone == 0.0


def test_without_a_framing_of_one_person_the_zone_is_not_known(replay_log):
    for subject in ("no", "all"):
        off = FRAMING.model_copy(update={"subject": subject})
        assert np.isnan(gz.measure(log_of(replay_log, np.zeros_like, off)).time_in_zone)


def test_reversals_and_travel_of_a_swing(replay_log):
    """5 s of a sine of 2 deg and 1 s: two reversals and 8 deg a second."""
    metrics = gz.measure(log_of(replay_log, lambda t: 2.0 * np.sin(2.0 * np.pi * t), FRAMING))
    assert metrics.reversals_per_min == pytest.approx(120.0, rel=0.11)
    assert metrics.travel_deg_per_min == pytest.approx(480.0, rel=0.01)
    calm = gz.measure(log_of(replay_log, lambda t: 0.2 * np.sin(2.0 * np.pi * t), FRAMING))
    assert calm.reversals_per_min == 0.0


def test_time_to_reacquire_counts_from_the_first_observation_after_a_gap(replay_log):
    captures = np.concatenate([np.arange(0.0, 2.0, 0.1), np.arange(3.0, 5.0, 0.1)])
    log = log_of(replay_log, lambda t: np.where(t < 4.0, 10.0, 0.0), FRAMING, captures)
    assert gz.measure(log).time_to_reacquire_s == pytest.approx(4.0 - 3.1, abs=0.01)
    assert np.isnan(gz.measure(log_of(replay_log, np.zeros_like, FRAMING)).time_to_reacquire_s)
