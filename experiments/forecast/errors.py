"""Forecast errors of a predictor on one recording, frame by frame, as a job: the view of the sensor, and the truth."""

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
from gazempc.recordings.recording import Recording
from gazempc.recordings.truth import TrueHead, stretches
from gazempc.settings import PredictorSettings
from gazempc.sim.scene import SceneSettings, natural_placement
from gazempc.sim.sensor import SensorSpec, default_sensor, observe
from gazempc.types import FloatArray, Sighting
from predictors import ConstantVelocity, HeadObservation, Predictor, Walker

_SCENE = SceneSettings()


def placed_for(recording: Recording, sensor: SensorSpec) -> Recording:
    """A recording in the frame in which a sensor sees it.

    Where nothing depends on the robot's place, the recording's own frame serves: errors are then the same everywhere.
    Otherwise the robot stands at the default place of a replay: where the recording's sensor stood, or
    2.5 m beside the walk.

    Args:
        recording: The recording, in its own frame.
        sensor: The sensor.

    Returns:
        The recording, in the base frame if that matters.

    Raises:
        PlacementError: If the head comes too near to the robot.
    """
    if not sensor.depends_on_place:
        return recording
    return place(recording, natural_placement(recording), _SCENE.distance_m, _SCENE.height_m)


def in_order(recording: Recording, sensor: SensorSpec, seed: int) -> list[Sighting]:
    """What a predictor gets: as in the loop, a frame that was overtaken by a newer one is dropped.

    Args:
        recording: The recording, as `placed_for` gives it.
        sensor: The sensor.
        seed: Seed of its errors.

    Returns:
        The sightings in order of capture.
    """
    newer: list[Sighting] = []
    for sighting in observe(recording, sensor, seed):
        if not newer or sighting.observation.capture_time_s > newer[-1].observation.capture_time_s:
            newer.append(sighting)
    return newer


def smooth_truth(recording: Recording, over_s: float) -> Recording:
    """Smooth the true head's path by a centred moving average in time, which does not lag.

    Between frames the track is taken to be straight. Towards an end of the track, or a gap of more than 0.2 s, the
    window becomes narrower on both sides, so that steady motion stays as it is.

    Args:
        recording: The recording; its truth is a tracker's, with the errors of that.
        over_s: Length of the window, seconds; 0 for no smoothing.

    Returns:
        The recording with the smooth truth. What a tracker measured of it is the track before, unless the recording has
        such a track of its own.
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
    """How the predictors see the walks.

    Attributes:
        sensors: Sensor by name: the one that was chosen, or each that a recording may call for.
        sensor: Name of the chosen one; None for the one that fits each recording.
        seed: Seed of the sensor's noise.
        truth_smoothing_s: Over what time the truth is smoothed for scoring; the predictors see it as it is. With it,
            the track as it was recorded is the sensor that fits.
    """

    sensors: Mapping[str, SensorSpec]
    sensor: str | None
    seed: int
    truth_smoothing_s: float

    @property
    def sensor_name(self) -> str | None:
        """The name that the chosen sensor gives itself; None if none is chosen."""
        return None if self.sensor is None else self.sensors[self.sensor].name

    def of(self, recording: Recording) -> tuple[Recording, SensorSpec, TrueHead]:
        """A recording as it is seen.

        Args:
            recording: The recording, in its own frame.

        Returns:
            What the sensor sees, in the frame in which it does; the sensor; what forecasts are compared with.

        Raises:
            PlacementError: If the head comes too near to a robot whose place matters.
        """
        fits = "recorded" if self.truth_smoothing_s else default_sensor(recording)
        sensor = self.sensors[self.sensor or fits]
        placed = placed_for(recording, sensor)
        smooth = smooth_truth(placed, self.truth_smoothing_s)
        return replace(placed, measured=smooth.measured), sensor, TrueHead(smooth)


Cues = Literal["both", "head", "pelvis", "none"]

# A filter has converged after half a second; earlier frames would measure its start.
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
    observations = [_shown(each.observation, cues) for each in in_order(recording, sensor, seed)]
    found, update_us = [], []
    for observation in observations:
        capture_s = observation.capture_time_s
        reference.update(observation)
        started = time.perf_counter()
        predictor.update(observation)
        update_us.append(1e6 * (time.perf_counter() - started))
        forecast = predictor.forecast(capture_s + horizons_s)
        stated = forecast.means_base_m, forecast.covariances_m2, forecast.degrees_of_freedom
        found.append((capture_s, reference.state()[1][:3], *stated))
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
    level = np.einsum("fhi,fki->fhk", difference_m[..., :2], np.stack([direction, across], axis=1))
    return np.concatenate([level, difference_m[..., 2:]], axis=-1)


def _nees(difference_m: FloatArray, covariance_m2: FloatArray) -> FloatArray:
    nees = np.full(difference_m.shape[:2], np.nan)
    stated = np.linalg.det(covariance_m2) > 0
    solved = np.linalg.solve(covariance_m2[stated], difference_m[stated][..., None])[..., 0]
    nees[stated] = np.sum(difference_m[stated] * solved, axis=-1)
    return nees


@dataclass(frozen=True)
class ForecastJob:
    """All that the errors depend on.

    Attributes:
        recording: Synthetic name or path.
        predictor: A shipped name or ``module:Class``.
        cues: Which orientations it is shown.
        horizons_s: Horizons from capture, seconds.
        view: How it sees the walk.
        settings: Parameters of the shipped predictors.
        options: Parameters of the user's own.
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
        """Labels, the predictor's name, whether it was fitted on this person, and arrays of `ForecastErrors`."""
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
