"""Frames that are too rare, names that mean nothing; and the whole watch within a live run."""

import dataclasses

import numpy as np
import pytest
from builders.checks import assert_same_commands, assert_sound
from builders.live import run_live

from gazempc.live.hints import Frame, SetupHints
from gazempc.live.mount import Mount
from gazempc.live.plausibility import judge_ids, judge_rate

HEAD = np.array([2.0, 0.0, 0.4])


def named(names):
    return [Frame(0.03 * k, 0.03 * k, HEAD, HEAD, name) for k, name in enumerate(names)]


@pytest.mark.parametrize(("rate_hz", "said"), [(30.0, ""), (6.5, ""), (5.0, "5.0 frames"), (0.8, "0.8 frames")])
def test_rare_frames_are_told_from_the_median_of_their_intervals(rate_hz, said):
    found = judge_rate(np.arange(0.0, 4.0, 1.0 / rate_hz), 1.0, SetupHints())
    assert [said] * bool(said) == [each.text[: len(said)] for each in found]
    # Each person of a frame has its time; a gap is no rate.
    twice = np.repeat(np.arange(0.0, 1.0, 1.0 / 30.0), 2)
    assert judge_rate(np.append(twice, [3.0, 3.03]), 1.0, SetupHints()) == []
    if rate_hz < 1.0:
        assert "--loop.lost-after-s 3.1" in found[0].text


def test_a_name_for_each_frame_is_no_name():
    (found,) = judge_ids(named(map(str, range(10))), SetupHints())
    assert found.event == "new_id_each_frame"
    assert "--no-use-ids" in found.text
    assert judge_ids(named(["a"] * 10), SetupHints()) == []
    assert judge_ids(named(["a", "b"] * 5), SetupHints()) == []
    assert judge_ids(named([None] * 10), SetupHints()) == []


def changed(sighting, **fields):
    return dataclasses.replace(sighting, observation=dataclasses.replace(sighting.observation, **fields))


def optical_mm(now_s, sighting):
    x, y, z = sighting.observation.head_position_base_m
    turned = {"head_quat_wxyz": None, "pelvis_quat_wxyz": None}
    return [changed(sighting, head_position_base_m=1e3 * np.array([-y, -z, x]), **turned)]


def test_within_a_second_of_data_it_is_an_event_and_a_warning_and_the_options_give_the_right_gaze():
    wrong = run_live(change=optical_mm, duration_s=3.0)
    assert_sound(wrong)
    (said_s,) = wrong.event_s("wrong_unit")
    assert said_s < 1.2
    refused, text = wrong.report.warnings
    assert refused.startswith("implausible_person: ")
    assert text.startswith("wrong_unit: ")
    assert wrong.used == 0
    mended = run_live(change=optical_mm, duration_s=3.0, mount=Mount(unit_m=0.001, axes="optical"))
    assert_sound(mended)
    assert mended.events == {"no_observation_yet"}
    assert mended.report.warnings == []
    assert_same_commands(mended, within_rad=1e-9)


def test_a_slow_tracker_is_told_and_its_frames_are_used():
    """Every tenth frame of 30 a second."""
    count = [0]

    def rare(now_s, sighting):
        count[0] += 1
        return [sighting] if count[0] % 10 == 0 else []

    result = run_live(change=rare, duration_s=4.0)
    assert_sound(result)
    assert "low_frame_rate" in result.events
    assert result.refused == {}
    assert "3.0 frames a second" in result.report.warnings[0]
