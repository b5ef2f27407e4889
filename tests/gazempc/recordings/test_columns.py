"""Column mappings: units, axes, orders, times and people, on tables of a known walk; proposed mappings."""

import numpy as np
import pytest
from builders import exports
from builders.exports import Walk, in_axes, quat_in_axes, same_turns
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError, SettingsError
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions
from gazempc.run import main

T = Walk.times_s


def write(path, header, *columns, separator=",", comma=False):
    """A table; each column has numbers, shape (N,) or (N, C), or text."""
    flat = [c for column in columns for c in (np.asarray(column).T if np.ndim(column) > 1 else [column])]
    rows = [[cell if isinstance(cell, str) else repr(float(cell)) for cell in row] for row in zip(*flat, strict=True)]
    if comma:
        rows = [[cell.replace(".", ",") for cell in row] for row in rows]
    lines = ([header] if header else []) + rows
    path.write_text("".join(separator.join(line) + "\n" for line in lines), encoding="utf-8")
    return path


def read(path, columns, **options):
    return load(path, ReadOptions(columns=columns, **options))


def same_head(recording, head_m=Walk.head_m, atol=1e-9):
    np.testing.assert_allclose(recording.truth.head_position_m, head_m, atol=atol)


def same_turn(recording):
    same_turns(recording.truth.head_quat_wxyz, Walk.head, 1e-5)


@pytest.mark.parametrize(("unit", "size_m"), [("cm", 0.01), ("mm", 0.001), ("in", 0.0254), ("ft", 0.3048)])
def test_length_units_are_converted(tmp_path, unit, size_m):
    path = write(tmp_path / "a.csv", ["when", "p.x", "p.y", "p.z"], T, Walk.head_m / size_m)
    same_head(read(path, f"t=when, head=p:{unit}"))
    named = write(tmp_path / "b.csv", ["when", f"X ({unit})", f"y_{unit}", f"z [{unit}]"], T, Walk.head_m / size_m)
    same_head(read(named, "t=when, head=[X,y,z]"))


@pytest.mark.parametrize(
    "columns", ["head=head", "head=HEAD", "head=[head_x, head_y, head_z]", "head=[#2,#3,#4]", "head=(head_x,head_y,#4)"]
)
def test_columns_are_named_by_prefix_list_or_index(tmp_path, columns):
    same_head(read(write(tmp_path / "a.csv", ["s", "Head_X", "Head_Y", "Head_Z"], T, Walk.head_m), f"t=s, {columns}"))


def test_positions_are_means_of_points_and_names_may_have_signs(tmp_path):
    offset = np.array([0.05, 0.07, 0.0])
    header = ["s", *(f"left-ear.{c}" for c in "xyz"), *(f"right ear {c}" for c in "xyz")]
    path = write(tmp_path / "a.csv", header, T, Walk.head_m + offset, Walk.head_m - offset)
    same_head(read(path, "t=s, head=left-ear", mapping=None), Walk.head_m + offset)
    header = [name.replace("-", "_") for name in header]
    plus = write(tmp_path / "b.csv", header, T, Walk.head_m + offset, Walk.head_m - offset)
    same_head(read(plus, "t=s, head=left_ear+right ear"))


@pytest.mark.parametrize("axes", ["y-up", "optical"])
def test_axes_of_positions_and_quaternions_are_converted(tmp_path, axes):
    quats = quat_in_axes(axes, Walk.head)
    header = ["s", "x", "y", "z", "qw", "qx", "qy", "qz", "px", "py", "pz"]
    path = write(tmp_path / "a.csv", header, T, in_axes(axes, Walk.head_m), quats, in_axes(axes, Walk.pelvis_m))
    recording = read(path, f"t=s, head=[x,y,z], head_q=[qw,qx,qy,qz]:wxyz, pelvis=p, axes={axes}")
    same_head(recording)
    same_turn(recording)
    np.testing.assert_allclose(recording.truth.pelvis_position_m, Walk.pelvis_m, atol=1e-9)


def test_left_handed_axes_of_unity_are_converted(tmp_path):
    """Unity: x right, y up, z forward; a left turn is negative about y."""
    x, y, z = Walk.head_m.T
    half = -0.5 * (Walk.travel_rad + 0.3)
    header = ["s", "x", "y", "z", "qx", "qy", "qz", "qw"]
    path = write(tmp_path / "a.csv", header, T, -y, z, x, 0 * T, np.sin(half), 0 * T, np.cos(half))
    recording = read(path, "t=s, head=[x,y,z], head_q=q, axes=unity")
    same_head(recording)
    same_turn(recording)


