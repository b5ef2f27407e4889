"""Logs that follow each other as one."""

import dataclasses

import numpy as np
import pytest

import gazempc as gz
from gazempc.results.log import Fault, join_logs, merge_faults

ROWS = {
    "time_s": ("time_s", "head_true", "joint_", "command_"),
    "capture_time_s": (
        "capture_",
        "arrival_",
        "head_observed",
        "person_id",
        "forecast_mean",
        "forecast_cov",
        "forecast_degrees",
        "forecast_true",
    ),
    "event_time_s": ("event_",),
}


def cut(log, from_s, to_s):
    """The part of a log between two times."""
    parts = {}
    for times, names in ROWS.items():
        kept = (getattr(log, times) >= from_s) & (getattr(log, times) < to_s)
        parts |= {f.name: getattr(log, f.name)[kept] for f in dataclasses.fields(log) if f.name.startswith(names)}
    return dataclasses.replace(log, **parts)


def test_the_parts_of_a_log_join_to_the_log():
    whole = gz.replay("subject03_R1", controller="reactive", predictor="constant_velocity")
    joined = join_logs([cut(whole, 0.0, 1.0), cut(whole, 1.0, 2.5), cut(whole, 2.5, np.inf)])
    for field in dataclasses.fields(whole):
        if field.name != "run":
            np.testing.assert_array_equal(getattr(joined, field.name), getattr(whole, field.name), err_msg=field.name)
    assert joined.run == whole.run
    assert gz.measure(joined).as_dict() == pytest.approx(gz.measure(whole).as_dict(), nan_ok=True)


def test_of_each_event_the_first_exception_and_all_that_came():
    first, other = Fault("forecast_failed", 3, "TypeError: a", "trace a"), Fault("late_plan", 1, "OSError", "b")
    again = Fault("forecast_failed", 4, "ValueError: c", "trace c")
    assert merge_faults([first, other, again]) == (Fault("forecast_failed", 7, "TypeError: a", "trace a"), other)
    assert first.line == "forecast_failed (3 x): TypeError: a"
