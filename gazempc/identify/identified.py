"""Results of an identification: table, figure and neck file."""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gazempc.files.documents import as_toml
from gazempc.identify.estimate import AxisEstimate
from gazempc.identify.record import NeckRecord
from gazempc.neck.spec import NeckSpec
from gazempc.results.table import aligned

_DETAIL_S = 4.0


def table(estimates: Sequence[AxisEstimate], neck: NeckSpec) -> str:
    """Estimates with 95 % intervals beside the values of the neck file, two joints per table.

    Args:
        estimates: One for each joint that moved.
        neck: The neck whose limits were kept.

    Returns:
        Text of several lines.
    """
    if len(estimates) > 2:
        return f"{table(estimates[:2], neck)}\n\n{table(estimates[2:], neck)}"
    lines = [["", *(text for e in estimates for text in (f"{e.axis}, identified", f"{e.axis}, neck {neck.name}"))]]
    for label, name, factor, digits in (
        ("dead time (ms)", "dead_time_s", 1e3, 1),
        ("natural frequency (rad/s)", "natural_frequency_rad_s", 1.0, 2),
        ("damping ratio", "damping_ratio", 1.0, 3),
        ("servo lag (ms)", "servo_lag_s", 1e3, 1),
        ("bandwidth, -3 dB (Hz)", "bandwidth_hz", 1.0, 3),
    ):
        cells = [label]
        for e in estimates:
            filed = getattr(neck.axes[neck.joint_names.index(e.axis)], name, None)
            cells += [getattr(e, name).shown(factor, digits), "" if filed is None else f"{factor * filed:.{digits}f}"]
        lines.append(cells)
    for label, texts in (
        ("offset (deg)", [f"{round(math.degrees(e.offset_rad), 2) + 0.0:.2f}" for e in estimates]),
        ("fit (%)", [f"{e.fit_percent:.2f}" for e in estimates]),
        ("residual RMS (deg)", [f"{e.residual_rms_deg:.3f}" for e in estimates]),
        ("of it correlated (deg)", [f"{e.structured_rms_deg:.3f}" for e in estimates]),
        ("readings used", [f"{e.time_s.size}" + f" ({e.misread} misread)" * (e.misread > 0) for e in estimates]),
    ):
        lines.append([label, *(cell for text in texts for cell in (text, ""))])
    return "\n".join(aligned(lines))


def neck_toml(neck: NeckSpec, estimates: Sequence[AxisEstimate], name: str, origin: str) -> str:
    """A neck file with the identified values; all others from the given neck.

    Args:
        neck: Source of limits, geometry and rates.
        estimates: One for each joint that moved; a joint without an estimate is unchanged.
        name: Name of the new neck.
        origin: The measured robot or log.

    Returns:
        TOML that `gazempc.neck.spec.load_neck` reads.
    """
    found = "; ".join(
        f"{e.axis}: dead time {e.dead_time_s.shown(1e3, 1)} ms, bandwidth {e.bandwidth_hz.shown(1.0, 3)} Hz, "
        f"fit {e.fit_percent:.1f} %"
        for e in estimates
    )
    kept = [axis for axis in neck.joint_names if axis not in {e.axis for e in estimates}]
    source = f"identified by gazempc on {datetime.date.today().isoformat()} from {origin} (95 % intervals): {found}; "
    source += "".join(f"{axis} not identified, as in {neck.name}; " for axis in kept)
    source += f"limits and geometry of {neck.name}: {neck.source}"
    servo = ("dead_time_s", "natural_frequency_rad_s", "damping_ratio")
    axes = {
        e.axis: neck.axes[neck.joint_names.index(e.axis)].model_copy(
            update={field: float(f"{getattr(e, field).value:.6g}") for field in servo}
        )
        for e in estimates
    }
    measured = neck.with_axes(axes).model_copy(update={"name": name, "source": source})
    return as_toml(measured.model_dump(exclude_none=True))


def draw(record: NeckRecord, estimates: Sequence[AxisEstimate], title: str, path: Path) -> None:
    """Draw measured against model, one column for each joint: all of it, a part of it, and the difference.

    Args:
        record: Commands and angles.
        estimates: One for each joint that moved.
        title: Title of the figure.
        path: Picture to write.
    """
    figure = Figure(figsize=(max(6.4, 5.6 * len(estimates)), 7.6), dpi=110, layout="constrained")
    columns = figure.subplots(3, len(estimates), squeeze=False, height_ratios=(3, 3, 1.6)).T
    start_s, names = float(record.command_time_s[0]), record.neck().joint_names
    for rows, e in zip(columns, estimates, strict=True):
        command_deg = np.rad2deg(record.command_rad[:, names.index(e.axis)])
        measured_deg, model_deg = np.rad2deg(e.measured_rad), np.rad2deg(e.model_rad)
        sent_s, time_s, from_s = record.command_time_s - start_s, e.time_s - start_s, _busiest_s(e) - start_s
        for ax in rows[:2]:
            ax.plot(sent_s, command_deg, label="command sent", color="0.55", lw=1.2, drawstyle="steps-post")
            ax.plot(time_s, measured_deg, label="measured", color="#E69F00", lw=3.6)
            fitted = "fitted model, from the commands alone"
            ax.plot(time_s, model_deg, label=fitted, color="#00405F", lw=1.2, ls=(0, (5, 1.5)))
            ax.set_ylabel("angle (deg)")
        rows[0].set(xlim=(0.0, time_s[-1]))
        rows[0].set_title(
            f"{e.axis}: dead time {e.dead_time_s.shown(1e3, 1)} ms\n"
            f"bandwidth {e.bandwidth_hz.shown(1.0, 2)} Hz, damping {e.damping_ratio.shown(1.0, 2)}, "
            f"fit {e.fit_percent:.1f} %",
            fontsize="medium",
        )
        rows[0].axvspan(from_s, from_s + _DETAIL_S, color="0.93", lw=0, zorder=0.5)
        rows[1].set(xlim=(from_s, from_s + _DETAIL_S), facecolor="0.97")
        rows[2].plot(time_s, measured_deg - model_deg, color="k", lw=0.7)
        rows[2].set(xlim=(0.0, time_s[-1]), xlabel="time (s)", ylabel="difference (deg)")
        for ax in rows:
            ax.grid(color="0.9", lw=0.6)
        rows[1].set_title(f"the shaded {_DETAIL_S:g} s in detail", loc="left", fontsize="small")
        rows[2].set_title(f"measured - model: RMS {e.residual_rms_deg:.3f} deg", loc="left", fontsize="small")
    handles = columns[0][0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(title, fontsize="medium")
    figure.savefig(path)


def _busiest_s(e: AxisEstimate) -> float:
    """Start of the interval with the most motion, seconds."""
    way = np.append(0.0, np.cumsum(np.abs(np.diff(e.model_rad))))
    last_s = max(float(e.time_s[-1]) - _DETAIL_S, float(e.time_s[0]))
    starts_s = e.time_s[e.time_s <= last_s]
    ways = np.interp(starts_s + _DETAIL_S, e.time_s, way) - way[: starts_s.size]
    return float(starts_s[int(np.argmax(ways))])
