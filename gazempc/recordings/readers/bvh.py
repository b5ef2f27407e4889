"""Recordings from motion capture as BVH, of skeletons whose joints are named.

The parser is our own: the one maintained library (bvhio 1.5.4) never returns on a file that is cut off and
reads numbers in single precision.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError
from gazempc.recordings.readers.bvh_parse import Bvh, Joint, parse_bvh, poses
from gazempc.recordings.readers.checks import Prescribed, recording_of
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording, Track
from gazempc.types import FloatArray

Pairs = list[tuple[int, int]]
_SIDES = {"left": "left", "l": "left", "lft": "left", "right": "right", "r": "right", "rgt": "right"}
# Exporters' prefixes of names: Mixamo, and bones of Blender's Rigify.
_PREFIX = re.compile(r"^(mixamorig\d*|(DEF|ORG|MCH)-)")
_TIP_WORDS = {"end", "top", "tip", "nub"}
_REST_FRAME_JUMP_DEG = 30.0
# Exporters lay the rest pose along the file's axes; a direction nearer than 30 degrees to one is meant to be
# that axis (a neck leans forward, measured hips are not quite level).
_SNAP_COSINE = np.cos(np.radians(30.0))
_MIN_UP_COSINE = 0.85  # people lean less than 30 degrees when they walk
_UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "CMU's ASF unit": 0.0254 / 0.45}
_STANDING_HEIGHT_RANGE_M = (1.3, 2.1)
_HEIGHT_SAMPLES = 12
_OPTIONS = "bvh_unit_m, bvh_up_axis, bvh_head_joint, bvh_hips_joint, bvh_facing, bvh_frame_rate_hz"


def read_bvh(path: Path, options: ReadOptions) -> Recording:
    """Read a BVH file.

    The head is the tip of the head's bone where the file has one. Orientations are those of the joints'
    bones, so that in the rest pose head and hips face where the person faces. A first frame that only shows
    the rest pose (common in conversions of the CMU database) is left out.

    Args:
        path: File to read.
        options: Unit, frame rate, head and hips joints, facing and up axis, where what is inferred is wrong.

    Returns:
        The recording; time starts at 0. Its notes state in one line what was inferred.

    Raises:
        RecordingError: If the file is damaged, or head, facing, unit or up axis is in doubt; names the option that
            decides.
    """
    bvh, left_out = _without_rest_frame(parse_bvh(path))
    joints, pairs = bvh.joints, _pairs(bvh.joints)
    head = _joint(path, joints, options.bvh_head_joint, "bvh_head_joint", _heads(joints, pairs))
    hips = _joint(path, joints, options.bvh_hips_joint, "bvh_hips_joint", _hips(joints, pairs, head))
    tip, tip_offset = _head_tip(joints, head)
    pose_of = poses(bvh, {head, hips, tip})
    head_position, hips_position = pose_of[tip][1] + pose_of[tip][0].apply(tip_offset), pose_of[hips][1]
    person, told = _person_axes(path, joints, pairs, (head, hips), options.bvh_facing)
    up = _up_axis(path, options.bvh_up_axis, np.mean(head_position - hips_position, axis=0))
    unit_m, unit = _unit(path, bvh, up, options.bvh_unit_m)
    # With y up, z becomes x.
    forward = np.roll(np.abs(up), 1)
    out = Rotation.from_matrix(np.vstack([forward, np.cross(up, forward), up]))

    def quats(joint: int) -> FloatArray:
        turned = out * pose_of[joint][0] * Rotation.from_matrix(person)
        return np.asarray(turned.as_quat(scalar_first=True))

    frame_s = bvh.frame_time_s if options.bvh_frame_rate_hz is None else 1.0 / options.bvh_frame_rate_hz
    point = "tip of its bone" if tip != head or tip_offset.any() else "the joint"
    inferred = (
        f"read as: {unit}, {_axis_name(up)} up, head {joints[head].name} ({point}), hips {joints[hips].name}, "
        f"facing {_axis_name(person[:, 0])} at rest ({told}), {1.0 / frame_s:.4g} frames a second; the options "
        f"{_OPTIONS} change it"
    )
    track = Track(
        head_position_m=unit_m * out.apply(head_position),
        head_quat_wxyz=quats(head),
        pelvis_position_m=unit_m * out.apply(hips_position),
        pelvis_quat_wxyz=quats(hips),
        valid=np.ones(len(bvh.motion), dtype=np.bool_),
    )
    times_s = frame_s * np.arange(len(bvh.motion), dtype=np.float64)
    prescribed = Prescribed(options=f"the options {_OPTIONS} change the reading")
    notes = [inferred, *left_out]
    return recording_of(path, times_s, track, "motion capture", has_robot=False, prescribed=prescribed, notes=notes)


def _without_rest_frame(bvh: Bvh) -> tuple[Bvh, list[str]]:
    """Leave out a first frame in the rest pose: rotations of exactly 0 and a leap to the second; and a note."""
    is_rotation = np.array([channel.endswith("rotation") for joint in bvh.joints for channel in joint.channels])
    turns_deg = bvh.motion[:2][:, is_rotation]
    if len(turns_deg) < 2 or not is_rotation.any() or turns_deg[0].any():
        return bvh, []
    if np.abs((turns_deg[1] + 180.0) % 360.0 - 180.0).max() <= _REST_FRAME_JUMP_DEG:
        return bvh, []
    return replace(bvh, motion=bvh.motion[1:]), ["first frame (rest pose) left out"]


def _words(name: str) -> tuple[str, ...]:
    """Words of a joint's name in lower case, without prefixes such as ``mixamorig:``."""
    bare = _PREFIX.sub("", name.rpartition(":")[2].strip()) or name
    return tuple(word.lower() for word in re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+", bare))


def _named(joints: list[Joint], names: tuple[str, ...]) -> list[int]:
    """Joints of one of these names, or else those whose last word it is (Bip01 Head), but not of one side."""
    split = [_words(joint.name) for joint in joints]
    whole = [[k for k, those in enumerate(split) if "".join(those) == name] for name in names]
    last = [[k for k, those in enumerate(split) if those[-1:] == (n,) and not set(those) & set(_SIDES)] for n in names]
    return next((found for found in (*whole, *last) if found), [])


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
    """Side of a joint (left, right or nothing) and the rest of its name."""
    for k, word in enumerate(words):
        if word in _SIDES:
            return _SIDES[word], words[:k] + words[k + 1 :]
        for side in ("left", "right"):
            if word.startswith(side):
                return side, (*words[:k], word[len(side) :], *words[k + 1 :])
    return "", words


def _to_root(joints: list[Joint], index: int) -> list[int]:
    """A joint and all its parents."""
    way = [index]
    while joints[way[-1]].parent >= 0:
        way.append(joints[way[-1]].parent)
    return way


def _rest(joints: list[Joint]) -> FloatArray:
    """Positions of all joints in the rest pose relative to the root, shape (J, 3), file units."""
    positions = np.zeros((len(joints), 3))
    for index, joint in enumerate(joints[1:], start=1):
        positions[index] = positions[joint.parent] + joint.offset
    return positions


def _heads(joints: list[Joint], pairs: Pairs) -> list[int]:
    """The outermost joints named head; else the end of the body's middle that is farthest from the legs."""
    named = _named(joints, ("head",))
    if named or not pairs:
        return [k for k in named if not set(_to_root(joints, k)[1:]) & set(named)]
    sides = {index for pair in pairs for index in pair}
    middle = [k for k in range(len(joints)) if not sides & set(_to_root(joints, k))]
    parents = {joints[k].parent for k in middle}
    length = {k: sum(float(np.linalg.norm(joints[j].offset)) for j in _to_root(joints, k)[:-1]) for k in middle}
    leaves = sorted((k for k in middle if k not in parents), key=lambda k: -length[k])
    return leaves[:1] if length[leaves[0]] > 0.0 else []


def _hips(joints: list[Joint], pairs: Pairs, head: int) -> list[int]:
    """The joint named hips; else the first one that head and both feet grow on; else the root."""
    if named := _named(joints, ("hips", "hip", "pelvis")):
        return named[:1]
    away = _rest(joints) - _rest(joints)[head]
    feet = max(pairs, key=lambda pair: float(np.linalg.norm(away[pair[0]] + away[pair[1]])), default=(0, 0))
    ways = [_to_root(joints, index) for index in (*feet, head)]
    return [next(index for index in ways[0] if all(index in way for way in ways))]


def _joint(path: Path, joints: list[Joint], wanted: str | None, option: str, found: list[int]) -> int:
    """The joint that an option names, else the one that was found."""
    names = ", ".join(joint.name for joint in joints)
    if wanted is not None:
        exact = [index for index, joint in enumerate(joints) if joint.name == wanted]
        found = (exact or [k for k, joint in enumerate(joints) if _words(joint.name) == _words(wanted)])[:1]
    if len(found) != 1:
        several = ", ".join(joints[k].name for k in found)
        problem = f"{several} may be meant" if several else f"no joint {wanted!r}" if wanted else "no such joint"
        raise RecordingError(path, "HIERARCHY", problem, f"the option {option}, one of {names}")
    return found[0]


def _head_tip(joints: list[Joint], head: int) -> tuple[int, FloatArray]:
    """Tip of the head's bone where the file has one, else the joint: an index and the offset from it, shape (3,)."""
    end_offset = joints[head].end_offset
    if end_offset is not None:
        return head, end_offset
    tips = [k for k, joint in enumerate(joints) if joint.parent == head and set(_words(joint.name)) & _TIP_WORDS]
    return (tips or [head])[0], np.zeros(3)


def _person_axes(
    path: Path, joints: list[Joint], pairs: Pairs, head_hips: tuple[int, int], wanted: str | None
) -> tuple[FloatArray, str]:
    """Person's forward, left and up axes in the rest pose, as columns, shape (3, 3), and their origin in words.

    Up is from hips to head. Left is the sum of the differences between all left joints and their right twins.
    """
    rest, option = _rest(joints), "the option bvh_facing (x, -x, y, -y, z or -z)"
    up = _along_axis(rest[head_hips[0]] - rest[head_hips[1]])
    if up is None:
        raise RecordingError(path, "HIERARCHY", "head and hips coincide in the rest pose", "two places")
    if wanted is not None:
        ahead, told = np.zeros(3), "by bvh_facing"
        ahead["xyz".index(wanted[-1])] = -1.0 if wanted.startswith("-") else 1.0
    else:
        to_left = sum((rest[left] - rest[right] for left, right in pairs), np.zeros(3))
        left = _along_axis(to_left - (to_left @ up) * up)
        if left is None:
            problem = f"no pairs of left and right joints in {', '.join(joint.name for joint in joints)}"
            raise RecordingError(path, "HIERARCHY", problem, f"joints such as LeftUpLeg and RightUpLeg, or {option}")
        ahead, told = np.cross(left, up), "by left and right joints"
    forward = _along_axis(ahead - (ahead @ up) * up)
    if forward is None:
        problem = f"the person faces {_axis_name(up)}, the direction of the head"
        raise RecordingError(path, "HIERARCHY", problem, f"another axis: {option}")
    forward -= (forward @ up) * up
    forward /= np.linalg.norm(forward)
    return np.column_stack([forward, np.cross(up, forward), up]), told


def _up_axis(path: Path, wanted: str | None, to_head: FloatArray) -> FloatArray:
    """Unit vector of the file's axis that points up, shape (3,): from hips to head in the motion.

    Some files keep their skeleton along another axis and turn it upright in every frame.
    """
    axis = np.zeros(3)
    largest = int(np.argmax(np.abs(to_head)))
    if wanted is not None:
        axis["xyz".index(wanted)] = 1.0
    elif abs(to_head[largest]) <= _MIN_UP_COSINE * np.linalg.norm(to_head):
        shown = ", ".join(f"{x:.3g}" for x in to_head)
        problem = f"no axis points up: from hips to head is ({shown}) in the mean"
        raise RecordingError(path, "MOTION", problem, "an upright person, or the option bvh_up_axis (y or z)")
    else:
        axis[largest] = np.sign(to_head[largest])
    return axis


def _unit(path: Path, bvh: Bvh, up: FloatArray, wanted_m: float | None) -> tuple[float, str]:
    """Metres per file unit, by the person's median height in the motion, and how it was found."""
    thinned = slice(None, None, max(1, len(bvh.motion) // _HEIGHT_SAMPLES))
    sampled = poses(bvh, range(len(bvh.joints)), thinned)
    points = [position for _, position in sampled.values()]
    points += [
        sampled[index][1] + sampled[index][0].apply(joint.end_offset)
        for index, joint in enumerate(bvh.joints)
        if joint.end_offset is not None
    ]
    height = float(np.median(np.ptp(np.array(points) @ up, axis=0)))
    if wanted_m is not None:
        return wanted_m, f"unit {wanted_m:.6g} m by bvh_unit_m ({height * wanted_m:.2f} m high)"
    low_m, high_m = _STANDING_HEIGHT_RANGE_M
    for name, unit_m in _UNITS_M.items():
        if low_m <= height * unit_m <= high_m:
            return unit_m, f"unit {name} ({height * unit_m:.2f} m high)"
    candidates = ", ".join(f"{name} ({unit_m:.6g})" for name, unit_m in _UNITS_M.items())
    problem = f"the person is {height:.4g} units high, in no known unit {low_m:g} to {high_m:g} m"
    raise RecordingError(path, "MOTION", problem, f"one of the units {candidates}, or the option bvh_unit_m")


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


def _axis_name(vector: FloatArray) -> str:
    """The axis that a direction is nearest to, such as ``-z``."""
    largest = int(np.argmax(np.abs(vector)))
    return f"{'-' if vector[largest] < 0 else ''}{'xyz'[largest]}"
