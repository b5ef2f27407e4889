"""Gating of detections, track management, and the part of a Kalman filter that is common to all motion models."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TypeVar

import numpy as np
from scipy.special import chdtri

from predictors.geometry import mahalanobis2
from predictors.predictor import NotReadyError, check_newer, noise_m2
from predictors.types import FloatArray, HeadObservation, check_positive

AnyTime = TypeVar("AnyTime", float, FloatArray)
_NOTHING_M2 = np.zeros((3, 3))

# An innovation beyond this quantile is a false detection (another person, a reflection).
_GATE_PROBABILITY = 0.999
# Quantile of chi-square with 3 degrees of freedom; importing `scipy.stats` for it takes half a second.
GATE_D2 = float(chdtri(3, 1.0 - _GATE_PROBABILITY))
# Manoeuvre noise: turning and braking exceed the innovation covariance of a constant-velocity filter. At the edge of
# the gate, four standard deviations, this is 5 m/s^2: a turn of 0.5 m radius at 1.6 m/s, or a stop within 0.3 s. The
# filter's velocity lags by about 0.2 s, which counts as time since the last accepted frame. With less, jumps of 0.1 m
# of street trackers were rejected, and forecasts at 0.25 s were 1 % worse.
_MANOEUVRE_SD_M_S2, _FILTER_LAG_S = 1.25, 0.2
# Time constant of the measured innovation covariance; the bound of the gain is active at low frame rates.
_INNOVATION_TIME_S, _LARGEST_GAIN = 0.3, 0.2
# Degrees of freedom of the robust t weights (Lange, Little & Taylor 1989): the influence of an outlier is bounded by
# `_T_DEGREES + 3` innovations of one standard deviation.
_T_DEGREES = 3.0
# Association of rejected detections to a candidate: maximum speed between them, and tracker error.
_CANDIDATE_SPEED_M_S, _CANDIDATE_ERROR_M = 2.0, 0.1
# Time of rejections before a restart: longer than an identity switch of a tracker, about 0.7 s; at most the age of the
# track, which may have begun with a false detection. 1.5 s if the candidate has another identity: the attended person
# may come back. A candidate needs two detections.
_RESTART_AFTER_S, _RESTART_OTHER_ID_S, _CANDIDATE_FRAMES = 0.75, 1.5, 2
# Tolerance of time-stamp comparisons.
_ROUNDING_S = 1e-6


def is_near(innovation_m: FloatArray, spread_m2: FloatArray, since_s: float) -> bool:
    """Whether a detection is inside the gate.

    Args:
        innovation_m: Observed minus predicted position, shape (3,), metres.
        spread_m2: Its covariance, shape (3, 3), square metres.
        since_s: Time since the last accepted frame, seconds.

    Returns:
        Whether the Mahalanobis distance is within the gate; False for NaN, the result of an overflow.
    """
    return mahalanobis2(innovation_m, spread_m2, allowance_m(since_s) ** 2) <= GATE_D2


def allowance_m(since_s: AnyTime) -> AnyTime:
    """Manoeuvre noise: standard deviation of the departure from a steady walk.

    Args:
        since_s: Time since the last accepted frame, seconds; a number or an array of any shape.

    Returns:
        Standard deviation on each axis, metres, of the same shape.
    """
    return 0.5 * _MANOEUVRE_SD_M_S2 * (since_s + _FILTER_LAG_S) ** 2


class GatedFilter(ABC):
    """Kalman filter of the head's position with a gate; a subclass provides the motion model.

    The gate is at the 99.9 % level of the Mahalanobis distance. Its covariance is the sum of the filter's innovation
    covariance, the sample covariance of recent innovations, and manoeuvre noise since the last accepted frame. Rejected
    detections within walking distance of each other form a candidate track; a detection nearer to the candidate than to
    the track is rejected, too. The candidate replaces the track after 0.75 s of rejections, after 1.5 s if it has
    another identity, and sooner if the track is younger; the measured innovation covariance is kept.

    Over a gap the state is extrapolated and its covariance grows. A stated covariance of the position is that of the
    measurement.

    Args:
        position_noise_m: Standard deviation of a position measurement on each axis, metres, if none is stated.
        gated: False to accept every observation, as a plain Kalman filter.

    Attributes:
        started_at_s: Capture time of the track's first observation; None before it.
        accepted: Observations accepted by the last update: empty after a rejection; the whole candidate after a
            restart.
    """

    def __init__(self, position_noise_m: float, gated: bool = True) -> None:
        check_positive(position_noise_m=position_noise_m)
        self._R = position_noise_m**2 * np.eye(3)
        self._gated = gated
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        # Times of the state, of the newest accepted observation, of the first of the rejections in a row, and of the
        # last update of the measured innovation covariance.
        self._time_s = self._issued_at_s = self._refused_s = self._judged_s = -math.inf
        self.started_at_s: float | None = None
        self.accepted: tuple[HeadObservation, ...] = ()
        self._rejections = 0
        # Rejected observations of the candidate track, oldest first.
        self._candidate: tuple[HeadObservation, ...] = ()
        self._person_id: str | None = None
        self._measured_m2 = np.zeros((3, 3))

    @property
    def rejections_in_a_row(self) -> int:
        """Number of consecutive rejected observations."""
        return self._rejections

    def update(self, observation: HeadObservation) -> None:
        """Update with one observation; see `predictors.predictor.Predictor.update`."""
        self.update_with(observation, self._R, _NOTHING_M2)

    def update_with(self, observation: HeadObservation, unstated_m2: FloatArray, extra_m2: FloatArray) -> None:
        """Update with one observation and a measurement noise that the predictor has estimated.

        Args:
            observation: The observation.
            unstated_m2: Covariance of a position without a stated one, shape (3, 3), square metres.
            extra_m2: Covariance that is added to every position's, shape (3, 3), square metres.

        Raises:
            OutOfOrderError: If it is not newer than the last observation.
        """
        check_newer(observation, None if self.started_at_s is None else self._time_s)
        R = noise_m2(observation, unstated_m2) + extra_m2
        if self.started_at_s is None:
            self._start(observation, R)
            return
        expected_m, covariance_m2 = self._predict(observation.capture_time_s - self._time_s)
        self._time_s = observation.capture_time_s
        if not self._gated or self._passes(observation, expected_m, covariance_m2 + R):
            self._correct(observation.head_position_base_m, R)
            self._accept(observation)
            return
        self.accepted = ()
        if self._lost(self.started_at_s):
            candidate = self._candidate
            self._start(candidate[0], noise_m2(candidate[0], unstated_m2) + extra_m2)
            for other in candidate[1:]:
                self.update_with(other, unstated_m2, extra_m2)
            self.accepted = candidate

    def _start(self, observation: HeadObservation, R: FloatArray) -> None:
        self._begin(observation.head_position_base_m, R)
        self._time_s = self.started_at_s = observation.capture_time_s
        self._person_id = None
        self._accept(observation)

    def _accept(self, observation: HeadObservation) -> None:
        self._issued_at_s = self._judged_s = observation.capture_time_s
        self.accepted, self._candidate, self._rejections = (observation,), (), 0
        # Position takes precedence: trackers change the identity of a person.
        self._person_id = observation.person_id or self._person_id

    def _passes(self, observation: HeadObservation, expected_m: FloatArray, spread_m2: FloatArray) -> bool:
        """Gate an observation, given the position that the filter predicts for it, and its innovation covariance."""
        innovation_m = observation.head_position_base_m - expected_m
        # No manoeuvre noise for another identity: within a person's reach it is more probably another person.
        since_s = 0.0 if self._has_other_identity(observation) else observation.capture_time_s - self._issued_at_s
        near = is_near(innovation_m, spread_m2 + self._measured_m2, since_s)
        of_candidate = False
        for other in self._candidate[-1:]:
            apart_m = math.dist(other.head_position_base_m, observation.head_position_base_m)
            apart_s = observation.capture_time_s - other.capture_time_s
            of_candidate = apart_m <= _CANDIDATE_ERROR_M + _CANDIDATE_SPEED_M_S * apart_s
            near = near and not (of_candidate and apart_m <= math.hypot(*innovation_m.tolist()))
        if not (of_candidate and len(self._candidate) >= _CANDIDATE_FRAMES):
            # From the third detection on the candidate is a person: its innovations are no tracker errors.
            self._update_covariance(innovation_m, spread_m2, observation.capture_time_s)
        if not near:
            if not self._rejections:
                self._refused_s = observation.capture_time_s
            self._rejections += 1
            self._candidate = (*self._candidate, observation) if of_candidate else (observation,)
        return near

    def _lost(self, started_at_s: float) -> bool:
        """Whether the candidate should replace the track."""
        newest = self._candidate[-1]
        wait_s = min(_RESTART_AFTER_S, self._issued_at_s - started_at_s)
        if self._has_other_identity(newest):
            wait_s = _RESTART_OTHER_ID_S
        lasted_s = newest.capture_time_s - self._refused_s
        return len(self._candidate) >= _CANDIDATE_FRAMES and lasted_s >= wait_s - _ROUNDING_S

    def _has_other_identity(self, observation: HeadObservation) -> bool:
        return None not in (self._person_id, observation.person_id) and observation.person_id != self._person_id

    def _update_covariance(self, innovation_m: FloatArray, spread_m2: FloatArray, time_s: float) -> None:
        gain = min((time_s - self._judged_s) / _INNOVATION_TIME_S, _LARGEST_GAIN)
        self._judged_s = time_s
        known_m2 = spread_m2 + self._measured_m2
        weight = (_T_DEGREES + 3.0) / (_T_DEGREES + mahalanobis2(innovation_m, known_m2))
        if math.isfinite(weight):
            self._measured_m2 += gain * (weight * (innovation_m[:, None] * innovation_m) - self._measured_m2)

    def _check_started(self) -> None:
        if self.started_at_s is None:
            raise NotReadyError("no observation yet")

    @abstractmethod
    def _begin(self, position_m: FloatArray, R: FloatArray) -> None:
        """Initial state at a first position of covariance R."""

    @abstractmethod
    def _predict(self, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Extrapolate the state; predicted position, shape (3,), and its covariance, shape (3, 3)."""

    @abstractmethod
    def _correct(self, position_m: FloatArray, R: FloatArray) -> None:
        """Measurement update with an accepted position of covariance R."""
