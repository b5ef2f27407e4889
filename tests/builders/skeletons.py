"""BVH files as programs export them: their joints' names and trees, axes and units, on one walking person."""

import numpy as np

# Axes of the rest pose: the columns are the person's forward, left and up in the file.
Y_UP_FACING_Z = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
Z_UP_FACING_MINUS_Y = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
Z_UP_FACING_X = np.eye(3)
CMU_UNIT_M = 0.0254 / 0.45
RATE_HZ = 60.0
# Of the head's tip above the hips; legs are 0.9 m long.
HEAD_ABOVE_HIPS_M = 0.78
HEAD_YAW_RAD = 0.4


def limb(names, offsets, end):
    """A chain: (name, offset, children or end)."""
    (name, *names), (offset, *offsets) = names, offsets
    return (name, offset, [limb(names, offsets, end)] if names else end)


def leg(names, left):
    """Hip to toes; with five names the first is a joint at the hips."""
    side = 1.0 if left else -1.0
    offsets = [(0.0, 0.1 * side, 0.0), (0.0, 0.0, -0.42), (0.0, 0.0, -0.42), (0.14, 0.0, -0.06)]
    if len(names) == 5:
        offsets = [(0.0, 0.0, 0.0), *offsets]
    return limb(names, offsets[: len(names)], (0.06, 0.0, 0.0) if len(names) > 3 else (0.0, 0.0, -0.06))


def arm(names, left):
    """Collar to hand."""
    side = 1.0 if left else -1.0
    return limb(
        names,
        [(0.0, 0.04 * side, 0.1), (0.0, 0.14 * side, 0.0), (0, 0.28 * side, 0), (0, 0.26 * side, 0)],
        (0, 0.15 * side, 0),
    )


def body(hips, spine, head, legs, arms, top=None):
    """A tree: names of the hips, of the spine up to the neck, of the head, its two legs, its two arms."""
    above = 0.6 / len(spine)
    tip = HEAD_ABOVE_HIPS_M - 0.6
    end = (0.0, 0.0, tip) if top is None else [(top, (0.0, 0.0, tip), (0.0, 0.0, 0.0))]
    node = (head, (0.0, 0.0, above), end)
    for k, name in enumerate(reversed(spine)):
        offset = (0.0, 0.0, 0.0) if k == len(spine) - 1 else (0.0, 0.0, above)
        # The arms grow on the last but one.
        grown = [arm(arms[0], True), arm(arms[1], False)] if k == min(1, len(spine) - 1) else []
        node = (name, offset, [node, *grown])
    return (hips, (0.0, 0.0, 0.0), [leg(legs[0], True), leg(legs[1], False), node])


def sides(left, right, names):
    """Names of both sides, from a pattern for each."""
    return tuple([pattern.format(name) for name in names] for pattern in (left, right))


def write_bvh(path, tree, axes=Y_UP_FACING_Z, unit_m=0.01, head=None, walks=True, above=None, positions_of=None):
    """A person of this tree, who walks on a curve and looks to the left of the way.

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
        lines.extend(
            [f"{pad}{'ROOT' if parent is None else 'JOINT'} {name}", f"{pad}{{", f"{pad}  OFFSET {number(offset)}"]
        )
        lines.append(f"{pad}  CHANNELS {len(kinds)} {' '.join(kinds)}")
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
    """Times, headings and places, in the person's axes at rest: 1.2 m/s on a circle of 4 m, or standing."""
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


_LEG, _ARM = ("UpLeg", "Leg", "Foot", "ToeBase"), ("Shoulder", "Arm", "ForeArm", "Hand")
_SPINE = ["Spine", "Spine1", "Spine2", "Neck"]

CMU_ASF = body(
    "root",
    ["lowerback", "upperback", "thorax", "lowerneck", "upperneck"],
    "head",
    sides("l{}", "r{}", ("hipjoint", "femur", "tibia", "foot", "toes")),
    sides("l{}", "r{}", ("clavicle", "humerus", "radius", "wrist")),
)
CMU_FOR_MOTION_BUILDER = body(
    "Hips",
    ["LowerBack", "Spine", "Spine1", "Neck", "Neck1"],
    "Head",
    (["LHipJoint", *("Left" + n for n in _LEG)], ["RHipJoint", *("Right" + n for n in _LEG)]),
    sides("Left{}", "Right{}", _ARM),
)
MIXAMO = body(
    "mixamorig:Hips",
    ["mixamorig:" + name for name in _SPINE],
    "mixamorig:Head",
    sides("mixamorig:Left{}", "mixamorig:Right{}", _LEG),
    sides("mixamorig:Left{}", "mixamorig:Right{}", _ARM),
    top="mixamorig:HeadTop_End",
)
XSENS = body(
    "Hips",
    ["Chest", "Chest2", "Chest3", "Chest4", "Neck"],
    "Head",
    sides("Left{}", "Right{}", ("Hip", "Knee", "Ankle", "Toe")),
    sides("Left{}", "Right{}", ("Collar", "Shoulder", "Elbow", "Wrist")),
)
ROKOKO = body(
    "Hips",
    ["Spine1", "Spine2", "Spine3", "Spine4", "Neck"],
    "Head",
    sides("Left{}", "Right{}", ("Thigh", "Shin", "Foot", "Toe")),
    sides("Left{}", "Right{}", ("Shoulder", "Arm", "ForeArm", "Hand")),
)
MOTION_BUILDER = renamed(
    body("Hips", _SPINE, "Head", sides("Left{}", "Right{}", _LEG), sides("Left{}", "Right{}", _ARM)),
    lambda name: f"Character1_{name}",
)
# Of Rigify's human: no bone is named head or hips.
BLENDER_RIGIFY = body(
    "spine",
    [f"spine.00{k}" for k in range(1, 6)],
    "spine.006",
    sides("{}.L", "{}.R", ("thigh", "shin", "foot", "toe")),
    sides("{}.L", "{}.R", ("shoulder", "upper_arm", "forearm", "hand")),
)
BLENDER = body(
    "hips",
    ["spine", "chest", "neck"],
    "head",
    sides("{}_L", "{}_R", ("thigh", "shin", "foot", "toe")),
    sides("{}_L", "{}_R", ("shoulder", "upper_arm", "forearm", "hand")),
)
NUMBERED = renamed(XSENS, {name: f"Bone_{k}" for k, name in enumerate(names_of(XSENS))}.__getitem__)
NUMBERED_HEAD = "Bone_" + str(names_of(XSENS).index("Head"))
