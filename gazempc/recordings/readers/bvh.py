"""Recordings from motion capture as BVH: head, hips, facing, up axis and unit by names, tree and motion of the joints.

The parser is our own: the one maintained library (bvhio 1.5.4) never returns on a file that is cut off and
reads numbers in single precision.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError
from gazempc.recordings.readers.bvh_parse import Bvh, Joint, Pose, parse_bvh, poses
from gazempc.recordings.readers.checks import (
    HEAD_TO_PELVIS_RANGE_M,
    check_frame_count,
    check_frame_interval,
    check_upright,
    median_head_to_pelvis_m,
)
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording, Track
from gazempc.types import FloatArray

_SIDES = {"left": "left", "l": "left", "lft": "left", "right": "right", "r": "right", "rgt": "right"}
# What exporters put before each name: Mixamo, and bones of Blender's Rigify.
_PREFIX = re.compile(r"^(mixamorig\d*|(DEF|ORG|MCH)-)")


def words(name: str) -> tuple[str, ...]:
    """Words of a joint's name in lower case, without prefixes such as ``mixamorig:``."""
    bare = _PREFIX.sub("", name.rpartition(":")[2].strip()) or name
    found = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+", bare)
    return tuple(word.lower() for word in found)


def named(joints: list[Joint], names: tuple[str, ...]) -> list[int]:
    """Joints of one of these names, or else those whose last word it is (Bip01 Head), but not of one side.

    Args:
        joints: All of them.
        names: In the order of preference.

    Returns:
        All that fit equally well, in file order; none where no name fits.
    """
    split = [words(joint.name) for joint in joints]
    for name in names:
        if found := [index for index, those in enumerate(split) if "".join(those) == name]:
            return found
    for name in names:
        found = [k for k, those in enumerate(split) if those and those[-1] == name and not set(those) & set(_SIDES)]
        if found:
            return found
    return []


def twins(joints: list[Joint]) -> list[tuple[int, int]]:
    """Pairs of a left joint and its right twin, as their names tell.

    Args:
        joints: All of them.

    Returns:
        Indices of left and right: of names with a word or a letter for the side (LeftUpLeg, lThigh, thigh.L), or else
        of names that differ in l and r at the beginning or the end (lfemur and rfemur, as CMU has them).
    """
    sides: dict[tuple[str, ...], dict[str, int]] = {}
    for index, joint in enumerate(joints):
        side, rest = _side(joint.name)
        if side:
            sides.setdefault(rest, {}).setdefault(side, index)
    pairs = [(pair["left"], pair["right"]) for pair in sides.values() if len(pair) == 2]
    return pairs or _by_letter("".join(words(joint.name)) for joint in joints)


def _side(name: str) -> tuple[str, tuple[str, ...]]:
    """Side of a joint (left, right or nothing) and the rest of its name."""
    those = words(name)
    for position, word in enumerate(those):
        if word in _SIDES:
            return _SIDES[word], those[:position] + those[position + 1 :]
        for side in ("left", "right"):
            if word.startswith(side):
                return side, (*those[:position], word[len(side) :], *those[position + 1 :])
    return "", those


def _by_letter(names: Iterable[str]) -> list[tuple[int, int]]:
    place = {name: index for index, name in enumerate(names)}
    pairs = []
    for name, left in place.items():
        for mine, other in ((name[:1], f"r{name[1:]}"), (name[-1:], f"{name[:-1]}r")):
            if mine == "l" and other in place:
                pairs.append((left, place[other]))
                break
    return pairs


# Bones of two sides differ by less, leaves of one head are nearer to each other.
_ALIKE = 0.15
# The two sides are farther apart than this share of their bones' length.
_APART = 0.05
# A leg is longer than this share of the way from hips to head.
_LEGS = 0.5
# Of the height without feet and crown, people's hips are at 0.5 to 0.6.
_HIPS_AT = (0.4, 0.7)
# A foot points forward: so much of its length lies across up.
_FOOT_ACROSS = 0.4
Pairs = list[tuple[int, int]]


