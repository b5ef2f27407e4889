"""Skeleton of a BVH file: its head and hips, how it faces at rest, and where its joints are in motion."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError
from gazempc.recordings.readers.bvh_parse import Bvh, Joint
from gazempc.types import FloatArray

_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}
_TIP_WORDS = {"end", "top", "tip", "nub"}
# Exporters lay the rest pose along the file's axes; a direction nearer than 30 degrees to one is meant to be
# that axis (a neck leans forward, measured hips are not quite level).
_SNAP_COSINE = np.cos(np.radians(30.0))

Pose = tuple[Rotation, FloatArray]


def find_head(path: Path, joints: list[Joint], wanted: str | None) -> int:
    """Index of the head's joint: the wanted one, else the one named head.

    Raises:
        RecordingError: If there is none; lists the joints.
    """
    found = _wanted(path, joints, wanted, "bvh_head_joint")
    if found is None:
        found = _named(joints, ("head",))
    if found is None:
        raise RecordingError(
            path, "HIERARCHY", "no joint named Head", f"the option bvh_head_joint, one of {_names(joints)}"
        )
    return found


def find_hips(path: Path, joints: list[Joint], wanted: str | None) -> int:
    """Index of the hips' joint: the wanted one, else the one named hips, hip or pelvis, else the root.

    Raises:
        RecordingError: If the wanted one does not exist; lists the joints.
    """
    found = _wanted(path, joints, wanted, "bvh_hips_joint")
    if found is None:
        found = _named(joints, ("hips", "hip", "pelvis"))
    return 0 if found is None else found


def head_tip(joints: list[Joint], head: int) -> tuple[int, FloatArray]:
    """Point that stands for the head: the tip of its bone where the file has one, else the joint.

    Returns:
        A joint's index and the point's offset from it, shape (3,), file units.
    """
    end_offset = joints[head].end_offset
    if end_offset is not None:
        return head, end_offset
    for index, joint in enumerate(joints):
        if joint.parent == head and set(_words(joint.name)) & _TIP_WORDS:
            return index, np.zeros(3)
    return head, np.zeros(3)


def rest_positions(joints: list[Joint]) -> FloatArray:
    """Positions of all joints in the rest pose relative to the root, shape (J, 3), file units."""
    positions = np.zeros((len(joints), 3))
    for index, joint in enumerate(joints[1:], start=1):
        positions[index] = positions[joint.parent] + joint.offset
    return positions


def person_axes_in_rest(path: Path, joints: list[Joint], head: int, hips: int) -> FloatArray:
    """Person's forward, left and up axes in the file's axes, as the columns of a rotation, shape (3, 3).

    Up is from hips to head; left is the sum of the differences between all left joints and their right twins.

    Raises:
        RecordingError: If head and hips coincide or there are no left and right joints.
    """
    rest = rest_positions(joints)
    up = _along_axis(rest[head] - rest[hips])
    if up is None:
        raise RecordingError(path, "HIERARCHY", "head and hips coincide in the rest pose", "two places")
    sides: dict[tuple[str, ...], dict[str, int]] = {}
    for index, joint in enumerate(joints):
        side, twin = _side(joint.name)
        if side:
            sides.setdefault(twin, {}).setdefault(side, index)
    pairs = [(pair["left"], pair["right"]) for pair in sides.values() if len(pair) == 2]
    to_left = sum((rest[left] - rest[right] for left, right in pairs), np.zeros(3))
    left_axis = _along_axis(to_left - (to_left @ up) * up)
    if left_axis is None:
        raise RecordingError(
            path,
            "HIERARCHY",
            f"no pairs of left and right joints that tell where the person faces in {_names(joints)}",
            "joints such as LeftUpLeg and RightUpLeg, at the person's two sides",
        )
    left_axis -= (left_axis @ up) * up
    left_axis /= np.linalg.norm(left_axis)
    return np.column_stack([np.cross(left_axis, up), left_axis, up])


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


def _wanted(path: Path, joints: list[Joint], name: str | None, option: str) -> int | None:
    """Index of the joint a user named; None where nothing was named."""
    if name is None:
        return None
    exact = [index for index, joint in enumerate(joints) if joint.name == name]
    near = [index for index, joint in enumerate(joints) if _words(joint.name) == _words(name)]
    if exact or near:
        return (exact or near)[0]
    raise RecordingError(path, "HIERARCHY", f"no joint {name!r}", f"{option} as one of {_names(joints)}")


def _named(joints: list[Joint], names: tuple[str, ...]) -> int | None:
    """Joint of one of these names, or else one whose last word it is (Bip01 Head), but not of one side."""
    words = [_words(joint.name) for joint in joints]
    for name in names:
        for index, those in enumerate(words):
            if "".join(those) == name:
                return index
    for name in names:
        for index, those in enumerate(words):
            if those and those[-1] == name and not set(those) & set(_SIDES):
                return index
    return None


def _words(name: str) -> tuple[str, ...]:
    """Words of a joint's name in lower case, without prefixes such as ``mixamorig:``."""
    bare = re.sub(r"^mixamorig\d*", "", name.rpartition(":")[2].strip()) or name
    words = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+", bare)
    return tuple(word.lower() for word in words)


def _side(name: str) -> tuple[str, tuple[str, ...]]:
    """Side of a joint (left, right or nothing) and the rest of its name."""
    words = _words(name)
    for position, word in enumerate(words):
        if word in _SIDES:
            return _SIDES[word], words[:position] + words[position + 1 :]
        for side in ("left", "right"):
            if word.startswith(side):
                return side, (*words[:position], word[len(side) :], *words[position + 1 :])
    return "", words


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
