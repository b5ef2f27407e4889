"""The shipped `walker` on walks: forecast errors and coverage with each sensor.

Synthetic walks are held out. Real ones were fitted on: there the tests detect regressions only.
"""

import dataclasses

import numpy as np
import pytest
from builders.people import yaw_quat
from builders.walkers import forecasts, moved, random_covariance, random_model, seen_of
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import f as f_distribution

from experiments.engine.command import find_recordings
from experiments.forecast.errors import forecast_errors
from gazempc.recordings.load import load
from gazempc.recordings.recording import TrueHead
from gazempc.sim.sensor import load_sensor, observe
from predictors import ConstantVelocity, HeadObservation, LastPosition, Walker, bearing_covariance
from predictors.walker.network import shipped_walker_model

SYNTHETIC = [f"subject{k:02d}_R{k % 6 + 1}" for k in range(1, 15)]
AHEAD_S = np.array([0.25, 0.5, 1.0])


def errors(recording, predictor, sensor="reference", ahead_s=(0.5,)):
    """Distances of forecast and truth, and squared Mahalanobis distances, shape (N, horizons)."""
    found = forecast_errors(recording, predictor, load_sensor(sensor), np.array(ahead_s), 0)
    return np.linalg.norm(found.difference_m, axis=-1), found.nees


def mean_errors(recordings, make, sensor="reference", ahead_s=(0.5,)):
    return np.mean([np.nanmean(errors(r, make(), sensor, ahead_s)[0], axis=0) for r in recordings], axis=0)


# Errors relative to constant velocity at 0.25, 0.5 and 1 s: shipped model, plus a tolerance of up to 0.06.
SYNTHETIC_RATIOS = {
    "reference": (0.54, 0.52, 0.53),
    "face_camera": (0.95, 0.88, 0.78),
    "perfect": (0.36, 0.38, 0.43),
}
# Goals for left-out people: .44 .47 .60, .53 .53 .60 and .70 .62 .65.
REAL_RATIOS = {"perfect": (0.44, 0.47, 0.60), "reference": (0.55, 0.53, 0.62), "body_tracker": (0.82, 0.74, 0.72)}
# Points by which 68 and 95 % may be missed on walks that are not those of the fit.
MISSED = (0.10, 0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("sensor", "ratios"), SYNTHETIC_RATIOS.items())
def test_synthetic_walkers_are_forecast_better_than_by_constant_velocity(sensor, ratios):
    recordings = [load(name) for name in SYNTHETIC[::4]]
    ours, plain = (mean_errors(recordings, make, sensor, AHEAD_S) for make in (Walker, ConstantVelocity))
    np.testing.assert_array_less(ours / plain, ratios)


@pytest.mark.slow
@pytest.mark.parametrize(("activity", "sensor"), [("stand", "body_tracker"), ("turn_on_spot", "reference")])
def test_standing_people_are_forecast_as_well_as_by_last_position(activity, sensor):
    recordings = [load(f"subject{k:02d}_{activity}") for k in range(1, 15, 7)]
    ours, last = (mean_errors(recordings, make, sensor, AHEAD_S[:2]) for make in (Walker, LastPosition))
    np.testing.assert_array_less(ours / last, 1.1 if activity == "turn_on_spot" else 1.02)


def revisions_m(recording, ahead_s=0.5):
    """Change of the forecast for one instant from frame to frame, metres."""
    predictor, before, found = Walker(), None, []
    for sighting in observe(recording, load_sensor("perfect"), 0):
        predictor.update(sighting.observation)
        now_s = sighting.observation.capture_time_s
        if before is not None and now_s > 1.0:
            target_s = before.issued_at_s + ahead_s
            old, new = before.means_base_m[0], predictor.forecast([target_s]).means_base_m[0]
            found.append(np.linalg.norm(new - old))
        before = predictor.forecast([now_s + ahead_s])
    return np.array(found)


@pytest.mark.parametrize(("activity", "largest_m"), [("stand", 0.01), ("start", 0.11), ("stop", 0.11)])
def test_revisions_of_the_forecast_from_frame_to_frame_are_bounded(activity, largest_m):
    """Walking and standing differ by up to 0.7 m at 0.5 s; the decision takes several frames."""
    for k in (6, 7):  # of 14 people those with the largest revisions
        assert revisions_m(load(f"subject{k:02d}_{activity}")).max() < largest_m


