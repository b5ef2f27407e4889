"""Engaged or not: are the decisions those that the names of recorded bags say?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError
from gazempc.people.company import Company
from gazempc.people.engagement import Engagement
from gazempc.people.person import PersonState
from gazempc.recordings.recording import Recording
from gazempc.recordings.together import load_together

# What the folder of somebody who is engaged has in its name, and that of somebody who is not.
_ENGAGED, _NOT = "eng", "dis"


@dataclass(frozen=True)
class Decided:
    """For how long it was decided rightly, wrongly and not at all, seconds.

    Attributes:
        faces: Of how many faces.
        right_s: As the name of the bag says.
        wrong_s: Otherwise.
        undecided_s: Not decided.
    """

    faces: int
    right_s: float
    wrong_s: float
    undecided_s: float


def decided(folder: Path) -> Decided:
    """Watch everybody on the bags of a folder.

    Args:
        folder: Folder of bags, whose names say what their people do: ``eng`` for engaged, ``dis`` for not.

    Returns:
        Times over all faces.

    Raises:
        RecordingError: If there are no bags.
    """
    bags = sorted(path.parent for path in folder.glob("*/metadata.yaml"))
    if not bags:
        raise RecordingError(str(folder), "", "no bags", "a folder of ROS 2 bags")
    each = [
        _decided(walk, _ENGAGED in bag.name and _NOT not in bag.name) for bag in bags for walk in load_together(bag)
    ]
    return Decided(len(each), *np.sum(each, axis=0).tolist())


def _decided(walk: Recording, truth: bool) -> tuple[float, float, float]:
    engagement, track = Engagement(), walk.measured or walk.truth
    found_s: dict[bool | None, float] = {True: 0.0, False: 0.0, None: 0.0}
    step_s = np.diff(walk.times_s, prepend=walk.times_s[0]).tolist()
    for k, time_s in enumerate(walk.times_s.tolist()):
        head_m, quat = track.head_position_m[k], track.head_quat_wxyz[k]
        state = PersonState(1, None, time_s, head_m, np.zeros(3), quat, time_s, 0.0)
        engaged = engagement.update(Company(time_s, (state,)))[1]
        found_s[None if engaged is None else engaged == truth] += step_s[k]
    return found_s[True], found_s[False], found_s[None]
