"""Faults of the source: silence, stale and shuffled frames, clocks that jump, observations that make no sense."""

import dataclasses
import itertools

import numpy as np
import pytest
from builders.checks import assert_recovered, assert_sound
from builders.faults import between
from builders.live import NECK, TS, Faulty, run_live

from gazempc.controllers.lookahead import LookAhead
from gazempc.live.clock import SimulatedClock
from gazempc.live.sources.source import Notice
from gazempc.loop.events import Event
from gazempc.results.metrics import measure
from gazempc.types import Sighting


def test_a_source_that_is_silent_for_five_seconds():
    """Stop 1 s after the last frame, at rest straight ahead slowly after 3 s, and the gaze back 2 s after the end.

    On the face, that is; to the last third of a degree when nobody is met any more.
    """
    silent = between(3.0, 8.0)
    result = run_live(change=lambda now, s: [] if silent(now) else [s], duration_s=None)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "target_lost", "return_to_rest"}
    last_capture_s = result.joined("capture_time_s")[result.joined("capture_time_s") < 5.0].max()
    assert result.event_s("target_lost") == pytest.approx([last_capture_s + 1.0], abs=2 * TS)
    assert result.event_s("return_to_rest") == pytest.approx([last_capture_s + 3.0], abs=2 * TS)
    now, sent = result.joined("time_s"), result.joined("command_position_rad")
    standing = sent[(now > last_capture_s + 1.6) & (now < last_capture_s + 3.0)]
    assert np.ptp(standing, axis=0) == pytest.approx([0, 0], abs=1e-9)
    assert np.abs(standing[0]).max() > 0.05
    returning = (now > last_capture_s + 3.0) & (now < 8.0)
    assert np.abs(np.diff(sent[returning], axis=0)).max() / TS <= 0.5 * (1 + 1e-9)
    assert sent[np.flatnonzero(returning)[-1]] == pytest.approx([0, 0], abs=1e-6)
    # Who was lost is looked for where they are, not where they would have gone.
    back = (now >= 8.0) & (now < 10.0)
    assert np.rad2deg(np.abs(result.joined("joint_position_rad")[back, 0])).max() < 25.0
    assert_recovered(result, 8.0 + 2.0, within_deg=1.0)
    assert_recovered(result, 8.0 + 3.0)
    assert measure(result.logs[0][0]).limit_violations == 0


def test_a_burst_of_stale_frames_is_dropped():
    """A tracker hangs for 1.2 s, then delivers all that it has kept."""
    held = []

    def hang(now_s, sighting):
        if 3.0 <= now_s < 4.2:
            held.append(sighting)
            return []
        burst, held[:] = [*held, sighting], []
        return burst

    result = run_live(change=hang, duration_s=7.5)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "target_lost", "stale_observation", "observations_dropped"}
    # The event is written once, when it begins, however many the frames.
    assert result.event_s("stale_observation").size == 1
    lag_s = result.joined("arrival_time_s") - result.joined("capture_time_s")
    assert lag_s.max() <= 0.5
    assert (lag_s > 0.1).sum() > 10  # what was not stale of it was used
    assert_recovered(result, 4.2 + 2.0)


def test_the_sensor_s_clock_jumps_and_comes_back():
    """Time stamps 3 s off for 1.5 s: not used for half a second, then shifted; the same when they come back."""

    event, back = "future_observation", "stale_observation"

    def jumped(now_s, sighting):
        seen = sighting.observation
        off_s = 3.0 if 3.0 <= now_s < 4.5 else 0.0
        late = dataclasses.replace(seen, capture_time_s=seen.capture_time_s + off_s)
        return [Sighting(sighting.arrival_s, late)]

    result = run_live(change=jumped, duration_s=8.5)
    assert_sound(result)
    assert result.events == {"no_observation_yet", event, back, "clock_shifted", "wrong_clock"}
    assert result.refused[event] == pytest.approx(15, abs=2)
    assert 0 < result.refused[back] < 17
    assert result.event_s(event)[0] == pytest.approx(3.0, abs=0.05)
    assert result.event_s("clock_shifted") == pytest.approx([3.5], abs=0.06)
    assert_recovered(result, 5.05 + 1.9)


def test_an_observation_with_nan_a_bad_quaternion_or_a_head_at_the_sensor_is_refused():
    """Forged past the check of `HeadObservation`, as a source in another language might."""
    heads = [("head_position_base_m", np.full(3, value)) for value in (np.nan, 0.005)]
    others = [("pelvis_quat_wxyz", np.zeros(4)), ("position_covariance_m2", np.zeros((3, 3)))]
    wrong = itertools.cycle([*heads, *others])

    def spoilt(now_s, sighting):
        if not 2.0 <= now_s < 2.5:
            return [sighting]
        seen, (field, value) = dataclasses.replace(sighting.observation), next(wrong)
        object.__setattr__(seen, field, value)
        return [Sighting(sighting.arrival_s, seen)]

    result = run_live(change=spoilt)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "bad_observation"}
    assert result.report.n_problems == len(result.report.problems) == result.refused["bad_observation"] > 10
    assert_recovered(result, 2.5 + 1.2)


def test_a_source_that_raises_is_asked_again_and_the_neck_brakes():
    """What it raises is in the log with its traceback, once."""

    to_s = 4.5

    def on_poll(now_s):
        if 2.0 <= now_s < to_s:
            raise ConnectionError("the tracker is gone")

    result = run_live(on_poll=on_poll, duration_s=7.5)
    assert_sound(result)
    lost = {"target_lost", "stale_observation", "observations_dropped"}
    assert result.events == {"no_observation_yet", "source_failed", *lost}
    assert result.event_s("source_failed") == pytest.approx([2.0], abs=TS)
    (fault,) = result.logs[0][0].faults
    assert (fault.event, fault.error) == ("source_failed", "ConnectionError: the tracker is gone (Faulty.poll())")
    assert "in on_poll" in fault.traceback
    assert fault.count == pytest.approx((to_s - 2.0) / TS, abs=2)
    now = result.joined("time_s")
    braked = result.joined("command_velocity_rad_s")[(now > 3.8) & (now < to_s)]
    assert np.abs(braked).max() < 1e-9
    assert_recovered(result, to_s + 1.9, within_deg=1.0)


def test_a_sender_that_is_refused_all_the_time_is_reported_every_ten_seconds(caplog):
    class Contested(Faulty):
        def poll(self):
            refused = Notice(Event.SENDER_REFUSED, f"a stranger at {self.clock.now_s():.0f} s")
            return dataclasses.replace(super().poll(), notices=(refused,))

    clock = SimulatedClock()
    result = run_live(clock=clock, source=Contested(clock), controller=LookAhead(NECK), duration_s=10.5)
    said = [record.getMessage() for record in caplog.records if "stranger" in record.getMessage()]
    assert said == [f"sender_refused: a stranger at {k} s" for k in (0, 10)]
    assert result.refused["sender_refused"] > 1900
    assert len(result.report.warnings) == 1
