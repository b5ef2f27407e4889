"""A person's track with labels, and how to load one by name or path."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from gazempc.types import BoolArray, FloatArray

DataKind = Literal["synthetic", "motion capture", "body tracking"]


@dataclass(frozen=True)
class Track:
    """Poses of head and pelvis at the recording's capture times.

    Rows where `valid` is False hold NaN. The frame is the recording's own: metres, z up, right-handed; the
    identity quaternion faces +x with +y to the person's left.

    Attributes:
        head_position_m: Shape (N, 3), metres.
        head_quat_wxyz: Shape (N, 4), unit quaternions.
        pelvis_position_m: Shape (N, 3), metres.
        pelvis_quat_wxyz: Shape (N, 4), unit quaternions.
        valid: Shape (N,); False where the person was not seen.
    """

    head_position_m: FloatArray
    head_quat_wxyz: FloatArray
    pelvis_position_m: FloatArray
    pelvis_quat_wxyz: FloatArray
    valid: BoolArray


@dataclass(frozen=True)
class Labels:
    """What is known about a recording besides the motion.

    Attributes:
        subject: Who walks; by default the name up to the first underscore.
        group: Route group such as ``straight``, ``turn``, ``sharp``, or None where unknown.
        description: Free text for people.
    """

    subject: str
    group: str | None = None
    description: str = ""


@dataclass(frozen=True)
class Recording:
    """One walk of one person.

    Attributes:
        name: Short name used in tables and file names.
        source: File path, or ``synthetic``.
        kind: Where the data is from; said wherever the recording is shown.
        times_s: Capture times, shape (N,), seconds, strictly increasing.
        truth: The best known true motion: the generator's or motion capture's own, or, for body tracking,
            the measured track smoothed without lag.
        measured: What a body tracker saw of it, where the recording has that; None for motion capture.
        has_robot: True where the origin of the frame is the robot's sensor (x forward, y left, z up), so
            that the recording can be replayed where it was taken.
        labels: Subject, group and description.
    """

    name: str
    source: str
    kind: DataKind
    times_s: FloatArray
    truth: Track
    measured: Track | None
    has_robot: bool
    labels: Labels = field(default_factory=lambda: Labels(subject="unknown"))
