"""The shipped `walker` on walks: how far it errs, through each sensor, and whether it knows how far.

Synthetic walks were not fitted on. Real ones were, so there the tests guard the code, not the claim.
"""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import f as f_distribution

from experiments.engine.command import find_recordings
from experiments.forecast.errors import forecast_errors
from gazempc.recordings.load import load
from gazempc.sim.sensor import load_sensor, observe
from predictors import ConstantVelocity, HeadObservation, LastPosition, Walker, bearing_covariance
from predictors.walker.model_file import shipped_walker_model

SYNTHETIC = [f"subject{k:02d}_R{k % 6 + 1}" for k in range(1, 15)]
AHEAD_S = np.array([0.25, 0.5, 1.0])


def errors(recording, predictor, sensor="reference", ahead_s=(0.5,)):
    """Distances of forecast and truth, and squared Mahalanobis distances, shape (N, horizons)."""
    found = forecast_errors(recording, predictor, load_sensor(sensor), np.array(ahead_s), 0)
    return np.linalg.norm(found.difference_m, axis=-1), found.nees


def mean_errors(recordings, make, sensor="reference", ahead_s=(0.5,)):
    return np.mean([np.nanmean(errors(r, make(), sensor, ahead_s)[0], axis=0) for r in recordings], axis=0)


def limits(shares):
    """Squared Mahalanobis distances that hold these shares of a t distribution with the model's tails."""
    v = shipped_walker_model().degrees_of_freedom
    return 3.0 * f_distribution.ppf(shares, 3, v) * (v - 2.0) / v


# Errors over those of constant velocity at 0.25, 0.5 and 1 s: what the model as it ships has, and up to 0.06 of room.
SYNTHETIC_RATIOS = {
    "reference": (0.54, 0.52, 0.54),
    "face_camera": (0.95, 0.88, 0.78),
}
# Goals on people left out are .53 .53 .60 and .70 .62 .65.
REAL_RATIOS = {"reference": (0.55, 0.53, 0.62), "body_tracker": (0.82, 0.74, 0.72)}
# Points by which 68 and 95 % may be missed on walks that are not those of the fit.
MISSED = (0.10, 0.04)


@pytest.mark.slow
@pytest.mark.parametrize(("sensor", "ratios"), SYNTHETIC_RATIOS.items())
def test_synthetic_walkers_are_forecast_better_than_by_constant_velocity(sensor, ratios):
    recordings = [load(name) for name in SYNTHETIC[::2]]
    ours, plain = (mean_errors(recordings, make, sensor, AHEAD_S) for make in (Walker, ConstantVelocity))
    np.testing.assert_array_less(ours / plain, ratios)


@pytest.mark.slow
@pytest.mark.parametrize(("activity", "sensor"), [("stand", "body_tracker"), ("turn_on_spot", "reference")])
def test_people_on_the_spot_are_forecast_as_well_as_by_their_last_position(activity, sensor):
    recordings = [load(f"subject{k:02d}_{activity}") for k in range(1, 15, 4)]
    ours, last = (mean_errors(recordings, make, sensor, AHEAD_S[:2]) for make in (Walker, LastPosition))
    np.testing.assert_array_less(ours / last, 1.1 if activity == "turn_on_spot" else 1.02)


def revisions_m(recording, ahead_s=0.5):
    """How far the forecast for one instant moves from frame to frame, metres."""
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


@pytest.mark.parametrize(("activity", "largest_m"), [("stand", 0.01), ("start", 0.1), ("stop", 0.1)])
def test_revisions_of_the_forecast_from_frame_to_frame_are_bounded(activity, largest_m):
    """Walking and staying lie up to 0.7 m apart at 0.5 s; a decision takes several frames."""
    assert revisions_m(load(f"subject07_{activity}")).max() < largest_m


def test_a_higher_threshold_answers_a_start_later():
    """Logits are compared with the threshold of the model; at very high ones the person is never forecast to walk."""
    shipped = shipped_walker_model()
    observations = [s.observation for s in observe(load("subject03_start"), load_sensor("reference"), 0)]
    first_s = []
    for threshold in (-1.0, 2.0, 20.0):
        walker = Walker(dataclasses.replace(shipped, decision=(shipped.decision[0], threshold)))
        first_s.append(np.inf)
        for observation in observations:
            walker.update(observation)
            now_s = observation.capture_time_s
            lead = walker.forecast([now_s + 0.5]).means_base_m[0] - observation.head_position_base_m
            if now_s > 0.5 and np.linalg.norm(lead[:2]) > 0.3:
                first_s[-1] = now_s
                break
    assert first_s[0] < first_s[1] < first_s[2] == np.inf


@pytest.mark.slow
def test_the_stated_ellipsoids_hold_their_shares():
    """68 and 95 % by the t distribution that is stated."""
    nees = np.concatenate([errors(load(name), Walker(), "face_camera")[1][:, 0] for name in SYNTHETIC])
    held = np.mean(nees[np.isfinite(nees)][:, None] <= limits([0.68, 0.95]), axis=0)
    np.testing.assert_array_less(np.abs(held - [0.68, 0.95]), MISSED)


def test_first_range_errors_do_not_lift_the_gaze_off_a_still_face():
    """A face above the camera, its range wrong by 5 %: in the first second, errors stay on the line of sight."""
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


def test_a_mounting_at_a_right_angle_is_found_out():
    """Orientations by a sensor whose forward axis is not the person's: half a second later it hardly matters."""
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
    recordings = [load(path) for path in find_recordings([str(walks_dir)])[::8]]
    ours, plain = (mean_errors(recordings, make, sensor, AHEAD_S) for make in (Walker, ConstantVelocity))
    np.testing.assert_array_less(ours / plain, ratios)
