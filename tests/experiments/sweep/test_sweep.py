"""Sweeps: every bad file is refused whole, nothing is done twice, nothing is lost, and known effects are found."""

import contextlib
import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

import experiments.sweep.runner
from experiments.engine.jobs import program_hash
from experiments.sweep.command import SweepSettings, main, sweep
from experiments.sweep.designs import design_points
from experiments.sweep.plan import load_plan, shipped_studies
from experiments.sweep.runner import Run, Runner
from experiments.sweep.spec import TIMING, Objective, SweepSpec
from experiments.sweep.tables import pareto_front
from experiments.sweep.variants import check_name, check_value, resolve, setting_fields
from gazempc.errors import GazempcError, MissingOptionalDependencyError, SettingsError
from gazempc.neck.spec import load_neck
from gazempc.recordings.load import load

ROOT = Path(__file__).resolve().parents[3]
SMALL = {
    "name": "small",
    "recordings": ["subject01_R1", "subject02_R4"],
    "base": {"controller": "lookahead"},
    "vary": {"model.dead_time_scale": [0.5, 1], "lookahead.smoothing_time_s": [0, 0.1]},
}
TUNED = {
    "name": "tuned",
    "recordings": ["subject01_R1"],
    "base": {"controller": "lookahead"},
    "vary": {
        "lookahead.smoothing_time_s": {"low": 0, "high": 0.3},
        "predictor": ["last_position", "constant_velocity"],
    },
    "design": "optuna",
    "n": 20,
}


def written(folder, content):
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "sweep.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def words(folder, content, *more):
    return [str(written(folder, content)), "--out", str(folder / "out"), "--no-figures", "--jobs", "1", *more]


def table_of(folder, name="results.csv"):
    with (folder / "out" / name).open(newline="") as file:
        return [{k: v for k, v in row.items() if k not in TIMING} for row in csv.DictReader(file)]


def refusal(folder, content):
    with pytest.raises(SettingsError) as caught:
        load_plan(written(folder, content))
    return str(caught.value)


@contextlib.contextmanager
def killed_after(folder, arguments, enough):
    """Start a sweep in a process of its own and kill it, workers and all, as soon as `enough()` says so."""
    process = subprocess.Popen(
        [sys.executable, "-m", "experiments.sweep", *arguments],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    give_up_s = time.monotonic() + 60
    while not enough() and process.poll() is None and time.monotonic() < give_up_s:
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    before = {path: path.stat().st_mtime_ns for path in (folder / "out" / "runs").glob("*.json")}
    yield before
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in before.items()), "a run was done twice"


# Dotted names


def test_each_kind_of_name_changes_what_it_says():
    variant = resolve(
        {
            "controller": "mpc",
            "mpc.horizon_s": 0.5,
            "constant_velocity.acceleration_psd": 0.2,
            "head_pose.weight": 0.7,
            "loop.compute_delay_s": 0.02,
            "start_offset_deg": 60,
            "distance_m": 3,
            "seed": 7,
            "neck": "slow",
            "neck.pan.dead_time_s": 0.2,
            "neck.both.velocity_max_rad_s": 0.7,
            "neck.geometry.eye_in_tilt_m": [0.1, 0, 0],
            "sensor.latency_s": 0.1,
        }
    )
    settings = variant.settings
    assert (settings.mpc.horizon_s, settings.constant_velocity.acceleration_psd) == (0.5, 0.2)
    assert (settings.head_pose.weight, settings.loop.compute_delay_s) == (0.7, 0.02)
    assert (settings.start_offset_deg, settings.distance_m, settings.seed) == (60, 3, 7)
    assert variant.robot_neck == variant.model_neck
    np.testing.assert_array_equal(variant.robot_neck.dead_time_s, [0.2, 0.4])
    np.testing.assert_array_equal(variant.robot_neck.velocity_max_rad_s, [0.7, 0.7])
    assert variant.robot_neck.pan.acceleration_max_rad_s2 == load_neck("slow").pan.acceleration_max_rad_s2
    assert variant.robot_neck.geometry.eye_in_tilt_m == (0.1, 0, 0)
    sensor = variant.sensor_for(load("subject01_R1"))
    assert (sensor.name, sensor.latency_s, sensor.rate_hz) == ("reference", 0.1, 30)


