"""Gaze shifts compared with human data."""

import pytest
from builders.replays import at_100_hz, quick_neck

from experiments.eyes.human import compared, main, make_shift, table
from gazempc.neck.limits import motor_scale, with_motion

EYES = at_100_hz("reference_eyes")
HUMAN = with_motion(EYES, "human")


@pytest.mark.parametrize(("direction", "amplitude_deg", "share"), [("up", 20, 0.52), ("down", 20, 0.08)])
def test_head_and_eye_amplitudes_match_human_gaze_shifts(direction, amplitude_deg, share):
    shift = make_shift(HUMAN, "mpc", direction, amplitude_deg)
    assert shift.head_share == pytest.approx(share, abs=0.01)
    assert shift.head_deg[-1] + shift.eye_deg[-1] == pytest.approx(amplitude_deg, abs=0.1)
    # The eyes begin one dead time of the head earlier, less their own.
    assert shift.lead_s == pytest.approx(0.34, abs=0.09)


def test_a_shift_is_scaled_to_the_motors_and_tabulated_beside_human_data():
    """Human peak speed, 4.39 amplitude + 106 deg/s, scaled to the motors."""
    shift, scale = make_shift(HUMAN, "mpc", "sideways", 40), motor_scale(EYES.pan)
    assert shift.head_share == pytest.approx(0.69, abs=0.01)
    assert shift.head_peak_deg_s == pytest.approx(scale * (4.39 * 0.69 * 40 + 106.0), rel=0.1)
    (row,) = (line for line in table([shift], scale).splitlines() if line.startswith("| sideways 40"))
    assert " 69 (69) " in row
    assert "(50) *" in row
    assert compared(shift, scale)["eyes ahead [ms]"].people == pytest.approx(50.0)


@pytest.mark.slow
def test_the_command_writes_a_picture(capsys, tmp_path):
    neck = quick_neck(tmp_path, "furhat")
    assert main(["--neck", neck, "--controller", "lookahead", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "furhat_lookahead.png").stat().st_size > 20_000
    assert capsys.readouterr().out.count("sideways 60") >= 1
