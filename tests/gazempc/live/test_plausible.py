"""Heads that cannot be are refused; what people and trackers do is not."""

import dataclasses

import numpy as np
import pytest
from builders.checks import assert_sound
from builders.faults import between
from builders.live import run_live

from gazempc.live.plausibility import Plausibility
from gazempc.settings import LoopSettings

FRAME_S = 1 / 30


def refused(heads_m, frame_s=FRAME_S, names=None):
    """Which of some frames are refused."""
    judge, names = Plausibility(), names or [None] * len(heads_m)
    return [bool(judge.refusal(k * frame_s, np.asarray(head), names[k])) for k, head in enumerate(heads_m)]


@pytest.mark.parametrize(
    "head_m", [[0.0, 0.0, 0.0], [0.1, 0.1, 0.1], [1e9, 0.0, 0.0], [20.0, 23.0, 0.0], [3.0, 0.0, 3.1], [3.0, 0.0, -3.1]]
)
def test_a_head_that_is_nowhere_is_refused(head_m):
    assert refused([[3.0, 0.0, 2.9], head_m, [0.21, 0.0, 0.0]]) == [False, True, False]


@pytest.mark.parametrize("rate_hz", [10, 200])
def test_who_flies_is_refused_after_half_a_second_and_until_they_slow_down(rate_hz):
    times_s = np.arange(0.0, 2.0, 1 / rate_hz)
    speed = np.where((times_s > 0.5) & (times_s < 1.3), 8.0, 1.0)
    heads = [[3.0, y, 0.4] for y in np.cumsum(speed) / rate_hz - 5.0]
    out = times_s[np.array(refused(heads, 1 / rate_hz))]
    assert out.min() == pytest.approx(1.0, abs=0.15)
    assert out.max() == pytest.approx(1.3, abs=0.15)
    slower = [[3.0, 5.5 * t, 0.4] for t in times_s]
    assert not any(refused(slower, 1 / rate_hz))


def test_what_trackers_do_is_no_flight():
    rng = np.random.default_rng(0)
    here, there = np.array([2.0, -2.0, 0.4]), np.array([4.0, 3.0, 0.4])
    jump = [here] * 30 + [there] * 30
    alternating = [here, there] * 45
    three = [here, there, np.array([3.0, 0.0, 0.2])] * 30
    noisy = np.array([3.0, 0.0, 0.4]) * (1.0 + 0.15 * rng.standard_normal((300, 1)))
    for heads in (jump, alternating, three, noisy):
        assert not any(refused(list(heads)))
    people = [[3.0, y, 0.4] for y in rng.uniform(-2.0, 2.0, 300)]
    assert not any(refused(people, names=[f"p{k}" for k in range(300)]))
    assert sum(refused(people)) < 3


def test_refused_heads_are_counted_by_name_and_limit_the_speed_while_one_is_near():
    far_s, near_s, speed_rad_s = between(0.4, 0.9), between(1.5, 2.5), 0.1

    def at(sighting, head_m):
        seen = dataclasses.replace(sighting.observation, head_position_base_m=np.array(head_m))
        return dataclasses.replace(sighting, observation=seen)

    def passing(now_s, sighting):
        if far_s(now_s):
            return [at(sighting, [1e9, 0.0, 0.0])]
        return [sighting, at(sighting, [0.15, 0.0, 0.0])] if near_s(now_s) else [sighting]

    result = run_live(change=passing, loop=LoopSettings(near_speed_max=(0.8, speed_rad_s)), duration_s=4.4)
    assert_sound(result)
    assert result.refused["implausible_person"] >= 14 + 29
    assert any("at most 30 m" in text for text in result.report.warnings)
    assert np.linalg.norm(result.joined("head_observed_base_m"), axis=1).max() < 20.0
    now_s = result.joined("time_s")
    fastest_rad_s = np.abs(result.joined("command_velocity_rad_s")).max(axis=1)
    # Braking takes 0.3 s; the limit holds for `lost_after_s` after the last sighting.
    slow = (now_s > 1.9) & (now_s < 3.4)
    assert fastest_rad_s[slow].max() <= speed_rad_s * (1 + 1e-6)
    assert fastest_rad_s[now_s < 1.5].max() > 2.0 * speed_rad_s
    assert fastest_rad_s[now_s > 3.6].max() > 2.0 * speed_rad_s
