"""BVH files with the joint names, trees, axes and units of several programs, of one walking person."""

import re

import numpy as np

# Axes of the rest pose: the columns are the person's forward, left and up in the file.
Y_UP_FACING_Z = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
Z_UP_FACING_MINUS_Y = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
CMU_UNIT_M = 0.0254 / 0.45
RATE_HZ = 60.0
# Of the head's tip above the hips; legs are 0.9 m long.
HEAD_ABOVE_HIPS_M = 0.78
HEAD_YAW_RAD = 0.4


def limb(side, names, offsets, end):
    """A chain of a side: (name, offset, children or end); `side` is the pattern of its names, such as `Left{}`."""
    (name, *names), (offset, *offsets) = names, offsets
    return (side.format(name), offset, [limb(side, names, offsets, end)] if names else end)


def leg(side, names, left):
    """Hip to toes; with five names the first is a joint at the hips."""
    offsets = [(0.0, 0.1 * left, 0.0), (0.0, 0.0, -0.42), (0.0, 0.0, -0.42), (0.14, 0.0, -0.06)]
    offsets = [(0.0, 0.0, 0.0)] * (len(names) - 4) + offsets[: len(names)]
    return limb(side, names, offsets, (0.06, 0.0, 0.0) if len(names) > 3 else (0.0, 0.0, -0.06))


def arm(side, names, left):
    """Collar to hand."""
    offsets = [(0.0, 0.04 * left, 0.1), *((0.0, y * left, 0.0) for y in (0.14, 0.28, 0.26))]
    return limb(side, names, offsets[: len(names)], (0.0, 0.15 * left, 0.0))


def body(hips, spine, head, sides, leg_names, arm_names, top=None):
    """A tree: names of the hips, of the spine up to the neck, and of the head; patterns of the left and right names."""
    above, tip = 0.6 / len(spine), (0.0, 0.0, HEAD_ABOVE_HIPS_M - 0.6)
    node = (head, (0.0, 0.0, above), tip if top is None else [(top, tip, (0.0, 0.0, 0.0))])
    legs, arms = ([make(side, names.split(), left) for side, left in zip(sides, (1.0, -1.0), strict=True)]
                  for make, names in ((leg, leg_names), (arm, arm_names)))  # fmt: skip
    for k, name in enumerate(reversed(spine)):
        offset = (0.0, 0.0, 0.0) if k == len(spine) - 1 else (0.0, 0.0, above)
        # The arms grow on the last but one.
        node = (name, offset, [node, *(arms if k == min(1, len(spine) - 1) else [])])
    return (hips, (0.0, 0.0, 0.0), [*legs, node])


def write_bvh(path, tree, axes=Y_UP_FACING_Z, unit_m=0.01, head=None, walks=True, above=None, positions_of=None):
    """Write a person with this tree who walks on a curve and looks to the left of travel.

    `above` is the name of a root at the floor; `positions_of` gives all joints position channels, times this.
    """
    lines, channels = ["HIERARCHY"], []
    up = "XYZ"[int(np.argmax(np.abs(axes[:, 2])))]
    other = [axis for axis in "XYZ" if axis != up]
    head = head or next(name for name in names_of(tree) if name.lower().endswith("head"))

    def number(offset_m):
        return " ".join(f"{value:.6f}" for value in axes @ np.array(offset_m, dtype=float) / unit_m)

    def add(node, parent, depth):
        name, offset, grown = node
        pad = "  " * depth
        kinds = [f"{axis}rotation" for axis in (up, *other)]
        if parent is None or positions_of is not None:
            kinds = ["Xposition", "Yposition", "Zposition", *kinds]
        place = axes @ np.array(offset, dtype=float) / unit_m * (positions_of or 0.0)
        channels.extend(
            (name, kind, value) for kind, value in zip(kinds, [*place, 0, 0, 0][-len(kinds) :], strict=True)
        )
        lines.extend([f"{pad}{'ROOT' if parent is None else 'JOINT'} {name}", f"{pad}{{"])
        lines.extend([f"{pad}  OFFSET {number(offset)}", f"{pad}  CHANNELS {len(kinds)} {' '.join(kinds)}"])
        if isinstance(grown, tuple):
            lines.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET {number(grown)}", f"{pad}  }}"])
        else:
            for child in grown:
                add(child, name, depth + 1)
        lines.append(f"{pad}}}")

    if above is not None:
        hips, _, grown = tree
        tree = (above, (0.0, 0.0, 0.0), [(hips, (0.0, 0.0, 0.94), grown)])
    add(tree, None, 0)
    times, yaws, places = walk(walks)
    height_m = 0.0 if above is not None else 0.94
    lines += ["MOTION", f"Frames: {len(times)}", f"Frame Time: {1 / RATE_HZ:.7f}"]
    sign = np.sign(axes[:, 2].sum()) * np.sign(np.linalg.det(axes))
    for yaw, place in zip(yaws, places, strict=True):
        values = {(name, kind): value for name, kind, value in channels}
        root = tree[0]
        for kind, value in zip(("X", "Y", "Z"), axes @ [*place, height_m] / unit_m, strict=True):
            values[root, f"{kind}position"] = value
        values[root, f"{up}rotation"] = np.degrees(sign * yaw)
        values[head, f"{up}rotation"] = np.degrees(sign * HEAD_YAW_RAD)
        lines.append(" ".join(f"{values[name, kind]:.6f}" for name, kind, _ in channels))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def walk(walks=True):
    """Times, headings and positions in the person's rest axes: 1.2 m/s on a circle of 4 m, or standing."""
    times = np.arange(120) / RATE_HZ
    yaws = 0.3 * times if walks else 0.2 * np.sin(times)
    places = 4.0 * np.column_stack([np.sin(yaws), 1.0 - np.cos(yaws)]) if walks else np.zeros((times.size, 2))
    return times, yaws, places


