"""CSV, Parquet and arrays: round trips; errors with file, place and remedy."""

import csv
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from builders.recordings import assert_refused
from scipy.spatial.transform import Rotation

import gazempc as gz
from gazempc.errors import RecordingError
from gazempc.recordings.load import load, load_together
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.table import remember_columns
from gazempc.recordings.readers.tables.mapping import COLUMNS

N = 60


def walk_values():
    """A person who walks along a line with the head turned by 30 deg, shape (N, 15)."""
    t = np.arange(N) / 30.0
    pelvis = np.column_stack([1.2 * t, 0.02 * np.sin(2 * np.pi * t), np.full(N, 0.95)])
    head = pelvis + np.array([0.0, 0.0, 0.6])
    head_q = Rotation.from_euler("z", np.full((N, 1), 30.0), degrees=True).as_quat()[:, [3, 0, 1, 2]]
    pelvis_q = np.tile([1.0, 0.0, 0.0, 0.0], (N, 1))
    return np.column_stack([t, head, head_q, pelvis, pelvis_q])


def table_rows(values=None):
    """A header and rows of text, for the first columns with values."""
    values = walk_values() if values is None else values
    return [list(COLUMNS[: values.shape[1]]), *[[repr(float(v)) for v in row] for row in values]]


def write_rows(path, rows):
    with path.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows(rows)
    return path


def test_labels_come_from_the_index_beside_the_file(tmp_path):
    write_rows(tmp_path / "walk7.csv", table_rows())
    header = ["clip", "x", "subject", "group", "source_description"]
    write_rows(tmp_path / "index.csv", [header, ["walk7", "", "p3", "sharp", "round a chair"]])
    labels = load(tmp_path / "walk7.csv").labels
    assert (labels.subject, labels.group, labels.description) == ("p3", "sharp", "round a chair")
    labels = load(write_rows(tmp_path / "other_2.csv", table_rows())).labels
    assert (labels.subject, labels.group, labels.description) == ("other", "straight", "")


PARTS = {"head_quat_wxyz": slice(4, 8), "pelvis_position_m": slice(8, 11), "pelvis_quat_wxyz": slice(11, 15)}


@pytest.mark.parametrize(
    ("ending", "given"),
    [("csv", ()), ("csv", tuple(PARTS)), ("parquet", ("pelvis_position_m",)), ("parquet", tuple(PARTS))],
)
def test_tables_are_read_back_and_missing_columns_give_unknown_parts(tmp_path, ending, given):
    values = walk_values()
    kept = [k for k in range(15) if k < 4 or any(k in range(15)[PARTS[name]] for name in given)]
    path = tmp_path / f"anna_1.{ending}"
    if ending == "csv":
        write_rows(path, [[row[k] for k in kept] for row in table_rows(values)])
    else:
        pq.write_table(pa.table({COLUMNS[k]: values[:, k] for k in kept} | {"note": ["x"] * N}), path)
    recording = load(path)
    np.testing.assert_array_equal(recording.times_s, values[:, 0])
    np.testing.assert_array_equal(recording.truth.head_position_m, values[:, 1:4])
    for name, columns in PARTS.items():
        expected = values[:, columns] if name in given else np.full_like(values[:, columns], np.nan)
        np.testing.assert_allclose(getattr(recording.truth, name), expected, atol=1e-15)
    assert (recording.name, recording.labels.subject, recording.labels.group) == ("anna_1", "anna", "straight")
    assert (recording.kind, recording.measured, recording.has_robot) == ("motion capture", None, False)


MILLIMETRES = np.where(np.isin(np.arange(15), [1, 2, 3, 8, 9, 10]), 1e3, 1.0)
Y_FOR_Z = [0, 1, 3, 2, *range(4, 9), 10, 9, *range(11, 15)]


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda values: (values * MILLIMETRES)[:, :4], ["1200 m/s", "looks like millimetres", "slower than 12.5 m/s"]),
        (lambda values: values[:, [0, 3, 2, 1]], ["z does not point up", "2.36 m along z", "metres with z up"]),
        (lambda values: values * MILLIMETRES, ["600 m", "(median)", "millimetres", "factor of 1000", "metres"]),
        (lambda values: values[:, Y_FOR_Z], ["z does not point up", "(0.00, 0.60, 0.00) m", "z up"]),
        (lambda values: values * [1e3, *[1.0] * 14], ["33.33 s", "milliseconds", "factor of 1000", "seconds"]),
    ],
)
def test_other_units_and_another_axis_up_are_refused(tmp_path, change, named):
    """For heads only, and for heads with a pelvis."""
    assert_refused(write_rows(tmp_path / "a.csv", table_rows(change(walk_values()))), *named)


