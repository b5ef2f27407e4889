"""Sound files of every kind that gazempc reads, small ones, and the ways in which tests damage them."""

import io
import json
import random
import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml
from scipy.spatial.transform import Rotation

from builders import bags, exports, skeletons
from builders.recordings import synthetic
from builders.replays import replayed
from experiments.engine.engine import Cache, read_result
from experiments.sweep.plan import load_plan
from gazempc.identify.record import NeckRecord, load_record
from gazempc.identify.tracker.read import of_lines
from gazempc.live.sources.camera.intrinsics import _values
from gazempc.neck.spec import load_neck
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.tables.mapping import read_mapping
from gazempc.results.log_files import load_log
from gazempc.results.mcap import write_mcap
from gazempc.results.table import measured_again
from gazempc.run_settings import load_settings
from gazempc.sim.sensor import load_sensor

# What files are damaged with: numbers, marks and bytes on which programs trip.
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
    ways = (_flip, _cut, _digit, _digit, _digit, _number, _number, _token, _swap, _repeat, _drop, _zeros)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        data = rng.choice(ways)(data, rng)
    return data


def _array(data, rng):
    """Another kind, shape or value of an array of a sound archive, whose check sums then hold."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = dict(archive)
    name = rng.choice(sorted(arrays))
    array = arrays[name]
    change = rng.randrange(8)
    if array.dtype.kind == "U" and not array.ndim:
        arrays[name] = np.array(damaged(str(array).encode(), rng).decode(errors="replace"))
    elif change == 0:
        del arrays[name]
    elif change == 1 and array.dtype.kind != "U":
        arrays[name] = array.astype(rng.choice(("U8", "f4", "c16", "?")))
    elif change == 2:
        arrays[name] = array[..., None]
    elif change == 3:
        arrays[name] = array[: rng.randrange(array.shape[0] + 1)] if array.ndim else np.zeros(3)
    elif change == 4:
        arrays[name] = array.ravel()
    elif array.size and array.dtype.kind == "f":
        array.flat[rng.randrange(array.size)] = rng.choice((np.nan, np.inf, 1e300, -1e6, 0.0, 1e6, 1e-320))
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
    """One digit of a number is another one: what is left is mostly sound."""
    found = [at for at in range(0, len(data), max(1, len(data) // 2000)) if data[at : at + 1].isdigit()]
    if not found:
        return _flip(data, rng)
    at = rng.choice(found)
    return data[:at] + b"%d" % rng.randrange(10) + data[at + 1 :]


def _token(data, rng):
    at = _place(data, rng)
    return data[:at] + rng.choice(_TOKENS) + data[at:]


def _swap(data, rng):
    a, b, c = sorted(_place(data, rng) for _ in range(3))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def _repeat(data, rng):
    a, b = sorted(_place(data, rng) for _ in range(2))
    return data[:b] + data[a:b] * rng.choice((1, 2)) + data[b:]


def _drop(data, rng):
    a, b = sorted(_place(data, rng) for _ in range(2))
    return data[:a] + data[b:]


def _zeros(data, rng):
    at, count = _place(data, rng), rng.choice((1, 8, 64))
    return data[:at] + bytes(count) + data[at + count :]


def _measured(path):
    return measured_again(load_log(path))


# Kinds that take ten times as long as the others to read.
COSTLY = ("echo", "openpose", "sqlite3", "mcap", "metadata", "sweep")


def sound_files(folder):
    """Files by name, each with the file that is to be damaged and what reads it.

    Args:
        folder: Where to write them; each kind gets a folder.

    Returns:
        For each name: the file to damage, and a call that reads it, to be made anew after each damage.
    """
    made = {}

    def make(name, file, read, what=None):
        made[name] = file, lambda: read(what or file)

    def sub(name):
        (folder / name).mkdir()
        return folder / name

    def own(path):
        columns = {"t": exports.Walk.times_s}
        for part in ("head", "pelvis"):
            columns |= {f"{part}_{c}": v for c, v in zip("xyz", getattr(exports.Walk, f"{part}_m").T, strict=True)}
            columns |= {f"{part}_q{c}": v for c, v in zip("wxyz", exports.Walk.quat_wxyz(part).T, strict=True)}
        return columns

    columns = own(None)
    lines = [",".join(columns), *(",".join(f"{v:.5f}" for v in row) for row in zip(*columns.values(), strict=True))]
    text = "\n".join(lines) + "\n"
    table = sub("table") / "anna_1.csv"
    table.write_text(text)
    make("table", table, load)
    index = sub("index") / "index.csv"
    index.write_text("clip,subject,group,kind,source_description\nanna_1,anna,turn,walking,made by hand\n")
    (index.parent / "anna_1.csv").write_text(text)
    make("index", index, load, index.parent / "anna_1.csv")
    mapping = sub("mapping") / "columns.toml"
    mapping.write_text('t = "t:s"\nhead = "head:m"\nhead_q = "head_q"\n')
    (mapping.parent / "anna_1.csv").write_text(text)
    make("mapping", mapping, load, mapping.parent / "anna_1.csv")
    parquet = sub("parquet") / "anna_1.parquet"
    pq.write_table(pa.table(columns | {"note": ["walks"] * len(columns["t"])}), parquet)
    make("parquet", parquet, load)
    make("motive", exports.motive(sub("motive") / "a.csv"), load)
    make("vicon", exports.vicon_markers(sub("vicon") / "a.csv"), load)
    make("echo", exports.ros2_echo(sub("echo") / "a.csv"), load)
    make("mvnx", exports.mvnx(sub("mvnx") / "a.mvnx"), load)
    openpose = exports.openpose(sub("openpose") / "walk")
    options = ReadOptions(columns="t=frame:30hz")
    make("openpose", sorted(openpose.iterdir())[5], lambda path: load(path, options), openpose)
    kinect = sub("kinect") / "a.json"
    kinect.write_text(json.dumps(_kinect()))
    make("kinect", kinect, load)
    tree = skeletons.body("Hips", ["Spine", "Neck"], "Head", (["LeftUpLeg", "LeftLeg", "LeftFoot"], ["RightUpLeg", "RightLeg", "RightFoot"]), (["LeftArm"], ["RightArm"]))  # noqa: E501  # fmt: skip
    make("bvh", skeletons.write_bvh(sub("bvh") / "a.bvh", tree), load)
    times_s = np.arange(40) / 20.0
    faces = bags.face_rows("face_a", times_s, np.column_stack([0.2 * times_s, 0.0 * times_s, 2.0 + 0.1 * times_s]))
    for storage, ending in (("sqlite3", "db3"), ("mcap", "mcap")):
        bag = bags.write_bag(sub(storage) / "bag", faces, storage)
        make(storage, next(bag.glob(f"*.{ending}")), load, bag)
    bag = bags.write_bag(sub("metadata") / "bag", faces)
    make("metadata", bag / "metadata.yaml", load, bag)
    json_lines = sub("lines") / "a.jsonl"
    rows = ({"capture_time_s": t, "head_position_m": [2.0, 0.1 * t, 0.3], "person_id": "a"} for t in times_s)
    json_lines.write_text("".join(json.dumps(row) + "\n" for row in rows))
    make("lines", json_lines, of_lines)

    log = replayed(synthetic("subject03_R4"), "reactive")
    log.save(sub("log") / "reactive.npz")
    make("log", folder / "log" / "reactive.npz", _measured)
    log.save(sub("from_log") / "reactive.npz")
    make("from_log", folder / "from_log" / "reactive.npz", load_record)
    write_mcap(log, sub("mcap_log") / "reactive.mcap")
    make("mcap_log", folder / "mcap_log" / "reactive.mcap", _measured)
    t = np.arange(200) / 100.0
    angles = np.column_stack([np.sin(t), np.cos(t)])
    about = json.dumps({"from": "robot", "neck": load_neck("reference").model_dump()})
    NeckRecord(about, t, angles, t, angles).save(sub("record") / "record.npz")
    make("record", folder / "record" / "record.npz", load_record)

    neck = sub("neck") / "neck.toml"
    neck.write_text(_shipped("neck", "reference"))
    make("neck", neck, load_neck)
    sensor = sub("sensor") / "sensor.toml"
    sensor.write_text(_shipped("sim/sensors", "street"))
    make("sensor", sensor, load_sensor)
    columns_file = sub("columns") / "columns.toml"
    columns_file.write_text(mapping.read_text())
    make("columns", columns_file, read_mapping)
    settings = sub("settings") / "settings.yaml"
    settings.write_text(
        "replay: subject03_R4\ncontrollers: [mpc, reactive]\nseed: 3\nmpc: {horizon_s: 0.6}\nneck: slow\n"
    )
    make("settings", settings, load_settings)
    sweep = sub("sweep") / "sweep.yaml"
    content = {"name": "s", "recordings": ["subject01_R1"], "base": {"controller": "mpc"}, "vary": {"seed": [1, 2]}}
    sweep.write_text(yaml.safe_dump(content))
    make("sweep", sweep, load_plan)
    camera = sub("camera") / "camera.yaml"
    camera.write_text(
        "image_width: 640\ncamera_matrix:\n  rows: 3\n  data: [500., 0., 320., 0., 500., 240., 0., 0., 1.]\n"
    )
    make("camera", camera, _values)
    cache = Cache(sub("arrays"))
    cache.keep("arrays", {"left_out": None, "failed": None, "error_m": np.arange(20.0)})
    make("arrays", folder / "arrays" / "arrays.npz", read_result)
    return made


def _shipped(folder, name):
    from importlib.resources import files

    return files("gazempc").joinpath(folder, f"{name}.toml").read_text(encoding="utf-8")


def _kinect():
    """One body that walks towards the camera, as `offline_processor` writes it."""
    names = ["PELVIS", "HEAD", "NOSE", "EAR_LEFT", "EAR_RIGHT"]
    # Up, facing, left of a person who faces the camera, in its axes: x right, y down, z forward.
    axes = np.column_stack([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    x, y, z, w = Rotation.from_matrix(axes).as_quat()
    offsets = {"PELVIS": (0, 200, 0), "HEAD": (0, -400, 0), "NOSE": (0, -420, -120), "EAR_LEFT": (80, -400, 0), "EAR_RIGHT": (-80, -400, 0)}  # noqa: E501  # fmt: skip
    frames = []
    for k in range(30):
        joints = [[float(a + b) for a, b in zip(offsets[n], (0, 0, 3000 - 30 * k), strict=True)] for n in names]
        body = {"body_id": 1, "joint_positions": joints, "joint_orientations": [[w, x, y, z]] * len(names)}
        frames.append({"timestamp_usec": 33_333 * k, "frame_id": k, "num_bodies": 1, "bodies": [body]})
    return {"joint_names": names, "frames": frames}


def rng_of(seed):
    """Random numbers that are the same on every machine."""
    return random.Random(seed)
