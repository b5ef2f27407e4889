"""Recordings: tracks of head and pelvis, labels, rotations of orientations, and the true head between the frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from gazempc.types import BoolArray, FloatArray, IntArray

# Longest gap in which the interpolated position is scored; longer ones are bridged but not scored.
_LONGEST_GAP_S = 0.2
# Half a servo period, in which a head moves by 4 mm at most; each frame then has a tick at any rate.
_ON_A_FRAME_S = 0.0025
_ROUNDING_S = 1e-6
_IDENTITY = Rotation.identity()
DataKind = Literal["synthetic", "motion capture", "body tracking", "tracked"]


@dataclass(frozen=True)
class Track:
    """Poses of head and pelvis at the recording's capture times.

    Where the person was seen, the head's position is known. The other parts are optional; a row of NaN marks an unknown
    part. The frame of reference is the recording's own: metres, z up, right-handed; the identity quaternion faces +x
    with +y to the person's left.

    Attributes:
        head_position_m: Shape (N, 3), metres; NaN where the person was not seen.
        head_quat_wxyz: Shape (N, 4), unit quaternions; NaN if unknown.
        pelvis_position_m: Shape (N, 3), metres; NaN if unknown.
        pelvis_quat_wxyz: Shape (N, 4), unit quaternions; NaN if unknown.
    """

    head_position_m: FloatArray
    head_quat_wxyz: FloatArray
    pelvis_position_m: FloatArray
    pelvis_quat_wxyz: FloatArray

    @property
    def valid(self) -> BoolArray:
        """Frames in which the person was seen, shape (N,)."""
        return np.asarray(np.isfinite(self.head_position_m).all(axis=1))

    def rows(self, chosen: BoolArray) -> Track:
        """The rows selected by a mask of shape (N,)."""
        return Track(*(values[chosen] for values in vars(self).values()))

    @property
    def positions_only(self) -> bool:
        """Whether no frame has an orientation of head or pelvis."""
        return not any(np.isfinite(quats).any() for quats in (self.head_quat_wxyz, self.pelvis_quat_wxyz))


def quats_of(values: FloatArray, rotation: Callable[[FloatArray], Rotation]) -> FloatArray:
    """Quaternions from the rows of an array.

    Args:
        values: Shape (N, C).
        rotation: Converts M rows to M rotations.

    Returns:
        Quaternions w, x, y, z, shape (N, 4); NaN for rows with a non-finite number.
    """
    known = np.isfinite(values).all(axis=1)
    result = np.full((len(values), 4), np.nan)
    if known.any():
        result[known] = rotation(values[known]).as_quat(scalar_first=True)
    return result


def composed(quats_wxyz: FloatArray, last: Rotation | None = None, first: Rotation = _IDENTITY) -> FloatArray:
    """Orientations ``first * q * last``.

    Args:
        quats_wxyz: Unit quaternions, shape (N, 4); NaN if unknown.
        last: Rotation of the body's own axes; None: identity.
        first: Rotation of the frame, one or N.

    Returns:
        Shape (N, 4); NaN if unknown.
    """
    known = np.isfinite(quats_wxyz).all(axis=1)
    before = first if first.single else first[np.flatnonzero(known)]

    def turn(quats: FloatArray) -> Rotation:
        own = before * Rotation.from_quat(quats, scalar_first=True)
        return own if last is None else own * last

    return quats_of(quats_wxyz, turn)


def turned(quats_wxyz: FloatArray, yaws_rad: ArrayLike) -> FloatArray:
    """Orientations rotated about the vertical.

    Args:
        quats_wxyz: Unit quaternions, shape (N, 4); NaN if unknown.
        yaws_rad: Angles, positive from +x to +y, one for all or shape (N,), radians.

    Returns:
        Shape (N, 4); NaN if unknown.
    """
    yaws = np.broadcast_to(np.asarray(yaws_rad, dtype=np.float64), len(quats_wxyz))
    return composed(quats_wxyz, first=Rotation.from_euler("z", yaws[:, None]))


@dataclass(frozen=True)
class Labels:
    """Facts about a recording besides the motion.

    Attributes:
        subject: The person; by default the name up to the first underscore.
        group: Route group such as ``straight``, ``turn``, ``sharp``, or None if unknown.
        description: Free text.
        activity: Activity of the person, such as ``moving``, ``starting``, ``stopping``, ``waiting``; None if unknown.
    """

    subject: str
    group: str | None = None
    description: str = ""
    activity: str | None = None


@dataclass(frozen=True)
class Recording:
    """One walk of one person.

    Attributes:
        name: Short name used in tables and file names.
        source: File path, or ``synthetic``.
        kind: Origin of the data; shown with every result.
        times_s: Capture times, shape (N,), seconds, strictly increasing.
        truth: The best known true motion. For synthetic walks and motion capture it is the recorded motion. For body
            tracking and people tracked by a robot, it is the measured track, smoothed without lag.
        measured: The measurements of a tracker, if the recording has them; None for motion capture.
        has_robot: True if the origin of the frame is the robot's sensor (x forward, y left, z up). Then the robot can
            stand where the sensor stood.
        labels: Subject, group, description and activity.
        notes: Notes of the reader on inferred and omitted data, one line each.
        delays_s: From capture to arrival, shape (N,), seconds; None if unknown.
    """

    name: str
    source: str
    kind: DataKind
    times_s: FloatArray
    truth: Track
    measured: Track | None
    has_robot: bool
    labels: Labels = field(default_factory=lambda: Labels(subject="unknown"))
    notes: tuple[str, ...] = ()
    delays_s: FloatArray | None = None


def truth_of(kind: str) -> str:
    """Description of the truth for a kind of recording.

    Args:
        kind: Kind of a recording or of a run.

    Returns:
        Text after "against"; empty if the true motion itself is known, or no person is recorded.
    """
    # The track is the only measurement.
    return "the tracker's own track, smoothed without lag" if kind in ("tracked", "body tracking") else ""


def stretches(recording: Recording) -> list[IntArray]:
    """Indices of the valid frames in each interval without a gap of more than 0.2 s."""
    seen = np.flatnonzero(recording.truth.valid)
    return np.split(seen, np.flatnonzero(np.diff(recording.times_s[seen]) > _LONGEST_GAP_S) + 1)


class TrueHead:
    """Cubic spline through the head's positions in valid frames; linear extrapolation at the last velocity.

    Args:
        recording: The recording; positions are in its frame.
    """

    def __init__(self, recording: Recording) -> None:
        valid = recording.truth.valid
        self._times_s: FloatArray = recording.times_s[valid]
        self._spline = CubicSpline(self._times_s, recording.truth.head_position_m[valid], axis=0)
        self._first_s, self._last_s = map(float, self._times_s[[0, -1]])

    def known(self, times_s: ArrayLike) -> BoolArray:
        """Mask of times with a known position: within the recording, and outside of gaps of more than 0.2 s.

        Args:
            times_s: Times, shape (H,), seconds.

        Returns:
            Shape (H,).
        """
        times = np.asarray(times_s, dtype=np.float64)
        after = np.clip(np.searchsorted(self._times_s, times), 1, self._times_s.size - 1)
        gap_s = self._times_s[after] - self._times_s[after - 1]
        on_a_frame = np.minimum(self._times_s[after] - times, times - self._times_s[after - 1]) < _ON_A_FRAME_S
        inside = (times >= self._first_s - _ROUNDING_S) & (times <= self._last_s + _ROUNDING_S)
        return inside & ((gap_s <= _LONGEST_GAP_S + _ROUNDING_S) | on_a_frame)

    def __call__(self, times_s: ArrayLike) -> FloatArray:
        """Positions at times.

        Args:
            times_s: Times, shape (H,), seconds.

        Returns:
            Positions, shape (H, 3), metres.
        """
        times = np.asarray(times_s, dtype=np.float64)
        inside = np.clip(times, self._first_s, self._last_s)
        beyond = (times - inside)[..., None]
        positions: FloatArray = self._spline(inside) + beyond * self._spline(inside, 1)
        return positions
