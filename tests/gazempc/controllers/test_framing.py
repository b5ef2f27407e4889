"""A zone of the picture as target: the optimum, rest inside the zone, and the limits of a run."""

import casadi as ca
import numpy as np
import pytest
from builders.control import run
from builders.ocp import NECK, QUIET, even, joint, random_states, shot
from builders.standing import standing_together

import gazempc as gz
from gazempc.controllers.mpc import problem
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.margins.margins import too_small
from gazempc.neck.picture import Framing
from gazempc.results.motion import reversals
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene

STEPS, T, ZETA = 8, 0.1, 0.85
VIEW_DEG = (60.0, 34.0)
CAMERA = gz.load_neck("ptz").model_copy(update={"head_view_deg": VIEW_DEG})
# The same camera with angle commands.
BY_ANGLES = CAMERA.with_axes(
    {name: getattr(CAMERA, name).model_copy(update={"command": "position"}) for name in ("pan", "tilt")}
)


def best_by_ipopt(state, low, high):
    """IPOPT with the distance from the zone as slack variable; joint angles, shape (STEPS,)."""
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
    found = ca.nlpsol("solver", "ipopt", program, QUIET)(
        x0=0,
        lbg=ca.vertcat(ca.DM.zeros(5 * STEPS + 5), -ca.DM.ones(m), -ca.DM.inf(STEPS), low),
        ubg=ca.vertcat(ca.DM.zeros(5 * STEPS + 5), ca.DM.ones(m), high, ca.DM.inf(STEPS)),
        lbx=ca.vertcat(-ca.DM.inf(5 * (1 + STEPS)), -ca.DM.ones(STEPS), ca.DM.zeros(STEPS)),
        ubx=ca.vertcat(ca.DM.inf(5 * (1 + STEPS)), ca.DM.ones(STEPS), ca.DM.inf(STEPS)),
    )
    return np.array(found["x"])[: 5 * (1 + STEPS), 0].reshape(1 + STEPS, 5)[1:, 0]


@pytest.mark.parametrize("offset", [0.0, 0.15, -0.3])
def test_the_optimum_equals_that_of_ipopt(offset):
    ocp = AxisOcp(even(STEPS), problem.Tuning(T, ZETA, zone=True), bounded=True)
    solvers = set()
    for state, reference in random_states(2, 0.1, STEPS, seed=3):
        low, high = reference + offset - 0.05, reference + offset + 0.05
        solution = ocp.solve(state, reference, (low, high))
        solvers.add(solution.solver)
        np.testing.assert_allclose(
            joint(ocp, state, solution.scaled_jerk)[:STEPS], best_by_ipopt(state, low, high), atol=2e-5
        )
    assert "none" not in solvers


def test_a_joint_at_rest_in_the_zone_stays_at_rest():
    ocp = AxisOcp(even(STEPS), problem.Tuning(T, ZETA, zone=True), bounded=True)
    reference = np.linspace(0.01, 0.04, STEPS)
    solution = ocp.solve(np.array([0.0, 0.0, 0.0, 0.0, 0.0]), reference, (reference - 0.05, reference + 0.05))
    assert solution.solver == "gain"
    np.testing.assert_allclose(solution.command, 0.0, atol=1e-12)


def pan_deg(*steps):
    """A head 2 m away at piecewise constant angles: pairs of a time and a pan."""

    def path(times_s):
        pan = np.radians(np.select([times_s >= at for at, _ in steps[::-1]], [to for _, to in steps[::-1]], 0.0))
        return 2.0 * np.stack([np.cos(pan), np.sin(pan), np.zeros_like(pan)], axis=-1)

    return path


@pytest.mark.parametrize(
    ("hysteresis_per_s", "sigma_m", "back_to_deg", "turns"),
    [(0.0, 0.0, 21.0, 1), (0.0, 0.2, 21.0, 0), (5.0, 0.0, 21.0, 0), (5.0, 0.2, -25.0, 1)],
)
def test_the_camera_turns_back_only_beyond_the_deviation_of_the_head(hysteresis_per_s, sigma_m, back_to_deg, turns):
    """A head at 40 deg is framed from 31 to 35 deg; at 21 it is just outside the zone."""
    framing = Framing(headroom=0.5, lead_room=0.0, hysteresis_per_s=hysteresis_per_s)
    joints, *_ = run(
        gz.Mpc(BY_ANGLES, framing=framing),
        BY_ANGLES,
        pan_deg((0.4, 40.0), (2.0, back_to_deg)),
        200,
        sigma_m=lambda since_s: np.full_like(since_s, sigma_m),
    )
    assert np.degrees(joints).max() > 28.0
    assert reversals(np.degrees(joints)[:, 0]) == turns


@pytest.mark.parametrize(("excursions", "moves"), [(0.7, False), (2.0, True)])
def test_the_camera_ignores_a_short_excursion_of_a_standing_person(excursions, moves):
    """The forecast is the present position: 14 deg, outside the zone of 10 deg and inside the picture of 30."""
    framing = Framing(headroom=0.5, lead_room=0.0)
    path = pan_deg((0.4, 14.0), (0.4 + excursions * 1.5 * CAMERA.pan.dead_time_s, 0.0))
    held = lambda now, times_s: path(np.full_like(times_s, now))  # noqa: E731
    joints, *_ = run(gz.Mpc(BY_ANGLES, framing=framing), BY_ANGLES, path, 200, known=held)
    assert (np.degrees(joints)[:, 0].max() > 2.0) == moves


@pytest.mark.parametrize("subject", ["one", "all"])
def test_the_box_of_all_people_is_kept_in_the_middle(subject):
    """Two standing people 40 deg apart; the nearer one alone would be framed otherwise."""
    scene = standing_together(4.0, (1.4, 0.5, 0.0), (2.0, -0.73, 0.0))
    framing = Framing(subject=subject, view_deg=VIEW_DEG, zone=(0.05, 0.05), headroom=0.5)
    log = replay_scene(scene, "mpc", "constant_velocity", ReplaySettings(attend="nearest", framing=framing)).log
    settled = np.degrees(log.joint_position_rad[log.time_s > 3.0, 0])
    assert settled.mean() == pytest.approx(20.0 if subject == "one" else 0.0, abs=5.0)


def metrics_of(recording, framing):
    scene = make_scene(recording, SceneSettings(), CAMERA)
    log = replay_scene(scene, "mpc", "walker", ReplaySettings(framing=framing)).log
    return gz.measure(log), log


@pytest.mark.slow
def test_the_camera_is_at_rest_before_a_standing_person():
    metrics, log = metrics_of("subject03_stand", Framing())
    assert metrics.time_in_zone > 0.99
    assert metrics.reversals_per_min == 0.0
    # The gaze starts on the head; headroom moves it once.
    assert "solver_gave_up" not in set(log.event_name)


@pytest.mark.slow
def test_a_walker_is_kept_in_the_zone_within_the_limits_of_the_picture():
    framing = Framing(acceleration_max=0.8)
    metrics, _ = metrics_of("subject01_R1", framing)
    plain, _ = metrics_of("subject01_R1", Framing(subject="no"))
    assert metrics.time_in_zone > 0.95
    assert metrics.limit_violations == 0
    assert metrics.peak_acceleration_rad_s2 <= 0.8 * np.radians(VIEW_DEG[0]) * 1.01
    assert metrics.rms_acceleration_rad_s2 < 0.9 * plain.rms_acceleration_rad_s2


def test_a_zone_has_no_margin_warning():
    """Inside the zone the cost gradient is zero: margins of the linear loop do not apply."""
    assert too_small(gz.Mpc(CAMERA, framing=Framing())) == []
