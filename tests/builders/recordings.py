"""Recordings that tests replay."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from gazempc.errors import RecordingError
from gazempc.recordings.load import load
from gazempc.recordings.placement import place


def synthetic(name):
    """A synthetic walk in the base frame, where it was recorded."""
    return place(load(name), "recorded", 2.5, 1.2)


def reordered(placed, order, name=None):
    """The frames of a recording in another order, 30 a second."""
    rows = {f.name: getattr(placed.truth, f.name)[order] for f in dataclasses.fields(placed.truth)}
    return dataclasses.replace(
        placed,
        name=name or placed.name,
        times_s=np.arange(len(order)) / 30.0,
        truth=dataclasses.replace(placed.truth, **rows),
        measured=None,
    )


def to_and_fro(name, legs):
    """A synthetic walk to and fro."""
    placed = synthetic(name)
    n = placed.times_s.size
    order = np.concatenate([np.arange(n) if leg % 2 == 0 else np.arange(n)[::-1] for leg in range(legs)])
    return reordered(placed, order, f"{name} x {legs}")


def assert_refused(name_or_path: str | Path, *named: str) -> None:
    """Loading raises a `RecordingError` whose message has all these words."""
    with pytest.raises(RecordingError) as caught:
        load(name_or_path)
    for words in named:
        assert words in str(caught.value)
