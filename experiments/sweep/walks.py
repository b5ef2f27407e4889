"""The recordings of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.engine.recordings import find_recordings, in_place
from gazempc.errors import GazempcError
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions


@dataclass(frozen=True)
class Walk:
    """A recording that has been read once.

    Attributes:
        name: Its name in tables.
        path: Synthetic name or absolute path.
        subject: Who walks.
        group: Kind of walk.
        is_synthetic: Whether it is one of the generated walks.
    """

    name: str
    path: str
    subject: str
    group: str | None
    is_synthetic: bool


def read_walks(words: Sequence[str], reading: ReadOptions) -> tuple[tuple[Walk, ...], list[str]]:
    """Read recordings.

    Args:
        words: As for `experiments.engine.recordings.find_recordings`.
        reading: What the user says about the files.

    Returns:
        The walks, and what is wrong with the others, a line each.
    """
    problems: list[str] = []
    found: list[str] = []
    for word in words:
        try:
            found += find_recordings([word])
        except GazempcError as error:
            problems += str(error).splitlines()
    walks = []
    for name in dict.fromkeys(found):
        try:
            recording = load(name, reading)
        except GazempcError as error:
            problems.append(str(error))
            continue
        labels = recording.labels
        walks.append(Walk(Path(name).stem, in_place(name), labels.subject, labels.group, recording.kind == "synthetic"))
    return tuple(walks), problems
