"""Motion of a walking person's head and pelvis about the path: traits of people, and gait.

Figures marked "the walks" were measured on 64 motion-capture clips of the CMU database; only the figures are used here,
none of the clips' data.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.special import ndtri

from gazempc.types import FloatArray

REFERENCE_SPEED_M_S = 1.05
"""Speed at which the gait amplitudes of `WalkerTraits` hold; the mean walking speed of short bouts."""

PELVIS_HEIGHT_RATIO = 0.607  # pelvis over head height; the walks: 0.99 m over 1.63 m
PELVIS_SWAY_RATIO = 0.85  # pelvis over head sway; the walks
PELVIS_SWAY_LAG_RAD = np.radians(18.0)  # of the pelvis behind the head's sway; the walks
PELVIS_YAW_LAG_RAD = np.radians(111.0)  # of the pelvis's yaw swing behind the head's sway; the walks
SWAY_SLOPE_S_M = -0.41  # relative change of sway per m/s: people sway less when faster; the walks
BOB_SLOPE_S_M = 1.0  # relative change of bob per m/s: longer steps lift more; the walks
PITCH_SWING_RAD = np.radians(1.5)  # at the step rate; head pitch and roll vary by 2.2 and 1.4 deg in all
ROLL_SWING_RAD = np.radians(1.0)  # at the stride rate


def _trait(mean: float, sd: float, low: float, high: float) -> Any:
    """Field of a trait with its mean, standard deviation and bounds over people."""
    return field(metadata={"over_people": (mean, sd, low, high)})


@dataclass(frozen=True)
class WalkerTraits:
    """Constant traits of a person.

    Attributes:
        head_height_m: Height of the head above the floor.
        head_ahead_m: Distance of the head ahead of the pelvis, along the travel direction.
        speed_m_s: Preferred walking speed over a few metres.
        step_rate_offset_hz: Difference from the step rate usual at a speed.
        sway_m: Amplitude of the head's sideways sway at the reference speed.
        bob_m: Amplitude of the vertical bob at the reference speed.
        fore_aft_m: Amplitude of the fore-aft motion.
        pelvis_yaw_swing_rad: Amplitude of the pelvis's yaw swing.
        head_lead_s: Time by which head yaw leads the travel direction in a turn of 90 deg.
        pelvis_lead_s: The same for the pelvis's yaw.
        head_yaw_offset_rad: Constant yaw between the measured and the true "straight ahead" of the head.
        head_yaw_wander_rad: Standard deviation of the slow wander of head yaw.
        head_pitch_rad: Mean pitch of the head, positive nose down.
    """

    # Adults' stature less about 0.1 m: the head joint lies inside the head.
    head_height_m: float = _trait(1.60, 0.08, 1.45, 1.75)
    head_ahead_m: float = _trait(0.042, 0.017, 0.01, 0.08)  # the walks
    # Short bouts: 0.6-1.3 m/s (Carlisle & Kuo 2023), below the 0.94-1.43 of long walks (Bohannon 2011).
    speed_m_s: float = _trait(REFERENCE_SPEED_M_S, 0.17, 0.68, 1.25)
    step_rate_offset_hz: float = _trait(0.0, 0.12, -0.24, 0.24)  # the walks
    # The walks, 30 +- 11 and 9 +- 4 mm; the spread here excludes the effect of speed.
    sway_m: float = _trait(0.030, 0.0098, 0.012, 0.052)
    bob_m: float = _trait(0.0092, 0.0025, 0.005, 0.016)
    fore_aft_m: float = _trait(0.006, 0.003, 0.002, 0.012)  # the walks
    pelvis_yaw_swing_rad: float = _trait(*np.radians([4.5, 2.0, 1.5, 8.5]))  # the walks
    # About 200 ms: Grasso 1996, Lopez 2019; median 242 ms in sharp turns on the walks.
    head_lead_s: float = _trait(0.205, 0.035, 0.15, 0.26)
    pelvis_lead_s: float = _trait(0.10, 0.02, 0.06, 0.14)  # about 100 ms after the head: Farkhatdinov 2017
    head_yaw_offset_rad: float = _trait(*np.radians([-4.0, 9.0, -22.0, 14.0]))  # the walks
    head_yaw_wander_rad: float = _trait(*np.radians([3.4, 2.1, 0.8, 8.0]))  # the walks
    head_pitch_rad: float = _trait(*np.radians([5.0, 4.0, -5.0, 15.0]))  # our choice: eyes on the way ahead


@dataclass(frozen=True)
class GaitMotion:
    """Periodic motion of walking, relative to the smooth path of travel; each field has shape (N,).

    Attributes:
        head_left_m: Sideways sway of the head, positive to the person's left.
        pelvis_left_m: Sideways sway of the pelvis.
        up_m: Bob of head and pelvis.
        ahead_m: Fore-aft motion of head and pelvis.
        pelvis_yaw_rad: Yaw swing of the pelvis.
        head_pitch_rad: Pitch swing of the head, positive nose down.
        head_roll_rad: Roll swing of the head, positive to the right ear.
    """

    head_left_m: FloatArray
    pelvis_left_m: FloatArray
    up_m: FloatArray
    ahead_m: FloatArray
    pelvis_yaw_rad: FloatArray
    head_pitch_rad: FloatArray
    head_roll_rad: FloatArray


def bounded_normal(rng: np.random.Generator, mean: float, sd: float, low: float, high: float) -> float:
    """Draw from a normal distribution, clipped to [low, high]."""
    return float(np.clip(rng.normal(mean, sd), low, high))


def slow_variation(rng: np.random.Generator, times_s: FloatArray, highest_hz: float) -> FloatArray:
    """Draw a smooth random signal of expected mean square 1 with no power above `highest_hz`.

    Args:
        rng: Random generator.
        times_s: Shape (N,), seconds.
        highest_hz: Upper edge of the band.

    Returns:
        Shape (N,), without unit.
    """
    count = 5
    frequencies_hz = rng.uniform(0.1, highest_hz, count)
    phases_rad = rng.uniform(-np.pi, np.pi, count)
    waves = np.cos(2.0 * np.pi * np.outer(times_s, frequencies_hz) + phases_rad)
    return np.asarray(np.sqrt(2.0 / count) * waves.sum(axis=1))


def draw_walkers(rng: np.random.Generator, count: int) -> tuple[WalkerTraits, ...]:
    """Draw people's traits from published ranges, so that few people already show the whole spread.

    Each trait takes one value from each of `count` equally likely parts of its distribution, in an independent order
    (Latin hypercube).

    Args:
        rng: Random generator.
        count: Number of people.

    Returns:
        The people.
    """
    values = []
    for mean, sd, low, high in (trait.metadata["over_people"] for trait in fields(WalkerTraits)):
        share = (rng.permutation(count) + rng.uniform(size=count)) / count
        values.append(np.clip(mean + sd * ndtri(share), low, high).tolist())
    return tuple(WalkerTraits(*traits) for traits in zip(*values, strict=True))


def step_rate_hz(walker: WalkerTraits, speed_m_s: FloatArray) -> FloatArray:
    """Steps per second at a speed (the walks; MacDougall & Moore 2005 find 2 +- 0.13 Hz at free speed).

    Args:
        walker: Traits of the person.
        speed_m_s: Shape (N,), metres per second.

    Returns:
        Shape (N,), hertz; twice the stride rate.
    """
    return 0.93 + 0.72 * speed_m_s + walker.step_rate_offset_hz


def walk_motion(
    rng: np.random.Generator, walker: WalkerTraits, times_s: FloatArray, speed_m_s: FloatArray
) -> GaitMotion:
    """Periodic motion of head and pelvis while walking at a varying speed.

    The head moves toward the stance foot and is highest and slowest at mid-stance, and lowest and fastest in
    double support, as an inverted pendulum is. It pitches down as it rises (Pozzo 1990).

    Args:
        rng: Random generator of the initial phase and of the variation between strides.
        walker: Traits of the person.
        times_s: Shape (N,), seconds.
        speed_m_s: Shape (N,), smooth speed of travel.

    Returns:
        The motion at `times_s`.
    """
    # Phase 0 is the double support before the left foot's stance, pi the one before the right foot's.
    stride_rate_hz = 0.5 * step_rate_hz(walker, speed_m_s)
    phase = rng.uniform(-np.pi, np.pi) + 2.0 * np.pi * cumulative_trapezoid(stride_rate_hz, times_s, initial=0)
    # Strides differ by some 10-15 % in width and lift; slower than a stride, so that the peaks stay sharp.
    faster_m_s = speed_m_s - REFERENCE_SPEED_M_S
    sway_m = walker.sway_m * (1.0 + SWAY_SLOPE_S_M * faster_m_s + 0.12 * slow_variation(rng, times_s, 0.4))
    bob_m = walker.bob_m * (1.0 + BOB_SLOPE_S_M * faster_m_s + 0.10 * slow_variation(rng, times_s, 0.4))
    return GaitMotion(
        head_left_m=sway_m * np.sin(phase),
        pelvis_left_m=PELVIS_SWAY_RATIO * sway_m * np.sin(phase - PELVIS_SWAY_LAG_RAD),
        up_m=-bob_m * np.cos(2.0 * phase),
        ahead_m=walker.fore_aft_m * np.sin(2.0 * phase),
        pelvis_yaw_rad=walker.pelvis_yaw_swing_rad * np.sin(phase - PELVIS_YAW_LAG_RAD),
        head_pitch_rad=-PITCH_SWING_RAD * np.cos(2.0 * phase),
        head_roll_rad=-ROLL_SWING_RAD * np.sin(phase),
    )
