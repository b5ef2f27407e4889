"""Training examples of the predictor `walker`, and variants of walks and of standing people."""

from dataclasses import replace

import numpy as np
import pytest
from builders.walkers import straight_model

from experiments.fit.examples import _joined, examples_of_walk, fitting_examples
from experiments.fit.pace import at_pace, idle, sway
from experiments.fit.trackers import beside, seen_through, with_onset_error
from experiments.fit.variants import GaplessWalk, bend, walk_of
from gazempc.errors import GazempcError
from gazempc.recordings.load import load
from gazempc.sim.sensor import load_sensor
from predictors import Walker
from predictors.walker.knots import KNOTS_S

FRAME_S = 1.0 / 30.0


def straight_walk(seconds=4.0, speed_m_s=1.2, heading_rad=0.4, sway_m=0.02):
    """A steady walk with a sway at 1 Hz and a bob at 2 Hz."""
    t = np.arange(round(seconds / FRAME_S) + 1) * FRAME_S
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    across = sway_m * np.sin(2 * np.pi * 0.95 * t)
    head = np.stack(
        [
            1.0 + speed_m_s * t * c - across * s,
            -2.0 + speed_m_s * t * s + across * c,
            1.6 + 0.02 * np.sin(2 * np.pi * 1.9 * t),
        ],
        axis=1,
    )
    turning = 0.05 * np.sin(2 * np.pi * 0.95 * t + 0.5)
    return GaplessWalk(t, head, heading_rad + 0.1 + turning, heading_rad - 0.05 + 0.5 * turning)


def standing(seconds=3.0, at_m=(2.0, 0.0, 1.6)):
    """A motionless person."""
    n = round(seconds / FRAME_S)
    return GaplessWalk(np.arange(n) * FRAME_S, np.tile(at_m, (n, 1)), np.zeros(n), np.zeros(n))


def speeds(walk, over_s=1.05):
    """Horizontal speed over a stride, along the walk."""
    step_s = float(np.median(np.diff(walk.times_s)))
    k = min(round(over_s / step_s), walk.times_s.size - 1)
    return np.linalg.norm(walk.head_m[k:, :2] - walk.head_m[:-k, :2], axis=1) / (k * step_s)


def seen(walk, sensor, seed=0):
    return seen_through(walk, "white", load_sensor(sensor), np.random.default_rng(seed))


def test_line_plus_departure_is_the_true_position():
    """Line plus departure, in the base frame, is the true position at each knot, for any tracker noise."""
    walk = walk_of(load("subject03_R1"))
    observations = seen(walk, "body_tracker")
    examples = examples_of_walk(walk, observations, 0.7)
    walker, k, compared = Walker(straight_model()), 0, 0
    for observation in observations:
        walker.update(observation)
        inputs = walker.inputs()
        if inputs.on_foot == 0.0 or inputs.time_s != observation.capture_time_s:
            continue
        np.testing.assert_allclose(examples.network[k], inputs.network, rtol=2**-10, atol=1e-6)
        np.testing.assert_allclose(examples.spread[k], inputs.spread, rtol=1e-6)
        noise_m2 = np.diag(inputs.to_base.T @ inputs.stated_m2 @ inputs.to_base)
        np.testing.assert_allclose(examples.noise_m[k] ** 2, noise_m2, rtol=1e-5)
        c, s = inputs.to_base[:2, 0]
        for horizon_s, (along, across, up) in zip(KNOTS_S, examples.departure_m[k], strict=True):
            at = inputs.origin_base_m + horizon_s * inputs.velocity_base_m_s
            at = at + np.array([c * along - s * across, s * along + c * across, up])
            frame = int(np.argmin(np.abs(walk.times_s - observation.capture_time_s - horizon_s)))
            apart_s = walk.times_s[frame] - observation.capture_time_s - horizon_s
            if observation.capture_time_s + horizon_s > walk.times_s[-1] + 1e-6:
                assert np.isnan(along)
            elif abs(apart_s) < 1e-6:
                np.testing.assert_allclose(at, walk.head_m[frame], atol=1e-5)
                compared += 1
        k += 1
    assert k == examples.weight.size
    assert compared > 100
    np.testing.assert_allclose(examples.weight, 0.7)


