"""All errors of a tracker from one track."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gazempc.identify.tracker.fit import GroupFit
from gazempc.identify.tracker.gated import Errors, TrackJumps, measure_errors
from gazempc.identify.tracker.read import HeadTrack
from gazempc.identify.tracker.sight import along_and_across, cut, still, still_yaw
from gazempc.identify.tracker.timing import FrameTimes, frame_times
from gazempc.types import BoolArray, FloatArray

# A shorter time is too short to estimate a wander of one second.
_STILL_MIN_S = 8.0
# A wander is known from this many of its correlation times on.
_CORRELATIONS = 8.0
# Heads of people who stand sway by 5 to 10 mm (s.d.; assumed): less is no error of a tracker.
_SWAY_M = 0.01
# A shorter delay comes from the recorder. A longer one means that the clocks differ.
_DELAY_MIN_S, _DELAY_MAX_S = 0.005, 5.0
# A jump counts as across the line of sight if its size there is beyond this share of its size along it.
_SIDEWAYS = 0.3
# A yaw that turns by more than this from frame to frame was flipped, not turned.
_FLIP_RAD = np.deg2rad(150.0)


@dataclass(frozen=True)
class DirectionError:
    """Error in one direction, or of a yaw.

    Attributes:
        fit: The fit, as a share of the range or in radians.
        hidden: Whether the white error is an upper bound.
        wander: `known`, `none` (the data show none, or no more than a person's sway), or `unknown` (the person moved).
    """

    fit: GroupFit
    hidden: bool
    wander: Literal["known", "none", "unknown"]


@dataclass(frozen=True)
class YawErrors:
    """Errors of one yaw.

    Attributes:
        error: White error and wander, radians.
        known_share: Share of frames in which the yaw is known.
        flips: How often it turned by 180 degrees from one frame to the next.
        used_s: Seconds that were used.
    """

    error: DirectionError
    known_share: float
    flips: int
    used_s: float


@dataclass(frozen=True)
class TrackerErrors:
    """What was measured of a tracker.

    Attributes:
        frames: Rate, jitter and losses.
        along: Error of the range, shares of it.
        across: Error of the bearing on each of its two axes, radians.
        jumps: Jumps of the track; sizes are shares of the range and radians.
        used_s: Seconds of data used for the position errors.
        still_s: Seconds in which the person stood or sat still.
        range_m: Least, median and largest range, shape (3,), metres.
        head_yaw: None where it is not known.
        pelvis_yaw: None where it is not known.
        delay_s: Median from stamp to arrival, seconds; None where the file does not say.
    """

    frames: FrameTimes
    along: DirectionError
    across: DirectionError
    jumps: TrackJumps
    used_s: float
    still_s: float
    range_m: FloatArray
    head_yaw: YawErrors | None
    pelvis_yaw: YawErrors | None
    delay_s: float | None

    @property
    def moved(self) -> bool:
        """Whether the person moved too much to tell the tracker's wander from their motion."""
        return self.still_s < _STILL_MIN_S

    @property
    def latency_s(self) -> float | None:
        """Latency, as far as it is measured: a shorter delay is that of the recorder alone."""
        return self.delay_s if self.delay_s is not None and _DELAY_MIN_S < self.delay_s < _DELAY_MAX_S else None

    @property
    def jump_sizes_m(self) -> tuple[FloatArray, FloatArray]:
        """How far each jump goes along and across the line of sight, each of shape (K,), metres."""
        sizes_m = self.jumps.sizes * self.range_m[1]
        return sizes_m[:, 0], np.hypot(sizes_m[:, 1], sizes_m[:, 2])

    @property
    def jumps_across(self) -> bool:
        """Whether jumps go across the line of sight as well as along it, farther than a person sways."""
        along_m, across_m = self.jump_sizes_m
        return bool(along_m.size and np.median(across_m) > max(_SWAY_M, _SIDEWAYS * np.median(along_m)))


def measure_tracker(track: HeadTrack, tell: Callable[[float], None]) -> TrackerErrors:
    """Measure a tracker.

    Args:
        track: What it saw of one person.
        tell: Called with the share that is done, 0 to 1.

    Returns:
        Its errors.
    """
    values = along_and_across(track.position_m)
    range_m = np.exp(values[:, 0])
    stands = still(track.times_s, track.position_m)
    data = cut(track.times_s, values, range_m, stands)
    still_s = float(data.intervals_s[data.used].sum())
    if moved := still_s < _STILL_MIN_S:
        data = cut(track.times_s, values, range_m, np.ones(track.times_s.size, dtype=np.bool_))
    errors = measure_errors(data, ((0,), (1, 2)), not moved, lambda share: tell(0.6 * share))
    sway = _SWAY_M / float(np.median(range_m))
    along, across = (_direction(errors, group, moved, sway) for group in range(2))
    tell(0.6)
    head = _yaw(track.times_s, track.head_yaw_rad, stands, lambda share: tell(0.6 + 0.2 * share))
    pelvis = _yaw(track.times_s, track.pelvis_yaw_rad, stands, lambda share: tell(0.8 + 0.2 * share))
    return TrackerErrors(
        frames=frame_times(track.times_s),
        along=along,
        across=across,
        jumps=errors.jumps,
        used_s=errors.used_s,
        still_s=still_s,
        range_m=np.array([range_m.min(), np.median(range_m), range_m.max()]),
        head_yaw=head,
        pelvis_yaw=pelvis,
        delay_s=None if track.delays_s is None else float(np.median(track.delays_s)),
    )


def _direction(errors: Errors, group: int, moved: bool, sway: float) -> DirectionError:
    fit = errors.groups[group]
    wander: Literal["known", "none", "unknown"] = "known"
    if moved or (fit.correlation_s is not None and errors.used_s < _CORRELATIONS * fit.correlation_s.value):
        wander = "unknown"
    elif fit.wander is None or fit.wander.value < sway:
        wander = "none"
    return DirectionError(fit, errors.hidden[group], wander)


def _yaw(
    times_s: FloatArray, yaw_rad: FloatArray, stands: BoolArray, tell: Callable[[float], None]
) -> YawErrors | None:
    known = np.isfinite(yaw_rad)
    if known.mean() < 0.1 or known.sum() < 30:
        return None
    at_s, angle_rad = times_s[known], np.unwrap(yaw_rad[known])
    turns = np.abs(np.angle(np.exp(1j * np.diff(angle_rad)))) > _FLIP_RAD
    if turns.any():
        # In twice the angle, half turns disappear.
        angle_rad = np.unwrap(2.0 * angle_rad) / 2.0
    ones = np.ones(at_s.size)
    data = cut(at_s, angle_rad[:, None], ones, stands[known] & still_yaw(at_s, angle_rad))
    if moved := float(data.intervals_s[data.used].sum()) < _STILL_MIN_S:
        data = cut(at_s, angle_rad[:, None], ones, ones > 0)
    if not data.used.any():
        return None
    errors = measure_errors(data, ((0,),), True, tell)
    return YawErrors(_direction(errors, 0, moved, 0.0), float(known.mean()), int(turns.sum()), errors.used_s)
