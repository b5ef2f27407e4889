"""Gating of detections, loss of a track, and the part of a Kalman filter that all motion models share."""

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
# of street trackers were refused, and forecasts at 0.25 s were 1 % worse.
_MANOEUVRE_SD_M_S2, _FILTER_LAG_S = 1.25, 0.2
# Time constant of the measured innovation covariance; at low frame rates the gain is bounded.
_LEARNS_IN_S, _LARGEST_GAIN = 0.3, 0.2
# Robust weights of a t distribution (Lange, Little & Taylor 1989): an outlier counts at most as `_DEGREES + 3`
# innovations of one standard deviation.
_DEGREES = 3.0
# Association of refused detections to one candidate: largest speed between them, and error of the tracker.
_OTHERS_SPEED_M_S, _OTHERS_ERROR_M = 2.0, 0.1
# Identity switches of trackers last about 0.7 s, so a track is kept for longer. A candidate needs two detections. A
# track younger than that is given up after its own age: it may have begun with a false detection.
_GIVEN_UP_AFTER_S, _CANDIDATE_FRAMES = 0.75, 2
# Tolerance of comparisons between time stamps.
_ROUNDING_S = 1e-6
# The same where the candidate has another identity: the attended person may come back.
_GIVEN_UP_BY_ID_S = 1.5


class Gate:
    """Gate at the 99.9 % level of the Mahalanobis distance, with a candidate track for detections outside it.

    The gate's covariance is the sum of the filter's innovation covariance, the measured one of recent innovations, and
    manoeuvre noise since the last accepted frame. Refused detections within walking distance of each other form a
    candidate track; a detection nearer to the candidate than to the track is refused, too. The candidate replaces the
    track after 0.75 s of refusals, after 1.5 s if it has another identity, and sooner if the track is younger.
    """

    def __init__(self) -> None:
        self._rejections = 0
        self._began_s = self._accepted_s = self._refused_s = -math.inf
        self._person_id: str | None = None
        self._measured_m2 = np.zeros((3, 3))
        self._judged_s = -math.inf
        self._candidate: list[HeadObservation] = []

    @property
    def rejections_in_a_row(self) -> int:
        """Number of observations refused since the last accepted one."""
        return self._rejections

    @property
    def candidate(self) -> tuple[HeadObservation, ...]:
        """Refused observations of the candidate track, oldest first."""
        return tuple(self._candidate)

    @property
    def lost(self) -> bool:
        """Whether the track should start anew, from the candidate."""
        if len(self._candidate) < _CANDIDATE_FRAMES:
            return False
        newest = self._candidate[-1]
        age_s = self._accepted_s - self._began_s
        wait_s = _GIVEN_UP_BY_ID_S if self._is_named_otherwise(newest) else min(_GIVEN_UP_AFTER_S, age_s)
        return newest.capture_time_s - self._refused_s >= wait_s - _ROUNDING_S

    def begin(self, observation: HeadObservation) -> None:
        """Begin a track; the measured innovation covariance is kept.

        Args:
            observation: The first observation.
        """
        self._person_id = None
        self._began_s = observation.capture_time_s
        self._accept(observation)

    def accepts(self, observation: HeadObservation, expected_m: FloatArray, spread_m2: FloatArray) -> bool:
        """Judge one observation of a track that has begun.

        Args:
            observation: The observation, newer than all before it.
            expected_m: Position that the filter predicts for it, shape (3,), metres, base frame.
            spread_m2: Covariance of the difference as the filter has it, shape (3, 3), square metres.

        Returns:
            Whether the observation is to be used.
        """
        innovation_m = observation.head_position_base_m - expected_m
        # A detection of another identity within the person's reach is more probably another person.
        since_s = 0.0 if self._is_named_otherwise(observation) else observation.capture_time_s - self._accepted_s
        near = is_near(innovation_m, spread_m2 + self._measured_m2, since_s)
        of_candidate = bool(self._candidate) and _of_one_person(self._candidate[-1], observation)
        if near and of_candidate:
            near = _apart_m(self._candidate[-1], observation) > math.hypot(*innovation_m.tolist())
        if not (of_candidate and len(self._candidate) >= _CANDIDATE_FRAMES):
            # From the third detection on, the candidate is a person and no error of the tracker.
            self._learn(innovation_m, spread_m2, observation.capture_time_s)
        if near:
            self._accept(observation)
        else:
            if not self._rejections:
                self._refused_s = observation.capture_time_s
            self._rejections += 1
            self._candidate = [*self._candidate, observation] if of_candidate else [observation]
        return near

    def _accept(self, observation: HeadObservation) -> None:
        self._rejections = 0
        self._candidate = []
        self._accepted_s = self._judged_s = observation.capture_time_s
        # Position outranks identity: trackers change the identity of one person.
        self._person_id = observation.person_id or self._person_id

    def _is_named_otherwise(self, observation: HeadObservation) -> bool:
        return None not in (self._person_id, observation.person_id) and observation.person_id != self._person_id

    def _learn(self, innovation_m: FloatArray, spread_m2: FloatArray, time_s: float) -> None:
        gain = min((time_s - self._judged_s) / _LEARNS_IN_S, _LARGEST_GAIN)
        self._judged_s = time_s
        known_m2 = spread_m2 + self._measured_m2
        weight = (_DEGREES + 3.0) / (_DEGREES + mahalanobis2(innovation_m, known_m2))
        if math.isfinite(weight):
            self._measured_m2 += gain * (weight * (innovation_m[:, None] * innovation_m) - self._measured_m2)