def test_standing_gives_examples_and_running_gives_none():
    """Networks are fitted on standing people and exclude running ones."""
    still = standing()
    rng = np.random.default_rng(0)
    noisy = seen_through(still, "white", load_sensor("reference"), rng)
    examples = examples_of_walk(still, noisy, 1.0)
    assert examples.weight.size >= len(noisy) - 1
    off_m = np.abs(examples.departure_m[30:, :4])
    assert np.nanmedian(off_m) < 0.05
    runs = straight_walk(3.0, speed_m_s=4.0)
    running = examples_of_walk(runs, seen(runs, "perfect")[20:], 1.0)
    late = running.weight[20:]
    assert late.size == 0 or late.max() < 0.2


def test_a_recording_without_examples_is_reported():
    still = standing()
    nothing = examples_of_walk(still, seen(still, "perfect"), 1.0)  # not even sway, so no direction
    assert nothing.weight.size == 0
    with pytest.raises(GazempcError, match="ann_stands: no examples: the person is motionless or faster than 3 m/s"):
        _joined([nothing, nothing], "ann_stands")


def test_bending_a_walk_keeps_heights_and_lengthens_no_step():
    walk = walk_of(load("subject03_R1"))
    bent = bend(walk, np.random.default_rng(4))
    np.testing.assert_array_equal(bent.head_m[:, 2], walk.head_m[:, 2])
    steps_m, own_m = (np.linalg.norm(np.diff(each.head_m[:, :2], axis=0), axis=1) for each in (bent, walk))
    assert np.all((steps_m / own_m >= 0.55 - 1e-9) & (steps_m / own_m <= 1.0 + 1e-9))


def seen_in(recording, valid):
    """The recording with valid heads in these frames only."""
    head_m = np.where(valid[:, None], recording.truth.head_position_m, np.nan)
    return replace(recording, truth=replace(recording.truth, head_position_m=head_m))


def test_the_longest_interval_without_a_gap_is_used():
    recording = load("subject01_R1")
    valid = np.ones(recording.times_s.size, dtype=bool)
    valid[30:45] = valid[100] = False
    times_s = walk_of(seen_in(recording, valid)).times_s
    assert times_s[0] == recording.times_s[45]
    assert recording.times_s[100] not in times_s
    assert times_s[-1] == recording.times_s[-1]
    valid[:] = False
    valid[:20] = True
    with pytest.raises(GazempcError, match=r"0\.63 s; a fit requires at least 1\.25 s"):
        walk_of(seen_in(recording, valid))


@pytest.mark.parametrize("part", ["head", "pelvis"])
def test_a_walk_without_orientations_is_refused(part):
    recording = load("subject01_R1")
    name = f"{part}_quat_wxyz"
    unknown = replace(recording.truth, **{name: np.full((recording.times_s.size, 4), np.nan)})
    with pytest.raises(GazempcError, match=f"subject01_R1: the orientation of the {part} is unknown"):
        walk_of(replace(recording, truth=unknown))


def test_starts_and_stops_join_standing_and_walking():
    along = np.array([np.cos(0.4), np.sin(0.4)])
    for seed in range(3):
        rng = np.random.default_rng(seed)
        starts, stops, stands = (at_pace(straight_walk(12.0), kind, rng) for kind in ("start", "stop", "stand"))
        way_m = (starts.head_m[:, :2] - starts.head_m[0, :2]) @ along
        assert np.abs(way_m[:18]).max() < 0.45  # leans, steps aside
        assert speeds(starts, 0.3)[-1] > 0.4
        assert way_m[-1] > 0.5
        assert speeds(stops, 0.3)[:10].mean() > 0.4
        assert np.ptp(stops.head_m[-10:, :2], axis=0).max() < 0.35
        assert stops.times_s[-1] == pytest.approx(5.0, abs=0.04)
        assert 0.002 < np.ptp(stands.head_m[:, :2], axis=0).max() < 1.5
        assert speeds(stands, 0.3).max() < 1.5


