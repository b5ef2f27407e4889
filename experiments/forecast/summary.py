"""Forecast errors of one predictor on one recording as a job, and those of many in one table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from experiments.aggregate import bootstrap_mean, clips_of
from experiments.engine.job import Row, key_of, models_hash, parts_hash, recording_hash
from experiments.engine.replays import load_once
from experiments.forecast.errors import ClipView, Cues, ForecastErrors, forecast_errors
from gazempc.loop.build import Person, make_predictor
from gazempc.parts import PREDICTOR, name_of
from gazempc.results.forecast_metrics import inside
from gazempc.settings import PredictorSettings
from gazempc.types import FloatArray
from predictors import Walker

BASELINES = ("constant_velocity", "last_position")
_SHARES = (0.68, 0.90, 0.95)


@dataclass(frozen=True)
class ClipResult:
    """Errors of one predictor on one recording.

    Attributes:
        recording: Synthetic name or path.
        sensor: Name of the sensor.
        predictor: Name of the predictor.
        cues: Which orientations it was shown.
        data_kind: Where the data are from.
        subject: Who walks.
        group: Route group.
        kind: What the person does, such as ``starting``; None where that is not known.
        seen: Whether the predictor was fitted on this person.
        errors: The errors.
    """

    recording: str
    sensor: str
    predictor: str
    cues: Cues
    data_kind: str
    subject: str
    group: str
    kind: str | None
    seen: bool
    errors: ForecastErrors


def summarise(results: Sequence[ClipResult]) -> list[dict[str, Any]]:
    """Means by sensor, predictor, group or kind, and horizon.

    Means, coverage and NEES are means over clips of the mean over frames; percentiles are over all frames. The ratios
    to `constant_velocity` and `last_position` are over the clips that both have.

    Args:
        results: One for each sensor, predictor, cues and recording.

    Returns:
        One row a combination; NaN is None.
    """
    rows = []
    for sensor in dict.fromkeys(r.sensor for r in results):
        seen = [r for r in results if r.sensor == sensor]
        baselines = {name: {r.recording: r for r in reversed(seen) if r.predictor == name} for name in BASELINES}
        clips_in_order = clips_of(vars(r) for r in seen)
        for predictor, cues in dict.fromkeys((r.predictor, r.cues) for r in seen):
            for clips in clips_in_order:
                named = {"sensor": sensor, "predictor": predictor, "cues": cues, **clips.labels}
                chosen = [r for r in seen if (r.predictor, r.cues) == (predictor, cues) and clips.hold(vars(r))]
                for i, horizon_s in enumerate(chosen[0].errors.horizons_s if chosen else ()):
                    ratios = {f"ratio_to_{name}": _ratio(chosen, own, i) for name, own in baselines.items()}
                    rows.append({**named, "horizon_s": float(horizon_s), **_figures(chosen, i), **ratios})
    return rows


def _ratio(chosen: Sequence[ClipResult], baseline: Mapping[str, ClipResult], i: int) -> float | None:
    pairs = [(error_m(r, i), error_m(baseline[r.recording], i)) for r in chosen if r.recording in baseline]
    known = np.array([pair for pair in pairs if np.isfinite(pair).all()])
    if not known.size or not known[:, 1].any():
        return None
    own_m, baseline_m = known.mean(axis=0)
    return float(own_m / baseline_m)


def error_m(result: ClipResult, i: int) -> float:
    """Mean distance from the true head at the i-th horizon, metres; NaN where none is known."""
    return _mean(np.linalg.norm(result.errors.difference_m[:, i], axis=-1))


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def _figures(chosen: Sequence[ClipResult], i: int) -> dict[str, Any]:
    people = [r.subject for r in chosen]
    differences = [1e3 * r.errors.difference_m[:, i] for r in chosen]
    distances = [np.linalg.norm(d, axis=-1) for d in differences]
    frames = np.concatenate(distances)
    frames = frames[np.isfinite(frames)]

    def over_clips(values: Sequence[FloatArray]) -> float:
        return _mean(np.array([_mean(v) for v in values]))

    mean, low, high = bootstrap_mean([_mean(d) for d in distances], people)
    figures = {
        "error_true_mm": mean,
        "error_true_p50_mm": float(np.percentile(frames, 50)) if frames.size else math.nan,
        "error_true_p95_mm": float(np.percentile(frames, 95)) if frames.size else math.nan,
        "error_filtered_mm": over_clips([1e3 * r.errors.error_filtered_m[:, i] for r in chosen]),
        "error_along_rms_mm": _rms(differences, 0),
        "error_across_rms_mm": _rms(differences, 1),
        "error_vertical_rms_mm": _rms(differences, 2),
        **{f"coverage_{round(100 * p)}": over_clips([_inside(r.errors, i, p) for r in chosen]) for p in _SHARES},
        "nees": over_clips([r.errors.nees[:, i] for r in chosen]),
        "update_us": float(np.median(np.concatenate([r.errors.update_us for r in chosen]))),
        "n_clips": sum(bool(np.isfinite(d).any()) for d in distances),
        "n_people": len(set(people)),
        "n_frames": int(frames.size),
        "n_people_seen_in_fitting": len({r.subject for r in chosen if r.seen}),
    }
    row: dict[str, Any] = {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in figures.items()}
    row["error_true_mm_ci95"] = [low, high] if math.isfinite(low) else None
    return row


def _rms(differences: Sequence[FloatArray], part: int) -> float:
    values = np.concatenate([d[:, part] for d in differences])
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def _inside(errors: ForecastErrors, i: int, share: float) -> FloatArray:
    nees = errors.nees[:, i]
    return np.where(np.isfinite(nees), inside(nees, errors.degrees_of_freedom, share), np.nan)


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
