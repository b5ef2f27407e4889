"""A comparison by a worker process; the other tests of commands do their jobs in one process."""

import pytest
from builders.comparisons import rows_of
from builders.own_parts import own_module

from experiments.compare import main


@pytest.mark.slow
def test_a_worker_finds_a_part_of_ones_own(tmp_path, monkeypatch):
    own = own_module(tmp_path, monkeypatch)
    words = ["--recordings", "subject01_R4", "--controllers", f"{own}:Sluggish", "--predictors", "last_position"]
    assert main([*words, "--jobs", "1", "--no-figures", "--out", str(tmp_path / "out")]) == 0
    (row,) = rows_of(tmp_path / "out")
    assert (row["controller"], row["failed"]) == ("sluggish", "")
