"""BVH text into joints and channel values, and their forward kinematics.

Lines are counted from 1. Joint names may hold blanks, braces may stand on the line of a name.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError, shown
from gazempc.recordings.readers.checks import check_finite
from gazempc.recordings.readers.text import read_text
from gazempc.types import FloatArray


class Lines:
    """The file's lines that are not blank, split into words, read one after the other."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        split = ((number, line.split()) for number, line in enumerate(text.splitlines(), start=1))
        self._lines = [(number, words) for number, words in split if words]
        self._next = 0
        self.number = 0

    def next(self, expected: str) -> list[str]:
        """Words of the next line.

        Raises:
            RecordingError: If the file ends instead.
        """
        if self._next == len(self._lines):
            last = self._lines[-1][0]
            raise RecordingError(self.path, f"line {last}", "the file ends here (cut off?)", expected)
        self.number, words = self._lines[self._next]
        self._next += 1
        return words

    def push_back(self, words: list[str]) -> None:
        """Hand in words of the current line that the next call shall return."""
        self._next -= 1
        self._lines[self._next] = (self.number, words)

    def rest(self) -> list[tuple[int, list[str]]]:
        """All lines not yet read, with their numbers."""
        return self._lines[self._next :]

    def error(self, problem: str, expected: str) -> RecordingError:
        """An error in the current line."""
        return RecordingError(self.path, f"line {self.number}", problem, expected)


def parse_number(path: Path, line: int, word: str) -> float:
    """Parse a number of a line.

    Raises:
        RecordingError: If it is not one; shows what stands there.
    """
    try:
        return float(word)
    except ValueError:
        raise RecordingError(path, f"line {line}", f"{shown(word)} is not a number", "a number") from None


_CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")
_CHANNEL_OF_LOWER = {name.lower(): name for name in _CHANNELS}
_MAX_OFFSET = 1e9


@dataclass
class Joint:
    """A joint of the hierarchy.

    Attributes:
        name: As in the file.
        parent: Index of the parent in the list of joints, -1 for the root; parents come first.
        offset: Shape (3,), from the parent in the rest pose, file units.
        channels: Such as ``("Zrotation", "Xrotation", "Yrotation")``, in file order.
        first_channel: Column of the first channel in the motion.
        end_offset: Shape (3,), from the joint to its end site, file units; None without one.
    """

    name: str
    parent: int
    offset: FloatArray = field(default_factory=lambda: np.zeros(3))
    channels: tuple[str, ...] = ()
    first_channel: int = 0
    end_offset: FloatArray | None = None


@dataclass(frozen=True)
class Bvh:
    """A parsed file.

    Attributes:
        joints: In file order, root first.
        frame_time_s: As in the file, seconds.
        motion: Shape (N, C), a row a frame, a column a channel; file units and degrees.
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
        RecordingError: If the file is cut off or is not BVH; names the line.
    """
    lines = Lines(path, read_text(path, "a BVH file"))
    words = lines.next("HIERARCHY")
    if words[0].upper() != "HIERARCHY":
        raise lines.error(f"the file begins with {shown(' '.join(words))}", "HIERARCHY, as in a BVH file")
    joints = _Hierarchy(lines).read()
    count, frame_time_s = _motion_header(lines)
    channels = sum(len(joint.channels) for joint in joints)
    frames = lines.rest()
    motion = _frames(lines, frames, channels)
    if len(frames) != count:
        number = frames[-1][0] if frames else lines.number
        raise RecordingError(
            path, f"line {number}", f"the file ends after {len(frames)} frames", f"{count}, as 'Frames:' says"
        )
    labels = [f"{joint.name} {channel}" for joint in joints for channel in joint.channels]
    check_finite(path, motion, labels, lambda index: f"line {frames[index][0]}")
    return Bvh(joints, frame_time_s, motion)


