"""The command line as a user calls it."""

import io
import json
import signal
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from bs4 import BeautifulSoup
from builders.own_parts import own_module

from gazempc.errors import SettingsError
from gazempc.part_options import take_options
from gazempc.results.log import load_log
from gazempc.results.metrics import gap_closed, measure
from gazempc.results.run_summary import LABELS
from gazempc.run import main, parse
from gazempc.run_settings import load_settings
from gazempc.signals import Interrupted
from gazempc.sim import repeat
from gazempc.sim.replay import replay_scene

ROOT = Path(__file__).resolve().parents[2]
ROW_KEYS = {
    "controller",
    "predictor",
    "gaze_error_rms_deg",
    "gaze_error_median_deg",
    "gaze_error_p95_deg",
    "eye_contact_2p6",
    "eye_contact_4",
    "eye_contact_9",
    "gap_closed",
    "rms_acceleration_rad_s2",
    "peak_velocity_rad_s",
    "peak_acceleration_rad_s2",
    "peak_jerk_rad_s3",
    "limit_violations",
    "step_ms_p50",
    "step_ms_p99",
}


def command(*words):
    return subprocess.run(
        [sys.executable, "-m", "gazempc.run", *words], capture_output=True, text=True, cwd=ROOT, check=False
    )


@pytest.fixture(scope="module")
def main_job(tmp_path_factory):
    """The README's main job, without its environment, and under as many seeds on a busy machine as on another."""
    out = tmp_path_factory.mktemp("main_job")
    said = io.StringIO()
    with redirect_stdout(said):
        assert main(["--replay", "subject03_R4", "--noise-seeds", "2", "--out", str(out)]) == 0
    return out, said.getvalue()


def test_the_main_job_writes_all_it_promises(main_job):
    out, _ = main_job
    names = {path.name for path in out.iterdir()}
    assert {"summary.json", "settings.yaml", "overview.png", "angles.png"} <= names
    assert {"gaze.gif"} | {f"{c}.npz" for c in LABELS} <= names
    summary = json.loads((out / "summary.json").read_text())
    assert summary["recording"] == "subject03_R4"
    assert summary["kind"] == "synthetic"
    assert summary["settings"]["placement"] == "recorded"
    assert summary["versions"]["numpy"] == np.__version__
    assert [row["controller"] for row in summary["rows"]] == list(LABELS)
    assert all(set(row) >= ROW_KEYS for row in summary["rows"])


def said_to_be_written(said):
    (line,) = (line for line in said.splitlines() if line.startswith("Written to "))
    return line.partition("/: ")[2].split(", ")


def test_what_is_said_to_be_written_is_written_and_nothing_else(main_job, tmp_path, capsys):
    out, said = main_job
    logs = [f"{name}{end}.npz" for name in LABELS for end in ("", "_compute")]
    told = [name for name in said_to_be_written(said) if "each controller" not in name]
    assert sorted([*told, *logs]) == sorted(path.name for path in out.iterdir())
    # A log measured again, without figures.
    assert main(["--replay", str(out / "mpc.npz"), "--no-figures", "--out", str(tmp_path)]) == 0
    told = said_to_be_written(capsys.readouterr().out)
    assert sorted(told) == sorted(path.name for path in tmp_path.iterdir()) == ["report.html", "summary.json"]


def test_the_report_has_all_numbers_and_pictures_of_the_run(main_job):
    out, text = main_job
    report = (out / "report.html").read_text(encoding="utf-8")
    assert len(report.encode()) < 3_000_000
    soup = BeautifulSoup(report, "html.parser")
    cells = {row.th.text: [cell.text for cell in row.find_all("td")] for row in soup.tbody.find_all("tr")}
    for row in json.loads((out / "summary.json").read_text())["noise"]["rows"]:
        column = list(LABELS).index(row["controller"])
        mean, sd = (row[of]["gaze_error_rms_deg"] for of in ("mean", "sd"))
        assert cells["gaze error RMS [deg]"][column] == f"{mean:.2f} ± {sd:.2f}"
        assert cells["limit violations"][column] == "0"
    assert soup.find(class_="answer").text in text
    assert soup.find(class_="command").text.startswith("python -m gazempc.run --replay subject03_R4 --noise-seeds 2 ")
    assert len(soup.find(id="pictures").find_all("img")) == 3
    assert len(soup.select(".legend button")) == len(LABELS)
    assert f"numpy {np.__version__}" in soup.find(id="again").text


