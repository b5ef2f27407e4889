"""Whether a recording can be of one person who walks near a robot: what is damaged has often a sound form."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError
from gazempc.types import FloatArray

# Longer than any walk before a robot; its replay takes an hour, too.
MOST_DURATION_S = 3600.0
# After a longer gap, another walk begins.
MOST_GAP_S = 60.0
# No sensor of a robot tells a head from farther away.
MOST_RANGE_M = 100.0
# In a frame of the floor the robot is placed beside the walk; across a campus is far enough.
MOST_EXTENT_M = 1000.0


def check_plausible(source: Path, times_s: FloatArray, head_position_m: FloatArray, at_sensor: bool) -> None:
    """Refuse recordings that last for hours, or of people kilometres away.

    Args:
        source: File, for messages.
        times_s: Times at which the head is known, shape (N,), seconds, increasing.
        head_position_m: Where it is, shape (N, 3), metres.
        at_sensor: Whether the frame's origin is the robot's sensor.

    Raises:
        RecordingError: Names the time, and what is accepted.
    """
    if not times_s.size:
        return
    steps_s = np.diff(times_s, prepend=times_s[0])
    after = int(np.argmax(steps_s))
    start_s = float(times_s[0])
    if steps_s[after] > MOST_GAP_S:
        raise RecordingError(
            source,
            "time stamps",
            f"a gap of {steps_s[after]:.4g} s, from {times_s[after - 1] - start_s:.4g} s after the first frame on",
            f"frames at most {MOST_GAP_S:g} s apart; a walk after a longer gap is another recording",
        )
    if times_s[-1] - start_s > MOST_DURATION_S:
        raise RecordingError(
            source,
            "time stamps",
            f"the recording lasts {(times_s[-1] - start_s) / 3600.0:.4g} h",
            f"{MOST_DURATION_S / 3600.0:g} h at most: cut it into walks",
        )
    away_m = head_position_m if at_sensor else head_position_m - np.median(head_position_m, axis=0)
    ranges_m = np.linalg.norm(away_m, axis=1)
    far, most_m = int(np.argmax(ranges_m)), MOST_RANGE_M if at_sensor else MOST_EXTENT_M
    if ranges_m[far] > most_m:
        from_what = "the sensor" if at_sensor else "the middle of the walk"
        raise RecordingError(
            source,
            "positions",
            f"{times_s[far] - start_s:.4g} s after the first frame the head is {ranges_m[far]:.4g} m from {from_what}",
            f"{most_m:g} m at most, in metres",
        )