def rest_positions(joints: list[Joint]) -> FloatArray:
    """Positions of all joints in the rest pose relative to the root, shape (J, 3), file units."""
    positions = np.zeros((len(joints), 3))
    for index, joint in enumerate(joints[1:], start=1):
        positions[index] = positions[joint.parent] + joint.offset
    return positions


def mirrored(joints: list[Joint]) -> Pairs:
    """Pairs of joints that grow from one joint alike, to two sides; which is left is not known yet.

    Args:
        joints: All of them.

    Returns:
        Indices; what grows on the two joints of a pair comes after it, in the same order.
    """
    children = _children(joints)
    shapes: list[tuple[object, ...]] = [()] * len(joints)
    for index in reversed(range(len(joints))):
        shapes[index] = tuple(shapes[child] for child in children[index])
    pairs: Pairs = []
    of_sides: set[int] = set()
    for index, grown in enumerate(children):
        # Two fingers are alike, too.
        if index in of_sides:
            continue
        for k, one in enumerate(grown):
            for other in grown[k + 1 :]:
                if shapes[one] == shapes[other] and _like_mirror(joints, children, one, other):
                    pairs += _together(children, one, other)
        of_sides = {index for pair in pairs for index in pair}
    return pairs


def middle_leaf(joints: list[Joint], pairs: Pairs) -> list[int]:
    """The joint at the far end of the middle of the body, which is the head of a figure that stands on two sides.

    Args:
        joints: All of them.
        pairs: Of `mirrored`, or of names.

    Returns:
        One joint; several where they are as likely; none where there are no sides.
    """
    if not pairs:
        return []
    of_sides = {index for pair in pairs for index in pair}
    children = _children(joints)
    length = np.zeros(len(joints))
    middle = np.ones(len(joints), dtype=np.bool_)
    for index, joint in enumerate(joints):
        if joint.parent >= 0:
            length[index] = length[joint.parent] + np.linalg.norm(joint.offset)
            middle[index] = middle[joint.parent] and index not in of_sides
    leaves = [k for k in range(len(joints)) if middle[k] and not any(middle[child] for child in children[k])]
    far = max(length[leaf] for leaf in leaves)
    ends = [leaf for leaf in leaves if length[leaf] > (1.0 - _ALIKE) * far]
    if far == 0.0:
        return []
    # Jaw and crown grow on the head; ends that part far below it are two heads.
    parting = common_ancestor(joints, ends)
    return [parting] if length[parting] > (1.0 - 2 * _ALIKE) * far else ends


def common_ancestor(joints: list[Joint], of: list[int]) -> int:
    """The last joint that all of some joints grow on, or are.

    Args:
        joints: All of them.
        of: Indices, at least one.

    Returns:
        Its index.
    """
    ways = [way_to_root(joints, index) for index in of]
    return next(index for index in ways[0] if all(index in way for way in ways))


def way_to_root(joints: list[Joint], index: int) -> list[int]:
    """A joint and all that it grows on, up to the root."""
    way = [index]
    while joints[way[-1]].parent >= 0:
        way.append(joints[way[-1]].parent)
    return way


def feet(joints: list[Joint], pairs: Pairs, hips: int, to_head: FloatArray) -> FloatArray | None:
    """Where the feet point in the rest pose, if the person stands in it.

    Args:
        joints: All of them.
        pairs: Joints of two sides.
        hips: Index of the hips.
        to_head: From hips to head, shape (3,), file units.

    Returns:
        Across up, shape (3,), file units; None where no feet are told.
    """
    rest, trunk = rest_positions(joints), float(np.linalg.norm(to_head))
    up = to_head / trunk
    below = [float((rest[a] + rest[b] - 2.0 * rest[hips]) @ up) / 2.0 for a, b in pairs]
    # Some rest poses have their legs folded up: they say nothing of how a person stands.
    if not pairs or min(below) > -_LEGS * trunk:
        return None
    ahead, length = np.zeros(3), 0.0
    for index in pairs[int(np.argmin(below))]:
        # The last bone is the foot's or the toes', and so is the one before it if it lies across up.
        for bone in (joints[index].offset, joints[index].end_offset):
            if bone is None or not bone.any():
                continue
            across = bone - (bone @ up) * up
            if np.linalg.norm(across) > _FOOT_ACROSS * np.linalg.norm(bone):
                ahead += across
                length += float(np.linalg.norm(across))
    # Feet that point to two sides point nowhere.
    return ahead if length and np.linalg.norm(ahead) > 0.5 * length else None


