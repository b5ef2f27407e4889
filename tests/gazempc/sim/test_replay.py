"""Replays: reproducible, with several noise seeds, and independent of earlier runs."""

import dataclasses
import json

import numpy as np
import pytest
from builders.attention import attention_log
from builders.recordings import reordered, synthetic
from builders.replays import NECK, QUICK, replayed

import gazempc as gz
from gazempc.command import Progress
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.errors import LeftOutError
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.parts import TRUE_FUTURE, check_gaze
from gazempc.results.log_files import load_log
from gazempc.results.metrics import measure
from gazempc.results.motion import limit_violations
from gazempc.run import main as run_main
from gazempc.settings import LoopSettings
from gazempc.sim import repeat
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene


def test_equal_arguments_give_equal_logs_bit_for_bit(tmp_path):
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
def test_with_the_true_future_a_compute_delay_adds_no_error(delay_s):
    """Commands sent during the computation are predicted through as exactly as those of the dead time."""
    settings = ReplaySettings(loop=LoopSettings(compute_delay_s=delay_s))
    log = replayed(reordered(synthetic("subject03_R4"), range(75)), "mpc+perfect", settings=settings)
    assert measure(log).gaze_error_rms_deg < 0.1


def test_a_scene_keeps_the_start_pose_of_the_neck():
    scene = make_scene("subject01_R1", SceneSettings(start_offset_deg=10.0), NECK)
    seen_m = np.array([2.0, 2.0, 0.0])
    np.testing.assert_allclose(scene.first_angles_rad(seen_m), [np.deg2rad(55.0), 0.0])
    begins = dataclasses.replace(scene, start_rad=(0.2, -0.1))
    log = replay_scene(begins, "reactive", "last_position").log
    np.testing.assert_allclose(log.joint_position_rad[0], [0.2, -0.1])


def test_the_deprecated_name_of_the_true_future_warns():
    with pytest.warns(FutureWarning, match=r"mpc\+perfect"):
        assert check_gaze("perfect") == TRUE_FUTURE
    with pytest.raises(ValueError, match="no predictor 'perfekt'"):
        check_gaze("mpc+perfekt")


WALK = reordered(synthetic("subject02_R1"), range(45))
SETTINGS = QUICK.model_copy(update={"seed": 3})


def repeated(count, settings=SETTINGS, controllers=("lookahead",)):
    scene = make_scene(WALK, settings, NECK)
    return scene, repeat.replay_repeatedly(scene, settings, controllers, count, Progress())


def test_each_seed_gives_the_metrics_of_a_replay_with_that_seed():
    scene, done = repeated(2)
    for seed, row in zip((3, 4), done.repeats[0].rows, strict=True):
        again = make_scene(WALK, SETTINGS.model_copy(update={"seed": seed}), NECK)
        log = replay_scene(again, "lookahead", "constant_velocity", SETTINGS).log
        np.testing.assert_equal(row.metrics.as_dict(), measure(log).as_dict())
        if seed == 3:
            np.testing.assert_array_equal(done.first["lookahead"].log.joint_position_rad, log.joint_position_rad)
    assert done.repeats[0].seeds == (3, 4)
    assert "over 2 seeds of the noise, 3 to 4; " in done.seeds_note
    assert scene.seed == 3


def test_by_default_the_number_of_seeds_follows_from_the_run_time(monkeypatch):
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


def test_other_necks_and_settings_have_separate_programs():
    """The cache key of a program has all its parameters."""

    def gain(mpc):
        return mpc.ocps[0].program.gain.tobytes()

    limit = REFERENCE.model_copy(update={"pan": REFERENCE.pan.model_copy(update={"jerk_max_rad_s3": 200.0})})
    rate = REFERENCE.model_copy(update={"servo_rate_hz": 400.0})
    made = [Mpc(neck) for neck in (REFERENCE, SLOW, limit, rate)]
    gains = list(map(gain, [*made, Mpc(REFERENCE, horizon_s=0.6), Mpc(REFERENCE, smoothing_time_s=0.1)]))
    assert len(set(gains)) == len(gains)
    assert gain(Mpc(REFERENCE)) == gains[0]


def test_equal_necks_share_read_only_matrices():
    """Two controllers share read-only matrices, and have solvers of their own."""
    first, second = Mpc(REFERENCE).ocps[0], Mpc(REFERENCE).ocps[0]
    assert first is not second
    assert first.program is second.program
    program = first.program
    for array in (program.data.h, program.data.a, program.rows_map, program.gain, program.cost_map):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


# ---------------------------------------------------------------- ends of what is accepted


LARGEST = {"velocity_max_rad_s": 1e3, "acceleration_max_rad_s2": 1e6, "jerk_max_rad_s3": 1e9}
LEAST = {"velocity_max_rad_s": 0.01, "acceleration_max_rad_s2": 0.01, "jerk_max_rad_s3": 0.1}
FAST, SOFT = {"natural_frequency_rad_s": 1e3}, {"natural_frequency_rad_s": 0.01}
RATES = {"control_rate_hz": 100.0, "servo_rate_hz": 100.0}
QUICK_SERVO = {"servo_rate_hz": 100.0}