class _Hierarchy:
    """The joints read so far and where in their tree the next line belongs."""

    def __init__(self, lines: Lines) -> None:
        self.joints: list[Joint] = []
        self._lines = lines
        self._open: list[int] = []  # indices; the last is the joint being described
        self._in_end_site = False
        self._channels = 0

    def read(self) -> list[Joint]:
        """Read up to and with the line MOTION."""
        readers = {
            "ROOT": self._root,
            "JOINT": self._joint,
            "END": self._end_site,
            "OFFSET": self._offset,
            "CHANNELS": self._joint_channels,
            "}": self._close,
        }
        while True:
            inside = f" (joint {self.joints[self._open[-1]].name!r} is open)" if self._open else ""
            words = self._lines.next(f"the rest of the hierarchy{inside}, then MOTION")
            keyword = words[0].upper()
            if keyword == "MOTION":
                if not self.joints or self._open:
                    problem = f"MOTION comes before the hierarchy is complete{inside}"
                    raise self._lines.error(problem, "one ROOT, all braces closed, then MOTION")
                return self.joints
            if keyword != "ROOT" and (keyword not in readers or not self._open):
                raise self._out_of_place(words)
            readers[keyword](words)

    def _out_of_place(self, words: list[str]) -> RecordingError:
        known = "one ROOT with JOINT, End Site, OFFSET, CHANNELS and braces in it, then MOTION"
        return self._lines.error(f"{shown(' '.join(words))} is out of place here", known)

    def _root(self, words: list[str]) -> None:
        if self.joints:
            raise self._out_of_place(words)
        self._add(words, -1)

    def _joint(self, words: list[str]) -> None:
        if self._in_end_site:
            raise self._out_of_place(words)
        self._add(words, self._open[-1])

    def _add(self, words: list[str], parent: int) -> None:
        self.joints.append(Joint(_name(self._lines, words), parent))
        _open_brace(self._lines, words)
        self._open.append(len(self.joints) - 1)

    def _end_site(self, words: list[str]) -> None:
        if self._in_end_site:
            raise self._out_of_place(words)
        _open_brace(self._lines, words)
        self._in_end_site = True

    def _offset(self, words: list[str]) -> None:
        joint, offset = self.joints[self._open[-1]], _offset(self._lines, words)
        if not self._in_end_site:
            joint.offset = offset
        elif joint.end_offset is None:  # of several end sites the first counts
            joint.end_offset = offset

    def _joint_channels(self, words: list[str]) -> None:
        joint = self.joints[self._open[-1]]
        if self._in_end_site or joint.channels:
            raise self._out_of_place(words)
        joint.channels, joint.first_channel = _channels(self._lines, words), self._channels
        self._channels += len(joint.channels)

    def _close(self, words: list[str]) -> None:
        if self._in_end_site:
            self._in_end_site = False
        else:
            self._open.pop()
        if len(words) > 1:
            self._lines.push_back(words[1:])


def _name(lines: Lines, words: list[str]) -> str:
    """Joint's name: all words up to a brace."""
    name = " ".join(word for word in words[1:] if word != "{")
    if not name:
        raise lines.error(f"{words[0]} without a name", f"{words[0]} and a joint's name")
    return name


def _open_brace(lines: Lines, words: list[str]) -> None:
    """Read the opening brace, on the same line or the next."""
    if words[-1] == "{":
        return
    following = lines.next("an opening brace")
    if following[0] != "{":
        raise lines.error(f"{shown(' '.join(following))} follows {shown(' '.join(words))}", "an opening brace")
    if len(following) > 1:
        lines.push_back(following[1:])


def _offset(lines: Lines, words: list[str]) -> FloatArray:
    """Three numbers of an OFFSET."""
    if len(words) != 4:
        raise lines.error(f"OFFSET with {len(words) - 1} values", "OFFSET and three numbers")
    offset = np.array([parse_number(lines.path, lines.number, word) for word in words[1:]])
    if not (np.abs(offset) <= _MAX_OFFSET).all():
        raise lines.error(f"OFFSET {' '.join(words[1:])}", "three finite numbers")
    return offset


