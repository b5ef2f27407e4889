"""The model of `Walker`: network outputs, departures between knots, and refusals."""

import dataclasses
import json
import math

import numpy as np
import pytest
from builders.walkers import random_model
from scipy.interpolate import CubicSpline
from scipy.special import softmax

from gazempc.errors import SettingsError
from gazempc.loop.build import Person, make_predictor
from gazempc.settings import WalkerSettings
from gazempc.sim.replay import ReplaySettings
from predictors.walker.features import KNOWN, MIRROR, N_INPUTS, N_PLACES, N_SPREAD, N_VELOCITIES
from predictors.walker.knots import KNOTS_S, BetweenKnots
from predictors.walker.network import (
    DEPARTURE_SCALE_M,
    N_DOUBT,
    N_OUTPUTS,
    WalkerModelError,
    load_walker_model,
    save_walker_model,
)


def layers(network, inputs):
    """Outputs, layer by layer, shape (outputs,)."""
    h = inputs
    for i, (w, b) in enumerate(zip(network.weights, network.biases, strict=True)):
        h = h @ w.astype(float) + b
        h = np.tanh(h) if i < len(network.weights) - 1 else h
    return h


def motion_of(outputs, places_m, velocities_m_s):
    """Departures of walking and of standing, and logits of walking."""
    assert outputs.shape[-1] == N_OUTPUTS
    k = 3 * KNOTS_S.size
    departures = outputs[:, :k].reshape(-1, KNOTS_S.size, 3) * DEPARTURE_SCALE_M[:, None]
    stay_m = softmax(outputs[:, k + 1 : k + 1 + N_PLACES], axis=-1) @ places_m
    # Convex combination of rest and of the filters' velocities.
    initial_m_s = softmax(outputs[:, k + 1 + N_PLACES :], axis=-1) @ np.vstack([np.zeros(3), velocities_m_s[1:]])
    # Critically damped: a return with a time constant of 0.4 s, and the transient of a velocity with 0.7 s.
    returned = 1.0 - ((1.0 + KNOTS_S / 0.4) * np.exp(-KNOTS_S / 0.4))[:, None]
    at_m = places_m[0] + returned * (stay_m[:, None, :] - places_m[0])
    at_m = at_m + (KNOTS_S * np.exp(-KNOTS_S / 0.7))[:, None] * initial_m_s[:, None, :]
    return departures, at_m - KNOTS_S[:, None] * velocities_m_s[0], outputs[:, k]


@pytest.mark.parametrize(("network", "known"), [("seeing", (1.0, 1.0)), ("seeing", (0.0, 1.0)), ("blind", (0.0, 0.0))])
def test_departure_is_the_mean_over_regimes_and_mirror_images(network, known):
    """With the network for tracks with orientation, or without."""
    rng, model = np.random.default_rng(3), dataclasses.replace(random_model(), decision=(1.5, 0.3))
    x, spread = rng.standard_normal(N_INPUTS), rng.standard_normal(N_SPREAD)
    x[KNOWN], of_stay = known, (0.1 * rng.standard_normal((N_PLACES, 3)), rng.standard_normal((N_VELOCITIES, 3)))
    own = motion_of(layers(getattr(model, network), x)[None], *of_stay)
    turned = motion_of(layers(getattr(model, network), x * MIRROR)[None], *(each * [1, -1, 1] for each in of_stay))
    mirrored = turned[0] * [1, -1, 1], turned[1] * [1, -1, 1], turned[2]
    walk, stay, logit = (np.concatenate(pair) for pair in zip(own, mirrored, strict=True))
    outputs = model.outputs(x)
    walks = 1.0 / (1.0 + np.exp(-1.5 * (logit - 0.3)))
    answers = walks[:, None, None] * walk + (1.0 - walks)[:, None, None] * stay
    departure, doubt = model.answer(outputs, spread, *of_stay)
    np.testing.assert_allclose(departure, answers.mean(axis=0), atol=1e-6)
    np.testing.assert_array_equal(doubt[:N_SPREAD], spread)
    near, far = (int(np.flatnonzero(h == KNOTS_S)[0]) for h in (0.5, 1.0))
    size = np.abs([departure[near, 1] / 0.06, departure[far, 1] / 0.2, departure[far, 0] / 0.2])
    np.testing.assert_allclose(doubt[N_SPREAD:-3], np.minimum(size, 4.0), atol=1e-5)
    off = (answers - answers.mean(axis=0))[:, far, :2]
    apart = np.sqrt(np.mean(np.sum(off**2, axis=-1)))
    np.testing.assert_allclose(doubt[-3], np.log1p(apart / 0.02), atol=1e-5)
    torn = np.sqrt(np.mean(walks * (1.0 - walks) * np.sum((walk - stay)[:, far, :2] ** 2, axis=-1)))
    np.testing.assert_allclose(doubt[-2], np.log1p(torn / 0.02), atol=1e-5)
    np.testing.assert_allclose(doubt[-1], walks.mean(), atol=1e-6)


def test_outputs_are_blended_by_the_weight_of_orientation():
    x, model = np.random.default_rng(4).standard_normal(N_INPUTS), random_model()
    x[KNOWN] = 0.25, 0.5
    np.testing.assert_allclose(model.outputs(x), 0.5 * model.seeing(x) + 0.5 * model.blind(x), atol=1e-12)


