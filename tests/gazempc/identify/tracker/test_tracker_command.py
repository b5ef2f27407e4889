"""The command: from a recording to a sensor file, and refusals."""

import json

import numpy as np
import pytest
from builders.bags import face_rows, write_bag
from builders.trackers import person_m, seen_m
from scipy.spatial.transform import Rotation

from gazempc.identify.identify import main
from gazempc.recordings.load import recording_from_arrays
from gazempc.sim.sensor import load_sensor, observe

TIMES_S = np.arange(0.0, 10.0, 1.0 / 18.0)
RNG = np.random.default_rng(0)
SEEN_M = seen_m(RNG, person_m(RNG, TIMES_S), TIMES_S, along=(0.02, 0.0, 1.0), across_deg=(0.1, 0.0, 1.0))


def identify(path, tmp_path, *more):
    out = tmp_path / "mine.toml"
    assert main(["--tracker", str(path), "--out", str(out), *more]) == 0
    return load_sensor(out)


def as_expected(sensor):
    errors = (sensor.along.noise_share, sensor.across.noise_deg)
    return errors == pytest.approx((0.02, 0.1), rel=0.15) and sensor.rate_hz == pytest.approx(18.0, rel=1e-3)


def write_table(path, times_s=TIMES_S, position_m=SEEN_M):
    rows = np.column_stack([times_s, position_m])
    np.savetxt(path, rows, "%.12g", ",", header="t,head_x,head_y,head_z", comments="")
    return path


def test_a_table_of_heads_is_identified(tmp_path, capsys):
    sensor = identify(write_table(tmp_path / "anna.csv"), tmp_path)
    output = capsys.readouterr().out
    assert as_expected(sensor)
    assert sensor.name == "mine"
    assert (sensor.head_yaw.reported, sensor.pelvis_yaw.reported) == (False, False)
    assert (sensor.along.wander_share, sensor.dropout_probability) == (0.0, 0.0)
    assert "from anna.csv" in sensor.source
    assert "latency assumed" in sensor.source
    for words in ("range: white (% of the range)", "bearing: white (deg", "latency is not measured", "only 10 s"):
        assert words in output


def test_json_lines_are_identified(tmp_path, capsys):
    path = tmp_path / "seen.jsonl"
    lines = [
        json.dumps({"capture_time_s": 1.7e9 + t, "head_position_m": p, "person_id": "anna"})
        for t, p in zip(TIMES_S.tolist(), SEEN_M.tolist(), strict=True)
    ]
    bob = [
        json.dumps({"capture_time_s": 1.7e9 + t, "head_position_m": [1, 0, 0], "person_id": "bob"}) for t in range(9)
    ]
    path.write_text("\n".join([*lines, *bob, '{"capture_time_s": 17']))
    assert as_expected(identify(path, tmp_path))
    output = capsys.readouterr().out
    assert "also in the file: bob (9 frames)" in output
    assert "9 frames in" in refused(capsys, "--tracker", str(path), "--person", "bob")
    assert "--person carl: not in" in refused(capsys, "--tracker", str(path), "--person", "carl")
    assert f"1 of {len(TIMES_S) + 10} lines are not observations (line {len(TIMES_S) + 10}:" in output


def test_a_bag_gives_latency_and_losses(tmp_path, capsys):
    # The camera's axes, a face with its z axis towards the camera, rotating by 3 deg per frame.
    optical_m = SEEN_M @ np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turns_rad = np.pi + np.deg2rad(3.0) * RNG.standard_normal(TIMES_S.size)
    quats = Rotation.from_euler("y", turns_rad[:, None]).as_quat(scalar_first=True)
    kept = np.ones(TIMES_S.size, dtype=bool)
    kept[50:59] = kept[120:138] = kept[160] = False
    rows = [face_rows("face_a", [t], p, quat_wxyz=q)[0] for t, p, q in zip(TIMES_S, optical_m, quats, strict=True)]
    bag = write_bag(tmp_path / "bag", [row for row, keeps in zip(rows, kept, strict=True) if keeps], delay_s=0.12)
    sensor = identify(bag, tmp_path)
    assert as_expected(sensor)
    assert sensor.latency_s == pytest.approx(0.12, abs=1e-4)
    assert sensor.head_yaw.noise_deg == pytest.approx(3.0, rel=0.15)
    assert (sensor.loss.duration_min_s, sensor.loss.duration_max_s) == pytest.approx((0.5, 1.0), rel=1e-3)
    assert sensor.dropout_probability == pytest.approx(1 / TIMES_S.size, rel=0.01)
    assert "optical axes rotated" in capsys.readouterr().out


def test_wander_of_a_walking_person_is_omitted_with_a_warning(tmp_path, capsys):
    walk_m = seen_m(RNG, person_m(RNG, TIMES_S, walks=True), TIMES_S, along=(0.02, 0.05, 1.0), across_deg=(0.1, 0, 1))
    sensor = identify(write_table(tmp_path / "walk.csv", position_m=walk_m), tmp_path)
    output = capsys.readouterr().out
    assert "Warning: the person moved too much" in output
    assert "unknown" in output
    assert (sensor.along.wander_share, sensor.across.wander_deg) == (0.0, 0.0)
    assert "wander of range and bearing unknown" in sensor.source


def refused(capsys, *words):
    assert main(list(words)) == 2
    return capsys.readouterr().err


def test_invalid_recordings_are_refused(tmp_path, capsys):
    out = ("--out", str(tmp_path / "mine.toml"))
    assert "no such recording" in refused(capsys, "--tracker", "nowhere.csv", *out)
    (tmp_path / "notes.xlsx").write_text("hello")
    assert "unknown file type" in refused(capsys, "--tracker", str(tmp_path / "notes.xlsx"), *out)
    short = write_table(tmp_path / "short.csv", TIMES_S[:30], SEEN_M[:30])
    assert "at least 60 frames in 3 s" in refused(capsys, "--tracker", str(short), *out)
    assert "--person" in refused(capsys, "--robot", "simulated", "--person", "anna", *out)
    aged = tmp_path / "aged.jsonl"
    aged.write_text("\n".join(json.dumps({"age_s": 0.1, "head_position_m": [1, 0, 0]}) for _ in range(90)))
    assert "line 1: age_s is not a capture time" in refused(capsys, "--tracker", str(aged), *out)
    assert not (tmp_path / "mine.toml").exists()


def test_a_simulated_sensor_is_identified_from_its_observations(tmp_path):
    times_s = np.arange(0.0, 20.0, 1.0 / 30.0)
    standing_m = person_m(np.random.default_rng(2), times_s)
    recording = recording_from_arrays("standing", times_s, standing_m, in_base_frame=True)
    seen = [sighting.observation for sighting in observe(recording, load_sensor("face_camera"), seed=1)]
    captured_s, heads_m = ([getattr(o, name) for o in seen] for name in ("capture_time_s", "head_position_base_m"))
    path = write_table(tmp_path / "standing.csv", np.array(captured_s), np.array(heads_m))
    found, true = identify(path, tmp_path), load_sensor("face_camera")
    assert found.rate_hz == pytest.approx(true.rate_hz, rel=1e-3)
    assert found.along.noise_share == pytest.approx(true.along.noise_share, rel=0.1)
    assert found.along.wander_share == pytest.approx(true.along.wander_share, rel=0.4)
    assert found.across.noise_deg == pytest.approx(true.across.noise_deg, rel=0.1)
