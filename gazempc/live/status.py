"""Status lines of a live run: one line a second, and the meaning of each event when it first begins."""

from __future__ import annotations

import sys
import threading
from collections import Counter, deque
from contextlib import suppress
from typing import TextIO

import numpy as np

from gazempc.loop.events import MEANINGS
from gazempc.neck.kinematics import gaze_ray, pan_tilt_rad
from gazempc.neck.spec import AXES, NeckSpec
from gazempc.results.moments import EventMoment, LateMoment, Moment, StatusMoment, TickMoment

# Period of lines, and averaging time of rates.
_LINE_S = 1.0
# Timeout of the last lines, which take milliseconds.
_LAST_S = 2.0
# Length of the queue for a blocked terminal or pipe: some 15 s at 200 Hz.
_WAITING = 5000


class StatusLine:
    """Prints the status in a separate thread, within a with-block.

    Args:
        neck: The neck.
        lost_after_s: Age of the newest observation from which on the person is lost, seconds.
        file: Output stream; default: standard output.
        wait_s: Timeout of the end of the block for a blocked reader, seconds.
    """

    def __init__(
        self, neck: NeckSpec, lost_after_s: float, file: TextIO | None = None, wait_s: float = _LAST_S
    ) -> None:
        self._neck, self._lost_after_s, self._wait_s = neck, lost_after_s, wait_s
        self._file = file or sys.stdout
        # Of the thread of the run.
        self._start_s: float | None = None
        self._waiting: deque[LateMoment | EventMoment | StatusMoment] = deque(maxlen=_WAITING)
        self._due, self._ended = threading.Event(), False
        # Of the thread that prints.
        self._thread = threading.Thread(target=self._work, name="status", daemon=True)
        self._recent: deque[StatusMoment] = deque()
        self._explained, self._began = set[str](), Counter[str]()
        self._next_line_s, self._late_ms, self._skipped = _LINE_S, 0.0, 0

    def __enter__(self) -> StatusLine:
        """Begin to print."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Print the rest; a pipe without a reader does not block the end of the run."""
        self._ended = True
        self._due.set()
        self._thread.join(self._wait_s)

    def take(self, moment: Moment) -> None:
        """Process a moment of the run; returns at once. Without a reader the oldest moments are lost."""
        if self._start_s is None and isinstance(moment, TickMoment | StatusMoment):
            self._start_s = moment.time_s
        if isinstance(moment, LateMoment | EventMoment | StatusMoment):
            self._waiting.append(moment)
        if isinstance(moment, StatusMoment):
            self._due.set()

    def _work(self) -> None:
        with suppress(OSError):  # the pipe is closed; the run goes on
            while not self._ended or self._waiting:
                self._due.wait()
                self._due.clear()
                while self._waiting:
                    self._show(self._waiting.popleft())

    def _show(self, moment: LateMoment | EventMoment | StatusMoment) -> None:
        match moment:
            case LateMoment():
                self._late_ms = max(self._late_ms, moment.late_ms)
                self._skipped += moment.skipped
            case EventMoment(name=name):
                if name not in self._explained:
                    self._explained.add(name)
                    meaning = MEANINGS.get(name)
                    self._print(moment.time_s, f"{name}: {meaning}" if meaning else name)
                self._began[name] = self._began.pop(name, 0) + 1  # the latest one is the last
            case StatusMoment():
                while len(self._recent) > 1 and moment.time_s - self._recent[1].time_s >= _LINE_S:
                    self._recent.popleft()
                self._recent.append(moment)
                elapsed_s = moment.time_s - (self._start_s or 0.0)
                if elapsed_s >= self._next_line_s:
                    self._print(moment.time_s, self._line(moment))
                    self._next_line_s, self._late_ms = _LINE_S * (elapsed_s // _LINE_S + 1.0), 0.0
                    self._began.clear()

    def _print(self, time_s: float, text: str) -> None:
        print(f"{time_s - (self._start_s or 0.0):6.1f} s  {text}", file=self._file, flush=True)

    def _line(self, state: StatusMoment) -> str:
        neck = self._neck
        eye_m, direction = gaze_ray(neck.geometry, state.joints_rad)
        _, aim = gaze_ray(neck.geometry, state.command_rad)
        person = "no person seen yet"
        if state.capture_time_s is not None and state.head_base_m is not None:
            age_s = state.time_s - state.capture_time_s
            seen = "lost, last seen" if age_s > self._lost_after_s else "seen"
            person = f"{seen} {age_s:.2f} s ago, {np.linalg.norm(state.head_base_m - eye_m):.2f} m away"
        (pan, tilt), (aim_pan, aim_tilt) = np.rad2deg(pan_tilt_rad(np.array([direction, aim]))).tolist()
        parts = [
            person,
            self._observations(state),
            f"looks at pan {pan:+.1f}, tilt {tilt:+.1f} deg",
            f"aims at {aim_pan:+.1f}, {aim_tilt:+.1f}",
        ]
        if neck.joints > len(AXES):
            angles_deg = zip(neck.joint_names, np.rad2deg(state.joints_rad).tolist(), strict=True)
            parts.append("joints " + ", ".join(f"{name} {deg:+.1f}" for name, deg in angles_deg) + " deg")
        started_s = state.plan_start_s
        parts.append("no plan" if started_s is None else f"plan {1e3 * (state.time_s - started_s):.0f} ms old")
        left_out = f", {self._skipped} skipped" if self._skipped else ""
        parts.append(f"ticks at most {self._late_ms:.2f} ms late{left_out}")
        if self._began:
            began = ", ".join(f"{name} {count} x" for name, count in reversed(self._began.items()))
            parts.append(f"began: {began}")
        return "; ".join(parts)

    def _observations(self, state: StatusMoment) -> str:
        before = self._recent[0]
        came = state.observations - before.observations
        if not came:
            return "no observations"
        share = 100.0 * (state.used - before.used) / came
        return f"{came / (state.time_s - before.time_s):.0f} observations/s, {share:.0f} % used"
