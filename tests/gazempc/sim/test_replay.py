"""Replays: the same arguments give the same log, and a compute delay costs nothing with the true future."""

import dataclasses

import numpy as np
import pytest
from builders.recordings import reordered, synthetic
from builders.replays import replayed

from gazempc.controllers.mpc.mpc import Mpc
from gazempc.errors import LeftOutError
from gazempc.neck.spec import load_neck
from gazempc.parts import TRUE_FUTURE, check_gaze
from gazempc.results.log import load_log
from gazempc.results.metrics import measure
from gazempc.settings import LoopSettings
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene


def test_the_same_arguments_give_the_same_log_to_the_last_bit(tmp_path):
    """Also with a controller whose solvers have a warm start from another recording; another seed differs."""
    neck = load_neck("slow")
    first, other = (reordered(synthetic(name), range(60)) for name in ("subject03_R4", "subject01_R6"))
    controller = Mpc(neck)
    for name, walk, seed in (("a", first, 2), ("b", other, 2), ("c", first, 2), ("d", first, 3)):
        replayed(walk, controller, neck=neck, settings=ReplaySettings(seed=seed)).save(tmp_path / f"{name}.npz")
    replayed(first, neck=neck, settings=ReplaySettings(seed=2)).save(tmp_path / "fresh.npz")
    a, c, d = ((tmp_path / f"{name}.npz").read_bytes() for name in "acd")
    assert a == c
    assert a != d
    commands_rad = [load_log(tmp_path / f"{name}.npz").command_position_rad for name in ("a", "fresh")]
    np.testing.assert_array_equal(*commands_rad)


def test_a_recording_too_short_to_be_scored_is_refused():
    recording = synthetic("subject01_R1")
    with pytest.raises(LeftOutError, match=r"subject01_R1: 0\.63 s is too short"):
        replayed(reordered(recording, range(20)), "lookahead")
    log = replayed(recording, "reactive")
    with pytest.raises(LeftOutError, match="known at 0 ticks"):
        measure(dataclasses.replace(log, head_true_base_m=np.full_like(log.head_true_base_m, np.nan)))


@pytest.mark.parametrize("delay_s", [0.0, 0.05])
def test_with_the_true_future_a_compute_delay_costs_nothing(delay_s):
    """The commands that go out while the computer works are rolled through as exactly as those of the dead time."""
    settings = ReplaySettings(loop=LoopSettings(compute_delay_s=delay_s))
    log = replayed(synthetic("subject03_R4"), "mpc+perfect", settings=settings)
    assert measure(log).gaze_error_rms_deg < 0.1


def test_a_scene_says_where_the_neck_begins():
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
