"""Ends of what is accepted in a replay: necks, settings, frame rates, and the view of a camera on the head."""

import json

import numpy as np
import pytest
from builders.recordings import reordered, synthetic
from builders.replays import replayed

import gazempc as gz
from gazempc.errors import LeftOutError
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.results.metrics import measure
from gazempc.results.motion import limit_violations
from gazempc.run import main as run_main
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene

LARGEST = {"velocity_max_rad_s": 1e3, "acceleration_max_rad_s2": 1e6, "jerk_max_rad_s3": 1e9}
LEAST = {"velocity_max_rad_s": 0.01, "acceleration_max_rad_s2": 0.01, "jerk_max_rad_s3": 0.1}
FAST, SLOW = {"natural_frequency_rad_s": 1e3}, {"natural_frequency_rad_s": 0.01}
RATES = {"control_rate_hz": 100.0, "servo_rate_hz": 100.0}


@pytest.fixture(scope="module")
def walk():
    return reordered(synthetic("subject03_R4"), range(75))


def neck_of(base="reference", rates=None, **of_axis):
    content = load_neck(base).model_dump() | (rates or {})
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
        (neck_of(**SLOW), {}),
        (neck_of("reference_eyes", **LARGEST, **FAST), {}),
        (neck_of("reachy_mini_body", **LEAST), {}),
        (neck_of(dead_time_s=5.0, damping_ratio=0.11), {}),
        (neck_of(position_min_deg=0.0, position_max_deg=1e-9), {}),
        (neck_of("slow", rates=RATES), {"mpc": {"horizon_s": 5.0, "smoothing_time_s": 1.0}}),
        (neck_of(), {"mpc": {"smoothing_time_s": 1e-300}, "predictor": "constant_velocity"}),
    ],
    ids=lambda value: "",
)
def test_what_is_accepted_is_replayed_within_limits(neck, settings, walk):
    log = replayed(walk, neck=neck, settings=ReplaySettings.model_validate(settings))
    assert limit_violations(log, neck) == 0
    assert log.faults == ()
    assert np.isfinite(measure(log).gaze_error_rms_deg)


def test_the_mpc_follows_with_a_fast_joint_as_look_ahead_does(walk):
    """Each step of a held command makes a fast joint jump: that is no motion to be smoothed away."""
    neck = neck_of(**FAST)
    mpc, ahead = (measure(replayed(walk, name, neck=neck)).gaze_error_rms_deg for name in ("mpc", "lookahead"))
    assert mpc < ahead + 0.5


def passer(rate_hz, seconds=4.0, name="passer"):
    times_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    heads_m = np.column_stack([np.full(times_s.size, 0.0), 0.8 * (times_s - seconds / 2), np.full(times_s.size, 1.6)])
    return gz.recording_from_arrays(name, times_s, heads_m)


def lookahead_of(recording, **settings):
    scene = make_scene(recording, SceneSettings(**settings.pop("scene", {})), **settings)
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
    said = capsys.readouterr().out
    assert "Note: 3.0 frames a second" in said
    assert said.count("low_frame_rate") == 0
    log = gz.load_log(tmp_path / "out" / "lookahead.npz")
    known = int(np.isfinite(log.head_true_base_m).all(axis=1).sum())
    assert f"Note: the true head is known at {known} of {log.time_s.size} ticks" in said
    notes = json.loads((tmp_path / "out" / "summary.json").read_text())["notes"]
    assert [f"Note: {note}" in said for note in notes] == [True, True]


def test_too_few_frames_are_not_called_a_short_recording():
    with pytest.raises(LeftOutError, match=r"known at \d ticks from 1.0 s on, at least 10 are needed"):
        gz.measure(lookahead_of(passer(1.5)))


def test_the_view_of_a_camera_on_the_head_limits_what_is_seen():
    neck = gz.load_neck("reference").model_copy(update={"head_view_deg": (60.0, 45.0)})
    ahead = lookahead_of("subject03_R4", neck=neck)
    assert ahead.run.sensor["view"] == {"on": "head", "horizontal_deg": 60.0, "vertical_deg": 45.0}
    # A person 50 degrees beside the gaze is out of view, and the neck without a person stays where it is.
    aside = lookahead_of("subject03_R4", neck=neck, scene={"start_offset_deg": 50.0})
    assert aside.capture_time_s[0] > 2.0  # the person has walked into view
