"""The paper's test over frames, and a test over people with independent pairs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import PermutationMethod, rankdata, wilcoxon

from experiments.paper.frames import Frames
from experiments.paper.published import STEPS_AHEAD
from gazempc.errors import GazempcError
from gazempc.results.run_summary import without_nan
from gazempc.types import FloatArray


@dataclass(frozen=True)
class Judged:
    """Out-of-sample errors on one video: w tuned on other people.

    Attributes:
        recording: Name.
        subject: Name of the person.
        group: R12, R34 or R56.
        weight: w tuned on the other people.
        baseline_mm: Error of the baseline at each frame, shape (F,).
        proposed_mm: Error of the proposed forecast, shape (F,).
    """

    recording: str
    subject: str
    group: str
    weight: float
    baseline_mm: FloatArray
    proposed_mm: FloatArray


def tune_weight(videos: Sequence[Frames], seed: int, trials: int, balanced: bool = False) -> float:
    """Tune w in [0, 1] with Optuna's tree-structured Parzen estimator, in this process.

    The paper's objective is the sum of the errors over all frames of all videos.

    Args:
        videos: Training videos.
        seed: Seed of the sampler.
        trials: Number of trials.
        balanced: Whether groups of routes have equal weight, independent of their numbers of frames. The paper's groups
            have equal numbers of videos.

    Returns:
        The best w found; deterministic.
    """
    import optuna  # noqa: PLC0415

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    base_m, turn_m, share = _stacked(videos, balanced)

    def objective(trial: optuna.Trial) -> float:
        return float(share @ np.linalg.norm(base_m + trial.suggest_float("w", 0.0, 1.0) * turn_m, axis=1))

    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))
    study.optimize(objective, n_trials=trials)
    return float(study.best_params["w"])


def _stacked(videos: Sequence[Frames], balanced: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Errors of all frames, their change for w = 1, and the frames' weights."""
    base_m, turn_m = (np.concatenate([getattr(v, name) for v in videos]) for name in ("base_m", "turn_m"))
    if not balanced:
        return base_m, turn_m, np.ones(len(base_m))
    frames = Counter[str]()
    for v in videos:
        frames[v.group] += len(v.base_m)
    return base_m, turn_m, np.concatenate([np.full(len(v.base_m), 1.0 / frames[v.group]) for v in videos])


def exact_weight(videos: Sequence[Frames], balanced: bool = False) -> float:
    """Minimiser in [0, 1] of the sum of the errors, or of the mean over groups of their mean errors.

    A sum of norms of functions affine in w is convex, so a bounded search finds the global minimum.

    Args:
        videos: Training videos.
        balanced: See `tune_weight`.

    Returns:
        The minimum, to six digits.
    """
    base_m, turn_m, share = _stacked(videos, balanced)

    def total(weight: float) -> float:
        return float(share @ np.linalg.norm(base_m + weight * turn_m, axis=1))

    found = float(minimize_scalar(total, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-7}).x)
    return min((0.0, found, 1.0), key=total)


def leave_one_subject_out(videos: Sequence[Frames], seed: int, trials: int, balanced: bool = False) -> list[Judged]:
    """Errors on each subject's videos with the w tuned on all other subjects.

    Args:
        videos: All videos.
        seed: Seed from which each subject's sampler is seeded.
        trials: Number of trials per subject.
        balanced: See `tune_weight`.

    Returns:
        One entry per video, in the order given.

    Raises:
        GazempcError: If there are fewer than two subjects.
    """
    subjects = sorted({v.subject for v in videos})
    if len(subjects) < 2:
        raise GazempcError(f"leaving one subject out needs at least 2 subjects, got {len(subjects)}: {subjects}")
    seeds = np.random.SeedSequence(seed).generate_state(len(subjects))
    weights = {
        subject: tune_weight([v for v in videos if v.subject != subject], int(own), trials, balanced)
        for subject, own in zip(subjects, seeds, strict=True)
    }
    return [judge(v, weights[v.subject]) for v in videos]


def judge(video: Frames, weight: float) -> Judged:
    """Errors on a video without the rule, and with the rule at a weight."""
    return Judged(video.recording, video.subject, video.group, weight, video.error_mm(0.0), video.error_mm(weight))


ZERO_METHOD: Final = "wilcox"  # zero differences are dropped
ALTERNATIVE: Final = "greater"  # alternative hypothesis: greater errors of the baseline
_RESAMPLES = 10_000
# Least number of people for a bootstrap interval; with fewer, its ends would be the extremes.
_FEWEST_FOR_INTERVAL = 5
_SEED = 20210603