def test_only_the_model_is_wrong_about_the_dead_time():
    variant = resolve({"controller": "mpc", "neck.tilt.dead_time_s": 0.2, "model.dead_time_scale": 1.5})
    np.testing.assert_array_equal(variant.robot_neck.dead_time_s, [0.4, 0.2])
    np.testing.assert_allclose(variant.model_neck.dead_time_s, [0.6, 0.3])


def test_a_named_axis_wins_over_both_in_any_order():
    for values in ({"neck.pan.dead_time_s": 0.1, "neck.both.dead_time_s": 0.3}, {"neck.both.dead_time_s": 0.3}):
        neck = resolve({"controller": "mpc", **values}).robot_neck
        assert neck.pan.dead_time_s == values.get("neck.pan.dead_time_s", 0.3)
        assert neck.tilt.dead_time_s == 0.3


def test_every_default_is_a_value_that_its_name_accepts():
    for name, field in setting_fields().items():
        assert check_name(name) is None
        if not field.is_required():
            assert check_value(name, field.default) == (field.default, None), name


@pytest.mark.parametrize(
    ("name", "expected"),
    [("mpc.horizn_s", "'mpc.horizon_s'"), ("horizon_s", "'mpc.horizon_s'"), ("nek", "'neck'"), ("out", "unknown")],
)
def test_a_wrong_name_gets_a_suggestion(name, expected):
    assert expected in check_name(name)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("mpc.horizon_s", 9, ">= 0.1 and <= 5"),
        ("mpc.horizon_s", "long", "a number"),
        ("mpc.horizon_s", True, "a number"),
        ("height_m", float("nan"), "a number"),
        ("seed", 1.5, "a whole number >= 0"),
        ("controller", "mcp", "perhaps you meant 'mpc'"),
        ("placement", "sid", "perhaps you meant 'side'"),
        ("neck", "slw", "perhaps you meant 'slow'"),
        ("sensor", "perfct", "perhaps you meant 'perfect'"),
        ("neck.pan.damping_ratio", 0, "> 0.1 and <= 10"),
    ],
)
def test_a_wrong_value_is_told_what_is_accepted(name, value, expected):
    assert expected in check_value(name, value)[1]


# Files


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
            "figures": {"response": ["lookahead.smoothing_time_s", "eye_contact_4", "case"]},
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
        "mpc.smoothing_time_s: a grid needs a list of values",
        "perhaps you meant 'gaze_error_rms_deg'",
        "no controller",
        "figures.response: lookahead.smoothing_time_s does not vary",
    ):
        assert expected in text, expected


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"vary": {}}, "nothing varies"),
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


# Designs


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


# Runs


def run_of(walk, **changes):
    return Run(walk, resolve({"controller": "lookahead", **changes}), "1")


def test_a_result_is_named_by_all_it_depends_on(tmp_path):
    walk = load_plan(written(tmp_path, SMALL)).walks[0]
    changes = [{}, {"seed": 1}, {"model.dead_time_scale": 0.9}, {"sensor.rate_hz": 10}, {"neck": "slow"}]
    keys = {run_of(walk, **change).key() for change in changes}
    keys.add(Run(walk, resolve({"controller": "lookahead"}), "2").key())
    source = (tmp_path / "walk.csv").resolve()
    rows = ["t,head_x,head_y,head_z"] + [f"{i / 30},{1 + i / 30},1,1.6" for i in range(90)]
    for text in (rows, rows[:-1]):
        source.write_text("\n".join(text))
        with contextlib.suppress(GazempcError):
            keys.add(run_of(load_plan(written(tmp_path, SMALL), [str(source)]).walks[0]).key())
    assert len(keys) >= 6
    assert run_of(walk).key() == run_of(walk, seed=0).key()


def test_a_changed_file_is_neither_run_nor_kept(tmp_path):
    walk = load_plan(written(tmp_path, SMALL)).walks[0]
    (tmp_path / "walk.csv").write_text("now something else")
    other = type(walk)(walk.name, str(tmp_path / "walk.csv"), "0123", walk.subject, walk.group)
    run = Run(other, resolve({"controller": "lookahead"}), program_hash())
    runner = Runner(
        tmp_path / "runs", lambda runs: ((k, experiments.sweep.runner.execute(r)) for k, r in runs.items()), 1
    )
    assert "has changed" in runner.run([run])[0]["failed"]
    runner.close()
    assert not list((tmp_path / "runs").iterdir())


