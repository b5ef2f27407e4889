"""Validated data of one axis on one clock; rejected if dead time and servo are not identifiable."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from gazempc.identify.record import IdentificationError, NeckRecord
from gazempc.types import FloatArray

FEWEST_READINGS = 60
_SHORTEST_S = 3.0
_LEAST_COMMAND_DEG = 2.0
_LEAST_FOLLOWED = 0.2
_MOST_MISREAD = 0.05
# Outlier threshold: distance from both neighbours in addition to the joint's reach between them.
_MISREAD_RAD = math.radians(5.0)


@dataclass(frozen=True)
class AxisData:
    """One joint of a record, with finite values at increasing times.

    Attributes:
        command_time_s: Send times of the commands, shape (K,), seconds.
        command_rad: Shape (K,), radians.
        time_s: Measurement times, shape (N,), seconds.
        measured_rad: Shape (N,), radians.
        misread: Number of removed outliers.
    """

    command_time_s: FloatArray
    command_rad: FloatArray
    time_s: FloatArray
    measured_rad: FloatArray
    misread: int


def prepare_axis(record: NeckRecord, index: int) -> AxisData:
    """Extract one axis from a record.

    Args:
        record: Commands and angles.
        index: Index of the joint in `NeckSpec.joint_names`.

    Returns:
        Valid data of the axis.

    Raises:
        IdentificationError: If the data are insufficient.
    """
    neck = record.neck()
    name, axis = neck.joint_names[index], neck.axes[index]

    def refuse(problem: str, advice: str) -> IdentificationError:
        return IdentificationError(f"{name}: {problem}: {advice}")

    reported, failed = record.joint_time_s.size, record.failed_reads
    if reported == 0:
        raise refuse(f"there are no readings of the joints ({failed} reads failed)", "check the robot's connection")
    command_time_s, command = _advancing(record.command_time_s, record.command_rad[:, index])
    time_s, measured = _advancing(record.joint_time_s, record.joint_rad[:, index])
    if (stamps := time_s.size) < FEWEST_READINGS:
        needed = f"at least {FEWEST_READINGS} are needed"
        raise refuse(f"{reported} readings with {stamps} different time stamps; {needed}", "record longer")
    span_s = min(time_s[-1], command_time_s[-1]) - max(time_s[0], command_time_s[0])
    if span_s < _SHORTEST_S:
        shared = f"commands and angles share {max(span_s, 0.0):.1f} s; at least {_SHORTEST_S:g} s are needed"
        raise refuse(shared, "record longer, with time stamps of one clock")
    inside = (time_s >= command_time_s[0]) & (time_s <= command_time_s[-1] + 1.0)
    time_s, measured = time_s[inside], measured[inside]
    command_deg = float(np.rad2deg(np.ptp(command)))
    if command_deg < _LEAST_COMMAND_DEG:
        moves = f"its command moves over {command_deg:.2f} deg; at least {_LEAST_COMMAND_DEG:g} deg are needed"
        raise refuse(moves, "move it more (--amplitude-deg), or leave it out with --axes")
    # Failed readings often come as a fixed angle far away, such as -180 deg.
    reach = 2.0 * axis.velocity_max_rad_s * float(np.percentile(np.diff(time_s), 95))
    wild = np.abs(measured - median_filter(measured, size=5, mode="nearest")) > _MISREAD_RAD + reach
    if (share := wild.mean()) > _MOST_MISREAD:
        raise refuse(f"{100 * share:.0f} % of the readings are implausible jumps", "check the encoder and its unit")
    time_s, measured = time_s[~wild], measured[~wild]
    moved_deg = float(np.rad2deg(np.ptp(np.percentile(measured, (1, 99)))))
    if moved_deg < _LEAST_FOLLOWED * command_deg:
        moves = f"the command moved over {command_deg:.1f} deg, the joint over {moved_deg:.1f} deg"
        raise refuse(moves, "check that its motor is on, and that the angles are in radians and of this axis")
    return AxisData(command_time_s, command, time_s, measured, int(wild.sum()))


def _advancing(time_s: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Finite rows at strictly increasing times; a robot may repeat a reading."""
    finite = np.isfinite(time_s) & np.isfinite(value)
    time_s, value = time_s[finite], value[finite]
    newest = np.maximum.accumulate(time_s) if time_s.size else time_s
    new = np.append(True, time_s[1:] > newest[:-1] + 1e-6)[: time_s.size]
    return time_s[new], value[new]
