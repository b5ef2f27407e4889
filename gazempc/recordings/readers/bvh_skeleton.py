"""Skeleton of a BVH file: head, hips, two sides and facing at rest, by the names of the joints, else by their tree."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from gazempc.errors import RecordingError
from gazempc.recordings.readers.bvh_parse import Joint, to_root
from gazempc.types import FloatArray

Pairs = list[tuple[int, int]]
_SIDES = {"left": "left", "l": "left", "lft": "left", "right": "right", "r": "right", "rgt": "right"}
# Exporters' prefixes of names: Mixamo, and bones of Blender's Rigify.
_PREFIX = re.compile(r"^(mixamorig\d*|(DEF|ORG|MCH)-)")
_TIP_WORDS = {"end", "top", "tip", "nub"}
# Rest poses are aligned with the file's axes; a direction within 30 degrees of one is snapped to it (necks lean
# forward, measured hips are not quite level).
_SNAP_COSINE = np.cos(np.radians(30.0))
# Largest relative difference in distance from the root between ends of one head (jaw and crown).
_SAME_HEAD = 0.15
# Tolerance of mirror symmetry, relative to the size of the skeleton.
_MIRROR_TOLERANCE = 0.02
# Minimum length of standing legs, relative to the distance from hips to head.
_LEGS = 0.5
# Range of the hips' height relative to a standing skeleton's; people's is 0.5 to 0.6.
_HIPS_RANGE = (0.4, 0.7)
# Minimum horizontal share of a foot's length.
_FOOT_ACROSS = 0.4
# Feet more than 120 degrees from the facing by names contradict it.
_CONTRADICTION = -0.5


@dataclass(frozen=True)
class Skeleton:
    """Relevant joints of a hierarchy.

    Attributes:
        head: Index of the head's joint.
        hips: Index of the hips' joint.
        pairs: Joints of the two sides; left and right where `sides_named`.
        sides_named: Whether names distinguish left from right.
        head_by: How the head was found if not by name; else empty.
    """

    head: int
    hips: int
    pairs: Pairs
    sides_named: bool
    head_by: str


def find_skeleton(path: Path, joints: list[Joint], wanted_head: str | None, wanted_hips: str | None) -> Skeleton:
    """Find head, hips and sides.

    Args:
        path: File, for messages.
        joints: All joints.
        wanted_head: Name of the head's joint; None: by name, else the far end of the central chain.
        wanted_hips: Name of the hips' joint; None: by name, else the common ancestor of the legs, else the root.

    Returns:
        The skeleton.

    Raises:
        RecordingError: If there is no such joint, or several are equally plausible; names the option.
    """
    by_name = _pairs(joints)
    pairs, head_by = by_name or _mirrored(joints), ""
    named = _named(joints, ("head",))
    heads = _wanted(path, joints, wanted_head, "bvh_head_joint")
    heads = heads or [k for k in named if not set(to_root(joints, k)[1:]) & set(named)]
    if not heads:
        heads, head_by = _middle_end(joints, pairs), "far end of the central chain"
    if len(heads) != 1:
        problem = f"several candidates for the head: {_names(joints, heads)}" if heads else "no candidate for the head"
        raise RecordingError(path, "HIERARCHY", problem, f"the option bvh_head_joint, one of {_names(joints)}")
    hips = _wanted(path, joints, wanted_hips, "bvh_hips_joint") or _named(joints, ("hips", "hip", "pelvis"))
    return Skeleton(heads[0], (hips or [_parting(joints, pairs, heads[0])])[0], pairs, bool(by_name), head_by)


def head_tip(joints: list[Joint], head: int) -> tuple[int, FloatArray]:
    """Tip of the head's bone where the file has one, else the joint: an index and the offset from it, shape (3,)."""
    end_offset = joints[head].end_offset
    if end_offset is not None:
        return head, end_offset
    tips = [k for k, joint in enumerate(joints) if joint.parent == head and set(_words(joint.name)) & _TIP_WORDS]
    return (tips or [head])[0], np.zeros(3)


def rest_positions(joints: list[Joint]) -> FloatArray:
    """Positions of all joints in the rest pose relative to the root, shape (J, 3), file units."""
    return np.array([joint.rest for joint in joints])


def stands_at_rest(joints: list[Joint], hips: int, up: FloatArray) -> bool:
    """Whether the rest pose stands: hips at about half the height along a unit vector in the file's axes."""
    heights = rest_positions(joints) @ up
    share = (heights[hips] - heights.min()) / max(float(np.ptp(heights)), 1e-9)
    return bool(_HIPS_RANGE[0] < share < _HIPS_RANGE[1])