def _channels(lines: Lines, words: list[str]) -> tuple[str, ...]:
    """Names of a joint's channels, spelt as in _CHANNELS."""
    expected = f"CHANNELS, their number and names out of {', '.join(_CHANNELS)}, each once"
    channels = tuple(_CHANNEL_OF_LOWER.get(word.lower(), "") for word in words[2:])
    count_is_right = len(words) > 1 and words[1] == str(len(channels))
    if not count_is_right or "" in channels or len(set(channels)) != len(channels):
        raise lines.error(f"{shown(' '.join(words), 80)}", expected)
    return channels


def _motion_header(lines: Lines) -> tuple[int, float]:
    """Number of frames and the time between two, seconds."""
    words = lines.next("Frames: and their number")
    if words[0].lower() != "frames:" or len(words) != 2 or not words[1].isdecimal() or len(words[1]) > 9:
        raise lines.error(f"{shown(' '.join(words))} after MOTION", "Frames: and their number")
    count = int(words[1])
    words = lines.next("Frame Time: and seconds")
    if [word.lower() for word in words[:2]] != ["frame", "time:"] or len(words) != 3:
        raise lines.error(f"{shown(' '.join(words))} after Frames:", "Frame Time: and seconds")
    frame_time_s = parse_number(lines.path, lines.number, words[2])
    if not (math.isfinite(frame_time_s) and frame_time_s > 0.0):
        raise lines.error(f"the frame time is {words[2]}", "a frame time above 0, in seconds")
    return count, frame_time_s


def _frames(lines: Lines, frames: list[tuple[int, list[str]]], channels: int) -> FloatArray:
    """Channel values of all frames, shape (N, C)."""
    motion = np.empty((len(frames), channels))
    for index, (number, words) in enumerate(frames):
        if len(words) != channels:
            raise RecordingError(
                lines.path,
                f"line {number}",
                f"{len(words)} values in frame {index + 1}",
                f"{channels} values, one for each channel",
            )
        try:
            motion[index] = [float(word) for word in words]
        except ValueError:
            motion[index] = [parse_number(lines.path, number, word) for word in words]
    return motion


Pose = tuple[Rotation, FloatArray]


def poses(bvh: Bvh, wanted: Iterable[int], frames: slice) -> dict[int, Pose]:
    """Forward kinematics of some joints and of all between them and the root.

    A position channel stands in the place of the same component of OFFSET, as in most programs.

    Args:
        bvh: The file.
        wanted: Indices of joints.
        frames: Which N frames.

    Returns:
        For each joint its rotation (N of them, joint to file axes) and position, shape (N, 3), file units.
    """
    needed: set[int] = set()
    for index in wanted:
        joint = index
        while joint >= 0 and joint not in needed:
            needed.add(joint)
            joint = bvh.joints[joint].parent
    motion = bvh.motion[frames]
    found: dict[int, Pose] = {}
    for index in sorted(needed):
        joint_here = bvh.joints[index]
        local = np.tile(joint_here.offset, (len(motion), 1))
        turn: Rotation | None = None
        for column, channel in enumerate(joint_here.channels, start=joint_here.first_channel):
            axis = channel[0].lower()
            if channel.endswith("position"):
                local[:, "xyz".index(axis)] = motion[:, column]
            else:
                step = Rotation.from_euler(axis, motion[:, column : column + 1], degrees=True)
                turn = step if turn is None else turn * step
        if turn is None:
            turn = Rotation.identity(len(motion))
        if joint_here.parent < 0:
            found[index] = (turn, local)
        else:
            parent_turn, parent_position = found[joint_here.parent]
            found[index] = (parent_turn * turn, parent_position + parent_turn.apply(local))
    return found
