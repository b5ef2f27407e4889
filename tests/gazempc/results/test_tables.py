"""A log as tables: every value is that of the log."""

import numpy as np
import pandas as pd
import pytest

import gazempc as gz
from gazempc.export import export, main


@pytest.fixture(scope="module")
def log():
    return gz.replay("subject03_R4", controller="lookahead", predictor="constant_velocity", sensor="reference")


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


def test_the_command_writes_beside_the_log(log, tmp_path, capsys):
    log.save(tmp_path / "run.npz")
    assert main([str(tmp_path / "run.npz"), "--to", "mcap"]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "run.mcap")
    assert gz.load_log(tmp_path / "run.mcap").run == log.run
