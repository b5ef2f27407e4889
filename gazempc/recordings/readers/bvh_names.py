"""What the names of a BVH file's joints say: the head, the hips, and the joints of the two sides."""

from __future__ import annotations

import re
from collections.abc import Iterable

from gazempc.recordings.readers.bvh_parse import Joint

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