def test_axes_may_be_a_list_and_differ_for_the_head(tmp_path):
    """A frame with z up, and a camera on the head: z forward, x right, y down."""
    from_optical = Rotation.from_matrix(exports.FILE_FROM_OURS["optical"].T)
    quats = (Walk.head * from_optical).as_quat()
    header = ["s", "n", "w", "u", "a", "b", "c", "d"]
    path = write(tmp_path / "a.csv", header, T, Walk.head_m, quats)
    recording = read(path, "t=s, head=[n,w,u], head_q=[a,b,c,d]:xyzw, head_axes=[z,-x,-y]")
    same_turn(recording)


TILTED = Rotation.from_euler("z", Walk.travel_rad[:, None]) * Rotation.from_euler("yx", [0.2, -0.1])


@pytest.mark.parametrize(("way", "unit"), [("xyz", "deg"), ("ZYX", "rad"), ("zxy", "rad"), ("rotvec", "deg")])
def test_angles_are_converted(tmp_path, way, unit):
    angles = TILTED.as_rotvec() if way == "rotvec" else TILTED.as_euler(way)
    values = np.degrees(angles) if unit == "deg" else angles
    path = write(tmp_path / "a.csv", ["s", "x", "y", "z", "a", "b", "c"], T, Walk.head_m, values)
    found = read(path, f"t=s, head=[x,y,z], head_euler=[a,b,c]:{way}:{unit}").truth.head_quat_wxyz
    same_turns(found, TILTED, 1e-5)


def test_roll_pitch_yaw_and_yaw_only_are_converted(tmp_path):
    """Roll, pitch and yaw about fixed axes in this order, as in ROS."""
    rpy = TILTED.as_euler("xyz")
    path = write(tmp_path / "a.csv", ["s", "x", "y", "z", "head_roll", "head_pitch", "head_yaw"], T, Walk.head_m, rpy)
    found = read(path, "t=s, head=[x,y,z], head_euler=head:rad").truth.head_quat_wxyz
    same_turns(found, TILTED, 1e-5)
    yaw = np.degrees(Walk.travel_rad + 0.3)
    path = write(tmp_path / "b.csv", ["s", "x", "y", "z", "yaw_deg"], T, Walk.head_m, yaw)
    same_turn(read(path, "t=s, head=[x,y,z], head_yaw=yaw"))


@pytest.mark.parametrize(
    "columns", ["head_forward=nose-ears", "head_left=l-r", "head_forward=nose-ears, head_left=l-r"]
)
def test_orientations_are_computed_from_points(tmp_path, columns):
    points = {"nose": [0.1, 0, 0], "ears": [0, 0, 0], "l": [0, 0.07, 0], "r": [0, -0.07, 0]}
    header = ["s", *(f"{name}_{c}" for name in points for c in "xyz")]
    path = write(tmp_path / "a.csv", header, T, *(Walk.point_m("head", offset) for offset in points.values()))
    same_turn(read(path, f"t=s, head=ears, {columns}"))


START_S = 1_714_557_600.0
TIMES = {
    "t=when:ns": 1e9 * (START_S + T),
    "t=when:min": T / 60.0,
    "t=when:30hz": np.arange(float(T.size)) * 2 + 7,
    "t=:30hz": 0 * T,
    "t=when:date": [f"2024-05-01T10:00:{s:09.6f}" for s in T],
    "t=when:date ": [f"2024-05-01 12:00:{s:09.6f}+02:00" for s in T],
    "t = when:date": [f"10:00:{s:09.6f}" for s in T],
}


@pytest.mark.parametrize("columns", TIMES)
def test_time_formats_are_converted(tmp_path, columns):
    path = write(tmp_path / "a.csv", ["when", "x", "y", "z"], TIMES[columns], Walk.head_m)
    recording = read(path, f"{columns}, head=[x,y,z]")
    np.testing.assert_allclose(recording.times_s - recording.times_s[0], T, atol=1e-6)
    if "2024" in str(TIMES[columns]):
        assert recording.times_s[0] == pytest.approx(START_S, abs=1e-6)


@pytest.mark.parametrize(
    ("separator", "comma", "ending"),
    [(";", False, ".csv"), (";", True, ".txt"), ("\t", True, ".tsv"), ("  ", False, ".txt")],
)
def test_separators_and_decimal_commas_are_detected(tmp_path, separator, comma, ending):
    header = ["t", "head_x", "head_y", "head_z"]
    path = write(tmp_path / f"a{ending}", header, T, Walk.head_m, separator=separator, comma=comma)
    same_head(load(path))