def test_scaled_sway_has_the_amplitude_of_the_gaussian_average():
    """The average over a s.d. of 0.3 s retains exp(-(2 pi f 0.3 s)^2 / 2) of a sway of frequency f."""
    before, after = straight_walk(12.0), sway(straight_walk(12.0), 2.0)
    retained = np.exp(-0.5 * (2 * np.pi * 0.95 * 0.3) ** 2)
    inside = slice(60, -60)  # outside, the average is truncated
    across = [walk.head_m[inside, :2] @ [-np.sin(0.4), np.cos(0.4)] for walk in (before, after)]
    expected = (2.0 - retained) * (across[0] - across[0].mean())
    np.testing.assert_allclose(across[1] - across[1].mean(), expected, atol=1e-3)
    along = [walk.head_m[inside, :2] @ [np.cos(0.4), np.sin(0.4)] for walk in (before, after)]
    np.testing.assert_allclose(along[1], along[0], atol=1e-3)
    np.testing.assert_array_equal(after.head_m[:, 2], before.head_m[:, 2])


def test_an_onset_error_ends_within_a_quarter_of_a_second():
    track, first_m = seen(standing(), "perfect"), []
    for seed in range(200):
        found = with_onset_error(track, np.random.default_rng(seed))
        assert [each.capture_time_s for each in found] == [
            each.capture_time_s for each in track if each.capture_time_s < track[0].capture_time_s + 1.0
        ]
        pairs = zip(found, track, strict=False)
        error_m = np.array([each.head_position_base_m - true.head_position_base_m for each, true in pairs])
        ages_s = np.array([each.capture_time_s for each in found]) - track[0].capture_time_s
        assert np.all(error_m[ages_s >= 0.25] == 0.0)
        size_m = np.linalg.norm(error_m, axis=1)
        assert np.all(np.diff(size_m) <= 0.0)
        first_m.append(error_m[0])
    # Variance of a log-uniform standard deviation: (b^2 - a^2) / (2 log(b / a)).
    expected_m = np.sqrt((0.15**2 - 0.02**2) / (2.0 * np.log(0.15 / 0.02)))
    np.testing.assert_allclose(np.std(first_m, axis=0), expected_m * np.array([1.0, 1.0, 0.5]), rtol=0.2)


def test_variants_without_a_single_frame_are_left_out(monkeypatch):
    blind = load_sensor("reference").model_copy(update={"dropout_probability": 1.0 - 1e-9})
    drawn = iter([("white", blind), ("white", load_sensor("reference"))])
    monkeypatch.setattr("experiments.fit.examples.draw_tracker", lambda *_: next(drawn))
    assert fitting_examples("subject01_R1", 0, 2).weight.size > 0
    for tracker, why in ((blind, "never sees the person"), (load_sensor("recorded"), "has no such track")):
        with pytest.raises(GazempcError, match=why):
            fitting_examples("subject01_R1", 0, 2, tracker)


def test_the_robot_is_beside_the_walk_and_clear_of_it():
    walk, bearings = straight_walk(4.0), []
    for seed in range(20):
        moved = beside(walk, np.random.default_rng(seed))
        away = np.linalg.norm(moved.head_m[:, :2], axis=1)
        assert away.min() > 1.2 - 1e-9
        np.testing.assert_allclose(np.diff(moved.head_m, axis=0), np.diff(walk.head_m, axis=0), atol=1e-12)
        np.testing.assert_allclose(moved.head_m[:, 2], walk.head_m[:, 2] - 1.2)
        bearings.append(np.arctan2(*moved.head_m[60, 1::-1]))
    assert np.ptp(bearings) > 5.0


def test_people_on_the_spot_sway_little_or_much_and_turn_with_it():
    """A fifth barely moves; in most the s.d. exceeds 5 cm and the body turns, at speeds below those of walking."""
    rng = np.random.default_rng(0)
    motions = [idle(150, 1 / 30, rng) for _ in range(200)]
    sway_m = np.array([np.max(np.std(each.head_m[:, :2], axis=0)) for each in motions])
    assert np.quantile(sway_m, 0.2) < 0.02
    assert 0.05 < np.quantile(sway_m, 0.6) < 0.1
    assert 0.5 < np.mean([np.ptp(each.pelvis_yaw_rad) > 0.0 for each in motions]) < 0.8
    speed_m_s = [np.max(np.hypot(*np.diff(each.head_m[:, :2], axis=0).T)) * 30.0 for each in motions]
    assert np.quantile(speed_m_s, [0.5, 0.99]) == pytest.approx([0.26, 0.85], abs=0.15)