def stands(joints: list[Joint], hips: int, up: FloatArray) -> bool:
    """Whether the rest pose is one of a person who stands: the hips at about half the height.

    Args:
        joints: All of them.
        hips: Index of the hips.
        up: Unit vector in the file's axes, shape (3,).

    Returns:
        True if so.
    """
    heights = rest_positions(joints) @ up
    share = (heights[hips] - heights.min()) / max(float(np.ptp(heights)), 1e-9)
    return bool(_HIPS_AT[0] < share < _HIPS_AT[1])


def _children(joints: list[Joint]) -> list[list[int]]:
    children: list[list[int]] = [[] for _ in joints]
    for index, joint in enumerate(joints):
        if joint.parent >= 0:
            children[joint.parent].append(index)
    return children


def _like_mirror(joints: list[Joint], children: list[list[int]], one: int, other: int) -> bool:
    """Whether two branches are of the same lengths and go to two sides."""
    lengths = np.array([[np.linalg.norm(joints[k].offset) for k in pair] for pair in _together(children, one, other)])
    alike = np.abs(lengths[:, 0] - lengths[:, 1]) <= _ALIKE * lengths.max(axis=1) + 1e-9
    rest = rest_positions(joints)
    apart = max(float(np.linalg.norm(rest[a] - rest[b])) for a, b in _together(children, one, other))
    return bool(alike.all()) and apart > _APART * float(lengths.sum()) / 2


def _together(children: list[list[int]], one: int, other: int) -> Pairs:
    pairs = [(one, other)]
    for a, b in zip(children[one], children[other], strict=True):
        pairs += _together(children, a, b)
    return pairs


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


_UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "CMU's ASF unit": 0.0254 / 0.45}
_STANDING_HEIGHT_RANGE_M = (1.3, 2.1)
_HEIGHT_SAMPLES = 12
_MIN_UP_COSINE = 0.85  # people lean less than 30 degrees when they walk


@dataclass(frozen=True)
class Scale:
    """Metres per unit of a file, and words for people."""

    unit_m: float
    said: str


def up_axis(path: Path, wanted: str | None, head_position: FloatArray, hips_position: FloatArray) -> FloatArray:
    """Unit vector of the file's axis that points up, shape (3,).

    It is where the head is from the hips in the motion, not in the rest pose. Some files keep their skeleton along
    another axis and turn it upright in every frame.
    """
    axis = np.zeros(3)
    if wanted is not None:
        axis["xyz".index(wanted)] = 1.0
        return axis
    to_head = np.mean(head_position - hips_position, axis=0)
    length = float(np.linalg.norm(to_head))
    largest = int(np.argmax(np.abs(to_head)))
    if abs(to_head[largest]) < _MIN_UP_COSINE * length or length == 0.0:
        raise RecordingError(
            path,
            "MOTION",
            f"no axis points up: from hips to head is ({', '.join(f'{x:.3g}' for x in to_head)}) in the mean",
            "an upright person, or the option bvh_up_axis (y or z)",
        )
    axis[largest] = np.sign(to_head[largest])
    return axis


