"""Compare forecasts over many recordings: `python -m experiments.forecast --recordings synthetic`."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field
from scipy.stats import chi2
from tqdm import tqdm

from experiments.aggregate import bootstrap_mean, groups_of
from experiments.forecast_errors import RUN_IN_S, ForecastErrors, forecast_errors
from experiments.recordings import find_recordings
from gazempc.config import DEFAULT_PREDICTOR, PredictorName, RunSettings
from gazempc.errors import GazempcError
from gazempc.recording import load
from gazempc.replay import make_predictor
from gazempc.report import versions
from gazempc.sensor import default_sensor, load_sensor
from gazempc.truth import TrueHead

FloatArray = NDArray[np.float64]

_BAD_INPUT = 2
_INSIDE_68 = float(chi2.ppf(0.68, df=3))
_INSIDE_95 = float(chi2.ppf(0.95, df=3))


class ForecastSettings(BaseModel):
    """Settings of `python -m experiments.forecast`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    recordings: tuple[str, ...] = Field(
        min_length=1, description="'synthetic' (14 x 6), folders, files or synthetic names"
    )
    predictors: tuple[PredictorName | Literal["default"], ...] = Field(
        default=("last_position", "constant_velocity", "head_pose"), min_length=1, description="What to compare"
    )
    sensor: str | None = Field(
        default=None, description="Shipped sensor or .toml file; without it what fits each recording"
    )
    horizons: tuple[float, ...] = Field(default=(0.25, 0.5, 1.0), min_length=1, description="Seconds from capture")
    seed: int = Field(default=0, ge=0, description="Seed of the sensor's noise")
    out: Path = Field(default=Path("out/forecast"), description="Where to write")


@dataclass(frozen=True)
class ClipResult:
    """Errors of one predictor on one recording."""

    predictor: str
    kind: str
    subject: str
    group: str
    errors: ForecastErrors


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, or 2 on bad input.
    """
    settings = tyro.cli(ForecastSettings, args=arguments, prog="python -m experiments.forecast", description=__doc__)
    try:
        results = run(settings)
        rows = summarise(results)
        summary = {
            "rows": rows,
            "scored": f"frames from {RUN_IN_S} s after the first one whose horizon ends within the recording",
            "settings": settings.model_dump(mode="json", exclude={"out"}),
            "versions": versions(),
        }
        settings.out.mkdir(parents=True, exist_ok=True)
    except (GazempcError, OSError) as error:
        print(f"forecast: {error}", file=sys.stderr)
        return _BAD_INPUT
    (settings.out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    kinds = ", ".join(dict.fromkeys(r.kind for r in results))
    text = report(rows, kinds, settings.sensor)
    (settings.out / "summary.md").write_text(text, encoding="utf-8")
    from experiments.forecast_figures import draw  # noqa: PLC0415

    draw(rows, kinds, settings.out / "forecast_error.png")
    print(text)
    print(f"Written to {settings.out}/: summary.json, summary.md, forecast_error.png")
    return 0


def run(settings: ForecastSettings) -> list[ClipResult]:
    """Run every predictor over every recording.

    Args:
        settings: What to compare.

    Returns:
        One result a predictor and recording.

    Raises:
        GazempcError: If a recording or sensor does not exist or cannot be read, or a horizon is not positive.
    """
    horizons_s = np.array(settings.horizons)
    if not np.all((horizons_s > 0) & np.isfinite(horizons_s)):
        raise GazempcError(f"horizons must be positive, got {list(settings.horizons)}")
    recordings = find_recordings(settings.recordings)
    if settings.sensor is not None:
        load_sensor(settings.sensor)
    names = list(dict.fromkeys(DEFAULT_PREDICTOR if p == "default" else p for p in settings.predictors))
    results = []
    for name in tqdm(recordings, unit="recording", file=sys.stderr, mininterval=1.0):
        # Errors do not depend on where a robot stands, so the recording's own frame serves.
        recording = load(name)
        sensor = load_sensor(settings.sensor or default_sensor(recording))
        for predictor_name in names:
            predictor = make_predictor(predictor_name, RunSettings(), TrueHead(recording))
            errors = forecast_errors(recording, predictor, sensor, horizons_s, settings.seed)
            labels = recording.labels
            group = labels.group or "unknown"
            results.append(ClipResult(predictor_name, recording.kind, labels.subject, group, errors))
    return results


def summarise(results: Sequence[ClipResult]) -> list[dict[str, Any]]:
    """Means by predictor, group and horizon.

    Means, coverage and NEES are means over clips of the mean over frames; percentiles are over all frames.

    Args:
        results: As made by `run`.

    Returns:
        One row a combination; NaN is None.
    """
    rows = []
    for predictor in dict.fromkeys(r.predictor for r in results):
        own = [r for r in results if r.predictor == predictor]
        for group in groups_of({"group": r.group} for r in own):
            chosen = [r for r in own if group in {"all", r.group}]
            for i, horizon_s in enumerate(chosen[0].errors.horizons_s):
                rows.append(
                    {"predictor": predictor, "group": group, "horizon_s": float(horizon_s), **_figures(chosen, i)}
                )
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
        "coverage_95": _share_inside(inside, _INSIDE_95, people),
        "nees": bootstrap_mean(over_clips(inside), people)[0],
        "update_us": float(np.median(np.concatenate([r.errors.update_us for r in chosen]))),
        "n_clips": sum(bool(np.isfinite(d).any()) for d in distances),
        "n_people": len(set(people)),
        "n_frames": int(frames.size),
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


def report(rows: Sequence[dict[str, Any]], kinds: str, sensor: str | None) -> str:
    """The rows as a Markdown table.

    Args:
        rows: As made by `summarise`.
        kinds: What kinds of recordings they are from.
        sensor: The sensor that was asked for.

    Returns:
        The text.
    """

    def show(value: float | None, digits: int = 0) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    lines = [
        "# Forecast errors",
        "",
        f"{kinds}; sensor {sensor or 'that fits each recording'}. Distance from the true head: mean over clips with "
        "its 95 % bootstrap interval over people, and percentiles over frames. To filtered: distance from the "
        "position that a constant-velocity filter has at that time. Along and across the direction of travel and "
        "vertical: RMS. Within 68 and 95 %: share of frames inside the stated ellipsoid. NEES: 3 if the covariance "
        "is honest.",
        "",
        "| predictor | group | clips | horizon [s] | error [mm] | p50 | p95 | to filtered [mm] | along | across "
        "| vertical | within 68 % | within 95 % | NEES | update [us] |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        interval = r["error_true_mm_ci95"]
        error = show(r["error_true_mm"]) + (f" [{interval[0]:.0f}, {interval[1]:.0f}]" if interval else "")
        lines.append(
            f"| {r['predictor']} | {r['group']} | {r['n_clips']} | {r['horizon_s']:g} | {error} "
            f"| {show(r['error_true_p50_mm'])} | {show(r['error_true_p95_mm'])} | {show(r['error_filtered_mm'])} "
            f"| {show(r['error_along_rms_mm'])} | {show(r['error_across_rms_mm'])} "
            f"| {show(r['error_vertical_rms_mm'])} "
            f"| {show(r['coverage_68'], 2)} | {show(r['coverage_95'], 2)} | {show(r['nees'], 1)} "
            f"| {show(r['update_us'])} |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    sys.exit(main())
