"""Recordings by synthetic name, by path, or from arrays, of one person or of all people of a scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from gazempc.errors import RecordingError, suggest
from gazempc.recordings.readers.bag import read_bag, read_bag_people
from gazempc.recordings.readers.bag_messages import FILE_ENDINGS
from gazempc.recordings.readers.bvh import read_bvh
from gazempc.recordings.readers.checks import check_finite, check_unit_quaternions, recording_of
from gazempc.recordings.readers.kinect import is_kinect, read_kinect
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.table import TABLES, read_table
from gazempc.recordings.readers.tables.other_files import is_openpose_folder
from gazempc.recordings.recording import Labels, Recording, Track
from gazempc.recordings.synthetic.everyday import ACTIVITIES, everyday_names, generate_everyday
from gazempc.recordings.synthetic.walks import ROUTES, generate, synthetic_names
from gazempc.types import FloatArray

_READERS: dict[str, Callable[[Path, ReadOptions], Recording]] = {
    **dict.fromkeys(TABLES, read_table),
    ".json": read_kinect,
    ".bvh": read_bvh,
    **dict.fromkeys(FILE_ENDINGS, read_bag),
}
# Endings of recordings in a folder; .txt files of a folder may have other content.
ENDINGS_IN_FOLDERS = tuple(ending for ending in _READERS if ending not in (".txt", *FILE_ENDINGS))


def is_recording_folder(path: Path) -> bool:
    """Whether a folder is one recording: a ROS 2 bag, or OpenPose's files."""
    bag = (path / "metadata.yaml").is_file() or any(p.suffix in FILE_ENDINGS for p in path.iterdir())
    return bag or is_openpose_folder(path)


def is_recording(path: Path) -> bool:
    """Whether an entry of a folder is a recording, by its ending, and for .json also by its content.

    Args:
        path: The file or folder.
    """
    if path.is_dir():
        return is_recording_folder(path)
    if path.suffix.lower() == ".json" and path.is_file():
        return is_kinect(path)
    return path.suffix.lower() in ENDINGS_IN_FOLDERS and path.name != "index.csv"


def load(name_or_path: str | Path, options: ReadOptions | None = None) -> Recording:
    """Load a recording by its name in the synthetic data set or by its path.

    Args:
        name_or_path: A synthetic name (``subject01_R1`` to ``subject14_R6``, ``subject01_stand`` to
            ``subject14_stop``) or a path. Files are tables (.csv, .tsv,
            .txt, .parquet, .mvnx), Azure Kinect body tracking (.json) or .bvh. Folders are ROS 2 bags or OpenPose
            output.
        options: Options of the readers; default: none.

    Returns:
        The recording.

    Raises:
        RecordingError: If there is no such recording or its file is invalid.
        MissingOptionalDependencyError: If the format needs a package that is not installed.
    """
    accepted = f"a file ending in {', '.join(_READERS)}, or the folder of a ROS 2 bag or of OpenPose"
    if not isinstance(name_or_path, str | Path):
        raise RecordingError(repr(name_or_path)[:80], "", "not a name or a path", f"{accepted}, or a synthetic name")
    name, path = str(name_or_path), Path(name_or_path)
    walks, everyday = synthetic_names(), everyday_names()
    if name in walks:
        return generate(name)
    if name in everyday:
        return generate_everyday(name)
    try:
        is_directory, exists = path.is_dir(), path.exists()
    except (OSError, ValueError) as error:  # such as a name that is too long or contains a NUL character
        raise RecordingError(ascii(name), "", f"cannot be opened: {error}", accepted) from None
    reader = _READERS.get(path.suffix.lower())
    if not exists:
        near = f"{suggest(name, (*walks, *everyday))}, each person with {', '.join((*ROUTES, *ACTIVITIES))}"
        expected = accepted if reader or len(path.parts) > 1 else f"{accepted}, or a synthetic name: {near}"
        raise RecordingError(name, "", "no such file or synthetic recording", expected)
    if is_directory:
        reader = read_table if is_openpose_folder(path) else read_bag if is_recording_folder(path) else None
    if reader is None:
        problem = "this folder is neither a ROS 2 bag nor OpenPose output"
        raise RecordingError(name, "", problem if is_directory else f"unknown file type {path.suffix!r}", accepted)
    try:
        return reader(path, options or ReadOptions())
    except OSError as error:
        raise RecordingError(path, "", f"cannot be read: {error.strerror or error}", accepted) from None


# Public name in `import gazempc`.
load_recording = load


MARK = "+"


