"""Skeleton of a BVH file: its head and hips, and how it faces at rest; by its names, else by its tree."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from gazempc.errors import RecordingError
from gazempc.recordings.readers.bvh_names import named, twins, words
from gazempc.recordings.readers.bvh_parse import Joint
from gazempc.recordings.readers.bvh_tree import (
    Pairs,
    common_ancestor,
    feet,
    middle_leaf,
    mirrored,
    rest_positions,
    way_to_root,
)
from gazempc.types import FloatArray

Direction = Literal["x", "-x", "y", "-y", "z", "-z"]

_TIP_WORDS = {"end", "top", "tip", "nub"}
# Exporters lay the rest pose along the file's axes; a direction nearer than 30 degrees to one is meant to be
# that axis (a neck leans forward, measured hips are not quite level).
_SNAP_COSINE = np.cos(np.radians(30.0))
# Feet that point more than 120 degrees away from where the names say that the person faces contradict them.
_CONTRADICTION = -0.5


@dataclass(frozen=True)
class Skeleton:
    """What was found in a hierarchy.

    Attributes:
        head: Index of the head's joint.
        hips: Index of the hips' joint.
        pairs: Joints of the two sides; left and right where `sides_named`.
        sides_named: Whether names tell which is left.
        how: How the head was found, for people; empty for by its name.
    """

    head: int
    hips: int
    pairs: Pairs
    sides_named: bool
    how: str


def find_skeleton(path: Path, joints: list[Joint], wanted_head: str | None, wanted_hips: str | None) -> Skeleton:
    """Find head, hips and sides.

    Args:
        path: File, for messages.
        joints: All of them.
        wanted_head: Name of the head's joint; None: found by name, else at the far end of the middle of the body.
        wanted_hips: Name of the hips' joint; None: found by name, else where the legs part.

    Returns:
        The skeleton.

    Raises:
        RecordingError: If there is no such joint, or several are as likely; lists the joints and names the option.
    """
    by_name = twins(joints)
    pairs = by_name or mirrored(joints)
    head, how = _wanted(path, joints, wanted_head, "bvh_head_joint"), ""
    if head is None:
        found = _outermost(joints, named(joints, ("head",)))
        if not found:
            found, how = middle_leaf(joints, pairs), "the far end of the middle of the body"
        if len(found) != 1:
            problem = (
                f"{_names([joints[k] for k in found])} may be the head" if found else "no joint that may be the head"
            )
            raise RecordingError(path, "HIERARCHY", problem, f"the option bvh_head_joint, one of {_names(joints)}")
        head = found[0]
    hips = _wanted(path, joints, wanted_hips, "bvh_hips_joint")
    if hips is None:
        found = named(joints, ("hips", "hip", "pelvis"))
        hips = found[0] if found else _parting(joints, pairs, head)
    return Skeleton(head, hips, pairs, bool(by_name), how)


def head_tip(joints: list[Joint], head: int) -> tuple[int, FloatArray]:
    """Point that stands for the head: the tip of its bone where the file has one, else the joint.

    Returns:
        A joint's index and the point's offset from it, shape (3,), file units.
    """
    end_offset = joints[head].end_offset
    if end_offset is not None:
        return head, end_offset
    for index, joint in enumerate(joints):
        if joint.parent == head and set(words(joint.name)) & _TIP_WORDS:
            return index, np.zeros(3)
    return head, np.zeros(3)


def person_axes_in_rest(
    path: Path, joints: list[Joint], skeleton: Skeleton, wanted: Direction | None, way: FloatArray | None
) -> tuple[FloatArray, str]:
    """Person's forward, left and up axes in the file's axes, and what told where forward is.

    Up is from hips to head. Left is the sum of the differences between all left joints and their right twins. Where
    names do not tell left from right, feet point forward, else people walk forward.

    Args:
        path: File, for messages.
        joints: All of them.
        skeleton: Head, hips and sides.
        wanted: Axis of the rest pose that the person faces, as the user says; None: inferred.
        way: Direction of travel in the rest pose's axes, shape (3,); None without a walk.

    Returns:
        The axes as the columns of a rotation, shape (3, 3); and words for people.

    Raises:
        RecordingError: If head and hips coincide, or nothing tells where the person faces, or two things contradict.
    """
    rest = rest_positions(joints)
    up = _along_axis(rest[skeleton.head] - rest[skeleton.hips])
    if up is None:
        raise RecordingError(path, "HIERARCHY", "head and hips coincide in the rest pose", "two places")
    feet_ahead = feet(joints, skeleton.pairs, skeleton.hips, rest[skeleton.head] - rest[skeleton.hips])
    if wanted is not None:
        ahead, told = np.zeros(3), "as bvh_facing says"
        ahead["xyz".index(wanted[-1])] = -1.0 if wanted.startswith("-") else 1.0
        return _axes(path, ahead, up), told
    to_left = sum((rest[left] - rest[right] for left, right in skeleton.pairs), np.zeros(3))
    left = _along_axis(to_left - (to_left @ up) * up)
    by_sides = None if left is None else np.cross(left, up)
    if skeleton.sides_named and by_sides is not None:
        if feet_ahead is not None and feet_ahead @ by_sides < _CONTRADICTION * np.linalg.norm(feet_ahead):
            raise RecordingError(
                path,
                "HIERARCHY",
                f"left and right joints say that the person faces {direction(by_sides)} in the rest pose, feet say "
                f"{direction(feet_ahead)}",
                "the option bvh_facing (x, -x, y, -y, z or -z)",
            )
        return _axes(path, by_sides, up), "by left and right joints"
    for hint, told in ((feet_ahead, "by the feet"), (way, "by the way they walk")):
        if hint is None:
            continue
        # The line between the sides says it better, but not which way.
        ahead = hint if by_sides is None else by_sides * np.sign(hint @ by_sides)
        return _axes(path, ahead, up), told
    raise RecordingError(
        path,
        "HIERARCHY",
        f"no pairs of left and right joints, no feet and no way tell where the person faces in {_names(joints)}",
        "joints such as LeftUpLeg and RightUpLeg at the person's two sides, or the option bvh_facing "
        "(x, -x, y, -y, z or -z)",
    )


def direction(vector: FloatArray) -> str:
    """The axis that a direction is nearest to, such as ``-z``."""
    largest = int(np.argmax(np.abs(vector)))
    return f"{'-' if vector[largest] < 0 else ''}{'xyz'[largest]}"


def _axes(path: Path, ahead: FloatArray, up: FloatArray) -> FloatArray:
    forward = _along_axis(ahead - (ahead @ up) * up)
    if forward is None:
        raise RecordingError(
            path, "HIERARCHY", f"the person faces {direction(up)}, where the head is", "another axis: bvh_facing"
        )
    forward -= (forward @ up) * up
    forward /= np.linalg.norm(forward)
    return np.column_stack([forward, np.cross(up, forward), up])


def _parting(joints: list[Joint], pairs: Pairs, head: int) -> int:
    """Where the legs part: the first joint up from the feet that head and both legs grow on; else the root."""
    rest = rest_positions(joints)
    away = rest - rest[head]
    lowest = max(pairs, key=lambda pair: float(np.linalg.norm(away[pair[0]] + away[pair[1]])), default=None)
    return 0 if lowest is None else common_ancestor(joints, [*lowest, head])


def _outermost(joints: list[Joint], found: list[int]) -> list[int]:
    """Those that do not grow on another one of them."""
    return [k for k in found if not set(way_to_root(joints, k)[1:]) & set(found)]


def _wanted(path: Path, joints: list[Joint], name: str | None, option: str) -> int | None:
    """Index of the joint a user named; None where nothing was named."""
    if name is None:
        return None
    exact = [index for index, joint in enumerate(joints) if joint.name == name]
    near = [index for index, joint in enumerate(joints) if words(joint.name) == words(name)]
    if exact or near:
        return (exact or near)[0]
    raise RecordingError(path, "HIERARCHY", f"no joint {name!r}", f"{option} as one of {_names(joints)}")


def _along_axis(direction: FloatArray) -> FloatArray | None:
    """Unit vector along a direction, or along the file's axis that it nearly has; None for no direction."""
    length = float(np.linalg.norm(direction))
    if length < 1e-9:
        return None
    unit = direction / length
    largest = int(np.argmax(np.abs(unit)))
    if abs(unit[largest]) < _SNAP_COSINE:
        return np.asarray(unit)
    axis = np.zeros(3)
    axis[largest] = np.sign(unit[largest])
    return axis


def _names(joints: list[Joint]) -> str:
    return ", ".join(joint.name for joint in joints)
