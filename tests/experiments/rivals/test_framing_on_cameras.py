"""The comparison of framing: devices, the choice of constants, verdicts, and a small run."""

import json

import numpy as np
import pytest

from experiments.rivals.framing import DEVICES, FIGURES, OURS, FramingJob, main, summarise
from experiments.rivals.simulate import driven_by
from experiments.rivals.trials import STOP
from gazempc.errors import SettingsError
from gazempc.settings import WalkerSettings


def run_of(law, zone, reversals, constants="{}", device="cheap"):
    row = dict.fromkeys(FIGURES, 1.0) | {"time_in_zone": zone, "reversals_per_min": reversals}
    return row | {"law": law, "constants": constants, "device": device, "subject": "a"}


def test_constants_maximise_time_in_zone_then_minimise_reversals():
    runs = [run_of("op3", 0.9, 20.0, "a"), run_of("op3", 0.895, 10.0, "b"), run_of("op3", 0.5, 0.0, "c")]
    (row,) = summarise(runs)
    assert (row["constants"], row["reversals_per_min"]) == ("b", 10.0)


@pytest.mark.parametrize("name", list(DEVICES))
def test_devices_have_speed_tables_and_laws_with_angle_output_command_angles(name):
    neck = DEVICES[name].neck(name)
    assert neck.takes_speeds
    assert not neck.reports_joints
    assert neck.tilt.speed_steps.positive_rad_s != neck.tilt.speed_steps.negative_rad_s
    angles = driven_by(neck, "position")
    assert angles.pan.speed_steps is None
    assert angles.pan.dead_time_s == neck.pan.dead_time_s


@pytest.mark.parametrize(("option", "word", "meant"), [("laws", "frigat", "frigate"), ("devices", "chep", "cheap")])
def test_an_unknown_law_or_device_is_refused_with_the_nearest_name(option, word, meant, capsys):
    assert main(["--recordings", "subject01_R1", f"--{option}", word]) == 2
    assert f"'{meant}'" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.usefixtures("in_this_process")
def test_the_report_first_names_where_the_mpc_is_worse(tmp_path, capsys):
    words = ["--recordings", "subject01_R1", "--laws", "pixel_pid", OURS, "--devices", "good"]
    assert main([*words, "--jobs", "1", "--out", str(tmp_path)]) == 0
    rows = json.loads((tmp_path / "framing.json").read_text())["rows"]
    found = {row["law"]: row for row in rows}
    assert found[OURS]["time_in_zone"] > found["pixel_pid"]["time_in_zone"]
    text = capsys.readouterr().out
    assert text.index("Goal") < text.index("| good")
    assert (tmp_path / "framing.png").stat().st_size > 10_000
    assert np.isfinite(found[OURS]["rms_acceleration_rad_s2"])


@pytest.mark.slow
@pytest.mark.usefixtures("in_this_process")
def test_standing_people_alone_are_compared_without_walks(tmp_path):
    words = ["--standing", "subject01_stand", "--laws", "pixel_pid", "--devices", "good"]
    assert main([*words, "--jobs", "1", "--out", str(tmp_path)]) == 0
    (row,) = json.loads((tmp_path / "framing.json").read_text())["rows"]
    assert row["n_clips"] == 1


def test_the_forecast_is_that_of_the_fitted_models(tmp_path, capsys):
    missing = tmp_path / "walker.npz"
    assert main(["--recordings", "subject01_R1", "--laws", OURS, "--walker.fitted", str(missing)]) == 2
    assert str(missing) in capsys.readouterr().err
    neck, sensor = DEVICES["good"].neck("good"), DEVICES["good"].sensor()
    with pytest.raises(SettingsError, match=r"walker\.npz"):
        FramingJob(OURS, STOP, "subject01_R1", neck, sensor, walker=WalkerSettings(fitted=missing)).run()
