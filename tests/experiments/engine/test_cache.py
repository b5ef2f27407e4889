"""Kept results: what was written is read, and damage is noticed, named and repaired."""

import re

import numpy as np
import pytest
from builders.in_process import workers_in_this_process
from tiny_jobs import Tiny

from experiments.engine.cache import Cache, read_result
from experiments.engine.engine import Engine
from gazempc.errors import GazempcError

ROW = {"left_out": None, "failed": None, "rms_deg": 1.0 / 3.0, "name": "né", "list": [1, None, 2.5]}
ROW |= {"error_m": np.array([[0.1, np.nan], [1e-300, -0.0]]), "seen": np.array([True, False])}


def test_what_is_kept_is_found_to_the_last_bit(tmp_path):
    kept, found = Cache(tmp_path).keep("key", ROW), Cache(tmp_path).find("key")
    for got in (kept, found):
        assert got.keys() == ROW.keys()
        for name, value in ROW.items():
            np.testing.assert_array_equal(got[name], value)
    assert Cache(tmp_path).find("other") is None


DAMAGES = {
    "cut": lambda data: data[: len(data) // 2],
    "zeros at the end": lambda data: data[:-30] + bytes(30),
    "a digit of an array": lambda data: data.replace(np.float64(0.1).tobytes(), np.float64(0.2).tobytes()),
    "a digit of the text": lambda data: data.replace("3333".encode("utf-32-le"), "3433".encode("utf-32-le"), 1),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_noticed_named_and_put_away(damage, tmp_path, capsys):
    cache = Cache(tmp_path)
    cache.keep("key", ROW)
    path = cache.path("key")
    damaged = DAMAGES[damage](path.read_bytes())
    assert damaged != path.read_bytes()
    path.write_bytes(damaged)
    with pytest.raises(GazempcError, match=re.escape(str(path))):
        read_result(path)
    assert cache.find("key") is None
    assert str(path) in capsys.readouterr().err
    assert not path.exists()


def test_the_result_of_another_job_is_refused(tmp_path):
    cache = Cache(tmp_path)
    cache.keep("key", ROW)
    cache.path("key").rename(cache.path("other"))
    with pytest.raises(GazempcError, match="another job"):
        read_result(cache.path("other"))


def test_a_job_whose_result_is_damaged_is_done_again(tmp_path, capfd):
    path = Cache(tmp_path).path(Tiny(1).key())
    with workers_in_this_process(), Engine(tmp_path, jobs=1) as engine:
        engine.run([Tiny(1), Tiny(2)])
        path.write_text("{")
    with workers_in_this_process(), Engine(tmp_path, jobs=1) as engine:
        assert [row["square"] for row in engine.run([Tiny(1), Tiny(2)])] == [1, 4]
    assert str(path) in capfd.readouterr().err
    assert read_result(path)["square"] == 1
