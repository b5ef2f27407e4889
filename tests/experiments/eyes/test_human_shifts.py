"""Shifts of gaze beside those of people: what fits must fit."""

import math

import pytest

from experiments.eyes.human import compared, main, table
from experiments.eyes.shifts import make_shift
from gazempc.neck.human import head_velocity_rad_s, motor_scale, with_motion
from gazempc.neck.spec import load_neck

EYES = load_neck("reference_eyes")
HUMAN = with_motion(EYES, "human")


@pytest.mark.parametrize(
    ("direction", "amplitude_deg", "share"), [("sideways", 40, 0.69), ("up", 20, 0.52), ("down", 20, 0.08)]
)
@pytest.mark.parametrize("controller", ["mpc", "lookahead"])
def test_head_and_eyes_share_a_shift_as_people_do(controller, direction, amplitude_deg, share):
    shift = make_shift(HUMAN, controller, direction, amplitude_deg)
    assert shift.head_share == pytest.approx(share, abs=0.01)
    assert shift.head_deg[-1] + shift.eye_deg[-1] == pytest.approx(amplitude_deg, abs=0.1)
    # The eyes wait for nobody: they begin one dead time of the head earlier, less their own.
    assert shift.lead_s == pytest.approx(0.34, abs=0.09)


@pytest.mark.parametrize("amplitude_deg", [40, 60])
def test_the_head_is_as_fast_as_a_scaled_head_of_people(amplitude_deg):
    """4.39 times the head's amplitude and 106 deg/s more, by the share that the motors bear."""
    shift = make_shift(HUMAN, "mpc", "sideways", amplitude_deg)
    scaled = motor_scale(EYES.pan) * (4.39 * 0.69 * amplitude_deg + 106.0)
    assert shift.head_peak_deg_s == pytest.approx(scaled, rel=0.1)
    plain = make_shift(EYES, "mpc", "sideways", amplitude_deg)
    assert abs(plain.head_share - 1.0) < 0.02


def test_each_shift_is_beside_that_of_people():
    shifts = [make_shift(HUMAN, "mpc", "sideways", amplitude_deg) for amplitude_deg in (10, 40)]
    scale = motor_scale(EYES.pan)
    lines = table(shifts, scale).splitlines()
    (row,) = (line for line in lines if line.startswith("sideways 40"))
    assert " 69 (69) " in row
    assert "(50) *" in row
    by_label = {each.label: each for each in compared(shifts[1], scale)}
    head_rad = math.radians(shifts[1].head_deg[-1])
    assert by_label["head's peak"].people == pytest.approx(math.degrees(scale * head_velocity_rad_s(head_rad)))
    assert by_label["eyes ahead"].people == pytest.approx(50.0)


def test_a_neck_without_eyes_is_refused(capsys, tmp_path):
    assert main(["--neck", "reference", "--out", str(tmp_path)]) == 2
    assert "neck 'reference' has no eyes that turn; accepted: --motion robot" in capsys.readouterr().err


def test_the_command_writes_a_picture(capsys, tmp_path, monkeypatch):
    few = {"sideways": (20.0, 60.0), "up": (10.0,), "down": ()}
    monkeypatch.setattr("experiments.eyes.human._AMPLITUDES_DEG", few)
    assert main(["--neck", "furhat", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "furhat_mpc.png").stat().st_size > 20_000
    assert capsys.readouterr().out.count("sideways 60") >= 1
