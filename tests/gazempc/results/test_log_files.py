"""Files of a log: bit-exact round trips, joins, tables, and MCAP read by the `mcap` library."""

import dataclasses
import json
import math

import numpy as np
import pandas as pd
import pytest
from builders.bags import face_rows, write_bag
from builders.mcap import column, decoded, entities, numbers, placed
from builders.recordings import reordered, synthetic
from builders.replays import QUICK, cut, replayed
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

import gazempc as gz
from gazempc.export import export
from gazempc.export import main as export_main
from gazempc.live.mount import Mount
from gazempc.loop.events import MEANINGS
from gazempc.neck.kinematics import gaze_error_rad, gaze_ray, head_angles_rad
from gazempc.results.attention import measure_attention
from gazempc.results.log import Fault, Log, join_logs, merge_faults
from gazempc.results.log_files import has_log, write_mcap
from gazempc.results.metrics import gaze_error_deg
from gazempc.results.page.run_page import unusual_of
from gazempc.run import main as run_main
from predictors import HeadObservation


@pytest.fixture(scope="module")
def log():
    """Of a neck with eyes and a body."""
    walk = reordered(synthetic("subject03_R1"), range(60))
    neck = gz.load_neck("reference_eyes").model_copy(update={"body": gz.load_neck("reachy_mini_body").body})
    return replayed(walk, "lookahead", settings=QUICK, neck=neck)


@pytest.fixture(scope="module")
def path(log, tmp_path_factory):
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    write_mcap(log, path)
    return path


def nanoseconds(times_s):
    return [round(1e9 * t) for t in times_s]


def every(log):
    """Ticks from one scene to the next, 50 of which come in a second."""
    return round(log.neck.servo_rate_hz / 50)


def same(one, other):
    for field in dataclasses.fields(Log):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b, err_msg=field.name)
        else:
            assert a == b, field.name


def test_names_of_earlier_versions_are_read_as_the_present_ones(log, tmp_path):
    events, people = np.array([0.5, 1.0]), np.array([1, 0])
    fields = {"event_time_s": events, "attended_time_s": events, "attended_person": people}

    def named(event, why):
        names = {"event_name": np.array(["gate_refused", event]), "attended_why": np.array(["policy", why])}
        return dataclasses.replace(log, **fields, **names)

    named("nobody_attended", "nobody").save(tmp_path / "old.npz")
    old, new = gz.load_log(tmp_path / "old.npz"), named("no_person_attended", "no_person")
    same(old, new)
    assert repr(measure_attention(old)) == repr(measure_attention(new))  # NaN, too
    assert unusual_of(old, MEANINGS) == unusual_of(new, MEANINGS)


def test_a_log_is_read_back_bit_for_bit(log, path, tmp_path):
    log.save(tmp_path / "run.npz")
    for again in (gz.load_log(path), gz.load_log(tmp_path / "run.npz")):
        same(again, log)
        assert again.run == log.run
    with path.open("rb") as file:
        (about,) = [each.metadata for each in make_reader(file).iter_metadata() if each.name == "gazempc"]
    assert json.loads(about["run"]) == json.loads(log.run.as_json())


@pytest.mark.parametrize("topic", ["ticks", "observations", "forecasts"])
def test_mcap_values_equal_those_of_the_tables(log, path, topic):
    """Reference: the pandas tables, which are tested against the log."""
    frame = getattr(log.to_pandas(), topic)
    found = numbers(path, f"/{topic}")
    assert len(found) == len(frame)
    for name in frame:
        expected = frame[name].replace([math.inf, -math.inf], np.nan).to_numpy()
        if name == "person_id":
            assert [m[name] for _, m in found] == expected.tolist()
        else:
            np.testing.assert_array_equal(column(path, f"/{topic}", name), expected, err_msg=name)
    seen_s = log.arrival_time_s
    times_s = {"ticks": log.time_s, "observations": seen_s, "forecasts": np.repeat(seen_s, 3)}
    assert [at for at, _ in found] == nanoseconds(times_s[topic])


