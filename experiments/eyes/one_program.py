"""A controller that plans head and eyes together, one program a plane: ``experiments.eyes.one_program:OneProgram``."""

from __future__ import annotations

import numpy as np

from experiments.eyes.plane import PlanePlan, Weights
from gazempc.controllers.controller import Plan, Situation
from gazempc.errors import SettingsError
from gazempc.neck.ahead import JointAhead
from gazempc.neck.kinematics import eye_angles_rad
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

_PLAN_S = 0.4
_PLANES = (0, 1)


class OneProgram:
    """Plans head and eyes together over the forecast; see `experiments.eyes.plane`.

    Args:
        neck: A neck with eyes and without a body; both eyes' joints and both of the head have one dead time each.
        head_time_s: Weight of the head's smoothness, as a time.
        eye_time_s: The same of the eyes.
        comfort: Cost of a degree of the eyes off their middle, as a share of that of a degree of gaze error.
        horizon_s: Optimised motion of the head after its dead time, seconds.

    Raises:
        SettingsError: If the neck has no eyes, a body, or other dead times.
    """

    def __init__(
        self,
        neck: NeckSpec,
        head_time_s: float = 0.15,
        eye_time_s: float = 0.02,
        comfort: float = 0.12,
        horizon_s: float = 0.8,
    ) -> None:
        dead_s = neck.dead_time_s
        if neck.eyes is None or neck.body is not None or dead_s[0] != dead_s[1] or dead_s[2] != dead_s[3]:
            raise SettingsError(
                f"neck {neck.name!r}: one program needs eyes and no body; pan and tilt of the head must have one dead "
                "time, and those of the eyes"
            )
        self.neck = neck
        weights = Weights(head_time_s, eye_time_s, comfort, horizon_s)
        self._planes = [PlanePlan(neck, plane, weights, _PLAN_S) for plane in _PLANES]
        self._ahead_s: FloatArray = float(dead_s[2]) + self._planes[0].times_s
        self._motions: list[JointAhead] | None = None

    def reset(self) -> None:
        """Nothing to forget."""

    def forecast_times_s(self, start_s: float, newest_capture_s: float) -> FloatArray:
        """Ends of the eyes' steps, after the eyes' dead time, shape (n,), seconds."""
        return start_s + self._ahead_s

    def plan(self, situation: Situation) -> Plan:
        """See `gazempc.controllers.controller.Controller.plan`."""
        neck, offset_rad, command = self.neck, situation.joint_offset_rad, situation.command
        heads_rad = self._heads_rad(situation)
        # The sum of head and eye that looks at the person is exact where the head's angle is.
        gaze_rad = heads_rad + eye_angles_rad(neck.geometry, heads_rad, situation.forecast.means_base_m)
        knots = np.empty((3, self._planes[0].knots + 1, neck.joints))
        knots[:, 0] = command.position_rad, command.velocity_rad_s, command.acceleration_rad_s2
        for i, plane in enumerate(self._planes):
            head, eye = (self._state(situation, joint, knots[:, 0, joint]) for joint in (i, 2 + i))
            known_rad = heads_rad[: plane.known, i] - offset_rad[i]
            wanted_rad = gaze_rad[:, i] - offset_rad[i] - offset_rad[2 + i]
            knots[:, 1:, i], knots[:, 1:, 2 + i] = plane.solve(head, eye, known_rad, wanted_rad)
        start_s = situation.start_s - neck.servo_period_s
        return Plan(start_s, neck.control_period_s, knots[0], knots[1], knots[2])

    def _state(self, situation: Situation, joint: int, command: FloatArray) -> FloatArray:
        offset_rad = situation.joint_offset_rad[joint]
        joint_now = situation.settled_position_rad[joint] - offset_rad, situation.settled_velocity_rad_s[joint]
        return np.concatenate((joint_now, command))

    def _heads_rad(self, situation: Situation) -> FloatArray:
        """Where the head will be at the forecast's times, the last command held after those that are known."""
        if self._motions is None:
            delay_s = len(situation.committed_rad) * self.neck.servo_period_s
            ahead_s = delay_s + self._ahead_s - self.neck.servo_period_s
            self._motions = [JointAhead(self.neck.axes[i], self.neck.servo_period_s, ahead_s) for i in _PLANES]
        heads = []
        for i, motion in zip(_PLANES, self._motions, strict=True):
            held = np.full(motion.future_needed, situation.command.position_rad[i])
            offset_rad = float(situation.joint_offset_rad[i])
            angles = motion(
                float(situation.joint_position_rad[i]) - offset_rad,
                float(situation.joint_velocity_rad_s[i]),
                situation.sent_rad[:, i],
                np.concatenate((situation.committed_rad[:, i], held)),
            )
            heads.append(offset_rad + angles)
        return np.stack(heads, axis=-1)