def scale_of(path: Path, bvh: Bvh, hips: int, up: FloatArray, rest_up: FloatArray, wanted_m: float | None) -> Scale:
    """Metres per file unit, from the person's height in the motion or, if that fits none, the rest pose.

    Args:
        path: File, for messages.
        bvh: The file.
        hips: Index of the hips.
        up: The file's axis that points up in the motion, shape (3,).
        rest_up: The same in the rest pose.
        wanted_m: What the user says; None: inferred.

    Returns:
        The scale.

    Raises:
        RecordingError: If no unit makes the person as high as people are, or motion and rest pose disagree.
    """
    heights = _heights(bvh, up, rest_up)
    said = f"{heights[0]:.4g} units high ({heights[1]:.4g} in the rest pose)"
    if wanted_m is not None:
        return Scale(wanted_m, f"unit {wanted_m:.6g} m as said ({heights[0] * wanted_m:.2f} m high)")
    low_m, high_m = _STANDING_HEIGHT_RANGE_M
    fitting = [
        next((name for name, unit_m in _UNITS_M.items() if low_m <= height * unit_m <= high_m), None)
        for height in heights
    ]
    candidates = ", ".join(f"{name} ({unit_m:.6g})" for name, unit_m in _UNITS_M.items())
    # A rest pose that does not stand has no height.
    if None not in fitting and fitting[0] != fitting[1] and stands(bvh.joints, hips, rest_up):
        problem = f"the person is {said}: {fitting[0]} by the motion, {fitting[1]} by the rest pose"
        raise RecordingError(path, "HIERARCHY", problem, f"the option bvh_unit_m, one of {candidates}")
    name = fitting[0] or fitting[1]
    if name is None:
        raise RecordingError(
            path,
            "HIERARCHY",
            f"the person is {said}, in no known unit {low_m:g} to {high_m:g} m",
            f"one of the units {candidates}, or the option bvh_unit_m",
        )
    height = heights[0] if fitting[0] else heights[1]
    return Scale(_UNITS_M[name], f"unit {name} ({height * _UNITS_M[name]:.2f} m high)")


