"""The replay command line."""

import io
import json
from contextlib import redirect_stdout

import numpy as np
import pytest
from bs4 import BeautifulSoup

from gazempc.errors import SettingsError
from gazempc.results.log_files import load_log
from gazempc.results.metrics import gap_closed, measure
from gazempc.results.run_summary import LABELS
from gazempc.run import main, parse
from gazempc.run_settings import load_settings


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """A walk of 1.3 s, about the minimum that is scored, across the robot's view."""
    path, times_s = tmp_path_factory.mktemp("walks") / "walk.csv", np.arange(40) / 30.0
    columns = [times_s, np.full(40, 2.0), 1.2 * times_s - 1.0, np.full(40, 0.3)]
    np.savetxt(path, np.transpose(columns), "%.6f", ",", header="t,head_x,head_y,head_z", comments="")
    return path


@pytest.fixture(scope="module")
def main_job(walk, tmp_path_factory):
    """All outputs; the number of seeds is independent of machine load."""
    out, output = tmp_path_factory.mktemp("main_job"), io.StringIO()
    words = ["--replay", str(walk), "--placement", "recorded", "--noise-seeds", "2", "--out", str(out)]
    with redirect_stdout(output):
        assert main(words) == 0
    return out, output.getvalue()


def test_a_run_writes_all_documented_files(main_job):
    out, _ = main_job
    names = {path.name for path in out.iterdir()}
    assert {"summary.json", "settings.yaml", "overview.png", "angles.png"} <= names
    assert {"gaze.gif"} | {f"{c}.npz" for c in LABELS} <= names
    summary = json.loads((out / "summary.json").read_text())
    assert summary["recording"] == "walk"
    assert summary["settings"]["placement"] == "recorded"
    assert summary["versions"]["numpy"] == np.__version__
    assert [row["controller"] for row in summary["rows"]] == list(LABELS)


def announced_files(output):
    (line,) = (line for line in output.splitlines() if line.startswith("Written to "))
    return line.partition("/: ")[2].split(", ")


def test_exactly_the_announced_files_are_written(main_job, tmp_path, capsys):
    out, output = main_job
    logs = [f"{name}{end}.npz" for name in LABELS for end in ("", "_compute")]
    announced = [name for name in announced_files(output) if "each controller" not in name]
    assert sorted([*announced, *logs]) == sorted(path.name for path in out.iterdir())
    # A re-evaluated log, without figures.
    assert main(["--replay", str(out / "mpc.npz"), "--no-figures", "--out", str(tmp_path)]) == 0
    announced = announced_files(capsys.readouterr().out)
    assert sorted(announced) == sorted(path.name for path in tmp_path.iterdir()) == ["report.html", "summary.json"]


def test_the_report_has_all_metrics_and_figures_of_the_run(main_job):
    out, text = main_job
    report = (out / "report.html").read_text(encoding="utf-8")
    assert len(report.encode()) < 3_000_000
    soup = BeautifulSoup(report, "html.parser")
    cells = {row.th.text: [cell.text for cell in row.find_all("td")] for row in soup.tbody.find_all("tr")}
    noise = json.loads((out / "summary.json").read_text())["noise"]
    assert noise["seeds"] == [0, 1]
    for row in noise["rows"]:
        column = list(LABELS).index(row["controller"])
        mean, sd = (row[of]["gaze_error_rms_deg"] for of in ("mean", "sd"))
        assert cells["gaze error RMS [deg]"][column] == f"{mean:.2f} ± {sd:.2f}"
        assert f"{mean:.2f} ± {sd:.2f}" in text
        assert cells["limit violations"][column] == "0"
    assert soup.find(class_="answer").text in text
    assert soup.find(class_="command").text.startswith("python -m gazempc.run --replay ")
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
        least, most = (metrics[gaze].gaze_error_rms_deg for gaze in ("reactive", "mpc+perfect"))
        assert row["gap_closed"] == pytest.approx(gap_closed(row["gaze_error_rms_deg"], least, most))
        assert f"{row['gaze_error_rms_deg']:.2f}" in text


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


WRONG_MPC = "mpc:\n  horizont_s: 1\n  smoothing_time_s: -1\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nekc: slow\n", ["nekc", "perhaps you meant 'neck'"]),
        (WRONG_MPC, ["mpc.horizont_s", "'horizon_s'", "mpc.smoothing_time_s", "-1"]),
        ("controllers: [mpv]\n", ["controllers.0", "'mpc'"]),
        ("- a\n- b\n", ["mapping"]),
    ],
)
def test_wrong_config_files_are_refused_with_all_errors(tmp_path, text, expected):
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError) as caught:
        load_settings(path)
    for part in ("wrong.yaml", *expected):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--replay", "subject03_R7"], "subject03_R"),
        ([], "nothing to replay"),
        (["--replay", "subject03_R4", "--sensor", "x"], "accepted: azure_kinect, body_tracker, face_camera"),
        (["--replay", "subject03_R4", "--predicter", "perfect"], "--predictor"),
        (["--replay", "subject03_R4", "--distance-m", "0.5", "--placement", "side"], "at least 0.8 m"),
    ],
)
def test_bad_input_gives_one_message_and_status_2(words, expected, capfd):
    try:
        status = main(words)
    except SystemExit as leaving:
        status = leaving.code
    seen = capfd.readouterr()
    assert status == 2
    assert expected in " ".join((seen.out + seen.err).split())
    assert "Traceback" not in seen.err


def test_a_limit_violation_gives_status_1(walk, tmp_path, monkeypatch, capsys):
    """Does not occur in real runs: provoked by too small limits."""
    monkeypatch.setattr("gazempc.results.metrics.limit_violations", lambda log, neck: 3)
    words = ["--replay", str(walk), "--placement", "recorded", "--controllers", "reactive", "--no-figures"]
    assert main([*words, "--noise-seeds", "2", "--out", str(tmp_path)]) == 1
    assert "6 violations" in capsys.readouterr().err
