"""The person of the fault runs: walks to and fro across the robot's view, at any time."""

from __future__ import annotations

import numpy as np

from gazempc.types import FloatArray

_RANGE_M, _HALF_WAY_M, _PERIOD_S = 2.5, 1.2, 6.0


def head_m(times_s: FloatArray) -> FloatArray:
    """Where the head is in the base frame.

    Args:
        times_s: Times of any clock, shape (H,), seconds.

    Returns:
        Shape (H, 3), metres.
    """
    phase = 2.0 * np.pi * np.asarray(times_s) / _PERIOD_S
    return np.stack(
        [_RANGE_M + 0.3 * np.sin(0.5 * phase), _HALF_WAY_M * np.sin(phase), 0.4 + 0.0 * phase],
        axis=-1,
    )
