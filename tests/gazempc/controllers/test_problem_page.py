"""The cost, weights and rows on the page *Controllers* equal those of the code."""

import re

import casadi as ca
import numpy as np
import pytest
from builders.pages import page

from gazempc.controllers.mpc import problem
from gazempc.controllers.mpc.acquisition import ACQUIRED_FROM_RAD, ACQUISITION_DAMPING, CONTACT_RAD, FAR_RAD
from gazempc.controllers.mpc.condense import growing_steps
from gazempc.controllers.mpc.mpc import LONGEST_TIME_S
from gazempc.neck.spec import load_neck
from gazempc.settings import MpcSettings

NECK = load_neck("fetch")  # its limits are asymmetric in tilt
LENGTHS = growing_steps(0.8, NECK.control_period_s)
PAGE = page("controllers")
DAMPED = problem.Tuning(0.11, ACQUISITION_DAMPING)


def formula():
    """The lines of the problem on the page: the cost, and each constraint."""
    (block,) = re.findall(r"```text\nminimise +(.*?)```", PAGE, re.DOTALL)
    cost, constraints = block.split("subject to")
    return " ".join(cost.split()), [
        line.strip().removesuffix(",     s >= 0") for line in constraints.strip().splitlines()
    ]


def python(text):
    """A formula of the page as Python: a space between factors multiplies, `_k` is each step's."""
    text = re.sub(r"_k\b", "", text).replace("^", "**")
    text = text.replace("sum_k", "1").replace("sum ", "1 ")
    return re.sub(r"(?<=[\w)]) (?=[\w(])", " * ", text)


def drawn():
    """Numbers for the symbols, by name."""
    rng, n = np.random.default_rng(2), len(LENGTHS)
    return {name: rng.normal(size=n) for name in ("q", "v", "a", "u", "du", "ddu", "j", "r")}


def evaluated(expression, o, values):
    symbols = [getattr(o, name) for name in values]
    return np.array(ca.Function("f", symbols, [expression])(*values.values()))[:, 0]


@pytest.mark.parametrize("tuning", [problem.Tuning(0.12), DAMPED])
def test_the_cost_equals_that_of_the_page(tuning):
    o, values = problem.Trajectory(NECK, 0, LENGTHS), drawn()
    cost, _ = formula()
    assert cost.endswith(" + rho sum(s)")
    T, zeta = tuning.smoothing_time_s, tuning.damping_ratio
    ends_s, h = np.cumsum(LENGTHS) * NECK.control_period_s, np.array(LENGTHS, dtype=float)
    names = values | {
        "w": (h + np.append(h[1:], h[-1])) / 2,
        "h": h,
        "dr": np.gradient(values["r"], ends_s),
        "T": T,
        "T_j": 0.025,
        "d": 4 * zeta**2 - 2,
    }
    by_page = np.sum(eval(python(cost.removesuffix(" + rho sum(s)")), {}, names))
    assert evaluated(problem.cost(o, tuning), o, values)[0] == pytest.approx(by_page, rel=1e-12)


@pytest.mark.parametrize("index", [0, 1])
def test_the_rows_equal_those_of_the_page(index):
    """Each line `low - s <= value <= high + s` is a row that is -1 at low and 1 at high."""
    o, values, limits = problem.Trajectory(NECK, index, LENGTHS), drawn(), NECK.command_limits
    h = np.array(LENGTHS, dtype=float) * NECK.control_period_s
    names = values | {
        "H": np.append(h[1:], h[-1]),
        "s": 0.0,
        "j_max": limits.jerk_max_rad_s3[index],
        "u_min": limits.position_min_rad[index],
        "u_max": limits.position_max_rad[index],
        "du_max": limits.velocity_max_rad_s[index],
        "ddu_max": limits.acceleration_max_rad_s2[index],
    }
    by_page = []
    for line in formula()[1][2:]:
        bare = re.fullmatch(r"\|(.*)\| <= (.*)", line)
        low, value, high = (f"-({bare[2]})", bare[1], bare[2]) if bare else line.split(" <= ")
        low, value, high = (eval(python(text), {}, names) for text in (low, value, high))
        by_page.append((2.0 * value - low - high) / (high - low))
    ours = evaluated(problem.limits(o, NECK, index), o, values)
    assert ours == pytest.approx(np.concatenate(by_page), rel=2e-6)
    assert formula()[1][1] == "|j_k| <= j_max"
    assert problem.jerk_max_rad_s3(NECK, index) == pytest.approx(names["j_max"], rel=2e-6)


def weight(name):
    """The default in the table of weights."""
    return re.search(rf"^\| {name} \| ([\d.]+)", PAGE, re.MULTILINE)[1]


def test_the_weights_equal_those_of_the_page():
    defaults = MpcSettings()
    assert float(weight(r"T, `mpc\.smoothing_time_s`")) == LONGEST_TIME_S
    assert float(weight(r"`mpc\.acquisition_time_s`")) == defaults.acquisition_time_s
    assert float(weight(r"`mpc\.horizon_s`")) == defaults.horizon_s
    assert float(weight("rho")) == problem.SLACK_PRICE_RAD2
    assert float(weight("T_j, weight of the command's jerk")) == problem.JERK_TIME_S
    for number in (ACQUISITION_DAMPING, *np.degrees((ACQUIRED_FROM_RAD, FAR_RAD, CONTACT_RAD))):
        assert re.search(rf"\b{number:g}\b", PAGE)
    assert f"`{' '.join(map(str, growing_steps(0.8, 0.02)))}`" in PAGE
