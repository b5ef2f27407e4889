"""Wrong units and axes, and people where nobody is: what they look like, and that what is named mends them."""

import re

import numpy as np
import pytest

from gazempc.live.hints import Frame, SetupHints
from gazempc.live.mount import Mount
from gazempc.live.plausibility import judge_place
from predictors import HeadObservation

TIMES_S = np.arange(28) / 30.0
# Somebody walks by 2 m in front of the sensor, at 1.2 m/s.
WALK_M = np.column_stack([np.full(28, 2.0), 1.2 * (TIMES_S - 0.45), np.full(28, 0.4)])


def judged(sent, mount=None, names=None, times_s=TIMES_S):
    mount = mount or Mount()
    frames = []
    for k, head in enumerate(sent):
        seen = mount.in_sensor(HeadObservation(float(times_s[k]), np.array(head)))
        base_m = mount.to_base(seen, None, None).head_position_base_m
        name = None if names is None else names[k]
        frames.append(Frame(times_s[k] + 0.05, times_s[k], seen.head_position_base_m, base_m, name))
    return [(str(event), text) for event, text in judge_place(frames, times_s, mount, SetupHints())]


def columns(walk, order, signs):
    return walk[:, order] * signs


UNITS = {
    "millimetres": (1e3 * WALK_M, "millimetres", 0.001),
    "centimetres": (1e2 * WALK_M, "centimetres", 0.01),
    "inches": (WALK_M / 0.0254, "inches", 0.0254),
    "thousandths": (WALK_M / 1e3, "a thousandth of metres", 1000.0),
}


@pytest.mark.parametrize(("sent", "looks", "unit_m"), UNITS.values(), ids=UNITS.keys())
def test_a_wrong_unit_is_named_and_the_option_mends_it(sent, looks, unit_m):
    ((event, text),) = judged(sent)
    assert event == "wrong_unit"
    assert looks in text
    assert f"--mount.unit-m {unit_m:g}" in text.replace("1000.0", "1000")
    assert judged(sent, Mount(unit_m=unit_m)) == []


# The same walk as trackers with other axes state it: columns and signs written out by hand.
AXES = {
    "optical": columns(WALK_M, [1, 2, 0], [-1, -1, 1]),
    "opengl": columns(WALK_M, [1, 2, 0], [-1, 1, -1]),
    "unity": columns(WALK_M, [1, 2, 0], [-1, 1, 1]),
}


@pytest.mark.parametrize(("axes", "sent"), AXES.items(), ids=AXES.keys())
def test_wrong_axes_are_named_and_the_option_mends_them(axes, sent):
    ((event, text),) = judged(sent)
    assert event == "wrong_axes"
    assert f"--mount.axes {axes}" in text
    mended = Mount(axes=axes)
    assert judged(sent, mended) == []
    back = [mended.in_sensor(HeadObservation(0.0, head)).head_position_base_m for head in sent]
    np.testing.assert_allclose(back, WALK_M, atol=1e-12)


def test_both_at_once_are_told_one_after_the_other():
    sent = 1e3 * AXES["optical"]
    assert [event for event, _ in judged(sent)] == ["wrong_unit"]
    assert [event for event, _ in judged(sent, Mount(unit_m=0.001))] == ["wrong_axes"]
    assert judged(sent, Mount(unit_m=0.001, axes="optical")) == []


def test_a_sensor_that_is_turned_by_its_mount_is_right():
    assert judged(AXES["optical"], Mount(roll_pitch_yaw_deg=(-90.0, 0.0, -90.0))) == []


def test_somebody_too_high_too_far_or_too_fast():
    ((event, text),) = judged(WALK_M, Mount(position_m=(0.0, 0.0, 3.0)))
    assert event == "implausible_person"
    assert "3.4 m above" in text
    assert "--mount.position-m" in text
    assert [event for event, _ in judged(np.add(WALK_M, (22000.0, 0, 0)))] == ["implausible_person"]
    ((event, text),) = judged(WALK_M * [1.0, 8.0, 1.0])
    assert event == "implausible_person"
    assert re.search(r"moves at 9\.\d m/s", text)


def test_two_people_in_turn_are_too_fast_for_one_unless_they_have_names():
    two = WALK_M + np.column_stack([np.zeros(28), 2.5 * (np.arange(28) % 3 == 0), np.zeros(28)])
    assert judged(WALK_M) == []
    ((event, text),) = judged(np.where(np.arange(28)[:, None] // 7 % 2, WALK_M, np.add(WALK_M, (0, 3.0, 0))))
    assert event == "implausible_person"
    assert "person_id" in text
    assert judged(two, names=["a" if k % 3 == 0 else "b" for k in range(28)]) == []
