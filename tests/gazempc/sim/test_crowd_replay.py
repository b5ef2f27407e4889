"""Several people in a replay: one scene, one gaze."""

import numpy as np
import pytest

from gazempc.errors import SettingsError
from gazempc.recordings.together import load_together
from gazempc.results.limits import limit_violations
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene

TWO = "subject03_R4+subject05_R1"


def replayed(attend, controller="mpc", recording=TWO, predictor="constant_velocity", **settings):
    scene = make_scene(recording, SceneSettings(), everybody=True)
    return replay_scene(scene, controller, predictor, ReplaySettings(attend=attend, **settings)).log


def test_two_recordings_are_one_scene():
    scene = make_scene(TWO, SceneSettings(), everybody=True)
    assert scene.name == TWO
    alone = make_scene("subject05_R1", SceneSettings())
    np.testing.assert_array_equal(scene.others[0].truth.head_position_m, alone.walk.truth.head_position_m)


def test_several_people_need_to_be_told_whom_to_look_at():
    with pytest.raises(SettingsError, match="say whom to look at, such as --attend nearest"):
        replayed(None)
    with pytest.raises(SettingsError, match="several people: say whom to look at, such as --attend nearest"):
        make_scene(TWO, SceneSettings())


def test_the_gaze_is_on_whoever_is_looked_at():
    log = replayed("nearest", predictor="walker")
    assert set(log.attended_person.tolist()) == {1, 2}
    assert limit_violations(log, log.neck) == 0
    settled = np.zeros(log.time_s.size, dtype=bool)
    for from_s, to_s in zip(log.attended_time_s, [*log.attended_time_s[1:], log.time_s[-1]], strict=True):
        settled |= (log.time_s > from_s + 1.2) & (log.time_s < to_s)
    assert settled.sum() > 300
    pan_rad = np.arctan2(log.head_true_base_m[settled, 1], log.head_true_base_m[settled, 0])
    off_deg = np.degrees(np.abs(log.joint_position_rad[settled, 0] - pan_rad))
    assert np.percentile(off_deg, 95) < 2.6


def test_one_person_among_several_is_looked_at_as_if_they_were_alone():
    """The same recording, sensor and noise; only the first frames differ, until it is known to be somebody."""
    scene = make_scene("subject03_R4", SceneSettings())
    alone = replay_scene(scene, "mpc", "constant_velocity", ReplaySettings()).log
    one = replayed("nearest", recording="subject03_R4")
    later = alone.time_s > 1.5
    difference_deg = np.degrees(np.abs(alone.joint_position_rad[later] - one.joint_position_rad[later]))
    assert difference_deg.max() < 1.0


def test_the_perfect_forecast_is_that_of_whoever_is_looked_at():
    log = replayed("nearest", controller="perfect")
    known = np.isfinite(log.forecast_true_base_m).all(axis=2)
    assert known.sum() > 100
    apart_m = np.linalg.norm(log.forecast_mean_base_m - log.forecast_true_base_m, axis=2)[known]
    assert np.percentile(apart_m, 90) < 1e-6


def test_a_policy_that_raises_is_survived(monkeypatch):
    from gazempc.people.policies import Nearest

    def broken(self, company):
        raise RuntimeError("no idea")

    monkeypatch.setattr(Nearest, "scores", broken)
    log = replayed("nearest")
    assert "policy_failed" in log.event_name
    assert log.faults[0].line.endswith("RuntimeError: no idea")
    assert limit_violations(log, log.neck) == 0


def test_a_bag_with_two_people_is_a_scene_of_two(bags_dir):
    two = load_together(bags_dir / "2p_AA_FV_eng_1")
    assert [walk.labels.subject for walk in two] == ["eloek", "ghfbv"]
    assert abs(two[0].times_s[0] - two[1].times_s[0]) < 0.2
    log = replayed("engaged", recording=bags_dir / "2p_AA_FV_eng_1")
    assert log.attended_person.max() >= 1