def test_after_a_walk_and_a_sudden_stop_the_forecast_has_no_steady_state_error():
    """On a circle about the robot, then motionless: the running means still contain the walk."""
    rng, walker, errors_m = np.random.default_rng(0), Walker(), []
    for time_s in np.arange(0.0, 8.0, 1 / 30):
        angle_rad = np.radians(20.0) * min(time_s, 4.0)
        at_m = np.array([2.0 * np.cos(angle_rad), 2.0 * np.sin(angle_rad), 0.35])
        walker.update(HeadObservation(time_s, at_m + 0.003 * rng.standard_normal(3)))
        errors_m.append(walker.forecast([time_s + 0.5]).means_base_m[0] - at_m)
    assert np.linalg.norm(np.mean(errors_m[180:], axis=0)) < 0.0035


def test_a_higher_threshold_delays_the_response_to_a_start():
    """Logits are compared with the threshold of the model; at very high ones the person is never forecast to walk."""
    shipped = shipped_walker_model()
    observations = [s.observation for s in observe(load("subject03_start"), load_sensor("reference"), 0)]
    way_m = observations[-1].head_position_base_m - observations[0].head_position_base_m
    first_s = []
    for threshold in (-1.0, 2.0, 20.0):
        walker = Walker(dataclasses.replace(shipped, decision=(shipped.decision[0], threshold)))
        first_s.append(np.inf)
        for observation in observations:
            walker.update(observation)
            now_s = observation.capture_time_s
            lead = walker.forecast([now_s + 0.5]).means_base_m[0] - observation.head_position_base_m
            if now_s > 0.5 and lead @ way_m > 0.3 * np.linalg.norm(way_m):
                first_s[-1] = now_s
                break
    assert first_s[0] < first_s[1] < first_s[2] == np.inf


@pytest.mark.slow
def test_the_stated_ellipsoids_have_nominal_coverage():
    """68 and 95 % by the t distribution that is stated."""
    nees = np.concatenate([errors(load(name), Walker(), "face_camera")[1][:, 0] for name in SYNTHETIC[1::2]])
    v, shares = shipped_walker_model().degrees_of_freedom, np.array([0.68, 0.95])
    held = np.mean(nees[np.isfinite(nees)][:, None] <= 3.0 * f_distribution.ppf(shares, 3, v) * (v - 2.0) / v, axis=0)
    np.testing.assert_array_less(np.abs(held - shares), MISSED)


def test_initial_range_errors_stay_on_the_line_of_sight():
    """A face above the camera with 5 % range error: in the first second, errors stay on the line of sight."""
    elevation_rad = np.radians(22.0)
    face_m = 1.5 * np.array([np.cos(elevation_rad), 0.0, np.sin(elevation_rad)])
    off_rad = []
    for seed in range(5):
        rng, walker = np.random.default_rng(seed), Walker()
        for k in range(30):
            seen_m = face_m * (1.0 + 0.05 * rng.standard_normal())
            stated = bearing_covariance(seen_m, bearing_sd_rad=0.0014, range_sd_m=0.075)
            walker.update(HeadObservation(k / 30, seen_m, position_covariance_m2=stated))
            x, y, z = walker.forecast([k / 30 + 0.35]).means_base_m[0]
            off_rad.append(abs(np.arctan2(z, np.hypot(x, y)) - elevation_rad))
    assert np.degrees(max(off_rad)) < 1.6


def test_a_mounting_at_90_deg_is_estimated():
    """Orientations with a rotated forward axis: after half a second the effect is small."""
    turn = Rotation.from_euler("z", 90.0, degrees=True)

    def mounted(q):
        return (Rotation.from_quat(q, scalar_first=True) * turn).as_quat(scalar_first=True)

    recording = load("subject08_R1")
    quats = {f"{part}_quat_wxyz": getattr(recording.truth, f"{part}_quat_wxyz") for part in ("head", "pelvis")}
    turned = dataclasses.replace(recording.truth, **{name: mounted(q) for name, q in quats.items()})
    wrong, plain = (
        np.nanmean(errors(each, Walker())[0][10:])
        for each in (dataclasses.replace(recording, truth=turned, measured=None), recording)
    )
    assert wrong < 1.5 * plain


@pytest.mark.slow
@pytest.mark.parametrize(("sensor", "ratios"), REAL_RATIOS.items())
def test_real_walkers_are_forecast_far_better_than_by_constant_velocity(walks_dir, sensor, ratios):
    recordings = [load(path) for path in find_recordings([str(walks_dir)])[::16]]
    ours, plain = (mean_errors(recordings, make, sensor, AHEAD_S) for make in (Walker, ConstantVelocity))
    np.testing.assert_array_less(ours / plain, ratios)


# ---------------------------------------------------------------- robustness