@pytest.mark.parametrize("v", [3.0, 5.0, math.inf])
def test_spread_is_the_standard_deviation_of_the_t_distribution(v):
    model = dataclasses.replace(random_model(), degrees_of_freedom=v)
    doubt = np.random.default_rng(0).uniform(0.0, 1.0, N_DOUBT)
    units = np.tanh(doubt @ model.hidden)
    scale = np.exp(np.tensordot(doubt, model.log_spread, axes=1) + np.tensordot(units, model.log_spread_hidden, axes=1))
    factor = 1.0 if v == math.inf else math.sqrt(v / (v - 2.0))
    stated = model.spread_m(doubt)
    assert stated.shape == (KNOTS_S.size, 4)
    np.testing.assert_allclose(stated[:, :3], factor * scale)
    np.testing.assert_allclose(stated[:, 3], factor * model.noise_share)
    first = np.eye(N_DOUBT)[0]  # log_spread[0] is negative
    np.testing.assert_allclose(model.spread_m(1e3 * first)[:, :3], factor * 0.002)
    np.testing.assert_allclose(model.spread_m(-1e3 * first)[:, :3], factor * 5.0)


def test_departures_and_spread_at_between_and_beyond_the_knots():
    rng = np.random.default_rng(0)
    departure, spread = rng.standard_normal((8, 3)), np.sort(rng.uniform(0.01, 0.5, (8, 3)), axis=0)
    at, sd = BetweenKnots(departure, spread)(KNOTS_S)
    np.testing.assert_allclose(at, departure, atol=1e-9)
    np.testing.assert_allclose(sd, spread, atol=1e-9)
    fine = np.linspace(-0.2, 1.5, 400)
    expected = CubicSpline(KNOTS_S, departure)(np.clip(fine, 0.0, 1.5))
    found, sd = BetweenKnots(departure, spread)(fine)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    expected_sd = np.stack([np.interp(np.abs(fine), KNOTS_S, column) for column in spread.T], axis=1)
    np.testing.assert_allclose(sd, expected_sd, atol=1e-9)
    beyond, wide = BetweenKnots(departure, spread)(np.array([1.5, 2.0, 2.5]))
    np.testing.assert_allclose(beyond[2] - beyond[1], departure[7] - departure[6], atol=1e-9)
    np.testing.assert_allclose(beyond[1] - beyond[0], departure[7] - departure[6], atol=1e-9)
    np.testing.assert_allclose(wide[1], spread[7] * (2.0 / 1.5) ** 1.5, atol=1e-9)
    falling = BetweenKnots(departure, spread[::-1])(np.linspace(0, 3, 100))[1]
    assert np.all(np.diff(falling, axis=0) >= -1e-12)


GOOD = random_model()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hidden": GOOD.hidden[:-1]}, "hidden: an array of shape"),
        ({"hidden": GOOD.hidden * np.inf}, "expected finite numbers"),
        ({"decision": (0.0, 0.7)}, "expected a positive slope and a threshold"),
        ({"decision": (1.5, math.nan)}, "expected a positive slope and a threshold"),
        ({"degrees_of_freedom": 2.0}, "expected more than 2"),
        ({"degrees_of_freedom": math.nan}, "expected more than 2"),
    ],
)
def test_invalid_model_values_are_refused(change, message):
    with pytest.raises(WalkerModelError, match=message):
        dataclasses.replace(GOOD, **change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weights": (GOOD.seeing.weights[0][:-1], *GOOD.seeing.weights[1:])}, "weights of layer 1"),
        ({"weights": GOOD.seeing.weights[:-1], "biases": GOOD.seeing.biases[:-1]}, "weights of layer 2"),
        ({"biases": GOOD.seeing.biases[:-1]}, "one bias a layer"),
        ({"weights": (GOOD.seeing.weights[0][None], *GOOD.seeing.weights[1:])}, "weights of layer 1"),
        ({"biases": (GOOD.seeing.biases[0][None], *GOOD.seeing.biases[1:])}, "biases of layer 1"),
        ({"weights": (np.float32(0.0), *GOOD.seeing.weights[1:])}, "weights of layer 1"),
        ({"biases": (GOOD.seeing.biases[0] * np.inf, *GOOD.seeing.biases[1:])}, "biases of layer 1: .* finite"),
    ],
)
def test_invalid_layers_are_refused(change, message):
    with pytest.raises(WalkerModelError, match=message):
        dataclasses.replace(GOOD.seeing, **change)


# ---------------------------------------------------------------- files


def test_a_model_survives_a_round_trip(tmp_path):
    model = random_model(degrees_of_freedom=3.5)
    save_walker_model(model, tmp_path / "m.npz")
    np.testing.assert_equal(dataclasses.asdict(load_walker_model(tmp_path / "m.npz")), dataclasses.asdict(model))


def test_the_shipped_model_states_its_provenance():
    model = load_walker_model()
    about = model.about
    assert len(about["people"]) == 19  # four of them are standing trials
    assert len(about["recordings"]) == 77
    assert "experiments.fit" in about["command"]
    assert "/" not in json.dumps(about["command"])


@pytest.mark.parametrize("content", [b"", b"no archive", None, "degrees_of_freedom", "hidden", "blind_weights_0"])
def test_an_invalid_model_file_is_named(tmp_path, content):
    path = tmp_path / "walker.npz"
    if content is None:
        np.savez(path, something=np.zeros(3))
    elif isinstance(content, str):  # default of models without this parameter
        save_walker_model(random_model(), path)
        with np.load(path) as data:
            np.savez(path, **{k: v for k, v in data.items() if k != content})
    else:
        path.write_bytes(content)
    with pytest.raises(WalkerModelError, match=r"walker\.npz"):
        load_walker_model(path)
    with pytest.raises(SettingsError, match=r"walker\.fitted.*walker\.npz"):
        make_predictor("walker", ReplaySettings(walker=WalkerSettings(fitted=path)), Person(), {})
