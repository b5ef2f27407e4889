"""Measured errors of a tracker: the command, the printed table and the sensor file."""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gazempc.command import Progress
from gazempc.files.documents import as_toml
from gazempc.files.whole import write_whole
from gazempc.identify.tracker.errors import Errors
from gazempc.identify.tracker.measure import TrackerErrors, measure_tracker
from gazempc.identify.tracker.read import HeadTrack, read_track
from gazempc.results.table import aligned
from gazempc.types import FloatArray

DEG = 180.0 / math.pi
ASSUMED_LATENCY_S = 0.066


def table(errors: TrackerErrors) -> str:
    """Rows with value, 95 % interval, and seconds of data used."""
    rows = list(_rows(errors))
    lines = aligned([row[:2] for row in rows])
    return "\n".join(f"{line}  {remark}".rstrip() for line, (*_, remark) in zip(lines, rows, strict=True))


def _rows(errors: TrackerErrors) -> Iterator[tuple[str, str, str]]:
    frames = errors.frames
    low_m, middle_m, high_m = errors.range_m
    yield "range (m)", f"{middle_m:.2f}", f"median; {low_m:.2f} to {high_m:.2f}"
    yield "frames per second", f"{frames.rate_hz:.2f}", f"{frames.duration_s:.0f} s"
    kept = "about a steady rate; not in the file" if frames.regular else "irregular"
    yield "s.d. of their intervals (ms)", f"{1e3 * frames.jitter_s:.1f}", kept
    yield "single frames missing (%)", f"{100 * frames.single_share:.2f}", ""
    gaps_s = frames.gaps_s
    yield "longer gaps", f"{gaps_s.size}", f"{gaps_s.min():.2f} to {gaps_s.max():.2f} s long" if gaps_s.size else ""
    if errors.delay_s is not None:
        yield "from stamp to arrival (ms)", f"{1e3 * errors.delay_s:.1f}", "median"
    yield from _direction_rows("range", "% of the range", errors.along, 100.0)
    yield from _direction_rows("bearing", "deg, each axis", errors.across, DEG)
    durations_s = errors.jump_durations_s
    if durations_s.size:
        along, across = map(np.median, errors.jump_sizes_m)
        size = f"{along:.2f} m along, {across:.2f} m across the line of sight (medians)"
        remark = f"{size}; up to {durations_s.max():.2f} s"
        yield "jumps per second", f"{durations_s.size / (errors.along.used_s + durations_s.sum()):.2f}", remark
    else:
        yield "jumps per second", "0", f"{errors.along.used_s:.0f} s"
    for name, yaw in (("head yaw", errors.head_yaw), ("pelvis yaw", errors.pelvis_yaw)):
        if yaw is None:
            yield name, "-", "not in the recording"
        else:
            yield from _direction_rows(name, "deg", yaw, DEG)


def _direction_rows(name: str, unit: str, error: Errors, factor: float) -> Iterator[tuple[str, str, str]]:
    label, used = f"{name}: wander ({unit})", f"{error.used_s:.0f} s"
    remark = f"{used}; hidden by motion or smoothing" if error.hidden else used
    yield f"{name}: white ({unit})", _white(error, factor, 3, "<"), remark
    if error.wander is not None and error.correlation_s is not None:
        yield label, error.wander.shown(factor, 3), used
        yield f"{name}: its correlation time (s)", error.correlation_s.shown(1.0, 2), used
    elif error.wander_is == "unknown":
        yield label, "unknown", "hidden by the person's motion, or too slow for this recording; not in the file"
    else:
        yield label, "none", "not significant, or within a person's sway"


def warnings(errors: TrackerErrors) -> list[str]:
    """Warnings about the file: unknown, bounded or assumed values."""
    found = []
    if errors.moved:
        still = f"still for {errors.still_s:.0f} s of {errors.frames.duration_s:.0f} s"
        found.append(
            f"the person moved too much: {still}. Wander is omitted, so the file understates the error; "
            "record 30 s of a person who stands still"
        )
    elif errors.along.used_s < 20.0:
        found.append(f"only {errors.along.used_s:.0f} s of a person at rest; 30 s are better, mainly for wander")
    if errors.along.hidden or errors.across.hidden:
        found.append("white error: upper bounds only, as the tracker smooths, or the person moved")
    if errors.jump_durations_s.size and not errors.jumps_across:
        found.append("jumps are small or along the line of sight only: omitted, as a sensor file has no field for them")
    if errors.latency_s is None:
        found.append(f"latency is not measured: the file assumes {1e3 * ASSUMED_LATENCY_S:.0f} ms, as `reference`")
    return found


