"""Takes down what the loop does, and makes a log of it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gazempc.controllers.controller import CommandState
from gazempc.results.log import FORECAST_HORIZONS_S, ComputeTimes, Log
from gazempc.types import FloatArray, JointState
from predictors import HeadObservation, Predictor

_NOWHERE = np.full(2, np.nan)


class LoopRecorder:
    """Collects rows while the loop runs.

    An event that lasts is written once, when it begins: while the same event comes at every tick, it is one.

    Args:
        control_period_s: Time between two plans, seconds; the rarest event that lasts comes once in it.
    """

    def __init__(self, control_period_s: float) -> None:
        self._control_period_s = control_period_s
        self._ticks: list[tuple[float, JointState | None, FloatArray, CommandState]] = []
        self._observations: list[tuple[float, HeadObservation, FloatArray, FloatArray]] = []
        self._events: list[tuple[float, str]] = []
        self._event_last_s: dict[str, float] = {}
        self._update_ms: list[float] = []
        self._step_ms: list[float] = []
        self._latency_ms: list[float] = []

    @property
    def ticks(self) -> int:
        """How many ticks were taken down."""
        return len(self._ticks)

    def tick(self, time_s: float, state: JointState | None, sent_rad: FloatArray, command: CommandState) -> None:
        """Take down one servo tick: joints as measured (None if not), what was really sent, the command's motion."""
        self._ticks.append((time_s, state, sent_rad, command))

    def observation(self, time_s: float, observation: HeadObservation, predictor: Predictor, update_ms: float) -> None:
        """Take down an observation, what the predictor makes of it, and how long its update took.

        Raises:
            ValueError: If the forecast has not the shape that was asked for.
        """
        horizons = observation.capture_time_s + np.array(FORECAST_HORIZONS_S)
        forecast = predictor.forecast(horizons)
        n = horizons.size
        if forecast.means_base_m.shape != (n, 3) or forecast.covariances_m2.shape != (n, 3, 3):
            raise ValueError(f"forecast of shape {forecast.means_base_m.shape}, expected {(n, 3)}")
        self._observations.append((time_s, observation, forecast.means_base_m, forecast.covariances_m2))
        self._update_ms.append(update_ms)

    def step(self, step_ms: float) -> None:
        """Take down how long forecast and plan took, milliseconds."""
        self._step_ms.append(step_ms)

    def latency(self, latency_ms: float) -> None:
        """Take down how old a plan's newest observation was when its first command was sent, milliseconds."""
        self._latency_ms.append(latency_ms)

    def event(self, time_s: float, name: str) -> None:
        """Take down something out of the ordinary."""
        last_s = self._event_last_s.get(name, -np.inf)
        if time_s - last_s > 2.5 * self._control_period_s:
            self._events.append((time_s, name))
        self._event_last_s[name] = time_s

    def finish(
        self,
        about: dict[str, Any],
        true_head_base_m: Callable[[FloatArray], FloatArray],
        true_joints: Sequence[JointState | None] | None = None,
    ) -> tuple[Log, ComputeTimes]:
        """Make the log.

        Args:
            about: Description of the run, for `Log.about`.
            true_head_base_m: True head positions, shape (H, 3), at times, shape (H,); NaN where they are not known.
            true_joints: Where the joints really were at each tick, if that is known; else what was measured counts.

        Returns:
            The log, and the compute times.
        """
        time_s = np.array([t for t, _, _, _ in self._ticks])
        states = true_joints or [s for _, s, _, _ in self._ticks]
        commands = [c for _, _, _, c in self._ticks]
        captures = np.array([o.capture_time_s for _, o, _, _ in self._observations])
        horizons = np.array(FORECAST_HORIZONS_S)
        shape = (captures.size, horizons.size, 3)
        ahead = captures[:, None] + horizons
        true = true_head_base_m(ahead.ravel()).reshape(shape)
        log = Log(
            about=json.dumps(about, sort_keys=True),
            time_s=time_s,
            head_true_base_m=true_head_base_m(time_s),
            joint_position_rad=np.array([_NOWHERE if s is None else s.position_rad for s in states]),
            joint_velocity_rad_s=np.array([_NOWHERE if s is None else s.velocity_rad_s for s in states]),
            command_position_rad=np.array([sent_rad for _, _, sent_rad, _ in self._ticks]),
            command_velocity_rad_s=np.array([c.velocity_rad_s for c in commands]),
            command_acceleration_rad_s2=np.array([c.acceleration_rad_s2 for c in commands]),
            capture_time_s=captures,
            arrival_time_s=np.array([t for t, _, _, _ in self._observations]),
            head_observed_base_m=np.array([o.head_position_base_m for _, o, _, _ in self._observations]).reshape(-1, 3),
            forecast_mean_base_m=np.array([mean for _, _, mean, _ in self._observations]).reshape(shape),
            forecast_covariance_m2=np.array([cov for _, _, _, cov in self._observations]).reshape(*shape, 3),
            forecast_true_base_m=true,
            forecast_horizon_s=horizons,
            event_time_s=np.array([t for t, _ in self._events]),
            event_name=np.array([name for _, name in self._events], dtype=np.str_),
        )
        return log, ComputeTimes(np.array(self._update_ms), np.array(self._step_ms), np.array(self._latency_ms))
