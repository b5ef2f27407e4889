"""Why faces are rare: few pictures, a slow search, or pictures without a face."""

from __future__ import annotations

from collections import deque

import numpy as np

from gazempc.people.tracker_faults import LOW_RATE_HZ, is_low_rate

_WINDOW_S, _LEAST_PICTURES, _LEAST_FACES = 4.0, 4, 3
# The search takes nearly all of the time between two pictures.
_BUSY = 0.8


class FaceRate:
    """Judges the pictures of the last four seconds, once in a run."""

    def __init__(self) -> None:
        self._pictures: deque[tuple[float, bool, float]] = deque()
        self._told = False
        self._first_s: float | None = None

    def judge(self, captured_s: float, found: bool, search_s: float) -> str:
        """Take note of a picture.

        Args:
            captured_s: When it was captured, seconds; later than the one before.
            found: Whether a face was found in it.
            search_s: Time of the search, seconds.

        Returns:
            Why fewer than six faces a second are found; empty if that is not so, or was returned before.
        """
        self._first_s = captured_s if self._first_s is None else self._first_s
        self._pictures.append((captured_s, found, search_s))
        while self._pictures[0][0] < captured_s - _WINDOW_S:
            self._pictures.popleft()
        times_s, faces, searches_s = (np.array(column) for column in zip(*self._pictures, strict=True))
        enough = captured_s - self._first_s >= _WINDOW_S and times_s.size >= _LEAST_PICTURES
        if self._told or not enough or faces.sum() < _LEAST_FACES or not is_low_rate(times_s[faces]):
            return ""
        self._told = True
        every_s, search_s = float(np.median(np.diff(times_s))), float(np.median(searches_s))
        below = f"below {LOW_RATE_HZ:.0f} faces a second the gaze trails a walking person"
        if not is_low_rate(times_s):
            return (
                f"a face in {100 * faces.mean():.0f} % of {1 / every_s:.0f} pictures a second; {below}: more light, a "
                "nearer person, or a camera that sees faces from the front"
            )
        if search_s > _BUSY * every_s:
            return (
                f"the search takes {1e3 * search_s:.0f} ms a picture, so {1 / every_s:.1f} pictures a second are "
                f"searched; {below}: a faster or less busy computer"
            )
        return (
            f"camera or video give {1 / every_s:.1f} pictures a second; {below}: a larger --camera.fps, or more light, "
            "as many cameras slow down in the dark"
        )
