"""The convex programs against the nonlinear problem: both joints, the exact 3-D gaze angle, neck offsets."""

from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from builders.recordings import reordered
from builders.replays import replayed

from experiments.engine.command import find_recordings
from gazempc.controllers.controller import CommandState, Situation
from gazempc.controllers.mpc.mpc import LONGEST_TIME_S, Mpc
from gazempc.errors import LeftOutError, PlacementError
from gazempc.neck.ahead import joints_after_dead_time
from gazempc.neck.kinematics import gaze_ray, look_at_rad
from gazempc.neck.spec import load_neck
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.sim.replay import ReplaySettings
from predictors import Forecast

ROUNDED = 1.0 - 1e-6  # used share of the limits
DAMPING, ACQUISITION_DAMPING = np.sqrt(0.5), 0.85
JERK_TIME_S = 0.025
PASSING = 2.0  # price of a radian beyond the acquisition bound, rad^2
ANYWHERE = np.array([-100.0, 100.0])


# ---------------------------------------------------------------- oracle


def rotated(pan, tilt, v):
    """Rz(pan) Ry(-tilt) v, written out."""
    x, y, z = v
    x, z = ca.cos(tilt) * x - ca.sin(tilt) * z, ca.sin(tilt) * x + ca.cos(tilt) * z
    return ca.vertcat(ca.cos(pan) * x - ca.sin(pan) * y, ca.sin(pan) * x + ca.cos(pan) * y, z)


def gaze_angle2(neck, pan, tilt, target):
    """Square of the angle between the gaze ray and the direction to the target, by the series of arcsin^2."""
    eye = rotated(pan, 0.0, neck.geometry.tilt_axis_in_pan_m) + rotated(pan, tilt, neck.geometry.eye_in_tilt_m)
    to_target = target - eye
    sine2 = ca.sumsqr(ca.cross(rotated(pan, tilt, (1.0, 0.0, 0.0)), to_target / ca.norm_2(to_target)))
    return sine2 * (1 + sine2 * (1 / 3 + sine2 * (8 / 45 + sine2 * (4 / 35 + sine2 * 128 / 1575))))


def worth(neck, targets):
    """Gaze error per radian of pan and of tilt, shape (..., 2), with the gaze at the targets.

    The target's distance from the joint's axis, across the ray, over its distance from the eye.
    """
    angles = look_at_rad(neck.geometry, targets)
    eye, ray = gaze_ray(neck.geometry, angles)
    pan = angles[..., 0]
    forward = np.stack([np.cos(pan), np.sin(pan), np.zeros_like(pan)], axis=-1)
    left, up = np.stack([-np.sin(pan), np.cos(pan), np.zeros_like(pan)], axis=-1), np.array([0.0, 0.0, 1.0])
    x, y, z = neck.geometry.tilt_axis_in_pan_m
    tilt_axis = x * forward + y * left + z * up
    turns = []
    for axis, point in ((up, np.zeros(3)), (left, tilt_axis)):
        moved = np.cross(axis, targets - point)
        across = moved - np.sum(moved * ray, axis=-1, keepdims=True) * ray
        turns.append(np.linalg.norm(across, axis=-1) / np.linalg.norm(targets - eye, axis=-1))
    return np.stack(turns, axis=-1)


def servo_tick(axis, p, v, u, h):
    """One servo period of the joint by Runge-Kutta, command held."""
    wn, zeta = axis.natural_frequency_rad_s, axis.damping_ratio

    def pull(p, v):
        return wn**2 * (u - p) - 2 * zeta * wn * v

    a1, b1 = v, pull(p, v)
    a2, b2 = v + h / 2 * b1, pull(p + h / 2 * a1, v + h / 2 * b1)
    a3, b3 = v + h / 2 * b2, pull(p + h / 2 * a2, v + h / 2 * b2)
    a4, b4 = v + h * b3, pull(p + h * a3, v + h * b3)
    return p + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4), v + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)


