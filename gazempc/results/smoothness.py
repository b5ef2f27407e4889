"""Smoothness of a movement from its speed: spectral arc length and log dimensionless jerk."""

from __future__ import annotations

import numpy as np

from gazempc.types import FloatArray


def sparc(
    speed: FloatArray, rate_hz: float, cutoff_hz: float = 10.0, threshold: float = 0.05, padding: int = 4
) -> float:
    """Spectral arc length of a speed profile; larger (less negative) is smoother.

    Balasubramanian, Melendez-Calderon, Roby-Brami & Burdet (2015), On the analysis of movement smoothness, eq. 9,
    with their parameters.

    Args:
        speed: Speed over time, shape (M,), any unit.
        rate_hz: Samples a second.
        cutoff_hz: Highest frequency that counts.
        threshold: Frequencies beyond the last one with this share of the peak do not count.
        padding: Zero padding, powers of two beyond the length.

    Returns:
        The arc length, negative; NaN if nothing moves.
    """
    points = 2 ** int(np.ceil(np.log2(speed.size)) + padding)
    spectrum = np.abs(np.fft.fft(speed, points))
    if spectrum.max() == 0.0:
        return float("nan")
    frequency_hz = np.arange(points) * rate_hz / points
    low = frequency_hz <= cutoff_hz
    amplitude = (spectrum / spectrum.max())[low]
    frequency_hz = frequency_hz[low]
    above = np.flatnonzero(amplitude >= threshold)
    used = slice(above[0], above[-1] + 1)
    amplitude, frequency_hz = amplitude[used], frequency_hz[used]
    if frequency_hz.size < 2:
        return float("nan")
    across = np.diff(frequency_hz) / (frequency_hz[-1] - frequency_hz[0])
    return -float(np.sum(np.sqrt(across**2 + np.diff(amplitude) ** 2)))


def log_dimensionless_jerk(speed: FloatArray, rate_hz: float) -> float:
    """Log dimensionless jerk of a speed profile; larger (less negative) is smoother.

    Balasubramanian et al. (2015), eq. 6: ``-ln(duration^3 / peak speed^2 * integral of (d2 speed / dt2)^2)``.

    Args:
        speed: Speed over time, shape (M,), any unit.
        rate_hz: Samples a second.

    Returns:
        The index; NaN if nothing moves or the speed has no curvature.
    """
    dt_s = 1.0 / rate_hz
    jerk = np.diff(speed, 2) / dt_s**2
    scale = (speed.size * dt_s) ** 3 / speed.max() ** 2 if speed.size and speed.max() > 0 else np.nan
    total = scale * np.sum(jerk**2) * dt_s
    return -float(np.log(total)) if total > 0 else float("nan")