def test_columns_without_header_are_named_by_index(tmp_path):
    path = write(tmp_path / "a.csv", None, T, Walk.head_m, 0 * T)
    same_head(read(path, "t=1, head=[2,3,4]"))
    with pytest.raises(RecordingError, match=r"t, head_x.*'1, 2, 3, 4, 5'.*t=1:s, head=\[2,3,4\]"):
        load(path)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_encodings_of_excel_are_read(tmp_path, encoding):
    path = write(tmp_path / "a.csv", ["t", "head_x", "head_y", "head_z", "Winkel °"], T, Walk.head_m, 0 * T)
    path.write_bytes(path.read_text().encode(encoding))
    same_head(load(path))


def test_header_comments_unit_lines_and_separator_lines_are_read(tmp_path):
    rows = "".join(f"{t:.6f} {x:.9f} {y:.9f} {z:.9f}\n" for t, (x, y, z) in zip(T, 1000 * Walk.head_m, strict=True))
    commented = tmp_path / "a.txt"
    commented.write_text(f"# a walk\n# time px py pz\n{rows}")
    same_head(read(commented, "t=time, head=p:mm"), atol=1e-6)
    second = tmp_path / "b.csv"
    second.write_text("sep=;\ntime;px;py;pz\ns;mm;mm;mm\n" + rows.replace(" ", ";"))
    same_head(read(second, "t=time, head=p"), atol=1e-6)


def test_a_person_is_selected_by_an_id_column(tmp_path):
    ids = ["anna", "bob", "anna"] * 15
    path = write(tmp_path / "a.csv", ["s", "who", "x", "y", "z"], T, ids, Walk.head_m)
    recording = read(path, "t=s, head=[x,y,z], person=who")
    assert recording.times_s.size == 30
    assert "also in the file: bob (15)" in recording.notes[0]
    bob = read(path, "t=s, head=[x,y,z], person=who", person="bob")
    same_head(bob, Walk.head_m[1::3])
    assert bob.name == "a_bob"
    with pytest.raises(SettingsError, match=r"--reading\.person bop: not in .*perhaps you meant 'bob'"):
        read(path, "t=s, head=[x,y,z], person=who", person="bop")


def test_a_note_on_many_people_counts_those_that_it_omits(tmp_path):
    ids = [f"p{k:02d}" for k in range(11) for _ in range(4)] + ["p00"]
    path = write(tmp_path / "a.csv", ["s", "who", "x", "y", "z"], T, ids, Walk.head_m)
    (note,) = (each for each in read(path, "t=s, head=[x,y,z], person=who").notes if "also in the file" in each)
    assert "person p00 of 11 (5 frames, the most)" in note
    assert "p08 (4) and 2 more" in note
    assert "p09" not in note


@pytest.mark.parametrize(
    ("columns", "named"),
    [
        ("head, t=s", "'head' is not key=value"),
        ("t=s, t=s", "duplicate key t"),
        ("t=s, haed=[x,y,z]", "haed: unknown field; perhaps you meant 'head'"),
        ("t=s, head=[x,y,z], origin=moon", "origin: Input should be 'sensor', 'floor' or 'hips'"),
        ("t=s, head=[x,y]", r"mapping of the head: '\[x,y\]'. Expected: 3 columns"),
        ("t=s, head=[x,y,zz]", r"no column 'zz'.*found 's, x, y, z'"),
        ("t=s, head=[x,y,=1.2.3]", r"no column '=1\.2\.3'"),
        ("t=s:1.2.3hz, head=[x,y,z]", r"no column 's:1\.2\.3hz'"),
        ("t=s, head=[x,y,z], head_forward=[x,y,z]", "a difference of points: A-B"),
        ("t=s, head=[x,y,z], head_q=[x,y,z,s]", r"\[...\]:wxyz or :xyzw"),
        ("t=s, head=[x,y,z], head_euler=[x,y,z]:xyz", "angles without a unit"),
        ("t=s, head=[x,y,z], axes=sideways", "z-up, y-up, optical, unity"),
    ],
)
def test_invalid_mappings_are_refused(tmp_path, columns, named):
    path = write(tmp_path / "a.csv", ["s", "x", "y", "z"], T, Walk.head_m)
    with pytest.raises((SettingsError, RecordingError), match=named):
        read(path, columns)


