"""The default predictor: constant-velocity extrapolation, and feedforward networks for the departure from it."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import ArrayLike

from predictors.constant_velocity import ConstantVelocity
from predictors.predictor import NotReadyError, as_times, check_newer, noise_m2
from predictors.types import FloatArray, Forecast, HeadObservation
from predictors.walker.features import WalkerHistory, WalkerInputs
from predictors.walker.knots import BetweenKnots
from predictors.walker.network import N_OUTPUTS, VELOCITIES, WALKS, WalkerModel, shipped_walker_model
from predictors.walker.range_error import MeasuredRange

# Gait (sway and bob) is measurement noise of the line's filter: variance on each axis.
_GAIT_M2 = 0.02**2 * np.eye(3)
# Length of the replay buffer, refiltered when the estimated range error increases: 1.2 s at 30 frames a second.
_AGAIN_FRAMES = 36
# Increase that triggers it: 50 mm plus a factor of two in standard deviation; at most four times a track.
_WORSE_M2, _WORSE_TIMES2 = 0.05**2, 4.0
# Time constants of the low-pass filters of the logits, seconds. Walking: of 0.05, 0.1, 0.2 and 0.25 s, on standing
# people left out of the fit: it halves the false starts; from 0.2 s on, at a threshold that detects true starts, eye
# contact with starting people decreases. Places and velocities of staying: of 0.1, 0.2, 0.3, 0.6 and 1.2 s; from 0.1 to
# 0.6 s the acceleration with standing people falls by 9 %, the error by 1 %; the error with starting people rises by
# 2.5 %. At rest the direction of travel, in whose frame the inputs are, can reverse within a frame: with 0.1 s the
# forecast for synthetic standing people then moves by up to 11 mm, with 0.6 s by up to 8 mm.
_WALKING_LOGIT_S, _STAYING_LOGITS_S = 0.1, 0.6
_LOGITS_S = np.r_[_WALKING_LOGIT_S, np.full(N_OUTPUTS - WALKS - 1, _STAYING_LOGITS_S)]
# Logits before a track's first frame: of walking, for fewer false starts in the first frames of a tracker, and of rest
# as the initial velocity. The first was chosen among -1, -2.5, -4 and none on waiting, starting, stopping and walking
# people outside the fit; walkers lose 0.1 points of contact.
_PRIOR_LOGITS = np.zeros((2, N_OUTPUTS - WALKS))
_PRIOR_LOGITS[:, [0, VELOCITIES.start]] = -2.5, 4.0


class Walker:
    """Forecast of a walking or standing person from head position, head yaw and pelvis yaw.

    A constant-velocity filter, with gait as measurement noise, gives a straight line. Networks output the departure
    from it in the regime of walking (sway, bob, the continuation of a turn or a stop), the place of return and the
    initial velocity in the regime of staying, and the log-odds of walking. All logits are low-pass filtered. Inputs are
    relative to the line, so the forecast is invariant to translation and heading. Estimated online are the constant
    offsets of head and pelvis yaw from the direction of travel, and the covariance of the tracker's white error.

    A stated covariance replaces the estimated one. The filter's gate rejects outliers. At running speed the forecast is
    that of the filter. Orientations are optional; the weight of the last one decays to zero within half a second. Frame
    rate, gaps and jitter enter through the time stamps.

    Args:
        model: The fitted parameters; default: the shipped model.
    """

    def __init__(self, model: WalkerModel | None = None) -> None:
        self._model = shipped_walker_model() if model is None else model
        self._position = ConstantVelocity()
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self._position.reset()
        self._recent: deque[HeadObservation] = deque(maxlen=_AGAIN_FRAMES)
        self._range, self._largest_m2 = MeasuredRange(), 0.0
        self._reset_track()

    def _reset_track(self) -> None:
        self._history = WalkerHistory()
        self._inputs: WalkerInputs | None = None
        self._outputs: FloatArray | None = None
        self._logits = _PRIOR_LOGITS
        self._knots: BetweenKnots | None = None

    @property
    def rejections_in_a_row(self) -> int:
        """Number of consecutive rejected observations."""
        return self._position.rejections_in_a_row

    def update(self, observation: HeadObservation) -> None:
        """Update with one observation; see `predictors.predictor.Predictor.update`."""
        check_newer(observation, self._recent[-1].capture_time_s if self._recent else None)
        self._recent.append(observation)
        if observation.position_covariance_m2 is None:
            self._range.learn(observation)
        range_m2 = self._range.variance_m2
        again = range_m2 > _WORSE_M2 + _WORSE_TIMES2 * self._largest_m2
        if again:  # the earlier frames were filtered with a range variance that was too small
            self._position.reset()
            self._reset_track()
        self._largest_m2 = max(self._largest_m2, range_m2)
        for each in list(self._recent) if again else [observation]:
            self._process(each)

    def _estimated_m2(self, observation: HeadObservation) -> FloatArray:
        """Covariance of the observed position, for trackers that do not state it."""
        return self._history.white_noise_m2() + self._range.covariance_m2(observation.head_position_base_m)

    def _process(self, observation: HeadObservation) -> None:
        started_at_s = self._position.started_at_s
        self._position.update_with(observation, self._estimated_m2(observation), _GAIT_M2)
        taken = self._position.accepted
        if not taken:
            return
        if self._position.started_at_s != started_at_s:
            self._reset_track()
        _, state, _ = self._position.state()
        last_s = taken[0].capture_time_s if self._inputs is None else self._inputs.time_s
        for each in taken:  # several if a candidate has become the track
            inputs = self._history.add(each, state, noise_m2(each, self._estimated_m2(each)))
        self._inputs, self._knots = inputs, None
        if inputs.on_foot > 0.0:  # the line has no direction at a first frame
            self._outputs = self._model.outputs(inputs.network)
            gain = -np.expm1((last_s - inputs.time_s) / _LOGITS_S)
            self._logits = self._logits + gain * (self._outputs[:, WALKS:] - self._logits)
            self._outputs[:, WALKS:] = self._logits

    def inputs(self) -> WalkerInputs:
        """Inputs of the networks, for a fit.

        Returns:
            The inputs at the newest accepted observation.

        Raises:
            NotReadyError: If there has been no observation since the last reset.
        """
        if self._inputs is None:
            raise NotReadyError("no observation yet")
        return self._inputs

    def fitted_on(self) -> tuple[str, ...]:
        """People in the training set: their forecasts are in-sample."""
        return tuple(self._model.about.get("people", ()))

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        inputs = self.inputs()
        if inputs.on_foot == 0.0:
            return self._position.forecast(times_s)
        times = as_times(times_s)
        if self._knots is None:
            assert self._outputs is not None
            of_track = inputs.spread, inputs.places_m, inputs.velocities_m_s
            departure_m, doubt = self._model.answer(self._outputs, *of_track)
            axes = inputs.to_base.T
            # Outer products of the line's axes, weighted by the variances along them, sum to the covariance. The stated
            # one keeps its principal axes, such as a camera's line of sight.
            squares = (axes[:, :, None] * axes[:, None, :]).reshape(3, 9), inputs.stated_m2.reshape(1, 9)
            self._squares = np.concatenate(squares)
            self._knots = BetweenKnots(departure_m @ axes, self._model.spread_m(doubt))
        tau = times - inputs.time_s
        departure, spread = self._knots(tau)
        means = inputs.origin_base_m + tau[:, None] * inputs.velocity_base_m_s + departure
        covariances = (spread**2 @ self._squares).reshape(-1, 3, 3)
        share = inputs.on_foot
        if share < 1.0:  # mean and covariance of the mixture of both forecasts
            filtered = self._position.forecast(times)
            apart = means - filtered.means_base_m
            means = filtered.means_base_m + share * apart
            covariances = share * covariances + (1.0 - share) * filtered.covariances_m2
            covariances += share * (1.0 - share) * apart[:, :, None] * apart[:, None, :]
        return Forecast(times, means, covariances, inputs.time_s, self._model.degrees_of_freedom)
