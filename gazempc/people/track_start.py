"""The first frames of a track: one that comes late is put into its place."""

from __future__ import annotations

from predictors import HeadObservation, Predictor

# A velocity needs two frames. Over a network that delays frames by 40 to 250 ms, the first one to come is often the
# third or fourth in order of capture, and those before it follow within 0.2 s. Later in a track each frame is one of
# many: with all late frames in their places the gaze erred 0.01 to 0.03 deg less (64 walks, two seeds), which is not
# worth copies of the predictor's state.
START_S = 0.3


class TrackStart:
    """Gives one predictor its observations, those of the first 0.3 s of a track in the order of their capture.

    If one of these comes late, the predictor is reset and takes all of them in again. So the track may begin earlier
    than with the observation that came first. Where observations come in order, the predictor gets them as they come.

    Args:
        predictor: The predictor.
    """

    def __init__(self, predictor: Predictor) -> None:
        self._predictor = predictor
        self._forget()

    def _forget(self) -> None:
        self._first: list[HeadObservation] = []
        self._newest_s = 0.0

    def reset(self) -> None:
        """Forget the person; the predictor does, too."""
        self._predictor.reset()
        self._forget()

    def update(self, observation: HeadObservation) -> None:
        """Give the predictor one observation.

        Args:
            observation: The observation.

        Raises:
            OutOfOrderError: If it is older than the newest one and comes after the start, or is there already.
            Exception: Whatever the predictor raises.
        """
        captured_s = observation.capture_time_s
        if self._has_place_for(captured_s):
            self._first = sorted([*self._first, observation], key=lambda each: each.capture_time_s)
            self._predictor.reset()
            for each in self._first:
                self._predictor.update(each)
            return
        self._predictor.update(observation)
        self._newest_s = captured_s
        if not self._first or captured_s - self._first[0].capture_time_s <= START_S:
            self._first.append(observation)

    def _has_place_for(self, captured_s: float) -> bool:
        if not self._first or captured_s >= self._newest_s:
            return False
        within = self._newest_s - min(captured_s, self._first[0].capture_time_s) <= START_S
        return within and all(each.capture_time_s != captured_s for each in self._first)
