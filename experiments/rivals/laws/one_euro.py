"""The one-euro filter (Casiez, Roussel, Vogel 2012): a low-pass that opens where its input moves fast."""

from __future__ import annotations

import math

import numpy as np

from gazempc.types import FloatArray


class OneEuro:
    """Filters an array, each entry by itself.

    Args:
        least_cutoff_hz: Cutoff while the input stands.
        beta: By how much the cutoff rises with the input's speed, in hertz for a unit a second.
        speed_cutoff_hz: Cutoff of the low-pass on that speed.
    """

    def __init__(self, least_cutoff_hz: float, beta: float, speed_cutoff_hz: float) -> None:
        self._least_cutoff_hz, self._beta, self._speed_cutoff_hz = least_cutoff_hz, beta, speed_cutoff_hz
        self.reset()

    def reset(self) -> None:
        """Take the next input as it is."""
        self._value: FloatArray | None = None
        self._input: FloatArray | None = None

    def update(self, value: FloatArray, dt_s: float) -> FloatArray:
        """The filtered value, of the input's shape; `dt_s` is the time since the last one, seconds."""
        if self._value is None or self._input is None:
            self._value, self._speed = value, np.zeros_like(value)
        else:
            speed = (value - self._input) / dt_s
            self._speed = self._speed + _share(np.asarray(self._speed_cutoff_hz), dt_s) * (speed - self._speed)
            cutoff_hz = self._least_cutoff_hz + self._beta * np.abs(self._speed)
            self._value = self._value + _share(cutoff_hz, dt_s) * (value - self._value)
        self._input = value
        return self._value


def _share(cutoff_hz: FloatArray, dt_s: float) -> FloatArray:
    step = 2.0 * math.pi * cutoff_hz * dt_s
    return step / (step + 1.0)