def sensor_toml(errors: TrackerErrors, track: HeadTrack, name: str, origin: str, day: datetime.date) -> str:
    """Write the measured errors as a sensor file.

    Args:
        errors: Errors of the tracker.
        track: The measured track.
        name: Name of the new sensor.
        origin: The recording's file.
        day: Date of the measurement.

    Returns:
        TOML that `gazempc.sim.sensor.load_sensor` reads.
    """
    frames, wait_s = errors.frames, errors.latency_s
    parts = {"range": errors.along, "bearing": errors.across}
    unknown = [part for part, error in parts.items() if error.wander_is == "unknown"]
    found = (
        f"range white {_white(errors.along, 100.0, 2)} %, bearing white "
        f"{_white(errors.across, DEG, 3)} deg (95 % intervals) on {errors.along.used_s:.0f} s at "
        f"{errors.range_m[1]:.2f} m"
    )
    values: dict[str, object] = {
        "name": name,
        "source": f"measured by gazempc on {day.isoformat()} from {origin}, {track.person}: {found}; "
        + (f"wander of {' and '.join(unknown)} unknown; " if unknown else "")
        + (f"latency from stamp to arrival, {1e3 * wait_s:.0f} ms" if wait_s is not None else "latency assumed"),
        "rate_hz": _rounded(frames.rate_hz),
        "latency_s": _rounded(wait_s if wait_s is not None else ASSUMED_LATENCY_S),
        "dropout_probability": _rounded(frames.single_share),
        "along": _direction_table(errors.along, 1.0, "share"),
        "across": _direction_table(errors.across, DEG, "deg"),
    }
    if errors.jumps_across:
        durations_s = errors.jump_durations_s
        low_m, high_m = np.quantile(np.hypot(*errors.jump_sizes_m), [0.1, 0.9])
        # The times in use are those without jumps.
        bursts = _bursts(errors.along.used_s + durations_s.sum(), durations_s, (0.1, 0.9))
        values["jumps"] = {**bursts, "size_min_m": _rounded(low_m), "size_max_m": _rounded(high_m)}
    for part, yaw in (("head_yaw", errors.head_yaw), ("pelvis_yaw", errors.pelvis_yaw)):
        values[part] = {"reported": False} if yaw is None else _direction_table(yaw, DEG, "deg")
    if frames.gaps_s.size:
        values["loss"] = _bursts(frames.duration_s, frames.gaps_s, (0.0, 1.0))
    if not frames.regular:
        # Range of a uniform distribution with this standard deviation; the rate is without delays.
        jitter_s = frames.jitter_s * math.sqrt(12.0)
        values["rate_hz"] = _rounded(1.0 / max(1.0 / frames.rate_hz - 0.5 * jitter_s, 1e-3))
        values["timing"] = {"frame_jitter_s": _rounded(jitter_s)}
    return as_toml(values)


def _white(error: Errors, factor: float, digits: int, most: str = "at most") -> str:
    value = factor * error.white.value
    return f"{most} {value:.{digits}f}" if error.hidden else error.white.shown(factor, digits)


def _direction_table(error: Errors, factor: float, unit: str) -> dict[str, object]:
    values: dict[str, object] = {f"noise_{unit}": _rounded(factor * error.white.value)}
    if error.wander is not None and error.correlation_s is not None:
        values[f"wander_{unit}"] = _rounded(factor * error.wander.value)
        values["wander_time_s"] = _rounded(error.correlation_s.value)
    return values


def _bursts(total_s: float, durations_s: FloatArray, quantiles: tuple[float, float]) -> dict[str, object]:
    interval_s = (total_s - float(durations_s.sum())) / durations_s.size
    low_s, high_s = map(_rounded, np.quantile(durations_s, quantiles))
    return {"mean_interval_s": _rounded(interval_s), "duration_min_s": low_s, "duration_max_s": high_s}


def _rounded(value: float) -> float:
    return float(f"{float(value):.4g}")


def identify_tracker(path: Path, person: str | None, out: Path, progress: Progress) -> None:
    """Measure a tracker's errors from a recording, print them and write a sensor file.

    Args:
        path: Recording: table, lines of JSON or folder of a bag.
        person: The tracker's name of the person; None: the longest track.
        out: TOML file to write.
        progress: Progress display.

    Raises:
        RecordingError: If the recording cannot be read.
        SettingsError: If there is no such person.
        MissingOptionalDependencyError: If the format needs a package that is not installed.
    """
    progress.begin(f"reading {path}")
    track = read_track(path, person)
    print(f"{path.name}: {track.person}, {track.times_s.size} frames")
    for note in track.notes:
        print(f"  {note}")
    errors = measure_tracker(track)
    print(f"\n{table(errors)}\n\n± is half the 95 % confidence interval.")
    for warning in warnings(errors):
        print(f"Warning: {warning}.")
    write_whole(out, sensor_toml(errors, track, out.stem, path.name, datetime.date.today()))
    print(f"\nWritten: {out}")
    print(f"Use it: python -m gazempc.run --replay subject03_R4 --sensor {out}")
