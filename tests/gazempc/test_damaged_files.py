"""Damaged files of every kind: each is read, or refused by name within bounds of time and text."""

import io
import json
import random
import re
import time
from collections import Counter
from importlib.resources import files

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from builders import bags, exports, skeletons
from builders.recordings import synthetic
from builders.replays import replayed

from experiments.engine.engine import Cache, read_result
from experiments.sweep.plan import load_plan
from gazempc.errors import GazempcError
from gazempc.identify.record import NeckRecord, load_record
from gazempc.identify.tracker.read import of_lines
from gazempc.live.sources.camera.intrinsics import _values
from gazempc.neck.spec import load_neck
from gazempc.recordings.load import load
from gazempc.recordings.readers.checks import MOST_DURATION_S, MOST_EXTENT_M
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording
from gazempc.results.log_files import load_log, write_mcap
from gazempc.results.table import measured_again
from gazempc.run_settings import load_settings
from gazempc.sim.sensor import load_sensor

INPUTS = 300
# Timeout of a refusal, more than ten times the usual time of these small files.
MOST_S = 2.0
MOST_CHARACTERS = 3000
# Kinds that take ten times as long as the others to read.
COSTLY = ("echo", "openpose", "sqlite3", "mcap", "metadata", "sweep")
# Inserted tokens: numbers, marks and bytes that often break parsers.
_TOKENS = (
    b"nan", b"inf", b"-inf", b"1e6", b"1e300", b"-1", b"0", b"", b"null", b"true", b"9" * 5000, b"0x" + b"f" * 5000,
    b"1e999999999", b"[" * 3000, b"{" * 3000, b"\x00", b"\xff\xfe", b'"', b"'", b"\\ud800", b"\xed\xa0\x80", b"&a",
    b"*a", b"!!python/object:os.system", b"1e-320", b"18446744073709551616", b"\n\n", b",,,,", b";", b"\t", b"-0",
    b"2024-13-45T99:99:99", b"../../x", b"=" * 100,
)  # fmt: skip
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def damaged(data, rng):
    """The bytes of a file with one to three damages of random kinds."""
    if data.startswith(b"PK") and rng.random() < 0.7:
        return _array(data, rng)
    ways = (_flip, _cut, _digit, _digit, _digit, _number, _number, _token, _drop)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        data = rng.choice(ways)(data, rng)
    return data


