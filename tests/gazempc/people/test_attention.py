"""Selection of the attended person: policies, hysteresis, dwell time, limits; the published engagement measure."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gazempc.errors import SettingsError
from gazempc.people.attention import Attention
from gazempc.people.company import Company, Sound
from gazempc.people.person import PersonState
from gazempc.people.policies import WINDOW_S, Engaged, Nearest, make_policy, visual_engagement
from gazempc.settings import AttentionSettings

TICK_S = 0.02


def person(number, x=2.0, y=0.0, velocity=(0.0, 0.0), tracker_id=None, quat=None):
    return PersonState(
        number, tracker_id, 0.0, np.array([x, y, 0.4]), np.array([*velocity, 0.0]), quat, seen_s=0.0, since_s=0.0
    )


def scores(choice, people, time_s=0.0, sounds=(), attended=None):
    policy = make_policy(choice, {}) if isinstance(choice, str) else choice
    return policy.scores(Company(time_s, tuple(people), attended, tuple(sounds)))


def attention(policy="nearest", **settings):
    return Attention(make_policy(policy, {}), AttentionSettings(**settings))


def run(attending, people_at, seconds, from_s=0.0):
    """Tick times and attended track numbers."""
    times_s = from_s + np.arange(round(seconds / TICK_S)) * TICK_S
    return times_s, [attending.update(people_at(t), t).number for t in times_s.tolist()]


def test_approaching_prefers_the_fastest_approach_else_the_nearest():
    comes, goes = person(1, 4.0, velocity=(-1.0, 0.0)), person(2, 1.0, velocity=(1.0, 0.0))
    passes = person(3, 1.5, velocity=(0.0, 1.5))
    assert np.argmax(scores("approaching", [comes, goes, passes])) == 0
    assert np.argmax(scores("approaching", [goes, passes])) == 0


def test_the_speaker_is_located_by_sound_and_kept_in_a_pause():
    left, right = person(1, 2.0, 1.0), person(2, 2.0, -1.0)
    policy = make_policy("speaker", {})
    speech = Sound(0.0, math.atan2(-1.0, 2.0) + math.radians(10.0))
    assert np.argmax(scores(policy, [left, right], 0.1, [speech])) == 1
    assert np.argmax(scores(policy, [person(1, 1.0, 0.5), right], 5.0)) == 1
    # A sound far from each person, and older than a pause, has no speaker.
    assert np.argmax(scores(policy, [left, right], 6.0, [Sound(5.9, math.pi)])) == 1
    answer = Sound(6.1, math.atan2(1.0, 2.0))
    assert np.argmax(scores(policy, [left, right], 6.2, [speech, answer])) == 0


def test_a_named_policy_attends_no_other_person():
    found = scores("id:anna", [person(1, tracker_id="bob"), person(2, tracker_id="anna"), person(3)])
    assert np.isnan(found).tolist() == [True, False, True]


def test_a_user_defined_policy_is_checked():
    with pytest.raises(SettingsError, match=r"policy builtins:object lacks the method reset\(\)"):
        make_policy("builtins:object", {})
    with pytest.raises(SettingsError, match="no policy 'nearst': perhaps you meant 'nearest'"):
        make_policy("nearst", {})


def test_a_switch_waits_for_the_hysteresis():
    attending = attention(hysteresis_s=0.5, dwell_s=0.0)
    times_s, numbers = run(attending, lambda t: [person(1, 2.0), person(2, 3.0 if t < 1.0 else 1.0)], 3.0)
    switched_s = times_s[numbers.index(2)]
    assert 1.5 <= switched_s <= 1.5 + 2 * TICK_S
    assert numbers[0] == 1


@pytest.mark.parametrize("dwell_s", [0.0, 2.0])
def test_a_switch_waits_for_the_dwell_time(dwell_s):
    attending = attention(hysteresis_s=0.2, dwell_s=dwell_s)
    times_s, numbers = run(attending, lambda t: [person(1 + int(t) % 2, 1.0), person(2 - int(t) % 2, 2.0)], 30.0)
    switches_s = times_s[1:][np.diff(numbers) != 0]
    assert switches_s.size > 5
    assert np.diff(switches_s).min() >= max(dwell_s, 0.2) - 1e-9


def test_a_person_who_left_is_replaced_at_once():
    attending = attention(dwell_s=5.0, hysteresis_s=1.0)
    run(attending, lambda t: [person(1, 1.0), person(2, 2.0)], 1.0)
    now = attending.update([person(2, 2.0)], 1.02)
    assert (now.number, now.why) == (2, "left")


def test_the_distance_limit_has_hysteresis():
    attending = attention(enter_m=1.0, leave_m=1.5, hysteresis_s=0.0, dwell_s=0.0)
    walk_m = {0.0: 1.2, 1.0: 0.9, 2.0: 1.4, 3.0: 1.6, 4.0: 1.4}
    found = {t: attending.update([person(1, x)], t).number for t, x in walk_m.items()}
    assert found == {0.0: None, 1.0: 1, 2.0: 1, 3.0: None, 4.0: None}


def test_only_the_nearest_people_are_considered():
    class Farthest(Nearest):
        def scores(self, company):
            return [-score for score in super().scores(company)]

    crowd = [person(k, float(k)) for k in range(1, 6)]
    assert Attention(Farthest(), AttentionSettings(most_people=3)).update(crowd, 0.0).number == 3


def test_a_raising_policy_keeps_the_attended_person_until_they_leave():
    class Broken(Nearest):
        def scores(self, company):
            if company.time_s > 0.5:
                raise RuntimeError("broken")
            return super().scores(company)

    attending = Attention(Broken(), AttentionSettings())
    attending.update([person(1)], 0.0)
    with pytest.raises(RuntimeError):
        attending.update([person(1), person(2, 1.0)], 1.0)
    assert attending.attended.number == 1
    with pytest.raises(RuntimeError):
        attending.update([person(2, 1.0)], 2.0)
    assert attending.attended.number is None


@pytest.mark.parametrize("limits", [{"enter_m": 1.5, "leave_m": 1.0}, {"leave_m": 1.0}])
def test_contradictory_limits_are_refused(limits):
    with pytest.raises(ValueError, match="leave_m"):
        AttentionSettings(**limits)


def watcher(distance_m, off_deg=0.0, number=1):
    """A person straight ahead whose gaze misses the robot by an angle."""
    quat = Rotation.from_euler("z", 180.0 + off_deg, degrees=True).as_quat(scalar_first=True)
    return PersonState(number, None, 0.0, np.array([distance_m, 0.0, 0.0]), np.zeros(3), quat, 0.0, 0.0)


def watched(engagement, state, seconds, from_s=0.0):
    found = None
    for k in range(round(seconds * 20) + 1):
        found = engagement.update(Company(from_s + k / 20, (state,)))[state.number]
    return found


def test_engagement_equals_the_published_formula():
    # gaze = 1 - tan(off) / tan(60 deg), distance = log(4 - d + 1) / log(5).
    assert visual_engagement(watcher(1.0)) == pytest.approx(math.log(4.0) / math.log(5.0))
    expected = (1 - math.tan(math.radians(30)) / math.tan(math.radians(60))) * math.log(3.0) / math.log(5.0)
    assert visual_engagement(watcher(2.0, 30.0)) == pytest.approx(expected)
    assert visual_engagement(watcher(2.0, 61.0)) == 0.0
    assert visual_engagement(watcher(2.0, 180.0)) == 0.0
    assert visual_engagement(watcher(4.1)) == 0.0


def test_engagement_is_undecided_before_a_full_window():
    engagement = Engaged()
    assert watched(engagement, watcher(1.0), WINDOW_S - 0.1) is None
    assert watched(engagement, watcher(1.0), 0.1, WINDOW_S) is True
    assert watched(engagement, watcher(1.0, 90.0), 1.0, WINDOW_S + 0.2) is True
    assert watched(engagement, watcher(1.0, 90.0), 4.0, WINDOW_S + 1.3) is False


def test_a_gap_restarts_the_window():
    engagement = Engaged()
    assert watched(engagement, watcher(1.0), 6.0) is True
    assert watched(engagement, watcher(1.0), 1.0, from_s=10.0) is None


def test_engaged_people_come_before_nearer_ones():
    policy = Engaged()
    near, far = watcher(1.0, 80.0, number=1), watcher(1.5, number=2)
    for k in range(120):
        scores = policy.scores(Company(k / 20, (near, far)))
        assert np.argmax(scores) == (1 if k / 20 >= WINDOW_S else 0)
