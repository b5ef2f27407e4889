"""Tables of unknown names are refused with a proposal, which can be pasted, and which `guess` takes."""

import numpy as np
import pytest
from builders.exports import Walk
from test_columns import same_head, write

from gazempc.errors import RecordingError
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions

T, HEAD = Walk.times_s, Walk.head_m
TABLES = {
    "an index first": (["", "timestamp", "head_x", "head_y", "head_z"], T, T, HEAD),
    "nanoseconds since 1970, mm, a quaternion": (
        ["stamp_ns", *(f"pose.position.{c}" for c in "xyz"), *(f"pose.orientation.{c}" for c in "xyzw")],
        1e9 * (1.7e9 + T), 1000 * HEAD, Walk.head.as_quat(),
    ),
    "milliseconds, cm": (["stamp", "x", "y", "z"], 1000 * T, 100 * HEAD),
    "units in brackets": (["Time (s)", "Head X [mm]", "Head Y [mm]", "Head Z [mm]"], T, 1000 * HEAD),
    "PlotJuggler": (["__time", *(f"/face/pose/position/{c}" for c in "xyz")], 1.7e9 + T, HEAD),
    "a robot beside the head": (["time", *(f"{k}_{c}" for k in ("robot", "head") for c in "xyz")], T, 0 * HEAD, HEAD),
    "commas in names": (["time, s", "head, x", "head, y", "head, z"], T, HEAD),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_what_is_proposed_can_be_pasted_and_taken(tmp_path, name):
    header, *columns = TABLES[name]
    path = write(tmp_path / "a.csv", [f'"{cell}"' if "," in cell else cell for cell in header], *columns)
    with pytest.raises(RecordingError, match=r"a guess: --reading\.columns ") as caught:
        load(path)
    pasted = str(caught.value).partition('--reading.columns "')[2].partition('"')[0]
    for options in (ReadOptions(guess=True), ReadOptions(columns=pasted)):
        found = load(path, options)
        same_head(found, HEAD)
        np.testing.assert_allclose(found.times_s - found.times_s[0], T, atol=1e-6)


def test_undetermined_parts_are_named(tmp_path):
    path = write(tmp_path / "a.csv", ["frame", "id", "x", "y"], np.arange(float(T.size)), 0 * T + 3, HEAD[:, :2])
    with pytest.raises(RecordingError, match=r"30 frames a second is a guess; the file has no height: 1\.6 m stands"):
        load(path)
    same_head(load(path, ReadOptions(guess=True)), np.column_stack([HEAD[:, :2], 0 * T + 1.6]))


@pytest.mark.parametrize(
    "header",
    [["t", "a", "b", "c"], ["k", "x", "y", "z"], ["t", *(f"head{k}_{c}" for k in (1, 2) for c in "xyz")]],
)
def test_nothing_to_guess(tmp_path, header):
    heads = [HEAD] * (len(header) // 3)
    with pytest.raises(RecordingError, match="no columns that could be the time and one head"):
        load(write(tmp_path / "a.csv", header, T, *heads), ReadOptions(guess=True))