def _array(data, rng):
    """Change type, shape or value of an array in a valid archive, with correct checksums."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = dict(archive)
    name = rng.choice(sorted(arrays))
    array = arrays[name]
    if array.dtype.kind == "U" and not array.ndim:
        arrays[name] = np.array(damaged(str(array).encode(), rng).decode(errors="replace"))
    elif array.size and array.dtype.kind == "f" and rng.random() < 0.5:
        array.flat[rng.randrange(array.size)] = rng.choice((np.nan, np.inf, 1e300, -1e6, 0.0, 1e6, 1e-320))
    else:
        others = (array.astype("U8"), array[..., None], array[: len(array) // 2] if array.ndim else np.zeros(3))
        arrays[name] = rng.choice((*others, array.ravel(), np.zeros(0)))
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def _place(data, rng):
    return rng.randrange(len(data) + 1)


def _flip(data, rng):
    at = rng.randrange(max(len(data), 1))
    return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]


def _cut(data, rng):
    return data[: _place(data, rng)]


def _number(data, rng):
    found = list(_NUMBER.finditer(data[:20000]))
    if not found:
        return _flip(data, rng)
    number = rng.choice(found)
    return data[: number.start()] + rng.choice(_TOKENS) + data[number.end() :]


def _digit(data, rng):
    """Change one digit of a number; the rest stays valid."""
    found = [at for at in range(0, len(data), max(1, len(data) // 2000)) if data[at : at + 1].isdigit()]
    if not found:
        return _flip(data, rng)
    at = rng.choice(found)
    return data[:at] + b"%d" % rng.randrange(10) + data[at + 1 :]


def _token(data, rng):
    at = _place(data, rng)
    return data[:at] + rng.choice(_TOKENS) + data[at:]


def _drop(data, rng):
    a, b = sorted(_place(data, rng) for _ in range(2))
    return data[:a] + data[b:]


def measured(path):
    return measured_again(load_log(path))


def shipped(folder, name):
    return files("gazempc").joinpath(folder, f"{name}.toml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """For each kind, the file to damage and a call that reads it."""
    folder, made = tmp_path_factory.mktemp("sound"), {}

    def sub(name):
        (folder / name).mkdir()
        return folder / name

    def add(name, file, read, what=None):
        made[name] = file, lambda: read(what or file)

    def text(name, file_name, content, read, beside=None):
        """A text file; with `beside`, the text of a table that is read with it."""
        file, table = sub(name) / file_name, None
        file.write_text(content)
        if beside is not None:
            table = file.parent / "anna_1.csv"
            table.write_text(beside)
        add(name, file, read, table)

    columns = {"t": exports.Walk.times_s}
    for part in ("head", "pelvis"):
        columns |= {f"{part}_{c}": v for c, v in zip("xyz", getattr(exports.Walk, f"{part}_m").T, strict=True)}
        columns |= {f"{part}_q{c}": v for c, v in zip("wxyz", exports.Walk.quat_wxyz(part).T, strict=True)}
    values = [",".join(f"{v:.5f}" for v in row) for row in zip(*columns.values(), strict=True)]
    table = "\n".join([",".join(columns), *values, ""])
    times_s = np.arange(40) / 20.0
    rows = ({"capture_time_s": t, "head_position_m": [2.0, 0.1 * t, 0.3], "person_id": "a"} for t in times_s)
    text("table", "anna_1.csv", table, load)
    index = "clip,subject,group,kind,source_description\nanna_1,anna,turn,walking,made by hand\n"
    text("index", "index.csv", index, load, table)
    text("mapping", "columns.toml", 't = "t:s"\nhead = "head:m"\nhead_q = "head_q"\n', load, table)
    text("kinect", "a.json", json.dumps(exports.kinect()), load)
    text("lines", "a.jsonl", "".join(json.dumps(row) + "\n" for row in rows), of_lines)
    text("neck", "neck.toml", shipped("neck", "reference"), load_neck)
    text("sensor", "sensor.toml", shipped("sim/sensors", "street"), load_sensor)
    settings = "replay: subject03_R4\ncontrollers: [mpc, reactive]\nseed: 3\nmpc: {horizon_s: 0.6}\nneck: slow\n"
    text("settings", "settings.yaml", settings, load_settings)
    plan = "name: s\nrecordings: [subject01_R1]\nbase: {controller: mpc}\nvary: {seed: [1, 2]}\n"
    text("sweep", "sweep.yaml", plan, load_plan)
    camera = "image_width: 640\ncamera_matrix:\n  rows: 3\n  data: [500., 0., 320., 0., 500., 240., 0., 0., 1.]\n"
    text("camera", "camera.yaml", camera, _values)

    parquet = sub("parquet") / "anna_1.parquet"
    pq.write_table(pa.table(columns | {"note": ["walks"] * len(columns["t"])}), parquet)
    add("parquet", parquet, load)
    add("motive", exports.motive(sub("motive") / "a.csv"), load)
    add("vicon", exports.vicon_markers(sub("vicon") / "a.csv"), load)
    add("echo", exports.ros2_echo(sub("echo") / "a.csv"), load)
    add("mvnx", exports.mvnx(sub("mvnx") / "a.mvnx"), load)
    openpose = exports.openpose(sub("openpose") / "walk")
    options = ReadOptions(columns="t=frame:30hz")
    add("openpose", sorted(openpose.iterdir())[5], lambda path: load(path, options), openpose)
    tree = skeletons.body("Hips", ["Spine", "Neck"], "Head", skeletons.BY_WORD, "UpLeg Leg Foot", "Arm")
    add("bvh", skeletons.write_bvh(sub("bvh") / "a.bvh", tree), load)
    faces = bags.face_rows("face_a", times_s, np.column_stack([0.2 * times_s, 0.0 * times_s, 2.0 + 0.1 * times_s]))
    for storage, ending in (("sqlite3", "db3"), ("mcap", "mcap")):
        bag = bags.write_bag(sub(storage) / "bag", faces, storage)
        add(storage, next(bag.glob(f"*.{ending}")), load, bag)
    add("metadata", bag / "metadata.yaml", load, bag)

    log, of_log = replayed(synthetic("subject03_R1"), "reactive"), sub("log")
    log.save(of_log / "reactive.npz")
    write_mcap(log, of_log / "reactive.mcap")
    add("log", of_log / "reactive.npz", measured)
    add("from_log", of_log / "reactive.npz", load_record)
    add("mcap_log", of_log / "reactive.mcap", measured)
    t = np.arange(200) / 100.0
    angles = np.column_stack([np.sin(t), np.cos(t)])
    about = json.dumps({"from": "robot", "neck": load_neck("reference").model_dump()})
    NeckRecord(about, t, angles, t, angles).save(sub("record") / "record.npz")
    add("record", folder / "record" / "record.npz", load_record)
    Cache(sub("arrays")).keep("arrays", {"left_out": None, "failed": None, "error_m": np.arange(20.0)})
    add("arrays", folder / "arrays" / "arrays.npz", read_result)
    return made


@pytest.mark.slow
def test_the_undamaged_files_are_read(sound):
    for _, read in sound.values():
        read()


@pytest.mark.slow
def test_damaged_files_are_read_or_refused_by_name(sound):
    rng, became, slow = random.Random(20), Counter(), []
    names = [*5 * [name for name in sound if name not in COSTLY], *COSTLY]
    # For a recording in a folder the message names the folder.
    folders = {name: str(path.parent) for name, (path, _) in sound.items()}
    for k in range(INPUTS):
        name = names[k % len(names)]
        path, read = sound[name]
        content = path.read_bytes()
        replace(path, damaged(content, rng))
        started_s = time.process_time()
        try:
            became[outcome(read, folders[name])] += 1
        except Exception as error:
            error.add_note(f"{name}, input {k}")
            raise
        finally:
            replace(path, content)
        if time.process_time() - started_s > MOST_S:
            slow.append((name, k))
    assert slow == []
    assert became["refused"] > 0.3 * INPUTS
    assert became["accepted"] > 0.1 * INPUTS


def replace(path, content):
    """Replace a file by a new one of the same name: overwriting blocks on some file systems."""
    path.unlink()
    path.write_bytes(content)


def outcome(read, folder):
    """Outcome of reading a file; a refusal names it in a few lines, accepted values are plausible."""
    try:
        result = read()
    except GazempcError as error:
        refusal = str(error)
    else:
        if isinstance(result, Recording):
            assert_plausible(result)
        return "accepted"
    assert folder in refusal
    assert len(refusal) < MOST_CHARACTERS
    return "refused"


def assert_plausible(recording):
    seen = recording.truth.valid
    assert np.ptp(recording.times_s[seen]) <= MOST_DURATION_S
    heads_m = recording.truth.head_position_m[seen]
    assert np.isfinite(heads_m).all()
    assert np.linalg.norm(heads_m - np.median(heads_m, axis=0), axis=1).max() <= MOST_EXTENT_M