def test_the_figures_follow_from_the_logs_alone(main_job):
    out, text = main_job
    rows = {row["controller"]: row for row in json.loads((out / "summary.json").read_text())["rows"]}
    metrics = {name: measure(load_log(out / f"{name}.npz")) for name in rows}
    for name, row in rows.items():
        for key, value in metrics[name].as_dict().items():
            assert row[key] == (pytest.approx(value) if np.isfinite(value) else None), (name, key)
        expected = gap_closed(
            row["gaze_error_rms_deg"],
            metrics["reactive"].gaze_error_rms_deg,
            metrics["mpc+perfect"].gaze_error_rms_deg,
        )
        assert row["gap_closed"] == pytest.approx(expected)
        assert f"{row['gaze_error_rms_deg']:.2f}" in text


def test_the_spread_over_the_noise_is_printed_and_saved(main_job):
    out, text = main_job
    summary = json.loads((out / "summary.json").read_text())
    noise = summary["noise"]
    assert noise["seeds"] == [0, 1]
    assert summary["settings"]["noise_seeds"] == 2
    assert "over 2 seeds" in text
    for row, over_seeds in zip(summary["rows"], noise["rows"], strict=True):
        errors = over_seeds["per_seed"]["gaze_error_rms_deg"]
        assert errors[0] == row["gaze_error_rms_deg"]
        mean, sd = np.mean(errors), np.std(errors, ddof=1)
        assert (over_seeds["mean"]["gaze_error_rms_deg"], over_seeds["sd"]["gaze_error_rms_deg"]) == pytest.approx(
            (mean, sd)
        )
        assert f"{mean:.2f} ± {sd:.2f}" in text


def test_prediction_is_worth_what_the_readme_says(main_job):
    """Threefold less error by both predictive gazes, at most 0.3 deg with the perfect forecast, no violation."""
    out, text = main_job
    rows = {row["controller"]: row for row in json.loads((out / "summary.json").read_text())["rows"]}
    reactive = rows["reactive"]["gaze_error_rms_deg"]
    assert rows["lookahead"]["gaze_error_rms_deg"] < reactive / 3
    assert rows["mpc"]["gaze_error_rms_deg"] < reactive / 3
    assert rows["mpc+perfect"]["gaze_error_rms_deg"] <= 0.3
    assert all(row["limit_violations"] == 0 for row in rows.values())
    assert "Eye contact (within 2.6 deg): reactive" in text


