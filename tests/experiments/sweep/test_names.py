"""Dotted names: each sets what it says, and a wrong one is told what was meant."""

import numpy as np
import pytest

from experiments.sweep.names import check_name, check_value, resolve, setting_fields, with_unit
from experiments.sweep.spec import METRICS
from gazempc.neck.spec import load_neck


def test_each_kind_of_name_changes_what_it_says():
    variant = resolve(
        {
            "controller": "mpc",
            "mpc.horizon_s": 0.5,
            "constant_velocity.acceleration_psd": 0.2,
            "head_pose.weight": 0.7,
            "loop.compute_delay_s": 0.02,
            "start_offset_deg": 60,
            "distance_m": 3,
            "seed": 7,
            "neck": "slow",
            "neck.pan.dead_time_s": 0.2,
            "neck.both.velocity_max_rad_s": 0.7,
            "neck.geometry.eye_in_tilt_m": [0.1, 0, 0],
            "sensor.latency_s": 0.1,
        }
    )
    settings = variant.settings
    assert (settings.mpc.horizon_s, settings.constant_velocity.acceleration_psd) == (0.5, 0.2)
    assert (settings.head_pose.weight, settings.loop.compute_delay_s) == (0.7, 0.02)
    assert (settings.start_offset_deg, settings.distance_m, settings.seed) == (60, 3, 7)
    assert variant.robot_neck == variant.neck
    np.testing.assert_array_equal(variant.robot_neck.dead_time_s, [0.2, 0.4])
    np.testing.assert_array_equal(variant.robot_neck.velocity_max_rad_s, [0.7, 0.7])
    assert variant.robot_neck.pan.acceleration_max_rad_s2 == load_neck("slow").pan.acceleration_max_rad_s2
    assert variant.robot_neck.geometry.eye_in_tilt_m == (0.1, 0, 0)
    sensor = variant.sensors["reference"]
    assert (sensor.name, sensor.latency_s, sensor.rate_hz) == ("reference", 0.1, 30)


def test_only_the_model_is_wrong_about_the_dead_time():
    variant = resolve({"controller": "mpc", "neck.tilt.dead_time_s": 0.2, "model.dead_time_scale": 1.5})
    np.testing.assert_array_equal(variant.robot_neck.dead_time_s, [0.4, 0.2])
    np.testing.assert_allclose(variant.neck.dead_time_s, [0.6, 0.3])


def test_every_default_is_a_value_that_its_name_accepts():
    for name, field in setting_fields().items():
        assert check_name(name) is None
        if not field.is_required():
            assert check_value(name, field.default) == (field.default, None), name


@pytest.mark.parametrize(
    ("name", "expected"),
    [("mpc.horizn_s", "'mpc.horizon_s'"), ("horizon_s", "'mpc.horizon_s'"), ("nek", "'neck'"), ("out", "unknown")],
)
def test_a_wrong_name_gets_a_suggestion(name, expected):
    assert expected in check_name(name)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("mpc.horizon_s", 9, "less than or equal to 5"),
        ("mpc.horizon_s", "long", "valid number"),
        ("mpc.horizon_s", True, "float"),
        ("height_m", float("nan"), "float"),
        ("seed", 1.5, "valid integer"),
        ("controller", "mcp", "perhaps you meant 'mpc'"),
        ("placement", "sid", "'side'"),
        ("neck", "slw", "perhaps you meant 'slow'"),
        ("sensor", "perfct", "perhaps you meant 'perfect'"),
    ],
)
def test_a_wrong_value_is_told_what_is_accepted(name, value, expected):
    assert expected in check_value(name, value)[1]


@pytest.mark.parametrize(
    ("field", "shown"),
    [
        ("eye_contact_2p6", "eye contact within 2.6 deg (share of the time)"),
        ("gaze_error_rms_deg", "gaze error RMS (deg)"),
        ("gaze_error_p95_deg", "gaze error, 95 % below (deg)"),
        ("return_late_p95_s", "return late, 95 % below (s)"),
        ("forecast_error_500_mm", "forecast error at 0.5 s (mm)"),
        ("forecast_coverage_95_500", "forecast coverage of 95 % at 0.5 s"),
        ("step_ms_p99", "step, 99 % below (ms)"),
        ("mpc.smoothness", "MPC: smoothness"),
        ("sensor.latency_s", "sensor: latency (s)"),
    ],
)
def test_fields_are_shown_by_name_and_unit(field, shown):
    assert with_unit(field) == shown


def test_no_metric_is_shown_by_its_field():
    for name in (*METRICS, *setting_fields()):
        assert "_" not in with_unit(name), name
