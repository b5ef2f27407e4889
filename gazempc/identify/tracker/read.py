"""Read a track from a table, lines of JSON or a bag, to measure its tracker."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError, SettingsError, suggest
from gazempc.identify.tracker.track import HeadTrack, of_bag, of_lines, of_recording
from gazempc.recordings.readers.bag import read_bag_tracks
from gazempc.recordings.readers.plausible import check_plausible
from gazempc.recordings.readers.table import TABLES

_LINES = (".jsonl", ".ndjson")
_ACCEPTED = (
    "a table (.csv, .tsv, .txt, .parquet) with t, head_x, head_y, head_z, or with columns that are known or saved; "
    "lines of JSON as a live source takes them "
    f"({', '.join(_LINES)}); or the folder of a ROS 2 bag"
)
# Fewer repeats are chance, of coordinates with few digits.
_REPEATED = 0.1
# No camera sees a head nearer than this. If a head is nearer, the origin is not the sensor.
_LEAST_RANGE_M = 0.1
# With less data no error can be estimated.
_MIN_FRAMES, _MIN_DURATION_S = 60, 3.0


def read_track(path: Path, person: str | None, tell: Callable[[float], None]) -> HeadTrack:
    """Read the longest track of a file, or that of one person.

    Args:
        path: File or folder.
        person: The tracker's name of the person; None: who has the longest track.
        tell: Called with the share that is read, 0 to 1.

    Returns:
        The track.

    Raises:
        RecordingError: If the file cannot be read, or the track is too short.
        SettingsError: If there is no such person.
        MissingOptionalDependencyError: If the format needs a package that is not installed.
    """
    if path.is_dir():
        tracks: Sequence[HeadTrack] = [of_bag(track) for track in read_bag_tracks(path, tell)]
    elif path.suffix.lower() in _LINES:
        tracks = of_lines(path)
    elif not path.exists() or path.suffix.lower() not in (*TABLES, ".json"):
        raise RecordingError(path, "", "no such recording" if not path.exists() else "unknown kind of file", _ACCEPTED)
    else:
        tracks = [of_recording(path)]
    chosen = _choose(path, tracks, person)
    _check(path, chosen)
    return _without_repeats(chosen)


def _choose(path: Path, tracks: Sequence[HeadTrack], person: str | None) -> HeadTrack:
    tracks = sorted(tracks, key=lambda track: -track.times_s.size)
    if person is None:
        chosen = tracks[0]
    else:
        named = [t for t in tracks if person in (t.person, t.person.partition("_")[2])]
        if not named:
            raise SettingsError(f"--person {person}: not in {path}; {suggest(person, [t.person for t in tracks])}")
        chosen = named[0]
    others = [f"{t.person} ({t.times_s.size} frames)" for t in tracks if t is not chosen]
    if not others:
        return chosen
    note = f"also in the file: {', '.join(others)}; choose by --person"
    return replace(chosen, notes=(*chosen.notes, note))


def _check(path: Path, track: HeadTrack) -> None:
    place, frames = f"person {track.person}", track.times_s.size
    duration_s = float(np.ptp(track.times_s)) if frames else 0.0
    if frames < _MIN_FRAMES or duration_s < _MIN_DURATION_S:
        raise RecordingError(
            path,
            place,
            f"{frames} frames in {duration_s:.1f} s",
            f"at least {_MIN_FRAMES} frames in {_MIN_DURATION_S:g} s; better 30 s of a person who stands still",
        )
    check_plausible(path, track.times_s, track.position_m, at_sensor=True)
    if (np.ptp(track.position_m, axis=0) == 0.0).all():
        raise RecordingError(path, place, "the position never changes", "a tracker that measures")
    if (np.linalg.norm(track.position_m, axis=1) < _LEAST_RANGE_M).any():
        raise RecordingError(
            path,
            place,
            f"a head within {_LEAST_RANGE_M:g} m of the origin",
            "positions in the sensor's own frame, x forward, y left, z up, the sensor at the origin",
        )


def _without_repeats(track: HeadTrack) -> HeadTrack:
    """The track without repeated frames: a tracker may publish faster than it measures."""
    new = np.concatenate([[True], (np.diff(track.position_m, axis=0) != 0.0).any(axis=1)])
    if new.mean() > 1.0 - _REPEATED:
        return track
    note = f"{int((~new).sum())} of {new.size} frames repeat the position before exactly: left out"
    return HeadTrack(
        track.person,
        track.times_s[new],
        track.position_m[new],
        track.head_yaw_rad[new],
        track.pelvis_yaw_rad[new],
        None if track.delays_s is None else track.delays_s[new],
        (*track.notes, note),
    )
