"""Forecast errors of a predictor on one recording, frame by frame."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from experiments.forecast.view import observations_of
from gazempc.recordings.recording import Recording
from gazempc.recordings.truth import TrueHead
from gazempc.sim.sensor import SensorSpec
from gazempc.types import FloatArray
from predictors import ConstantVelocity, HeadObservation, Predictor

Cues = Literal["both", "head", "pelvis", "none"]

# A filter that has seen half a second knows the walk; earlier frames would measure its start.
RUN_IN_S = 0.5


@dataclass(frozen=True)
class ForecastErrors:
    """Errors after each scored frame at each horizon; NaN where the true head is not known by then.

    Attributes:
        horizons_s: Shape (H,), seconds from capture.
        difference_m: Forecast minus true position, shape (F, H, 3), metres: along the travel direction at capture,
            across it (positive to the left), vertical.
        error_filtered_m: Distance of the forecast from the filtered position at that time, shape (F, H), metres.
        nees: Normalised squared error under the forecast's covariance, shape (F, H); NaN where it has none.
        degrees_of_freedom: Those of each forecast's errors, shape (F,); infinite for normal ones.
        update_us: Time of each predictor update, shape (U,), microseconds.
    """

    horizons_s: FloatArray
    difference_m: FloatArray
    error_filtered_m: FloatArray
    nees: FloatArray
    degrees_of_freedom: FloatArray
    update_us: FloatArray


def forecast_errors(
    recording: Recording,
    predictor: Predictor,
    sensor: SensorSpec,
    horizons_s: FloatArray,
    seed: int,
    cues: Cues = "both",
    true_head: TrueHead | None = None,
) -> ForecastErrors:
    """Run a predictor over a recording and compare its forecasts with what came.

    The filtered position is that of `ConstantVelocity` at its default settings on the same observations, between frames
    linearly interpolated; it is the same for all predictors.

    Args:
        recording: The recording, in the frame in which the sensor sees it.
        predictor: The predictor; reset first.
        sensor: What it sees of the recording.
        horizons_s: Horizons from capture, shape (H,), seconds.
        seed: Seed of the sensor's noise.
        cues: Which orientations the predictor is shown.
        true_head: What the forecasts are compared with; without it the recording's own truth.

    Returns:
        The errors of all frames captured at least half a second after the first one.
    """
    predictor.reset()
    reference = ConstantVelocity()
    true_head = true_head or TrueHead(recording)
    observations = [_shown(observation, cues) for observation in observations_of(recording, sensor, seed)]
    captures, filtered, means, covariances, freedom, update_us = [], [], [], [], [], []
    for observation in observations:
        reference.update(observation)
        started = time.perf_counter()
        predictor.update(observation)
        update_us.append(1e6 * (time.perf_counter() - started))
        captures.append(observation.capture_time_s)
        filtered.append(reference.state()[1][:3])
        forecast = predictor.forecast(observation.capture_time_s + horizons_s)
        means.append(forecast.means_base_m)
        covariances.append(forecast.covariances_m2)
        freedom.append(forecast.degrees_of_freedom)
    capture_s = np.array(captures)
    scored = capture_s >= capture_s[0] + RUN_IN_S - 1e-9
    ahead_s = capture_s[scored, None] + horizons_s
    mean = np.array(means)[scored]
    unknown = ~true_head.known(ahead_s)

    difference = mean - true_head(ahead_s)
    positions = np.array(filtered)
    filtered_ahead = np.stack([np.interp(ahead_s, capture_s, positions[:, i]) for i in range(3)], axis=-1)
    error_filtered = np.linalg.norm(mean - filtered_ahead, axis=-1)
    error_filtered[unknown | (ahead_s > capture_s[-1] + 1e-6)] = np.nan
    nees = _nees(difference, np.array(covariances)[scored])
    parts = _along_across_up(difference, true_head, capture_s[scored])
    for values in (parts, nees):
        values[unknown] = np.nan
    return ForecastErrors(horizons_s, parts, error_filtered, nees, np.array(freedom)[scored], np.array(update_us))


def _shown(observation: HeadObservation, cues: Cues) -> HeadObservation:
    return replace(
        observation,
        head_quat_wxyz=observation.head_quat_wxyz if cues in {"both", "head"} else None,
        pelvis_quat_wxyz=observation.pelvis_quat_wxyz if cues in {"both", "pelvis"} else None,
    )


def _along_across_up(difference_m: FloatArray, true_head: TrueHead, capture_s: FloatArray) -> FloatArray:
    travelled = true_head(capture_s + 0.05)[:, :2] - true_head(capture_s - 0.05)[:, :2]
    length = np.linalg.norm(travelled, axis=1, keepdims=True)
    # Who stands has no direction of travel; x serves as well as any.
    direction = np.where(length > 1e-6, travelled / np.maximum(length, 1e-6), [1.0, 0.0])
    across = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    return np.stack(
        [
            np.einsum("fhi,fi->fh", difference_m[..., :2], direction),
            np.einsum("fhi,fi->fh", difference_m[..., :2], across),
            difference_m[..., 2],
        ],
        axis=-1,
    )


def _nees(difference_m: FloatArray, covariance_m2: FloatArray) -> FloatArray:
    nees = np.full(difference_m.shape[:2], np.nan)
    stated = np.linalg.det(covariance_m2) > 0
    solved = np.linalg.solve(covariance_m2[stated], difference_m[stated][..., None])[..., 0]
    nees[stated] = np.sum(difference_m[stated] * solved, axis=-1)
    return nees