def person_axes(
    path: Path, joints: list[Joint], skeleton: Skeleton, wanted: str | None, travel: FloatArray | None
) -> tuple[FloatArray, str]:
    """Person's forward, left and up axes in the rest pose.

    Up is from hips to head. Left is the sum of the differences between all left joints and their right twins. Where
    names do not distinguish left from right, feet point forward, else people walk forward.

    Args:
        path: File, for messages.
        joints: All joints.
        skeleton: Head, hips and sides.
        wanted: Axis that the person faces at rest; None: inferred.
        travel: Direction of travel in the rest pose's axes, shape (3,); None without a walk.

    Returns:
        The axes as columns of a rotation, shape (3, 3), in the file's axes; and their origin in words.

    Raises:
        RecordingError: If head and hips coincide, or the facing is unknown or contradictory; names the option.
    """
    rest, option = rest_positions(joints), "the option bvh_facing (x, -x, y, -y, z or -z)"
    to_head = rest[skeleton.head] - rest[skeleton.hips]
    up = _along_axis(to_head)
    if up is None:
        raise RecordingError(path, "HIERARCHY", "head and hips coincide in the rest pose", "two places")
    to_left = sum((rest[left] - rest[right] for left, right in skeleton.pairs), np.zeros(3))
    left = _along_axis(to_left - (to_left @ up) * up)
    by_sides = None if left is None else np.cross(left, up)
    feet = _feet(joints, skeleton, to_head)
    hint, by = (travel, "by the direction of travel") if feet is None else (feet, "by the feet")
    if wanted is not None:
        ahead, by = (-1.0 if wanted[0] == "-" else 1.0) * np.eye(3)["xyz".index(wanted[-1])], "by bvh_facing"
    elif by_sides is not None and skeleton.sides_named:
        ahead, by = by_sides, "by left and right joints"
        if feet is not None and feet @ by_sides < _CONTRADICTION * np.linalg.norm(feet):
            facings = f"{axis_name(by_sides)} at rest {by}, but {axis_name(feet)} by the feet"
            raise RecordingError(path, "HIERARCHY", f"the person faces {facings}", option)
    elif hint is not None:
        # The line between the sides is more precise, but has two directions.
        ahead = hint if by_sides is None else by_sides * np.sign(hint @ by_sides)
    else:
        problem = f"no pairs of left and right joints, no feet and no walk determine the facing in {_names(joints)}"
        expected = f"joints such as LeftUpLeg and RightUpLeg at the person's two sides, or {option}"
        raise RecordingError(path, "HIERARCHY", problem, expected)
    forward = _along_axis(ahead - (ahead @ up) * up)
    if forward is None:
        problem = f"the facing {axis_name(up)} is the direction of the head"
        raise RecordingError(path, "HIERARCHY", problem, f"another axis: {option}")
    forward -= (forward @ up) * up
    forward /= np.linalg.norm(forward)
    return np.column_stack([forward, np.cross(up, forward), up]), by


def axis_name(vector: FloatArray) -> str:
    """The axis that a direction is nearest to, such as ``-z``."""
    largest = int(np.argmax(np.abs(vector)))
    return f"{'-' if vector[largest] < 0 else ''}{'xyz'[largest]}"


def _pairs(joints: list[Joint]) -> Pairs:
    """Pairs of a left joint and its right twin, by their names.

    Names have a word or a letter for the side (LeftUpLeg, lThigh, thigh.L), or else differ in l and r at the beginning
    or the end (lfemur and rfemur, as CMU has them).
    """
    sides: dict[tuple[str, ...], dict[str, int]] = {}
    for index, joint in enumerate(joints):
        side, rest = _side(_words(joint.name))
        sides.setdefault(rest, {}).setdefault(side, index)
    pairs = [(pair["left"], pair["right"]) for pair in sides.values() if pair.keys() >= {"left", "right"}]
    place = {"".join(_words(joint.name)): index for index, joint in enumerate(joints)}
    by_letter = {
        (left, place[twin])
        for name, left in place.items()
        for letter, twin in ((name[:1], f"r{name[1:]}"), (name[-1:], f"{name[:-1]}r"))
        if letter == "l" and twin in place
    }
    return pairs or sorted(by_letter)


def _side(words: tuple[str, ...]) -> tuple[str, tuple[str, ...]]:
    """Side of a joint (left, right or nothing) and the other words of its name."""
    for k, word in enumerate(words):
        if word in _SIDES:
            return _SIDES[word], words[:k] + words[k + 1 :]
        for side in ("left", "right"):
            if word.startswith(side):
                return side, (*words[:k], word[len(side) :], *words[k + 1 :])
    return "", words


