"""Leave one subject out: w tuned on the others, the errors of both forecasts on the one left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from experiments.paper.frames import Frames
from gazempc.errors import GazempcError, MissingOptionalDependencyError
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


def check_optuna() -> None:
    """Raise MissingOptionalDependencyError unless Optuna is installed."""
    try:
        import optuna  # noqa: F401, PLC0415
    except ImportError:
        raise MissingOptionalDependencyError("Tuning w", "optuna", "tune") from None


def total_error_mm(videos: Sequence[Frames], weight: float) -> float:
    """The paper's objective: the sum of the errors over all frames of all videos.

    Args:
        videos: Training videos.
        weight: w.

    Returns:
        The sum, mm.
    """
    return float(sum(v.error_mm(weight).sum() for v in videos))


def tune_weight(videos: Sequence[Frames], seed: int, trials: int, balanced: bool = False) -> float:
    """Tune w in [0, 1] with Optuna's tree of Parzen estimators, in this process alone.

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
    """The w in [0, 1] that minimises `total_error_mm`, or the mean over groups of their mean errors.

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
    return [
        Judged(v.recording, v.subject, v.group, (w := weights[v.subject]), v.error_mm(0.0), v.error_mm(w))
        for v in videos
    ]
