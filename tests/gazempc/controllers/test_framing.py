"""A zone of the picture in place of a point: the optimum of the statement, rest inside, and the limits of a run."""

import casadi as ca
import numpy as np
import pytest
from builders.ocp import NECK, even, joint, random_states, shot

import gazempc as gz
from gazempc.controllers.mpc import problem
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.margins.margins import too_small
from gazempc.neck.picture import Framing
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene

STEPS, T, ZETA = 8, 0.1, 0.85
VIEW_DEG = (60.0, 34.0)
CAMERA = gz.load_neck("ptz").model_copy(update={"head_view_deg": VIEW_DEG})


def best_by_ipopt(state, low, high):
    """The statement with the distance from the zone as a variable of its own; angles of the joint, shape (STEPS,)."""
    o = problem.Trajectory(NECK, 0, (1,) * STEPS)
    z, j, e = ca.SX.sym("Z", 5, 1 + STEPS), ca.SX.sym("J", STEPS), ca.SX.sym("e", STEPS)
    defects, values = shot(o, NECK, 0, z, problem.jerk_max_rad_s3(NECK, 0) * j)
    cost = problem.cost(o, problem.Tuning(T, ZETA, zone=True)) + ca.dot(o.w, e**2)
    symbols = [getattr(o, name) for name in values]
    cost, kept = ca.substitute([cost, problem.limits(o, NECK, 0)], symbols, list(values.values()))
    q, m = values["q"], kept.shape[0]
    program = {
        "x": ca.veccat(z, j, e),
        "f": 1e4 * cost,
        "g": ca.vertcat(defects, z[:, 0] - ca.DM(state), kept, q - e, q + e),
    }
    quiet = {
        "print_time": 0,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": 1e-11,
        "error_on_fail": True,
        "ipopt.bound_relax_factor": 0.0,
    }
    found = ca.nlpsol("solver", "ipopt", program, quiet)(
        x0=0,
        lbg=ca.vertcat(ca.DM.zeros(5 * STEPS + 5), -ca.DM.ones(m), -ca.DM.inf(STEPS), low),
        ubg=ca.vertcat(ca.DM.zeros(5 * STEPS + 5), ca.DM.ones(m), high, ca.DM.inf(STEPS)),
        lbx=ca.vertcat(-ca.DM.inf(5 * (1 + STEPS)), -ca.DM.ones(STEPS), ca.DM.zeros(STEPS)),
        ubx=ca.vertcat(ca.DM.inf(5 * (1 + STEPS)), ca.DM.ones(STEPS), ca.DM.inf(STEPS)),
    )
    return np.array(found["x"])[: 5 * (1 + STEPS), 0].reshape(1 + STEPS, 5)[1:, 0]


@pytest.mark.parametrize("offset", [0.0, 0.15, -0.3])
def test_the_optimum_is_that_of_the_statement(offset):
    ocp = AxisOcp(even(STEPS), T, ZETA, bounded=True, zone=True)
    solvers = set()
    for state, reference in random_states(2, 0.1, STEPS, seed=3):
        low, high = reference + offset - 0.05, reference + offset + 0.05
        solution = ocp.solve(state, reference, (low, high))
        solvers.add(solution.solver)
        np.testing.assert_allclose(
            joint(ocp, state, solution.scaled_jerk)[:STEPS], best_by_ipopt(state, low, high), atol=2e-5
        )
    assert "none" not in solvers


def test_a_joint_at_rest_in_the_zone_stays_there():
    ocp = AxisOcp(even(STEPS), T, ZETA, bounded=True, zone=True)
    reference = np.linspace(0.01, 0.04, STEPS)
    solution = ocp.solve(np.array([0.0, 0.0, 0.0, 0.0, 0.0]), reference, (reference - 0.05, reference + 0.05))
    assert solution.solver == "gain"
    np.testing.assert_allclose(solution.command, 0.0, atol=1e-12)


def metrics_of(recording, framing):
    scene = make_scene(recording, SceneSettings(), CAMERA)
    log = replay_scene(scene, "mpc", "walker", ReplaySettings(framing=framing)).log
    return gz.measure(log), log


@pytest.mark.slow
def test_the_camera_rests_before_a_person_who_stands():
    metrics, log = metrics_of("subject03_stand", Framing())
    assert metrics.time_in_zone > 0.99
    resting, _ = metrics_of("subject03_stand", Framing(subject="no"))
    assert metrics.travel_deg_per_min < 0.2 * resting.travel_deg_per_min
    assert metrics.reversals_per_min == 0.0
    # The start looks straight at the head; headroom moves it once.
    assert "solver_gave_up" not in set(log.event_name)


@pytest.mark.slow
def test_a_walker_is_kept_in_the_zone_within_the_limits_of_the_picture():
    framing = Framing(acceleration_max=0.8)
    metrics, _ = metrics_of("subject01_R1", framing)
    plain, _ = metrics_of("subject01_R1", Framing(subject="no"))
    assert metrics.time_in_zone > 0.95
    assert metrics.limit_violations == 0
    assert metrics.peak_acceleration_rad_s2 <= 0.8 * np.radians(VIEW_DEG[0]) * 1.01
    assert metrics.rms_acceleration_rad_s2 < 0.7 * plain.rms_acceleration_rad_s2


def test_a_zone_is_no_unstable_loop():
    """Inside, nothing pulls the camera anywhere: the checks of the linear loop do not apply."""
    assert too_small(gz.Mpc(CAMERA, framing=Framing())) == []
