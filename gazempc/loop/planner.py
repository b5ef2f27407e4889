"""Calls predictor and controller, synchronously or in a thread, so that a slow part does not delay commands."""

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

# Computes the controller's input, forecast included; None without a forecast.
Situate = Callable[[], Situation | None]


@dataclass(frozen=True)
class Answer:
    """Result of a planning request.

    Attributes:
        due_index: Tick at which the plan's first command is to be sent.
        plan: The plan; None after a failure.
        error: The failure; None for a plan.
        plan_ms: Computing time of forecast and plan, milliseconds.
    """

    due_index: int
    plan: Plan | None
    error: PartError | None
    plan_ms: float

    @property
    def event(self) -> str:
        """Name of the event of a failure."""
        failure = self.error and self.error.error
        return failure.event if isinstance(failure, ControllerError) else Event.CONTROLLER_FAILED


class ImmediatePlanner:
    """Synchronous planner for replays in simulated time: computes within `update` and `request`.

    Args:
        controller: Computes the plans.

    Attributes:
        controller: The same.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self._answered: list[Answer] = []

    def update(self, assimilate: Callable[[], None]) -> None:
        """Run a function that updates the predictor, before the next plan."""
        assimilate()

    def request(self, due_index: int, situate: Situate) -> bool:
        """Request a plan.

        Args:
            due_index: Tick at which its first command is to be sent.
            situate: Computes the controller's input.

        Returns:
            False if the previous request is still pending; this one is then rejected.
        """
        self._answered += _ask(self.controller, due_index, situate)
        return True

    def answers(self) -> list[Answer]:
        """Answers since the last call."""
        answered, self._answered = self._answered, []
        return answered

    def slow_calls(self, ended: bool) -> list[TimeoutError | None]:
        """Slow calls, see `gazempc.loop.boundary.slow_calls`; none here, as computing takes no simulated time."""
        return []

    def close(self) -> None:
        """Release the planner; never raises."""


class BackgroundPlanner:
    """Planner in a thread, for real time; during a call only the newest update is kept.

    Args:
        controller: Computes the plans; its methods are called by this thread only.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        # Queues of length one; the event wakes the thread.
        self._pending: deque[Callable[[], None]] = deque(maxlen=1)
        self._asked: deque[tuple[int, Situate]] = deque(maxlen=1)
        self._wake = threading.Event()
        self._answered: queue.SimpleQueue[list[Answer] | BaseException] = queue.SimpleQueue()
        self._busy = self._closed = False
        # A part that never returns must not keep the process alive.
        self._thread = threading.Thread(target=self._work, name="planner", daemon=True)
        self._thread.start()

    def update(self, assimilate: Callable[[], None]) -> None:
        """See `ImmediatePlanner.update`."""
        self._pending.append(assimilate)
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
            BaseException: An internal error that has ended the thread.
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
        """See `ImmediatePlanner.close`; waits only briefly for a call in progress."""
        self._closed = True
        self._wake.set()
        self._thread.join(timeout=1.0)

    def _work(self) -> None:
        try:
            while not self._closed:
                self._wake.wait()
                self._wake.clear()
                if self._pending:
                    self._pending.popleft()()
                if self._asked:
                    self._answered.put(_ask(self.controller, *self._asked.popleft()))
        except BaseException as error:
            self._answered.put(error)


Planner = ImmediatePlanner | BackgroundPlanner


def _ask(controller: Controller, due_index: int, situate: Situate) -> list[Answer]:
    started = time.perf_counter()
    situation = situate()
    if situation is None:
        return []
    plan, failures = None, list[PartError]()
    with boundary(controller, "plan", failures.append):
        plan = checked_plan(controller.plan(situation), situation.joint_position_rad.size)
    return [Answer(due_index, plan, next(iter(failures), None), 1e3 * (time.perf_counter() - started))]
