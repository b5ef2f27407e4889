"""Asks the controller for plans, at once or in the background, so that a slow one never holds up a command."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import dataclass
from typing import Protocol

from gazempc.controllers.controller import Controller, ControllerError, Plan, Situation
from gazempc.loop.events import Event


@dataclass(frozen=True)
class Answer:
    """What came of a request.

    Attributes:
        due_index: Tick at which the plan's first command is to be sent.
        plan: The plan; None if there is none.
        event: Why there is none, as it stands in the log; else empty.
        error: The exception behind the event, if there was one.
        plan_ms: How long planning took, milliseconds.
    """

    due_index: int
    plan: Plan | None
    event: str
    error: Exception | None
    plan_ms: float


class Planner(Protocol):
    """Takes one request at a time.

    Attributes:
        controller: Makes the plans.
    """

    controller: Controller

    def request(self, due_index: int, situation: Situation) -> bool:
        """Ask for a plan.

        Args:
            due_index: Tick at which its first command is to be sent.
            situation: What the controller is to know.

        Returns:
            False if the last request has not been answered yet; this one is then not taken.
        """
        ...

    def answers(self) -> list[Answer]:
        """What has been answered since the last call."""
        ...

    def close(self) -> None:
        """End it; never raises."""
        ...


class ImmediatePlanner:
    """Plans within `request`, for replays in simulated time.

    Args:
        controller: Makes the plans.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self._answered: list[Answer] = []

    def request(self, due_index: int, situation: Situation) -> bool:
        """See `Planner.request`."""
        self._answered.append(_ask(self.controller, due_index, situation))
        return True

    def answers(self) -> list[Answer]:
        """See `Planner.answers`."""
        answered, self._answered = self._answered, []
        return answered

    def close(self) -> None:
        """See `Planner.close`."""


class BackgroundPlanner:
    """Plans in a thread of its own, for a real clock.

    Args:
        controller: Makes the plans; its `plan` is called by this thread only.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self._requests: queue.SimpleQueue[tuple[int, Situation] | None] = queue.SimpleQueue()
        self._answered: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        self._busy = False
        # A controller that never returns must not keep the process alive.
        self._thread = threading.Thread(target=self._work, name="planner", daemon=True)
        self._thread.start()

    def request(self, due_index: int, situation: Situation) -> bool:
        """See `Planner.request`."""
        if self._busy:
            return False
        self._busy = True
        self._requests.put((due_index, situation))
        return True

    def answers(self) -> list[Answer]:
        """See `Planner.answers`."""
        found = []
        while True:
            try:
                found.append(self._answered.get_nowait())
            except queue.Empty:
                break
            self._busy = False
        return found

    def close(self) -> None:
        """See `Planner.close`; waits for a plan under way for a moment only."""
        self._requests.put(None)
        self._thread.join(timeout=1.0)

    def _work(self) -> None:
        while (request := self._requests.get()) is not None:
            self._answered.put(_ask(self.controller, *request))


def _ask(controller: Controller, due_index: int, situation: Situation) -> Answer:
    started = time.perf_counter()

    def answer(plan: Plan | None, event: str = "", error: Exception | None = None) -> Answer:
        return Answer(due_index, plan, event, error, 1e3 * (time.perf_counter() - started))

    try:
        plan = controller.plan(situation)
        if not isinstance(plan, Plan):
            raise TypeError(f"plan() returned {type(plan).__name__}, needed is a Plan")
        return answer(plan) if plan.is_finite() else answer(None, Event.PLAN_NOT_FINITE)
    except ControllerError as error:
        return answer(None, error.event, error)
    except Exception as error:
        return answer(None, Event.CONTROLLER_FAILED, error)
