"""Multi-objective tuning with Optuna that ends the same however often it is interrupted."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.engine.keys import program_hash, recording_hash
from experiments.sweep.plan import Point, SweepPlan, case_seed, is_whole
from experiments.sweep.spec import Case, Range
from gazempc.errors import MissingOptionalDependencyError

if TYPE_CHECKING:
    from optuna import Study
    from optuna.distributions import BaseDistribution
    from optuna.trial import FrozenTrial

# Trials proposed together and evaluated in parallel. Fixed, not the number of workers, so that the trials do not
# depend on the machine.
BATCH = 8
# Only one process writes the storage: a lock older than this is that of a killed one.
_LOCK_GRACE_S = 3

# Means of the objectives for each point; None where a run failed.
Score = Callable[[Sequence[Point]], list[list[float] | None]]


def check_installed() -> None:
    """Raise MissingOptionalDependencyError unless Optuna is installed."""
    try:
        import optuna  # noqa: F401, PLC0415
    except ImportError:
        raise MissingOptionalDependencyError("Design optuna", "optuna", "tune") from None


def tune(plan: SweepPlan, case: Case, storage: Path, score: Score) -> list[Point]:
    """Propose points by a multi-objective tree of Parzen estimators and score them, `BATCH` at a time.

    Each batch is proposed from the finished batches before it alone and with a seed of its own, and finished trials
    alone are stored. A killed tuning therefore proposes its last batch again, exactly, and goes on.

    Args:
        plan: The sweep.
        case: The case, complete.
        storage: Journal file; may hold other studies.
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
    study = _stored_study(plan, case, storage)
    space = {name: _distribution(name, entry) for name, entry in case.vary.items()}
    wanted = case.n or 0
    points: list[Point] = []
    for start in range(0, wanted, BATCH):
        known = study.get_trials(deepcopy=False)
        proposed = _propose(plan, case, known[:start], space)[: wanted - start]
        points += proposed
        new = proposed[max(0, len(known) - start) :]
        if not new:
            continue
        for point, values in zip(new, score(new), strict=True):
            state = TrialState.FAIL if values is None else TrialState.COMPLETE
            study.add_trial(create_trial(state=state, params=point, distributions=space, values=values))
    return points


def _stored_study(plan: SweepPlan, case: Case, storage: Path) -> Study:
    import optuna  # noqa: PLC0415
    from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock  # noqa: PLC0415

    # Anything that changes the proposals or the values makes it another study; only the number of trials may grow.
    content = {
        "case": {"base": case.base, "vary": {n: _plain(entry) for n, entry in case.vary.items()}},
        "objectives": [objective.model_dump() for objective in plan.spec.objectives],
        "seed": plan.spec.seed,
        "walks": [recording_hash(walk.path) for walk in plan.walks],
        "versions": [program_hash(), version("optuna")],
    }
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:8]
    lock = JournalFileOpenLock(str(storage), grace_period=_LOCK_GRACE_S)
    return optuna.create_study(
        storage=optuna.storages.JournalStorage(JournalFileBackend(str(storage), lock_obj=lock)),
        study_name=f"{case.name}-{digest}",
        directions=[objective.direction for objective in plan.spec.objectives],
        load_if_exists=True,
    )


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


def _plain(entry: Any) -> Any:
    return entry.model_dump() if isinstance(entry, Range) else entry
