"""Constant velocity: the gate, track replacement, and the filter against direct Gaussian solves."""

import numpy as np
import pytest
from builders.people import FRAME_S, WALK_M_S, posterior, seen, velocity_kernel, walk
from hypothesis import given
from hypothesis import strategies as st

from predictors import ConstantVelocity, HeadObservation
from predictors.gate import is_near

SPEED_M_S = np.array([1.2, 0.0, 0.0])
ASIDE_M = np.array([0.0, 1.0, 0.0])
RATES_HZ = [4.0, 10.0, 30.0, 60.0]


def person(time_s):
    return np.array([-2.0, 2.5, 0.4]) + time_s * SPEED_M_S


def show(cv, at, since_s, until_s, rate_hz=30.0):
    """Update with a person with 5 mm of noise; returns the observations."""
    rng = np.random.default_rng(7)
    shown = []
    for k in range(round(since_s * rate_hz), round(until_s * rate_hz)):
        shown.append(HeadObservation(k / rate_hz, at(k / rate_hz) + 0.005 * rng.standard_normal(3)))
        cv.update(shown[-1])
    return shown


def off_m(cv, at):
    time_s, state, _ = cv.state()
    return float(np.linalg.norm(state[:3] - at(time_s)))


@pytest.mark.parametrize("since_s", [1 / 30, 0.25, 1.0])
def test_the_edge_is_the_quantile_with_an_allowance_that_grows_with_the_gap(since_s):
    """16.266 is the 99.9 % quantile of chi-square with 3 degrees of freedom in printed tables."""
    edge_m = np.sqrt(16.266 * (0.02**2 + (0.5 * 1.25 * (since_s + 0.2) ** 2) ** 2))
    for factor, near in ((0.999, True), (1.001, False)):
        assert is_near(np.array([0.0, factor * edge_m, 0.0]), 0.02**2 * np.eye(3), since_s) is near
    assert not is_near(np.array([np.nan, 0.0, 0.0]), np.eye(3), since_s)


def test_only_spikes_are_refused():
    """10 % of the frames of a minute, 0.2 to 0.5 m."""
    rng, cv, wrong, good = np.random.default_rng(1), ConstantVelocity(), [], []
    for k in range(1800):
        spike = k > 10 and rng.random() < 0.1
        aside = rng.standard_normal(3)
        aside *= rng.uniform(0.2, 0.5) / np.linalg.norm(aside)
        seen_m = person(k / 30) + 0.01 * rng.standard_normal(3) + spike * aside
        cv.update(HeadObservation(k / 30, seen_m))
        (wrong if spike else good).append(cv.rejections_in_a_row > 0)
    assert np.mean(wrong) > 0.97
    assert np.mean(good) < 0.01


def test_a_tracker_noisier_than_stated_is_soon_accepted():
    """Range noise of 15 % with 10 mm stated: after a second nearly all frames are used."""
    rng, cv, refused = np.random.default_rng(2), ConstantVelocity(), []
    for k in range(150):
        cv.update(HeadObservation(k / 30, person(k / 30) * (1.0 + 0.15 * rng.standard_normal())))
        refused.append(cv.rejections_in_a_row > 0)
    assert np.mean(refused[30:]) < 0.1


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_a_passer_by_of_0_7_s_does_not_move_the_track(rate_hz):
    """Also where the growing gate includes the other person."""
    cv = ConstantVelocity()
    for period in range(4):
        begin_s = 1.8 * period
        show(cv, person, begin_s, begin_s + 1.1, rate_hz)
        show(cv, lambda t: person(t) + ASIDE_M, begin_s + 1.1, begin_s + 1.8, rate_hz)
        assert off_m(cv, person) < 0.15
    assert cv.started_at_s == 0.0


@pytest.mark.parametrize("rate_hz", [2.5, *RATES_HZ])
def test_a_lasting_jump_is_followed_within_about_a_second(rate_hz):
    """With the velocity observed meanwhile."""

    def elsewhere(time_s):
        return np.array([2.0, -1.0 - time_s, 0.4])

    cv = ConstantVelocity()
    show(cv, person, 0.0, 2.4, rate_hz)
    show(cv, elsewhere, 2.4, 3.0, rate_hz)
    assert off_m(cv, elsewhere) > 1.0
    show(cv, elsewhere, 3.0, 2.4 + 1.01, rate_hz)
    assert off_m(cv, elsewhere) < 0.03
    np.testing.assert_allclose(cv.state()[1][3:], [0.0, -1.0, 0.0], atol=0.1)


def test_a_track_with_a_false_first_detection_is_replaced_at_once():
    cv = ConstantVelocity()
    cv.update(HeadObservation(0.0, person(0.0) + 3.0 * ASIDE_M))
    show(cv, person, 1 / 30, 0.1)
    assert off_m(cv, person) < 0.02


def named(cv, at, since_s, until_s, name):
    for k in range(round(30 * since_s), round(30 * until_s)):
        cv.update(HeadObservation(k / 30, at(k / 30), person_id=name))


def aside_of_person(time_s):
    return person(time_s) + ASIDE_M


