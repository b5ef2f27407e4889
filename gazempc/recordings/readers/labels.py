"""Labels of a recording, from the index file beside it or else from its name and motion."""

from __future__ import annotations

import csv
from pathlib import Path

from gazempc.files.bounds import MOST_TEXT_BYTES, read_limited
from gazempc.recordings.readers.route_group import ROUTES, STANDING, route_group
from gazempc.recordings.recording import Labels
from gazempc.types import FloatArray

_INDEX_NAME = "index.csv"
_INDEX_COLUMNS = {"clip", "subject", "group"}
# Activities of people who stay where they are, whatever route an index states.
_STAYING = frozenset({"standing", "sitting", "waiting"})


def labels_for(path: Path, times_s: FloatArray, path_m: FloatArray) -> Labels:
    """Find a recording's labels.

    A file ``index.csv`` in the same folder with the columns clip, subject, group and, if it likes, kind and
    source_description wins for the clips it names. Otherwise the subject is the file's name up to the first
    underscore and the group follows from the motion. The group is ``standing`` where the activity is standing, sitting
    or waiting, or, without an activity, where the person does not leave the spot; a route stated in the index does not
    change that, a group of the user's own does.

    Args:
        path: The recording's file.
        times_s: Shape (N,), seconds, strictly increasing.
        path_m: Positions of the pelvis, or of the head where no pelvis is known, shape (N, 3), metres, z up; NaN
            where not seen.

    Returns:
        The labels.
    """
    row = _index_row(path)
    activity = row.get("kind") or None
    return Labels(
        subject=row.get("subject") or path.stem.split("_")[0] or path.stem,
        group=_group(row.get("group") or None, activity, times_s, path_m),
        description=row.get("source_description") or "",
        activity=activity,
    )


def _group(stated: str | None, activity: str | None, times_s: FloatArray, path_m: FloatArray) -> str:
    if stated is not None and stated not in ROUTES:
        return stated
    if activity is not None:
        return STANDING if activity in _STAYING else stated or route_group(times_s, path_m)
    by_motion = route_group(times_s, path_m)
    return stated if stated is not None and by_motion != STANDING else by_motion


def _index_row(path: Path) -> dict[str, str]:
    """Row of the index about this clip; empty where there is no index or it does not name the clip.

    A damaged or unrelated ``index.csv`` must not keep a sound recording from being read, so it is ignored.
    """
    try:
        text = read_limited(path.with_name(_INDEX_NAME), MOST_TEXT_BYTES).decode("utf-8-sig", errors="replace")
        rows = list(csv.reader(text.splitlines()))
    except (OSError, ValueError, csv.Error):
        return {}
    if not rows or not set(rows[0]) >= _INDEX_COLUMNS:
        return {}
    clip = rows[0].index("clip")
    for row in rows[1:]:
        if len(row) == len(rows[0]) and row[clip] == path.stem:
            return {name: cell.strip() for name, cell in zip(rows[0], row, strict=True)}
    return {}
