"""The person as the loop knows them: observations into the predictor, forecasts out of it, whatever it raises."""

from __future__ import annotations

import time

import numpy as np

from gazempc.loop.events import Event
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.tracker_faults import FrozenTracker, OrientationJumps
from gazempc.results.log import FORECAST_HORIZONS_S
from gazempc.settings import LoopSettings
from gazempc.types import FloatArray, Sighting
from predictors import Forecast, HeadObservation, OutOfOrderError, Predictor

# Two clocks that agree still differ by this much.
_CLOCK_TOLERANCE_S = 0.01
_RECORDED_HORIZONS_S = np.array(FORECAST_HORIZONS_S)


class PersonTrack:
    """Guards one predictor: what cannot be used is dropped, what it raises becomes an event.

    Args:
        predictor: Forecasts the head.
        settings: Ages at which observations and tracks are given up.

    Attributes:
        predictor: The predictor.
        newest: The newest observation that was used; None before the first one.
    """

    def __init__(self, predictor: Predictor, settings: LoopSettings) -> None:
        self.predictor = predictor
        self.newest: HeadObservation | None = None
        self._settings = settings
        self._tracker = FrozenTracker()
        self._jumps = OrientationJumps()

    @property
    def newest_capture_s(self) -> float | None:
        """Capture time of the newest observation that was used, seconds; None before the first one."""
        return None if self.newest is None else self.newest.capture_time_s

    def take_in(self, sighting: Sighting, time_s: float, recorder: LoopRecorder) -> None:
        """Take in an observation.

        Args:
            sighting: The observation and its arrival.
            time_s: The time, seconds.
            recorder: Records the observation and the forecast after it, or why it was dropped.
        """
        observation = sighting.observation
        if observation.capture_time_s > time_s + _CLOCK_TOLERANCE_S:
            # Taken in, it would make all later ones out of order.
            self._refuse(Event.FUTURE_OBSERVATION, time_s, recorder)
            return
        if time_s - observation.capture_time_s > self._settings.stale_after_s:
            self._refuse(Event.STALE_OBSERVATION, time_s, recorder)
            return
        was_frozen = self._tracker.frozen
        if self._tracker.see(sighting):
            recorder.refused(Event.TRACKER_FROZEN)
            if not was_frozen:
                recorder.event(time_s, Event.TRACKER_FROZEN)
            return
        observation, jumped = self._jumps.without(observation)
        if jumped:
            recorder.event(time_s, Event.ORIENTATION_JUMPED)
        newest_s = self.newest_capture_s
        started = time.perf_counter()
        try:
            lost = newest_s is not None and observation.capture_time_s - newest_s > self._settings.lost_after_s
            if lost or was_frozen:
                # A track carried on for so long would refuse the first frames, and the gaze follow it meanwhile. One
                # that was frozen ends with half a second of somebody who only seemed to stand.
                self.predictor.reset()
            self.predictor.update(observation)
        except OutOfOrderError:
            self._refuse(Event.OUT_OF_ORDER, time_s, recorder)
            return
        except Exception as error:
            self._refuse(Event.FORECAST_FAILED, time_s, recorder, error)
            return
        update_ms = 1e3 * (time.perf_counter() - started)
        self.newest = observation
        forecast = self.forecast(observation.capture_time_s + _RECORDED_HORIZONS_S, time_s, recorder)
        # A predictor that refuses detections may say so.
        gated = bool(getattr(self.predictor, "rejections_in_a_row", 0))
        if gated:
            self._refuse(Event.GATE_REFUSED, time_s, recorder)
        recorder.observation(time_s, observation, forecast, update_ms, used=not gated)

    @staticmethod
    def _refuse(event: Event, time_s: float, recorder: LoopRecorder, error: Exception | None = None) -> None:
        recorder.refused(event)
        recorder.event(time_s, event, error)

    def forecast(self, times_s: FloatArray, time_s: float, recorder: LoopRecorder) -> Forecast | None:
        """Ask for a forecast.

        Args:
            times_s: Times to forecast, shape (H,), seconds.
            time_s: The time, seconds.
            recorder: Records why there is none.

        Returns:
            The forecast; None if the predictor has none that can be used.
        """
        try:
            forecast = self.predictor.forecast(times_s)
            if not isinstance(forecast, Forecast):
                raise TypeError(f"forecast() returned {type(forecast).__name__}, needed is a Forecast")
            if forecast.times_s.size != times_s.size:
                raise ValueError(f"forecast() returned {forecast.times_s.size} times, asked for were {times_s.size}")
            # An infinite variance is an honest answer; a NaN is none.
            if np.isfinite(forecast.means_base_m).all() and not np.isnan(forecast.covariances_m2).any():
                return forecast
            problem = ValueError("forecast() returned positions that are not finite, or covariances with a NaN")
            recorder.event(time_s, Event.FORECAST_FAILED, problem)
            # A filter that holds a NaN holds it for ever: the next observation starts a new track.
            self.predictor.reset()
        except Exception as error:
            recorder.event(time_s, Event.FORECAST_FAILED, error)
        return None