def rolled(neck, i, lengths):
    """Joint angle, its velocity and acceleration, command, its velocity and acceleration at the end of each step.

    `lengths` are the step durations in control periods.

    Returns their Jacobians by the state, shape (6 K, 5), and by the jerks, shape (6 K, K).
    """
    axis, h = neck.axes[i], neck.servo_period_s
    wn, zeta = axis.natural_frequency_rad_s, axis.damping_ratio
    ticks = [neck.servo_ticks_per_plan * length for length in lengths]
    z0, jerk = ca.SX.sym("z0", 5), ca.SX.sym("jerk", len(ticks))
    p, v, u, du, ddu = (z0[k] for k in range(5))
    columns = []
    for k, count in enumerate(ticks):
        for _ in range(count):
            u, du, ddu = (
                u + h * du + h**2 / 2 * ddu + h**3 / 6 * jerk[k],
                du + h * ddu + h**2 / 2 * jerk[k],
                ddu + h * jerk[k],
            )
            p, v = servo_tick(axis, p, v, u, h)
        columns.append(ca.vertcat(p, v, wn**2 * (u - p) - 2 * zeta * wn * v, u, du, ddu))
    rows = ca.vec(ca.horzcat(*columns).T)
    return ca.Function("rolled", [], [ca.jacobian(rows, z0), ca.jacobian(rows, jerk)]).call([])


@lru_cache
def oracle(name, lengths):
    """IPOPT on both joints jointly, built once per neck."""
    neck = load_neck(name)
    limits, steps, lasts = neck.command_limits, len(lengths), np.array(lengths, dtype=float)
    n, ends_s = steps, neck.control_period_s * np.cumsum(lasts)
    following = np.append(lasts[1:], lasts[-1])
    half_s, weights = 0.5 * neck.control_period_s * following, 0.5 * (lasts + following)
    share, beyond = ca.SX.sym("jerk", n, 2), ca.SX.sym("beyond", steps, 2)  # jerk as a share of the largest
    start, offset, smoothing = ca.SX.sym("z0", 5, 2), ca.SX.sym("offset", 2), ca.SX.sym("T", 2)
    damping = ca.SX.sym("zeta", 2)
    target, turn, rate = ca.SX.sym("target", 3, steps), ca.SX.sym("turn", 2, steps), ca.SX.sym("rate", 2, steps)
    least, most = ca.SX.sym("least", steps, 2), ca.SX.sym("most", steps, 2)
    cost, rows, low, high, joints = PASSING * ca.sum(ca.sum(beyond)), [], [], [], []
    for i in range(2):
        by_state, by_jerk = rolled(neck, i, lengths)
        jerk = ROUNDED * float(limits.jerk_max_rad_s3[i]) * share[:, i]
        command = ca.reshape(by_state @ start[:, i] + by_jerk @ jerk, n, 6).T
        motion = command[:3, :]
        joints.append(motion[0, :] + offset[i])
        cost += smoothing[i] ** 4 * ca.dot(weights[None], (turn[i, :] * motion[2, :]) ** 2) + JERK_TIME_S**6 * ca.dot(
            jerk**2, lasts
        )
        slowing = 4 * damping[i] ** 2 - 2
        cost += slowing * smoothing[i] ** 2 * ca.dot(weights[None], (turn[i, :] * (motion[1, :] - rate[i, :])) ** 2)
        passing = [motion[0, :].T - most[:, i] - beyond[:, i], least[:, i] - motion[0, :].T - beyond[:, i]]
        rows += [*passing, command[3, :].T, command[4, :].T + half_s * command[5, :].T, command[5, :].T]
        fast, hard = ROUNDED * limits.velocity_max_rad_s[i], ROUNDED * limits.acceleration_max_rad_s2[i]
        high += [0.0, 0.0, limits.position_max_rad[i], fast, hard]
        low += [-np.inf, -np.inf, limits.position_min_rad[i], -fast, -hard]
    cost += sum(weights[k] * gaze_angle2(neck, joints[0][k], joints[1][k], target[:, k]) for k in range(steps))
    parameters = ca.veccat(start, offset, smoothing, damping, target, turn, rate, least, most)
    solver = ca.nlpsol(
        "oracle",
        "ipopt",
        {"x": ca.veccat(share, beyond), "p": parameters, "f": 1e4 * cost, "g": ca.vertcat(*rows)},
        {"print_time": 0, "ipopt.print_level": 0, "ipopt.sb": "yes", "error_on_fail": True},
    )
    angles = ca.Function("angles", [share, parameters], [ca.vertcat(*joints).T])

    def solve(states, offset_rad, times_s, dampings, targets, not_past_rad):
        # Joint velocities that track the target.
        rates = np.gradient(look_at_rad(neck.geometry, targets), ends_s, axis=0)
        values = (np.transpose(states), offset_rad, times_s, dampings, targets.T, worth(neck, targets).T, rates.T)
        p = ca.veccat(*map(ca.DM, (*values, *np.transpose(not_past_rad, (1, 2, 0)))))
        counts = [steps, steps, n, n, n] * 2
        bounds = {"lbg": np.repeat(low, counts), "ubg": np.repeat(high, counts)}
        counts = [2 * n, 2 * steps]
        bounds |= {"lbx": np.repeat([-1.0, 0.0], counts), "ubx": np.repeat([1.0, np.inf], counts)}
        found = solver(x0=0.0, p=p, **bounds)["x"]
        return np.array(angles(ca.reshape(found[: 2 * n], n, 2), p))

    return solve


