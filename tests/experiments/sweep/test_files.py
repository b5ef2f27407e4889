"""Sweep files: every bad one is refused whole, before anything runs."""

import pytest
from builders.sweeps import SMALL, refusal, words

from experiments.sweep.plan import load_plan, shipped_studies
from experiments.sweep.sweep import main


def test_all_errors_of_a_file_at_once(tmp_path):
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
        "recordigs: unknown key; perhaps you meant 'recordings'",
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
        ({"vary": {}}, "nothing varies"),
        ({"vary": {"mpc.smoothing_time_s": {"low": 0.1, "high": 0.2}}}, "a grid needs a list of values"),
        ({"base": {}}, "no controller"),
        ({"figures": {"response": ["mpc.horizon_s", "eye_contact_4", "case"]}}, "mpc.horizon_s does not vary"),
        ({"recordings": []}, "recordings"),
        ({"design": "random"}, "n: missing"),
        ({"design": "random", "n": 3, "vary": {"seed": {"low": 3, "high": 1}}}, "low (3) must be less than high (1)"),
        ({"design": "sobol", "n": 3, "vary": {"neck": {"low": 3, "high": 5}}}, "no numbers between two ends"),
        ({"design": "sobol", "n": 3, "vary": {"seed": {"low": 0, "high": 2.5}}}, "not a whole number"),
        ({"design": "optuna", "n": 3, "vary": {"distance_m": {"low": 0, "high": 2, "log": True}}}, "low"),
        ({"vary": {"seed": {"lo": 1, "high": 2}}}, "perhaps you meant 'low'"),
        ({"vary": {"controller": ["mpc"]}}, "controller is in base too"),
        ({"cases": [{"name": "a"}, {"name": "a"}]}, "used twice"),
        ({"cases": [{"name": "a", "vry": {}}]}, "perhaps you meant 'vary'"),
        ({"vary": {"neck.pan.position_min_deg": [0, 90]}}, "must be less than position_max_deg"),
    ],
)
def test_bad_files_are_refused(change, expected, tmp_path):
    assert expected in refusal(tmp_path, SMALL | change)


def test_bad_input_is_refused_before_anything_runs(tmp_path, capsys):
    (tmp_path / "bad.csv").write_text("t,head_x\n0,1\n")
    assert main(words(tmp_path, SMALL, "--recordings", str(tmp_path / "bad.csv"))) == 2
    assert "bad.csv" in capsys.readouterr().err
    assert main(["paretto", "--out", str(tmp_path / "out")]) == 2
    assert "perhaps you meant 'pareto'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", sorted(shipped_studies()))
def test_every_shipped_study_is_a_valid_sweep_with_a_question(name):
    plan = load_plan(name, ["subject01_R1"])
    assert plan.spec.name == name
    assert plan.spec.question
    assert all(plan.points.values())
