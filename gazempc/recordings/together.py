"""Several recordings that play at the same time, as one scene of several people."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gazempc.errors import RecordingError
from gazempc.recordings.load import is_recording_folder, load
from gazempc.recordings.readers.bag import open_bag
from gazempc.recordings.readers.bag_messages import FILE_ENDINGS
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording

MARK = "+"


def load_together(words: str | Path, options: ReadOptions | None = None) -> tuple[Recording, ...]:
    """Load all people of a scene.

    Args:
        words: Names or paths joined by ``+``, such as ``subject03_R4+subject05_R1``; a ROS 2 bag with several people;
            or a folder of recordings, which are taken to begin together.
        options: What the user says about the files.

    Returns:
        A recording a person, on one clock.

    Raises:
        RecordingError: If there is no such recording, a file is wrong, or the folder is empty.
        MissingOptionalDependencyError: If the format needs a package that is not installed.
    """
    given = options or ReadOptions()
    path = Path(words)
    if path.is_dir() and not is_recording_folder(path):
        files = sorted(p for p in path.iterdir() if p.is_file() and p.name != "index.csv" and p.suffix != ".toml")
        if not files:
            raise RecordingError(str(path), "", "this folder is empty", "recordings, one a person")
        return tuple(load(file, given) for file in files)
    if path.exists() and given.person is None and (path.is_dir() or path.suffix in FILE_ENDINGS):
        return _everybody(path, given)
    if path.exists():
        return (load(path, given),)
    parts = str(words).split(MARK)
    return tuple(recording for part in parts for recording in _one_or_more(part, given, len(parts)))


def _one_or_more(part: str, options: ReadOptions, parts: int) -> tuple[Recording, ...]:
    # A word that is not a path names one recording, and the message of what is wrong with it.
    return load_together(part, options) if parts > 1 and Path(part).exists() else (load(part, options),)


def _everybody(path: Path, options: ReadOptions) -> tuple[Recording, ...]:
    """All faces (or heads, or persons) of a bag, with their own starts."""
    people = open_bag(path).people
    alike = [seen for seen in people if seen.rank[0] == people[0].rank[0] and seen.poses.times_s.size > 1]
    starts_s = [float(seen.poses.times_s[0]) for seen in alike]
    recordings = [load(path, options.model_copy(update={"person": seen.name})) for seen in alike]
    return tuple(
        replace(recording, times_s=recording.times_s + start_s - min(starts_s))
        for recording, start_s in zip(recordings, starts_s, strict=True)
    )
