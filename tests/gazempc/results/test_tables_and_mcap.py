"""A log as tables and as MCAP: every value is that of the log."""

import csv
import json
import math
import sys
from dataclasses import fields

import numpy as np
import pandas as pd
import pytest
from builders.bags import face_rows, write_bag
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

import gazempc as gz
from gazempc.errors import SettingsError
from gazempc.export import export, main
from gazempc.neck.kinematics import gaze_ray
from gazempc.results.log import Log
from gazempc.results.mcap_file import write_mcap
from gazempc.results.mcap_read import has_log
from gazempc.results.metrics import gaze_error_deg


@pytest.fixture(scope="module")
def log():
    return gz.replay("subject03_R4", controller="lookahead", predictor="constant_velocity", sensor="reference")


@pytest.fixture(scope="module")
def mcap_path(log, tmp_path_factory):
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    write_mcap(log, path)
    return path


def messages(path, topic):
    with path.open("rb") as file:
        return [(m.log_time, m.data) for _, _, m in make_reader(file).iter_messages(topics=[topic])]


def same(one, other):
    for field in fields(Log):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b, err_msg=field.name)
        else:
            assert a == b, field.name


def test_a_log_and_a_bag_are_told_apart(mcap_path, tmp_path):
    assert has_log(mcap_path)
    bag = write_bag(tmp_path / "bag", face_rows("face_a", np.arange(9) / 30.0, [0.0, 0.0, 1.5]), "mcap")
    (file,) = bag.glob("*.mcap")
    assert not has_log(file)
    assert not has_log(tmp_path / "none.mcap")


def test_an_mcap_file_is_the_log_to_the_last_bit(log, mcap_path):
    same(gz.load_log(mcap_path), log)


def test_numbers_in_its_channels_are_those_of_the_log_at_their_times(log, mcap_path):
    ticks = [(at, json.loads(data)) for at, data in messages(mcap_path, "/ticks")]
    assert [at for at, _ in ticks] == [round(1e9 * t) for t in log.time_s]
    for k, name in enumerate(("pan", "tilt")):
        np.testing.assert_array_equal([m[f"command_{name}_rad"] for _, m in ticks], log.command_position_rad[:, k])
        np.testing.assert_array_equal([m[f"joint_{name}_rad_s"] for _, m in ticks], log.joint_velocity_rad_s[:, k])
    errors = [json.loads(data)["gaze_error_deg"] for _, data in messages(mcap_path, "/metrics")]
    np.testing.assert_array_equal(errors, gaze_error_deg(log))
    forecasts = [(at, json.loads(data)) for at, data in messages(mcap_path, "/forecasts")]
    assert len(forecasts) == 3 * log.capture_time_s.size
    at, seventh = forecasts[3 * 6 + 1]
    assert at == round(1e9 * log.arrival_time_s[6])
    assert seventh["horizon_s"] == log.forecast_horizon_s[1]
    assert seventh["mean_y_base_m"] == log.forecast_mean_base_m[6, 1, 1]
    assert seventh["covariance_xz_m2"] == log.forecast_covariance_m2[6, 1, 0, 2]
    # JSON has neither NaN nor infinity: constant velocity states a normal distribution.
    assert log.forecast_degrees_of_freedom[6] == math.inf
    assert seventh["degrees_of_freedom"] is None


