"""Rare frames are said in a replay; a camera on the robot's head sees what is before it."""

import json

import numpy as np
import pytest

import gazempc as gz
from gazempc.errors import LeftOutError
from gazempc.run import main as run_main
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene


def walk(rate_hz, seconds=4.0, name="passer"):
    times_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    heads_m = np.column_stack([np.full(times_s.size, 0.0), 0.8 * (times_s - seconds / 2), np.full(times_s.size, 1.6)])
    return gz.recording_from_arrays(name, times_s, heads_m)


def replayed(recording, **settings):
    scene = make_scene(recording, SceneSettings(**settings.pop("scene", {})), **settings)
    return replay_scene(scene, "lookahead", "constant_velocity", ReplaySettings())[0]


@pytest.mark.parametrize(("rate_hz", "of_sensor_hz", "low"), [(5.8, 30.0, True), (6.0, 30.0, False), (60.0, 4.0, True)])
def test_rare_frames_are_an_event_of_a_replay(rate_hz, of_sensor_hz, low):
    sensor = gz.load_sensor("reference").model_copy(update={"rate_hz": of_sensor_hz})
    log = replayed(walk(rate_hz, 2.5), sensor=sensor)
    assert ("low_frame_rate" in log.event_name) is low


def test_a_replay_of_rare_frames_warns_once_and_prints_how_much_is_scored(tmp_path, capsys):
    slow = walk(3.0, 6.0)
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
        gz.measure(replayed(walk(1.5)))


def test_the_view_of_a_camera_on_the_head_limits_what_is_seen():
    neck = gz.load_neck("reference").model_copy(update={"head_view_deg": (60.0, 45.0)})
    ahead = replayed("subject03_R4", neck=neck)
    assert ahead.run.sensor["view"] == {"on": "head", "horizontal_deg": 60.0, "vertical_deg": 45.0}
    # A person 50 degrees beside the gaze is out of view, and the neck without a person stays where it is.
    aside = replayed("subject03_R4", neck=neck, scene={"start_offset_deg": 50.0})
    assert aside.capture_time_s[0] > 2.0  # the person has walked into view