def test_a_mapping_beside_the_file_is_found_and_one_for_the_folder(tmp_path):
    path = write(tmp_path / "a.csv", ["s", "x", "y", "z"], T, 1000 * Walk.head_m)
    other = write(tmp_path / "b.csv", ["s", "x", "y", "z"], T, 1000 * Walk.head_m)
    given = tmp_path / "mine.toml"
    given.write_text('t = "s"\nhead = "[x,y,z]:mm"\n')
    same_head(load(path, ReadOptions(mapping=given)))
    (tmp_path / "a.csv.columns.toml").write_text(given.read_text())
    same_head(load(path))
    with pytest.raises(RecordingError, match="missing column"):
        load(other)
    (tmp_path / "columns.toml").write_text(given.read_text())
    same_head(load(other))
    given.write_text("t = 5\n")
    with pytest.raises(SettingsError, match=r"mine\.toml: t: "):
        load(path, ReadOptions(mapping=given))


def test_the_mapping_of_a_run_is_saved_and_found_again(tmp_path, capsys):
    path = write(tmp_path / "a.csv", ["s", "px", "py", "pz"], T, 1000 * Walk.head_m)
    words = ["--replay", str(path), "--controllers", "reactive", "--noise-seeds", "1", "--no-figures"]
    words += ["--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert '--reading.columns "t=s:s, head=[px,py,pz]:mm"' in capsys.readouterr().err
    assert main([*words, "--guess"]) == 0
    assert f"columns saved in {path}.columns.toml" in capsys.readouterr().out
    same_head(load(path))


# ---------------------------------------------------------------- proposals


TABLES = {
    "an index first": (["", "timestamp", "head_x", "head_y", "head_z"], T, T, Walk.head_m),
    "nanoseconds since 1970, mm, a quaternion": (
        ["stamp_ns", *(f"pose.position.{c}" for c in "xyz"), *(f"pose.orientation.{c}" for c in "xyzw")],
        1e9 * (1.7e9 + T), 1000 * Walk.head_m, Walk.head.as_quat(),
    ),
    "milliseconds, cm": (["stamp", "x", "y", "z"], 1000 * T, 100 * Walk.head_m),
    "units in brackets": (["Time (s)", "Head X [mm]", "Head Y [mm]", "Head Z [mm]"], T, 1000 * Walk.head_m),
    "PlotJuggler": (["__time", *(f"/face/pose/position/{c}" for c in "xyz")], 1.7e9 + T, Walk.head_m),
    "a robot beside the head": (
        ["time", *(f"{k}_{c}" for k in ("robot", "head") for c in "xyz")], T, 0 * Walk.head_m, Walk.head_m
    ),
    "commas in names": (["time, s", "head, x", "head, y", "head, z"], T, Walk.head_m),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_a_proposed_mapping_is_valid(tmp_path, name):
    header, *columns = TABLES[name]
    path = write(tmp_path / "a.csv", [f'"{cell}"' if "," in cell else cell for cell in header], *columns)
    with pytest.raises(RecordingError, match=r"a guess: --reading\.columns ") as caught:
        load(path)
    pasted = str(caught.value).partition('--reading.columns "')[2].partition('"')[0]
    for options in (ReadOptions(guess=True), ReadOptions(columns=pasted)):
        found = load(path, options)
        same_head(found, Walk.head_m)
        np.testing.assert_allclose(found.times_s - found.times_s[0], T, atol=1e-6)


def test_undetermined_parts_are_reported(tmp_path):
    path = write(tmp_path / "a.csv", ["frame", "id", "x", "y"], np.arange(float(T.size)), 0 * T + 3, Walk.head_m[:, :2])
    with pytest.raises(RecordingError, match=r"30 frames per second is a guess; the file has no height: 1\.6 m"):
        load(path)
    same_head(load(path, ReadOptions(guess=True)), np.column_stack([Walk.head_m[:, :2], 0 * T + 1.6]))


def test_a_negative_frame_rate_in_a_file_is_unknown(tmp_path):
    rows = "".join(f"{k},0,{x:.6f},{y:.6f},{z:.6f}\n" for k, (x, y, z) in enumerate(Walk.head_m))
    path = tmp_path / "a.csv"
    path.write_text(f"Trajectories\n-30\n,,Anna:Nose,,\nFrame,Sub Frame,X,Y,Z\n,,m,m,m\n{rows}")
    with pytest.raises(RecordingError, match=r"t=Frame:30hz.*30 frames per second is a guess"):
        load(path)


@pytest.mark.parametrize(
    "header",
    [["t", "a", "b", "c"], ["k", "x", "y", "z"], ["t", *(f"head{k}_{c}" for k in (1, 2) for c in "xyz")]],
)
def test_a_file_without_recognisable_columns_gets_no_proposal(tmp_path, header):
    heads = [Walk.head_m] * (len(header) // 3)
    with pytest.raises(RecordingError, match="no columns match a time and one head"):
        load(write(tmp_path / "a.csv", header, T, *heads), ReadOptions(guess=True))
