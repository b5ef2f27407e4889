"""What a sensor saw of a walk, and what was forecast from it at some instants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gazempc.errors import SettingsError
from gazempc.recordings.recording import Recording
from gazempc.recordings.truth import TrueHead
from gazempc.results.forecast_metrics import squared_radius
from gazempc.results.log import FORECAST_HORIZONS_S
from gazempc.sim.sensor import SensorSpec, observe
from gazempc.types import FloatArray
from predictors import Predictor

SHARE = 0.95


@dataclass(frozen=True)
class Instant:
    """What is forecast at one instant, seen from above.

    Attributes:
        now_s: The instant, seconds.
        means_base_m: Forecast for `FORECAST_HORIZONS_S` from now, shape (3, 2), metres: x, y.
        covariances_m2: Its covariances, shape (3, 2, 2), square metres.
        radius: Half axes of the ellipse that should hold `SHARE` of the errors, in standard deviations.
        true_base_m: Where the head then was, shape (3, 2), metres; NaN where that is not known.
    """

    now_s: float
    means_base_m: FloatArray
    covariances_m2: FloatArray
    radius: float
    true_base_m: FloatArray


@dataclass(frozen=True)
class SeenWalk:
    """What one sensor saw of a walk.

    Attributes:
        sensor: Its name.
        walk: The walk, in the base frame.
        truth: The true head of it.
        capture_s: Capture times of what arrived in order, shape (F,), seconds.
        observed_base_m: The heads that were seen, shape (F, 3), metres.
        instants: The forecasts.
    """

    sensor: str
    walk: Recording
    truth: TrueHead
    capture_s: FloatArray
    observed_base_m: FloatArray
    instants: tuple[Instant, ...]

    def error_rms_mm(self) -> tuple[float, float]:
        """RMS error of the seen heads along the line of sight, and on an axis across it, millimetres."""
        true_m = self.truth(self.capture_s)
        error_m = self.observed_base_m - true_m
        sight = true_m / np.linalg.norm(true_m, axis=1, keepdims=True)
        along_m = np.sum(error_m * sight, axis=1)
        across_m = error_m - along_m[:, None] * sight
        mean_m2 = np.mean(along_m**2), 0.5 * np.mean(np.sum(across_m**2, axis=1))
        return 1e3 * float(np.sqrt(mean_m2[0])), 1e3 * float(np.sqrt(mean_m2[1]))


def see(walk: Recording, sensor: SensorSpec, predictor: Predictor, instants_s: Sequence[float], seed: int) -> SeenWalk:
    """See a walk through a sensor, and forecast from what has arrived by some instants.

    Args:
        walk: The walk, in the base frame.
        sensor: The sensor.
        predictor: Forecasts; reset first.
        instants_s: The instants in rising order, seconds.
        seed: Seed of the sensor's errors.

    Returns:
        What was seen and forecast.

    Raises:
        SettingsError: If no observation had arrived by an instant.
    """
    predictor.reset()
    truth = TrueHead(walk)
    capture_s: list[float] = []
    heads_m: list[FloatArray] = []
    found: list[Instant] = []
    waiting = list(instants_s)
    for sighting in observe(walk, sensor, seed):
        while waiting and sighting.arrival_s > waiting[0]:
            found.append(_forecast(predictor, truth, waiting.pop(0), sensor.name, bool(capture_s)))
        observation = sighting.observation
        if capture_s and observation.capture_time_s <= capture_s[-1]:
            continue  # overtaken by a newer one; the loop drops it, too
        predictor.update(observation)
        capture_s.append(observation.capture_time_s)
        heads_m.append(observation.head_position_base_m)
    found += [_forecast(predictor, truth, at_s, sensor.name, seen=True) for at_s in waiting]
    return SeenWalk(sensor.name, walk, truth, np.array(capture_s), np.array(heads_m), tuple(found))


def _forecast(predictor: Predictor, truth: TrueHead, now_s: float, sensor: str, seen: bool) -> Instant:
    if not seen:
        raise SettingsError(f"--at-s {now_s:g}: sensor {sensor!r} had no observation yet; use a later instant")
    times_s = now_s + np.array(FORECAST_HORIZONS_S)
    forecast = predictor.forecast(times_s)
    true_m = truth(times_s)
    true_m[~truth.known(times_s)] = np.nan
    return Instant(
        now_s=now_s,
        means_base_m=forecast.means_base_m[:, :2],
        covariances_m2=forecast.covariances_m2[:, :2, :2],
        radius=float(np.sqrt(squared_radius(forecast.degrees_of_freedom, SHARE, axes=2))),
        true_base_m=true_m[:, :2],
    )
