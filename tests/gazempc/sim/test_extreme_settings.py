"""Necks and settings at the ends of what is accepted work in a whole replay."""

import numpy as np
import pytest
from builders.recordings import reordered, synthetic
from builders.replays import replayed

from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.results.metrics import measure
from gazempc.results.motion import limit_violations
from gazempc.sim.replay import ReplaySettings

LARGEST = {"velocity_max_rad_s": 1e3, "acceleration_max_rad_s2": 1e6, "jerk_max_rad_s3": 1e9}
LEAST = {"velocity_max_rad_s": 0.01, "acceleration_max_rad_s2": 0.01, "jerk_max_rad_s3": 0.1}
FAST, SLOW = {"natural_frequency_rad_s": 1e3}, {"natural_frequency_rad_s": 0.01}
RATES = {"control_rate_hz": 100.0, "servo_rate_hz": 100.0}


@pytest.fixture(scope="module")
def walk():
    return reordered(synthetic("subject03_R4"), range(75))


def neck_of(base="reference", rates=None, **of_axis):
    content = load_neck(base).model_dump() | (rates or {})
    for axis in (
        content["pan"],
        content["tilt"],
        *((content["eyes"] or {}).get(name) for name in ("pan", "tilt")),
        content["body"],
    ):
        if axis is not None:
            axis.update(of_axis)
    return NeckSpec.model_validate(content)


@pytest.mark.parametrize(
    ("neck", "settings"),
    [
        (neck_of(**SLOW), {}),
        (neck_of("reference_eyes", **LARGEST, **FAST), {}),
        (neck_of("reachy_mini_body", **LEAST), {}),
        (neck_of(dead_time_s=5.0, damping_ratio=0.11), {}),
        (neck_of(position_min_deg=0.0, position_max_deg=1e-9), {}),
        (neck_of("slow", rates=RATES), {"mpc": {"horizon_s": 5.0, "smoothing_time_s": 1.0}}),
        (neck_of(), {"mpc": {"smoothing_time_s": 1e-300}, "predictor": "constant_velocity"}),
    ],
    ids=lambda value: "",
)
def test_what_is_accepted_is_replayed_within_limits(neck, settings, walk):
    log = replayed(walk, neck=neck, settings=ReplaySettings.model_validate(settings))
    assert limit_violations(log, neck) == 0
    assert log.faults == ()
    assert np.isfinite(measure(log).gaze_error_rms_deg)


@pytest.mark.parametrize("natural_frequency_rad_s", [50.0, 1000.0])
def test_the_mpc_follows_with_a_fast_joint_as_look_ahead_does(natural_frequency_rad_s, walk):
    """Each step of a held command makes a fast joint jump: that is no motion to be smoothed away."""
    neck = neck_of(natural_frequency_rad_s=natural_frequency_rad_s)
    mpc, ahead = (measure(replayed(walk, name, neck=neck)).gaze_error_rms_deg for name in ("mpc", "lookahead"))
    assert mpc < ahead + 0.5
