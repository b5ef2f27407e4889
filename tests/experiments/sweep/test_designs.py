"""Designs: a grid has every combination, drawn points are inside, even and the same again; the front is unbeaten."""

import numpy as np
import pytest
from builders.sweeps import SMALL

from experiments.sweep.plan import design_points
from experiments.sweep.spec import Objective, SweepSpec
from experiments.sweep.tables import pareto_front


def case_of(**changes):
    return SweepSpec.model_validate(SMALL | changes).all_cases()[0]


def test_a_grid_has_every_combination_once():
    points = design_points(case_of(vary={"seed": [0, 1, 1], "distance_m": [2, 3], "neck": ["slow"]}), seed=0)
    assert {tuple(p.values()) for p in points} == {(s, d, "slow") for s in (0, 1) for d in (2, 3)}
    assert len(points) == 4


@pytest.mark.parametrize("design", ["random", "sobol"])
def test_drawn_designs_are_inside_even_and_the_same_again(design):
    vary = {
        "distance_m": {"low": 2, "high": 4},
        "mpc.horizon_s": {"low": 0.1, "high": 1.6, "log": True},
        "seed": {"low": 1, "high": 3},
        "neck": ["slow", "reference"],
    }
    points = design_points(case_of(design=design, n=200, vary=vary), seed=0)
    assert points == design_points(case_of(design=design, n=200, vary=vary), seed=0)
    assert points != design_points(case_of(design=design, n=200, vary=vary), seed=1)
    assert points[:50] == design_points(case_of(design=design, n=50, vary=vary), seed=0)
    assert all(2 <= p["distance_m"] <= 4 and 0.1 <= p["mpc.horizon_s"] <= 1.6 for p in points)
    assert np.mean([p["distance_m"] for p in points]) == pytest.approx(3, abs=0.15)
    assert np.median([p["mpc.horizon_s"] for p in points]) == pytest.approx(0.4, rel=0.2)
    for value in (1, 2, 3):
        assert sum(p["seed"] == value for p in points) == pytest.approx(200 / 3, abs=20)
    assert sum(p["neck"] == "slow" for p in points) == pytest.approx(100, abs=20)


def test_a_case_changes_only_what_it_says():
    spec = SweepSpec.model_validate(
        SMALL
        | {"cases": [{"name": "a"}, {"name": "b", "base": {"controller": "reactive", "model.dead_time_scale": 1}}]}
    )
    first, second = spec.all_cases()
    assert first.base["controller"] == "lookahead"
    assert second.base["controller"] == "reactive"
    assert list(first.vary) == ["model.dead_time_scale", "lookahead.smoothing_time_s"]
    assert list(second.vary) == ["lookahead.smoothing_time_s"]


def test_the_front_is_what_nothing_beats():
    goals = [Objective(metric="eye_contact_2p6", direction="maximize"), Objective(metric="sparc", direction="minimize")]
    values = [(0.5, 1.0), (0.6, 2.0), (0.5, 2.0), (0.9, 5.0), (0.8, 6.0), (None, 0.0)]
    front = pareto_front([{"eye_contact_2p6": a, "sparc": b} for a, b in values], goals)
    assert [(row["eye_contact_2p6"], row["sparc"]) for row in front] == [(0.5, 1.0), (0.6, 2.0), (0.9, 5.0)]
