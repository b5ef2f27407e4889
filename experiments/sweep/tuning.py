"""Multi-objective tuning with Optuna that ends the same however often it is interrupted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.sweep.plan import Point, SweepPlan, case_seed, is_whole
from experiments.sweep.spec import Case, Range
from gazempc.errors import MissingOptionalDependencyError

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.trial import FrozenTrial

# Trials proposed together and evaluated in parallel. Fixed, not the number of workers, so that the trials do not
# depend on the machine.
BATCH = 8

# Means of the objectives for each point; None where a run failed.
Score = Callable[[Sequence[Point]], list[list[float] | None]]


def check_installed() -> None:
    """Raise MissingOptionalDependencyError unless Optuna is installed."""
    try:
        import optuna  # noqa: F401, PLC0415
    except ImportError:
        raise MissingOptionalDependencyError("Design optuna", "optuna", "tune") from None


def tune(plan: SweepPlan, case: Case, score: Score) -> list[Point]:
    """Propose points by a multi-objective tree of Parzen estimators and score them, `BATCH` at a time.

    Each batch is proposed from the finished batches before it alone and with a seed of its own. As the results of all
    runs are kept, an interrupted tuning proposes the same batches again, finds their scores, and goes on.

    Args:
        plan: The sweep.
        case: The case, complete.
        score: Scores points.

    Returns:
        The points in the order of the trials; ``n`` of them.

    Raises:
        MissingOptionalDependencyError: Without Optuna.
    """
    check_installed()
    import optuna  # noqa: PLC0415
    from optuna.trial import TrialState, create_trial  # noqa: PLC0415

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    space = {name: _distribution(name, entry) for name, entry in case.vary.items()}
    wanted = case.n or 0
    points: list[Point] = []
    finished: list[FrozenTrial] = []
    for start in range(0, wanted, BATCH):
        batch = _propose(plan, case, finished, space)[: wanted - start]
        for point, values in zip(batch, score(batch), strict=True):
            state = TrialState.FAIL if values is None else TrialState.COMPLETE
            finished.append(create_trial(state=state, params=point, distributions=space, values=values))
        points += batch
    return points


def _propose(
    plan: SweepPlan, case: Case, finished: Sequence[FrozenTrial], space: dict[str, BaseDistribution]
) -> list[Point]:
    import optuna  # noqa: PLC0415

    seed = np.random.SeedSequence([*case_seed(case, plan.spec.seed), len(finished)]).generate_state(1)[0]
    study = optuna.create_study(
        sampler=optuna.samplers.TPESampler(seed=int(seed)),
        directions=[objective.direction for objective in plan.spec.objectives],
    )
    study.add_trials(finished)
    return [study.ask(space).params for _ in range(BATCH)]


def _distribution(name: str, entry: Any) -> BaseDistribution:
    from optuna.distributions import (  # noqa: PLC0415
        CategoricalDistribution,
        FloatDistribution,
        IntDistribution,
    )

    if not isinstance(entry, Range):
        return CategoricalDistribution(entry)
    if is_whole(name, entry):
        return IntDistribution(int(entry.low), int(entry.high), log=entry.log)
    return FloatDistribution(entry.low, entry.high, log=entry.log)
