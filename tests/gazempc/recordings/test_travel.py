"""Whether people leave the spot, and when they start: motions whose speed is known in closed form, and real people."""

import csv

import numpy as np
import pytest

from gazempc.recordings.load import load
from gazempc.recordings.readers.labels import travel


def along_x(x_m, rate_hz=30.0):
    t = np.arange(x_m.size) / rate_hz
    return t, np.column_stack([x_m, np.full_like(x_m, 0.4), np.full_like(x_m, 1.6)])


def starting(rate_hz=30.0, at_s=2.0, acceleration=1.0, seconds=6.0):
    """At rest, then constant acceleration up to 1.2 m/s."""
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    ramp_s = np.clip(t - at_s, 0.0, 1.2 / acceleration)
    return along_x(0.5 * acceleration * ramp_s**2 + 1.2 * np.maximum(t - at_s - 1.2 / acceleration, 0.0), rate_hz)


@pytest.mark.parametrize("rate_hz", [5.0, 15.0, 30.0, 200.0])
def test_the_start_is_where_the_speed_passes_0_3_m_s(rate_hz):
    found = travel(*starting(rate_hz))
    assert found.leaves
    # At a low rate the path is known to a frame only.
    assert found.start_s == pytest.approx(2.3, abs=max(1 / 30, 0.5 / rate_hz) + 1e-9)


@pytest.mark.parametrize(("pause_s", "starts"), [(0.3, False), (0.9, True)])
def test_a_start_follows_half_a_second_at_rest(pause_s, starts):
    t = np.arange(0.0, 6.0, 1.0 / 30.0)
    found = travel(*along_x(1.2 * np.minimum(t, 2.0) + 1.2 * np.maximum(t - 2.0 - pause_s, 0.0)))
    assert found.leaves
    # The window of the speed, 0.3 s, blurs both ends.
    assert (found.start_s == pytest.approx(2.0 + pause_s, abs=0.15)) if starts else np.isnan(found.start_s)


def test_jumps_of_a_tracker_are_no_start():
    t = np.arange(400) / 50.0
    found = travel(*along_x(0.1 * (np.arange(t.size) % 40 > 20), 50.0))
    assert not found.leaves


def test_real_people_who_stand_and_who_walk(walks_dir, tracks_dir):
    standing = (walks_dir.parent / "standing").glob("stand_*.csv")
    for path in [*standing, *sorted(tracks_dir.glob("vru_waiting*"))[::9]]:
        walk = load(path)
        assert not travel(walk.times_s, walk.truth.head_position_m).leaves, path.stem
        assert walk.labels.group == "standing"
    for path in sorted(walks_dir.glob("cmu*.csv"))[::4]:
        walk = load(path)
        assert travel(walk.times_s, walk.truth.head_position_m).leaves, path.stem


def test_real_pedestrians_who_start_do_so_about_3_s_into_their_track(tracks_dir):
    """The data set cuts tracks 3 s before the start as its annotators see it; some walk at the beginning as well."""
    with (tracks_dir / "index.csv").open(encoding="utf-8") as stream:
        clips = [row["clip"] for row in csv.DictReader(stream) if row["kind"] == "starting"]
    walks = [load(tracks_dir / f"{clip}.csv") for clip in clips[::6]]
    starts_s = [travel(walk.times_s, walk.truth.head_position_m).start_s - walk.times_s[0] for walk in walks]
    assert np.isfinite(starts_s).mean() > 0.9
    assert 3.0 < np.nanmedian(starts_s) < 3.4
