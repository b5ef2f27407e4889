"""Xsens MVN's export ``.mvnx`` as a table: positions and orientations of all segments, by name."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from gazempc.errors import RecordingError
from gazempc.recordings.readers.tables.raw_table import RawTable
from gazempc.recordings.readers.text import read_text

# A frame has about 30, and takes 5 kB: a file of the largest size has a million.
_MOST_TAGS = 2_000_000
_ACCEPTED = "an .mvnx file of Xsens MVN with positions and orientations of the segments"


def mvnx_table(path: Path) -> RawTable:
    """Read the frames of a recording; calibration poses are left out.

    Args:
        path: File to read.

    Returns:
        Columns ``Time_ms``, ``Head x``, ``Head q0`` and so on for each segment; metres, z up, scalar first.

    Raises:
        RecordingError: If the file is no such XML, or a frame has other counts than the segments.
    """
    text = read_text(path, "an .mvnx file")
    if (found := text.count("<")) > _MOST_TAGS:
        raise RecordingError(path, "", f"{found} tags", f"{_MOST_TAGS} at most: {_ACCEPTED}")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise RecordingError(path, "", "it defines entities, which may stand for gigabytes", _ACCEPTED)
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise RecordingError(path, "", f"not valid XML: {error}", _ACCEPTED) from None
    segments = [element.get("label") or "" for element in root.iterfind(".//{*}segments/{*}segment")]
    frames = [frame for frame in root.iterfind(".//{*}frame") if frame.get("type", "normal") == "normal"]
    if not segments or not frames:
        raise RecordingError(path, "", f"{len(segments)} segments and {len(frames)} frames", _ACCEPTED)
    rows = []
    for number, frame in enumerate(frames):
        try:
            time_ms = float(frame.get("time") or "nan")
        except ValueError:
            time_ms = float("nan")
        positions = _numbers(path, number, frame, "position", 3 * len(segments))
        quats = _numbers(path, number, frame, "orientation", 4 * len(segments))
        rows.append([time_ms, *positions, *quats])
    names = ["Time_ms", *(f"{s} {c}" for s in segments for c in "xyz")]
    names += [f"{s} q{k}" for s in segments for k in range(4)]
    return RawTable(
        path=path,
        layout="mvnx",
        names=tuple(names),
        columns=list(np.array(rows).T),
        places=[f"frame {k}" for k in range(len(rows))],
    )


def _numbers(path: Path, number: int, frame: ElementTree.Element, what: str, count: int) -> list[float]:
    element = frame.find(f"{{*}}{what}")
    text = "" if element is None else element.text or ""
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        found = []
    if len(found) != count:
        raise RecordingError(path, f"frame {number}, {what}", f"{len(found)} numbers", f"{count} numbers")
    return found
