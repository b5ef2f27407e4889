"""Shows a live run while it runs: a few lines on a terminal, or one line a second where the output is piped."""

from __future__ import annotations

import queue
import threading
from collections import Counter, deque
from collections.abc import Sequence
from types import TracebackType

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.text import Text

from gazempc.live.status import Status
from gazempc.loop.events import Event
from gazempc.neck.spec import AXES

# Rates are over this time; piped, so often a line comes.
_LINE_S = 1.0
# At the end the last lines are waited for; they take milliseconds.
_LAST_DRAWN_S = 2.0
# Statuses that wait for a terminal or a pipe that is not read; 15 s of them.
_WAITING = 60
_MEANINGS = {str(event): event.meaning for event in Event}


class StatusLine:
    """Draws statuses in a thread of its own, within a with-block.

    Args:
        joint_names: Names of the joints.
        console: Where to draw; without it standard output.
    """

    def __init__(self, joint_names: Sequence[str], console: Console | None = None) -> None:
        self._joint_names = tuple(joint_names)
        # Where the gaze is shared among more joints, each is shown, too.
        self._shared = len(joint_names) > len(AXES)
        self._console = console or Console(highlight=False)
        self._live: Live | None = None
        if self._console.is_terminal and not self._console.is_dumb_terminal:
            self._live = Live(console=self._console, auto_refresh=False)
        self._queue: queue.SimpleQueue[Status | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="status", daemon=True)
        self._recent: deque[Status] = deque()
        self._events: Counter[str] = Counter()
        self._next_line_s = _LINE_S
        self._late_ms = 0.0
        self._began: Counter[str] = Counter()

    def __enter__(self) -> StatusLine:
        """Begin to draw."""
        if self._live is not None:
            self._live.start()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Draw what is left."""
        self._queue.put(None)
        # Whoever does not read the pipe any more keeps nothing from being written and ended.
        self._thread.join(_LAST_DRAWN_S)
        if self._live is not None:
            self._live.stop()

    def show(self, status: Status) -> None:
        """Take a status; returns at once. While nobody reads, later ones are lost."""
        if self._queue.qsize() < _WAITING:
            self._queue.put(status)

    def _work(self) -> None:
        readers = True
        while (status := self._queue.get()) is not None:
            try:
                if readers:
                    self._draw(status)
            except OSError:
                readers = False  # the pipe is closed; the run goes on

    def _draw(self, status: Status) -> None:
        for time_s, name in status.events:
            if name not in self._events:
                meaning = _MEANINGS.get(name)
                self._print(f"{time_s:6.1f} s  {name}" + (f": {meaning}" if meaning else ""))
            # The latest one comes last.
            self._events[name] = self._events.pop(name, 0) + 1
            self._began[name] += 1
        while len(self._recent) > 1 and status.time_s - self._recent[1].time_s >= _LINE_S:
            self._recent.popleft()
        self._recent.append(status)
        self._late_ms = max(self._late_ms, status.late_ms)
        due = status.time_s >= self._next_line_s
        if self._live is not None:
            self._live.update(self._block(status), refresh=True)
        elif due:
            self._print(self._line(status))
        if due:
            self._next_line_s, self._late_ms = _LINE_S * (status.time_s // _LINE_S + 1.0), 0.0
            self._began.clear()

    def _print(self, text: str) -> None:
        if self._live is None:
            print(text, file=self._console.file, flush=True)
        else:
            self._console.print(Text(text))

    def _line(self, status: Status) -> str:
        joints = f"; joints {self._joints(status)}" if self._shared else ""
        began = f"; began: {_counts(self._began)}" if self._began else ""
        seen = f"{person(status)}; {observations(status, self._recent[0])}"
        loop = f"{plan(status)}; {ticks(self._late_ms, status.left_out)}"
        return f"{status.time_s:6.1f} s  {seen}; {gaze(status)}{joints}; {loop}{began}"

    def _block(self, status: Status) -> Text:
        unseen = status.age_s is None or status.lost
        rows = [
            ("person", f"{person(status)}; {observations(status, self._recent[0])}", "red" if unseen else "green"),
            ("gaze", gaze(status), ""),
            *([("joints", self._joints(status), "")] if self._shared else []),
            ("loop", f"{status.time_s:.0f} s; {plan(status)}; {ticks(self._late_ms, status.left_out)}", ""),
            *([("events", _counts(self._events), "yellow")] if self._events else []),
        ]
        text = Text(no_wrap=True, overflow="crop")
        for row, (name, said, look) in enumerate(rows):
            text.append(f"{'' if row == 0 else chr(10)}{name:<8}", "bold").append(said, look)
        return text

    def _joints(self, status: Status) -> str:
        angles_deg = np.rad2deg(status.joints_rad).tolist()
        each = (f"{name} {deg:+.1f}" for name, deg in zip(self._joint_names, angles_deg, strict=True))
        return f"{', '.join(each)} deg"


def person(status: Status) -> str:
    """Whether the person is seen, how long ago and how far away."""
    if status.age_s is None or status.distance_m is None:
        return "nobody seen yet"
    return f"{'lost, last seen' if status.lost else 'seen'} {status.age_s:.2f} s ago, {status.distance_m:.2f} m away"


def observations(status: Status, before: Status) -> str:
    """How many observations came a second, and what share of them was used, since a status before."""
    came, took_s = status.observations - before.observations, status.time_s - before.time_s
    if not came:
        return "no observations"
    share = 100.0 * (status.used - before.used) / came
    return f"{came / took_s:.0f} observations/s, {share:.0f} % used"


def gaze(status: Status) -> str:
    """Where the robot looks, and where the joints are commanded to look."""
    (pan, tilt), (aim_pan, aim_tilt) = np.rad2deg([status.gaze_rad, status.aim_rad]).tolist()
    return f"looks at pan {pan:+.1f}, tilt {tilt:+.1f} deg; aims at {aim_pan:+.1f}, {aim_tilt:+.1f}"


def plan(status: Status) -> str:
    """How old the plan in use is."""
    return "no plan" if status.plan_age_s is None else f"plan {1e3 * status.plan_age_s:.0f} ms old"


def ticks(late_ms: float, left_out: int) -> str:
    """How late ticks were."""
    return f"ticks at most {late_ms:.2f} ms late" + (f", {left_out} left out" if left_out else "")


def _counts(events: Counter[str]) -> str:
    """The latest event first."""
    return ", ".join(f"{name} {count} x" for name, count in reversed(events.items()))
