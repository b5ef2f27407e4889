"""Published results, and the numbers of frames that the statistics imply."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm

SIGNIFICANCE_LEVEL = 0.05
VIDEOS_PER_GROUP = 28
STEPS_AHEAD = 15
FRAME_RATE_HZ = 30.0
HORIZON_S = STEPS_AHEAD / FRAME_RATE_HZ
RANGE_M = (0.5, 5.46)
# As printed; impossible for a weight in [0, 1].
W_MEAN = 7.51
W_SD = 0.36
# Possible readings: a shifted decimal point, or steps of the 15.
W_READINGS = (0.751, round(W_MEAN / STEPS_AHEAD, 2))


@dataclass(frozen=True)
class PublishedGroup:
    """One group of routes as printed in the paper's section V-B.

    Attributes:
        group: Code of the routes.
        label: Group label in this project.
        baseline_mm: Mean error of the Kalman forecast.
        proposed_mm: Mean error of the forecast bent by the head's yaw.
        statistic: Statistic of the one-tailed Wilcoxon signed-rank test.
        p_value: Its p value.
        p_digits: Significant digits of the p value as printed.
    """

    group: str
    label: str
    baseline_mm: float
    proposed_mm: float
    statistic: float
    p_value: float
    p_digits: int


PUBLISHED = (
    PublishedGroup("R12", "straight", 122.0, 139.0, 579_000.0, 1.0, 2),
    PublishedGroup("R34", "turn", 404.0, 362.0, 2_849_081.0, 6.09e-93, 3),
    PublishedGroup("R56", "sharp", 559.0, 548.0, 1_990_900.0, 1.62e-3, 3),
)


@dataclass(frozen=True)
class ImpliedFrames:
    """Numbers of frames consistent with a statistic and its p value, by the normal approximation.

    Attributes:
        fewest: Smallest number.
        most: Largest number; None if all larger numbers in the search are consistent.
        effect: Rank-biserial correlation (1: better at every frame, -1: worse) at the smallest and the largest number,
            or at 100 per video without a largest one.
        worse_p_value: One-tailed p value of the opposite hypothesis, a smaller baseline error, at the smallest number.
        thinned_p_value: p value with every `STEPS_AHEAD`-th frame only, as overlapping horizons are not independent;
            NaN if `most` is None.
    """

    fewest: int
    most: int | None
    effect: tuple[float, float]
    worse_p_value: float
    thinned_p_value: float

    @property
    def per_video(self) -> float:
        """Frames in each of the group's 28 videos; from the smallest number if there is no largest one."""
        return 0.5 * (self.fewest + (self.most or self.fewest)) / VIDEOS_PER_GROUP


def signed_rank_z(statistic: float, n: Any) -> Any:
    """Standardised signed-rank statistic.

    Args:
        statistic: Sum of the ranks of the positive differences.
        n: Number of differences, none of them 0 or tied; a number or an array.

    Returns:
        z of the normal approximation (Wilcoxon 1945).
    """
    return (statistic - n * (n + 1) / 4.0) / np.sqrt(n * (n + 1) * (2 * n + 1) / 24.0)


def implied_frames(published: PublishedGroup, most: int = 6000) -> ImpliedFrames:
    """Infer the number of frames from a printed statistic and p value.

    The sum of the positive ranks must be between 0 and n (n + 1) / 2, and the one-tailed p value must round to the
    printed one.

    Args:
        published: Statistic and p value.
        most: Upper end of the search.

    Returns:
        The consistent numbers of frames.

    Raises:
        ValueError: If there is none.
    """
    fits = _fitting(published, most)
    if not fits:
        raise ValueError(f"no number of frames up to {most} gives the p value printed for {published.group}")
    fewest = fits[0]
    open_ended = fits[-1] == most
    largest = 100 * VIDEOS_PER_GROUP if open_ended else fits[-1]
    # z scales with the square root of the share of independent frames.
    thinned = signed_rank_z(published.statistic, 0.5 * (fewest + largest)) / math.sqrt(STEPS_AHEAD)
    return ImpliedFrames(
        fewest,
        None if open_ended else largest,
        effect=(rank_biserial(published.statistic, fewest), rank_biserial(published.statistic, largest)),
        worse_p_value=float(norm.cdf(signed_rank_z(published.statistic, fewest))),
        thinned_p_value=math.nan if open_ended else float(norm.sf(thinned)),
    )


def rank_biserial(statistic: float, n: int) -> float:
    """Matched-pairs rank-biserial correlation of a signed-rank statistic (Kerby 2014).

    Args:
        statistic: Sum of the ranks of the positive differences.
        n: Number of differences, none of them 0.

    Returns:
        1 if all differences are positive, -1 if all are negative.
    """
    return 4.0 * statistic / (n * (n + 1)) - 1.0


def _fitting(published: PublishedGroup, most: int) -> list[int]:
    printed, n = _rounded(published.p_value, published.p_digits), np.arange(2, most + 1)
    p_values = norm.sf(signed_rank_z(published.statistic, n))
    rounded = np.array([_rounded(p_value, published.p_digits) for p_value in p_values])
    fits: list[int] = n[(published.statistic <= n * (n + 1) / 2) & (rounded == printed)].tolist()
    return fits


def _rounded(value: float, digits: int) -> str:
    return f"{value:.{digits - 1}e}"