def load_together(words: str | Path, options: ReadOptions | None = None) -> tuple[Recording, ...]:
    """Load all people of a scene.

    Args:
        words: Names or paths joined by ``+``, such as ``subject03_R4+subject05_R1``; a ROS 2 bag with several people;
            or a folder of recordings. The starts of joined parts, and of the files of a folder, are taken as equal.
        options: Options of the readers.

    Returns:
        One recording per person, on one clock.

    Raises:
        RecordingError: If there is no such recording, a file is invalid, or the folder is empty.
        MissingOptionalDependencyError: If the format needs a package that is not installed.
    """
    given = options or ReadOptions()
    path = Path(words)
    if path.is_dir() and not is_recording_folder(path):
        files = sorted(p for p in path.iterdir() if p.is_file() and (is_recording(p) or p.suffix == ".txt"))
        if not files:
            raise RecordingError(str(path), "", "no recordings in this folder", "recordings, one per person")
        return tuple(person for file in files for person in _from_zero((load(file, given),)))
    if path.exists() and given.person is None and (path.is_dir() or path.suffix in FILE_ENDINGS):
        return read_bag_people(path, given)
    parts = str(words).split(MARK)
    if path.exists() or len(parts) == 1:
        return (load(words, given),)
    return tuple(person for part in parts for person in _from_zero(load_together(part, given)))


def _from_zero(people: Sequence[Recording]) -> list[Recording]:
    """Recordings on one clock, whose earliest time becomes zero: the files of a scene can have different clocks."""
    start_s = min(float(person.times_s[0]) for person in people)
    return [replace(person, times_s=person.times_s - start_s) for person in people]


def recording_from_arrays(
    name: str,
    times_s: ArrayLike,
    head_position_m: ArrayLike,
    *,
    head_quat_wxyz: ArrayLike | None = None,
    pelvis_position_m: ArrayLike | None = None,
    pelvis_quat_wxyz: ArrayLike | None = None,
    in_base_frame: bool = False,
) -> Recording:
    """Build a recording from arrays, for `gazempc.replay`.

    Args:
        name: Name of the recording; the subject is its part up to the first underscore.
        times_s: Capture times, shape (N,), seconds, increasing.
        head_position_m: True positions of the head, shape (N, 3), metres, z up.
        head_quat_wxyz: Orientations of the head, shape (N, 4), or (4,) if constant; the identity faces +x. Default:
            unknown, and not measured by simulated sensors.
        pelvis_position_m: Positions of the pelvis, shape (N, 3), metres; default: unknown.
        pelvis_quat_wxyz: Orientations of the pelvis, as `head_quat_wxyz`.
        in_base_frame: Whether the frame's origin is the robot's sensor, x forward, y left. Otherwise the floor is z =
            0, and `gazempc.replay` places the robot beside the walk.

    Returns:
        The recording.

    Raises:
        RecordingError: If a shape is wrong, a value is not finite, times do not increase, times or positions are in
            another unit, or a quaternion is not of unit length; names the array, the row and the accepted values.
    """
    times = _array(name, "times_s", times_s, ("N",))
    head_m = _array(name, "head_position_m", head_position_m, (times.size, 3))
    pelvis_m = np.full_like(head_m, np.nan)
    if pelvis_position_m is not None:
        pelvis_m = _array(name, "pelvis_position_m", pelvis_position_m, (times.size, 3))
    track = Track(
        head_position_m=head_m,
        head_quat_wxyz=_quats(name, "head_quat_wxyz", head_quat_wxyz, times.size),
        pelvis_position_m=pelvis_m,
        pelvis_quat_wxyz=_quats(name, "pelvis_quat_wxyz", pelvis_quat_wxyz, times.size),
    )
    labels = Labels(subject=name.partition("_")[0])
    found = recording_of(Path(name), times, track, "motion capture", in_base_frame, "row {}".format, labels=labels)
    return replace(found, name=name, source="arrays")


def _array(name: str, field: str, value: ArrayLike, shape: tuple[int | str, ...]) -> FloatArray:
    accepted = f"an array of numbers of shape ({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise RecordingError(name, field, "its values are not numbers", accepted) from None
    fits = array.ndim == len(shape) and all(n in ("N", size) for n, size in zip(shape, array.shape, strict=True))
    if not (fits and array.size):
        raise RecordingError(name, field, f"its shape is {array.shape}", accepted)
    rows = array.reshape(len(array), -1)
    check_finite(Path(name), rows, [field] * rows.shape[1], "row {}".format)
    return array


def _quats(name: str, field: str, value: ArrayLike | None, frames: int) -> FloatArray:
    if value is None:
        return np.full((frames, 4), np.nan)
    try:
        quats = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise RecordingError(name, field, "its rows are not numbers of equal count", "shape (N, 4) or (4,)") from None
    quats = _array(name, field, np.tile(quats, (frames, 1)) if quats.shape == (4,) else quats, (frames, 4))
    check_unit_quaternions(Path(name), quats, field, "row {}".format)
    return np.asarray(quats / np.linalg.norm(quats, axis=1, keepdims=True), dtype=np.float64)
