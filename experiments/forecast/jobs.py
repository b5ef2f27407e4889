"""Forecast errors of one predictor on one recording as a job."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.engine.job import Row
from experiments.engine.keys import key_of, models_hash, recording_hash
from experiments.engine.own_parts import parts_hash
from experiments.engine.replays import load_once
from experiments.forecast.errors import Cues, ForecastErrors, forecast_errors
from experiments.forecast.glance import turn_head
from experiments.forecast.placing import placed_for
from experiments.forecast.summary import ClipResult
from gazempc.loop.build import Person, make_predictor
from gazempc.parts import PREDICTOR, name_of
from gazempc.recordings.truth import TrueHead
from gazempc.settings import PredictorSettings
from gazempc.sim.sensor import SensorSpec, default_sensor
from predictors import Walker


@dataclass(frozen=True)
class View:
    """How the predictors see the walks.

    Attributes:
        sensors: Sensor by name: the one that was chosen, or each that a recording may call for.
        sensor: Name of the chosen one; None for the one that fits each recording.
        seed: Seed of the sensor's noise.
        glance_deg: How far the head is turned aside, see `experiments.forecast.glance.turn_head`.
        glance_from_s: When that begins, seconds after the first frame.
    """

    sensors: Mapping[str, SensorSpec]
    sensor: str | None
    seed: int
    glance_deg: float
    glance_from_s: float


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
    view: View
    settings: PredictorSettings
    options: Mapping[str, Any]

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        own = getattr(self.settings, self.predictor, self.settings.constant_velocity)
        content = {
            "recording": recording_hash(self.recording),
            "predictor": [self.predictor, self.cues, dict(self.options)],
            # `last_position` and `walker` use settings of the filter, too.
            "settings": [s.model_dump(mode="json", exclude={"fitted"}) for s in (own, self.settings.constant_velocity)],
            "models": models_hash(self.settings.walker.fitted) if self.predictor == "walker" else "",
            "horizons": self.horizons_s,
            "view": [self.view.sensor, self.view.seed, self.view.glance_deg, self.view.glance_from_s],
            "sensors": {name: sensor.model_dump(mode="json") for name, sensor in self.view.sensors.items()},
            "own parts": parts_hash("", self.predictor),
        }
        names = ("errors", "glance", "placing")
        return key_of(content, __name__, *(f"experiments.forecast.{name}" for name in names))

    def run(self) -> Row:
        """Labels, the predictor's name, whether it was fitted on this person, and arrays of `ForecastErrors`."""
        walk = turn_head(load_once(self.recording), self.view.glance_deg, self.view.glance_from_s)
        sensor = self.view.sensors[self.view.sensor or default_sensor(walk)]
        recording = placed_for(walk, sensor)
        subject = recording.labels.subject
        person = Person(subject, TrueHead(recording))
        predictor = make_predictor(self.predictor, self.settings, person, dict(self.options))
        errors = forecast_errors(recording, predictor, sensor, np.array(self.horizons_s), self.view.seed, self.cues)
        return {
            "kind": recording.kind,
            "subject": subject,
            "group": recording.labels.group or "unknown",
            "seen": isinstance(predictor, Walker) and subject in predictor.fitted_on(),
            "predictor_name": name_of(PREDICTOR, predictor),
            **vars(errors),
        }


def clip_result(row: Row) -> ClipResult:
    """The errors from the result of a job.

    Args:
        row: The result, with the predictor's name under ``predictor`` and the cues under ``cues``.

    Returns:
        The errors.
    """
    names = ("horizons_s", "difference_m", "error_filtered_m", "nees", "update_us")
    errors = ForecastErrors(**{name: row[name] for name in names})
    labels = {name: row[name] for name in ("predictor", "cues", "kind", "subject", "group", "seen")}
    return ClipResult(**labels, errors=errors)
