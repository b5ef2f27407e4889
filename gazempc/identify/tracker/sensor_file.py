"""The measured errors of a tracker, as a sensor file."""

from __future__ import annotations

import datetime
import math

import numpy as np

from gazempc.identify.toml import as_toml
from gazempc.identify.tracker.measure import DirectionError, TrackerErrors, YawErrors
from gazempc.identify.tracker.report import ASSUMED_LATENCY_S, DEG, shown
from gazempc.identify.tracker.track import HeadTrack


def sensor_toml(errors: TrackerErrors, track: HeadTrack, name: str, origin: str, day: datetime.date) -> str:
    """Write the measured errors as a sensor file.

    Args:
        errors: Of the tracker.
        track: What they were measured on.
        name: Of the new sensor.
        origin: File that was read.
        day: When.

    Returns:
        TOML that `gazempc.sim.sensor.load_sensor` reads.
    """
    frames, wait_s = errors.frames, errors.latency_s
    found = (
        f"range white {_white(errors.along, 100.0, 2)} %, bearing white "
        f"{_white(errors.across, DEG, 3)} deg (± s.d.) on {errors.used_s:.0f} s at {errors.range_m[1]:.2f} m"
    )
    unknown = [
        name for name, error in (("range", errors.along), ("bearing", errors.across)) if error.wander == "unknown"
    ]
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
        values["jumps"] = _jumps_table(errors)
    values["head_yaw"] = _yaw_table(errors.head_yaw)
    values["pelvis_yaw"] = _yaw_table(errors.pelvis_yaw)
    if frames.gaps_s.size:
        values["loss"] = {
            "mean_interval_s": _rounded(frames.gap_interval_s),
            "duration_min_s": _rounded(frames.gaps_s.min()),
            "duration_max_s": _rounded(frames.gaps_s.max()),
        }
    if not frames.regular:
        # Uniform from 0 to this has that standard deviation; the rate is that of frames that are not late.
        jitter_s = frames.jitter_s * math.sqrt(12.0)
        values["rate_hz"] = _rounded(1.0 / max(1.0 / frames.rate_hz - 0.5 * jitter_s, 1e-3))
        values["timing"] = {"frame_jitter_s": _rounded(jitter_s)}
    return as_toml(values)


def _white(error: DirectionError, factor: float, digits: int) -> str:
    white = error.fit.white
    return f"at most {factor * white.value:.{digits}f}" if error.hidden else shown(white, factor, digits)


def _direction_table(error: DirectionError, factor: float, unit: str) -> dict[str, object]:
    fit = error.fit
    values: dict[str, object] = {f"noise_{unit}": _rounded(factor * fit.white.value)}
    if error.wander == "known" and fit.wander is not None and fit.correlation_s is not None:
        values[f"wander_{unit}"] = _rounded(factor * fit.wander.value)
        values["wander_time_s"] = _rounded(fit.correlation_s.value)
    return values


def _yaw_table(yaw: YawErrors | None) -> dict[str, object]:
    return {"reported": False} if yaw is None else _direction_table(yaw.error, DEG, "deg")


def _jumps_table(errors: TrackerErrors) -> dict[str, object]:
    jumps = errors.jumps
    sizes_m = np.hypot(*errors.jump_sizes_m)
    low_m, high_m = np.quantile(sizes_m, [0.1, 0.9])
    low_s, high_s = np.quantile(jumps.durations_s, [0.1, 0.9])
    free_s = errors.used_s - float(jumps.durations_s.sum())
    return {
        "mean_interval_s": _rounded(free_s / jumps.durations_s.size),
        "duration_min_s": _rounded(low_s),
        "duration_max_s": _rounded(high_s),
        "size_min_m": _rounded(low_m),
        "size_max_m": _rounded(high_m),
    }


def _rounded(value: float) -> float:
    return float(f"{float(value):.4g}")
