"""Asks for forecasts and plans, at once or in the background, so that a slow part never holds up a command."""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from gazempc.controllers.controller import Controller, ControllerError, Plan, Situation
from gazempc.loop.boundary import PartError, boundary, checked_plan, slow_calls
from gazempc.loop.events import Event

# Makes the situation for which to plan, which needs a forecast; None without one.
Situate = Callable[[], Situation | None]


@dataclass(frozen=True)
class Answer:
    """Result of a planning request.

    Attributes:
        due_index: Tick at which the plan's first command is to be sent.
        plan: The plan; None if there is none.
        event: Why there is none, as it stands in the log; else empty.
        error: The exception behind the event, if there was one.
        plan_ms: How long forecast and plan took, milliseconds.
    """

    due_index: int
    plan: Plan | None
    event: str
    error: Exception | None
    plan_ms: float


class ImmediatePlanner:
    """Takes observations in, and takes one request at a time; plans within `request`, for replays in simulated time.

    Args:
        controller: Makes the plans.

    Attributes:
        controller: The same.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self._answered: list[Answer] = []

    def see(self, take_in: Callable[[], None]) -> None:
        """Take observations in, before the next plan."""
        take_in()

    def request(self, due_index: int, situate: Situate) -> bool:
        """Ask for a plan.

        Args:
            due_index: Tick at which its first command is to be sent.
            situate: Makes the controller's input.

        Returns:
            False if the last request has not been answered yet; this one is then not taken.
        """
        self._answered += _ask(self.controller, due_index, situate)
        return True

    def answers(self) -> list[Answer]:
        """What has been answered since the last call."""
        answered, self._answered = self._answered, []
        return answered

    def slow_calls(self, ended: bool) -> list[TimeoutError | None]:
        """Calls of parts that take long, see `gazempc.loop.boundary.slow_calls`; here computing takes no time."""
        return []

    def close(self) -> None:
        """End it; never raises."""


class BackgroundPlanner:
    """The same in a thread of its own, for a real clock; while a call is under way, only the newest frame is kept.

    Args:
        controller: Makes the plans; its methods are called by this thread only.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        # Mailboxes with one place each; the event wakes the thread up.
        self._take_in: deque[Callable[[], None]] = deque(maxlen=1)
        self._asked: deque[tuple[int, Situate]] = deque(maxlen=1)
        self._wake = threading.Event()
        self._answered: queue.SimpleQueue[list[Answer] | BaseException] = queue.SimpleQueue()
        self._busy = self._closed = False
        # A part that never returns must not keep the process alive.
        self._thread = threading.Thread(target=self._work, name="planner", daemon=True)
        self._thread.start()

    def see(self, take_in: Callable[[], None]) -> None:
        """See `ImmediatePlanner.see`."""
        self._take_in.append(take_in)
        self._wake.set()

    def request(self, due_index: int, situate: Situate) -> bool:
        """See `ImmediatePlanner.request`."""
        if self._busy:
            return False
        self._busy = True
        self._asked.append((due_index, situate))
        self._wake.set()
        return True

    def answers(self) -> list[Answer]:
        """See `ImmediatePlanner.answers`.

        Raises:
            BaseException: A fault of the program in the thread, which has ended.
        """
        found: list[Answer] = []
        while not self._answered.empty():
            answered = self._answered.get_nowait()
            if isinstance(answered, BaseException):
                raise answered
            found += answered
            self._busy = False
        return found

    def slow_calls(self, ended: bool) -> list[TimeoutError | None]:
        """See `ImmediatePlanner.slow_calls`."""
        return slow_calls(self._thread.ident or 0, ended)

    def close(self) -> None:
        """See `ImmediatePlanner.close`; waits for a call under way for a moment only."""
        self._closed = True
        self._wake.set()
        self._thread.join(timeout=1.0)

    def _work(self) -> None:
        try:
            while not self._closed:
                self._wake.wait()
                self._wake.clear()
                if self._take_in:
                    self._take_in.popleft()()
                if self._asked:
                    self._answered.put(_ask(self.controller, *self._asked.popleft()))
        except BaseException as error:
            self._answered.put(error)


Planner = ImmediatePlanner | BackgroundPlanner


def _ask(controller: Controller, due_index: int, situate: Situate) -> list[Answer]:
    started = time.perf_counter()

    def answer(plan: Plan | None, event: str = "", error: Exception | None = None) -> list[Answer]:
        return [Answer(due_index, plan, event, error, 1e3 * (time.perf_counter() - started))]

    situation = situate()
    if situation is None:
        return []
    try:
        with boundary(controller, "plan"):
            plan = checked_plan(controller.plan(situation), situation.joint_position_rad.size)
    except PartError as failed:
        event = failed.error.event if isinstance(failed.error, ControllerError) else Event.CONTROLLER_FAILED
        return answer(None, event, failed)
    return answer(plan)
