"""Among several people the watch judges the frames of one."""

import numpy as np

from gazempc.live.clock import SimulatedClock
from gazempc.live.hints import Frame, SetupHints
from gazempc.live.mount import Mount
from gazempc.live.watch import FollowedPerson, Watch
from gazempc.settings import LoopSettings
from predictors import HeadObservation


class Attends:
    """Looks at whoever is nearest to a place."""

    def __init__(self, at_m):
        self.newest = None if at_m is None else HeadObservation(0.0, np.array(at_m))


def frames(*people_m, seconds=2.0, name=lambda k, i: None):
    for k in range(int(30 * seconds)):
        for i, at_m in enumerate(people_m):
            head_m = np.array(at_m, dtype=float)
            yield Frame(k / 30 + 0.05, k / 30, head_m, head_m, name(k, i))


def told(given, at_m=None):
    found = []
    followed = FollowedPerson(found.append, Attends(at_m))
    for frame in given:
        followed.see(frame)
    return found


def said(given, at_m=None):
    watch, found = Watch(SimulatedClock(), None, Mount(), LoopSettings(), SetupHints()), []
    followed = FollowedPerson(watch.see, Attends(at_m))
    for frame in given:
        followed.see(frame)
        found += [str(finding.event) for finding in watch.findings(frame.arrival_s)]
    return found


LEFT, RIGHT = [2.0, 1.5, 0.3], [2.5, -1.5, 0.3]


def test_one_frame_an_instant_is_told_of_whoever_is_looked_at():
    for at_m, i in ((LEFT, 0), (RIGHT, 1)):
        seen = told(frames(LEFT, RIGHT), at_m)
        assert len(seen) == 59
        assert {tuple(frame.sensor_m) for frame in seen} == {tuple((LEFT, RIGHT)[i])}


def test_several_people_without_names_are_no_alarm():
    assert said(frames(LEFT, RIGHT, [4.0, 0.0, 0.2])) == []


def test_a_wrong_unit_and_new_names_are_noticed_among_several():
    millimetres = [list(1e3 * np.array(at_m)) for at_m in (LEFT, RIGHT)]
    assert said(frames(*millimetres)) == ["wrong_unit"]
    assert said(frames(LEFT, RIGHT, name=lambda k, i: f"{2 * k + i}"), LEFT) == ["new_id_each_frame"]
