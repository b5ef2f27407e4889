"""Data that do not determine the result are refused; play and noise are told apart."""

import math

import numpy as np
import pytest
from builders.identification import altered

from gazempc.identify.estimate import estimate_axis
from gazempc.identify.record import IdentificationError


def refusal(taken, axis=0, **options):
    """Text with which it is refused, before or after the fit."""
    try:
        return "\n".join(estimate_axis(taken, axis, **options).doubts)
    except IdentificationError as error:
        return str(error)


def with_noise(taken, sigma_deg):
    return taken.joint_rad + np.random.default_rng(2).normal(0, math.radians(sigma_deg), taken.joint_rad.shape)


def friction(taken):
    """A joint that moves only in jumps of 40 degrees."""
    return np.round(taken.joint_rad / math.radians(40)) * math.radians(40)


SPOILT = {
    "were not reported once": lambda t: altered(t, joint_time_s=np.zeros(0), joint_rad=np.zeros((0, 2))),
    "50 different time stamps": lambda t: altered(t, joint_time_s=t.joint_time_s[:50], joint_rad=t.joint_rad[:50]),
    "share 0.0 s": lambda t: altered(t, joint_time_s=t.joint_time_s + 1e9),
    "moves over 0.40 deg": lambda t: altered(t, command_rad=t.command_rad / 100),
    "the joint over 0.0 deg": lambda t: altered(t, joint_rad=np.zeros_like(t.joint_rad)),
    "jump as no joint can": lambda t: altered(
        t, joint_rad=np.where(np.arange(len(t.joint_rad))[:, None] % 10 == 0, -math.pi, t.joint_rad)
    ),
    "of the motion; at least 80 %": lambda t: altered(t, joint_rad=friction(t)),
    "dead time is only known to": lambda t: altered(
        t, joint_time_s=t.joint_time_s[::40], joint_rad=with_noise(t, 3.0)[::40]
    ),
    "before its commands": lambda t: altered(t, joint_time_s=t.joint_time_s - 0.45),
    "at the end of what was looked for (-100 ms)": lambda t: altered(t, joint_time_s=t.joint_time_s - 0.6),
}


@pytest.mark.parametrize("problem", SPOILT)
def test_data_that_do_not_determine_the_servo_are_refused(clean, problem):
    text = refusal(SPOILT[problem](clean))
    assert problem in text
    assert text.startswith("pan: ")


def test_refuses_a_dead_time_beyond_what_was_looked_for(clean):
    assert "--dead-time-max-s" in refusal(clean, dead_time_max_s=0.3)
    assert refusal(clean, dead_time_max_s=0.5) == ""


def test_play_in_the_gears_is_noted_and_noise_is_not(clean):
    """The intervals know noise only; what the model cannot be must be said."""
    slack, held, rows = math.radians(0.8), clean.joint_rad[0], []
    for angles in clean.joint_rad:
        held = np.clip(held, angles - slack / 2, angles + slack / 2)
        rows.append(held)
    with_play = estimate_axis(altered(clean, joint_rad=np.array(rows)), 0)
    assert "hang together in time" in with_play.note
    assert 0.1 < with_play.structured_rms_deg <= with_play.residual_rms_deg < 0.8
    noisy = estimate_axis(altered(clean, joint_rad=with_noise(clean, 0.3)), 0)
    assert noisy.note == ""
    assert noisy.structured_rms_deg < 0.1