def decoded(data, path, topic):
    """A message of a Foxglove schema, by the schema that is in the file, as a viewer does it."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    channel = next(c for c in summary.channels.values() if c.topic == topic)
    schema = summary.schemas[channel.schema_id]
    pool = descriptor_pool.DescriptorPool()
    for each in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(each)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name)).FromString(data)


def test_frames_lead_from_the_base_to_the_eye(log, mcap_path):
    """The chain of transforms is the kinematics of the neck."""
    sent = messages(mcap_path, "/tf")
    at, data = sent[len(sent) // 2]
    k = int(np.argmin(np.abs(log.time_s - at / 1e9)))
    position, turn = np.zeros(3), Rotation.identity()
    for each in decoded(data, mcap_path, "/tf").transforms:
        position = position + turn.apply([each.translation.x, each.translation.y, each.translation.z])
        q = each.rotation
        turn = turn * Rotation.from_quat([q.x, q.y, q.z, q.w])
    eye, direction = gaze_ray(log.neck.geometry, log.joint_position_rad[k])
    np.testing.assert_allclose(position, eye, atol=1e-12)
    np.testing.assert_allclose(turn.apply([1.0, 0.0, 0.0]), direction, atol=1e-12)


def test_ellipsoids_have_two_standard_deviations_along_their_axes(log, mcap_path):
    found = {}
    for _, data in messages(mcap_path, "/scene"):
        for entity in decoded(data, mcap_path, "/scene").entities:
            found.setdefault(entity.id, []).append(entity)
    assert set(found) == {"person", "observed", "forecast", "gaze"}
    forecast = found["forecast"][20]
    points = [[p.x, p.y, p.z] for p in forecast.lines[0].points]
    k = int(np.flatnonzero((log.forecast_mean_base_m == points).all(axis=(1, 2)))[0])
    for sphere, covariance in zip(forecast.spheres, log.forecast_covariance_m2[k], strict=True):
        q, size = sphere.pose.orientation, np.array([sphere.size.x, sphere.size.y, sphere.size.z])
        turn = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
        np.testing.assert_allclose(turn @ np.diag((size / 4.0) ** 2) @ turn.T, covariance, atol=1e-12)


def test_events_are_messages(log, mcap_path):
    sent = [decoded(data, mcap_path, "/events") for _, data in messages(mcap_path, "/events")]
    assert [message.message for message in sent] == log.event_name.tolist()


def test_pandas_tables_have_a_row_for_each(log):
    frames = log.to_pandas()
    assert len(frames.ticks) == log.time_s.size
    np.testing.assert_array_equal(frames.ticks["head_true_y_base_m"], log.head_true_base_m[:, 1])
    of_half_a_second = frames.forecasts[frames.forecasts["horizon_s"] == 0.5]
    np.testing.assert_array_equal(of_half_a_second["mean_x_base_m"], log.forecast_mean_base_m[:, 1, 0])
    np.testing.assert_array_equal(frames.observations["capture_time_s"], log.capture_time_s)
    assert frames.events["event"].tolist() == log.event_name.tolist()


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_tables_are_read_back_to_the_last_bit(log, tmp_path, to):
    paths = export(log, to, tmp_path / "run")
    assert [path.name for path in paths] == [
        f"run_{name}.{to}" for name in ("ticks", "observations", "forecasts", "events")
    ]
    read = (lambda p: pd.read_csv(p, float_precision="round_trip")) if to == "csv" else pd.read_parquet
    for path, frame in zip(paths, log.to_pandas(), strict=True):
        again = read(path)
        assert list(again) == list(frame)
        for name in frame.select_dtypes("number"):
            np.testing.assert_array_equal(again[name], frame[name])


def test_a_value_that_is_not_known_is_an_empty_cell(log, tmp_path):
    (_, _, forecasts, _) = export(log, "csv", tmp_path / "run")
    last = list(csv.DictReader(forecasts.read_text().splitlines()))[-1]
    assert last["head_true_x_base_m"] == ""  # one second after the last frame


def test_the_command_writes_beside_the_log(log, tmp_path, capsys):
    log.save(tmp_path / "run.npz")
    assert main([str(tmp_path / "run.npz"), "--to", "mcap"]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "run.mcap")
    same(gz.load_log(tmp_path / "run.mcap"), log)


def test_what_is_no_log_is_refused_by_name(tmp_path):
    import foxglove

    foxglove.open_mcap(tmp_path / "other.mcap", context=foxglove.Context()).close()
    with pytest.raises(SettingsError, match=r"other\.mcap: no log of gazempc"):
        gz.load_log(tmp_path / "other.mcap")
    (tmp_path / "cut.mcap").write_bytes((tmp_path / "other.mcap").read_bytes()[:30])
    with pytest.raises(SettingsError, match=r"cut\.mcap: not an MCAP file"):
        gz.load_log(tmp_path / "cut.mcap")


@pytest.mark.parametrize(("package", "extra"), [("foxglove", "view"), ("mcap.reader", "view")])
def test_a_missing_package_names_its_extra(log, mcap_path, tmp_path, monkeypatch, package, extra):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(SettingsError, match=rf"gazempc\[{extra}\]"):
        write_mcap(log, tmp_path / "x.mcap") if package == "foxglove" else gz.load_log(mcap_path)
