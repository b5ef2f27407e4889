"""Sweep files: invalid ones are refused with all errors; names set their values, designs have their points."""

import numpy as np
import pytest
from builders.studies import SMALL, refusal, words

from experiments.aggregate import METRICS
from experiments.sweep.names import check_name, check_value, resolve, setting_fields, with_unit
from experiments.sweep.page import pareto_front
from experiments.sweep.plan import design_points, load_plan, shipped_studies
from experiments.sweep.spec import Objective, SweepSpec
from experiments.sweep.sweep import main


def test_all_errors_of_a_file_are_reported_together(tmp_path):
    text = refusal(
        tmp_path,
        {
            "name": "bad",
            "recordigs": ["synthetic"],
            "recordings": ["subject01_R1", "subject99_R1", str(tmp_path / "none.csv")],
            "base": {"mpc.horizn_s": 1, "distance_m": -1},
            "vary": {"mpc.horizon_s": [0.5, 9], "seed": [], "mpc.smoothing_time_s": {"low": 0.1, "high": 0.2}},
            "metrics": ["gaze_eror_rms_deg"],
        },
    )
    for expected in (
        "recordigs: unknown field; perhaps you meant 'recordings'",
        "subject99_R1",
        "none.csv",
        "base: mpc.horizn_s: unknown setting; perhaps you meant 'mpc.horizon_s'",
        "base: distance_m",
        "vary: mpc.horizon_s: Input should be less than or equal to 5",
        "vary: seed: an empty list of values",
        "perhaps you meant 'gaze_error_rms_deg'",
    ):
        assert expected in text, expected


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"vary": {}}, "no setting varies"),
        ({"vary": {"mpc.smoothing_time_s": {"low": 0.1, "high": 0.2}}}, "a grid needs a list of values"),
        ({"base": {}}, "no controller"),
        ({"figures": {"response": ["mpc.horizon_s", "eye_contact_4", "case"]}}, "mpc.horizon_s does not vary"),
        ({"recordings": []}, "recordings"),
        ({"design": "random"}, "n: missing"),
        ({"design": "random", "n": 3, "vary": {"seed": {"low": 3, "high": 1}}}, "low (3) must be less than high (1)"),
        ({"design": "sobol", "n": 3, "vary": {"neck": {"low": 3, "high": 5}}}, "is not numeric"),
        ({"design": "sobol", "n": 3, "vary": {"seed": {"low": 0, "high": 2.5}}}, "not an integer"),
        ({"design": "optuna", "n": 3, "vary": {"distance_m": {"low": 0, "high": 2, "log": True}}}, "low"),
        ({"vary": {"seed": {"lo": 1, "high": 2}}}, "perhaps you meant 'low'"),
        ({"vary": {"controller": ["mpc"]}}, "controller is in base too"),
        ({"base": {"controller": "mcp"}}, "perhaps you meant 'mpc'"),
        ({"vary": {"horizon_s": [0.5, 1]}}, "'mpc.horizon_s'"),
        ({"vary": {"mpc.horizon_s": [True]}}, "float"),
        ({"cases": [{"name": "a"}, {"name": "a"}]}, "duplicate name"),
        ({"vary": {"neck.pan.position_min_deg": [0, 90]}}, "must be less than position_max_deg"),
    ],
)
def test_bad_files_are_refused(change, expected, tmp_path):
    assert expected in refusal(tmp_path, SMALL | change)


def test_a_bad_recording_is_refused_before_any_run(tmp_path, capsys):
    (tmp_path / "bad.csv").write_text("t,head_x\n0,1\n")
    assert main(words(tmp_path, SMALL, "--recordings", str(tmp_path / "bad.csv"))) == 2
    assert "bad.csv" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", sorted(shipped_studies()))
def test_every_shipped_study_is_a_valid_sweep_with_a_question(name):
    plan = load_plan(name, ["subject01_R1"])
    assert plan.spec.name == name
    assert plan.spec.question
    assert all(plan.points.values())


def case_of(**changes):
    return SweepSpec.model_validate(SMALL | changes).all_cases()[0]


def test_a_grid_has_every_combination_once():
    points = design_points(case_of(vary={"seed": [0, 1, 1], "distance_m": [2, 3], "neck": ["slow"]}), seed=0)
    assert {tuple(p.values()) for p in points} == {(s, d, "slow") for s in (0, 1) for d in (2, 3)}
    assert len(points) == 4


@pytest.mark.parametrize("design", ["random", "sobol"])
def test_sampled_designs_are_in_bounds_evenly_spread_and_reproducible(design):
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


def test_a_case_changes_only_its_named_values():
    spec = SweepSpec.model_validate(
        SMALL
        | {"cases": [{"name": "a"}, {"name": "b", "base": {"controller": "reactive", "model.dead_time_scale": 1}}]}
    )
    first, second = spec.all_cases()
    assert first.base["controller"] == "lookahead"
    assert second.base["controller"] == "reactive"
    assert list(first.vary) == ["model.dead_time_scale", "lookahead.smoothing_time_s"]
    assert list(second.vary) == ["lookahead.smoothing_time_s"]


def test_the_front_is_the_non_dominated_set():
    goals = [Objective(metric="eye_contact_2p6", direction="maximize"), Objective(metric="sparc", direction="minimize")]
    values = [(0.5, 1.0), (0.6, 2.0), (0.5, 2.0), (0.9, 5.0), (0.8, 6.0), (None, 0.0)]
    front = pareto_front([{"eye_contact_2p6": a, "sparc": b} for a, b in values], goals)
    assert [(row["eye_contact_2p6"], row["sparc"]) for row in front] == [(0.5, 1.0), (0.6, 2.0), (0.9, 5.0)]


def test_each_kind_of_name_sets_its_value():
    run = resolve(
        {
            "controller": "mpc",
            "mpc.horizon_s": 0.5,
            "start_offset_deg": 60,
            "neck": "slow",
            "neck.pan.dead_time_s": 0.2,
            "neck.both.velocity_max_rad_s": 0.7,
            "neck.geometry.eye_in_tilt_m": [0.1, 0, 0],
            "sensor.latency_s": 0.1,
        }
    )
    assert (run.controller, run.settings.mpc.horizon_s, run.settings.start_offset_deg) == ("mpc", 0.5, 60)
    assert run.robot_neck == run.neck
    np.testing.assert_array_equal(run.robot_neck.dead_time_s, [0.2, 0.4])
    np.testing.assert_array_equal(run.robot_neck.velocity_max_rad_s, [0.7, 0.7])
    assert run.robot_neck.geometry.eye_in_tilt_m == (0.1, 0, 0)
    sensor = run.sensors["reference"]
    assert (sensor.name, sensor.latency_s, sensor.rate_hz) == ("reference", 0.1, 30)


def test_a_dead_time_error_applies_to_the_model_alone():
    variant = resolve({"controller": "mpc", "neck.tilt.dead_time_s": 0.2, "model.dead_time_scale": 1.5})
    np.testing.assert_array_equal(variant.robot_neck.dead_time_s, [0.4, 0.2])
    np.testing.assert_allclose(variant.neck.dead_time_s, [0.6, 0.3])


def test_every_default_is_valid_for_its_name():
    for name, field in setting_fields().items():
        assert check_name(name) is None
        if not field.is_required():
            assert check_value(name, field.default) == (field.default, None), name


def test_every_metric_has_a_label():
    for name in (*METRICS, *setting_fields()):
        assert "_" not in with_unit(name), name