def is_near(innovation_m: FloatArray, spread_m2: FloatArray, since_s: float) -> bool:
    """Whether a detection is inside the gate.

    Args:
        innovation_m: Observed minus predicted position, shape (3,), metres.
        spread_m2: Its covariance, shape (3, 3), square metres.
        since_s: Time since the last frame that was used, seconds.

    Returns:
        Whether the distance is within the gate; False for NaN, from a position of absurd size.
    """
    return mahalanobis2(innovation_m, spread_m2, allowance_m(since_s) ** 2) <= GATE_D2


def allowance_m(since_s: AnyTime) -> AnyTime:
    """Manoeuvre noise: standard deviation of the departure from a steady walk.

    Args:
        since_s: Time since the last frame that was used, seconds; a number or an array of any shape.

    Returns:
        Standard deviation on each axis, metres, of the same shape.
    """
    return 0.5 * _MANOEUVRE_SD_M_S2 * (since_s + _FILTER_LAG_S) ** 2


def _apart_m(one: HeadObservation, other: HeadObservation) -> float:
    return math.dist(one.head_position_base_m, other.head_position_base_m)


def _of_one_person(one: HeadObservation, other: HeadObservation) -> bool:
    since_s = other.capture_time_s - one.capture_time_s
    return _apart_m(one, other) <= _OTHERS_ERROR_M + _OTHERS_SPEED_M_S * since_s


class GatedFilter(ABC):
    """A Kalman filter of the head's position behind a `Gate`; a subclass has the motion model.

    Observations outside the gate are refused, and refused ones that form a candidate for 0.75 s restart the track. Over
    a gap the state is extrapolated and its covariance grows. A stated covariance of the position is the measurement
    covariance.

    Args:
        position_noise_m: Standard deviation of a position measurement on each axis, metres, where none is stated.
        gated: False to take in every observation, as a plain Kalman filter does.
    """

    def __init__(self, position_noise_m: float, gated: bool = True) -> None:
        check_positive(position_noise_m=position_noise_m)
        self._R = position_noise_m**2 * np.eye(3)
        self._gated = gated
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self._time_s = self._issued_at_s = -math.inf
        self._started_at_s: float | None = None
        self._taken_in: tuple[HeadObservation, ...] = ()
        self._gate = Gate()

    @property
    def started_at_s(self) -> float | None:
        """Capture time of the observation that the track began with, None before the first one."""
        return self._started_at_s

    @property
    def taken_in(self) -> tuple[HeadObservation, ...]:
        """Observations that the last update used: none if it was refused; where a track begins anew, all of its own."""
        return self._taken_in

    @property
    def rejections_in_a_row(self) -> int:
        """Number of observations refused since the last accepted one."""
        return self._gate.rejections_in_a_row

    def update(self, observation: HeadObservation) -> None:
        """Take in one observation; see `predictors.predictor.Predictor.update`."""
        self.update_with(observation, self._R, _NOTHING_M2)

    def update_with(self, observation: HeadObservation, unstated_m2: FloatArray, extra_m2: FloatArray) -> None:
        """Take in one observation, for a predictor that measures the noise itself.

        Args:
            observation: The observation.
            unstated_m2: Covariance of a position that states none, shape (3, 3), square metres.
            extra_m2: Covariance that is added to every position's, shape (3, 3), square metres.

        Raises:
            OutOfOrderError: If it is not newer than the last observation.
        """
        check_newer(observation, None if self._started_at_s is None else self._time_s)
        R = noise_m2(observation, unstated_m2) + extra_m2
        if self._started_at_s is None:
            self._start(observation, R)
            return
        expected_m, covariance_m2 = self._predict(observation.capture_time_s - self._time_s)
        self._time_s = observation.capture_time_s
        if not self._gated or self._gate.accepts(observation, expected_m, covariance_m2 + R):
            self._correct(observation.head_position_base_m, R)
            self._issued_at_s = observation.capture_time_s
            self._taken_in = (observation,)
            return
        self._taken_in = ()
        if self._gate.lost:
            candidate = self._gate.candidate
            self._start(candidate[0], noise_m2(candidate[0], unstated_m2) + extra_m2)
            for other in candidate[1:]:
                self.update_with(other, unstated_m2, extra_m2)
            self._taken_in = candidate

    def _start(self, observation: HeadObservation, R: FloatArray) -> None:
        self._begin(observation.head_position_base_m, R)
        self._time_s = self._issued_at_s = self._started_at_s = observation.capture_time_s
        self._taken_in = (observation,)
        self._gate.begin(observation)

    def _check_started(self) -> None:
        if self._started_at_s is None:
            raise NotReadyError("no observation yet")

    @abstractmethod
    def _begin(self, position_m: FloatArray, R: FloatArray) -> None:
        """Initial state at a first position of covariance R."""

    @abstractmethod
    def _predict(self, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Carry the state on; position, shape (3,), and its covariance, shape (3, 3)."""

    @abstractmethod
    def _correct(self, position_m: FloatArray, R: FloatArray) -> None:
        """Correct the state by an accepted position of covariance R."""
