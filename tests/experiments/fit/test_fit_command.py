"""The command that fits the predictor `walker`: output, reuse, and leave-one-out splits."""

from __future__ import annotations

import functools
import io
from contextlib import redirect_stdout

import numpy as np
import pytest
from builders.fits import toy
from builders.walkers import NOTHING, straight_model

from experiments.fit.command import fit, main
from experiments.fit.examples import Examples
from experiments.fit.networks import fit_network
from experiments.fit.spread import errors_on_left_out
from predictors.walker.network import DEPARTURE_SCALE_M, DEPARTURES, Network, WalkerModel, load_walker_model

pytestmark = pytest.mark.usefixtures("in_this_process")


def settings(folder, **changes):
    plain = {"variants": 2, "steps": 20, "jobs": 1, "out": folder}
    return {"recordings": ("subject01_R1", "subject02_R4"), **plain, **changes}


@pytest.fixture(scope="module")
def finished(tmp_path_factory, in_this_process):
    """Output folder of the fit command on few examples: a slow tracker, equal row counts for each fit."""
    folder = tmp_path_factory.mktemp("finished")
    slow = folder / "slow.toml"
    slow.write_text('name = "slow"\nsource = "a test"\nrate_hz = 5.0\nlatency_s = 0.1\n')
    words = ["--recordings", "subject01_R1", "subject02_R4", "--variants", "2", "--steps", "20"]
    output = io.StringIO()
    with redirect_stdout(output), pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.fit.networks.fit_network", fitted_once())
        assert main([*words, "--tracker", str(slow), "--jobs", "1", "--out", str(folder / "fit")]) == 0
    assert "--walker.fitted" in output.getvalue()
    return folder / "fit"


def fitted_once():
    """Fits the first network; the others are copies scaled by their own examples, as JAX takes seconds for each."""
    first = functools.cache(lambda: fit_network(Examples(*(column[:30] for column in seen[0])), *seen[1]))
    seen = []

    def fit_or_scale(examples, *settings):
        seen[:] = seen or [vars(examples).values(), settings]
        scale = np.float32(1.0 + np.nanmean(np.abs(examples.departure_m)))
        return Network(tuple(scale * weights for weights in first().weights), first().biases)

    return fit_or_scale


@pytest.mark.slow
def test_the_command_writes_a_model_of_all_people_and_leave_one_out_models(finished):
    everybody = load_walker_model(finished / "walker.npz")
    assert everybody.about["people"] == ["subject01", "subject02"]
    assert everybody.about["recordings"] == ["subject01_R1", "subject02_R4"]
    assert everybody.about["settings"]["steps"] == 20
    without = load_walker_model(finished / "left_out" / "subject01.npz")
    assert without.about["people"] == ["subject02"]
    for name in ("seeing", "blind"):
        assert not np.array_equal(getattr(without, name).weights[0], getattr(everybody, name).weights[0])
    assert np.any(without.log_spread != everybody.log_spread)
    assert np.all(everybody.noise_share > 0.0)
    assert everybody.degrees_of_freedom >= 5.0
    assert sorted(p.name for p in finished.iterdir()) == ["left_out", "runs", "walker.npz"]


def constant_model(value):
    """A model with a constant departure along the line: `value` at each knot, in units of its scale."""
    bias = NOTHING.biases[0].copy()
    bias[DEPARTURES][::3] = value
    return WalkerModel(*2 * (Network(NOTHING.weights, (bias,)),), straight_model().log_spread)


def test_errors_are_by_the_model_fitted_without_the_person():
    """With two clips per person, and models with distinct forecasts."""
    people = ["ann", "bob", "ann", "bob"]
    scoring = [toy(5, k) for k in range(4)]
    found = errors_on_left_out({"ann": constant_model(1.0), "bob": constant_model(2.0)}, people, scoring)
    for person, errors, examples in zip(people, found, scoring, strict=True):
        predicted = errors.error_m + examples.departure_m
        expected = {"ann": 1.0, "bob": 2.0}[person] * DEPARTURE_SCALE_M
        np.testing.assert_allclose(predicted[1, :, 0], expected, rtol=1e-5)
        np.testing.assert_array_equal(errors.weight, examples.weight)


def test_networks_are_not_fitted_on_the_person_left_out(tmp_path, monkeypatch):
    """Each fit reads the example files of all other people."""
    asked = []

    def spy(engine, jobs):
        asked.append(jobs)
        return [{"failed": None, "left_out": None, **vars(toy(5, 0))} for _ in jobs]

    people = {"subject01_R1": "subject01", "subject02_R4": "subject02", "subject01_R4": "subject01"}
    monkeypatch.setattr("experiments.fit.command.Engine.run", spy)
    monkeypatch.setattr("experiments.fit.command.model_of", lambda *_: (_ for _ in ()).throw(StopIteration))
    with pytest.raises((StopIteration, RuntimeError)):
        fit(**settings(tmp_path, recordings=tuple(people)))
    examples, scoring, fits = asked
    person_of = {job.key(): people[job.recording] for job in examples}
    # Errors are measured with another random seed than the fit.
    assert [(job.recording, job.seed, job.variants) for job in scoring] == [(name, 1, 0) for name in people]
    read = [[person_of[path.stem] for path in job.examples] for job in fits]
    everybody = ["subject01", "subject02", "subject01"]
    assert read == [["subject02"]] * 2 + [["subject01"] * 2] * 2 + [everybody] * 2
    assert [job.sees_yaws for job in fits] == [True, False] * 3
