"""The paper's test over frames, and the test over people that independent pairs ask for."""

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
    """Errors on one video of a person on whom w was not tuned.

    Attributes:
        recording: Name.
        subject: Who walks.
        group: R12, R34 or R56.
        weight: w tuned on the others.
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
    """Tune w in [0, 1] with Optuna's tree of Parzen estimators, in this process alone.

    The paper's objective is the sum of the errors over all frames of all videos.

    Args:
        videos: Training videos.
        seed: Seed of the sampler.
        trials: Number of trials.
        balanced: Whether each group of routes counts alike, however many frames it has. The paper's groups have equal
            numbers of videos; those of other data need not.

    Returns:
        The best w found; the same for the same arguments.
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
    """All frames' errors, what w = 1 adds, and what each frame counts."""
    base_m, turn_m = (np.concatenate([getattr(v, name) for v in videos]) for name in ("base_m", "turn_m"))
    if not balanced:
        return base_m, turn_m, np.ones(len(base_m))
    frames = Counter[str]()
    for v in videos:
        frames[v.group] += len(v.base_m)
    return base_m, turn_m, np.concatenate([np.full(len(v.base_m), 1.0 / frames[v.group]) for v in videos])


def exact_weight(videos: Sequence[Frames], balanced: bool = False) -> float:
    """The w in [0, 1] that minimises the sum of the errors, or the mean over groups of their mean errors.

    A sum of distances that are each linear in w is convex, so a bounded search finds its one minimum.

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
    """Judge each subject's videos with the w tuned on all other subjects.

    Args:
        videos: All videos.
        seed: Seed of the samplers; each subject's is drawn from it.
        trials: Trials a subject.
        balanced: See `tune_weight`.

    Returns:
        One entry a video, in the order given.

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
    """The errors on a video without the rule, and with it at a weight."""
    return Judged(video.recording, video.subject, video.group, weight, video.error_mm(0.0), video.error_mm(weight))


ZERO_METHOD: Final = "wilcox"  # frames without any difference say nothing and are dropped
ALTERNATIVE: Final = "greater"  # the baseline's errors are the greater ones
_RESAMPLES = 10_000
# Drawn from fewer people, the ends of an interval would be the smallest and the largest of them.
_FEWEST_FOR_INTERVAL = 5
_SEED = 20210603


def frame_test(videos: Sequence[Judged]) -> dict[str, Any]:
    """One-tailed Wilcoxon signed-rank test over frames, each taken for an independent pair as in the paper.

    Args:
        videos: The group's videos.

    Returns:
        ``statistic``, the sum of the ranks of frames at which the baseline errs more; ``p_value`` of "the baseline errs
        more" by the normal approximation; ``p_value_thinned``, the same of every 15th frame of each video only, the
        median over the 15 ways to begin; ``n_frames``, and ``n_used`` of them, which have a difference. NaN is None.
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
    """Exact test with one pair a person: mean errors over that person's frames in the group.

    Args:
        videos: The group's videos.

    Returns:
        Numbers of people, ``n_people``, and of those with a difference, ``n_used``; ``statistic``, the sum of the ranks
        of people for whom the baseline errs more; exact p values, one-tailed of "the proposed forecast errs less"
        (``p_better``) and of "it errs more" (``p_worse``), and ``p_two_sided``; ``smallest_p``, the smallest one-tailed
        p value that so many people with a difference can give. ``difference_mm`` is the mean over people of proposed
        minus baseline, ``effect`` the matched-pairs rank-biserial correlation (1 if the proposed errs less for
        all people, -1 if more), each with a bootstrap interval over people, None with fewer than five. NaN is None.
    """
    people = sorted({v.subject for v in videos})
    gains = [
        np.concatenate([v.baseline_mm - v.proposed_mm for v in videos if v.subject == person]).mean()
        for person in people
    ]
    # Beyond a picometre differences are rounding, and would break ties by the order of the frames.
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
    # The tables of the exact test know no ties; with some, all ways to give out the signs are gone through, or of more
    # than 20 people a million.
    ties = np.unique(np.abs(gain_mm)).size < gain_mm.size

    def p_value(alternative: Literal["greater", "less", "two-sided"]) -> float:
        method: Literal["exact"] | PermutationMethod = "exact"
        if ties:
            method = PermutationMethod(n_resamples=1 << 20, batch=1 << 14, rng=_SEED)
        return float(wilcoxon(gain_mm, zero_method=ZERO_METHOD, alternative=alternative, method=method).pvalue)

    return p_value("greater"), p_value("less"), p_value("two-sided")


def _rank_biserial(gains: FloatArray) -> FloatArray:
    """Matched-pairs rank-biserial correlation of each row without its zeros, shape (R,) (Kerby 2014); 0 if all are."""
    # Zeros take the lowest ranks, so that without them all others move down by their number.
    zeros = (gains == 0.0).sum(axis=1, keepdims=True)
    ranks = np.where(gains == 0.0, 0.0, rankdata(np.abs(gains), axis=1) - zeros)
    return np.asarray((ranks * np.sign(gains)).sum(axis=1) / np.maximum(ranks.sum(axis=1), 1.0))


def _interval(values: FloatArray) -> list[float]:
    ends: list[float] = np.percentile(values, [2.5, 97.5]).tolist()
    return ends
