"""The default: a line through the recent walk, and a small network that has seen how people leave it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from predictors.constant_velocity import ConstantVelocity
from predictors.predictor import NotReadyError, as_times
from predictors.types import FloatArray, Forecast, HeadObservation
from predictors.walker.features import WalkerHistory, WalkerInputs
from predictors.walker.network import WalkerModel, between_knots, shipped_walker_model


class Walker:
    """Forecast of a walking person from the last 1.2 s of head position, head yaw and pelvis yaw.

    A straight line through the last two thirds of a second gives a direction that gait does not shake. How the walk
    will leave that line (sway, bob, a turn that has begun) is learned from people walking: in the line's own frame, so
    that it does not matter where and in which direction somebody walks. What is learned on line: the constant offset of
    the person's head and pelvis yaw from their direction of travel, and the noise of the sensor.

    Outliers are refused by `ConstantVelocity`, whose forecast this one turns into for somebody who stands, or moves
    faster than people walk, and at the first frames. Orientation may be missing, at any time and of either part; it
    fades out over half a second. Frame rate, gaps and jitter are taken care of by the time stamps.

    Args:
        model: The fitted numbers; without them those that ship with the package.
        acceleration_psd: See `ConstantVelocity`.
        position_noise_m: See `ConstantVelocity`; the noise that the network reckons with is measured on line.
    """

    def __init__(
        self, model: WalkerModel | None = None, acceleration_psd: float = 0.05, position_noise_m: float = 0.01
    ) -> None:
        self._model = shipped_walker_model() if model is None else model
        self._position = ConstantVelocity(acceleration_psd, position_noise_m)
        self._history = WalkerHistory()
        self._inputs: WalkerInputs | None = None
        self._knots: tuple[FloatArray, FloatArray] | None = None
        self._axes = np.eye(3), np.zeros((3, 9))

    def reset(self) -> None:
        """Forget the person."""
        self._position.reset()
        self._history, self._inputs, self._knots = WalkerHistory(), None, None

    def update(self, observation: HeadObservation) -> None:
        """Take in one observation; see `predictors.predictor.Predictor.update`."""
        started_at_s = self._position.started_at_s
        self._position.update(observation)
        if self._position.started_at_s != started_at_s:
            self._history = WalkerHistory()
        for taken in self._position.taken_in:
            self._inputs = self._history.add(taken)
            self._knots = None

    def inputs(self) -> WalkerInputs:
        """What the network is asked, for whoever fits one.

        Returns:
            The inputs at the newest accepted observation.

        Raises:
            NotReadyError: If there has been no observation since the last reset.
        """
        if self._inputs is None:
            raise NotReadyError("no observation yet")
        return self._inputs

    def fitted_on(self) -> tuple[str, ...]:
        """People that the model was fitted on: on their walks its errors are smaller than on others'."""
        return tuple(self._model.about.get("people", ()))

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """Forecast the head position; see `predictors.predictor.Predictor.forecast`."""
        inputs = self.inputs()
        if inputs.walking == 0.0:
            return self._position.forecast(times_s)
        times = as_times(times_s)
        if self._knots is None:
            departures, doubt = self._model.answer(inputs.network[None], inputs.spread[None])
            self._knots = departures[0], self._model.spread_m(doubt)[0]
            c, s = math.cos(inputs.heading_rad), math.sin(inputs.heading_rad)
            to_base = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            # Each axis of the line's frame contributes its variance times the square of its direction.
            self._axes = to_base, (to_base.T[:, :, None] * to_base.T[:, None, :]).reshape(3, 9)
        tau = times - inputs.time_s
        to_base, squares = self._axes
        departure, spread = between_knots(tau, *self._knots)
        means = tau[:, None] * inputs.velocity_base_m_s
        means += inputs.origin_base_m
        means += departure @ to_base.T
        covariances = (spread**2 @ squares).reshape(-1, 3, 3)
        if inputs.walking < 1.0:
            means, covariances = self._blend(inputs.walking, times, means, covariances)
        return Forecast(times, means, covariances, inputs.time_s)

    def _blend(
        self, walking: float, times_s: FloatArray, means: FloatArray, covariances: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of the mixture of both forecasts."""
        other = self._position.forecast(times_s)
        apart = means - other.means_base_m
        return (
            other.means_base_m + walking * apart,
            walking * covariances
            + (1.0 - walking) * other.covariances_m2
            + walking * (1.0 - walking) * apart[:, :, None] * apart[:, None, :],
        )
