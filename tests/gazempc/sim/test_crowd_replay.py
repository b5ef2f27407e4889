"""Several people in a replay: one scene, one gaze."""

from dataclasses import replace

import numpy as np
import pytest
from builders.replays import NECK
from builders.standing import standing_together

from experiments.people.study import least_time_s
from gazempc.errors import SettingsError
from gazempc.people import people
from gazempc.results.attention import measure_attention
from gazempc.results.metrics import gaze_error_deg
from gazempc.results.motion import limit_violations
from gazempc.settings import AttentionSettings
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene
from gazempc.sim.sensing.spec import FieldOfView

TWO = "subject03_R4+subject05_R1"


def replayed(attend, controller="mpc", recording=TWO, predictor="constant_velocity", **settings):
    scene = make_scene(recording, SceneSettings(), NECK, all_people=True)
    return replay_scene(scene, controller, predictor, ReplaySettings(attend=attend, **settings)).log


def test_several_people_require_an_attention_policy():
    with pytest.raises(SettingsError, match="choose one by --attend, such as --attend nearest"):
        replayed(None)
    with pytest.raises(SettingsError, match="several people: choose one by --attend, such as --attend nearest"):
        make_scene(TWO, SceneSettings())


def test_the_gaze_tracks_the_attended_person():
    log = replayed("nearest", predictor="walker")
    assert set(log.attended_person.tolist()) == {1, 2}
    assert limit_violations(log, log.neck) == 0
    settled = np.zeros(log.time_s.size, dtype=bool)
    for from_s, to_s in zip(log.attended_time_s, [*log.attended_time_s[1:], log.time_s[-1]], strict=True):
        settled |= (log.time_s > from_s + 1.2) & (log.time_s < to_s)
    assert settled.sum() > 150
    pan_rad = np.arctan2(log.head_true_base_m[settled, 1], log.head_true_base_m[settled, 0])
    off_deg = np.degrees(np.abs(log.joint_position_rad[settled, 0] - pan_rad))
    assert np.percentile(off_deg, 95) < 2.6


def test_one_person_of_several_is_tracked_as_well_as_alone():
    """Equal recording, sensor and noise; only frames before the track's confirmation differ."""
    scene = make_scene("subject03_R4", SceneSettings(), NECK)
    alone = replay_scene(scene, "lookahead", "constant_velocity", ReplaySettings()).log
    one = replayed("nearest", "lookahead", recording="subject03_R4")
    later = alone.time_s > 1.5
    difference_deg = np.degrees(np.abs(alone.joint_position_rad[later] - one.joint_position_rad[later]))
    assert difference_deg.max() < 1.0


def test_the_perfect_forecast_is_that_of_the_attended_person():
    log = replayed("nearest", controller="mpc+perfect")
    known = np.isfinite(log.forecast_true_base_m).all(axis=2)
    assert known.sum() > 100
    apart_m = np.linalg.norm(log.forecast_mean_base_m - log.forecast_true_base_m, axis=2)[known]
    assert np.percentile(apart_m, 90) < 1e-6


@pytest.mark.parametrize("exchanged_from_frame", [None, 40])
def test_observations_assigned_to_another_person_are_swaps(monkeypatch, exchanged_from_frame):
    """From some frame on the numbers are exchanged: one swap each, in that frame only."""
    calls = []
    right = people.assign

    def by_side(expected, unseen_s, track_names, observations):
        calls.append(1)
        if not len(track_names) == len(observations) == 2:
            return right(expected, unseen_s, track_names, observations)
        left = int(np.argmax([seen.head_position_base_m[1] for seen in observations]))
        exchanged = exchanged_from_frame is not None and len(calls) >= exchanged_from_frame
        columns = (1 - left, left) if exchanged else (left, 1 - left)
        return [(row, column, expected.of(slice(row, row + 1))) for row, column in enumerate(columns)]

    monkeypatch.setattr(people, "assign", by_side)
    scene = standing_together(2.5, [2.0, 0.8, 0.3], [2.0, -0.8, 0.3])
    log = replay_scene(scene, "lookahead", "constant_velocity", ReplaySettings(attend="nearest")).log
    assert log.identity_swap_time_s.size == (0 if exchanged_from_frame is None else 2)
    assert np.unique(log.identity_swap_time_s).size <= 1


def test_a_head_mounted_sensor_observes_people_in_its_view_only():
    """The gaze starts on Ann. Bob is nearer, but 70 deg beside her, outside a view of 60 deg."""
    ann = standing_together(2.0, [2.2, 1.3, 0.3], [1.4, -1.2, 0.3])
    view = FieldOfView(on="head", horizontal_deg=60.0, vertical_deg=60.0)
    for sensor, left in ((ann.sensor, False), (ann.sensor.model_copy(update={"view": view}), True)):
        settings = ReplaySettings(attend="nearest")
        log = replay_scene(replace(ann, sensor=sensor), "lookahead", "constant_velocity", settings).log
        assert limit_violations(log, log.neck) == 0
        known = np.isfinite(log.head_true_base_m).all(axis=1)
        assert known.mean() > 0.9
        assert np.all((log.head_true_base_m[known, 1] > 0.0) == left)


@pytest.mark.slow
def test_a_bag_with_two_people_is_a_scene_of_two(bags_dir):
    scene = make_scene(bags_dir / "2p_AA_FV_eng_1", SceneSettings(), NECK, all_people=True)
    two = [scene.walk, *scene.others]
    assert [walk.labels.subject for walk in two] == ["eloek", "ghfbv"]
    assert abs(two[0].times_s[0] - two[1].times_s[0]) < 0.2
    log = replay_scene(scene, "reactive", "constant_velocity", ReplaySettings(attend="engaged")).log
    assert log.attended_person.max() >= 1


# ---------------------------------------------------------------- switches


WANTED_FROM_S, HYSTERESIS_S = 1.4, 0.2
CALM = AttentionSettings(hysteresis_s=HYSTERESIS_S, dwell_s=1.0)
PLACES_M = ([1.5, 1.2, 0.0], [1.5, -1.2, 0.5])


class SecondLater:
    """Prefers the second person from `WANTED_FROM_S` on, else the first."""

    def reset(self):
        pass

    def scores(self, company):
        preferred = 2 if company.time_s >= WANTED_FROM_S else 1
        return [float(person.number == preferred) for person in company.people]


@pytest.mark.parametrize("controller", ["mpc", "lookahead"])
def test_a_switch_is_near_time_optimal_with_overshoot_below_1_deg(controller):
    settings = ReplaySettings(attend=f"{__name__}:SecondLater", attention=CALM)
    log = replay_scene(standing_together(3.6, *PLACES_M), controller, "walker", settings).log
    assert log.attended_person.tolist() == [1, 2]
    switched_s = float(log.attended_time_s[1])
    assert switched_s == pytest.approx(WANTED_FROM_S + HYSTERESIS_S, abs=0.03)
    found = measure_attention(log)
    assert found.switch_overshoot_deg < 1.0
    away_deg = gaze_error_deg(log)[np.searchsorted(log.time_s, switched_s)]
    assert away_deg > 60.0
    assert found.time_to_contact_after_switch_s < least_time_s(log.neck, away_deg) + 0.12
    assert limit_violations(log, log.neck) == 0
