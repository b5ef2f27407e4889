"""The job engine: jobs run once, results are saved, failures are rows, damage is reported; keys and recordings."""

import os
import re
import shutil

import numpy as np
import pytest
from builders import exports
from tiny_jobs import Tiny

from experiments.engine.command import find_recordings, labels_of
from experiments.engine.engine import Cache, Engine, read_result
from experiments.engine.job import carry_out, program_hash, recording_hash
from gazempc.errors import GazempcError

ROW = {"left_out": None, "failed": None, "rms_deg": 1.0 / 3.0, "name": "né", "list": [1, None, 2.5]}
ROW |= {"error_m": np.array([[0.1, np.nan], [1e-300, -0.0]]), "seen": np.array([True, False])}


def test_saved_results_are_read_back_bit_for_bit(tmp_path):
    kept, found = Cache(tmp_path).keep("key", ROW), Cache(tmp_path).find("key")
    for got in (kept, found):
        assert got.keys() == ROW.keys()
        for name, value in ROW.items():
            np.testing.assert_array_equal(got[name], value)
    assert Cache(tmp_path).find("other") is None


DAMAGES = {
    "cut": lambda data: data[: len(data) // 2],
    "a digit of an array": lambda data: data.replace(np.float64(0.1).tobytes(), np.float64(0.2).tobytes()),
    "a digit of the text": lambda data: data.replace("3333".encode("utf-32-le"), "3433".encode("utf-32-le"), 1),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_result_file_is_reported_and_deleted(damage, tmp_path, capsys):
    cache = Cache(tmp_path)
    cache.keep("key", ROW)
    path = cache.path("key")
    damaged = DAMAGES[damage](path.read_bytes())
    assert damaged != path.read_bytes()
    path.write_bytes(damaged)
    with pytest.raises(GazempcError, match=re.escape(str(path))):
        read_result(path)
    assert cache.find("key") is None  # so the job is repeated
    assert str(path) in capsys.readouterr().err
    assert not path.exists()
    cache.keep("key", ROW)
    path.rename(cache.path("other"))
    with pytest.raises(GazempcError, match="another job"):
        read_result(cache.path("other"))


def names(folder):
    return {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """Folder and rows of a first run: squares, an array, and each kind of missing result."""
    folder = tmp_path_factory.mktemp("engine")
    jobs = [Tiny(3), Tiny(1), Tiny(3), Tiny(2, "array"), Tiny(1, "leave out"), Tiny(1, "fail"), Tiny(1, "bug")]
    with Engine(folder, jobs=2) as engine:
        return folder, jobs, engine.run(jobs)


@pytest.mark.slow
def test_results_keep_job_order_and_equal_jobs_run_once(first):
    folder, _, rows = first
    assert [row.get("square") for row in rows[:4]] == [9, 1, 9, 4]
    np.testing.assert_array_equal(rows[3]["array"], np.full((2, 2), 0.1))
    assert len(list(folder.iterdir())) == 4  # without the equal one and the failed ones
    assert all(row["pid"] != os.getpid() for row in rows[:4])


def test_a_failed_job_gives_a_row_with_the_reason(first):
    rows = first[2]
    assert rows[4] == {"left_out": "too near", "failed": None}
    assert rows[5] == {"left_out": None, "failed": "no such walk"}
    assert rows[6]["failed"].startswith("TypeError: a bug (tiny_jobs.py, line ")


def test_a_second_run_repeats_only_failed_jobs(first):
    folder, jobs, rows = first
    before = names(folder)
    with Engine(folder, jobs=1) as engine:
        again = engine.run(jobs)
    assert names(folder) == before
    assert [row.get("pid") for row in again[:4]] == [row["pid"] for row in rows[:4]]
    assert again[6]["failed"] == rows[6]["failed"]


def test_a_killed_worker_is_reported_and_other_results_are_kept(tmp_path):
    with Engine(tmp_path, jobs=1) as engine:
        engine.run([Tiny(1), Tiny(2)])
        with pytest.raises(GazempcError, match=r"a worker process died .*; 2 of 3 results are kept in "):
            engine.run([Tiny(1, "die")])
    assert len(list(tmp_path.iterdir())) == 2


def test_a_worker_with_other_code_or_files_reports_a_failure():
    job = Tiny(2)
    assert "differs from the main process" in carry_out(job, job.key(), "0")["failed"]
    assert "files differ" in carry_out(job, "0", program_hash())["failed"]
    assert carry_out(job, job.key(), program_hash())["square"] == 4


def test_folders_that_are_recordings_are_listed(tmp_path):
    keypoints = exports.openpose(tmp_path / "walk")
    (tmp_path / "empty").mkdir()
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("")
    for name in ("b.csv", "index.csv", "notes.txt", "a.mvnx", "b.csv.columns.toml"):
        (tmp_path / name).write_text("")
    found = [str(tmp_path / name) for name in ("a.mvnx", "b.csv", "bag", "walk")]
    assert find_recordings([str(tmp_path)]) == found
    assert find_recordings([str(keypoints)]) == [str(keypoints)]
    with pytest.raises(GazempcError, match="no recordings in this folder"):
        find_recordings([str(tmp_path / "empty")])
    with pytest.raises(GazempcError, match=r"perhaps you meant 'synthetic'[\s\S]*none\.csv"):
        find_recordings(["syntetic", str(tmp_path / "none.csv")])
    with pytest.raises(GazempcError, match="perhaps you meant 'subject03_R4'; accepted: everyday, synthetic, a syn"):
        find_recordings(["subject3_R4"])


def test_the_key_depends_on_saved_columns_and_all_files_of_a_folder(tmp_path):
    path = tmp_path / "a.csv"
    np.savetxt(path, np.eye(4))
    keys = [recording_hash(str(path))]
    (tmp_path / "columns.toml").write_text('t = "1"\n')
    keys.append(recording_hash(str(path)))
    (tmp_path / "a.csv.columns.toml").write_text('t = "2"\n')
    keys.append(recording_hash(str(path)))
    folder = exports.openpose(tmp_path / "walk")
    keys.append(recording_hash(str(folder)))
    shutil.copy(next(folder.iterdir()), folder / "walk_000000000500_keypoints.json")
    keys.append(recording_hash(str(folder)))
    assert len({tuple(key) for key in keys}) == len(keys)


def test_labels_are_stems_and_distinct_if_folders_have_files_of_one_name():
    names = ["subject01_R1", "walks/cmu05.csv", "anna/walk_1.csv", "ben/walk_1.csv"]
    assert labels_of(names) == ["subject01_R1", "cmu05", "anna/walk_1", "ben/walk_1"]
