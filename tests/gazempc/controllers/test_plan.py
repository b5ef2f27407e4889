"""A plan is a value: its shapes are checked, and it is the integral of its jerks."""

import numpy as np
import pytest

from gazempc.controllers.controller import Plan


def test_plan_shapes_are_checked():
    with pytest.raises(ValueError, match="shape"):
        Plan(0.0, 0.02, np.zeros((3, 1)), np.zeros((3, 1)), np.zeros((3, 1)))
    with pytest.raises(ValueError, match="differ"):
        Plan(0.0, 0.02, np.zeros((3, 2)), np.zeros((2, 2)), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="finite start"):
        Plan(np.nan, 0.02, np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="shape"):
        Plan(0.0, 0.02, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2)))


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_a_plan_is_the_integral_of_its_jerks(steps):
    lengths_s = np.full(steps, 0.02)
    jerks = np.random.default_rng(0).uniform(-1.0, 1.0, (len(lengths_s), 2))
    knots = [(np.array([0.1, -0.2]), np.array([0.5, 0.3]), np.zeros(2))]

    def moved(knot, jerk, h):
        p, v, a = knot
        return p + h * v + h**2 / 2 * a + h**3 / 6 * jerk, v + h * a + h**2 / 2 * jerk, a + h * jerk

    for jerk, h in zip(jerks, lengths_s, strict=True):
        knots.append(moved(knots[-1], jerk, h))
    positions, velocities, accelerations = (np.array(part) for part in zip(*knots, strict=True))
    plan = Plan(1.0, 0.02, positions, velocities, accelerations)
    times_s = np.concatenate([[0.0], np.cumsum(lengths_s)])
    assert plan.end_s == pytest.approx(1.0 + times_s[-1] + 0.02)
    for k, (jerk, h) in enumerate(zip(jerks, lengths_s, strict=True)):
        for share in (0.0, 0.3, 0.99):
            found = plan.at(1.0 + times_s[k] + share * h)
            wanted = moved(knots[k], jerk, share * h)
            assert found.position_rad == pytest.approx(wanted[0], abs=1e-12)
            assert found.velocity_rad_s == pytest.approx(wanted[1], abs=1e-9)
            assert found.acceleration_rad_s2 == pytest.approx(wanted[2], abs=1e-7)
    beyond = plan.at(plan.end_s)
    assert beyond.position_rad == pytest.approx(positions[-1] + 0.02 * velocities[-1])
    assert plan.at(0.9).position_rad == pytest.approx(positions[0])
