"""What the tree of a BVH file's joints says where names say nothing: the body's middle, its sides, its feet."""

from __future__ import annotations

import numpy as np

from gazempc.recordings.readers.bvh_parse import Joint
from gazempc.types import FloatArray

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