def test_mcap_gaze_errors_equal_the_metrics(log, path):
    np.testing.assert_allclose(column(path, "/metrics", "gaze_error_deg"), gaze_error_deg(log), rtol=1e-12)
    newest = np.searchsorted(log.arrival_time_s, log.time_s + 1e-9, side="right") - 1
    observed = np.where((newest < 0)[:, None], np.nan, log.head_observed_base_m[newest])
    expected = np.rad2deg(gaze_error_rad(log.neck.geometry, log.joint_position_rad, observed))
    np.testing.assert_allclose(column(path, "/metrics", "gaze_to_observed_deg"), expected, rtol=1e-12)
    # Values available in a run only are absent.
    assert np.isnan(column(path, "/metrics", "late_ms")).all()


def test_transforms_compose_from_base_to_eye(log, path):
    """The chain of transforms is the kinematics of the neck, with its eyes and its body."""
    of = dict(zip(nanoseconds(log.time_s), log.joint_position_rad, strict=True))
    sent = [(at, m.transforms) for at, m in decoded(path, "/tf") if m.transforms[-1].child_frame_id != "person"]
    for at, frames in sent[::40]:
        position_m, turn = placed(frames, "eye")
        eye_m, direction = gaze_ray(log.neck.geometry, of[at])
        np.testing.assert_allclose(position_m, eye_m, atol=1e-12)
        np.testing.assert_allclose(turn.apply([1.0, 0.0, 0.0]), direction, atol=1e-12)


def test_the_camera_frame_equals_the_mount(log, tmp_path):
    """Its transform equals that of the run's mount."""
    mount = Mount(on="head", position_m=(0.05, 0.0, 0.1), roll_pitch_yaw_deg=(3.0, 10.0, -20.0))
    run = log.run.model_copy(update={"settings": {"mount": mount.model_dump(mode="json")}})
    write_mcap(cut(dataclasses.replace(log, run=run), 0.0, 1.3), tmp_path / "mounted.mcap")
    k = 60 * every(log)
    at_tick = round(1e9 * log.time_s[k])
    sent = [m for at, m in decoded(tmp_path / "mounted.mcap", "/tf") if at == at_tick and len(m.transforms) > 1]
    seen = HeadObservation(0.0, np.array([2.0, 0.3, 0.1]))
    expected = mount.to_base(seen, log.neck.geometry, head_angles_rad(log.joint_position_rad[k])).head_position_base_m
    at_m, turn = placed(sent[0].transforms, "camera")
    np.testing.assert_allclose(at_m + turn.apply(seen.head_position_base_m), expected, atol=1e-12)


def test_the_scene_shows_observations_and_forecasts(log, path):
    found = entities(path)
    assert set(found) == {"person", "observed", "forecast", "gaze"}
    known = np.isfinite(log.forecast_mean_base_m).all(axis=(1, 2))
    lines = [[[p.x, p.y, p.z] for p in each.lines[0].points] for each in found["forecast"]]
    np.testing.assert_array_equal(lines, log.forecast_mean_base_m[known])
    for each, covariances_m2 in list(zip(found["forecast"], log.forecast_covariance_m2[known], strict=True))[::20]:
        for sphere, covariance in zip(each.spheres, covariances_m2, strict=True):
            # Two standard deviations along their axes.
            q, size = sphere.pose.orientation, np.array([sphere.size.x, sphere.size.y, sphere.size.z])
            turn = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
            np.testing.assert_allclose(turn @ np.diag((size / 4.0) ** 2) @ turn.T, covariance, atol=1e-12)
    ray = found["gaze"][30].lines[0].points
    direction = np.array([ray[1].x - ray[0].x, ray[1].y - ray[0].y, ray[1].z - ray[0].z])
    _, directions = gaze_ray(log.neck.geometry, log.joint_position_rad)
    np.testing.assert_allclose(direction / 4.0, directions[30 * every(log)], atol=1e-9)


