"""The joints beside pan and tilt: a body under the neck and eyes in the head share one gaze with it."""

from __future__ import annotations

import numpy as np

from gazempc.controllers.body import BodyAim
from gazempc.controllers.controller import Situation
from gazempc.controllers.eyes import EyeAim
from gazempc.neck.kinematics import look_at_rad, unwrap_pan
from gazempc.neck.spec import NeckSpec
from gazempc.types import BoolArray, FloatArray

# With it shifts of 20 deg come nearest to people's (docs/eyes.md); less changes nothing more.
_SHARED_HEAD_TIME_S = 0.1


class Chain:
    """Shares the gaze among the joints of a neck, from the slowest to the fastest: body, head, eyes.

    Each joint gets what the slower ones will leave over when it answers. Without body and eyes nothing changes.

    Args:
        neck: The neck.
        knots_s: Times of the plan's knots from its start, shape (K,), seconds.
    """

    def __init__(self, neck: NeckSpec, knots_s: FloatArray) -> None:
        self.body = None if neck.body is None else BodyAim(neck, knots_s)
        self.eyes = None if neck.eyes is None else EyeAim(neck, knots_s)
        limits = neck.command_limits
        head_rad = float(limits.position_min_rad[0]), float(limits.position_max_rad[0])
        # Of head and body together.
        self._reach_rad = head_rad if self.body is None else self.body.reach_rad
        self._geometry = neck.geometry

    def eye_times_s(self, start_s: float) -> FloatArray:
        """Times for which the eyes need the forecast, shape (H,), seconds; empty without eyes."""
        return np.empty(0) if self.eyes is None else self.eyes.forecast_times_s(start_s)

    def head_rad(self, situation: Situation, means_base_m: FloatArray) -> FloatArray:
        """Pan and tilt that the head is to have in the base frame.

        The pan is on the turn of the present command, if that is within reach. With eyes, the head takes its share
        of the angle to the person. If the eyes cannot move, the head also takes their part.

        Args:
            situation: What is known.
            means_base_m: Where the person is, shape (H, 3), metres.

        Returns:
            Shape (H, 2), radians.
        """
        command_rad = situation.command.position_rad
        pan_rad = float(command_rad[0]) if self.body is None else self.body.gaze_command_rad(command_rad)
        head_rad = unwrap_pan(look_at_rad(self._geometry, means_base_m), pan_rad, *self._reach_rad)
        if self.eyes is None:
            return head_rad
        if not situation.held:
            return self.eyes.head_share_rad(head_rad)
        return self.eyes.head_without_rad(situation, means_base_m, head_rad)

    def eyes_held(self, situation: Situation) -> BoolArray:
        """Of pan and tilt, whether there is an eye that is held, so that the head takes over, shape (2,)."""
        return np.zeros(2, dtype=np.bool_) if self.eyes is None else self.eyes.held(situation)

    def events(self, commands_rad: FloatArray) -> tuple[str, ...]:
        """Events of a plan whose first commands are these, shape (N,), radians."""
        return ("eyes_at_limit",) if self.eyes is not None and self.eyes.at_limit(commands_rad) else ()

    def with_eyes(
        self, situation: Situation, means_base_m: FloatArray, head_rad: FloatArray, body_rad: FloatArray | None
    ) -> FloatArray:
        """Commands of all joints at the knots.

        Args:
            situation: What is known.
            means_base_m: The forecast for `eye_times_s`, shape (H, 3), metres.
            head_rad: Commands of pan and tilt, shape (K, 2), radians.
            body_rad: Commands of the body, shape (K,), radians; None without one.

        Returns:
            Shape (K, N), radians.
        """
        body = [] if body_rad is None else [body_rad[:, None]]
        if self.eyes is None:
            return np.concatenate([head_rad, *body], axis=1) if body else head_rad
        others = np.concatenate([head_rad, *body], axis=1)
        return np.concatenate([head_rad, self.eyes.commands_rad(situation, means_base_m, others), *body], axis=1)


def head_time_s(neck: NeckSpec, given_s: float | None, usual_s: float) -> float:
    """Smoothing time of the head of a neck with eyes.

    Args:
        neck: The neck.
        given_s: What the user wants, seconds; None for what fits the neck.
        usual_s: What fits a head that ends facing the person, seconds.

    Returns:
        Seconds.
    """
    if given_s is not None:
        return given_s
    shares = neck.eyes is not None and min(neck.eyes.head_share_pan, neck.eyes.head_share_up) < 1.0
    return _SHARED_HEAD_TIME_S if shares else usual_s


def slopes(position: FloatArray, step_s: float) -> FloatArray:
    """Slopes by central differences, as of numpy.gradient, which takes several times as long.

    Args:
        position: Rows at equal steps, shape (K, N), K at least 2.
        step_s: Time between rows, seconds.

    Returns:
        Shape (K, N), per second.
    """
    slope = np.empty_like(position)
    slope[1:-1] = (position[2:] - position[:-2]) / (2.0 * step_s)
    slope[0] = (position[1] - position[0]) / step_s
    slope[-1] = (position[-1] - position[-2]) / step_s
    return slope
