"""The measured errors of a tracker, as a printed table."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gazempc.identify.tracker.fit import Known
from gazempc.identify.tracker.measure import DirectionError, TrackerErrors

DEG = 180.0 / math.pi
ASSUMED_LATENCY_S = 0.066
_GOOD_S = 20.0


def table(errors: TrackerErrors) -> str:
    """Rows with value, standard deviation, and seconds of data used."""
    rows = list(_rows(errors))
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    return "\n".join(
        f"{name.ljust(widths[0])}  {value.rjust(widths[1])}  {remark}".rstrip() for name, value, remark in rows
    )


def _rows(errors: TrackerErrors) -> Iterator[tuple[str, str, str]]:
    frames, used = errors.frames, f"{errors.used_s:.0f} s"
    low_m, middle_m, high_m = errors.range_m
    yield "range (m)", f"{middle_m:.2f}", f"median; {low_m:.2f} to {high_m:.2f}"
    yield "frames a second", f"{frames.rate_hz:.2f}", f"{frames.duration_s:.0f} s"
    kept = "about a steady rate; not in the file" if frames.regular else "irregular"
    yield "s.d. of their intervals (ms)", f"{1e3 * frames.jitter_s:.1f}", kept
    yield "single frames missing (%)", f"{100 * frames.single_share:.2f}", ""
    gaps_s = frames.gaps_s
    spell = f"{gaps_s.min():.2f} to {gaps_s.max():.2f} s long" if gaps_s.size else ""
    yield "longer gaps", f"{gaps_s.size}", spell
    if errors.delay_s is not None:
        yield "from stamp to arrival (ms)", f"{1e3 * errors.delay_s:.1f}", "median"
    yield from _direction_rows("range", "% of the range", errors.along, 100.0, used)
    yield from _direction_rows("bearing", "deg, each axis", errors.across, DEG, used)
    jumps = errors.jumps
    if jumps.durations_s.size:
        along, across = errors.jump_sizes_m
        size = f"{np.median(along):.2f} m along, {np.median(across):.2f} m across the line of sight (medians); "
        last = f"up to {jumps.durations_s.max():.2f} s" if jumps.durations_s.any() else "one frame each"
        yield "jumps a second", f"{jumps.durations_s.size / errors.used_s:.2f}", size + last
    else:
        yield "jumps a second", "0", used
    for name, yaw in (("head yaw", errors.head_yaw), ("pelvis yaw", errors.pelvis_yaw)):
        if yaw is None:
            yield name, "-", "not in the recording"
            continue
        yield from _direction_rows(name, "deg", yaw.error, DEG, f"{yaw.used_s:.0f} s")
        if yaw.flips:
            yield f"{name}: half turns", f"{yaw.flips}", "from one frame to the next; not in the file"
        if yaw.known_share < 1.0:
            yield f"{name}: known (%)", f"{100 * yaw.known_share:.1f}", "of the frames"


def _direction_rows(
    name: str, unit: str, error: DirectionError, factor: float, used: str
) -> Iterator[tuple[str, str, str]]:
    fit = error.fit
    if error.hidden:
        yield f"{name}: white ({unit})", f"< {factor * fit.white.value:.3f}", f"{used}; hidden by motion or smoothing"
    else:
        yield f"{name}: white ({unit})", shown(fit.white, factor, 3), used
    if error.wander == "unknown":
        yield (
            f"{name}: wander ({unit})",
            "unknown",
            "hidden by the person's motion, or too slow for this recording; not in the file",
        )
    elif error.wander == "none" or fit.wander is None or fit.correlation_s is None:
        yield f"{name}: wander ({unit})", "none", "none seen, or no more than a person's sway"
    else:
        yield f"{name}: wander ({unit})", shown(fit.wander, factor, 3), used
        yield f"{name}: its correlation time (s)", shown(fit.correlation_s, 1.0, 2), used


def shown(known: Known, factor: float, digits: int) -> str:
    """A value with its standard deviation.

    Args:
        known: The value.
        factor: From its unit to the one shown.
        digits: After the point.

    Returns:
        Text such as ``0.082 ± 0.003``.
    """
    # A spread rounded to nothing would claim certainty.
    return f"{factor * known.value:.{digits}f} ± {max(factor * known.sd, 10.0**-digits):.{digits}f}"


def warnings(errors: TrackerErrors) -> list[str]:
    """Warnings about the file: unknown, bounded or assumed values."""
    found = []
    if errors.moved:
        found.append(
            f"the person moved too much: still for {errors.still_s:.0f} s of {errors.frames.duration_s:.0f} s. Wander "
            "is unknown and left out, so the file describes a tracker with less error than yours; record 30 s of a "
            "person who stands still"
        )
    elif errors.used_s < _GOOD_S:
        found.append(
            f"only {errors.used_s:.0f} s of a person who is still; 30 s give a better estimate, mainly of wander"
        )
    if errors.along.hidden or errors.across.hidden:
        found.append(
            "white error cannot be measured: the tracker smooths, or the person moved. The file has upper bounds"
        )
    if errors.jumps.durations_s.size and not errors.jumps_across:
        found.append("jumps are small or along the line of sight only; a sensor file has no field for them; left out")
    if errors.latency_s is None:
        found.append(
            f"latency is not measured: the file assumes {1e3 * ASSUMED_LATENCY_S:.0f} ms, as the sensor reference"
        )
    return found
