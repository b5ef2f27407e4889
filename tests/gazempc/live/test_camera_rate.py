"""Why faces are rare: the cause that is named is the one that was made."""

import numpy as np
import pytest

from gazempc.live.sources.camera.worker import FaceRate


def told(rate_hz, found, search_s, seconds=12.0):
    rate = FaceRate()
    times_s = np.arange(0.0, seconds, 1 / rate_hz)
    return [text for k, at_s in enumerate(times_s) if (text := rate.judge(at_s, found(k), search_s))]


@pytest.mark.parametrize(
    ("rate_hz", "found", "search_s", "cause"),
    [
        (3, lambda k: True, 0.03, "camera or video give 3.0 pictures a second"),
        (4, lambda k: True, 0.18, "the search takes 180 ms a picture"),  # a busy computer
        (3, lambda k: True, 0.30, "the search takes 300 ms a picture"),
        (30, lambda k: k % 10 == 0, 0.03, " % of 30 pictures a second"),
        (30, lambda k: k % 30 < 3, 0.03, None),  # three in a row, then none: their intervals are short
        (30, lambda k: True, 0.03, None),
        (7, lambda k: True, 0.14, None),
        (30, lambda k: False, 0.03, None),
    ],
)
def test_the_cause_of_rare_faces_is_named_once(rate_hz, found, search_s, cause):
    texts = told(rate_hz, found, search_s)
    assert len(texts) == (cause is not None)
    assert cause is None or cause in texts[0]
