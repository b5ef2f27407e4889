"""The part of `python -m gazempc.identify` that measures a tracker."""

from __future__ import annotations

import datetime
from pathlib import Path

from gazempc.files.whole import write_whole
from gazempc.identify.tracker.measure import measure_tracker
from gazempc.identify.tracker.read import read_track
from gazempc.identify.tracker.report import table, warnings
from gazempc.identify.tracker.sensor_file import sensor_toml
from gazempc.progress import Progress


def identify_tracker(path: Path, person: str | None, out: Path, progress: Progress) -> None:
    """Measure a tracker from a recording, print what was found and write a sensor file.

    Args:
        path: Recording: table, lines of JSON or folder of a bag.
        person: The tracker's name of the person; None: who has the longest track.
        out: TOML file to write.
        progress: Says how far it is.

    Raises:
        RecordingError: If the recording cannot be read.
        SettingsError: If there is no such person.
        MissingOptionalDependencyError: If the format needs a package that is not installed.
    """
    progress.say(f"reading {path}")
    track = read_track(path, person, progress.at)
    print(f"{path.name}: {track.person}, {track.times_s.size} frames")
    for note in track.notes:
        print(f"  {note}")
    progress.say("fitting")
    errors = measure_tracker(track, progress.at)
    print(f"\n{table(errors)}\n\n± is one standard deviation.")
    for warning in warnings(errors):
        print(f"Warning: {warning}.")
    write_whole(out, sensor_toml(errors, track, out.stem, path.name, datetime.date.today()))
    print(f"\nWritten: {out}")
    print(f"Use it: python -m gazempc.run --replay subject03_R4 --sensor {out}")
