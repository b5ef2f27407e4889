"""The solution of the example `ocp.py` equals the plan of the MPC."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.mpc.mpc import Mpc
from gazempc.neck.spec import load_neck

EXAMPLE = runpy.run_path(str(Path(__file__).resolve().parents[2] / "examples" / "ocp.py"))
NECK = load_neck("reference")
# The tracking program, without acquisition bounds.
OCP = Mpc(NECK).ocps[0]


def compared(z0, reference):
    jerks, motion = EXAMPLE["solve"](z0, reference)
    plan = OCP.solve(z0, reference)
    ends = np.cumsum(EXAMPLE["steps"])
    known = ends[ends <= plan.command.shape[1]]
    assert plan.command[0, known - 1] == pytest.approx(motion[2, 1 : 1 + len(known)], abs=2e-6)
    assert plan.scaled_jerk * OCP.model.jerk_scale == pytest.approx(jerks, abs=0.05)
    return plan.solver


def test_the_example_has_the_parameters_of_the_neck():
    assert (EXAMPLE["wn"], EXAMPLE["zeta"]) == (NECK.pan.natural_frequency_rad_s, NECK.pan.damping_ratio)
    assert (EXAMPLE["period_s"], EXAMPLE["h"]) == (NECK.control_period_s, NECK.servo_period_s)
    assert EXAMPLE["steps"] == OCP.model.lengths.astype(int).tolist()


@pytest.mark.parametrize(
    ("z0", "to_rad", "solver"),
    [((0.0,) * 5, 0.02, "gain"), ((0.1, 0.4, 0.15, 0.5, -2.0), 0.5, "daqp")],
)
def test_the_plan_of_the_example_equals_that_of_the_mpc(z0, to_rad, solver):
    steps = np.cumsum(EXAMPLE["steps"])
    assert compared(np.array(z0), z0[0] + (to_rad - z0[0]) * steps / steps[-1]) == solver


@pytest.mark.slow
@settings(max_examples=3)
@given(st.tuples(*[st.floats(-1, 1)] * 5), st.floats(-1, 1), st.floats(-1, 1))
def test_plans_are_equal_from_any_start_within_the_limits(unit, at, slope):
    z0 = 0.5 * np.array(unit) * [1.3, 2.4, 1.3, 2.4, 14.0]
    compared(z0, at + slope * np.cumsum(EXAMPLE["steps"]) * 0.02)
