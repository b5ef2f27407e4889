"""Several people in the loop: tracker faults of each, and their consequences."""

import numpy as np
import pytest
from builders.loop import make_recorder
from builders.people import yaw_quat
from builders.replays import run_info

from gazempc.loop.attended import AttendedPeople
from gazempc.people.attention import Attention
from gazempc.people.policies import Nearest
from gazempc.settings import AttentionSettings, LoopSettings
from gazempc.types import Sighting
from predictors import ConstantVelocity, HeadObservation

FRAME_S, LATENCY_S = 1.0 / 30.0, 0.05
CALM = AttentionSettings(hysteresis_s=0.2, dwell_s=0.2)


class Bench:
    """Feeds `AttendedPeople` frame by frame; people are functions of time."""

    def __init__(self, policy=None, predictor=ConstantVelocity, everyone=False):
        self.recorder = make_recorder()
        self.target = AttendedPeople(predictor, Attention(policy or Nearest(), CALM), LoopSettings(), everyone)
        self.time_s = 0.0

    def show(self, seconds, *people):
        """Feed each person whose function returns a position, with optional orientation and name."""
        for _ in range(round(seconds / FRAME_S)):
            self.time_s += FRAME_S
            seen = [person(self.time_s) for person in people]
            now_s = self.time_s + LATENCY_S
            sightings = [
                Sighting(now_s, HeadObservation(self.time_s, np.array(head_m), quat, person_id=name))
                for head_m, quat, name in (each for each in seen if each is not None)
            ]
            self.target.assimilate(sightings, now_s, self.recorder)
        return self

    @property
    def events(self):
        return self.recorder.events

    @property
    def attended(self):
        log, _ = self.recorder.finish(run_info(), lambda times_s: np.full((times_s.size, 3), np.nan))
        return list(zip(log.attended_person.tolist(), log.attended_why.tolist(), strict=True))


def walker(x_m=2.0, speed_m_s=1.0, from_y_m=-1.0, name=None, frozen_s=(9.0, 9.0), quat=lambda time_s: None):
    """A walk to the left; the tracker is frozen in an interval, then at the true position."""

    def at(time_s):
        shown_s = frozen_s[0] if frozen_s[0] <= time_s < frozen_s[1] else time_s
        return [x_m, from_y_m + speed_m_s * shown_s, 0.3], quat(time_s), name

    return at


def stands(x_m, y_m=1.0, name=None, until_s=99.0):
    return lambda time_s: ([x_m, y_m + 1e-3 * np.sin(9.0 * time_s), 0.3], None, name) if time_s < until_s else None


def test_a_frozen_track_is_not_used_and_attention_switches():
    bench = Bench().show(3.4, walker(name="a", frozen_s=(1.5, 3.0)), stands(3.0, name="b"))
    assert bench.attended[0] == (1, "policy")
    assert "tracker_frozen" in bench.events
    # Detected after 0.5 s; a second later the track has ended, and the other person is attended.
    assert bench.recorder.refusals["tracker_frozen"] == pytest.approx(30, abs=2)
    assert bench.attended[1] == (2, "left")
    # When the tracker resumes, the first person has the same number.
    assert [state.number for state in bench.target.people.present(bench.time_s)] == [1, 2]
    assert "person_returned" in bench.events


def test_after_freezing_the_forecast_restarts_at_the_new_position():
    bench = Bench().show(2.8, walker(frozen_s=(1.4, 2.2)))
    assert bench.events.count("tracker_frozen") == 1
    times_s = np.array([bench.time_s + 0.3])
    forecast = bench.target.forecast(times_s, bench.time_s, bench.recorder)
    np.testing.assert_allclose(forecast.means_base_m[0], [2.0, -1.0 + times_s[0], 0.3], atol=0.15)


def test_orientation_jumps_are_judged_per_person():
    """Two people with opposite yaws give no jump; a half turn of one within a frame does."""
    quiet = Bench().show(1.0, walker(quat=lambda _: yaw_quat(0.0)), walker(3.0, quat=lambda _: yaw_quat(np.pi)))
    assert "orientation_jumped" not in quiet.events
    turned = walker(3.0, quat=lambda time_s: yaw_quat(np.pi if 0.49 < time_s < 0.51 else 0.0))
    bench = Bench().show(1.0, walker(quat=lambda _: yaw_quat(0.0)), turned)
    assert bench.events.count("orientation_jumped") == 1


def test_observations_refused_by_the_predictor_are_counted():
    class Refuses(ConstantVelocity):
        rejections_in_a_row = 1

    bench = Bench(predictor=Refuses).show(0.5, walker())
    assert bench.recorder.refusals["gate_refused"] > 5
    assert bench.recorder.used == 0


def test_no_person_is_attended_while_all_people_are_lost():
    bench = Bench().show(0.8, stands(2.0, 1.0), stands(3.0, -1.0)).show(1.2)
    assert bench.events[-1] == "no_person_attended"
    assert bench.target.forecast(np.array([2.5]), bench.time_s, bench.recorder) is None
    bench.show(0.5, stands(5.0, 2.0))
    assert [number for number, _ in bench.attended] == [1, 0, 3]


@pytest.mark.parametrize("answer", [None, "a", [1.0, 2.0, 3.0], float("nan")])
def test_an_invalid_policy_answer_is_an_event_and_the_run_continues(answer):
    class InvalidScores:
        def reset(self):
            pass

        def scores(self, company):
            return answer

    bench = Bench(InvalidScores()).show(0.5, stands(2.0))
    assert "policy_failed" in bench.events
    assert bench.attended == []


def test_a_policy_may_exclude_all_people():
    class ExcludesAll:
        def reset(self):
            pass

        def scores(self, company):
            return [np.nan if company.time_s > 0.6 else 1.0] * len(company.people)

    bench = Bench(ExcludesAll()).show(1.5, stands(2.0))
    assert bench.attended == [(1, "policy"), (0, "no_person")]
    assert "no_person_attended" in bench.events


def test_a_late_first_frame_of_the_attended_person_is_used_and_the_newest_time_kept():
    bench, person = Bench(), walker()
    bench.show(4 * FRAME_S, lambda time_s: None if bench.time_s == 2 * FRAME_S else person(time_s))
    assert bench.attended == [(1, "policy")]
    before = bench.recorder.used
    late = Sighting(bench.time_s + LATENCY_S, HeadObservation(2 * FRAME_S, np.array(person(2 * FRAME_S)[0])))
    bench.target.assimilate([late], bench.time_s + LATENCY_S, bench.recorder)
    assert bench.recorder.used == before + 1
    assert bench.target.newest_capture_s == bench.time_s
    in_order = ConstantVelocity()
    for k in range(1, 5):
        in_order.update(HeadObservation(k * FRAME_S, np.array(person(k * FRAME_S)[0])))
    later_s = np.array([0.8])
    expected_m = in_order.forecast(later_s).means_base_m
    found = bench.target.people.track(1).forecast(later_s)
    assert found.means_base_m == pytest.approx(expected_m, abs=1e-9)
    assert bench.events.count("out_of_order") == 0


@pytest.mark.parametrize(("everyone", "y_m"), [(False, -0.5), (True, 0.0)])
def test_the_target_is_one_person_or_the_centre_of_all(everyone, y_m):
    bench = Bench(everyone=everyone)
    bench.show(1.0, walker(2.0, 0.0, -0.5), walker(2.01, 0.0, 0.5))
    forecast = bench.target.forecast(np.array([bench.time_s]), bench.time_s, bench.recorder)
    assert forecast.means_base_m[0, 1] == pytest.approx(y_m, abs=0.02)