@pytest.mark.slow
def test_the_file_of_a_replay_has_its_plans(tmp_path, capsys):
    words = ["--replay", "subject03_R1", "--controllers", "lookahead", "--predictor", "constant_velocity"]
    words += ["--noise-seeds", "1", "--log", "mcap", "--no-figures", "--out", str(tmp_path)]
    assert run_main(words) == 0
    capsys.readouterr()
    log = gz.load_log(tmp_path / "lookahead.mcap")
    plans = numbers(tmp_path / "lookahead.mcap", "/plan")
    assert len(plans) > 100
    for at, plan in plans[50:80]:
        knots_s = plan["start_s"] + plan["step_s"] * np.arange(len(plan["pan_rad"]))
        commanded = log.command_position_rad[np.searchsorted(log.time_s, at / 1e9 - 1e-6), 0]
        assert commanded == pytest.approx(np.interp(at / 1e9, knots_s, plan["pan_rad"]), abs=0.02)
    latency_ms = column(tmp_path / "lookahead.mcap", "/metrics", "latency_ms")
    assert 60.0 < np.nanmedian(latency_ms) < 110.0


def test_a_log_and_a_bag_are_distinguished(path, tmp_path):
    assert has_log(path)
    bag = write_bag(tmp_path / "bag", face_rows("face_a", np.arange(9) / 30.0, [0.0, 0.0, 1.5]), "mcap")
    (file,) = bag.glob("*.mcap")
    assert not has_log(file)
    assert not has_log(tmp_path / "none.mcap")


def test_parts_of_a_log_join_to_the_whole(log):
    joined = join_logs([cut(log, 0.0, 0.5), cut(log, 0.5, 1.5), cut(log, 1.5, np.inf)])
    same(joined, log)


def test_events_keep_their_first_exception_and_their_count():
    first, other = Fault("forecast_failed", 3, "TypeError: a", "trace a"), Fault("late_plan", 1, "OSError", "b")
    again = Fault("forecast_failed", 4, "ValueError: c", "trace c")
    assert merge_faults([first, other, again]) == (Fault("forecast_failed", 7, "TypeError: a", "trace a"), other)
    assert first.line == "forecast_failed (3 x): TypeError: a"


def test_pandas_tables_have_a_row_for_each_record(log):
    frames = log.to_pandas()
    assert len(frames.ticks) == log.time_s.size
    np.testing.assert_array_equal(frames.ticks["head_true_y_base_m"], log.head_true_base_m[:, 1])
    of_half_a_second = frames.forecasts[frames.forecasts["horizon_s"] == 0.5]
    np.testing.assert_array_equal(of_half_a_second["mean_x_base_m"], log.forecast_mean_base_m[:, 1, 0])
    np.testing.assert_array_equal(frames.observations["capture_time_s"], log.capture_time_s)
    assert frames.events["event"].tolist() == log.event_name.tolist()


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_tables_are_read_back_bit_for_bit(log, tmp_path, to):
    paths = export(log, to, tmp_path / "run")
    read = (lambda p: pd.read_csv(p, float_precision="round_trip")) if to == "csv" else pd.read_parquet
    for path, frame in zip(paths, log.to_pandas(), strict=True):
        again = read(path)
        assert list(again) == list(frame)
        for name in frame.select_dtypes("number"):
            np.testing.assert_array_equal(again[name], frame[name])


def test_the_command_writes_the_mcap_file_beside_the_log(log, tmp_path, capsys):
    cut(log, 0.0, 0.5).save(tmp_path / "run.npz")
    assert export_main([str(tmp_path / "run.npz"), "--to", "mcap"]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "run.mcap")
    assert gz.load_log(tmp_path / "run.mcap").run == log.run