def test_a_bug_in_one_run_does_not_end_the_others_and_is_not_kept(tmp_path, monkeypatch):
    whole = experiments.sweep.runner._figures

    def broken(run):
        if run.variant.settings.seed == 1:
            raise TypeError("a bug")
        return whole(run)

    monkeypatch.setattr(experiments.sweep.runner, "_figures", broken)
    content = SMALL | {"vary": {"seed": [0, 1]}, "recordings": ["subject01_R1"]}
    assert main(words(tmp_path, content)) == 1
    assert [r["failed"] for r in table_of(tmp_path)] == ["", "TypeError: a bug"]
    monkeypatch.undo()
    assert main(words(tmp_path, content)) == 0


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """A small sweep done in one go, by two processes."""
    folder = tmp_path_factory.mktemp("undisturbed")
    assert sweep(SweepSettings(sweep=str(written(folder, SMALL)), jobs=2, out=folder / "out", figures=False)) == 0
    return folder


def test_tables_and_known_effects(undisturbed):
    rows, table = table_of(undisturbed), table_of(undisturbed, "table.csv")
    assert len(rows) == 8
    assert len({(r["point"], r["recording"]) for r in rows}) == 8
    summary = json.loads((undisturbed / "out" / "summary.json").read_text())
    assert (summary["n_runs"], summary["failed"], summary["limit_violations"]) == (8, [], 0)
    overall = {
        (float(r["model.dead_time_scale"]), float(r["lookahead.smoothing_time_s"])): r
        for r in table
        if r["group"] == "all"
    }
    by_hand = [float(r["gaze_error_rms_deg"]) for r in rows if r["point"] == overall[1, 0]["point"]]
    assert float(overall[1, 0]["gaze_error_rms_deg"]) == pytest.approx(np.mean(by_hand))
    assert overall[1, 0]["n_clips"] == "2"
    # A wrong dead time costs error; a low-pass makes the gaze smoother.
    assert float(overall[0.5, 0]["gaze_error_rms_deg"]) > 1.3 * float(overall[1, 0]["gaze_error_rms_deg"])
    assert float(overall[1, 0.1]["rms_acceleration_rad_s2"]) < 0.8 * float(overall[1, 0]["rms_acceleration_rad_s2"])
    assert {p["point"] for p in summary["pareto"]["small"]} <= {0, 1, 2, 3}


def test_killed_in_the_middle_it_goes_on_and_ends_the_same(tmp_path, undisturbed):
    arguments = words(tmp_path, SMALL)
    runs = tmp_path / "out" / "runs"
    with killed_after(tmp_path, arguments, lambda: len(list(runs.glob("*.json"))) >= 2) as before:
        assert 2 <= len(before) < 8
        assert main(arguments) == 0
    for name in ("results.csv", "table.csv"):
        assert table_of(tmp_path, name) == table_of(undisturbed, name)
    summaries = [json.loads((f / "out" / "summary.json").read_text()) for f in (tmp_path, undisturbed)]
    assert summaries[0] == summaries[1]


def test_a_failed_run_is_a_row_with_its_reason(tmp_path):
    # The sensor of body tracking has nothing to replay on a synthetic walk without it; out of range sees nobody.
    content = SMALL | {"vary": {"sensor.range_max_m": [0.1, 10]}, "recordings": ["subject01_R1"]}
    assert main(words(tmp_path, content)) == 1
    rows = table_of(tmp_path)
    assert "never sees the person" in rows[0]["failed"]
    assert not rows[1]["failed"]