def frame_test(videos: Sequence[Judged]) -> dict[str, Any]:
    """One-tailed Wilcoxon signed-rank test over frames, treated as independent pairs as in the paper.

    Args:
        videos: The group's videos.

    Returns:
        ``statistic``, the rank sum of frames with a larger baseline error; ``p_value`` of "the baseline error is
        larger" by the normal approximation; ``p_value_thinned``, the same with every 15th frame of each video, median
        over the 15 offsets; ``n_frames``, and ``n_used``, those with a nonzero difference. None for NaN.
    """
    baseline, proposed = (np.concatenate([getattr(v, name) for v in videos]) for name in ("baseline_mm", "proposed_mm"))
    statistic, p_value = _over_frames(baseline, proposed)
    sides = [video.baseline_mm for video in videos], [video.proposed_mm for video in videos]
    thin = ([np.concatenate([v[first::STEPS_AHEAD] for v in side]) for side in sides] for first in range(STEPS_AHEAD))
    thinned = np.median([_over_frames(*both)[1] for both in thin])
    test: dict[str, Any] = without_nan(
        {
            "statistic": statistic,
            "p_value": p_value,
            "p_value_thinned": float(thinned),
            "n_frames": baseline.size,
            "n_used": int(np.count_nonzero(baseline != proposed)),
        }
    )
    return test


def person_test(videos: Sequence[Judged]) -> dict[str, Any]:
    """Exact signed-rank test with one pair per person, the mean errors over the person's frames in the group.

    Args:
        videos: The group's videos.

    Returns:
        Numbers of people, ``n_people``, and of those with a nonzero difference, ``n_used``; ``statistic``, the rank sum
        of people with a larger baseline error; exact p values, one-tailed for a smaller (``p_better``) and a larger
        (``p_worse``) error of the proposed forecast, and ``p_two_sided``; ``smallest_p``, the least one-tailed p value
        attainable with ``n_used`` people. ``difference_mm`` is the mean over people of proposed minus baseline,
        ``effect`` the matched-pairs rank-biserial correlation (1 if the proposed error is smaller for all people, -1 if
        larger), each with a bootstrap interval over people, None with fewer than five. None for NaN.
    """
    people = sorted({v.subject for v in videos})
    gains = [
        np.concatenate([v.baseline_mm - v.proposed_mm for v in videos if v.subject == person]).mean()
        for person in people
    ]
    # Rounded to a picometre: smaller differences are rounding errors and would break ties arbitrarily.
    gain_mm = np.round(gains, 9)
    n = len(people)
    several = n >= _FEWEST_FOR_INTERVAL
    used_mm = gain_mm[gain_mm != 0.0]
    better, worse, either = _exact_p_values(used_mm) if used_mm.size > 1 else (math.nan,) * 3
    draws = np.random.default_rng(_SEED).integers(n, size=(_RESAMPLES, n))
    drawn = gain_mm[draws]
    test: dict[str, Any] = without_nan(
        {
            "n_people": n,
            "n_used": used_mm.size,
            "statistic": float(rankdata(np.abs(used_mm))[used_mm > 0].sum()),
            "p_better": better,
            "p_worse": worse,
            "p_two_sided": either,
            "smallest_p": 0.5**used_mm.size,
            "difference_mm": float(-gain_mm.mean()),
            "difference_ci95_mm": _interval(-drawn.mean(axis=1)) if several else None,
            "effect": float(_rank_biserial(gain_mm[None])[0]),
            "effect_ci95": _interval(_rank_biserial(drawn)) if several else None,
        }
    )
    return test


def _over_frames(baseline_mm: FloatArray, proposed_mm: FloatArray) -> tuple[float, float]:
    if not np.any(baseline_mm != proposed_mm):
        return 0.0, math.nan
    result = wilcoxon(baseline_mm, proposed_mm, zero_method=ZERO_METHOD, alternative=ALTERNATIVE, method="approx")
    return float(result.statistic), float(result.pvalue)


def _exact_p_values(gain_mm: FloatArray) -> tuple[float, float, float]:
    # The exact distribution assumes no ties; with ties, a permutation test over all sign patterns, or over a million of
    # them for more than 20 people.
    ties = np.unique(np.abs(gain_mm)).size < gain_mm.size

    def p_value(alternative: Literal["greater", "less", "two-sided"]) -> float:
        method: Literal["exact"] | PermutationMethod = "exact"
        if ties:
            method = PermutationMethod(n_resamples=1 << 20, batch=1 << 14, rng=_SEED)
        return float(wilcoxon(gain_mm, zero_method=ZERO_METHOD, alternative=alternative, method=method).pvalue)

    return p_value("greater"), p_value("less"), p_value("two-sided")


def _rank_biserial(gains: FloatArray) -> FloatArray:
    """Matched-pairs rank-biserial correlation of each row without zeros, shape (R,) (Kerby 2014); 0 if all are zero."""
    # Zeros have the lowest ranks: without them the other ranks decrease by their number.
    zeros = (gains == 0.0).sum(axis=1, keepdims=True)
    ranks = np.where(gains == 0.0, 0.0, rankdata(np.abs(gains), axis=1) - zeros)
    return np.asarray((ranks * np.sign(gains)).sum(axis=1) / np.maximum(ranks.sum(axis=1), 1.0))


def _interval(values: FloatArray) -> list[float]:
    ends: list[float] = np.percentile(values, [2.5, 97.5]).tolist()
    return ends
