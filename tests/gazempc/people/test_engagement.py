"""Engagement: the published measure, its window and the policy."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gazempc.people.company import Company
from gazempc.people.engagement import WINDOW_S, Engagement, visual_engagement
from gazempc.people.person import PersonState
from gazempc.people.policies import Engaged


def watcher(distance_m, off_deg=0.0, number=1):
    """A person straight ahead who looks past the robot by an angle."""
    quat = Rotation.from_euler("z", 180.0 + off_deg, degrees=True).as_quat(scalar_first=True)
    return PersonState(number, None, 0.0, np.array([distance_m, 0.0, 0.0]), np.zeros(3), quat, 0.0, 0.0)


def watched(engagement, state, seconds, from_s=0.0):
    found = None
    for k in range(round(seconds * 20) + 1):
        found = engagement.update(Company(from_s + k / 20, (state,)))[state.number]
    return found


def test_the_measure_is_the_published_one():
    # gaze = 1 - tan(off) / tan(60 deg), distance = log(4 - d + 1) / log(5).
    assert visual_engagement(watcher(1.0)) == pytest.approx(math.log(4.0) / math.log(5.0))
    expected = (1 - math.tan(math.radians(30)) / math.tan(math.radians(60))) * math.log(3.0) / math.log(5.0)
    assert visual_engagement(watcher(2.0, 30.0)) == pytest.approx(expected)
    assert visual_engagement(watcher(2.0, 61.0)) == 0.0
    assert visual_engagement(watcher(2.0, 180.0)) == 0.0
    assert visual_engagement(watcher(4.1)) == 0.0


def test_engagement_is_undecided_before_a_full_window():
    engagement = Engagement()
    assert watched(engagement, watcher(1.0), WINDOW_S - 0.1) is None
    assert watched(engagement, watcher(1.0), 0.1, WINDOW_S) is True
    assert watched(engagement, watcher(1.0, 90.0), 1.0, WINDOW_S + 0.2) is True
    assert watched(engagement, watcher(1.0, 90.0), 4.0, WINDOW_S + 1.3) is False


def test_a_gap_restarts_the_window():
    engagement = Engagement()
    assert watched(engagement, watcher(1.0), 6.0) is True
    assert watched(engagement, watcher(1.0), 1.0, from_s=10.0) is None


def test_engaged_people_come_before_nearer_ones():
    policy = Engaged()
    near, far = watcher(1.0, 80.0, number=1), watcher(1.5, number=2)
    for k in range(120):
        scores = policy.scores(Company(k / 20, (near, far)))
        assert np.argmax(scores) == (1 if k / 20 >= WINDOW_S else 0)