def _words(name: str) -> tuple[str, ...]:
    """Words of a joint's name in lower case, without prefixes such as ``mixamorig:``."""
    bare = _PREFIX.sub("", name.rpartition(":")[2].strip()) or name
    return tuple(word.lower() for word in re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+", bare))


def _named(joints: list[Joint], names: tuple[str, ...]) -> list[int]:
    """Joints with one of these names, else with it as last word (Bip01 Head) and of neither side."""
    split = [_words(joint.name) for joint in joints]
    whole = [[k for k, those in enumerate(split) if "".join(those) == name] for name in names]
    last = [
        [k for k, those in enumerate(split) if those[-1:] == (n,) and not set(those) & _SIDES.keys()] for n in names
    ]
    return next((found for found in (*whole, *last) if found), [])


def _mirrored(joints: list[Joint]) -> Pairs:
    """Pairs of mirrored joints in the rest pose about the best of three planes; left and right undetermined."""
    rest = rest_positions(joints)
    near = _MIRROR_TOLERANCE * float(np.ptp(rest, axis=0).max())
    found: list[Pairs] = []
    for axis in range(3):
        distances, twins = map(np.asarray, KDTree(rest * np.where(np.arange(3) == axis, -1.0, 1.0)).query(rest))
        of_side = np.flatnonzero((rest[:, axis] > near) & (distances <= near))
        found.append([(int(joint), int(twins[joint])) for joint in of_side])
    return max(found, key=len)


def _middle_end(joints: list[Joint], pairs: Pairs) -> list[int]:
    """Head of a symmetric skeleton: the far end of its central chain; several if equally plausible."""
    of_sides = {index for pair in pairs for index in pair}
    ways = [to_root(joints, index) for index in range(len(joints))]
    length = [sum(float(np.linalg.norm(joints[k].offset)) for k in way[:-1]) for way in ways]
    middle = {way[0] for way in ways if not of_sides.intersection(way[:-1])}
    leaves = sorted(middle - {joints[k].parent for k in middle})
    far = max(length[leaf] for leaf in leaves)
    if not pairs or far == 0.0:
        return []
    ends = [leaf for leaf in leaves if length[leaf] > (1.0 - _SAME_HEAD) * far]
    # Jaw and crown are children of the head; ends that branch far below it are two heads.
    parting = _common(joints, ends)
    return [parting] if length[parting] > (1.0 - 2.0 * _SAME_HEAD) * far else ends


def _parting(joints: list[Joint], pairs: Pairs, head: int) -> int:
    """Lowest common ancestor of head and both feet; the root of a skeleton without sides."""
    rest = rest_positions(joints)
    away = rest - rest[head]
    feet = max(pairs, key=lambda pair: float(np.linalg.norm(away[pair[0]] + away[pair[1]])), default=(0, 0))
    return _common(joints, [*feet, head])


def _feet(joints: list[Joint], skeleton: Skeleton, to_head: FloatArray) -> FloatArray | None:
    """Horizontal direction of the feet at rest, shape (3,), file units; None if legs are folded or feet disagree."""
    rest, trunk = rest_positions(joints), float(np.linalg.norm(to_head))
    up = to_head / trunk
    below = [float((rest[a] + rest[b] - 2.0 * rest[skeleton.hips]) @ up) / 2.0 for a, b in skeleton.pairs]
    # Some rest poses have folded legs.
    if min(below, default=0.0) > -_LEGS * trunk:
        return None
    lowest = [joints[index] for index in skeleton.pairs[int(np.argmin(below))]]
    # The last bone is the foot's or the toes'; so is the one before it, if horizontal.
    bones = [bone for joint in lowest for bone in (joint.offset, joint.end_offset) if bone is not None]
    level = [(bone - (bone @ up) * up, _FOOT_ACROSS * np.linalg.norm(bone)) for bone in bones]
    across = np.array([part for part, least in level if np.linalg.norm(part) > least]).reshape(-1, 3)
    ahead = across.sum(axis=0)
    return ahead if np.linalg.norm(ahead) > 0.5 * np.linalg.norm(across, axis=1).sum() else None


def _common(joints: list[Joint], of: list[int]) -> int:
    """Lowest common ancestor of some joints, possibly one of them."""
    ways = [to_root(joints, index) for index in of]
    shared = set(ways[0]).intersection(*ways[1:])
    return next(index for index in ways[0] if index in shared)


def _wanted(path: Path, joints: list[Joint], name: str | None, option: str) -> list[int]:
    """The joint that an option names; empty without one."""
    if name is None:
        return []
    exact = [index for index, joint in enumerate(joints) if joint.name == name]
    found = exact or [index for index, joint in enumerate(joints) if _words(joint.name) == _words(name)]
    if not found:
        raise RecordingError(path, "HIERARCHY", f"no joint {name!r}", f"{option} as one of {_names(joints)}")
    return found[:1]


def _names(joints: list[Joint], chosen: list[int] | None = None) -> str:
    return ", ".join(joints[k].name for k in (range(len(joints)) if chosen is None else chosen))


def _along_axis(direction: FloatArray) -> FloatArray | None:
    """Unit vector along a direction, or along the file's axis that it nearly has; None for no direction."""
    length = float(np.linalg.norm(direction))
    if length < 1e-9:
        return None
    unit = direction / length
    largest = int(np.argmax(np.abs(unit)))
    if abs(unit[largest]) < _SNAP_COSINE:
        return np.asarray(unit)
    return np.asarray(np.sign(unit[largest]) * np.eye(3)[largest])
