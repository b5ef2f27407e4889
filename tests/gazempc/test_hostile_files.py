"""Files made to hang or to exhaust memory: refused by name at once, and never executed."""

import io
import os
import resource
import sqlite3
import struct
import time
import zipfile
from contextlib import closing

import numpy as np
import pytest
from backports import zstd
from builders import bags

from experiments.engine.command import find_recordings
from experiments.engine.engine import read_result
from experiments.sweep.plan import load_plan
from gazempc.errors import GazempcError
from gazempc.identify.record import load_record
from gazempc.identify.tracker.read import read_track
from gazempc.loop.build import walker_model
from gazempc.neck.spec import load_neck
from gazempc.recordings.load import load
from gazempc.recordings.readers.tables.mapping import read_mapping
from gazempc.results.log_files import load_log
from gazempc.run_settings import load_settings
from gazempc.sim.sensor import load_sensor

MOST_S, MOST_MB, MOST_CHARACTERS = 2.0, 500, 5000
READERS = {
    "walk.csv": load, "walk.tsv": load, "walk.txt": load, "walk.parquet": load, "walk.mvnx": load, "walk.json": load,
    "walk.bvh": load, "walk.mcap": load, "walk.db3": load, "log.npz": load_log, "log.mcap": load_log,
    "record.npz": load_record, "neck.toml": load_neck, "columns.toml": read_mapping, "run.yaml": load_settings,
    "sweep.yaml": load_plan, "result.json": read_result,
    "walker.npz": lambda path: walker_model(path, "anna"),
    "walk.jsonl": read_track,
}  # fmt: skip


def refused(read, path):
    """Message of a refusal, which is fast and uses little memory."""
    before_mb, started_s = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, time.process_time()
    with pytest.raises(GazempcError) as caught:
        read(path)
    assert time.process_time() - started_s < MOST_S
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - before_mb < MOST_MB
    message = str(caught.value)
    assert str(path) in message
    assert len(message) < MOST_CHARACTERS
    return message


@pytest.mark.parametrize("name", READERS)
def test_pipes_and_devices_do_not_block(name, tmp_path):
    pipe, device = tmp_path / name, tmp_path / "linked" / name
    os.mkfifo(pipe)
    assert "a pipe" in refused(READERS[name], pipe)
    device.parent.mkdir()
    device.symlink_to("/dev/zero")
    assert "a device" in refused(READERS[name], device)


def test_a_damaged_model_in_a_folder_is_named(tmp_path):
    (tmp_path / "walker.npz").write_bytes(b"no archive")
    with pytest.raises(GazempcError, match=r"walker\.npz: cannot be read"):
        walker_model(tmp_path, "anna")


@pytest.mark.parametrize("name", [name for name in READERS if not name.endswith((".mcap", ".db3", ".parquet"))])
def test_files_of_gigabytes_are_not_read(name, tmp_path):
    path = tmp_path / name
    with path.open("wb") as file:
        file.truncate(20 * 2**30)  # sparse
    assert "too large" in refused(READERS[name], path)


ALIASES = "a: &a [x, x, x, x, x, x, x, x]\n"
for before, after in zip("abcdefgh", "bcdefghi", strict=True):
    ALIASES += f"{after}: &{after} [{', '.join([f'*{before}'] * 8)}]\n"


TEXTS = [
    *((name, *each) for name in ("run.yaml", "sweep.yaml") for each in (
        (ALIASES, "aliases"),
        ("seed: " + "9" * 5000, "digits"),
        ("seed: " + "[" * 20000, "nested"),
        ("seed: !!python/object/apply:os.system ['touch harmed']", "could not determine a constructor"),
        ('replay: "\\ud800"', "YAML"),
        ("x" * 300_000 + ": 1", "too large"),
    )),
    ("neck.toml", "name = " + "9" * 5000, "digits"),
    ("neck.toml", "name = " + "[" * 20000, "nested"),
    ("neck.toml", "x" * 3000 + " = 1", "unknown field"),
    ("neck.toml", "".join(f"x{k} = 1\n" for k in range(5000)), "errors more"),
    *(("neck.toml", key.format(".a" * 40_000) + " = 1", "nested deeper") for key in ("a{}", "[a{}]\nx", "'a'{}")),
    ("walk.json", "[" * 200_000, "JSON"),
    ("walk.json", '{"joint_names": ' + "9" * 5000 + "}", "JSON"),
    ("walk.json", '{"a":' * 100_000, "JSON"),
    ("walk.json", "[[]," * 12_000_000, "at most"),
    ("walk.mvnx", "<a/>" * 3_000_000, "at most"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "text", "message"), TEXTS, ids=range(len(TEXTS)))
