"""A predictor in a process of its own: what holds the interpreter's lock there holds up no command here."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from numpy.typing import ArrayLike

from gazempc.live.process import second_to_the_run
from predictors import Forecast, HeadObservation, Predictor


class IsolatedPredictor:
    """Passes each call to a predictor in another process, and waits for its answer without the lock.

    Args:
        make: Makes the predictor there; can be pickled.

    Attributes:
        rejections_in_a_row: As the predictor has it after the last call.
    """

    def __init__(self, make: Callable[[], Predictor]) -> None:
        context = multiprocessing.get_context("spawn")
        self.rejections_in_a_row = 0
        self._line, theirs = context.Pipe()
        # It ends with this process, or when nothing is left at this end of the line.
        context.Process(target=_serve, args=(theirs, make), name="predictor", daemon=True).start()
        theirs.close()
        self.reset()

    def _ask(self, method: str, *args: Any) -> Any:
        self._line.send((method, args))
        answer, self.rejections_in_a_row = self._line.recv()
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def reset(self) -> None:
        """See `predictors.predictor.Predictor.reset`."""
        self._ask("reset")

    def update(self, observation: HeadObservation) -> None:
        """See `predictors.predictor.Predictor.update`."""
        self._ask("update", observation)

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """See `predictors.predictor.Predictor.forecast`."""
        found: Forecast = self._ask("forecast", times_s)
        return found


def _serve(line: Connection, make: Callable[[], Predictor]) -> None:
    second_to_the_run()
    predictor = make()
    while True:
        try:
            method, args = line.recv()
        except EOFError:
            return
        try:
            answer = getattr(predictor, method)(*args)
        except BaseException as error:  # also of sys.exit
            answer = error
        line.send((answer, getattr(predictor, "rejections_in_a_row", 0)))