def test_tuning_killed_in_the_middle_ends_with_the_same_trials(tmp_path):
    optuna = pytest.importorskip("optuna", reason="optuna is not installed (extra tune)")
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert main(words(whole, TUNED)) == 0
    arguments = words(killed, TUNED)
    runs = killed / "out" / "runs"
    # In the second batch of eight, so that a finished batch is known and one is half done.
    with killed_after(killed, arguments, lambda: len(list(runs.glob("*.json"))) >= 11) as before:
        assert 11 <= len(before) < 20
        assert main(arguments) == 0
    rows = table_of(whole)
    assert len(rows) == 20
    assert rows == table_of(killed)
    assert len({r["lookahead.smoothing_time_s"] for r in rows}) > 10
    backend = optuna.storages.journal.JournalFileBackend(str(killed / "out" / "optuna.log"))
    (study,) = optuna.get_all_study_summaries(optuna.storages.JournalStorage(backend))
    assert study.n_trials == 20


def test_figures_are_drawn(undisturbed, tmp_path):
    figures = {
        "response": [["model.dead_time_scale", "gaze_error_rms_deg", "lookahead.smoothing_time_s"]],
        "heatmap": ["model.dead_time_scale", "lookahead.smoothing_time_s", "eye_contact_2p6"],
        "pareto": ["rms_acceleration_rad_s2", "eye_contact_2p6", "case"],
    }
    path = written(tmp_path, SMALL | {"figures": figures})
    before = set((undisturbed / "out" / "runs").iterdir())
    assert sweep(SweepSettings(sweep=str(path), jobs=1, out=undisturbed / "out")) == 0
    assert set((undisturbed / "out" / "runs").iterdir()) == before
    assert {p.name for p in (undisturbed / "out").glob("*.png")} == {
        "response_model-dead_time_scale_gaze_error_rms_deg.png",
        "heatmap_model-dead_time_scale_lookahead-smoothing_time_s_eye_contact_2p6.png",
        "pareto_rms_acceleration_rad_s2_eye_contact_2p6.png",
    }


# A cluster


def cluster_script(arguments, kill_after_runs):
    """A LocalCluster of two processes in a process of its own; one worker is killed in the middle."""
    return f"""
import os, signal, sys, threading, time
from pathlib import Path
from distributed import Client, LocalCluster
from experiments.sweep import main

if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        def kill():
            with Client(cluster) as client:
                pid = next(iter(client.run(os.getpid).values()))
            runs = Path({str(arguments[2])!r}) / "runs"
            while len(list(runs.glob("*.json"))) < {kill_after_runs}:
                time.sleep(0.005)
            os.kill(pid, signal.SIGKILL)
            print("killed after", len(list(runs.glob("*.json"))), flush=True)
        killer = threading.Thread(target=kill)
        killer.start()
        time.sleep(1.0)
        status = main([*{arguments!r}, "--dask", cluster.scheduler_address])
        killer.join()
    sys.exit(status)
"""


def test_on_a_cluster_whose_worker_is_killed_nothing_is_lost_or_counted_twice(tmp_path, undisturbed):
    pytest.importorskip("distributed", reason="dask.distributed is not installed (extra cluster)")
    script = tmp_path / "on_cluster.py"
    script.write_text(cluster_script(words(tmp_path, SMALL), kill_after_runs=2))
    done = subprocess.run(
        [sys.executable, str(script)], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    killed_after_runs = int(done.stdout.split("killed after")[1].split()[0])
    assert 2 <= killed_after_runs < 8
    for name in ("results.csv", "table.csv"):
        assert table_of(tmp_path, name) == table_of(undisturbed, name)
    assert len(list((tmp_path / "out" / "runs").glob("*.json"))) == 8


def test_no_scheduler_is_said_and_not_waited_for(tmp_path, capsys, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed (extra cluster)")

    def unreachable(*_, **__):
        raise OSError("Timed out")

    monkeypatch.setattr(distributed, "Client", unreachable)
    assert main(words(tmp_path, SMALL, "--dask", "tcp://127.0.0.1:1")) == 2
    assert "no scheduler answers" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("feature", "package", "extra", "content", "more"),
    [
        ("A sweep", "joblib", "sweep", SMALL, ()),
        ("--dask", "distributed", "cluster", SMALL, ("--dask", "tcp://x:1")),
        ("Design optuna", "optuna", "tune", TUNED, ()),
    ],
)
def test_a_missing_package_names_its_extra(feature, package, extra, content, more, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    assert main(words(tmp_path, content, *more)) == 2
    assert str(MissingOptionalDependencyError(feature, package, extra)) in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