def test_texts_are_bounded_and_never_executed(name, text, message, tmp_path, monkeypatch):
    """Nesting, repetition or tags that would take hours, all memory, or run a command."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / name
    path.write_text(text)
    assert message in refused(READERS[name], path)
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_a_database_with_a_view_as_table_is_refused(tmp_path):
    bag = bags.write_bag(tmp_path / "bag", bags.face_rows("face_a", np.arange(20) / 10.0, (0.0, 0.0, 2.0)))
    file = next(bag.glob("*.db3"))
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("ALTER TABLE messages RENAME TO sound")
        forever = "WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n)"
        database.execute(
            f"CREATE VIEW messages AS {forever} SELECT id, 1 AS topic_id, 0 AS timestamp, 'x' AS data FROM n"
        )
    assert "view" in refused(load, bag)


def test_entities_in_xml_are_not_resolved(tmp_path):
    path = tmp_path / "walk.mvnx"
    secret = tmp_path / "secret.txt"
    secret.write_text("secret")
    path.write_text(f'<!DOCTYPE x [<!ENTITY e SYSTEM "file://{secret}">]><mvnx>&e;</mvnx>')
    assert "secret" not in refused(load, path).replace(str(secret), "")


def npz(members):
    """An archive of members with forged headers; see the format of numpy's files."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, (shape, kind, data) in members.items():
            header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
            archive.writestr(
                f"{name}.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + data
            )
    return file.getvalue()


@pytest.mark.parametrize(
    ("member", "message"),
    [
        (((10**12,), "<f8", b""), "its shape"),
        (((1,), "|O", b"\x80\x04."), "accepted: numbers and text"),
        (((3,), "<f8", bytes(8)), "its shape"),
    ],
)
def test_array_headers_must_match_their_data(member, message, tmp_path):
    path = tmp_path / "log.npz"
    path.write_bytes(npz({"time_s": member}))
    assert message in refused(load_log, path)
    assert message in refused(load_record, path)


@pytest.mark.parametrize("word", ["x" * 5000, "a\0b"])
def test_invalid_names_are_refused(word):
    for read in (load, load_log, load_neck, lambda name: find_recordings([name])):
        with pytest.raises(GazempcError) as caught:
            read(word)
        assert len(str(caught.value)) < 7000


TIMES_S = np.arange(90) / 30.0
WALK_M = np.column_stack([1.1 * TIMES_S, 0.0 * TIMES_S, 1.6 + 0.0 * TIMES_S])


@pytest.mark.parametrize(
    ("times_s", "head_m", "message"),
    [
        (np.append(TIMES_S[:-1], 1e6), WALK_M, "a gap of 1e+06 s"),
        (np.arange(7400) / 2.0, np.tile(WALK_M[:1], (7400, 1)), "lasts 1.028 h"),
        (TIMES_S, np.vstack([WALK_M[:-1], [[5000.0, 0.0, 1.6]]]), "is 4998 m from the middle"),
    ],
)
def test_an_impossible_walk_is_refused_with_the_reason(times_s, head_m, message, tmp_path):
    path = tmp_path / "walk.csv"
    rows = np.column_stack([times_s, head_m])
    np.savetxt(path, rows, "%.6f", ",", header="t,head_x,head_y,head_z", comments="")
    assert message in refused(load, path)


@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_a_compression_bomb_in_a_bag_is_refused(compression, tmp_path):
    bag = bags.write_bag(tmp_path / "bag", bags.face_rows("face_a", np.arange(20) / 10.0, (0.0, 0.0, 2.0)))
    if compression == "zstd":
        with zstd.open(bag / "more.db3.zstd", "wb") as file:
            for _ in range(300):
                file.write(bytes(2**20))
    else:
        chunk = struct.pack("<QQQIIQ", 0, 1, 2**31, 0, 0, 0)
        (bag / "more.mcap").write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(chunk)) + chunk)
    assert "implausibly large" in refused(load, bag)


@pytest.mark.parametrize(
    "table", ["jumps]\nsize_max_m = 0.1\nmean_interval_s", "loss]\nmean_interval_s", "other_person]\nevery_s"]
)
def test_a_sensor_with_error_rates_above_any_frame_rate_is_refused(table, tmp_path):
    """Each error burst is sampled: one every 3.5 ns took minutes for a walk of 5 s."""
    path = tmp_path / "sensor.toml"
    path.write_text(f'name = "s"\nsource = "s"\nrate_hz = 30.0\nlatency_s = 0.1\n[{table} = 3.5e-9\n')
    assert "0.001" in refused(load_sensor, path)
