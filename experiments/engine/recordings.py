"""Which recordings a command works on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gazempc.errors import GazempcError, shown, suggest
from gazempc.recordings.load import ENDINGS_IN_FOLDERS, is_recording_folder
from gazempc.recordings.synthetic.everyday import everyday_names
from gazempc.recordings.synthetic.walks import synthetic_names

# Sets of synthetic recordings: 84 walks, and 70 of people who stand, start and stop.
_SETS = {"synthetic": synthetic_names, "everyday": everyday_names}


def find_recordings(words: Sequence[str]) -> list[str]:
    """Names and paths of the recordings a user means.

    Args:
        words: ``synthetic`` for all synthetic walks, ``everyday`` for the synthetic people who stand, start and stop, a
            folder for all recordings in it (its ``index.csv`` is not one), a file, a folder that is itself a
            recording, or a synthetic name.

    Returns:
        Names and paths, each once, in the order given; files of a folder sorted.

    Raises:
        GazempcError: If something does not exist, or a folder has no recordings; all such words at once.
    """
    found: list[str] = []
    problems = []
    for word in words:
        path = Path(word)
        try:
            path.exists()
        except (OSError, ValueError) as error:  # such as a name longer than the system allows, or with a zero in it
            why = error.strerror if isinstance(error, OSError) else error
            problems.append(f"{shown(word, 80)}: not a recording; {why}")
            continue
        if word in _SETS:
            found += _SETS[word]()
        elif path.is_dir() and not is_recording_folder(path):
            files = sorted(p for p in path.iterdir() if _is_recording(p))
            found += [str(p) for p in files]
            if not files:
                problems.append(f"{word}: no recordings in this folder (accepted: {', '.join(ENDINGS_IN_FOLDERS)})")
        elif path.exists() or any(word in names() for names in _SETS.values()):
            found.append(word)
        else:
            hint = suggest(word, list(_SETS)) if "." not in word and "/" not in word else "no such file or folder"
            problems.append(f"{word}: not a recording; {hint}, a synthetic name, a file or a folder")
    if problems:
        raise GazempcError("\n".join(problems))
    return list(dict.fromkeys(found))


def _is_recording(path: Path) -> bool:
    if path.is_dir():
        return is_recording_folder(path)
    return path.suffix.lower() in ENDINGS_IN_FOLDERS and path.name != "index.csv"


def in_place(recording: str) -> str:
    """A recording by a name that is right in any folder: the absolute path of a file, or a synthetic name."""
    path = Path(recording)
    return str(path.resolve()) if path.exists() else recording
