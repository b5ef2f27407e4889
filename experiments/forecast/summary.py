"""Forecast errors of many recordings in one table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from experiments.aggregate import bootstrap_mean, groups_of
from experiments.forecast.errors import Cues, ForecastErrors
from gazempc.types import FloatArray

BASELINE = "constant_velocity"
_INSIDE_68, _INSIDE_90, _INSIDE_95 = (float(chi2.ppf(share, df=3)) for share in (0.68, 0.90, 0.95))


@dataclass(frozen=True)
class ClipResult:
    """Errors of one predictor on one recording; `seen` if it was fitted on this person."""

    predictor: str
    cues: Cues
    kind: str
    subject: str
    group: str
    errors: ForecastErrors
    seen: bool


def summarise(results: Sequence[ClipResult]) -> list[dict[str, Any]]:
    """Means by predictor, group and horizon.

    Means, coverage and NEES are means over clips of the mean over frames; percentiles are over all frames.

    Args:
        results: One for each predictor, cues and recording.

    Returns:
        One row a combination; NaN is None.
    """
    rows = []
    for predictor, cues in dict.fromkeys((r.predictor, r.cues) for r in results):
        own = [r for r in results if (r.predictor, r.cues) == (predictor, cues)]
        for group in groups_of({"group": r.group} for r in own):
            chosen = [r for r in own if group in {"all", r.group}]
            for i, horizon_s in enumerate(chosen[0].errors.horizons_s):
                rows.append(
                    {
                        "predictor": predictor,
                        "cues": cues,
                        "group": group,
                        "horizon_s": float(horizon_s),
                        **_figures(chosen, i),
                    }
                )
    baseline = {(r["group"], r["horizon_s"]): r["error_true_mm"] for r in reversed(rows) if r["predictor"] == BASELINE}
    for row in rows:
        against, own = baseline.get((row["group"], row["horizon_s"])), row["error_true_mm"]
        row["ratio_to_constant_velocity"] = own / against if own is not None and against else None
    return rows


def _figures(chosen: Sequence[ClipResult], i: int) -> dict[str, Any]:
    people = [r.subject for r in chosen]
    differences = [1e3 * r.errors.difference_m[:, i] for r in chosen]
    distances = [np.linalg.norm(d, axis=-1) for d in differences]
    frames = np.concatenate(distances)
    frames = frames[np.isfinite(frames)]

    def over_clips(values: Sequence[FloatArray]) -> list[float]:
        return [float(np.mean(v[np.isfinite(v)])) if np.isfinite(v).any() else math.nan for v in values]

    mean, low, high = bootstrap_mean(over_clips(distances), people)
    inside = [r.errors.nees[:, i] for r in chosen]
    figures = {
        "error_true_mm": mean,
        "error_true_p50_mm": float(np.percentile(frames, 50)) if frames.size else math.nan,
        "error_true_p95_mm": float(np.percentile(frames, 95)) if frames.size else math.nan,
        "error_filtered_mm": bootstrap_mean(
            over_clips([1e3 * r.errors.error_filtered_m[:, i] for r in chosen]), people
        )[0],
        "error_along_rms_mm": _rms(differences, 0),
        "error_across_rms_mm": _rms(differences, 1),
        "error_vertical_rms_mm": _rms(differences, 2),
        "coverage_68": _share_inside(inside, _INSIDE_68, people),
        "coverage_90": _share_inside(inside, _INSIDE_90, people),
        "coverage_95": _share_inside(inside, _INSIDE_95, people),
        "nees": bootstrap_mean(over_clips(inside), people)[0],
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


def _share_inside(nees: Sequence[FloatArray], limit: float, people: Sequence[str]) -> float:
    shares = [float(np.mean(v[np.isfinite(v)] <= limit)) if np.isfinite(v).any() else math.nan for v in nees]
    return bootstrap_mean(shares, people)[0]
