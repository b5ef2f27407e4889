"""Fitting the predictor `walker`: variants of walks, examples, the two fits, and the command."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders.fits import toy

from experiments.fit.examples import _joined, as_seen, examples_of_walk, fitting_examples, join
from experiments.fit.networks import fit_networks
from experiments.fit.spread import calibrate, fit_spread
from experiments.fit.variants import GaplessWalk, bend, change_pace, glance, mirror, vary, walk_of
from gazempc.errors import GazempcError
from gazempc.recordings.load import load
from predictors.walker.network import KNOTS_S, WalkerModel, load_walker_model


@pytest.fixture
def walk():
    return walk_of(load("subject03_R1"))


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def steps_m(walk):
    return np.linalg.norm(np.diff(walk.head_m[:, :2], axis=0), axis=1)


# ---------------------------------------------------------------- variants


def test_a_bent_walk_has_the_same_heights_and_no_longer_steps(walk, rng):
    for _ in range(20):
        bent = bend(walk, rng)
        np.testing.assert_array_equal(bent.head_m[:, 2], walk.head_m[:, 2])
        ratio = steps_m(bent) / steps_m(walk)
        assert np.all(ratio <= 1.0 + 1e-9)
        assert np.all(ratio >= 0.55 - 1e-9)


def test_pelvis_head_and_path_turn_by_the_same_angle(walk):
    """Bent long before its end, body and path have turned alike: what is left between them is gait and offset."""
    longer = GaplessWalk(
        np.linspace(0.0, 12.0, 361),
        np.column_stack([np.linspace(0.0, 14.0, 361), np.zeros(361), np.full(361, 1.5)]),
        np.zeros(361),
        np.zeros(361),
    )
    turned = []
    for seed in range(40):
        bent = bend(longer, np.random.default_rng(seed))
        step = np.diff(bent.head_m[-2:, :2], axis=0)[0]
        path = np.arctan2(step[1], step[0])
        if abs(np.ptp(bent.pelvis_yaw_rad[-20:])) < 1e-6 and abs(np.ptp(bent.head_yaw_rad[-20:])) < 1e-6:
            turned.append(abs(bent.pelvis_yaw_rad[-1]))
            for yaw in (bent.pelvis_yaw_rad[-1], bent.head_yaw_rad[-1]):
                assert np.cos(yaw - path) > np.cos(np.radians(12.0))
    assert np.degrees(np.mean(turned)) > 30


def test_two_mirrors_are_none(walk):
    once, twice = mirror(walk), mirror(mirror(walk))
    np.testing.assert_array_equal(twice.head_m, walk.head_m)
    np.testing.assert_array_equal(once.head_m[:, 1], -walk.head_m[:, 1])
    np.testing.assert_array_equal(twice.pelvis_yaw_rad, walk.pelvis_yaw_rad)


def test_a_glance_turns_nothing_but_the_head(walk, rng):
    looking = glance(walk, rng, 40.0)
    np.testing.assert_array_equal(looking.head_m, walk.head_m)
    np.testing.assert_array_equal(looking.pelvis_yaw_rad, walk.pelvis_yaw_rad)
    away = np.abs(np.degrees(looking.head_yaw_rad - walk.head_yaw_rad))
    assert away.max() == pytest.approx(40.0, abs=1.0) or away.max() < 40.0


def test_another_pace_keeps_frames_and_never_goes_back(walk, rng):
    for _ in range(30):
        other = change_pace(walk, rng)
        assert other.times_s.size == other.head_m.shape[0] == other.head_yaw_rad.size <= walk.times_s.size
        assert np.all(np.isfinite(other.head_m))


def test_variants_are_the_same_for_the_same_seed(walk):
    a, b = (vary(walk, np.random.default_rng(7), bend_it=True) for _ in range(2))
    np.testing.assert_array_equal(a.head_m, b.head_m)
    np.testing.assert_array_equal(a.head_yaw_rad, b.head_yaw_rad)


# ---------------------------------------------------------------- examples


def test_examples_lead_to_where_the_walk_went(walk, rng):
    """Line plus departure, back in the room, is the true position at each knot."""
    from predictors.walker.predictor import Walker

    observations = as_seen(walk, 0.0, 0.0, rng, faults=False)
    examples = examples_of_walk(walk, observations, 1.0)
    walker, k = Walker(), 0
    for observation in observations:
        walker.update(observation)
        inputs = walker.inputs()
        if inputs.walking == 0.0:
            continue
        c, s = np.cos(inputs.heading_rad), np.sin(inputs.heading_rad)
        along, across, up = examples.departure_m[k, 4]
        at = inputs.origin_base_m + 0.5 * inputs.velocity_base_m_s
        at = at + np.array([c * along - s * across, s * along + c * across, up])
        frame = int(np.argmin(np.abs(walk.times_s - observation.capture_time_s - 0.5)))
        if np.isfinite(along) and abs(walk.times_s[frame] - observation.capture_time_s - 0.5) < 1e-6:
            np.testing.assert_allclose(at, walk.head_m[frame], atol=1e-5)
        k += 1
    assert k == examples.weight.size


def test_faults_leave_frames_and_orientations_out(walk):
    lengths, blind = set(), 0
    for seed in range(60):
        seen = as_seen(walk, 0.01, 0.03, np.random.default_rng(seed), faults=True)
        lengths.add(len(seen))
        blind += any(o.head_quat_wxyz is None or o.pelvis_quat_wxyz is None for o in seen)
    assert min(lengths) < 0.9 * walk.times_s.size
    assert max(lengths) == walk.times_s.size
    assert 2 < blind < 20


def test_a_walk_is_the_longest_stretch_without_a_gap():
    recording = load("subject01_R1")
    valid = np.ones(recording.times_s.size, dtype=bool)
    valid[30:45] = valid[100] = False
    holed = replace(recording, truth=replace(recording.truth, valid=valid))
    times_s = walk_of(holed).times_s
    assert times_s[0] == recording.times_s[45]
    assert recording.times_s[100] not in times_s
    assert times_s[-1] == recording.times_s[-1]
    valid[:] = False
    valid[:20] = True
    with pytest.raises(GazempcError, match=r"0\.63 s; to fit on it, at least 1\.25 s"):
        walk_of(replace(recording, truth=replace(recording.truth, valid=valid)))


@pytest.mark.parametrize("part", ["head", "pelvis"])
def test_a_walk_without_orientations_is_refused(part):
    recording = load("subject01_R1")
    name = f"{part}_quat_wxyz"
    unknown = replace(recording.truth, **{name: np.full((recording.times_s.size, 4), np.nan)})
    with pytest.raises(GazempcError, match=f"subject01_R1: the orientation of the {part} is not known"):
        walk_of(replace(recording, truth=unknown))


def test_examples_of_many_recordings_are_one_table():
    parts = [fitting_examples(name, 0, 1) for name in ("subject01_R1", "subject02_R4")]
    assert join(parts).weight.size == sum(p.weight.size for p in parts) > 100


def test_who_stands_gives_no_examples_and_that_is_said(rng):
    """A stander without noise is never walking; a recording of which nothing is left is named."""
    standing = GaplessWalk(np.arange(90) / 30, np.tile([2.0, 0.0, 1.6], (90, 1)), np.zeros(90), np.zeros(90))
    examples = examples_of_walk(standing, as_seen(standing, 0.0, 0.0, rng, faults=False), 1.0)
    assert examples.weight.size == 0
    with pytest.raises(GazempcError, match="ann_stands: nobody walks"):
        _joined([examples, examples], "ann_stands")


# ---------------------------------------------------------------- the fits


def test_spread_is_recovered():
    """Errors drawn with a known dependence of their spread on the inputs."""
    rng = np.random.default_rng(0)
    u = np.column_stack([np.ones(20000), rng.uniform(0, 2, (20000, 2))])
    true = np.array([np.log(0.05), 0.8, -0.3])
    error = np.exp(u @ true)[:, None, None] * rng.standard_normal((20000, 1, 3))
    error[::7] = np.nan
    found = fit_spread(u, error, np.ones(20000))
    np.testing.assert_allclose(found[:, 0, :], np.tile(true[:, None], 3), atol=0.03)


def test_calibration_states_what_is_there():
    """Spreads stated too small come out nearly right, on the safe side; with long tails, both are missed."""
    rng = np.random.default_rng(0)
    u = np.ones((40000, 1))
    error = 0.1 * rng.standard_normal((40000, 1, 3))
    small = np.full((1, 1, 3), np.log(0.07))
    stated = np.exp(calibrate(small, u, error))
    assert np.all((stated >= 0.1) & (stated < 0.11))
    assert np.mean(np.sum((error / stated) ** 2, axis=-1) <= 3.5059) == pytest.approx(0.72, abs=0.01)

    error = error / np.sqrt(rng.chisquare(3, (40000, 1, 1)) / 3)
    stated = np.exp(calibrate(np.full((1, 1, 3), np.log(0.15)), u, error))
    distance2 = np.sum((error / stated) ** 2, axis=-1)
    too_many, too_few = np.mean(distance2 <= 3.5059) - 0.68, 0.95 - np.mean(distance2 <= 7.8147)
    assert too_many == pytest.approx(max(too_few, 0.04), abs=0.01)


def test_networks_learn_and_are_the_same_for_the_same_seed():
    examples, other = toy(4000, 0), toy(1000, 1)
    fits = [fit_networks(examples, 3, 1, 600) for _ in range(2)]
    for a, b in zip(fits[0][0], fits[1][0], strict=True):
        np.testing.assert_array_equal(a, b)
    weights, biases = fits[0]
    h = other.network
    for i, (w, b) in enumerate(zip(weights, biases, strict=True)):
        h = h @ w[0] + b[0]
        h = np.tanh(h) if i < len(weights) - 1 else h
    model = WalkerModel(weights, biases, load_walker_model().log_spread)
    assert h.shape == (1000, 3 * KNOTS_S.size)
    error = model.answer(other.network.astype(float), other.spread.astype(float))[0] - other.departure_m
    known = np.isfinite(error[:, 4, 1])
    assert np.mean(np.abs(error[known, 4, 1])) < 0.75 * np.mean(np.abs(other.departure_m[known, 4, 1]))
