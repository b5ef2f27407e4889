"""Makes the statuses of a live run."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from gazempc.live.logs import LiveLogs
from gazempc.live.parts import LiveParts
from gazempc.live.report import LiveReport
from gazempc.live.status import Status
from gazempc.loop.gaze_loop import GazeLoop
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.smoother import Smoother
from gazempc.neck.kinematics import gaze_ray
from gazempc.types import FloatArray

# So often people can read it.
_PERIOD_S = 0.25


class StatusMaker:
    """Makes statuses, in the thread of the run.

    Args:
        parts: The parts of the run.
        loop: The loop.
        smoother: Where the command stands.
        report: What was counted.
        logs: The logs.
        show: Takes each status; must return at once.
    """

    def __init__(
        self,
        parts: LiveParts,
        loop: GazeLoop,
        smoother: Smoother,
        report: LiveReport,
        logs: LiveLogs,
        show: Callable[[Status], None],
    ) -> None:
        self._neck, self._lost_after_s = parts.neck, parts.settings.lost_after_s
        self._loop, self._smoother, self._report, self._logs = loop, smoother, report, logs
        self._show = show
        self._start_s: float | None = None
        self._due_s = -math.inf
        self._late_s = 0.0
        self._recorder: LoopRecorder | None = None
        self._told = 0

    def late(self, late_s: float) -> None:
        """Take note of how late a tick began, seconds."""
        self._late_s = max(self._late_s, late_s)

    def after_tick(self, index: int, now_s: float) -> None:
        """Make a status if it is time: four times a second, between two plans, when nobody else computes.

        Args:
            index: Number of the tick.
            now_s: Its time, seconds.
        """
        if self._start_s is None:
            self._start_s = self._due_s = now_s
        per_plan = self._neck.servo_ticks_per_plan
        if now_s >= self._due_s and index % per_plan == per_plan // 2:
            # After a pause not one after the other.
            self._due_s = max(self._due_s + _PERIOD_S, now_s)
            self._show(self._make(now_s, self._start_s))

    def finish(self, now_s: float) -> None:
        """Make the last status, so that no event is left out."""
        self._show(self._make(now_s, now_s if self._start_s is None else self._start_s))

    def _make(self, now_s: float, start_s: float) -> Status:
        loop, geometry = self._loop, self._neck.geometry
        command_rad = self._smoother.command.position_rad
        joints_rad = command_rad if loop.joints is None else loop.joints.position_rad
        eye_m, gaze = gaze_ray(geometry, joints_rad)
        _, aim = gaze_ray(geometry, command_rad)
        seen, plan = loop.seen, loop.plan
        age_s = None if seen is None else now_s - seen.capture_time_s
        late_s, self._late_s = self._late_s, 0.0
        return Status(
            time_s=now_s - start_s,
            age_s=age_s,
            lost=age_s is not None and age_s > self._lost_after_s,
            distance_m=None if seen is None else float(np.linalg.norm(seen.head_position_base_m - eye_m)),
            observations=self._report.observations,
            used=self._logs.used,
            joints_rad=tuple(joints_rad.tolist()),
            gaze_rad=_pan_tilt(gaze),
            aim_rad=_pan_tilt(aim),
            plan_age_s=None if plan is None else now_s - plan.start_s,
            late_ms=1e3 * late_s,
            left_out=self._report.skipped_ticks,
            events=tuple((time_s - start_s, name) for time_s, name in self._begun()),
        )

    def _begun(self) -> tuple[tuple[float, str], ...]:
        recorder = self._logs.recorder
        before: tuple[tuple[float, str], ...] = ()
        if self._recorder is not recorder:
            # A log has ended since: its last events have not been told.
            before = () if self._recorder is None else self._recorder.events_from(self._told)
            self._recorder, self._told = recorder, 0
        begun = recorder.events_from(self._told)
        self._told += len(begun)
        return before + begun


def _pan_tilt(direction: FloatArray) -> tuple[float, float]:
    x, y, z = direction.tolist()
    return math.atan2(y, x), math.atan2(z, math.hypot(x, y))
