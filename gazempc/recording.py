"""A person's track with labels, and how to load one by name or path."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from gazempc.errors import RecordingError, suggest

if TYPE_CHECKING:
    from gazempc.readers.options import ReadOptions

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

DataKind = Literal["synthetic", "motion capture", "body tracking"]


@dataclass(frozen=True)
class Track:
    """Poses of head and pelvis at the recording's capture times.

    Rows where `valid` is False hold NaN. The frame is the recording's own: metres, z up, right-handed; the
    identity quaternion faces +x with +y to the person's left.

    Attributes:
        head_position_m: Shape (N, 3), metres.
        head_quat_wxyz: Shape (N, 4), unit quaternions.
        pelvis_position_m: Shape (N, 3), metres.
        pelvis_quat_wxyz: Shape (N, 4), unit quaternions.
        valid: Shape (N,); False where the person was not seen.
    """

    head_position_m: FloatArray
    head_quat_wxyz: FloatArray
    pelvis_position_m: FloatArray
    pelvis_quat_wxyz: FloatArray
    valid: BoolArray


@dataclass(frozen=True)
class Labels:
    """What is known about a recording besides the motion.

    Attributes:
        subject: Who walks; by default the name up to the first underscore.
        group: Route group such as ``straight``, ``turn``, ``sharp``, or None where unknown.
        description: Free text for people.
    """

    subject: str
    group: str | None = None
    description: str = ""


@dataclass(frozen=True)
class Recording:
    """One walk of one person.

    Attributes:
        name: Short name used in tables and file names.
        source: File path, or ``synthetic``.
        kind: Where the data is from; said wherever the recording is shown.
        times_s: Capture times, shape (N,), seconds, strictly increasing.
        truth: The best known true motion: the generator's or motion capture's own, or, for body tracking,
            the measured track smoothed without lag.
        measured: What a body tracker saw of it, where the recording has that; None for motion capture.
        has_robot: True where the origin of the frame is the robot's sensor (x forward, y left, z up), so
            that the recording can be replayed where it was taken.
        labels: Subject, group and description.
    """

    name: str
    source: str
    kind: DataKind
    times_s: FloatArray
    truth: Track
    measured: Track | None
    has_robot: bool
    labels: Labels = field(default_factory=lambda: Labels(subject="unknown"))


def load(name_or_path: str | Path, options: ReadOptions | None = None) -> Recording:
    """Load a recording by its name in the synthetic data set or by its path.

    Args:
        name_or_path: ``subject01_R1`` to ``subject14_R6``, or a file ending in .csv, .parquet, .json (Azure
            Kinect body tracking) or .bvh.
        options: What the user says about the file; default: nothing.

    Returns:
        The recording.

    Raises:
        RecordingError: If there is no such recording or its file is wrong.
        MissingOptionalDependencyError: If the format needs a package that is not installed.
    """
    # Imported here because readers and generator themselves need the classes above.
    from gazempc.readers.bvh import read_bvh  # noqa: PLC0415
    from gazempc.readers.kinect import read_kinect  # noqa: PLC0415
    from gazempc.readers.options import ReadOptions  # noqa: PLC0415
    from gazempc.readers.table import read_csv, read_parquet  # noqa: PLC0415
    from gazempc.synthetic import generate, synthetic_names  # noqa: PLC0415

    readers = {".csv": read_csv, ".parquet": read_parquet, ".json": read_kinect, ".bvh": read_bvh}
    accepted = f"a file ending in {', '.join(readers)}"
    name, path = str(name_or_path), Path(name_or_path)
    names = list(synthetic_names())
    if name in names:
        return generate(name)
    try:
        is_directory, exists, is_file = path.is_dir(), path.exists(), path.is_file()
    except OSError as error:  # such as a name longer than the system allows
        raise RecordingError(name, "", f"cannot be opened: {error.strerror}", accepted) from None
    if is_directory:
        raise RecordingError(name, "", "this is a directory", accepted)
    if not exists:
        looks_like_file = path.suffix.lower() in readers or len(path.parts) > 1
        expected = accepted if looks_like_file else f"{accepted}, or a synthetic name: {suggest(name, names)}"
        raise RecordingError(name, "", "no such file or synthetic recording", expected)
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise RecordingError(name, "", f"unknown kind of file {path.suffix!r}", accepted)
    if not is_file:
        raise RecordingError(name, "", "this is not a regular file", accepted)
    return reader(path, options if options is not None else ReadOptions())
