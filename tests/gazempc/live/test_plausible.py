"""Plausibility of input: implausible heads are refused; wrong units, axes, rates and names are findings."""

import dataclasses

import numpy as np
import pytest
from builders.checks import assert_sound
from builders.faults import between
from builders.frames import TRACK_S, findings, frames, judged_place, refused
from builders.live import run_live

from gazempc.live.clock import SimulatedClock
from gazempc.live.mount import Mount
from gazempc.live.plausibility import Watch, judge_rate
from gazempc.live.stamps import Frame, SetupHints
from gazempc.settings import LoopSettings
from gazempc.sim.scene import SceneSettings, make_scene
from gazempc.sim.sensor import observe, sensor_names


@pytest.mark.parametrize(
    "head_m", [[0.0, 0.0, 0.0], [0.1, 0.1, 0.1], [1e9, 0.0, 0.0], [20.0, 23.0, 0.0], [3.0, 0.0, 3.1], [3.0, 0.0, -3.1]]
)
def test_an_implausible_head_position_is_refused(head_m):
    assert refused([[3.0, 0.0, 2.9], head_m, [0.21, 0.0, 0.0]]) == [False, True, False]


@pytest.mark.parametrize("rate_hz", [10, 200])
def test_an_implausible_speed_is_refused_after_half_a_second_until_it_falls(rate_hz):
    times_s = np.arange(0.0, 2.0, 1 / rate_hz)
    speed = np.where((times_s > 0.5) & (times_s < 1.3), 8.0, 1.0)
    heads = [[3.0, y, 0.4] for y in np.cumsum(speed) / rate_hz - 5.0]
    out = times_s[np.array(refused(heads, 1 / rate_hz))]
    assert out.min() == pytest.approx(1.0, abs=0.15)
    assert out.max() == pytest.approx(1.3, abs=0.15)
    slower = [[3.0, 5.5 * t, 0.4] for t in times_s]
    assert not any(refused(slower, 1 / rate_hz))


def test_ordinary_tracker_errors_are_plausible():
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


def test_refused_heads_are_counted_by_name_and_near_ones_limit_the_speed():
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


# A person walks by 2 m in front of the sensor, at 1.2 m/s.
WALK_M = np.column_stack([np.full(28, 2.0), 1.2 * (TRACK_S - 0.45), np.full(28, 0.4)])


# The same walk in other units or axes: columns and signs written by hand.
OTHERS = {
    "unit-m 0.001": WALK_M / 0.001,
    "unit-m 0.0254": WALK_M / 0.0254,
    "unit-m 1000.0": WALK_M / 1000.0,
    "axes optical": WALK_M[:, [1, 2, 0]] * [-1, -1, 1],
    "axes opengl": WALK_M[:, [1, 2, 0]] * [-1, 1, -1],
    "axes unity": WALK_M[:, [1, 2, 0]] * [-1, 1, 1],
}


@pytest.mark.parametrize(("option", "sent"), OTHERS.items(), ids=OTHERS.keys())
def test_wrong_units_and_axes_are_reported_with_the_correcting_option(option, sent):
    ((event, text),) = judged_place(sent)
    name, _, value = option.partition(" ")
    assert event == f"wrong_{name.removesuffix('-m')}"
    assert f"--mount.{option}" in text
    mended = Mount(axes=value) if name == "axes" else Mount(unit_m=float(value))
    assert judged_place(sent, mended) == []


def test_an_implausible_height_range_or_speed_is_reported():
    # Alternating blocks of seven frames: two people without names.
    in_turn_m = np.where(np.arange(28)[:, None] // 7 % 2, WALK_M, np.add(WALK_M, (0, 3.0, 0)))
    for sent, mount, named in (
        (WALK_M, Mount(position_m=(0.0, 0.0, 3.0)), "--mount.position-m"),
        (np.add(WALK_M, (22000.0, 0, 0)), None, "22002 m"),
        (WALK_M * [1.0, 8.0, 1.0], None, " m/s"),
        (in_turn_m, None, "person_id"),
    ):
        ((event, text),) = judged_place(sent, mount)
        assert event == "implausible_person"
        assert named in text
    assert judged_place(WALK_M) == []
    two_m = WALK_M + np.column_stack([np.zeros(28), 2.5 * (np.arange(28) % 3 == 0), np.zeros(28)])
    assert judged_place(two_m, names=["a" if k % 3 == 0 else "b" for k in range(28)]) == []


@pytest.mark.parametrize(
    ("times_s", "named"),
    [
        (np.arange(0.0, 4.0, 1 / 6.5), None),
        (np.arange(0.0, 4.0, 1 / 5.0), "5.0"),
        (np.arange(0.0, 4.0, 1 / 4.0), "camera"),
        (np.arange(0.0, 4.0, 1 / 0.8), "--loop.lost-after-s"),
        # A person with sparse detections.
        (np.sort(np.concatenate([np.arange(0.0, 4.0, 0.4), [0.433, 1.633, 2.833]])), "rarely detected"),
        # People of a frame share its time; a gap does not count as an interval.
        (np.append(np.repeat(np.arange(0.0, 1.0, 1 / 30), 2), [3.0, 3.03]), None),
    ],
)
def test_a_low_frame_rate_is_judged_by_the_median_interval(times_s, named):
    found = judge_rate(times_s, 1.0, SetupHints())
    assert [named in each.text for each in found] == [True] * (named is not None)


LEFT, RIGHT = [2.0, 1.5, 0.3], [2.5, -1.5, 0.3]


def test_among_several_people_wrong_units_and_new_names_are_reported():
    assert findings(frames(LEFT, RIGHT, [4.0, 0.0, 0.2])) == {}
    assert findings(frames(LEFT, RIGHT, name=lambda k, i: "ab"[i])) == {}
    millimetres = [list(1e3 * np.array(at_m)) for at_m in (LEFT, RIGHT)]
    assert list(findings(frames(*millimetres))) == ["wrong_unit"]
    ((event, text),) = findings(frames(LEFT, RIGHT, name=lambda k, i: f"{2 * k + i}")).items()
    assert event == "new_id_each_frame"
    assert "--no-use-ids" in text


@pytest.mark.parametrize("sensor", sensor_names())
def test_good_data_give_no_finding(sensor):
    scene = make_scene("subject01_R1", SceneSettings(sensor=sensor))
    watch = Watch(SimulatedClock(), None, Mount(), LoopSettings(), SetupHints())
    for sighting in observe(scene.walk, scene.sensor, 0):
        seen = sighting.observation
        assert list(watch.findings(sighting.arrival_s)) == []
        head_m = seen.head_position_base_m
        watch.observe(Frame(sighting.arrival_s, seen.capture_time_s, head_m, head_m, seen.person_id))