@pytest.fixture(scope="module")
def short_walk():
    return reordered(synthetic("subject03_R4"), range(45))


def neck_of(base="reference", rates=None, **of_axis):
    content = load_neck(base).model_dump() | (rates or QUICK_SERVO)
    for axis in (
        content["pan"],
        content["tilt"],
        *((content["eyes"] or {}).get(name) for name in ("pan", "tilt")),
        content["body"],
    ):
        if axis is not None:
            axis.update(of_axis)
    return NeckSpec.model_validate(content)


@pytest.mark.parametrize(
    ("neck", "settings"),
    [
        (neck_of(**SOFT), {}),
        (neck_of("reference_eyes", **LARGEST, **FAST), {}),
        (neck_of("reachy_mini_body", **LEAST), {}),
        (neck_of(dead_time_s=5.0, damping_ratio=0.11), {}),
        (neck_of(position_min_deg=0.0, position_max_deg=1e-9), {}),
        (neck_of("slow", rates=RATES), {"mpc": {"horizon_s": 5.0, "smoothing_time_s": 1.0}}),
        (neck_of(), {"mpc": {"smoothing_time_s": 1e-300}, "predictor": "constant_velocity"}),
    ],
    ids=lambda value: "",
)
def test_every_accepted_input_is_replayed_within_limits(neck, settings, short_walk):
    log = replayed(short_walk, neck=neck, settings=ReplaySettings.model_validate(settings))
    assert limit_violations(log, neck) == 0
    assert log.faults == ()
    assert np.isfinite(measure(log).gaze_error_rms_deg)


def test_with_a_fast_joint_the_mpc_tracks_as_look_ahead(short_walk):
    """Steps of a held command make a fast joint jump, which smoothing must not suppress."""
    neck = neck_of(**FAST)
    mpc, ahead = (measure(replayed(short_walk, name, neck=neck)).gaze_error_rms_deg for name in ("mpc", "lookahead"))
    assert mpc < ahead + 0.5


def passer(rate_hz, seconds=4.0, name="passer"):
    times_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    heads_m = np.column_stack([np.full(times_s.size, 0.0), 0.8 * (times_s - seconds / 2), np.full(times_s.size, 1.6)])
    return gz.recording_from_arrays(name, times_s, heads_m)


def lookahead_of(recording, neck=NECK, **settings):
    scene = make_scene(recording, SceneSettings(**settings.pop("scene", {})), neck, **settings)
    return replay_scene(scene, "lookahead", "constant_velocity", ReplaySettings())[0]


@pytest.mark.parametrize(("rate_hz", "of_sensor_hz", "low"), [(5.8, 30.0, True), (6.0, 30.0, False), (60.0, 4.0, True)])
def test_rare_frames_are_an_event_of_a_replay(rate_hz, of_sensor_hz, low):
    sensor = gz.load_sensor("reference").model_copy(update={"rate_hz": of_sensor_hz})
    log = lookahead_of(passer(rate_hz, 2.5), sensor=sensor)
    assert ("low_frame_rate" in log.event_name) is low


def test_a_replay_of_rare_frames_warns_once_and_prints_how_much_is_scored(tmp_path, capsys):
    slow = passer(3.0, 6.0)
    columns = [slow.times_s, *slow.truth.head_position_m.T]
    np.savetxt(tmp_path / "slow.csv", np.transpose(columns), "%.6f", ",", header="t,head_x,head_y,head_z", comments="")
    words = ["--replay", str(tmp_path / "slow.csv"), "--controllers", "lookahead", "--no-figures"]
    assert run_main([*words, "--noise-seeds", "1", "--out", str(tmp_path / "out")]) == 0
    output = capsys.readouterr().out
    assert "Note: 3.0 frames a second" in output
    assert output.count("low_frame_rate") == 0
    log = gz.load_log(tmp_path / "out" / "lookahead.npz")
    known = int(np.isfinite(log.head_true_base_m).all(axis=1).sum())
    assert f"Note: the true head is known at {known} of {log.time_s.size} ticks" in output
    notes = json.loads((tmp_path / "out" / "summary.json").read_text())["notes"]
    assert [f"Note: {note}" in output for note in notes] == [True, True]


def test_too_few_frames_are_not_reported_as_a_short_recording():
    with pytest.raises(LeftOutError, match=r"known at \d ticks from 1.0 s on, at least 10 are needed"):
        gz.measure(lookahead_of(passer(1.5)))


def test_the_view_of_a_head_mounted_camera_limits_observations():
    neck = NECK.model_copy(update={"head_view_deg": (60.0, 45.0)})
    ahead = lookahead_of("subject03_R4", neck=neck)
    assert ahead.run.sensor["view"] == {"on": "head", "horizontal_deg": 60.0, "vertical_deg": 45.0}
    # A person 50 degrees beside the gaze is out of view, and the neck without a person stays where it is.
    aside = lookahead_of("subject03_R4", neck=neck, scene={"start_offset_deg": 50.0})
    assert aside.capture_time_s[0] > 2.0  # the person has walked into view
