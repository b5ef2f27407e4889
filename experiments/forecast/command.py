"""Compare forecasts over many recordings: `python -m experiments.forecast --recordings synthetic`."""

from __future__ import annotations

import json
import math
import sys
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from pydantic import Field
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from tqdm import tqdm

from experiments.aggregate import bootstrap_mean, groups_of
from experiments.engine.recordings import find_recordings
from experiments.forecast.errors import RUN_IN_S, Cues, ForecastErrors, forecast_errors
from gazempc.errors import GazempcError
from gazempc.recordings.load import load
from gazempc.recordings.recording import Recording, Track
from gazempc.recordings.truth import TrueHead
from gazempc.results.report import versions
from gazempc.settings import DEFAULT_PREDICTOR, PredictorName, PredictorSettings
from gazempc.sim.replay import make_predictor
from gazempc.sim.sensor import default_sensor, load_sensor
from gazempc.types import FloatArray
from predictors import Predictor, Walker

BASELINE: PredictorName = "constant_velocity"
_BAD_INPUT = 2
_GLANCE_RISE_S = 0.25
_INSIDE_68 = float(chi2.ppf(0.68, df=3))
_INSIDE_90 = float(chi2.ppf(0.90, df=3))
_INSIDE_95 = float(chi2.ppf(0.95, df=3))