def test_unix_times_at_1000_hz_are_read(tmp_path):
    """The spacing of double-precision numbers at 1.7e9 is 2.4e-7."""
    t = 1_700_000_000.0 + np.arange(2000) / 1000.0
    head_m = np.column_stack([1.2 * (t - t[0]), np.zeros(2000), np.full(2000, 1.7)])
    rows = table_rows(np.column_stack([t, head_m]))
    assert load(write_rows(tmp_path / "fast.csv", rows)).times_s.size == 2000


def _set(row, column, text):
    def change(rows):
        rows[row - 1][COLUMNS.index(column)] = text

    return change


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda rows: [row.pop(4) for row in rows], ["header", "missing column(s) head_qw", "the columns t, head_x"]),
        (lambda rows: [row.append(row[3]) for row in rows], ["more than one column head_z", "once"]),
        (_set(17, "head_y", "left"), ["row 17", "head_y", "'left' is not a number", "a number"]),
        (_set(9, "head_x", "1e300"), ["row 9", "head_x", "1e+300", "finite"]),
        (lambda rows: rows[20].pop(), ["row 21", "14 cells", "15 cells"]),
        (lambda rows: rows.__delitem__(slice(1, None)), ["no rows", "one row per frame"]),
        (lambda rows: rows.__delitem__(slice(4, None)), ["only 3 frame(s)", "at least 4"]),
        (_set(12, "t", repr(9 / 30.0)), ["row 12", "0.3 follows 0.3 in row 11", "larger"]),
        (_set(30, "head_qw", "0.5"), ["row 30", "head_q{w,x,y,z}", "norm is 0.56", "norm of 1"]),
    ],
)
def test_damage_is_reported_with_its_place(tmp_path, change, named):
    rows = table_rows()
    change(rows)
    path = write_rows(tmp_path / "walk.csv", rows)
    assert_refused(path, str(path), *named)


@pytest.mark.parametrize(("column", "cell"), [("t", ""), ("head_x", "NaN"), ("t", "null"), ("head_x", "-inf")])
def test_rows_without_time_or_head_are_dropped_and_counted(tmp_path, column, cell):
    rows = table_rows()
    for line in (9, 30):
        _set(line, column, cell)(rows)
    recording = load(write_rows(tmp_path / "walk.csv", rows))
    np.testing.assert_array_equal(recording.times_s, np.delete(walk_values()[:, 0], [7, 28]))
    assert "2 of 60 rows" in recording.notes[0]


def test_a_part_that_is_unknown_in_a_row_is_nan_there(tmp_path):
    rows = table_rows()
    _set(9, "pelvis_qz", "nan")(rows)
    recording = load(write_rows(tmp_path / "walk.csv", rows))
    unknown = np.isnan(recording.truth.pelvis_quat_wxyz).any(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(unknown), [7])
    assert "orientation is unknown in 1 of 60 rows" in recording.notes[0]


@pytest.mark.parametrize(
    ("data", "named"),
    [
        (b"", "empty"),
        (b"t,head_x\n1,\xff\xfe", "line 2: byte 0xff is not UTF-8"),
        (b"t,head_x\n\n1,\x00", "line 3: a zero byte"),
        (b't,x\n"' + b"x" * 200_000, "field larger"),
    ],
)
def test_files_other_than_text_tables_are_refused(tmp_path, data, named):
    path = tmp_path / "walk.csv"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=named):
        load(path)


@pytest.mark.parametrize("column", ["t", "pelvis_qy"])
def test_parquet_damage_is_reported_with_its_column(tmp_path, column):
    values = walk_values()
    columns = {name: values[:, k] for k, name in enumerate(COLUMNS)}
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table(columns | {column: ["x"] * N}), path)
    with pytest.raises(RecordingError, match=rf"a\.parquet: row 1, column {column}: 'x' is not a number"):
        load(path)
    pq.write_table(pa.table(columns | {column: [None, *values[1:, COLUMNS.index(column)]]}), path)
    assert load(path).times_s.size == N - (column == "t")
    del columns[column]
    pq.write_table(pa.table(columns), path)
    with pytest.raises(RecordingError, match=rf"missing column\(s\) {column};"):
        load(path)


