"""Observations of walking people, and models of `Walker` without a fit."""

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.recordings.load import load
from gazempc.sim.sensor import load_sensor, observe
from predictors import HeadObservation, Walker
from predictors.walker.features import N_INPUTS
from predictors.walker.knots import KNOTS_S
from predictors.walker.network import N_DOUBT, N_OUTPUTS, WALKS, Network, WalkerModel

# Network layers with zero departure and the regime walking for all people.
_WALKING = np.zeros(N_OUTPUTS, dtype=np.float32)
_WALKING[WALKS] = 100.0
NOTHING = Network((np.zeros((N_INPUTS, N_OUTPUTS), dtype=np.float32),), (_WALKING,))
AHEAD_S = np.array([0.0, 0.1, 0.25, 0.5, 1.0, 1.4])


@cache
def random_model(seed=0, size=0.1, degrees_of_freedom=5.0):
    """Random weights, for properties that hold for any weights."""
    rng = np.random.default_rng(seed)
    sizes = ((N_INPUTS, 7), (7, 7), (7, N_OUTPUTS))

    def layers():
        weights = tuple(size * rng.standard_normal(shape).astype(np.float32) for shape in sizes)
        biases = tuple(size * rng.standard_normal(shape[1]).astype(np.float32) for shape in sizes)
        return Network(weights, biases)

    networks = layers(), layers()
    log_spread = 0.1 * size * rng.standard_normal((N_DOUBT, KNOTS_S.size, 3))
    log_spread[0] = np.log(0.05) + np.linspace(0.0, 1.0, KNOTS_S.size)[:, None]
    noise_share = np.linspace(0.5, 0.8, KNOTS_S.size)
    hidden, log_spread_hidden = (size * rng.standard_normal(shape) for shape in ((N_DOUBT, 5), (5, KNOTS_S.size, 3)))
    return WalkerModel(
        *networks, log_spread, hidden, log_spread_hidden, noise_share, degrees_of_freedom=degrees_of_freedom
    )


def straight_model(spread_m=0.1, degrees_of_freedom=5.0, stated_share=0.0):
    """A model with zero departure from the line and the same spread at all horizons.

    The scale is `spread_m` plus a share of the observations' stated error.
    """
    log_spread = np.zeros((N_DOUBT, KNOTS_S.size, 3))
    log_spread[0] = np.log(spread_m)
    return WalkerModel(
        *2 * (NOTHING,),
        log_spread,
        noise_share=np.full(KNOTS_S.size, stated_share),
        degrees_of_freedom=degrees_of_freedom,
    )


def seen_of(name, sensor="reference", seed=0):
    """Observations of a recording by a sensor."""
    return [s.observation for s in observe(load(name), load_sensor(sensor), seed)]


def moved(observation, angle_rad, shift_m, mirror=False):
    """The same sighting by a robot at another pose; with `mirror`, of the mirrored person."""
    side = np.diag([1.0, -1.0 if mirror else 1.0, 1.0])
    turn = Rotation.from_euler("z", angle_rad)
    change = turn.as_matrix() @ side

    def quat(q):
        if q is None:
            return None
        w, x, y, z = q
        return (turn * Rotation.from_quat([-x, y, -z, w] if mirror else [x, y, z, w])).as_quat(scalar_first=True)

    covariance = observation.position_covariance_m2
    return HeadObservation(
        observation.capture_time_s,
        change @ observation.head_position_base_m + shift_m,
        quat(observation.head_quat_wxyz),
        quat(observation.pelvis_quat_wxyz),
        None if covariance is None else change @ covariance @ change.T,
    )


def forecasts(observations, ahead_s=AHEAD_S, walker=None):
    """Means and covariances after each observation."""
    walker = walker or Walker()
    found = []
    for observation in observations:
        walker.update(observation)
        found.append(walker.forecast(observation.capture_time_s + ahead_s))
    return np.array([f.means_base_m for f in found]), np.array([f.covariances_m2 for f in found])


def random_covariance(rng, sds_m):
    """A covariance with random principal axes."""
    # Four normal numbers give uniform rotations; SciPy's random rotations differ between versions.
    turn = Rotation.from_quat(rng.standard_normal(4)).as_matrix()
    covariance = turn @ np.diag(np.square(sds_m)) @ turn.T
    return 0.5 * (covariance + covariance.T)
