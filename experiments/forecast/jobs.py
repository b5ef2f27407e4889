"""Forecast errors of one predictor on one recording as a job."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from experiments.engine.job import Row
from experiments.engine.keys import key_of, models_hash, recording_hash
from experiments.engine.own_parts import parts_hash
from experiments.engine.replays import load_once
from experiments.forecast.errors import Cues, ForecastErrors, forecast_errors
from experiments.forecast.glance import turn_head
from experiments.forecast.placing import placed_for
from experiments.forecast.smoothing import smooth_truth
from experiments.forecast.summary import ClipResult
from gazempc.loop.build import Person, make_predictor
from gazempc.parts import PREDICTOR, name_of
from gazempc.recordings.recording import Recording
from gazempc.recordings.truth import TrueHead
from gazempc.settings import PredictorSettings
from gazempc.sim.sensor import SensorSpec, default_sensor
from predictors import Walker


class Seen(NamedTuple):
    """A recording as predictors see it.

    Attributes:
        recording: What the sensor sees, in the frame in which it does.
        sensor: The sensor.
        true_head: What forecasts are compared with.
    """

    recording: Recording
    sensor: SensorSpec
    true_head: TrueHead


@dataclass(frozen=True)
class ClipView:
    """How the predictors see the walks.

    Attributes:
        sensors: Sensor by name: the one that was chosen, or each that a recording may call for.
        sensor: Name of the chosen one; None for the one that fits each recording.
        seed: Seed of the sensor's noise.
        truth_smoothing_s: Over what time the truth is smoothed for scoring; the predictors see it as it is. With it,
            the track as it was recorded is the sensor that fits.
        glance_deg: How far the head is turned aside, see `experiments.forecast.glance.turn_head`.
        glance_from_s: When that begins, seconds after the first frame.
    """

    sensors: Mapping[str, SensorSpec]
    sensor: str | None
    seed: int
    truth_smoothing_s: float
    glance_deg: float
    glance_from_s: float

    @property
    def sensor_name(self) -> str | None:
        """The name that the chosen sensor gives itself; None if none is chosen."""
        return None if self.sensor is None else self.sensors[self.sensor].name

    def of(self, recording: Recording) -> Seen:
        """A recording as it is seen.

        Args:
            recording: The recording, in its own frame.

        Returns:
            What is seen, by what, and the truth behind it.

        Raises:
            PlacementError: If the head comes too near to a robot whose place matters.
        """
        fits = "recorded" if self.truth_smoothing_s else default_sensor(recording)
        sensor = self.sensors[self.sensor or fits]
        looking = placed_for(turn_head(recording, self.glance_deg, self.glance_from_s), sensor)
        smooth = smooth_truth(looking, self.truth_smoothing_s)
        return Seen(replace(looking, measured=smooth.measured), sensor, TrueHead(smooth))


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
        own = getattr(self.settings, self.predictor, self.settings.constant_velocity)
        content = {
            "recording": recording_hash(self.recording),
            "predictor": [self.predictor, self.cues, dict(self.options)],
            # `last_position` uses settings of the filter, too.
            "settings": [s.model_dump(mode="json", exclude={"fitted"}) for s in (own, self.settings.constant_velocity)],
            "models": models_hash(self.settings.walker.fitted) if self.predictor == "walker" else "",
            "horizons": self.horizons_s,
            "view": [
                self.view.sensor,
                self.view.seed,
                self.view.truth_smoothing_s,
                self.view.glance_deg,
                self.view.glance_from_s,
            ],
            "sensors": {name: sensor.model_dump(mode="json") for name, sensor in self.view.sensors.items()},
            "own parts": parts_hash("", self.predictor),
        }
        used = ("errors", "glance", "placing", "smoothing")
        return key_of(content, __name__, *(f"experiments.forecast.{name}" for name in used))

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


def clip_result(row: Row) -> ClipResult:
    """The errors from the result of a job.

    Args:
        row: The result, with the recording, the predictor's name and the cues under their names.

    Returns:
        The errors.
    """
    errors = ForecastErrors(**{field.name: row[field.name] for field in fields(ForecastErrors)})
    labels = {field.name: row[field.name] for field in fields(ClipResult) if field.name != "errors"}
    return ClipResult(**labels, errors=errors)
