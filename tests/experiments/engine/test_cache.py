"""Kept results: what was written is read, and damage is noticed, named and repaired."""

import json
import re

import numpy as np
import pytest
from builders.in_process import workers_in_this_process
from tiny_jobs import Tiny

from experiments.engine.cache import Cache, read_result, result_file
from experiments.engine.engine import Engine
from gazempc.errors import GazempcError

PLAIN = {"left_out": None, "failed": None, "rms_deg": 1.0 / 3.0, "name": "né", "list": [1, None, 2.5]}
ARRAYS = PLAIN | {"error_m": np.array([[0.1, np.nan], [1e-300, -0.0]]), "seen": np.array([True, False])}


@pytest.mark.parametrize("row", [PLAIN, ARRAYS], ids=["plain", "arrays"])
def test_what_is_kept_is_found_to_the_last_bit(row, tmp_path):
    kept, found = Cache(tmp_path).keep("key", row), Cache(tmp_path).find("key")
    for got in (kept, found):
        assert got.keys() == row.keys()
        for name, value in row.items():
            np.testing.assert_array_equal(got[name], value)
    assert [p.suffix for p in tmp_path.iterdir()] == [".npz" if "seen" in row else ".json"]
    assert Cache(tmp_path).find("other") is None


def cut(data):
    return data[: len(data) // 2]


DAMAGES = {
    "cut": cut,
    "empty": lambda _: b"",
    "a digit": lambda data: data.replace(b"3333", b"3433", 1),
    "a name": lambda data: data.replace(b"rms_deg", b"rms_rad"),
    "another job's": lambda data: data.replace(b'"key": "key"', b'"key": "yek"'),
    "list": lambda _: b"[]",
    "null": lambda _: b"null",
    "no row": lambda _: b"{}",
    "no text": lambda _: b"\xff\xfe\x00",
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_noticed_named_and_put_away(damage, tmp_path, capsys):
    Cache(tmp_path).keep("key", PLAIN)
    (path,) = tmp_path.iterdir()
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    assert Cache(tmp_path).find("key") is None
    error = capsys.readouterr().err
    assert str(path) in error
    assert "done again" in error
    assert not path.exists()


def test_a_job_whose_result_is_damaged_is_done_again(tmp_path, capfd):
    with workers_in_this_process(), Engine(tmp_path, jobs=1) as engine:
        engine.run([Tiny(1), Tiny(2)])
        path = result_file(tmp_path, Tiny(1).key())
        path.write_text("{")
    with workers_in_this_process(), Engine(tmp_path, jobs=1) as engine:
        assert [row["square"] for row in engine.run([Tiny(1), Tiny(2)])] == [1, 4]
        assert [row["square"] for row in engine.fresh] == [1]
    assert str(path) in capfd.readouterr().err
    assert read_result(path)["square"] == 1


@pytest.mark.parametrize("damage", [cut, lambda _: b"", lambda data: data[:-30] + bytes(30)])
def test_damaged_arrays_are_noticed(damage, tmp_path):
    Cache(tmp_path).keep("key", ARRAYS)
    path = result_file(tmp_path, "key")
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(GazempcError, match=re.escape(str(path))):
        read_result(path)


def test_a_changed_array_is_noticed(tmp_path):
    Cache(tmp_path).keep("key", ARRAYS)
    path = result_file(tmp_path, "key")
    data, value = path.read_bytes(), np.float64(0.1).tobytes()
    path.write_bytes(data.replace(value, np.float64(0.2).tobytes()))
    with pytest.raises(GazempcError, match="damaged"):
        read_result(path)


def test_nothing_half_written_is_left(tmp_path, monkeypatch):
    monkeypatch.setattr("pathlib.Path.replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        Cache(tmp_path).keep("key", PLAIN)
    assert not list(tmp_path.iterdir())


def test_the_file_is_json_that_people_can_read(tmp_path):
    Cache(tmp_path).keep("key", PLAIN)
    content = json.loads((tmp_path / "key.json").read_text())
    assert content["key"] == "key"
    assert content["row"] == PLAIN


@pytest.mark.parametrize("change", ["another name", "another kind", "another order of axes", "one more", "one less"])
def test_arrays_that_were_written_anew_are_noticed(change, tmp_path):
    """An archive whose own check sums hold."""
    Cache(tmp_path).keep("key", ARRAYS)
    path = result_file(tmp_path, "key")
    with np.load(path) as data:
        arrays = dict(data)
    if change == "another name":
        arrays["error_mm"] = arrays.pop("error_m")
    elif change == "another kind":
        arrays["seen"] = arrays["seen"].astype(np.int8)
    elif change == "another order of axes":
        arrays["error_m"] = arrays["error_m"].ravel()
    elif change == "one more":
        arrays["more"] = np.zeros(1)
    else:
        del arrays["seen"]
    np.savez(path, **arrays)
    with pytest.raises(GazempcError, match="damaged"):
        read_result(path)
