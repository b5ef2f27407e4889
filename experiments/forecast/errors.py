"""Forecast errors of a predictor on one recording, frame by frame, as a job; observations and ground truth."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.interpolate import make_interp_spline

from experiments.engine.job import Row, key_of, models_hash, parts_hash, recording_hash
from experiments.engine.replays import load_once
from gazempc.loop.build import Person, make_predictor
from gazempc.parts import PREDICTOR, name_of
from gazempc.recordings.placement import place
from gazempc.recordings.recording import Recording, TrueHead, stretches
from gazempc.settings import PredictorSettings
from gazempc.sim.scene import SceneSettings, natural_placement
from gazempc.sim.sensor import SensorSpec, default_sensor, observe
from gazempc.types import FloatArray, Sighting
from predictors import ConstantVelocity, HeadObservation, Predictor, Walker

_SCENE = SceneSettings()


def placed_for(recording: Recording, sensor: SensorSpec) -> Recording:
    """Transform a recording into the frame of a sensor's observations.

    The recording's own frame if the sensor's errors are independent of the robot's position; otherwise the base frame
    of a robot at the default position of a replay: at the recording's sensor, or 2.5 m beside the walk.

    Args:
        recording: The recording, in its own frame.
        sensor: The sensor.

    Returns:
        The recording, in the base frame if the errors depend on it.

    Raises:
        PlacementError: If the head comes too near to the robot.
    """
    if not sensor.depends_on_place:
        return recording
    return place(recording, natural_placement(recording), _SCENE.distance_m, _SCENE.height_m)


def in_order(recording: Recording, sensor: SensorSpec, seed: int) -> list[Sighting]:
    """Observations of a predictor: as in the loop, frames that arrive after a newer one are dropped.

    Args:
        recording: The recording, from `placed_for`.
        sensor: The sensor.
        seed: Seed of the sensor's errors.

    Returns:
        The sightings in order of capture.
    """
    newer: list[Sighting] = []
    for sighting in observe(recording, sensor, seed):
        if not newer or sighting.observation.capture_time_s > newer[-1].observation.capture_time_s:
            newer.append(sighting)
    return newer


def smooth_truth(recording: Recording, over_s: float) -> Recording:
    """Smooth the true head's path by a centred moving average, which has zero phase.

    The track is linear between frames. Towards an end of the track, or a gap of more than 0.2 s, the window shrinks
    symmetrically, so that constant velocity is preserved.

    Args:
        recording: The recording, whose truth has the errors of a tracker.
        over_s: Length of the window, seconds; 0 for no smoothing.

    Returns:
        The recording with smoothed truth; the unsmoothed track becomes the measured one, if the recording has none.
    """
    if over_s == 0.0:
        return recording
    track = recording.truth
    position_m = track.head_position_m.copy()
    for rows in stretches(recording):
        position_m[rows] = _averaged(recording.times_s[rows], position_m[rows], over_s)
    return replace(recording, truth=replace(track, head_position_m=position_m), measured=recording.measured or track)


def _averaged(times_s: FloatArray, position_m: FloatArray, over_s: float) -> FloatArray:
    half_s = np.minimum(0.5 * over_s, np.minimum(times_s - times_s[0], times_s[-1] - times_s))
    wide = half_s > 0.0
    averaged = position_m.copy()
    if wide.any():
        area = make_interp_spline(times_s, position_m, k=1).antiderivative()
        around = area(times_s[wide] + half_s[wide]) - area(times_s[wide] - half_s[wide])
        averaged[wide] = around / (2.0 * half_s[wide, None])
    return averaged


@dataclass(frozen=True)
class ClipView:
    """Sensor and ground truth of an evaluation.

    Attributes:
        sensors: Sensor by name: the chosen one, or all defaults.
        sensor: Name of the chosen one; None for each recording's default.
        seed: Seed of the sensor's noise.
        truth_smoothing_s: Window over which the truth is smoothed for scoring only; if positive, the recorded track is
            the default sensor.
    """

    sensors: Mapping[str, SensorSpec]
    sensor: str | None
    seed: int
    truth_smoothing_s: float

    @property
    def sensor_name(self) -> str | None:
        """Name in the chosen sensor's file; None if none is chosen."""
        return None if self.sensor is None else self.sensors[self.sensor].name

    def of(self, recording: Recording) -> tuple[Recording, SensorSpec, TrueHead]:
        """Observed recording, sensor and ground truth.

        Args:
            recording: The recording, in its own frame.

        Returns:
            The recording in the sensor's frame; the sensor; the true head.

        Raises:
            PlacementError: If the head comes too near to the robot.
        """
        fits = "recorded" if self.truth_smoothing_s else default_sensor(recording)
        sensor = self.sensors[self.sensor or fits]
        placed = placed_for(recording, sensor)
        smooth = smooth_truth(placed, self.truth_smoothing_s)
        return replace(placed, measured=smooth.measured), sensor, TrueHead(smooth)


Cues = Literal["both", "head", "pelvis", "none"]

# Convergence time of the filters, excluded from the scores.
RUN_IN_S = 0.5


