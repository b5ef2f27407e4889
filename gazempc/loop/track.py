"""Single-person target: updates a predictor, and converts its exceptions to events."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Protocol

import numpy as np

from gazempc.loop.boundary import PartError, boundary, checked_forecast
from gazempc.loop.events import Event
from gazempc.loop.recorder import LoopRecorder
from gazempc.people.tracker_faults import FrozenTracker, OrientationJumps, TrackStart
from gazempc.results.log import FORECAST_HORIZONS_S
from gazempc.settings import LoopSettings
from gazempc.types import CameraView, FloatArray, Sighting
from predictors import Forecast, HeadObservation, OutOfOrderError, Predictor

# Tolerance of clock synchronisation.
_CLOCK_TOLERANCE_S = 0.01
RECORDED_HORIZONS_S = np.array(FORECAST_HORIZONS_S)


class Target(Protocol):
    """The person to look at: a single person, or the attended one of several."""

    @property
    def predictor(self) -> Predictor:
        """A predictor of a person, for the warm-up of the loop."""

    @property
    def newest_capture_s(self) -> float | None:
        """Capture time of the newest observation of the person to look at, seconds; None before the first one."""

    @property
    def newest(self) -> HeadObservation | None:
        """The newest observation passed to the predictor, also if its gate rejected it; None before the first one."""

    def assimilate(self, sightings: Iterable[Sighting], time_s: float, recorder: LoopRecorder) -> None:
        """Process the observations that have arrived since the last tick; called at every tick.

        Args:
            sightings: Observations with arrival times.
            time_s: The time, seconds.
            recorder: Records used observations with forecasts, and refused ones with the reason.
        """

    def forecast(self, times_s: FloatArray, time_s: float, recorder: LoopRecorder) -> Forecast | None:
        """Forecast the gaze target.

        Args:
            times_s: Times to forecast, shape (H,), seconds.
            time_s: The time, seconds.
            recorder: Records the reason of a failure.

        Returns:
            The forecast; None after a failure.
        """


class AroundTarget:
    """Base class of targets that wrap another one.

    Args:
        target: The wrapped target.
    """

    def __init__(self, target: Target) -> None:
        self._target = target

    @property
    def predictor(self) -> Predictor:
        """See `gazempc.loop.track.Target`."""
        return self._target.predictor

    @property
    def newest(self) -> HeadObservation | None:
        """See `gazempc.loop.track.Target`."""
        return self._target.newest

    @property
    def newest_capture_s(self) -> float | None:
        """See `gazempc.loop.track.Target`."""
        return self._target.newest_capture_s

    def forecast(self, times_s: FloatArray, time_s: float, recorder: LoopRecorder) -> Forecast | None:
        """See `gazempc.loop.track.Target.forecast`."""
        return self._target.forecast(times_s, time_s, recorder)


class PersonTrack:
    """Guards one predictor: refuses invalid observations, and converts exceptions to events.

    Args:
        predictor: Forecasts the head.
        settings: Maximum ages of observations and tracks.

    Attributes:
        predictor: The predictor.
        newest: See `Target`.
        newest_capture_s: See `Target`.
    """

    def __init__(self, predictor: Predictor, settings: LoopSettings) -> None:
        self.predictor = predictor
        self.newest: HeadObservation | None = None
        self.newest_capture_s: float | None = None
        self._settings = settings
        self._view: CameraView | None = None
        self._start = TrackStart(predictor)
        self._tracker = FrozenTracker()
        self._jumps = OrientationJumps()

    def assimilate(self, sightings: Iterable[Sighting], time_s: float, recorder: LoopRecorder) -> None:
        """See `Target.assimilate`."""
        for sighting in sightings:
            self._view = sighting.view
            self._take_one(sighting, time_s, recorder)

    def _take_one(self, sighting: Sighting, time_s: float, recorder: LoopRecorder) -> None:
        unusable = why_not_usable(sighting, time_s, self._settings)
        if unusable is not None:
            recorder.refuse(unusable, time_s)
            return
        observation = sighting.observation
        was_frozen = self._tracker.frozen
        if self._tracker.observe(sighting):
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
            with boundary(self.predictor, "update"):
                lost = newest_s is not None and observation.capture_time_s - newest_s > self._settings.lost_after_s
                if lost or (was_frozen and not self._tracker.frozen):
                    # A track extrapolated for so long would refuse the first frames, while the gaze follows it. A
                    # frozen track ends with half a second of repeated frames, a false standstill.
                    self._start.reset()
                self._start.update(observation)
                # Optional attribute of a predictor with a gate.
                gated = bool(getattr(self.predictor, "rejections_in_a_row", 0))
        except PartError as failed:
            if isinstance(failed.error, OutOfOrderError):
                recorder.refuse(Event.OUT_OF_ORDER, time_s)
            else:
                recorder.refuse(Event.FORECAST_FAILED, time_s, failed)
            return
        update_ms = 1e3 * (time.perf_counter() - started)
        if newest_s is not None and observation.capture_time_s < newest_s:
            # No forecast from its capture time, which would use later frames.
            recorder.observation(time_s, observation, None, update_ms)
            return
        self.newest, self.newest_capture_s = observation, observation.capture_time_s
        forecast = self.forecast(observation.capture_time_s + RECORDED_HORIZONS_S, time_s, recorder)
        if gated:
            recorder.refuse(Event.GATE_REFUSED, time_s)
        recorder.observation(time_s, observation, forecast, update_ms, used=not gated)

    def forecast(self, times_s: FloatArray, time_s: float, recorder: LoopRecorder) -> Forecast | None:
        """See `Target.forecast`."""
        return forecast_of(self.predictor, self.predictor.forecast, self._start, self._view, times_s, time_s, recorder)


def why_not_usable(sighting: Sighting, time_s: float, settings: LoopSettings) -> Event | None:
    """Check the time stamp of an observation.

    Args:
        sighting: The observation with its arrival time.
        time_s: The time, seconds.
        settings: Maximum age of observations.

    Returns:
        The reason of refusal; None for a valid observation.
    """
    captured_s = sighting.observation.capture_time_s
    if captured_s > time_s + _CLOCK_TOLERANCE_S:
        # Accepted, it would make all later ones out of order.
        return Event.FUTURE_OBSERVATION
    return Event.STALE_OBSERVATION if time_s - captured_s > settings.stale_after_s else None


def forecast_of(
    predictor: Predictor,
    ask: Callable[[FloatArray], Forecast],
    start: TrackStart,
    view: CameraView | None,
    times_s: FloatArray,
    time_s: float,
    recorder: LoopRecorder,
) -> Forecast | None:
    """Call a predictor for a forecast; faults become events.

    Args:
        predictor: The predictor.
        ask: Maps times to a forecast.
        start: The predictor's track, which clamps the forecast to the reach of the person.
        view: The last picture of the person; None if unknown.
        times_s: Times to forecast, shape (H,), seconds.
        time_s: The time, seconds.
        recorder: Records the reason of a failure, and clamping.

    Returns:
        The forecast; None after a failure.
    """
    forecast: Forecast | None = None
    with boundary(predictor, "forecast", partial(recorder.event, time_s, Event.FORECAST_FAILED)):
        answered = ask(times_s)
        try:
            forecast = checked_forecast(answered, times_s.size)
        except ValueError:
            # NaN persists in the state of a filter: the next observation starts a new track.
            start.reset()
            raise
    if forecast is None:
        return None
    within, left = start.within_reach(forecast)
    if view is not None:
        bounded_m = view.bounded(within.means_base_m)
        if not np.allclose(bounded_m, within.means_base_m, rtol=0.0, atol=1e-6):
            within, left = replace(within, means_base_m=bounded_m), True
    if left:
        recorder.event(time_s, Event.FORECAST_OUT_OF_REACH)
    return within
