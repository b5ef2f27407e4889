"""Heads that cannot be: refused one by one, whatever the tracker says."""

from __future__ import annotations

from collections import deque

import numpy as np

from gazempc.live.watch.frame import shown
from gazempc.types import FloatArray

# A robot's own head is within this of its pan axis, and no tracker sees a face farther off than the other.
_NEAREST_M, _FARTHEST_M = 0.2, 30.0
# No pan axis is higher over the floor than this: what is lower still is below the floor. No head is higher up, either.
_HIGHEST_M = 3.0
# Sprinters reach 10 m/s, people in a room 3. Trackers jump; what flies in one direction for half a second is no jump.
_FASTEST_M_S = 6.0
_PARTS, _PART_S = 4, 0.125
_MEMORY_S = _PARTS * _PART_S
# Names of people are the tracker's: there may be as many as frames.
_NAMES_MAX = 32


class Plausibility:
    """Judges heads in the base frame by their place and by how they have moved."""

    def __init__(self) -> None:
        self._paths: dict[str | None, deque[tuple[float, FloatArray]]] = {}

    def refusal(self, capture_s: float, head_base_m: FloatArray, person_id: str | None) -> str:
        """Why a head cannot be a person's.

        Args:
            capture_s: Time of capture, seconds.
            head_base_m: Its place, shape (3,), metres.
            person_id: How the tracker calls the person.

        Returns:
            A sentence; empty if it can be.
        """
        if why := out_of_place(head_base_m):
            return why
        return self._too_fast(capture_s, head_base_m, person_id)

    def _too_fast(self, capture_s: float, head_m: FloatArray, person_id: str | None) -> str:
        path = self._paths.pop(person_id, None) or deque()
        if path and capture_s <= path[-1][0]:
            self._paths[person_id] = path
            return ""  # out of order, which the predictor tells
        path.append((capture_s, head_m))
        # Up to a little before half a second ago, so that half a second is always there.
        while len(path) > 1 and path[1][0] <= capture_s - _MEMORY_S:
            path.popleft()
        self._paths[person_id] = path
        while len(self._paths) > _NAMES_MAX:
            del self._paths[next(iter(self._paths))]
        if path[0][0] > capture_s - _MEMORY_S:
            return ""
        times_s = np.array([time_s for time_s, _ in path])
        marks = np.searchsorted(times_s, capture_s - _PART_S * np.arange(_PARTS, -1, -1), side="right") - 1
        if np.any(np.diff(marks) < 1):
            return ""  # too few frames to tell a jump from a flight
        heads_m = np.array([path[mark][1] for mark in marks])
        moved_m = heads_m[-1] - heads_m[0]
        way_m = float(np.linalg.norm(moved_m))
        if way_m == 0.0:
            return ""
        speeds_m_s = np.diff(heads_m, axis=0) @ moved_m / way_m / np.diff(times_s[marks])
        if np.all(speeds_m_s > _FASTEST_M_S):
            return f"the head flies at {np.median(speeds_m_s):.0f} m/s: faster than {_FASTEST_M_S:.0f} m/s nobody moves"
        return ""


def out_of_place(head_base_m: FloatArray) -> str:
    """Why no head can be there.

    Args:
        head_base_m: The place, shape (3,), metres.

    Returns:
        A sentence; empty if one can be.
    """
    range_m, up_m = float(np.linalg.norm(head_base_m)), float(head_base_m[2])
    if range_m < _NEAREST_M:
        return f"the head is {range_m:.2f} m from the neck's pan axis: nearer than {_NEAREST_M} m it is the robot's own"
    if not range_m <= _FARTHEST_M:
        return f"the head is {shown(range_m)} m away: farther than {_FARTHEST_M:.0f} m nobody is looked at"
    if abs(up_m) > _HIGHEST_M:
        where = "above the pan axis: no head is so high" if up_m > 0 else "below the pan axis: that is under the floor"
        return f"the head is {abs(up_m):.1f} m {where}"
    return ""