@dataclass(frozen=True)
class ForecastErrors:
    """Errors after each scored frame at each horizon; NaN without a true head.

    Attributes:
        horizons_s: Shape (H,), seconds from capture.
        difference_m: Forecast minus true position, shape (F, H, 3), metres: along the travel direction at capture,
            across it (positive to the left), vertical.
        error_filtered_m: Distance of the forecast from the filtered position at that time, shape (F, H), metres.
        nees: Normalised estimation error squared, shape (F, H); NaN for a singular covariance.
        degrees_of_freedom: Degrees of freedom of each forecast's errors, shape (F,); infinite for normal errors.
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
    """Run a predictor on a recording and compare its forecasts with the true path.

    The filtered position, common to all predictors, is that of `ConstantVelocity` at its default settings on the same
    observations, linearly interpolated between frames.

    Args:
        recording: The recording, in the sensor's frame.
        predictor: The predictor; reset first.
        sensor: The sensor.
        horizons_s: Horizons from capture, shape (H,), seconds.
        seed: Seed of the sensor's noise.
        cues: Orientations in the observations.
        true_head: Ground truth; default: the recording's.

    Returns:
        The errors of all frames captured at least half a second after the first one.
    """
    predictor.reset()
    reference = ConstantVelocity()
    true_head = true_head or TrueHead(recording)
    observations = [_with_cues(each.observation, cues) for each in in_order(recording, sensor, seed)]
    found, update_us = [], []
    for observation in observations:
        capture_s = observation.capture_time_s
        reference.update(observation)
        started = time.perf_counter()
        predictor.update(observation)
        update_us.append(1e6 * (time.perf_counter() - started))
        forecast = predictor.forecast(capture_s + horizons_s)
        outputs = forecast.means_base_m, forecast.covariances_m2, forecast.degrees_of_freedom
        found.append((capture_s, reference.state()[1][:3], *outputs))
    captures_s, positions, means, covariances, freedom = (np.array(column) for column in zip(*found, strict=True))
    scored = captures_s >= captures_s[0] + RUN_IN_S - 1e-9
    ahead_s = captures_s[scored, None] + horizons_s
    mean = means[scored]
    unknown = ~true_head.known(ahead_s)

    difference = mean - true_head(ahead_s)
    filtered_ahead = np.stack([np.interp(ahead_s, captures_s, positions[:, i]) for i in range(3)], axis=-1)
    error_filtered = np.linalg.norm(mean - filtered_ahead, axis=-1)
    error_filtered[unknown | (ahead_s > captures_s[-1] + 1e-6)] = np.nan
    nees = _nees(difference, covariances[scored])
    parts = _along_across_up(difference, true_head, captures_s[scored])
    for values in (parts, nees):
        values[unknown] = np.nan
    return ForecastErrors(horizons_s, parts, error_filtered, nees, freedom[scored], np.array(update_us))


def _with_cues(observation: HeadObservation, cues: Cues) -> HeadObservation:
    return replace(
        observation,
        head_quat_wxyz=observation.head_quat_wxyz if cues in {"both", "head"} else None,
        pelvis_quat_wxyz=observation.pelvis_quat_wxyz if cues in {"both", "pelvis"} else None,
    )


def _along_across_up(difference_m: FloatArray, true_head: TrueHead, capture_s: FloatArray) -> FloatArray:
    travelled = true_head(capture_s + 0.05)[:, :2] - true_head(capture_s - 0.05)[:, :2]
    length = np.linalg.norm(travelled, axis=1, keepdims=True)
    # The direction of travel is undefined at rest; x by convention.
    direction = np.where(length > 1e-6, travelled / np.maximum(length, 1e-6), [1.0, 0.0])
    across = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    level = np.einsum("fhi,fki->fhk", difference_m[..., :2], np.stack([direction, across], axis=1))
    return np.concatenate([level, difference_m[..., 2:]], axis=-1)


def _nees(difference_m: FloatArray, covariance_m2: FloatArray) -> FloatArray:
    nees = np.full(difference_m.shape[:2], np.nan)
    regular = np.linalg.det(covariance_m2) > 0
    solved = np.linalg.solve(covariance_m2[regular], difference_m[regular][..., None])[..., 0]
    nees[regular] = np.sum(difference_m[regular] * solved, axis=-1)
    return nees


@dataclass(frozen=True)
class ForecastJob:
    """Inputs of an evaluation.

    Attributes:
        recording: Synthetic name or path.
        predictor: A shipped name or ``module:Class``.
        cues: Orientations in the observations.
        horizons_s: Horizons from capture, seconds.
        view: Sensor and ground truth.
        settings: Parameters of the shipped predictors.
        options: Parameters of custom predictors.
    """

    recording: str
    predictor: str
    cues: Cues
    horizons_s: tuple[float, ...]
    view: ClipView
    settings: PredictorSettings
    options: Mapping[str, Any]

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        fitted = self.settings.walker.fitted if self.predictor == "walker" else None
        return key_of(
            self,
            recording=recording_hash(self.recording),
            models=models_hash(fitted),
            parts=parts_hash("", self.predictor),
        )

    def run(self) -> Row:
        """Labels, the predictor's name, whether the person is in its training set, and arrays of `ForecastErrors`."""
        recording, sensor, true_head = self.view.of(load_once(self.recording))
        subject = recording.labels.subject
        predictor = make_predictor(self.predictor, self.settings, Person(subject, true_head), dict(self.options))
        horizons_s = np.array(self.horizons_s)
        errors = forecast_errors(recording, predictor, sensor, horizons_s, self.view.seed, self.cues, true_head)
        return {
            "sensor": sensor.name,
            "data_kind": recording.kind,
            "subject": subject,
            "group": recording.labels.group or "unknown",
            "kind": recording.labels.activity,
            "seen": isinstance(predictor, Walker) and subject in predictor.fitted_on(),
            "predictor_name": name_of(PREDICTOR, predictor),
            **vars(errors),
        }
