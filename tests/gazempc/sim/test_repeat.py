"""The noise is repeated as often as one can wait for, and not where it makes no difference."""

import numpy as np

from gazempc.progress import Progress
from gazempc.results.metrics import measure
from gazempc.sim import repeat
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import make_scene

SETTINGS = ReplaySettings(predictor="constant_velocity", seed=3)
CONTROLLERS = ("lookahead",)


def repeated(count, settings=SETTINGS, controllers=CONTROLLERS):
    scene = make_scene("subject02_R1", settings)
    return scene, repeat.replay_repeatedly(scene, settings, controllers, count, Progress())


def test_each_seed_gives_the_figures_of_a_replay_with_that_seed():
    scene, done = repeated(2)
    for seed, row in zip((3, 4), done.repeats[0].rows, strict=True):
        again = make_scene("subject02_R1", SETTINGS.model_copy(update={"seed": seed}))
        log = replay_scene(again, "lookahead", "constant_velocity", SETTINGS).log
        np.testing.assert_equal(row.metrics.as_dict(), measure(log).as_dict())
        if seed == 3:
            np.testing.assert_array_equal(done.first["lookahead"].log.joint_position_rad, log.joint_position_rad)
    assert done.repeats[0].seeds == (3, 4)
    assert "over 2 seeds of the noise, 3 to 4; " in done.said
    assert scene.seed == 3


def test_without_a_number_as_many_seeds_as_one_can_wait_for(monkeypatch):
    monkeypatch.setattr(repeat, "PATIENCE_S", 0.0)
    _, done = repeated(None, controllers=("reactive",))
    assert len(done.repeats[0].seeds) == 1
    assert "fit into 0 s" in done.said


def test_without_noise_one_seed_is_enough(monkeypatch):
    monkeypatch.setattr(repeat, "PATIENCE_S", 1e9)
    _, done = repeated(None, SETTINGS.model_copy(update={"sensor": "perfect"}), ("reactive",))
    assert done.repeats[0].seeds == (3,)
    assert done.said == "one seed of the noise, 3 (another one makes no difference)"