def test_unknown_recordings_are_refused_with_the_accepted_kinds(tmp_path):
    assert load("subject03_R2").name == "subject03_R2"
    cases = {
        "subject03_R9": ["no such", "perhaps you meant 'subject03_R", ".csv, .tsv, .txt, .parquet, .mvnx, .json, .bvh"],
        str(tmp_path): ["neither a ROS 2 bag nor"],
        str(tmp_path / "none.csv"): ["no such file", ".csv, .tsv"],
        "x" * 5000: [""],
    }
    (tmp_path / "a.xlsx").write_bytes(b"x")
    cases[str(tmp_path / "a.xlsx")] = ["unknown file type '.xlsx'", ".csv, .tsv, .txt, .parquet, .mvnx, .json, .bvh"]
    for name, named in cases.items():
        assert_refused(name, *named)


# ---------------------------------------------------------------- arrays


TIMES_S = np.arange(120) / 30.0
HEAD_M = np.stack([0.5 * TIMES_S, 1.0 + 0.0 * TIMES_S, 1.7 + 0.02 * np.sin(11.0 * TIMES_S)], axis=1)


def test_arrays_are_stored_unchanged():
    quats = Rotation.from_euler("z", np.linspace(0.0, 90.0, 120)[:, None], degrees=True).as_quat(scalar_first=True)
    pelvis_m = HEAD_M - [0.1, 0.0, 0.7]
    made = gz.recording_from_arrays(
        "anna_1", TIMES_S.tolist(), HEAD_M.tolist(), in_base_frame=True,
        head_quat_wxyz=quats, pelvis_position_m=pelvis_m, pelvis_quat_wxyz=[0.0, 0.0, 0.0, 1.0],
    )  # fmt: skip
    np.testing.assert_array_equal(made.times_s, TIMES_S)
    np.testing.assert_array_equal(made.truth.head_position_m, HEAD_M)
    np.testing.assert_allclose(made.truth.head_quat_wxyz, quats)
    np.testing.assert_array_equal(made.truth.pelvis_position_m, pelvis_m)
    np.testing.assert_array_equal(made.truth.pelvis_quat_wxyz, np.tile([0, 0, 0, 1], (120, 1)))
    assert (made.name, made.labels.subject, made.has_robot) == ("anna_1", "anna", True)
    assert made.truth.valid.all()
    assert not gz.recording_from_arrays("anna", TIMES_S, HEAD_M).has_robot


def spoilt(array, row, value):
    other = np.array(array)
    other[row] = value
    return other


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"times_s": TIMES_S[:-1]}, "head_position_m: its shape is (120, 3)"),
        ({"times_s": [], "head_position_m": np.zeros((0, 3))}, "times_s: its shape is (0,)"),
        ({"times_s": spoilt(TIMES_S, 7, 0.0)}, "row 7: the time stamp 0.0 follows"),
        ({"times_s": "now"}, "times_s: its values are not numbers"),
        ({"head_position_m": spoilt(HEAD_M, 5, np.nan)}, "row 5"),
        ({"head_position_m": 1e3 * HEAD_M}, "looks like millimetres"),
        ({"head_quat_wxyz": [1.0, 1.0, 0.0, 0.0]}, "head_quat_wxyz: not a unit quaternion"),
    ],
)
def test_invalid_arrays_are_reported(arguments, named):
    with pytest.raises(RecordingError) as raised:
        gz.recording_from_arrays(**{"name": "mine", "times_s": TIMES_S, "head_position_m": HEAD_M, **arguments})
    assert str(raised.value).startswith("mine: ")
    assert named in str(raised.value)


def table_of(path, start_s):
    times_s = np.arange(40) / 30.0
    rows = np.transpose([start_s + times_s, np.full(40, 2.0), 1.2 * times_s - 1.0, np.full(40, 0.3)])
    np.savetxt(path, rows, "%.6f", ",", header="t,head_x,head_y,head_z", comments="")
    return path


def test_people_in_files_with_different_clocks_begin_together(tmp_path):
    files = [table_of(tmp_path / name, start_s) for name, start_s in (("a.csv", 0.0), ("b.csv", 1.7e9))]
    for words in (tmp_path, f"{files[0]}+{files[1]}"):
        found = load_together(words)
        assert [each.times_s[0] for each in found] == [0.0, 0.0]
        assert [each.times_s[-1] for each in found] == pytest.approx([1.3, 1.3], abs=1e-5)


def test_chosen_columns_are_saved_for_one_table_only(tmp_path):
    (tmp_path / "two").mkdir()
    file = table_of(tmp_path / "two" / "a.csv", 0.0)
    options = ReadOptions(columns="t=t, head=head_x/head_y/head_z")
    assert remember_columns(tmp_path / "two", options) == ""
    assert remember_columns(Path(f"{file}+{file}"), options) == ""
    assert remember_columns(file, options).startswith("columns saved")
