"""Stability margins against model mismatch: gain, delay, natural frequency; disk margin by python-control."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gazempc.controllers.mpc.mpc import Mpc
from gazempc.errors import SettingsError
from gazempc.margins.linear_loop import ComplexArray, LinearLoop, Mismatch
from gazempc.neck.spec import AXES, NeckSpec
from gazempc.types import FloatArray

# Thresholds of warnings. A distance of 0.5 between L and -1, the customary minimum, implies a gain margin of 2 and a
# phase margin of 29 deg (Astrom & Murray 2021, Feedback Systems, section 10.3). Clocks and buses may delay a command by
# two control periods.
LEAST_DISTANCE, LEAST_DELAY_PERIODS = 0.5, 2.0
# Frequencies of the loop transfer up to the servo's Nyquist frequency, and factors of the natural frequency.
_POINTS, _POINTS_OF_CHECK, _LOWEST_RAD_S = 400, 100, 0.05
_FACTOR_MAX, _FACTOR_STEP, _BISECTIONS = 10.0, 1.15, 12
# Maximum number of states: with more (long dead time, high servo rate) the eigenvalues take seconds.
_MOST_STATES = 500


@dataclass(frozen=True)
class Margins:
    """Margins of one joint.

    Attributes:
        joint: Its name.
        poles: Closed-loop poles of a control period, in the z plane, shape (S,).
        period_s: Control period, seconds.
        omega_rad_s: Frequencies of the loop transfer, shape (F,), rad/s.
        loop: Loop transfer L at these, cut at the measured angle.
        gain: Gain margin, as a factor.
        gain_hz: Frequency of oscillation at the gain margin.
        phase_deg: Phase margin.
        delay_s: Delay margin: excess of the dead time over the model's at the stability boundary.
        shorter_s: The same for a shorter dead time; at most the dead time itself.
        disk: Disk margin, for simultaneous changes of gain and phase: largest factor, phase in degrees.
        peak_sensitivity: Largest |1 / (1 + L)|.
        frequency_factors: Stable range of the natural frequency as factors of the model's; 0 and infinite if no factor
            between 0.1 and 10 makes the loop unstable.
    """

    joint: str
    poles: ComplexArray
    period_s: float
    omega_rad_s: FloatArray
    loop: ComplexArray
    gain: float
    gain_hz: float
    phase_deg: float
    delay_s: float
    shorter_s: float
    disk: tuple[float, float]
    peak_sensitivity: float
    frequency_factors: tuple[float, float]

    @property
    def slowest_s(self) -> float:
        """Time constant of the slowest closed-loop pole, seconds; negative if the loop is unstable."""
        return -self.period_s / math.log(float(np.abs(self.poles).max()))

    @property
    def tolerance(self) -> str:
        """Tolerances of the neck file, as text."""
        low, high = self.frequency_factors
        lower = f"under {1.0 / _FACTOR_MAX:g}" if low == 0.0 else f"{low:.2f}"
        upper = f"over {_FACTOR_MAX:g}" if math.isinf(high) else f"{high:.2f}"
        return (
            f"dead time wrong by {-1e3 * self.shorter_s:.0f} to {1e3 * self.delay_s:+.0f} ms, "
            f"or natural frequency by a factor of {lower} to {upper}"
        )


def margins(mpc: Mpc) -> list[Margins]:
    """Margins of pan and of tilt.

    Args:
        mpc: The controller, with its neck.

    Returns:
        Margins of pan, then of tilt.

    Raises:
        SettingsError: If the dead time has too many servo periods.
    """
    pan = _of_joint(mpc, 0)
    # Without active limits the margins depend on the servo only.
    keys = ("natural_frequency_rad_s", "damping_ratio", "dead_time_s", "takes_speed")
    servos = {tuple(getattr(axis, key) for key in keys) for axis in mpc.neck.axes[:2]}
    alike = len(servos) == 1 and not any(ocp.own for ocp in mpc.ocps)
    return [pan, replace(pan, joint=AXES[1]) if alike else _of_joint(mpc, 1)]


def sentences(neck: NeckSpec, found: list[Margins]) -> list[str]:
    """Tolerances of pan and tilt in the neck file, as sentences; joints with equal tolerances share one."""
    joints: dict[str, list[str]] = {}
    for each in found:
        joints.setdefault(each.tolerance, []).append(each.joint)
    return [
        f"{neck.name}: {' and '.join(names)} {'stays' if len(names) == 1 else 'stay'} stable with {what}"
        for what, names in joints.items()
    ]


def too_small(mpc: Mpc) -> list[str]:
    """Warnings about margins below the thresholds; empty if there are none, or too many states to compute.

    Without python-control, whose import takes a second.
    """
    neck, found = mpc.neck, list[str]()
    if mpc.picture is not None:  # within the zone the camera rests: open loop
        return found
    for i, joint in enumerate(AXES):
        loop, late_s = LinearLoop(mpc, i), LEAST_DELAY_PERIODS * neck.control_period_s
        if loop.size > _MOST_STATES:
            continue
        distance = float(np.abs(1.0 + loop.response(_frequencies(neck, _POINTS_OF_CHECK))).min())
        if not _is_stable(loop):
            found.append(f"neck {neck.name!r}: {joint}: the loop of MPC and observer is unstable")
        elif distance < LEAST_DISTANCE:
            found.append(
                f"neck {neck.name!r}: {joint}: peak sensitivity {1.0 / distance:.2f}, at most "
                f"{1.0 / LEAST_DISTANCE:g} is wanted: small errors of the neck file may make it oscillate"
            )
        elif not _is_stable(LinearLoop(mpc, i, Mismatch(dead_time_s=late_s))):
            found.append(
                f"neck {neck.name!r}: {joint}: delay margin below {1e3 * late_s:.0f} ms: it oscillates if its dead "
                "time is longer by that"
            )
    return found


def _is_stable(loop: LinearLoop) -> bool:
    return float(np.abs(np.linalg.eigvals(loop.transition())).max()) < 1.0


def _frequencies(neck: NeckSpec, points: int) -> FloatArray:
    return np.asarray(np.geomspace(_LOWEST_RAD_S, math.pi / neck.servo_period_s, points, endpoint=False))


def _of_joint(mpc: Mpc, index: int) -> Margins:
    import control  # noqa: PLC0415  (a second of import)

    loop, axis, joint = LinearLoop(mpc, index), mpc.neck.axes[index], AXES[index]
    if loop.size > _MOST_STATES:
        raise SettingsError(
            f"neck {mpc.neck.name!r}: {joint}: dead_time_s {axis.dead_time_s:g} has {loop.size} servo periods; margins "
            f"are computed for at most {_MOST_STATES}"
        )
    omega = _frequencies(mpc.neck, _POINTS)
    response = loop.response(omega)
    gains, phases, _, gains_rad_s, crossings, _ = control.stability_margins(
        control.FRD(response, omega, smooth=True), returnall=True
    )
    above = [(float(gain), float(at)) for gain, at in zip(gains, gains_rad_s, strict=True) if gain > 1.0]
    gain, gain_rad_s = min(above, default=(math.inf, math.nan))
    lags = np.mod(np.deg2rad(phases), 2.0 * math.pi) / crossings
    # Seiler, Packard & Gahinet (2020), An introduction to disk margins: of S - T, for which both are symmetric.
    disk = 1.0 / float(np.abs(1.0 / (1.0 + response) - 0.5).max())

    def stable(error: Mismatch) -> bool:
        return _is_stable(LinearLoop(mpc, index, error))

    shorter = _first_unstable(lambda x: stable(Mismatch(dead_time_s=-x)), axis.dead_time_s, axis.dead_time_s / 10.0)
    steps = math.log(_FACTOR_MAX), math.log(_FACTOR_STEP)
    slower = _first_unstable(lambda x: stable(Mismatch(frequency=math.exp(-x))), *steps)
    faster = _first_unstable(lambda x: stable(Mismatch(frequency=math.exp(x))), *steps)
    return Margins(
        joint=joint,
        poles=np.asarray(np.linalg.eigvals(loop.transition()), dtype=np.complex128),
        period_s=loop.period_s,
        omega_rad_s=omega,
        loop=response,
        gain=gain,
        gain_hz=gain_rad_s / (2.0 * math.pi),
        phase_deg=float(np.min(np.mod(phases, 360.0), initial=180.0)),
        delay_s=float(np.min(lags, initial=math.inf)),
        shorter_s=min(shorter, axis.dead_time_s),
        disk=(
            (1.0 + 0.5 * disk) / (1.0 - 0.5 * disk) if disk < 2.0 else math.inf,
            2.0 * math.degrees(math.atan(0.5 * disk)),
        ),
        peak_sensitivity=1.0 / float(np.abs(1.0 + response).min()),
        frequency_factors=(math.exp(-slower), math.exp(faster)),
    )


def _first_unstable(stable: Callable[[float], bool], end: float, step: float) -> float:
    """Smallest error at which the loop is unstable, by a scan and bisection; infinite if stable up to the end."""
    low = 0.0
    while low < end:
        high = min(low + step, end)
        if not stable(high):
            for _ in range(_BISECTIONS):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if stable(middle) else (low, middle)
            return 0.5 * (low + high)
        low = high
    return math.inf
