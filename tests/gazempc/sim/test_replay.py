"""Replays: reproducible, with several seeds of the noise, and independent of what ran before."""

import dataclasses

import numpy as np
import pytest
from builders.attention import attention_log
from builders.recordings import reordered, synthetic
from builders.replays import QUICK, replayed

from gazempc.command import Progress
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.errors import LeftOutError
from gazempc.neck.spec import load_neck
from gazempc.parts import TRUE_FUTURE, check_gaze
from gazempc.results.log_files import load_log
from gazempc.results.metrics import measure
from gazempc.settings import LoopSettings
from gazempc.sim import repeat
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene


def test_the_same_arguments_give_the_same_log_to_the_last_bit(tmp_path):
    """Also with a controller whose solvers have a warm start from another recording; another seed differs."""
    neck = load_neck("slow")
    first, other = (reordered(synthetic(name), range(45)) for name in ("subject03_R4", "subject01_R6"))
    controller = Mpc(neck)
    for name, walk, seed in (("a", first, 2), ("b", other, 2), ("c", first, 2), ("d", first, 3)):
        settings = QUICK.model_copy(update={"seed": seed})
        replayed(walk, controller, neck=neck, settings=settings).save(tmp_path / f"{name}.npz")
    replayed(first, neck=neck, settings=QUICK.model_copy(update={"seed": 2})).save(tmp_path / "fresh.npz")
    a, c, d = ((tmp_path / f"{name}.npz").read_bytes() for name in "acd")
    assert a == c
    assert a != d
    commands_rad = [load_log(tmp_path / f"{name}.npz").command_position_rad for name in ("a", "fresh")]
    np.testing.assert_array_equal(*commands_rad)


def test_a_recording_too_short_to_be_scored_is_refused():
    recording = synthetic("subject01_R1")
    with pytest.raises(LeftOutError, match=r"subject01_R1: 0\.63 s is too short"):
        replayed(reordered(recording, range(20)), "lookahead")
    log = attention_log(np.zeros(400))
    with pytest.raises(LeftOutError, match="known at 0 ticks"):
        measure(dataclasses.replace(log, head_true_base_m=np.full_like(log.head_true_base_m, np.nan)))


@pytest.mark.parametrize("delay_s", [0.0, 0.05])
def test_with_the_true_future_a_compute_delay_costs_nothing(delay_s):
    """The commands that go out while the computer works are rolled through as exactly as those of the dead time."""
    settings = ReplaySettings(loop=LoopSettings(compute_delay_s=delay_s))
    log = replayed(synthetic("subject03_R4"), "mpc+perfect", settings=settings)
    assert measure(log).gaze_error_rms_deg < 0.1


def test_a_scene_has_the_start_of_the_neck():
    scene = make_scene("subject01_R1", SceneSettings(start_offset_deg=10.0))
    seen_m = np.array([2.0, 2.0, 0.0])
    np.testing.assert_allclose(scene.first_angles_rad(seen_m), [np.deg2rad(55.0), 0.0])
    begins = dataclasses.replace(scene, start_rad=(0.2, -0.1))
    log = replay_scene(begins, "reactive", "last_position").log
    np.testing.assert_allclose(log.joint_position_rad[0], [0.2, -0.1])


def test_the_former_name_of_the_true_future_warns():
    with pytest.warns(FutureWarning, match=r"mpc\+perfect"):
        assert check_gaze("perfect") == TRUE_FUTURE
    with pytest.raises(ValueError, match="no predictor 'perfekt'"):
        check_gaze("mpc+perfekt")


WALK = reordered(synthetic("subject02_R1"), range(45))
SETTINGS = QUICK.model_copy(update={"seed": 3})


def repeated(count, settings=SETTINGS, controllers=("lookahead",)):
    scene = make_scene(WALK, settings)
    return scene, repeat.replay_repeatedly(scene, settings, controllers, count, Progress())


def test_each_seed_gives_the_figures_of_a_replay_with_that_seed():
    scene, done = repeated(2)
    for seed, row in zip((3, 4), done.repeats[0].rows, strict=True):
        again = make_scene(WALK, SETTINGS.model_copy(update={"seed": seed}))
        log = replay_scene(again, "lookahead", "constant_velocity", SETTINGS).log
        np.testing.assert_equal(row.metrics.as_dict(), measure(log).as_dict())
        if seed == 3:
            np.testing.assert_array_equal(done.first["lookahead"].log.joint_position_rad, log.joint_position_rad)
    assert done.repeats[0].seeds == (3, 4)
    assert "over 2 seeds of the noise, 3 to 4; " in done.seeds_note
    assert scene.seed == 3


def test_without_a_number_as_many_seeds_as_one_can_wait_for(monkeypatch):
    monkeypatch.setattr(repeat, "PATIENCE_S", 0.0)
    _, done = repeated(None, controllers=("reactive",))
    assert len(done.repeats[0].seeds) == 1
    assert "fit into 0 s" in done.seeds_note


def test_without_noise_one_seed_is_enough(monkeypatch):
    monkeypatch.setattr(repeat, "PATIENCE_S", 1e9)
    _, done = repeated(None, SETTINGS.model_copy(update={"sensor": "perfect"}), ("reactive",))
    assert done.repeats[0].seeds == (3,)
    assert done.seeds_note == "one seed of the noise, 3 (another one makes no difference)"


REFERENCE, SLOW = load_neck("reference"), load_neck("slow")


def test_necks_and_settings_do_not_share():
    """Every number that a program depends on is in its key."""

    def gain(mpc):
        return mpc.ocps[0].program.gain.tobytes()

    limit = REFERENCE.model_copy(update={"pan": REFERENCE.pan.model_copy(update={"jerk_max_rad_s3": 200.0})})
    rate = REFERENCE.model_copy(update={"servo_rate_hz": 400.0})
    made = [Mpc(neck) for neck in (REFERENCE, SLOW, limit, rate)]
    gains = list(map(gain, [*made, Mpc(REFERENCE, horizon_s=0.6), Mpc(REFERENCE, smoothing_time_s=0.1)]))
    assert len(set(gains)) == len(gains)
    assert gain(Mpc(REFERENCE)) == gains[0]


def test_the_same_neck_shares_but_cannot_be_written_to():
    """Two controllers have their matrices in common, and solvers of their own; a change is an error."""
    first, second = Mpc(REFERENCE).ocps[0], Mpc(REFERENCE).ocps[0]
    assert first is not second
    assert first.program is second.program
    program = first.program
    for array in (program.data.h, program.data.a, program.rows_map, program.gain, program.cost_map):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