def test_a_jump_with_another_name_is_refused_for_longer():
    cv = ConstantVelocity()
    named(cv, person, 0.0, 2.0, "ann")
    named(cv, aside_of_person, 2.0, 3.2, "bob")
    assert off_m(cv, person) < 0.05
    named(cv, person, 3.2, 4.0, "ann")
    assert cv.rejections_in_a_row == 0
    named(cv, aside_of_person, 4.0, 5.6, "bob")
    assert off_m(cv, aside_of_person) < 0.02
    named(cv, person, 5.6, 6.8, "ann")  # now the track is the other person's
    assert off_m(cv, aside_of_person) < 0.05


def test_after_a_gap_another_name_must_match_the_predicted_position():
    """0.4 m aside after 0.4 s may be the same person turning, but not under another name."""

    def turned(time_s):
        return person(time_s) + 0.4 * ASIDE_M

    for name, refused in (("ann", 0), ("bob", 1)):
        cv = ConstantVelocity()
        named(cv, person, 0.0, 2.0, "ann")
        named(cv, turned, 2.4, 2.4 + 1 / 30, name)
        assert cv.rejections_in_a_row == refused


# ---------------------------------------------------------------- the filter


@given(
    steps_s=st.lists(st.sampled_from([0.004, 0.02, FRAME_S, 0.05, 0.4, 2.0]), min_size=1, max_size=25),
    psd=st.sampled_from([0.01, 0.05, 1.0]),
    noise_m=st.sampled_from([0.003, 0.01, 0.05]),
    seed=st.integers(0, 1000),
)
def test_filter_is_the_exact_gaussian_posterior_for_irregular_stamps(steps_s, psd, noise_m, seed):
    rng = np.random.default_rng(seed)
    seen_s = 5.0 + np.concatenate([[0.0], np.cumsum(steps_s)])
    seen_m = np.array([3.0, -1.0, 0.5]) + (seen_s[:, None] - 5.0) * WALK_M_S
    seen_m = seen_m + 0.5 * noise_m * rng.standard_normal(seen_m.shape)
    cv = ConstantVelocity(acceleration_psd=psd, position_noise_m=noise_m)
    observations = [HeadObservation(time_s, position_m) for time_s, position_m in zip(seen_s, seen_m, strict=True)]
    for observation in observations:
        cv.update(observation)
        assert cv.rejections_in_a_row == 0
    times_s = seen_s[-1] + np.array([0.0, 0.01, 0.25, 0.5, 1.0])
    forecast = cv.forecast(times_s)
    means, covariances = posterior(observations, times_s, velocity_kernel(psd), noise_m)
    np.testing.assert_allclose(forecast.means_base_m, means, rtol=0, atol=1e-9)
    np.testing.assert_allclose(forecast.covariances_m2, covariances, rtol=1e-9, atol=1e-9)
    assert forecast.issued_at_s == seen_s[-1]


def show_jumps(cv, count):
    """Update with a position 0.5 m aside for some frames; returns the last time and position."""
    end_s = walk(cv)
    jump = cv.forecast(end_s).means_base_m[0] + [0.0, 0.5, 0.0]
    for i in range(1, count + 1):
        cv.update(seen(end_s + i * FRAME_S, jump + 0.001 * i))
    return end_s + count * FRAME_S, jump + 0.001 * count


def test_after_0_75_s_the_refused_observations_become_the_track():
    """With its full history: as a filter of these observations alone."""
    cv, fresh = ConstantVelocity(), ConstantVelocity()
    end_s, place_m = show_jumps(cv, 24)
    for i in range(1, 25):
        fresh.update(seen(end_s - (24 - i) * FRAME_S, place_m - 0.001 * (24 - i)))
    for mine, expected in zip(cv.state(), fresh.state(), strict=True):
        np.testing.assert_allclose(mine, expected, rtol=0, atol=1e-12)
    assert cv.forecast(end_s).issued_at_s == end_s
    assert cv.started_at_s == pytest.approx(end_s - 23 * FRAME_S)
    assert len(cv.accepted) == 24
    assert cv.rejections_in_a_row == 0


def test_ungated_is_the_plain_filter_of_all_observations():
    """One outlier: the exact posterior with it (ungated) or without it (gated)."""
    times_s = np.arange(40) * FRAME_S
    positions_m = np.array([2.0, 1.0, 0.4]) + times_s[:, None] * WALK_M_S
    positions_m[30] += [0.0, 3.0, 0.0]
    observations = [HeadObservation(t, position) for t, position in zip(times_s, positions_m, strict=True)]
    for gated in (False, True):
        cv = ConstantVelocity(gated=gated)
        for observation in observations:
            cv.update(observation)
        used = [o for k, o in enumerate(observations) if k != 30 or not gated]
        ahead_s = times_s[-1] + np.array([0.0, 0.5])
        means, covariances = posterior(used, ahead_s, velocity_kernel(0.05), 0.01)
        forecast = cv.forecast(ahead_s)
        np.testing.assert_allclose(forecast.means_base_m, means, atol=1e-6)
        np.testing.assert_allclose(forecast.covariances_m2, covariances, atol=1e-6)