TIMES_S = np.array([-0.1, 0.0, 0.5, 3.0])
steps = st.sampled_from([1e-9, 1e-6, 1e-3, 1 / 120, 1 / 30, 0.3, 3.0, 1e4])
exponents = st.floats(-3.0, 2.0)  # of standard deviations: variances from 1e-6 to 1e4 m^2


def assert_sound(walker, now_s):
    forecast = walker.forecast(now_s + TIMES_S)
    P = forecast.covariances_m2
    assert np.all(np.isfinite(forecast.means_base_m))
    assert np.all(np.isfinite(P))
    np.testing.assert_allclose(P, np.swapaxes(P, 1, 2), rtol=1e-9)
    assert np.linalg.eigvalsh(P).min() > 0.0


@settings(max_examples=20)
@given(steps_s=st.lists(steps, min_size=1, max_size=60), speed_m_s=st.floats(0.0, 5.0), seed=st.integers(0, 1000))
def test_forecasts_are_finite_for_any_time_stamps(steps_s, speed_m_s, seed):
    """Bursts a nanosecond apart, gaps of hours, orientations that come and go."""
    rng, walker, time_s = np.random.default_rng(seed), Walker(random_model()), 0.0
    for step_s in steps_s:
        time_s += step_s
        quats = [yaw_quat(rng.uniform(-7, 7)) if rng.random() < 0.6 else None for _ in range(2)]
        position = np.array([speed_m_s * time_s, 0.0, 0.4]) + 0.02 * rng.standard_normal(3)
        walker.update(HeadObservation(time_s, position, *quats))
        assert_sound(walker, time_s)


@settings(max_examples=15)
@given(
    sizes=st.lists(st.tuples(exponents, exponents, exponents), min_size=2, max_size=40),
    stated=st.lists(st.booleans(), min_size=40, max_size=40),
    turns=st.booleans(),
    seed=st.integers(0, 1000),
)
@example(sizes=[(2.0, -3.0, -3.0)] * 40, stated=[True] * 40, turns=True, seed=1)
@example(sizes=[(2.5, 2.5, -3.0)] * 40, stated=[True] * 40, turns=True, seed=2)
def test_forecasts_are_valid_for_any_covariance(sizes, stated, turns, seed):
    """From 1 mm to 100 m, with random or constant axes, sometimes absent."""
    rng, walker = np.random.default_rng(seed), Walker(random_model())
    for k, exponent in enumerate(sizes):
        covariance = random_covariance(rng if turns else np.random.default_rng(seed), 10.0 ** np.array(exponent))
        position = np.array([1.2 * k / 30, 0.0, 0.4]) + 0.02 * rng.standard_normal(3)
        covariance_m2 = covariance if stated[k] else None
        walker.update(HeadObservation(k / 30, position, None, yaw_quat(0.1), position_covariance_m2=covariance_m2))
        assert_sound(walker, k / 30)


@pytest.mark.parametrize("covariance", [None, np.diag([1e4, 1e-6, 1e-6])])
@pytest.mark.parametrize("rate_hz", [2.5, 30.0])
def test_a_motionless_person_is_forecast_in_place(covariance, rate_hz):
    """A person without sway, or a tracker that repeats one position."""
    walker, at = Walker(random_model()), np.array([2.0, -1.0, 0.3])
    for k in range(100):
        walker.update(HeadObservation(k / rate_hz, at, yaw_quat(0.4), yaw_quat(0.4), position_covariance_m2=covariance))
        assert_sound(walker, k / rate_hz)
    np.testing.assert_allclose(walker.forecast(99 / rate_hz + TIMES_S).means_base_m, np.tile(at, (4, 1)), atol=1e-6)


def blind(observation):
    return dataclasses.replace(observation, head_quat_wxyz=None, pelvis_quat_wxyz=None)


def test_a_jump_of_half_a_metre_is_refused():
    observations = seen_of("subject01_R2")[:100]
    clean, _ = forecasts(observations)
    for k in (20, 40, 60):
        o = observations[k]
        observations[k] = dataclasses.replace(o, head_position_base_m=o.head_position_base_m + 0.5 * np.eye(3)[0])
    shaken, _ = forecasts(observations)
    # Afterwards the forecast equals that with missing frames.
    assert np.max(np.linalg.norm(shaken[62:, 3] - clean[62:, 3], axis=1)) < 0.06


@pytest.mark.parametrize("seed", range(4))
def test_errors_of_a_tracks_first_frames_are_no_start(seed):
    """A standing person whose first 0.1 s drift by 7 cm: no forecast at 0.5 s is 0.3 m away, as a false start is."""
    rng, walker = np.random.default_rng(seed), Walker()
    for k in range(30):
        at_m = np.array([2.5, 0.5 + 0.07 * min(k / 3, 1.0), 0.4]) + 0.005 * rng.standard_normal(3)
        walker.update(HeadObservation(k / 30, at_m))
        assert k == 0 or np.linalg.norm(walker.forecast([k / 30 + 0.5]).means_base_m[0] - at_m) < 0.3


