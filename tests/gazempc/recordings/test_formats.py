"""A whole run on each recording format, from a file to `summary.json`."""

import json

import numpy as np
import pandas as pd
import pytest
from builders.bags import face_rows, write_bag

from gazempc.recordings.load import load
from gazempc.recordings.readers.tables.people import COLUMNS
from gazempc.run import main

SECONDS = 3.5


def table():
    """A synthetic walk in the columns of the CSV format."""
    recording = load("subject07_R3")
    t = recording.truth
    values = [recording.times_s[:, None], t.head_position_m, t.head_quat_wxyz, t.pelvis_position_m, t.pelvis_quat_wxyz]
    return pd.DataFrame(np.hstack(values), columns=COLUMNS)


def write_csv(folder):
    path = folder / "me_01.csv"
    table().to_csv(path, index=False)
    return path


def bag(folder):
    """A person who crosses 2.5 m in front of a camera, facing to its left, with a tracker's noise."""
    t = np.arange(int(SECONDS * 30)) / 30
    noise = np.random.default_rng(0).normal(0, 0.004, (t.size, 3))
    places = np.column_stack([np.full_like(t, 2.5), 1.0 * t - 1.6, np.full_like(t, 0.3)]) + noise
    return write_bag(folder / "me_01", face_rows("face_a", 1e9 + t, places, "camera_link", (0.707107, 0, 0, 0.707107)))


@pytest.mark.parametrize(
    ("write", "kind", "sensor", "placement"),
    [
        (write_csv, "motion capture", "reference", "side"),
        (bag, "tracked", "recorded", "recorded"),
    ],
)
def test_a_run_on_each_format(write, kind, sensor, placement, tmp_path, capsys):
    words = ["--replay", str(write(tmp_path)), "--controllers", "reactive", "lookahead", "--no-figures"]
    assert main([*words, "--noise-seeds", "1", "--out", str(tmp_path / "out")]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["kind"] == kind
    assert (summary["settings"]["sensor"], summary["settings"]["placement"]) == (sensor, placement)
    rows = {row["controller"]: row for row in summary["rows"]}
    assert rows["lookahead"]["gaze_error_rms_deg"] < rows["reactive"]["gaze_error_rms_deg"] / 3
    said = capsys.readouterr().out
    assert kind in said
    tracked = "the tracker's own track, smoothed without lag"
    assert summary["scored_against"] == (tracked if kind == "tracked" else "the true head")
    for note in summary["notes"]:
        assert note in said
