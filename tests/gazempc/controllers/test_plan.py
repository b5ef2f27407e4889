"""A plan: shape checks, and integration of its jerks."""

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
    h, jerks = 0.02, np.random.default_rng(0).uniform(-1.0, 1.0, (steps, 2))
    knots = [np.array([[0.1, -0.2], [0.5, 0.3], [0.0, 0.0]])]

    def moved(knot, jerk, h):
        p, v, a = knot
        return np.array([p + h * v + h**2 / 2 * a + h**3 / 6 * jerk, v + h * a + h**2 / 2 * jerk, a + h * jerk])

    for jerk in jerks:
        knots.append(moved(knots[-1], jerk, h))
    plan = Plan(1.0, h, *np.transpose(knots, (1, 0, 2)))
    assert plan.end_s == pytest.approx(1.0 + (steps + 1) * h)
    for k, jerk in enumerate(jerks):
        for share in (0.0, 0.3, 0.99):
            found = plan.at(1.0 + (k + share) * h)
            expected = moved(knots[k], jerk, share * h)
            motion = found.position_rad, found.velocity_rad_s, found.acceleration_rad_s2
            np.testing.assert_allclose(motion, expected, atol=1e-7)
    position_rad, velocity_rad_s, _ = knots[-1]
    assert plan.at(plan.end_s).position_rad == pytest.approx(position_rad + h * velocity_rad_s)
    assert plan.at(0.9).position_rad == pytest.approx(knots[0][0])
