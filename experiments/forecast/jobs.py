"""Forecast errors of one predictor on one recording as a job."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from experiments.engine.job import Row, key_of, models_hash, parts_hash, recording_hash
from experiments.engine.replays import load_once
from experiments.forecast.errors import ClipView, Cues, ForecastErrors, forecast_errors
from experiments.forecast.summary import ClipResult
from gazempc.loop.build import Person, make_predictor
from gazempc.parts import PREDICTOR, name_of
from gazempc.settings import PredictorSettings
from predictors import Walker


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


def clip_result(row: Row) -> ClipResult:
    """The errors from the result of a job.

    Args:
        row: The result, with the recording, the predictor's name and the cues under their names.

    Returns:
        The errors.
    """
    errors = ForecastErrors(**{field.name: row[field.name] for field in fields(ForecastErrors)})
    return ClipResult(**{field.name: row[field.name] for field in fields(ClipResult)[:-1]}, errors=errors)