def _heights(bvh: Bvh, up: FloatArray, rest_up: FloatArray) -> tuple[float, float]:
    """Height of the person in the motion (median) and in the rest pose, file units."""
    rest = rest_positions(bvh.joints)
    ends = {index: joint.end_offset for index, joint in enumerate(bvh.joints) if joint.end_offset is not None}
    sampled = poses(bvh, range(len(bvh.joints)), slice(None, None, max(1, len(bvh.motion) // _HEIGHT_SAMPLES)))
    in_motion = [position for _, position in sampled.values()]
    in_motion += [sampled[index][1] + sampled[index][0].apply(offset) for index, offset in ends.items()]
    in_rest = np.vstack([rest, *(rest[index] + offset for index, offset in ends.items())])
    return float(np.median(np.ptp(np.array(in_motion) @ up, axis=0))), float(np.ptp(in_rest @ rest_up))


def check_size(path: Path, truth: Track, unit_m: float) -> None:
    """Refuse a skeleton that is no person's, or a wrong unit that the user gave."""
    distance_m = median_head_to_pelvis_m(truth.head_position_m, truth.pelvis_position_m)
    low_m, high_m = HEAD_TO_PELVIS_RANGE_M
    if not low_m <= distance_m <= high_m:
        raise RecordingError(
            path,
            "positions",
            f"the head is {distance_m:.4g} m from the hips (median) with {unit_m:.6g} m a unit",
            f"{low_m:g} to {high_m:g} m; the options bvh_unit_m, bvh_head_joint and bvh_hips_joint change it",
        )


_REST_FRAME_JUMP_DEG = 30.0


def read_bvh(path: Path, options: ReadOptions) -> Recording:
    """Read a BVH file.

    The head is the tip of the head's bone where the file has one. Orientations are those of the joints'
    bones, so that in the rest pose head and hips face where the person faces. A first frame that only shows
    the rest pose (common in conversions of the CMU database) is left out.

    Args:
        path: File to read.
        options: Unit, frame rate, head and hips joints, facing and up axis, where what is inferred is wrong.

    Returns:
        The recording; time starts at 0. Its notes say in one line what was inferred.

    Raises:
        RecordingError: If the file is damaged, or head, facing, unit or up axis is in doubt; names the option that
            decides.
    """
    bvh, note = _without_rest_frame(parse_bvh(path))
    count = len(bvh.motion)
    check_frame_count(path, count)
    skeleton = find_skeleton(path, bvh.joints, options.bvh_head_joint, options.bvh_hips_joint)
    head, hips = skeleton.head, skeleton.hips
    tip, tip_offset = head_tip(bvh.joints, head)
    pose_of = poses(bvh, {head, hips, tip}, slice(None))
    head_position = pose_of[tip][1] + pose_of[tip][0].apply(tip_offset)
    hips_position = pose_of[hips][1]
    way = _way(pose_of[hips], np.linalg.norm(head_position - hips_position, axis=1))
    person_axes, told = person_axes_in_rest(path, bvh.joints, skeleton, options.bvh_facing, way)
    up = up_axis(path, options.bvh_up_axis, head_position, hips_position)
    scale = scale_of(path, bvh, hips, up, person_axes[:, 2], options.bvh_unit_m)
    out_from_file = _out_from_file(up)
    truth = Track(
        head_position_m=np.asarray(head_position @ out_from_file.T * scale.unit_m),
        head_quat_wxyz=_quat_wxyz(out_from_file, pose_of[head][0], person_axes),
        pelvis_position_m=np.asarray(hips_position @ out_from_file.T * scale.unit_m),
        pelvis_quat_wxyz=_quat_wxyz(out_from_file, pose_of[hips][0], person_axes),
        valid=np.ones(count, dtype=np.bool_),
    )
    rate_hz = options.bvh_frame_rate_hz
    times_s = np.arange(count, dtype=np.float64) * (bvh.frame_time_s if rate_hz is None else 1.0 / rate_hz)
    check_frame_interval(path, times_s)
    check_size(path, truth, scale.unit_m)
    check_upright(path, truth.head_position_m, truth.pelvis_position_m, "the option bvh_up_axis")
    labels = labels_for(path, times_s, truth.pelvis_position_m)
    point = "tip of its bone" if tip != head or tip_offset.any() else "the joint"
    inferred = (
        f"read as: {scale.said}, {direction(up)} up, head {bvh.joints[head].name} "
        f"({', '.join(filter(None, (point, skeleton.how)))}), hips {bvh.joints[hips].name}, "
        f"facing {direction(person_axes[:, 0])} at rest ({told}), {1.0 / np.diff(times_s[:2])[0]:.4g} frames a second; "
        "the options bvh_unit_m, bvh_up_axis, bvh_head_joint, bvh_hips_joint, bvh_facing, bvh_frame_rate_hz change it"
    )
    return Recording(
        name=path.stem,
        source=str(path),
        kind="motion capture",
        times_s=times_s,
        truth=truth,
        measured=None,
        has_robot=False,
        labels=replace(labels, description="; ".join(filter(None, (labels.description, note)))),
        notes=(inferred,),
    )


def _way(hips: Pose, size: FloatArray) -> FloatArray | None:
    """Direction of travel as the hips see it, in the rest pose's axes, shape (3,); None for who stays where they are.

    Args:
        hips: Their N rotations and positions.
        size: From hips to head, shape (N,), file units: a walk is longer than that.
    """
    turns, positions = hips
    way = turns[:-1].inv().apply(np.diff(positions, axis=0)).sum(axis=0)
    return way if np.linalg.norm(way) > np.median(size) else None


def _without_rest_frame(bvh: Bvh) -> tuple[Bvh, str]:
    """Leave out a first frame in the rest pose, told by rotations of exactly 0 and a leap to the second.

    Returns:
        The file and a note for its description, empty where nothing was left out.
    """
    is_rotation = np.array([channel.endswith("rotation") for joint in bvh.joints for channel in joint.channels])
    if len(bvh.motion) < 2 or not is_rotation.any() or bvh.motion[0, is_rotation].any():
        return bvh, ""
    leap_deg = np.abs((bvh.motion[1, is_rotation] + 180.0) % 360.0 - 180.0).max()
    if leap_deg <= _REST_FRAME_JUMP_DEG:
        return bvh, ""
    return replace(bvh, motion=bvh.motion[1:]), "first frame (rest pose) left out"


def _out_from_file(up: FloatArray) -> FloatArray:
    """Rotation from the file's axes to ones with z up, shape (3, 3); with y up, z becomes x."""
    forward = np.roll(np.abs(up), 1)
    return np.vstack([forward, np.cross(up, forward), up])


def _quat_wxyz(out_from_file: FloatArray, file_from_joint: Rotation, person_axes: FloatArray) -> FloatArray:
    """Orientation of a joint's person axes in the output frame, shape (N, 4)."""
    turned = Rotation.from_matrix(out_from_file) * file_from_joint * Rotation.from_matrix(person_axes)
    return np.asarray(turned.as_quat()[:, [3, 0, 1, 2]])