@pytest.mark.slow
@pytest.mark.parametrize(("predictor", "costs"), [("my_parts:Nonsense", True), ("last_position", False)])
def test_a_run_whose_forecast_costs_contact_tells_so(tmp_path, monkeypatch, capsys, predictor, costs):
    """A person who stands, and a forecast that swings by half a metre aside of them."""
    swings = """

class Nonsense(ConstantVelocity):
    def forecast(self, times_s):
        found = super().forecast(times_s)
        found.means_base_m[:, 1] += 0.5 * np.sin(3.0 * np.asarray(times_s))
        return found
"""
    own_module(tmp_path, monkeypatch, more=f"import numpy as np\n{swings}")
    words = ["--replay", "subject03_stand", "--predictor", predictor, "--noise-seeds", "2", "--no-figures"]
    assert main([*words, "--controllers", "reactive", "mpc", "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert ("--predictor last_position" in told) == costs
    assert ("points less contact" in told) == costs
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    starts = {row["controller"]: row["false_starts_per_min"] for row in summary["rows"]}
    assert (starts["mpc"] > 0) == costs


def test_the_log_is_read_in_one_line_by_numpy_and_pandas(main_job):
    out, _ = main_job
    frame = pd.DataFrame(np.load(out / "mpc.npz")["joint_position_rad"], columns=["pan_rad", "tilt_rad"])
    assert len(frame) > 800
    assert frame.notna().all().all()


def test_saved_settings_repeat_the_run(main_job, tmp_path):
    out, _ = main_job
    words = ["--config", str(out / "settings.yaml"), "--out", str(tmp_path), "--no-figures", "--controllers", "mpc"]
    assert main([*words, "--noise-seeds", "1"]) == 0
    assert (tmp_path / "mpc.npz").read_bytes() == (out / "mpc.npz").read_bytes()


def test_config_file_and_command_line(tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text("neck: slow\nseed: 7\nmpc:\n  horizon_s: 0.6\n")
    settings = parse(["--config", str(path), "--seed", "8", "--mpc.smoothing-time-s", "0.2"])
    assert (settings.neck, settings.seed) == ("slow", 8)
    assert (settings.mpc.horizon_s, settings.mpc.smoothing_time_s) == (0.6, 0.2)
    assert parse([f"--config={path}"]).seed == 7


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nekc: slow\n", ["nekc", "perhaps you meant 'neck'"]),
        (
            "mpc:\n  horizont_s: 1\n  smoothing_time_s: -1\n",
            ["mpc.horizont_s", "'horizon_s'", "mpc.smoothing_time_s", "-1"],
        ),
        ("controllers: [mpv]\n", ["controllers.0", "'mpc'"]),
        ("- a\n- b\n", ["mapping"]),
        ("a: [\n", ["not valid YAML"]),
        ("seed: -3\n", ["seed", "greater than or equal to 0"]),
    ],
)
def test_wrong_config_files_are_refused_with_all_errors(tmp_path, text, expected):
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError) as caught:
        load_settings(path)
    for part in ["wrong.yaml", *expected]:
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--replay", "subject03_R7"], "subject03_R"),
        (["--replay", "nothing.csv"], "nothing.csv"),
        ([], "nothing to replay"),
        (["--replay", "subject03_R4", "--neck", "referense"], "perhaps you meant 'reference'"),
        (
            ["--replay", "subject03_R4", "--sensor", "x"],
            "accepted: azure_kinect, body_tracker, face_camera, perfect, recorded, reference, street",
        ),
        (["--replay", "subject03_R4", "--config", "absent.yaml"], "absent.yaml"),
        (["--replay", "subject03_R4", "--predicter", "perfect"], "--predictor"),
        (["--replay", "subject03_R4", "--mpc.horizon-s", "0.01"], "horizon_s"),
        (["--replay", "subject03_R4", "--distance-m", "0.5", "--placement", "side"], "at least 0.8 m"),
    ],
)
def test_bad_input_is_one_message_and_status_2(words, expected, capfd):
    try:
        status = main(words)
    except SystemExit as leaving:
        status = leaving.code
    seen = capfd.readouterr()
    assert status == 2
    assert expected in " ".join((seen.out + seen.err).split())
    assert "Traceback" not in seen.err


def test_a_limit_violation_is_status_1(tmp_path, monkeypatch, capsys):
    """Never seen in a real run: made by measuring against limits that are too small."""
    monkeypatch.setattr("gazempc.results.metrics.limit_violations", lambda log, neck: 3)
    words = ["--replay", "subject03_R4", "--controllers", "reactive", "--no-figures", "--out", str(tmp_path)]
    assert main([*words, "--noise-seeds", "2"]) == 1
    assert "6 violations" in capsys.readouterr().err


@pytest.mark.slow
def test_list_names_recordings_necks_and_sensors():
    done = command("--list")
    assert done.returncode == 0
    for word in ("subject01_R1", "subject14_R6", ".bvh", "reference", "slow", "fetch", "pr2", "recorded"):
        assert word in done.stdout


def test_help_shows_every_default(capsys):
    with pytest.raises(SystemExit) as leaving:
        main(["--help"])
    assert leaving.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    for word in ("--predictor", "default: walker", "--mpc.horizon-s", "default: 0.8", "reactive lookahead"):
        assert word in text


def test_options_are_written_with_hyphens_or_underscores_like_all_settings():
    words = ["--options.hold-s", "0.7", "--seed", "3", "--options.predictor.spread_m=0.1"]
    assert take_options(words) == (["--seed", "3"], {"hold_s": "0.7", "predictor.spread_m": "0.1"})


def test_a_signal_in_the_first_seed_keeps_the_controllers_that_are_complete(tmp_path, monkeypatch, capsys):
    def replay(scene, controller, *rest):
        if controller == "lookahead":
            raise Interrupted(signal.SIGINT)
        return replay_scene(scene, controller, *rest)

    monkeypatch.setattr(repeat, "replay_scene", replay)
    words = ["--replay", "subject03_R4", "--controllers", "reactive", "lookahead", "--out", str(tmp_path)]
    assert main(words) == 130
    assert load_log(tmp_path / "reactive.npz").run.controller == "reactive"
    assert f"kept in {tmp_path}" in capsys.readouterr().err
    rows = json.loads((tmp_path / "summary.json").read_text())["rows"]
    assert [row["controller"] for row in rows] == ["reactive"]