def test_a_gap_is_coasted_with_growing_variance_until_recovery():
    """The track is extrapolated; afterwards the forecast converges to that without a gap."""
    observations, gap_s = seen_of("subject06_R1"), 1.0
    whole, _ = forecasts(observations)
    begin_s = observations[45].capture_time_s
    kept = [o for o in observations if not begin_s < o.capture_time_s <= begin_s + gap_s]
    walker = Walker()
    for o in kept[:46]:
        walker.update(o)
    assert kept[45].capture_time_s == begin_s
    inside = walker.forecast(begin_s + np.linspace(0.0, gap_s + 1.0, 20))
    assert np.all(np.diff(np.trace(inside.covariances_m2, axis1=1, axis2=2)) >= -1e-12)
    truth = TrueHead(load("subject06_R1"))
    assert np.linalg.norm(inside.means_base_m[0] - truth([begin_s])[0]) < 0.05
    found = []
    for o in kept[46:]:
        walker.update(o)
        found.append(walker.forecast([o.capture_time_s + 0.5]).means_base_m[0])
    late = min(20, len(found) - 1)
    assert np.linalg.norm(np.array(found)[late:] - whole[-len(found) :][late:, 3], axis=1).max() < 0.1


def test_a_lost_orientation_fades_without_a_jump():
    """No orientation from one frame on: forecasts deviate gradually from those with it."""
    observations = seen_of("subject03_R5", "perfect")[:110]
    turn = len(observations) // 2
    half = [o if k < turn else blind(o) for k, o in enumerate(observations)]
    with_it, without = forecasts(observations)[0][:, 3], forecasts(half)[0][:, 3]
    apart = np.linalg.norm(with_it - without, axis=1)
    assert np.all(apart[:turn] == 0.0)
    assert apart[turn] < 0.05
    never = forecasts([blind(o) for o in observations])
    np.testing.assert_allclose(without[turn + 40 :], never[0][turn + 40 :, 3], atol=0.03)


def test_a_regained_orientation_gives_the_forecast_without_loss():
    """For any robot pose; held orientations must not appear as a turn of the body."""
    observations = [moved(o, 2.0, np.zeros(3)) for o in seen_of("subject03_R6", "perfect")[:90]]
    gone = [blind(o) if 30 <= k < 60 else o for k, o in enumerate(observations)]
    apart = np.linalg.norm(forecasts(gone)[0][:, 3] - forecasts(observations)[0][:, 3], axis=1)
    assert np.max(apart[63:90]) < 0.12
    assert np.mean(apart[70:90]) < 0.04


def direction_errors_deg(stated, range_share):
    """Of forecasts 0.5 s ahead of a passing real gait; range with a relative bias and 12 % noise."""
    truth, rng, walker, errors = TrueHead(load("subject08_R1")), np.random.default_rng(0), Walker(), []
    for time_s in np.arange(0.0, 3.0, 1 / 30):
        true_m = truth([time_s])[0]
        seen_m = true_m * (1.0 + range_share) * (1.0 + 0.12 * rng.standard_normal())
        seen_m = seen_m + 0.002 * np.linalg.norm(seen_m) * rng.standard_normal(3)
        covariance = bearing_covariance(seen_m, 0.002, 0.5) if stated else None
        walker.update(HeadObservation(time_s, seen_m, position_covariance_m2=covariance))
        forecast_m, then_m = walker.forecast([time_s + 0.5]).means_base_m[0], truth([time_s + 0.5])[0]
        cosine = forecast_m @ then_m / np.linalg.norm(forecast_m) / np.linalg.norm(then_m)
        errors.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return np.array(errors[30:])


def test_a_range_error_of_20_percent_keeps_the_bearing():
    """With a stated covariance elongated along the line of sight the bearing dominates."""
    stated, right = direction_errors_deg(True, -0.2), direction_errors_deg(True, 0.0)
    assert np.sqrt(np.mean(stated**2)) < 2.5
    assert np.sqrt(np.mean(stated**2)) < 1.3 * np.sqrt(np.mean(right**2)) + 0.2
    # Without a stated covariance the measured one does as well, within the chance of one walk.
    assert np.sqrt(np.mean(stated**2)) < 1.1 * np.sqrt(np.mean(direction_errors_deg(False, -0.2) ** 2))
