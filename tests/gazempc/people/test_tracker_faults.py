"""A frozen tracker against a person who stands, and a jump of the yaw against a turn."""

import numpy as np
import pytest
from builders.people import yaw_quat

from gazempc.people.tracker_faults import FrozenTracker, OrientationJumps
from gazempc.types import Sighting
from predictors import HeadObservation


def sighting(time_s, head_m, sensor_m=None):
    return Sighting(time_s + 0.05, HeadObservation(time_s, head_m), sensor_m)


def frozen_at(path_m, rate_hz, sensor_m=None):
    """Times from the start at which a tracker that gives these positions counts as frozen."""
    tracker = FrozenTracker()
    times_s = np.arange(len(path_m)) / rate_hz
    moving = [None] * len(path_m) if sensor_m is None else sensor_m
    return [t for t, m, s in zip(times_s, path_m, moving, strict=True) if tracker.see(sighting(t, m, s))]


def walk_then(stops_m_s2, rate_hz, seconds=4.0, speed_m_s=1.2):
    """A person walks for 2 s, brakes and stands; without noise."""
    times_s = np.arange(int(seconds * rate_hz)) / rate_hz
    braking_s = np.clip(times_s - 2.0, 0.0, speed_m_s / stops_m_s2)
    way_m = speed_m_s * np.minimum(times_s, 2.0) + speed_m_s * braking_s - 0.5 * stops_m_s2 * braking_s**2
    return np.stack([2.0 + 0.0 * way_m, way_m - 1.5, 0.3 + 0.0 * way_m], axis=1)


@pytest.mark.parametrize("rate_hz", [5.0, 30.0])
def test_a_tracker_that_is_frozen_in_mid_walk_is_noticed_after_half_a_second(rate_hz):
    path_m = walk_then(1.0, rate_hz)
    stop = int(1.5 * rate_hz)
    path_m[stop : stop + int(1.5 * rate_hz)] = path_m[stop]
    found_s = frozen_at(path_m, rate_hz)
    assert found_s[0] == pytest.approx((stop + 0.5 * rate_hz) / rate_hz, abs=1.01 / rate_hz)
    # Until the first other position, and not later.
    assert found_s[-1] == pytest.approx((stop + int(1.5 * rate_hz) - 1) / rate_hz)
    assert len(found_s) == round((found_s[-1] - found_s[0]) * rate_hz) + 1


@pytest.mark.parametrize(("rate_hz", "stops_m_s2"), [(16.0, 0.5), (30.0, 3.0), (60.0, 1.0)])
def test_braking_to_a_stand_without_noise_is_not_frozen(rate_hz, stops_m_s2):
    assert frozen_at(walk_then(stops_m_s2, rate_hz), rate_hz) == []


def test_standing_from_the_beginning_or_elsewhere_after_a_gap_is_not_frozen():
    stands = np.tile([2.0, 0.5, 0.3], (120, 1))
    assert frozen_at(stands, 30.0) == []
    # Lost for two seconds; then a person stands 3 m away.
    tracker = FrozenTracker()
    for i in range(60):
        assert not tracker.see(sighting(i / 30.0, [2.0, 0.5, 0.3]))
    for i in range(60):
        assert not tracker.see(sighting(4.0 + i / 30.0, [2.0, 3.5, 0.3]))


def test_noise_of_a_tracker_is_no_walk_and_noise_is_never_frozen():
    rng = np.random.default_rng(0)
    stands = np.array([2.0, 0.5, 0.3]) + 0.03 * rng.standard_normal((120, 3))
    assert frozen_at(stands, 30.0) == []
    stands[60:] = stands[60]
    assert frozen_at(stands, 30.0) == []


def test_on_a_moving_head_what_the_sensor_saw_counts():
    """Frozen there, the position moves with the head in the base frame; who stands seems to move in the sensor's."""
    frames = np.arange(90)
    pan_rad = 0.02 * frames
    turning = np.stack([2.0 * np.cos(pan_rad), 2.0 * np.sin(pan_rad), 0.3 + 0.0 * pan_rad], axis=1)
    in_sensor = np.where(frames[:, None] < 45, turning, [2.0, 0.0, 0.3])
    assert frozen_at(turning, 30.0, in_sensor)[0] == pytest.approx(2.0, abs=0.04)
    assert frozen_at(turning, 30.0) == []
    assert frozen_at(np.tile([2.0, 0.0, 0.3], (90, 1)), 30.0, in_sensor) == []


# ---------------------------------------------------------------- orientations


def seen(time_s, head_rad=None, pelvis_rad=None):
    quats = [None if yaw is None else yaw_quat(yaw) for yaw in (head_rad, pelvis_rad)]
    return HeadObservation(time_s, [2.0, 0.0, 0.3], *quats, head_yaw_sd_rad=0.1)


def known(jumps, observations):
    """Which orientations are left of each, and how many events there were."""
    found = [jumps.without(o) for o in observations]
    kept = [(o.head_quat_wxyz is not None, o.pelvis_quat_wxyz is not None) for o, _ in found]
    return kept, sum(first for _, first in found)


def test_an_orientation_that_flips_at_every_frame_is_never_used():
    observations = [seen(i / 30.0, np.pi * (i % 2), 0.1) for i in range(90)]
    kept, events = known(OrientationJumps(), observations)
    assert kept == [(True, True)] + [(False, True)] * 89
    assert events == 1


def test_turns_of_people_and_steps_over_pi_are_used():
    # 500 degrees a second, which is as fast as heads turn, all round.
    observations = [seen(i / 10.0, np.radians(50.0) * i, -np.radians(50.0) * i) for i in range(30)]
    assert known(OrientationJumps(), observations) == ([(True, True)] * 30, 0)
    # A turn between frames that are far apart, or around a frame without orientation, is possible.
    observations = [seen(0.3 * i, np.pi * (i % 2)) for i in range(10)]
    assert known(OrientationJumps(), observations) == ([(True, False)] * 10, 0)
    observations = [seen(0.0, 0.0), seen(0.03), seen(0.06, 3.0)]
    assert known(OrientationJumps(), observations)[1] == 0


def test_all_else_of_an_observation_is_kept_and_a_new_flip_is_a_new_event():
    jumps = OrientationJumps()
    jumps.without(seen(0.0, 0.0))
    found, first = jumps.without(seen(0.03, 3.0))
    assert (found.head_quat_wxyz, found.head_yaw_sd_rad, first) == (None, 0.1, True)
    assert not jumps.without(seen(0.06, 0.0))[1]
    assert not jumps.without(seen(0.03, 3.0))[1]  # out of order
    jumps.without(seen(2.0, 0.0))
    assert jumps.without(seen(2.03, 3.0))[1]
