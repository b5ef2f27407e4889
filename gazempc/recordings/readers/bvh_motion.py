"""Forward kinematics of a BVH file: where its joints are in motion."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.recordings.readers.bvh_parse import Bvh
from gazempc.types import FloatArray

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