def names_of(tree):
    """Names of all joints of a tree."""
    name, _, grown = tree
    return [name] if isinstance(grown, tuple) else [name, *(n for child in grown for n in names_of(child))]


def renamed(tree, name_of):
    """The tree with other names."""
    name, offset, grown = tree
    return (name_of(name), offset, grown if isinstance(grown, tuple) else [renamed(child, name_of) for child in grown])


BY_WORD, BY_LETTER = ("Left{}", "Right{}"), ("{}_L", "{}_R")
_SPINE, _LEG, _ARM = ["Spine", "Spine1", "Spine2", "Neck"], "UpLeg Leg Foot ToeBase", "Shoulder Arm ForeArm Hand"
_BONES = "thigh shin foot toe", "shoulder upper_arm forearm hand"

_CMU_SPINE = ["lowerback", "upperback", "thorax", "lowerneck", "upperneck"]
_CMU_LIMBS = "hipjoint femur tibia foot toes", "clavicle humerus radius wrist"
CMU_ASF = body("root", _CMU_SPINE, "head", ("l{}", "r{}"), *_CMU_LIMBS)
CMU_FOR_MOTION_BUILDER = renamed(
    body("Hips", ["LowerBack", "Spine", "Spine1", "Neck", "Neck1"], "Head", BY_WORD, f"HipJoint {_LEG}", _ARM),
    lambda name: re.sub("(eft|ight)HipJoint", "HipJoint", name),
)
MOTION_BUILDER = renamed(body("Hips", _SPINE, "Head", BY_WORD, _LEG, _ARM), "Character1_{}".format)
MIXAMO = renamed(body("Hips", _SPINE, "Head", BY_WORD, _LEG, _ARM, top="HeadTop_End"), "mixamorig:{}".format)
XSENS = body(
    "Hips",
    ["Chest", "Chest2", "Chest3", "Chest4", "Neck"],
    "Head",
    BY_WORD,
    "Hip Knee Ankle Toe",
    "Collar Shoulder Elbow Wrist",
)
ROKOKO = body("Hips", ["Spine1", "Spine2", "Spine3", "Spine4", "Neck"], "Head", BY_WORD, "Thigh Shin Foot Toe", _ARM)
BIPED = renamed(
    body("Pelvis", ["Spine", "Neck"], "Head", ("L {}", "R {}"), "Thigh Calf Foot Toe0", "Clavicle UpperArm Hand"),
    "Bip01 {}".format,
)
# Of Rigify's human: no bone is named head or hips.
BLENDER_RIGIFY = body("spine", [f"spine.00{k}" for k in range(1, 6)], "spine.006", ("{}.L", "{}.R"), *_BONES)
BLENDER = body("hips", ["spine", "chest", "neck"], "head", BY_LETTER, *_BONES)
NUMBERED = renamed(XSENS, {name: f"Bone_{k}" for k, name in enumerate(names_of(XSENS))}.__getitem__)
NUMBERED_HEAD = "Bone_" + str(names_of(XSENS).index("Head"))
