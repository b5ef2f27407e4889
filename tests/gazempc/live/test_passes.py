"""Several passes of one recording: the jump of the person from the end to the beginning is nobody's error."""

import json

import pytest

from gazempc.live.session import main


@pytest.mark.slow
def test_figures_of_several_passes_are_those_of_one(tmp_path):
    found = {}
    for passes in (1, 3):
        out = tmp_path / str(passes)
        words = ["--source", "replay", "--robot", "simulated", "--passes", str(passes), "--no-figures"]
        assert main([*words, "--out", str(out)]) == 0
        found[passes] = json.loads((out / "summary.json").read_text())["metrics_of_last_log"]
    # Scored with the jumps it was 28 deg.
    assert found[3]["gaze_error_rms_deg"] == pytest.approx(found[1]["gaze_error_rms_deg"], abs=0.7)
    assert found[3]["rms_acceleration_rad_s2"] < 1.5 * found[1]["rms_acceleration_rad_s2"]
