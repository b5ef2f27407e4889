"""A whole run on a ROS 2 bag, from the folder to `summary.json`."""

import json

import numpy as np
from builders.bags import face_rows, write_bag

from gazempc.run import main


def test_a_run_on_a_bag(tmp_path):
    """A person crosses 2.5 m in front of a camera, facing to its left, with a tracker's noise."""
    t = np.arange(70) / 30
    noise = np.random.default_rng(0).normal(0, 0.004, (t.size, 3))
    places = np.column_stack([np.full_like(t, 2.5), 1.0 * t - 1.2, np.full_like(t, 0.3)]) + noise
    quat = (0.707107, 0, 0, 0.707107)
    folder = write_bag(tmp_path / "me_01", face_rows("face_a", 1e9 + t, places, "camera_link", quat))
    words = ["--replay", str(folder), "--controllers", "reactive", "lookahead", "--no-figures", "--noise-seeds", "1"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["kind"], summary["scored_against"].startswith("the tracker's own track")) == ("tracked", True)
    assert (summary["settings"]["sensor"], summary["settings"]["placement"]) == ("recorded", "recorded")
    rows = {row["controller"]: row for row in summary["rows"]}
    assert rows["lookahead"]["gaze_error_rms_deg"] < rows["reactive"]["gaze_error_rms_deg"] / 3
