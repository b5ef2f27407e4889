"""Which recordings a command works on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gazempc.errors import GazempcError, suggest
from gazempc.recordings.synthetic.walks import synthetic_names

SUFFIXES = (".csv", ".parquet", ".json", ".bvh")


def find_recordings(words: Sequence[str]) -> list[str]:
    """Names and paths of the recordings a user means.

    Args:
        words: ``synthetic`` for the whole synthetic set, a folder for all recordings in it (its ``index.csv`` is not
            one), a file, or a synthetic name.

    Returns:
        Names and paths, each once, in the order given; files of a folder sorted.

    Raises:
        GazempcError: If something does not exist, or a folder has no recordings; all such words at once.
    """
    found: list[str] = []
    problems = []
    for word in words:
        path = Path(word)
        if word == "synthetic":
            found += synthetic_names()
        elif path.is_dir():
            files = sorted(p for p in path.iterdir() if p.suffix.lower() in SUFFIXES and p.name != "index.csv")
            found += [str(p) for p in files]
            if not files:
                problems.append(f"{word}: no recordings in this folder (accepted: {', '.join(SUFFIXES)})")
        elif path.is_file() or word in synthetic_names():
            found.append(word)
        else:
            hint = suggest(word, ["synthetic"]) if "." not in word and "/" not in word else "no such file or folder"
            problems.append(f"{word}: not a recording; {hint}, a synthetic name, a file or a folder")
    if problems:
        raise GazempcError("\n".join(problems))
    return list(dict.fromkeys(found))


def in_place(recording: str) -> str:
    """A recording by a name that is right in any folder: the absolute path of a file, or a synthetic name."""
    path = Path(recording)
    return str(path.resolve()) if path.is_file() else recording
