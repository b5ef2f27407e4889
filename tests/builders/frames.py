"""Frames of a source, and the findings on them."""

import numpy as np

from gazempc.live.clock import SimulatedClock
from gazempc.live.mount import Mount
from gazempc.live.plausibility import Plausibility, Watch, judge_place
from gazempc.live.stamps import Frame, SetupHints
from gazempc.settings import LoopSettings
from predictors import HeadObservation

FRAME_S = 1 / 30
# When the frames of a short track were captured.
TRACK_S = np.arange(28) / 30.0


def refused(heads_m, frame_s=FRAME_S, names=None):
    """Frames that are refused."""
    judge, names = Plausibility(), names or [None] * len(heads_m)
    return [bool(judge.refusal(k * frame_s, np.asarray(head), names[k])) for k, head in enumerate(heads_m)]


def judged_place(sent, mount=None, names=None):
    """Findings on a short track; heads in the tracker's frame."""
    mount, judged = mount or Mount(), []
    for time_s, head, name in zip(TRACK_S, sent, names or [None] * TRACK_S.size, strict=True):
        seen = mount.in_sensor(HeadObservation(float(time_s), np.array(head)))
        base_m = mount.to_base(seen, None, None).head_position_base_m
        judged.append(Frame(time_s + 0.05, time_s, seen.head_position_base_m, base_m, name))
    return [(str(event), text) for event, text in judge_place(judged, TRACK_S, mount, SetupHints())]


def frames(*people_m, seconds=2.0, name=lambda k, i: None):
    for k in range(int(30 * seconds)):
        for i, at_m in enumerate(people_m):
            head_m = np.array(at_m, dtype=float)
            yield Frame(k / 30 + 0.05, k / 30, head_m, head_m, name(k, i))


def findings(given):
    watch, found = Watch(SimulatedClock(), None, Mount(), LoopSettings(), SetupHints(), several=True), {}
    for frame in given:
        watch.observe(frame)
        found |= {str(finding.event): finding.text for finding in watch.findings(frame.arrival_s)}
    return found
