"""Which files a command works on, and what a result depends on beside a recording's file."""

import shutil

import numpy as np
import pytest
from builders import exports

from experiments.engine.command import find_recordings
from experiments.engine.job import recording_hash
from gazempc.errors import GazempcError


def test_folders_that_are_recordings_are_found_as_such(tmp_path):
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


def test_a_result_depends_on_the_saved_columns_and_on_all_files_of_a_folder(tmp_path):
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
