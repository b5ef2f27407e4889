"""Reachy Mini's laws compared with derived closed forms."""

import numpy as np
import pytest
from builders.rival_bench import CAMERA, NECK, Plant, camera, first_frame_only, ramp, run, standing

from experiments.rivals.laws.reachy_mini import (
    ConversationApp,
    Gate,
    ImageFilter,
    ReachyMini,
    ReachyMiniCaptureRaw,
)
from experiments.rivals.rival import Detection


def face(offset=(0.0, 0.0), capture_s=0.0):
    return Detection(capture_s, capture_s + 0.1, np.array(offset), 1.5, np.array([90.0, 120.0]))


def test_a_still_target_is_approached_with_a_time_constant_of_0_123_s():
    """The frame arrives after 0.1 s; a computed command is sent at the next step, 0.02 s later."""
    course = run(ReachyMini(NECK, CAMERA), standing(20.0), 1.5, seen=first_frame_only)
    since_s = course.time_s - 0.12
    steps = np.floor(since_s / 0.02 + 1e-6) + 1
    expected = np.where(since_s >= -1e-6, 20.0 * (1.0 - 0.85**steps), 0.0)
    np.testing.assert_allclose(np.rad2deg(course.command[:, 0]), expected, atol=1e-6)
    assert -0.02 / np.log(0.85) == pytest.approx(0.123, abs=5e-4)


# Target at a step: frames of 0.1 s, five steps each; easing; sent one step later; held for a step.
HOLD_S, EASE_S, NEXT_S, HALF_S = 0.04, 0.02 * 0.85 / 0.15, 0.02, 0.01


def test_with_capture_times_the_lag_is_delay_plus_easing_plus_motor():
    law = ReachyMiniCaptureRaw(NECK, CAMERA)
    course = run(law, ramp(20.0, -30.0), 4.0, Plant(0.03, 0.09))
    assert course.lag_s(20.0, 1.0) == pytest.approx(0.1 + HOLD_S + EASE_S + NEXT_S + HALF_S + 0.12, abs=2e-3)


def test_overshoot_grows_with_frame_latency():
    def overshoot_deg(law, latency_s, **constants):
        seen_by = camera(latency_s=latency_s)
        course = run(law(NECK, seen_by, **constants), standing(25.0), 3.0, Plant(0.03, 0.09), seen_by)
        return course.head_deg[:, 0].max() - 25.0

    late = [overshoot_deg(ReachyMini, latency_s, filtered=False) for latency_s in (0.1, 0.2)]
    assert late[0] > 1.0
    assert late[1] > 1.5 * late[0]
    assert overshoot_deg(ReachyMiniCaptureRaw, 0.2) < 0.01


def test_the_head_returns_to_straight_ahead_two_seconds_after_the_last_face():
    course = run(ReachyMini(NECK, CAMERA), standing(20.0), 5.0, seen=lambda t: t < 1.0)
    held = (course.time_s > 2.0) & (course.time_s < 2.9)
    assert np.ptp(course.head_deg[held, 0]) < 0.1
    np.testing.assert_allclose(course.head_deg[-1], 0.0, atol=0.05)


def test_the_image_filter_holds_small_changes_and_follows_large_ones_faster():
    image_filter = ImageFilter()
    assert image_filter.update(np.array([0.10, 0.0]))[0] == 0.10
    assert image_filter.update(np.array([0.11, 0.0]))[0] == 0.10
    assert image_filter.update(np.array([0.20, 0.0]))[0] == pytest.approx(0.13)
    assert image_filter.update(np.array([0.50, 0.0]))[0] == pytest.approx(0.13 + 0.6 * 0.37)


def test_a_jump_is_ignored_until_the_previous_face_expires():
    gate = Gate()
    taken = [
        gate.takes(face((x, 0.0), time_s)) for x, time_s in ((0, 0), (0.6, 0.1), (0.4, 0.2), (-0.2, 2.1), (-0.2, 2.3))
    ]
    assert taken == [True, False, True, False, True]


def test_the_conversation_app_moves_0_6_of_the_error():
    course = run(ConversationApp(NECK, CAMERA), standing(-7.0), 2.0, Plant(0.03, 0.09))
    assert course.head_deg[-1, 0] == pytest.approx(0.6 * -7.0, abs=0.01)
