"""Parser of BVH text into joints and channel values, and forward kinematics.

Line numbers start at 1. Joint names may contain blanks; braces may follow a name on its line.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError, shown
from gazempc.files.bounds import read_text
from gazempc.recordings.readers.checks import MAX_MAGNITUDE, check_finite
from gazempc.types import FloatArray

Pose = tuple[Rotation, FloatArray]
_CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")
_PIECES = re.compile(r"[{}]|[^{}]+")
_CHANNELS_EXPECTED = f"their number and names out of {', '.join(_CHANNELS)}, each once"


@dataclass
class Joint:
    """A joint of the hierarchy.

    Attributes:
        name: As in the file.
        parent: Index of the parent in the list of joints, -1 for the root; parents come first.
        offset: Shape (3,), from the parent in the rest pose, file units.
        rest: Shape (3,), from the root in the rest pose, file units.
        channels: Such as ``("Zrotation", "Xrotation", "Yrotation")``, in file order.
        first_channel: Column of the first channel in the motion.
        end_offset: Shape (3,), from the joint to its end site, file units; None without one.
    """

    name: str
    parent: int
    offset: FloatArray
    rest: FloatArray
    channels: tuple[str, ...] = ()
    first_channel: int = 0
    end_offset: FloatArray | None = None


@dataclass(frozen=True)
class Bvh:
    """A parsed file.

    Attributes:
        joints: In file order, root first.
        frame_time_s: As in the file, seconds.
        motion: Shape (N, C), one row per frame, one column per channel; file units and degrees.
    """

    joints: list[Joint]
    frame_time_s: float
    motion: FloatArray


def parse_bvh(path: Path) -> Bvh:
    """Parse a BVH file.

    Args:
        path: File to read.

    Returns:
        Joints and motion.

    Raises:
        RecordingError: If the file is truncated or is not BVH; names the line.
    """
    lines = _Lines(path, read_text(path, "a BVH file"))
    lines.match("HIERARCHY", "HIERARCHY, as in a BVH file")
    joints: list[Joint] = []
    try:
        _add_joint(lines, lines.match("ROOT (.+)", "ROOT and a name")[1], -1, joints)
    except RecursionError:
        raise lines.error(f"{len(joints)} nested joints", "a person's joints") from None
    lines.match("MOTION", "MOTION after one ROOT")
    count = int(lines.match("Frames: 0*([1-9][0-9]{0,8})", "Frames: and their number, at least 1")[1])
    (frame_time_s,) = lines.numbers([lines.match(r"Frame Time: (\S+)", "Frame Time: and seconds")[1]])
    if not 0.0 < frame_time_s < np.inf:
        raise lines.error(f"the frame time is {frame_time_s:g}", "a frame time above 0, in seconds")
    labels = [f"{joint.name} {channel}" for joint in joints for channel in joint.channels]
    rows: list[list[float]] = []
    numbers: list[int] = []
    while lines.rest:
        words = lines.next("a frame")
        if len(words) != len(labels):
            problem = f"{len(words)} values in frame {len(rows) + 1}"
            raise lines.error(problem, f"{len(labels)} values, one for each channel")
        rows.append(lines.numbers(words))
        numbers.append(lines.number)
    if len(rows) != count:
        raise lines.error(f"the file ends after {len(rows)} frames", f"{count}, as in 'Frames:'")
    motion = np.array(rows).reshape(count, len(labels))
    check_finite(path, motion, labels, lambda index: f"line {numbers[index]}")
    return Bvh(joints, frame_time_s, motion)


def poses(bvh: Bvh, wanted: Iterable[int], frames: slice = slice(None)) -> dict[int, Pose]:
    """Forward kinematics of some joints and their ancestors.

    A position channel replaces the same component of OFFSET, as in most programs.

    Args:
        bvh: The file.
        wanted: Indices of joints.
        frames: Slice of N frames.

    Returns:
        For each joint its rotation (N of them, joint to file axes) and position, shape (N, 3), file units.
    """
    needed = {index for joint in wanted for index in to_root(bvh.joints, joint)}
    motion = bvh.motion[frames]
    found: dict[int, Pose] = {}
    for index in sorted(needed):
        joint = bvh.joints[index]
        local, turn = np.tile(joint.offset, (len(motion), 1)), Rotation.identity(len(motion))
        for column, channel in enumerate(joint.channels, start=joint.first_channel):
            axis = channel[0].lower()
            if channel.endswith("position"):
                local[:, "xyz".index(axis)] = motion[:, column]
            else:
                turn *= Rotation.from_euler(axis, motion[:, column : column + 1], degrees=True)
        if joint.parent >= 0:
            parent_turn, parent_position = found[joint.parent]
            turn, local = parent_turn * turn, parent_position + parent_turn.apply(local)
        found[index] = turn, local
    return found


def to_root(joints: list[Joint], index: int) -> list[int]:
    """Indices of a joint and of all its parents, up to the root."""
    way = [index]
    while joints[way[-1]].parent >= 0:
        way.append(joints[way[-1]].parent)
    return way


class _Lines:
    """Non-blank lines of the file, split into words; braces are separate lines."""

    def __init__(self, path: Path, text: str) -> None:
        self._path, self.number = path, 0
        numbered = enumerate(text.splitlines(), start=1)
        pieces = ((number, piece.split()) for number, line in numbered for piece in _PIECES.findall(line))
        self.rest: deque[tuple[int, list[str]]] = deque((number, words) for number, words in pieces if words)

    def next(self, expected: str) -> list[str]:
        if not self.rest:
            raise self.error("the file ends here (truncated?)", expected)
        self.number, words = self.rest.popleft()
        return words

    def match(self, pattern: str, expected: str) -> re.Match[str]:
        text = " ".join(self.next(expected))
        if (found := re.fullmatch(pattern, text, re.IGNORECASE)) is None:
            raise self.error(shown(text), expected)
        return found

    def numbers(self, words: list[str]) -> list[float]:
        try:
            return [float(word) for word in words]
        except ValueError as error:
            text = str(error).partition(": ")[2].strip("'")
            raise self.error(f"{shown(text)} is not a number", "a number") from None

    def offset(self) -> FloatArray:
        found = np.array(self.numbers(self.match(r"OFFSET (\S+ \S+ \S+)", "OFFSET and three numbers")[1].split()))
        if not (np.abs(found) <= MAX_MAGNITUDE).all():
            raise self.error(f"OFFSET {found}", "three finite numbers")
        return found

    def error(self, problem: str, expected: str) -> RecordingError:
        return RecordingError(self._path, f"line {self.number}", problem, expected)


def _add_joint(lines: _Lines, name: str, parent: int, joints: list[Joint]) -> None:
    """Read a joint and its descendants, from its opening to its closing brace."""
    lines.match(r"\{", f"the opening brace of joint {name!r}")
    index, offset = len(joints), lines.offset()
    joint = Joint(name, parent, offset, joints[parent].rest + offset if joints else np.zeros(3))
    joint.first_channel = sum(len(other.channels) for other in joints)
    found = lines.match(r"CHANNELS (\d{1,3}) ?(.*)", f"CHANNELS of joint {name!r}, {_CHANNELS_EXPECTED}")
    joint.channels = tuple(word.capitalize() for word in found[2].split())
    if not len(joint.channels) == len(set(joint.channels) & set(_CHANNELS)) == int(found[1]):
        raise lines.error(shown(found[0], 80), _CHANNELS_EXPECTED)
    joints.append(joint)
    expected = f"JOINT, End Site or the closing brace of joint {name!r}"
    while (found := lines.match(r"JOINT (.+)|END .*|\}", expected))[0] != "}":
        if found[1] is not None:
            _add_joint(lines, found[1], index, joints)
            continue
        lines.match(r"\{", "the opening brace of an end site")
        end = lines.offset()
        joint.end_offset = end if joint.end_offset is None else joint.end_offset
        lines.match(r"\}", "the closing brace of an end site")
