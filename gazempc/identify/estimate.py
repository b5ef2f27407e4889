"""Estimation of dead time and servo of one axis from a record, with 95 % confidence intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from gazempc.identify.record import IdentificationError, NeckRecord
from gazempc.identify.servo_fit import Z_95, Fit, ServoModel, fit
from gazempc.types import FloatArray

# Requirements of the data.
_FEWEST_READINGS = 60
_SHORTEST_S = 3.0
_LEAST_COMMAND_DEG = 2.0
# Minimum fit and maximum half widths of the confidence intervals of a reliable result.
_LEAST_FIT_PERCENT = 80.0
_WIDEST_MS, _WIDEST_PERCENT = 20.0, 25.0  # of dead time and bandwidth
# Numerical precision of the model: lower bound of the width of intervals.
_NARROWEST_S = 1e-4

_SCAN_STEP_S = 0.02
_SCAN_DAMPING = 0.8


@dataclass(frozen=True)
class Interval:
    """An estimate and its 95 % confidence interval."""

    value: float
    low: float
    high: float

    @property
    def half_width(self) -> float:
        """The larger distance from the estimate to an end."""
        return max(self.high - self.value, self.value - self.low)

    @staticmethod
    def around(value: float, half_width: float) -> Interval:
        """A symmetric interval."""
        return Interval(float(value), float(value - half_width), float(value + half_width))

    def shown(self, factor: float, digits: int) -> str:
        """Estimate and half width, multiplied by `factor` for the unit, such as ``400.0 ± 0.1``."""
        # At least one unit of the last digit: a rounded half width of 0 would mean certainty.
        half = max(factor * self.half_width, 10.0**-digits)
        return f"{factor * self.value:.{digits}f} ± {half:.{digits}f}"


@dataclass(frozen=True)
class AxisEstimate:
    """Estimate of one axis.

    Attributes:
        axis: Name of the joint, one of `NeckSpec.joint_names`.
        dead_time_s: From sending a command to its first effect, seconds; includes any delay of the angles' time stamps.
        natural_frequency_rad_s: wn of the servo.
        damping_ratio: zeta of the servo.
        bandwidth_hz: -3 dB bandwidth of the servo.
        servo_lag_s: 2 zeta / wn, seconds.
        offset_rad: Steady-state error, radians.
        fit_percent: 100 (1 - |measured - model| / |measured - mean|).
        residual_rms_deg: RMS of measured - model.
        structured_rms_deg: Its part with correlation in time, without white encoder noise.
        misread: Number of removed outliers.
        time_s: Measurement times, shape (N,), seconds.
        measured_rad: The angles, shape (N,), radians.
        model_rad: The fitted model, shape (N,), radians.
        doubts: Reasons not to use the result, each with figures and advice; empty for a reliable result.
    """

    axis: str
    dead_time_s: Interval
    natural_frequency_rad_s: Interval
    damping_ratio: Interval
    bandwidth_hz: Interval
    servo_lag_s: Interval
    offset_rad: float
    fit_percent: float
    residual_rms_deg: float
    structured_rms_deg: float
    misread: int
    time_s: FloatArray
    measured_rad: FloatArray
    model_rad: FloatArray
    doubts: tuple[str, ...]

    @property
    def note(self) -> str:
        """Warning about the result; empty if there is none."""
        # Structure of the residual due to quantisation by an encoder of 4096 steps.
        if self.structured_rms_deg < 0.1:
            return ""
        return (
            f"{self.axis}: {self.structured_rms_deg:.2f} deg of the residual are correlated in time\n"
            "  (friction, play, a motor at its limit): a second-order servo does not model it,\n"
            "  and the true values may lie outside the intervals; "
            "inspect the figure, and try another --amplitude-deg"
        )


def bandwidth_hz(natural_frequency_rad_s: float, damping_ratio: float) -> float:
    """-3 dB bandwidth of a second-order servo, Hz."""
    a = 1.0 - 2.0 * damping_ratio**2
    return natural_frequency_rad_s * math.sqrt(a + math.sqrt(a * a + 1.0)) / (2.0 * math.pi)


def estimate_axis(record: NeckRecord, index: int, dead_time_max_s: float = 1.5) -> AxisEstimate:
    """Fit dead time, natural frequency and damping of one axis to a record.

    Output-error method: least squares of the simulated response to the commands. Offset and initial state are
    eliminated by linear least squares at each step (variable projection); the three others are found by
    `scipy.optimize.least_squares`, started from a scan over dead times and bandwidths.

    Args:
        record: Commands and angles.
        index: Index of the joint in `NeckSpec.joint_names`.
        dead_time_max_s: Upper bound of the dead time, seconds.

    Returns:
        The estimate, with `doubts` about its reliability.

    Raises:
        IdentificationError: If the data are insufficient.
    """
    name = record.neck().joint_names[index]
    command_time_s, command, time_s, measured, misread = _prepare_axis(record, index)
    # About 1000 readings suffice.
    thinned = slice(None, None, max(1, time_s.size // 1000))
    starts = _scan(ServoModel(command_time_s, command, time_s[thinned]), measured[thinned], dead_time_max_s)
    # Unknown commands before the record act until one dead time after its first command.
    known = time_s >= command_time_s[0] + min(starts[0][0] + 0.05, dead_time_max_s)
    time_s, measured = time_s[known], measured[known]
    if time_s.size < _FEWEST_READINGS or float(np.ptp(measured)) < 1e-9:
        raise IdentificationError(f"{name}: too few readings after the first command can have acted: record longer")
    model = ServoModel(command_time_s, command, time_s)

    def fitted_to(values: FloatArray) -> tuple[FloatArray, float]:
        wn, zeta = math.exp(values[1]), math.exp(values[2])
        answer = model.delayed(model.motion(wn, zeta), float(values[0]))
        columns = np.column_stack([np.ones(time_s.size), model.free(wn, zeta)])
        # The free response of a fast servo decays within a few readings: its columns may be nearly zero.
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-9)
        weights = np.linalg.lstsq(columns / size, measured - answer, rcond=1e-6)[0] / size
        return answer + columns @ weights, float(weights[0])

    # Negative dead times are allowed in the fit, for an unbiased estimate of zero.
    low, high = (-0.1, math.log(0.5), math.log(0.101)), (dead_time_max_s, math.log(300.0), math.log(9.99))
    best = fit(lambda values: np.rad2deg(measured - fitted_to(values)[0]), starts, low, high)
    fitted, offset_rad = fitted_to(best.values)
    # Second differences have six times the variance of white noise, and suppress slow changes.
    error_deg2, noise_deg2 = float(np.mean(best.residual**2)), float(np.mean(np.diff(best.residual, 2) ** 2)) / 6.0
    estimate = AxisEstimate(
        axis=name,
        **_intervals(best),
        offset_rad=offset_rad,
        fit_percent=100.0 * (1.0 - math.sqrt(error_deg2 / float(np.var(np.rad2deg(measured))))),
        residual_rms_deg=math.sqrt(error_deg2),
        structured_rms_deg=math.sqrt(max(error_deg2 - noise_deg2, 0.0)),
        misread=misread,
        time_s=time_s,
        measured_rad=measured,
        model_rad=fitted,
        doubts=(),
    )
    ends_s = (max(end_s, 0.0) for end_s in astuple(estimate.dead_time_s))
    return replace(estimate, doubts=_doubts(estimate, best.values, low, high), dead_time_s=Interval(*ends_s))


def _scan(model: ServoModel, measured: FloatArray, dead_time_max_s: float) -> list[tuple[float, float, float]]:
    """Initial values of the fit, best first.

    Cross-correlation of the measured motion with the responses of servos of several bandwidths, at all lags; only local
    maxima over the dead time are used.
    """
    lags_s = np.arange(0.0, dead_time_max_s, _SCAN_STEP_S)
    found: list[tuple[float, tuple[float, float, float]]] = []
    for wn in (4.0, 8.0, 15.0, 30.0, 60.0):
        motion = model.motion(wn, _SCAN_DAMPING)
        # The variance is independent of constant offsets.
        errors = np.array([np.var(measured - model.delayed(motion, float(lag_s))) for lag_s in lags_s])
        padded = np.pad(errors, 1, constant_values=np.inf)
        for i in np.flatnonzero((errors <= padded[:-2]) & (errors <= padded[2:])):
            found.append((float(errors[i]), (float(lags_s[i]), math.log(wn), math.log(_SCAN_DAMPING))))
    starts: list[tuple[float, float, float]] = []
    for error, start in sorted(found):
        # A faster servo with a longer dead time is nearly equivalent: the fit converges from one to the other.
        distinct = all(abs(start[0] - other[0]) > 0.15 for other in starts)
        if distinct and error <= 3.0 * min(found)[0] and len(starts) < 3:
            starts.append(start)
    return starts


def _intervals(best: Fit) -> dict[str, Interval]:
    """Intervals by field of `AxisEstimate`; on a log scale except for the dead time."""
    dead_time_s, log_wn, log_zeta = map(float, best.values)
    half_s = max(Z_95 * math.sqrt(best.covariance[0, 0]), _NARROWEST_S)
    wn, zeta = math.exp(log_wn), math.exp(log_zeta)
    step = 1e-5
    slope = math.log(bandwidth_hz(wn, zeta * math.exp(step)) / bandwidth_hz(wn, zeta * math.exp(-step))) / (2 * step)
    found = {"dead_time_s": Interval.around(dead_time_s, half_s)}
    for name, value, gradient in (
        ("natural_frequency_rad_s", wn, (1.0, 0.0)),
        ("damping_ratio", zeta, (0.0, 1.0)),
        ("bandwidth_hz", bandwidth_hz(wn, zeta), (1.0, slope)),
        ("servo_lag_s", 2 * zeta / wn, (-1.0, 1.0)),
    ):
        variance = float(np.array(gradient) @ best.covariance[1:, 1:] @ np.array(gradient))
        # At least the numerical precision of the model; bounded, to avoid overflow of the exponential.
        half = min(max(Z_95 * math.sqrt(max(variance, 0.0)), 1e-3), 50.0)
        found[name] = Interval(value, value * math.exp(-half), value * math.exp(half))
    return found


def _doubts(estimate: AxisEstimate, values: FloatArray, low: Sequence[float], high: Sequence[float]) -> tuple[str, ...]:
    dead_time, bandwidth = estimate.dead_time_s, estimate.bandwidth_hz
    more = "move more (--amplitude-deg) or longer (--duration-s)"
    clocks = "check that commands and angles have time stamps of one clock"
    width_ms, width_percent = 1e3 * dead_time.half_width, 100.0 * bandwidth.half_width / bandwidth.value
    found = []
    if estimate.fit_percent < _LEAST_FIT_PERCENT:
        found.append(
            f"the model explains {estimate.fit_percent:.1f} % of the motion; at least {_LEAST_FIT_PERCENT:g} % are "
            "needed: inspect the figure; the joint may be obstructed, too slow for its commands or not a second-order "
            "servo"
        )
    widths = (("dead time", width_ms, _WIDEST_MS, "ms"), ("bandwidth", width_percent, _WIDEST_PERCENT, "%"))
    for what, width, widest, unit in widths:
        if width > widest:
            found.append(f"the {what} is uncertain by +-{width:.0f} {unit}; +-{widest:g} {unit} are needed: {more}")
    for i, label in enumerate(("dead time", "natural frequency", "damping ratio")):
        for bound in (low[i], high[i]):
            if abs(values[i] - bound) < 1e-3:
                end = f"{1e3 * bound:.4g} ms" if i == 0 else f"{math.exp(bound):.4g}"
                advice = "the joint may be obstructed" if i else f"allow more (--dead-time-max-s), or {clocks}"
                found.append(f"the {label} is at the bound of the search ({end}): {advice}")
    if dead_time.high < -_NARROWEST_S:
        found.append(f"the joint moves {-1e3 * dead_time.value:.1f} ms before its commands: {clocks}")
    return tuple(f"{estimate.axis}: {doubt}" for doubt in found)


def _prepare_axis(record: NeckRecord, index: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, int]:
    """Extract one axis from a record: finite values at increasing times.

    Args:
        record: Commands and angles.
        index: Index of the joint.

    Returns:
        Send times of the commands and commands, shape (K,), measurement times and angles, shape (N,), seconds and
        radians; number of removed outliers.

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
    if (stamps := time_s.size) < _FEWEST_READINGS:
        needed = f"at least {_FEWEST_READINGS} are needed"
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
    # Outlier threshold: distance from both neighbours in addition to the joint's reach between them.
    wild = np.abs(measured - median_filter(measured, size=5, mode="nearest")) > math.radians(5.0) + reach
    if (share := wild.mean()) > 0.05:
        raise refuse(f"{100 * share:.0f} % of the readings are implausible jumps", "check the encoder and its unit")
    time_s, measured = time_s[~wild], measured[~wild]
    moved_deg = float(np.rad2deg(np.ptp(np.percentile(measured, (1, 99)))))
    if moved_deg < 0.2 * command_deg:
        moves = f"the command moved over {command_deg:.1f} deg, the joint over {moved_deg:.1f} deg"
        raise refuse(moves, "check that its motor is on, and that the angles are in radians and of this axis")
    return command_time_s, command, time_s, measured, int(wild.sum())


def _advancing(time_s: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Finite rows at strictly increasing times; a robot may repeat a reading."""
    finite = np.isfinite(time_s) & np.isfinite(value)
    time_s, value = time_s[finite], value[finite]
    newest = np.maximum.accumulate(time_s) if time_s.size else time_s
    new = np.append(True, time_s[1:] > newest[:-1] + 1e-6)[: time_s.size]
    return time_s[new], value[new]
