"""Track of one person from a table, lines of JSON or a bag, to measure its tracker."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError, SettingsError, suggest
from gazempc.files.bounds import read_text
from gazempc.live.sources.json_lines import LineError, parse_line
from gazempc.recordings.load import load
from gazempc.recordings.readers.checks import check_plausible
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.table import TABLES
from gazempc.types import FloatArray
from predictors import HeadObservation


@dataclass(frozen=True)
class HeadTrack:
    """The track of one person. The sensor is at the origin (x forward, y left, z up).

    Attributes:
        person: Name of the person from the tracker or the file.
        times_s: Capture times, shape (N,), seconds, strictly increasing.
        position_m: Positions of the head, shape (N, 3), metres.
        head_yaw_rad: Shape (N,); NaN if unknown.
        pelvis_yaw_rad: Shape (N,); NaN if unknown.
        delays_s: Delay from stamp to arrival, shape (N,), seconds; None if unknown.
        notes: Omissions and decisions of the reader.
    """

    person: str
    times_s: FloatArray
    position_m: FloatArray
    head_yaw_rad: FloatArray
    pelvis_yaw_rad: FloatArray
    delays_s: FloatArray | None
    notes: tuple[str, ...] = ()


def of_recording(path: Path, person: str | None = None) -> HeadTrack:
    """The measured track of a recording.

    Args:
        path: The recording, with the sensor at the origin.
        person: Name of the person; None for the one with the longest track.

    Returns:
        The track.

    Raises:
        RecordingError: If the recording cannot be read, or is a bag in which no person is in the frame of a sensor.
        SettingsError: If there is no such person.
        MissingOptionalDependencyError: If the format needs a package that is not installed.
    """
    recording = load(path, ReadOptions(person=person))
    if recording.kind == "tracked" and not recording.has_robot:
        raise RecordingError(path, "", f"not in the frame of a sensor: {recording.notes[0]}", "a head seen by a camera")
    seen = recording.measured or recording.truth
    valid = seen.valid
    unseen = () if valid.all() else (f"{int((~valid).sum())} frames without the person",)
    head_rad, pelvis_rad = (_forward_yaw_rad(quats[valid]) for quats in (seen.head_quat_wxyz, seen.pelvis_quat_wxyz))
    delays_s = None if recording.delays_s is None else recording.delays_s[valid]
    times_s, position_m = recording.times_s[valid], seen.head_position_m[valid]
    return HeadTrack(recording.name, times_s, position_m, head_rad, pelvis_rad, delays_s, (*recording.notes, *unseen))


def of_lines(path: Path, person: str | None = None) -> HeadTrack:
    """The track of one person in lines of JSON.

    Args:
        path: File with one observation per line, in order of arrival.
        person: The tracker's name of the person; None for the one with the most lines.

    Returns:
        The track.

    Raises:
        RecordingError: If more than one line in ten is invalid; names the first one.
        SettingsError: If there is no such person.
    """
    found: dict[str, list[HeadObservation]] = defaultdict(list)
    bad: list[str] = []
    lines = [each for each in enumerate(read_text(path, "lines of JSON").splitlines(), 1) if each[1].strip()]
    for number, text in lines:
        try:
            observation = parse_line(text, np.nan, lambda unix_s: unix_s)
            found[observation.person_id or path.stem].append(observation)
        except LineError as error:
            problem = "age_s is not a capture time in a file; give capture_time_s" if '"age_s"' in text else str(error)
            bad.append(f"line {number}: {problem}")
    count = len(lines)
    # Tolerated share of invalid lines (truncated at the end of a recording); beyond it the format is wrong.
    if len(bad) > 0.1 * count or not found:
        place, _, problem = bad[0].partition(": ")
        raise RecordingError(path, place, f"{problem} ({len(bad)} of {count} lines)", "one observation per line")
    chosen = max(found, key=lambda name: len(found[name])) if person is None else person
    if chosen not in found:
        raise SettingsError(f"--person {person}: not in {path}; {suggest(chosen, found)}")
    notes = [f"{len(bad)} of {count} lines are not observations ({bad[0]})"] if bad else []
    if others := [f"{name} ({len(own)} frames)" for name, own in found.items() if name != chosen]:
        notes.append(f"also in the file: {', '.join(others)}; choose by --person")
    times_s, first = np.unique([o.capture_time_s for o in found[chosen]], return_index=True)
    kept = [found[chosen][k] for k in first]
    if repeated := len(found[chosen]) - len(kept):
        notes.append(f"{repeated} lines repeat an earlier capture time: left out")
    head_rad, pelvis_rad = (
        _forward_yaw_rad(np.array([np.full(4, np.nan) if quat is None else quat for quat in quats]))
        for quats in ([o.head_quat_wxyz for o in kept], [o.pelvis_quat_wxyz for o in kept])
    )
    positions_m = np.array([o.head_position_base_m for o in kept])
    return HeadTrack(chosen, times_s, positions_m, head_rad, pelvis_rad, None, tuple(notes))


def _forward_yaw_rad(quats_wxyz: FloatArray) -> FloatArray:
    """Yaw of the forward axis +x, shape (N,)."""
    w, x, y, z = quats_wxyz.T
    return np.asarray(np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y**2 + z**2)))


_LINES = (".jsonl", ".ndjson")
_ACCEPTED = (
    "a table (.csv, .tsv, .txt, .parquet) with t, head_x, head_y, head_z, or with a known or saved mapping; "
    "lines of JSON as for a live source "
    f"({', '.join(_LINES)}); or the folder of a ROS 2 bag"
)
# Least range of a head; if it is less, the origin is not the sensor.
_LEAST_RANGE_M = 0.1
# Least data for the estimation of errors.
_MIN_FRAMES, _MIN_DURATION_S = 60, 3.0


def read_track(path: Path, person: str | None = None) -> HeadTrack:
    """Read the longest track of a file, or the track of one person.

    Args:
        path: File or folder.
        person: The tracker's name of the person; None: the longest track.

    Returns:
        The track.

    Raises:
        RecordingError: If the file cannot be read, or the track is too short.
        SettingsError: If there is no such person.
        MissingOptionalDependencyError: If the format needs a package that is not installed.
    """
    is_lines = path.suffix.lower() in _LINES
    if not is_lines and not path.is_dir() and (not path.exists() or path.suffix.lower() not in (*TABLES, ".json")):
        raise RecordingError(path, "", "no such recording" if not path.exists() else "unknown file type", _ACCEPTED)
    track = of_lines(path, person) if is_lines else of_recording(path, person)
    place, frames = f"person {track.person}", track.times_s.size
    duration_s = float(np.ptp(track.times_s)) if frames else 0.0
    if frames < _MIN_FRAMES or duration_s < _MIN_DURATION_S:
        needed = f"at least {_MIN_FRAMES} frames in {_MIN_DURATION_S:g} s; preferably 30 s of a person at rest"
        raise RecordingError(path, place, f"{frames} frames in {duration_s:.1f} s", needed)
    check_plausible(path, track.times_s, track.position_m, at_sensor=True)
    if (np.ptp(track.position_m, axis=0) == 0.0).all():
        raise RecordingError(path, place, "the position is constant", "measured positions")
    if (np.linalg.norm(track.position_m, axis=1) < _LEAST_RANGE_M).any():
        needed = "positions in the sensor's frame, x forward, y left, z up, the sensor at the origin"
        raise RecordingError(path, place, f"a head within {_LEAST_RANGE_M:g} m of the origin", needed)
    new = np.concatenate([[True], (np.diff(track.position_m, axis=0) != 0.0).any(axis=1)])
    # A tracker may publish at a higher rate than it measures; few repeated frames occur with coordinates of few digits.
    if new.mean() > 0.9:
        return track
    note = f"{int((~new).sum())} of {new.size} frames repeat the previous position exactly: left out"
    arrays = {name: value[new] for name, value in vars(track).items() if isinstance(value, np.ndarray)}
    return replace(track, **arrays, notes=(*track.notes, note))
