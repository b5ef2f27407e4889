"""A predictor in a separate process: it cannot block commands by holding the global interpreter lock."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from numpy.typing import ArrayLike

from gazempc.live.process import start_child
from predictors import Forecast, HeadObservation, Predictor


class IsolatedPredictor:
    """Proxy of a predictor in another process; waits for replies without the lock.

    Args:
        make: Factory of the predictor; can be pickled.

    Attributes:
        rejections_in_a_row: The predictor's attribute after the last call.
    """

    def __init__(self, make: Callable[[], Predictor]) -> None:
        self.rejections_in_a_row = 0
        # The process ends with this one, or when this end of the pipe is closed.
        _, self._line = start_child("predictor", _serve, make)
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
    predictor = make()
    with suppress(EOFError):  # the run has ended
        while True:
            method, args = line.recv()
            try:
                answer = getattr(predictor, method)(*args)
            except BaseException as error:  # also of sys.exit
                answer = error
            line.send((answer, getattr(predictor, "rejections_in_a_row", 0)))