# ---------------------------------------------------------------- the MPC, listened to


class Planned(NamedTuple):
    """Input and output of the MPC; joint angles of shape (N, 2), two bounds of shape (2, N)."""

    states: list
    offset_rad: np.ndarray
    times_s: list
    dampings: list
    targets: np.ndarray
    not_past_rad: list
    angles_rad: np.ndarray
    lengths: tuple


class Listener(Mpc):
    """An MPC that records the inputs of its programs in every plan with `wanted`."""

    def __init__(self, neck, smoothing_time_s, acquisition_time_s, **settings):
        smoothing_time_s = smoothing_time_s or LONGEST_TIME_S  # of these necks
        super().__init__(neck, smoothing_time_s=smoothing_time_s, acquisition_time_s=acquisition_time_s, **settings)
        self.recorded, self.selects, self._calls = [], lambda situation: True, []
        self.lengths = tuple(self.ocps[0].model.lengths.astype(int).tolist())
        for ocps, time_s, damping in (
            (self.ocps, smoothing_time_s, DAMPING),
            (self.acquisition_ocps, acquisition_time_s, ACQUISITION_DAMPING),
        ):
            for ocp in ocps:
                ocp.solve = self._listening(ocp, ocp.solve, time_s, damping)

    def _listening(self, ocp, solve, time_s, damping):
        def listening(state, reference, not_past_rad=None):
            solution = solve(state, reference, not_past_rad)
            angles = ocp.model.joint @ np.concatenate([state, [1.0], solution.scaled_jerk])
            assert solution.softened == 0.0
            free = np.repeat(ANYWHERE[:, None], len(reference), axis=1)
            bounds_rad = free if not_past_rad is None else np.array(not_past_rad)
            self._calls.append((state.copy(), time_s, damping, bounds_rad, angles))
            return solution

        return listening

    def plan(self, situation):
        self._calls.clear()
        plan = super().plan(situation)
        if self.selects(situation):
            states, times_s, dampings, not_past_rad, angles = zip(*self._calls, strict=True)
            offset_rad = situation.joint_offset_rad
            means = situation.forecast.means_base_m
            angles_rad = np.stack(angles, axis=1) + offset_rad
            self.recorded.append(
                Planned(states, offset_rad, times_s, dampings, means, not_past_rad, angles_rad, self.lengths)
            )
        return plan


def differences_deg(name, planned):
    """Angle between the gaze of the convex programs and that of the nonlinear one at each step, degrees."""
    neck = load_neck(name)
    best = oracle(name, planned.lengths)(*planned[:6])
    _, ours = gaze_ray(neck.geometry, planned.angles_rad)
    _, theirs = gaze_ray(neck.geometry, best)
    return np.degrees(np.linalg.norm(ours - theirs, axis=1))


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


# ---------------------------------------------------------------- tests


