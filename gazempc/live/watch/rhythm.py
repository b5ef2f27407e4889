"""Whether frames come often enough, and whether the tracker's names mean anything."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gazempc.live.watch.frame import Finding, Frame
from gazempc.live.watch.mends import Mends
from gazempc.loop.events import Event
from gazempc.people.tracker_faults import LOW_RATE_HZ, is_low_rate
from gazempc.types import FloatArray

# Of so many frames nearly each has a name of its own.
_NAMED_FRAMES, _OWN_NAME_SHARE = 6, 0.9


def judge_rate(times_s: FloatArray, lost_after_s: float, mends: Mends) -> list[Finding]:
    """Find out whether frames come less often than six times a second.

    Args:
        times_s: Times of the frames, of capture if these can be believed, shape (F,), seconds.
        lost_after_s: The loop brakes after so long without a frame, seconds.
        mends: Names what mends it.

    Returns:
        What is wrong.
    """
    if not is_low_rate(times_s):
        return []
    every_s = float(np.median(np.diff(np.unique(times_s))))
    text = (
        f"{1.0 / every_s:.1f} frames a second: below {LOW_RATE_HZ:.0f} the gaze trails everybody who walks; make the "
        "tracker faster, with a smaller picture say"
    )
    if every_s > lost_after_s:
        text += f"; the neck stops after each frame: {mends.setting('loop', 'lost_after_s', round(2.5 * every_s, 1))}"
    return [Finding(Event.LOW_FRAME_RATE, text)]


def judge_ids(frames: Sequence[Frame], mends: Mends) -> list[Finding]:
    """Find out whether every frame has another name.

    Args:
        frames: The frames of the last second.
        mends: Names what mends it.

    Returns:
        What is wrong.
    """
    names = [frame.person_id for frame in frames if frame.person_id is not None]
    if len(names) < _NAMED_FRAMES or len(set(names)) < _OWN_NAME_SHARE * len(names):
        return []
    text = (
        f"{len(set(names))} names of people in {len(names)} frames: looks like the number of the detection; send the "
        f"track's name as person_id, or say {mends.no_ids}"
    )
    return [Finding(Event.NEW_ID_EACH_FRAME, text)]
