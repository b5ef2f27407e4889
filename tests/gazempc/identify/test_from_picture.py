"""The command on the emulated camera: what it finds is what the emulator does."""

import datetime

import numpy as np
import pytest

from gazempc.identify.identified import TurnedAxis, option_words, turned_table, turned_toml
from gazempc.identify.identify import main
from gazempc.identify.new_neck import as_toml
from gazempc.identify.turning import Interval, TurnEstimate
from gazempc.neck.spec import load_neck
from gazempc.neck.speed_steps import SpeedSteps
from gazempc.robots.options import RobotOptions
from gazempc.robots.ptz_emulator import LATENCY_S

PTZ = load_neck("ptz")


def estimate(delay_s, speeds):
    known = {step: Interval(value, value, value) for step, value in sorted(speeds.items())}
    wn = Interval(20.0, 19.0, 21.0)
    return TurnEstimate(Interval(delay_s, delay_s, delay_s), wn, known, 0.01)


@pytest.mark.parametrize(("answers", "dead_time_s"), [(True, 0.3), (False, 0.5)])
def test_the_neck_file_has_the_measured_table(answers, dead_time_s, tmp_path):
    """With position answers theirs; without them that of the picture. The camera turns to the right for the step 1."""
    left, right = {1: 0.09, 2: 0.4, 3: 0.6}, {1: 0.1, 3: 0.5}
    speeds = {k: -v for k, v in right.items()} | {-k: v for k, v in left.items()}
    by_picture = {step: speed * (1.05 if answers else 1.0) for step, speed in speeds.items()}
    # The answers have the sign of the command, as the robot does.
    by_answers = estimate(0.3, {k: -v for k, v in speeds.items()}) if answers else None
    axes = [TurnedAxis(name, estimate(0.5, by_picture), by_answers, 3) for name in ("pan", "tilt")]
    path, view_rad = tmp_path / "measured.toml", np.radians([60.0, 36.0])
    path.write_text(turned_toml(PTZ, axes, tuple(view_rad), "measured", "a test", datetime.date(2026, 11, 23)))
    neck = load_neck(path)
    assert neck.pan.dead_time_s == dead_time_s
    assert neck.pan.speed_steps.positive_rad_s == pytest.approx((0.09, 0.4, 0.6))
    assert neck.pan.speed_steps.negative_rad_s == pytest.approx((0.1, 0.3, 0.5))
    assert neck.pan.velocity_max_rad_s == pytest.approx(0.5)
    assert neck.head_view_deg == (60.0, 36.0)
    assert "sign -1" in turned_table(axes, view_rad[0])


def test_the_command_to_use_has_the_options_and_the_measured_signs():
    """Pan was driven with the wrong sign, tilt with the right one, which is not the default."""
    turned = [
        TurnedAxis(name, estimate(0.5, {1: sign * 0.2, -1: -sign * 0.2}), None, 1)
        for name, sign in (("pan", -1), ("tilt", 1))
    ]
    options = RobotOptions.model_validate({"visca": {"directions": (1, -1), "counts_per_deg": 20.0}})
    words = " ".join(option_words("visca:192.0.2.8", options, turned))
    assert "--options.visca.directions -1 -1" in words
    assert "--options.visca.counts-per-deg 20.0" in words
    assert option_words("visca:192.0.2.8", RobotOptions(), turned[1:] * 2) == []


@pytest.mark.slow
def test_the_emulated_camera_is_found_as_it_is(tmp_path, capsys, real_time):
    pytest.importorskip("mujoco")
    out = tmp_path / "found.toml"
    few = {
        "pan": SpeedSteps(positive_rad_s=[0.2, 0.8], negative_rad_s=[0.16, 0.8]),
        "tilt": SpeedSteps(positive_rad_s=[0.8], negative_rad_s=[0.8]),
    }
    axes = {
        name: getattr(PTZ, name).model_copy(update={"speed_steps": steps, "velocity_max_rad_s": 0.8})
        for name, steps in few.items()
    }
    given = tmp_path / "given.toml"
    given.write_text(as_toml(PTZ.model_copy(update=axes).model_dump(exclude_none=True)))
    words = ["--robot", f"visca:emulator:{given}", "--source", "camera:emulator", "--neck", str(given)]
    assert main([*words, "--camera.fov-deg", "65", "--out", str(out)]) == 0
    neck, text = load_neck(out), capsys.readouterr().out
    for name in ("pan", "tilt"):
        axis = getattr(neck, name)
        assert axis.dead_time_s == pytest.approx(PTZ.pan.dead_time_s, abs=0.015)
        np.testing.assert_allclose(axis.speed_steps.levels_rad_s, few[name].levels_rad_s, rtol=0.03)
    assert neck.head_view_deg == pytest.approx((60.0, 36.0), abs=1.0)
    latency_ms = float(text.rsplit("--camera.latency-ms ", 1)[1].split()[0])
    assert latency_ms == pytest.approx(1e3 * LATENCY_S, abs=30.0)
