"""Ruckig's jerk-limited trajectory through the set-points of the plan, one servo period at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import ruckig

from gazempc.controllers.controller import AxisMotion, CommandState, Plan
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Interventions of the smoother at a tick; empty while the plan is followed.
Intervention = Literal["", "stale_plan", "limit_guard"]

# Ruckig refuses a target that touches its limits by rounding.
_TARGET_MARGIN = 1.0 - 1e-9
_SAME_TIME_S = 1e-6
# Tolerance for a plan to count as the continuation of the command.
_SAME_RAD = 1e-9
# Tolerance for a command at its limit.
_ROUNDED_UP = 1.0 + 1e-9
# Bound on the assumed speed of an intercepted target, as a share of the speed limit: leaves closing speed.
_CHASE_SHARE = 0.95


class _AxisSmoother:
    """One joint. Separate Ruckig problems: a slow axis must not delay the other by synchronisation."""

    def __init__(self, limits: Sequence[float], period_s: float) -> None:
        self._low, self._high, self._v_max, self._a_max, self._j_max = limits
        self._period_s = period_s
        self._generator = ruckig.Ruckig(1, period_s)
        # A separate trajectory for stops: a stop has no target position, but the one stored in the trajectory (0 at
        # first) counts among its extrema.
        self._trajectory, self._stop = ruckig.Trajectory(1), ruckig.Trajectory(1)
        # One input for each problem, as most of its values are constant: setting one takes as long as some solutions.
        self._to_follow, self._to_meet, self._to_rest = (ruckig.InputParameter(1) for _ in range(3))
        self._to_follow.minimum_duration = period_s
        self._to_rest.control_interface = ruckig.ControlInterface.Velocity
        for request in (self._to_follow, self._to_meet, self._to_rest):
            request.target_position = request.target_velocity = request.target_acceleration = [0.0]
            request.max_velocity = [self._v_max]
            request.max_acceleration = [self._a_max]
            request.max_jerk = [self._j_max]

    def toward(self, now: AxisMotion, target: AxisMotion, v_limit: float) -> tuple[AxisMotion, bool]:
        """Next motion toward the target one period from now; True if the limit guard stopped it instead."""
        v_max = min(self._v_max, v_limit)
        position, velocity, acceleration = target
        # Targets outside are rare: this test is faster than two calls.
        if not self._low <= position <= self._high:
            position = min(max(position, self._low), self._high)
        if not -self._a_max <= acceleration <= self._a_max:
            acceleration = min(max(acceleration, -self._a_max), self._a_max)
        if not -v_max <= velocity <= v_max:
            velocity = min(max(velocity, -v_max), v_max)
        following = self._continue(now, position, velocity, acceleration, v_max)
        if following is not None and self._can_stop_inside(following):
            return following, False
        v_max *= _TARGET_MARGIN
        velocity = min(max(target[1], -v_max), v_max)
        # The peak speed, including the contribution of the acceleration, is limited, or decreases if above the limit.
        fastest = max(v_max / _TARGET_MARGIN, self._peak_speed(now)) * _ROUNDED_UP
        for way, aim in (
            (self._follow, (position, velocity, _TARGET_MARGIN * acceleration)),
            (self._intercept, (position, velocity, 0.0)),
            (self._intercept, (position, 0.0, 0.0)),
        ):
            following = way(now, aim, v_max)
            if following is None or self._peak_speed(following) > fastest:
                continue
            if self._can_stop_inside(following):
                return following, False
        return self.toward_rest(now), True

    def _continue(
        self, now: AxisMotion, to_rad: float, to_rad_s: float, to_rad_s2: float, v_max: float
    ) -> AxisMotion | None:
        # The continuation of a tracked plan is one constant jerk, also at its limits, where Ruckig's solution
        # deviates because of rounding.
        h = self._period_s
        position, velocity, acceleration = now
        jerk = (to_rad_s2 - acceleration) / h
        position += h * (velocity + h * (acceleration / 2.0 + h * jerk / 6.0))
        velocity += h * (acceleration + h * jerk / 2.0)
        if not (
            abs(position - to_rad) <= _SAME_RAD
            and abs(velocity - to_rad_s) * h <= _SAME_RAD
            and abs(jerk) <= self._j_max * _ROUNDED_UP
        ):
            return None
        following = position, velocity, to_rad_s2
        return following if self._peak_speed(following) <= v_max * _ROUNDED_UP else None

    def _peak_speed(self, motion: AxisMotion) -> float:
        # Velocity after the acceleration has been ramped to zero.
        _, velocity, acceleration = motion
        now, later = abs(velocity), abs(velocity + acceleration * abs(acceleration) / (2.0 * self._j_max))
        return later if later > now else now

    def _follow(self, now: AxisMotion, target: AxisMotion, v_max: float) -> AxisMotion | None:
        # The plan's motion, if it is reachable within this period; arrival at its end, not earlier, as the command
        # would then wait for the plan.
        if self._out_of_reach(now, target[0]):
            return None
        request = self._to_follow
        request.max_velocity, request.min_velocity = [v_max / _TARGET_MARGIN], [-v_max / _TARGET_MARGIN]
        request.current_position, request.target_position = [now[0]], [target[0]]
        request.current_velocity, request.target_velocity = [now[1]], [target[1]]
        request.current_acceleration, request.target_acceleration = [now[2]], [target[2]]
        following = self._sample(request)
        return following if self._trajectory.duration <= self._period_s + _SAME_TIME_S else None

    def _out_of_reach(self, now: AxisMotion, position: float) -> bool:
        # Necessary condition, to save calls of Ruckig: within a time t the jerk limit allows a deviation of at most
        # jerk t^3 / 6 from the motion without jerk; with a time tolerance of a microsecond.
        t, (here, velocity, acceleration) = self._period_s, now
        by_itself = here + t * (velocity + t * acceleration / 2.0)
        longest_s = t + _SAME_TIME_S
        reach = self._j_max * longest_s**3 / 6.0 + _SAME_TIME_S * (abs(velocity) + longest_s * abs(acceleration))
        return abs(position - by_itself) > reach * _ROUNDED_UP + _SAME_RAD

    def _intercept(self, now: AxisMotion, target: AxisMotion, v_max: float) -> AxisMotion | None:
        # Interception of a plan that has jumped: aiming at its present position would leave a permanent lag. In the
        # frame that moves with the plan the target is at rest, and the time-optimal motion to it is the earliest
        # interception.
        request, position = self._to_meet, target[0]
        velocity = min(max(target[1], -_CHASE_SHARE * v_max), _CHASE_SHARE * v_max)
        request.max_velocity, request.min_velocity = [v_max - velocity], [-v_max - velocity]
        request.current_position = [now[0] - (position - velocity * self._period_s)]
        request.current_velocity = [now[1] - velocity]
        request.current_acceleration = [now[2]]
        relative = self._sample(request)
        if relative is None:
            return None
        return relative[0] + position, relative[1] + velocity, relative[2]

    def toward_rest(self, now: AxisMotion) -> AxisMotion:
        """Next motion of the fastest stop within the limits."""
        self._aim_at_rest(now)
        # Ruckig fails to stop only for limits below its numerical precision; rest is then within them.
        return self._sample(self._to_rest) or (now[0], 0.0, 0.0)

    def _aim_at_rest(self, motion: AxisMotion) -> None:
        request = self._to_rest
        request.current_position, request.current_velocity = [motion[0]], [motion[1]]
        request.current_acceleration = [motion[2]]

    def _can_stop_inside(self, motion: AxisMotion) -> bool:
        # Recursive feasibility: if every command allows a stop inside the position limits, no later one leaves them.
        # Ruckig has no position constraints.
        if self._far_from_limits(motion):
            return True
        # Relative to position 0, which is among the extrema anyway.
        position, velocity, acceleration = motion
        self._aim_at_rest((0.0, velocity, acceleration))
        if self._calculate(self._to_rest, self._stop):
            reach = self._stop.position_extrema[0]
            return bool(position + reach.min >= self._low - 1e-12 and position + reach.max <= self._high + 1e-12)
        return False

    def _far_from_limits(self, motion: AxisMotion) -> bool:
        # Sufficient condition, to save calls of Ruckig: an upper bound of the stopping distance. A stop first ramps the
        # acceleration to zero, then brakes from at most the peak speed by an S-curve.
        position, _, acceleration = motion
        peak_speed, braking = self._peak_speed(motion), abs(acceleration)
        longest_s = braking / self._j_max + peak_speed / self._a_max + self._a_max / self._j_max
        room = peak_speed * longest_s * _ROUNDED_UP
        # False for NaN.
        return braking <= self._a_max and self._low + room <= position <= self._high - room

    def _sample(self, request: ruckig.InputParameter) -> AxisMotion | None:
        if not self._calculate(request, self._trajectory):
            return None
        p, v, a = self._trajectory.at_time(self._period_s)
        return (p[0], v[0], a[0]) if math.isfinite(p[0] + v[0] + a[0]) else None

    def _calculate(self, request: ruckig.InputParameter, trajectory: ruckig.Trajectory) -> bool:
        try:
            result = self._generator.calculate(request, trajectory)
        except (ruckig.RuckigError, ValueError):  # ValueError: a result code that its binding lacks
            return False
        return result in (ruckig.Result.Working, ruckig.Result.Finished)


class Smoother:
    """Turns plans into commands within the limits, one servo period at a time.

    The command is Ruckig's jerk-limited trajectory through the plan's set-points (position, velocity, acceleration). A
    plan within the limits is tracked exactly. The command always satisfies `NeckSpec.command_limits`: Ruckig limits
    velocity, acceleration and jerk; the position satisfies its limits because each command allows a stop inside them.
    After the end of a plan the command brakes to rest (Ruckig alone would keep its velocity).

    Args:
        neck: The neck with the limits.
        position_rad: Initial command, at rest, shape (N,), radians; clipped to the limits.

    Attributes:
        motions: The last command, as tuples of floats, one motion a joint.
        intervention: Intervention of the last step; empty if the plan was tracked.
    """

    def __init__(self, neck: NeckSpec, position_rad: FloatArray) -> None:
        limits = neck.command_limits
        by_joint = np.transpose([limits.position_min_rad, limits.position_max_rad, *limits.derivatives]).tolist()
        self._axes = [_AxisSmoother(each, neck.servo_period_s) for each in by_joint]
        start = limits.clip_position(np.asarray(position_rad, dtype=np.float64))
        self.motions: tuple[AxisMotion, ...] = tuple([(each_rad, 0.0, 0.0) for each_rad in start.tolist()])
        self.intervention: Intervention = ""

    @property
    def command(self) -> CommandState:
        """The last command, as arrays."""
        return CommandState(*np.array(self.motions).T.copy())

    def step(self, time_s: float, plan: Plan | None, speed_limit_rad_s: float | None = None) -> FloatArray:
        """Compute the next command.

        Args:
            time_s: Time at which it will be sent, seconds.
            plan: The plan to track; None, a plan that has ended or one with a NaN means stop.
            speed_limit_rad_s: Lower speed limit for this step, for a slow return to rest; None for the neck's own.

        Returns:
            The commanded angles, shape (N,), radians; see `command` for the motion.
        """
        if plan is None or time_s >= plan.end_s or not plan.is_finite:
            self.motions = tuple([axis.toward_rest(now) for axis, now in zip(self._axes, self.motions, strict=True)])
            self.intervention = "stale_plan"
            return self._position_rad()
        speed_limit = speed_limit_rad_s or math.inf
        each = zip(self._axes, self.motions, plan.motions_at(time_s), strict=True)
        steps = [axis.toward(now, wanted, speed_limit) for axis, now, wanted in each]
        self.motions = tuple([following for following, _ in steps])
        self.intervention = "limit_guard" if any(stopped for _, stopped in steps) else ""
        return self._position_rad()

    def _position_rad(self) -> FloatArray:
        return np.array([motion[0] for motion in self.motions])