class ForecastSettings(PredictorSettings):
    """Settings of `python -m experiments.forecast`."""

    recordings: tuple[str, ...] = Field(
        min_length=1, description="'synthetic' (14 x 6), folders, files or synthetic names"
    )
    predictors: tuple[PredictorName | Literal["default"], ...] = Field(
        default=("last_position", "constant_velocity", "head_pose", "pelvis_pursuit", "walker"),
        min_length=1,
        description="What to compare",
    )
    sensor: str | None = Field(
        default=None, description="Shipped sensor or .toml file; without it what fits each recording"
    )
    horizons: tuple[float, ...] = Field(default=(0.25, 0.5, 1.0), min_length=1, description="Seconds from capture")
    cues: tuple[Cues, ...] = Field(
        default=("both",), min_length=1, description="Which orientations the predictors are shown"
    )
    glance: float = Field(
        default=0.0,
        ge=-180,
        le=180,
        description="Turn the recorded head aside by this angle (deg), as of who looks at something off their way",
    )
    glance_from: float = Field(default=0.0, ge=0, description="When the glance begins, seconds into the recording")
    example: str | None = Field(default=None, description="Recording to draw from above, with the forecasts")
    seed: int = Field(default=0, ge=0, description="Seed of the sensor's noise")
    out: Path = Field(default=Path("out/forecast"), description="Where to write")


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
    from experiments.forecast.figures import draw, draw_coverage, draw_cues  # noqa: PLC0415

    draw(rows, kinds, settings.out / "forecast_error.png")
    draw_coverage(rows, kinds, settings.out / "coverage.png")
    middle_s = sorted(settings.horizons)[len(settings.horizons) // 2]
    if len(set(settings.cues)) > 1:
        draw_cues(rows, kinds, settings.out / "cues.png", middle_s)
    if settings.example is not None:
        _draw_example(settings, settings.example, middle_s)
    print(text)
    print(f"Written to {settings.out}/: summary.json, summary.md and figures")
    return 0


def _draw_example(settings: ForecastSettings, name: str, horizon_s: float) -> None:
    from experiments.forecast.example import draw_example  # noqa: PLC0415

    recording = turn_head(load(name), settings.glance, settings.glance_from)
    sensor = load_sensor(settings.sensor or default_sensor(recording))
    shown: dict[str, Predictor] = {
        p: make_predictor(p, settings, TrueHead(recording), recording.labels.subject) for p in _predictors(settings)
    }
    draw_example(recording, shown, sensor, settings.seed, horizon_s, settings.out / "example.png")


def _predictors(settings: ForecastSettings) -> list[PredictorName]:
    return list(dict.fromkeys(DEFAULT_PREDICTOR if p == "default" else p for p in settings.predictors))


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
    names = _predictors(settings)
    if settings.example is not None:
        load(settings.example)
    results = []
    for name in tqdm(recordings, unit="recording", file=sys.stderr, mininterval=1.0):
        # Errors do not depend on where a robot stands, so the recording's own frame serves.
        recording = turn_head(load(name), settings.glance, settings.glance_from)
        sensor = load_sensor(settings.sensor or default_sensor(recording))
        for predictor_name in names:
            subject, group = recording.labels.subject, recording.labels.group or "unknown"
            predictor = make_predictor(predictor_name, settings, TrueHead(recording), subject)
            seen = isinstance(predictor, Walker) and subject in predictor.fitted_on()
            for cues in dict.fromkeys(settings.cues):
                errors = forecast_errors(recording, predictor, sensor, horizons_s, settings.seed, cues)
                results.append(ClipResult(predictor_name, cues, recording.kind, subject, group, errors, seen))
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


def turn_head(recording: Recording, angle_deg: float, from_s: float) -> Recording:
    """The recording with the head turned aside, by turns to the left and to the right from one name to the next.

    Args:
        recording: The recording.
        angle_deg: How far; 0 for not at all.
        from_s: When it begins, seconds after the first frame.

    Returns:
        The same walk with other head orientations.
    """
    if angle_deg == 0.0:
        return recording
    side = 1.0 if zlib.crc32(recording.name.encode()) % 2 else -1.0
    after_s = recording.times_s - recording.times_s[0] - from_s
    angle = np.radians(angle_deg) * side * np.clip(after_s / _GLANCE_RISE_S if from_s else after_s + 1.0, 0.0, 1.0)

    def turned(track: Track) -> Track:
        turn = Rotation.from_euler("z", angle[track.valid, None])
        quats = track.head_quat_wxyz.copy()
        as_seen = Rotation.from_quat(quats[track.valid], scalar_first=True)
        quats[track.valid] = (turn * as_seen).as_quat(scalar_first=True)
        return replace(track, head_quat_wxyz=quats)

    measured = None if recording.measured is None else turned(recording.measured)
    return replace(recording, truth=turned(recording.truth), measured=measured)


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
        "is honest. Ratio: error over that of constant_velocity. Cues: which orientations the predictor is shown.",
    ]
    if seen := max(r["n_people_seen_in_fitting"] for r in rows):
        lines += [
            "",
            f"walker was fitted on {_count(seen)} of those who walk here, which flatters it: for errors on people "
            "left out see --walker.fitted.",
        ]
    lines += [
        "",
        "| predictor | cues | group | clips | horizon [s] | error [mm] | ratio | p50 | p95 | to filtered [mm] | along "
        "| across | vertical | within 68 % | within 90 % | within 95 % | NEES | update [us] |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        interval = r["error_true_mm_ci95"]
        error = show(r["error_true_mm"]) + (f" [{interval[0]:.0f}, {interval[1]:.0f}]" if interval else "")
        lines.append(
            f"| {r['predictor']} | {r['cues']} | {r['group']} | {r['n_clips']} | {r['horizon_s']:g} | {error} "
            f"| {show(r['ratio_to_constant_velocity'], 2)} | {show(r['error_true_p50_mm'])} "
            f"| {show(r['error_true_p95_mm'])} | {show(r['error_filtered_mm'])} "
            f"| {show(r['error_along_rms_mm'])} | {show(r['error_across_rms_mm'])} "
            f"| {show(r['error_vertical_rms_mm'])} "
            f"| {show(r['coverage_68'], 2)} | {show(r['coverage_90'], 2)} | {show(r['coverage_95'], 2)} "
            f"| {show(r['nees'], 1)} "
            f"| {show(r['update_us'])} |"
        )
    return "\n".join([*lines, ""])


def _count(people: int) -> str:
    return "one person" if people == 1 else f"{people} people"


if __name__ == "__main__":
    sys.exit(main())