@pytest.mark.parametrize(
    ("name", "start_deg", "speed_m_s", "acquired", "tolerance_deg"),
    [
        ("reference", 5.0, 1.1, False, 0.05),
        ("reference", 5.0, 1.1, True, 0.05),
        ("fetch", 1.0, 0.4, False, 0.05),
        # At a pan error of 10 deg, an eye in front of the axis has another tilt to the target, which the convex
        # programs, separate for each joint, do not model.
        ("fetch", 5.0, 1.1, False, 0.15),
    ],
)
def test_the_convex_gaze_is_close_to_the_nonlinear_optimum(name, start_deg, speed_m_s, acquired, tolerance_deg):
    """A walker who passes 1.5 m away, from an offset, under a load: RMS angle between the two gazes."""
    neck = load_neck(name)
    mpc = Listener(neck, smoothing_time_s=0.11, acquisition_time_s=0.09, horizon_s=0.5)
    mpc._acquisitions[0]._on = acquired  # larger initial error
    times = mpc.forecast_times_s(0.0, 0.0)

    def path(t):
        return np.stack([np.full_like(t, 1.5), 0.9 - speed_m_s * t, 0.35 + 0.02 * np.sin(11 * t)], axis=-1)

    start = look_at_rad(neck.geometry, path(neck.dead_time_s[:1]))[0] + [np.radians(start_deg), 0.0]
    offset_rad = np.array([0.005, -0.02])
    situation = Situation(
        joints_after_dead_time(neck, 0),
        start_s=0.0,
        forecast=Forecast(times, path(times), np.zeros((times.size, 3, 3)), 0.0),
        command=CommandState(start, np.zeros(2), np.zeros(2)),
        joint_position_rad=start + offset_rad,
        joint_velocity_rad_s=np.zeros(2),
        joint_offset_rad=offset_rad,
        sent_rad=np.tile(start, (100, 1)),
        committed_rad=np.zeros((0, 2)),
    )
    mpc.plan(situation)
    (planned,) = mpc.recorded
    assert planned.dampings == (ACQUISITION_DAMPING if acquired else DAMPING, DAMPING)
    apart = rms(differences_deg(name, planned))
    print(f"{name}: {apart:.4f} deg RMS")
    assert apart < tolerance_deg
    # Sensitivity: the motion itself is degrees, not hundredths of one.
    assert np.degrees(np.ptp(planned.angles_rad[:, 0])) > 2.0


def planned_on_walks(walks_dir, name):
    """Three instants in the first half of every sixteenth walk."""
    neck, settings = load_neck(name), ReplaySettings()
    mpc = Listener(neck, **settings.mpc.model_dump())
    for path in find_recordings([str(walks_dir)])[::16]:
        try:
            placed = place(load(path), "side", settings.distance_m, settings.height_m)
            ticks = np.round(np.array([0.15, 0.3, 0.45]) * placed.times_s[-1] * neck.control_rate_hz)
            mpc.selects = lambda situation, ticks=ticks: round(situation.start_s * neck.control_rate_hz) in ticks
            replayed(reordered(placed, range(placed.times_s.size // 2 + 2)), mpc, neck=neck)
        except (PlacementError, LeftOutError):
            continue
    assert len(mpc.recorded) > 9
    return mpc.recorded


@pytest.mark.slow
@pytest.mark.parametrize(("name", "most_rms_deg", "most_deg"), [("reference", 0.01, 0.1), ("fetch", 0.03, 0.3)])
def test_on_real_walks_the_convex_gaze_is_close_to_the_nonlinear_optimum(walks_dir, name, most_rms_deg, most_deg):
    """Over all instants and the whole horizon, forecasts and smoothing times as they were.

    The aim is 0.05 deg RMS; the bound is tighter. At large errors `fetch` has its eye off the axis, which the convex
    programs do not model.
    """
    planned = planned_on_walks(walks_dir, name)
    apart = np.array([differences_deg(name, each) for each in planned])
    print(f"{name}: {len(planned)} plans, {rms(apart):.5f} deg RMS, at most {apart.max():.4f} deg")
    assert rms(apart) < most_rms_deg
    assert apart.max() < most_deg
    # Sensitivity: the gaze turns by degrees.
    assert np.mean([np.degrees(np.ptp(each.angles_rad[:, 0])) for each in planned]) > 5.0
