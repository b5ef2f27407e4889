"""Repeated replays of a scene for several controllers and noise seeds."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gazempc.command import Progress
from gazempc.results.metrics import measure
from gazempc.results.moments import Moment, PlanMoment
from gazempc.results.run_summary import Row, make_rows, measure_compute
from gazempc.results.table import Repeats, by_controller
from gazempc.signals import Interrupted
from gazempc.sim.replay import Replayed, ReplaySettings, replay_scene
from gazempc.sim.scene import Scene

DEFAULT_SEEDS = 8
# Time limit of repetitions by default.
PATIENCE_S = 10.0


@dataclass(frozen=True)
class Repeated:
    """Replays and metrics of repeated replays.

    Attributes:
        first: The replays under the first seed, by a unique name of the controller that is valid as a file name.
        repeats: The metrics of each controller, in the same order.
        faults: Exceptions caught in the runs, by seed, then by the same names; without empty entries.
        seeds_note: Number of noise seeds and the reason, as a sentence.
        interrupted: The signal that interrupted the repetitions.
        plans: The plans of the replays under the first seed, by the names of `first`; not part of a log.
    """

    first: dict[str, Replayed]
    repeats: list[Repeats]
    faults: dict[int, dict[str, list[dict[str, Any]]]]
    seeds_note: str
    plans: dict[str, list[PlanMoment]]
    interrupted: Interrupted | None = None


def replay_repeatedly(
    scene: Scene, settings: ReplaySettings, controllers: Sequence[str], count: int | None, progress: Progress
) -> Repeated:
    """Replay a scene under consecutive seeds, starting with its own.

    Args:
        scene: Walk, neck, sensor and first seed.
        settings: Predictor and parameters of the parts.
        controllers: Names of the controllers.
        count: Number of seeds; None for 8, or as many as fit into ten seconds, or one if the noise has no effect.
        progress: Progress display.

    Returns:
        Replays and metrics.

    Raises:
        Interrupted: By a signal before the first replay is complete; a later signal ends the repetitions.
        LeftOutError: If the recording is too short to be scored.
        SettingsError: If construction of a part fails, or its interface is violated.
    """
    rounds: list[list[Row]] = []
    survived: dict[int, dict[str, list[dict[str, Any]]]] = {}
    reason, interrupted = "", None
    first: dict[str, Replayed] = {}
    plans: dict[str, list[PlanMoment]] = {}
    started_s = time.monotonic()
    try:
        for seed in range(scene.seed, scene.seed + (count or DEFAULT_SEEDS)):
            done = len(rounds)
            if count is None and done == 2 and _figures(rounds[0]) == _figures(rounds[1]):
                del rounds[1]
                reason = "another one makes no difference"
                break
            if count is None and done and (time.monotonic() - started_s) * (done + 1) / done > PATIENCE_S:
                reason = f"as many as fit into {PATIENCE_S:.0f} s: --noise-seeds N for more"
                break
            progress.begin(f"replaying {scene.walk.name}, noise seed {seed}")
            replayed: dict[str, Replayed] = {} if done else first
            for name, found, planned in _replay_each(replace(scene, seed=seed), settings, controllers, progress):
                replayed[name] = found
                plans.setdefault(name, planned)
            if of_seed := {name: [*map(vars, log.faults)] for name, (log, _) in replayed.items() if log.faults}:
                survived[seed] = of_seed
            rounds.append(_rows(replayed, scene.neck.control_period_s))
    except Interrupted as stop:
        interrupted, reason = stop, "interrupted"
        if not first:
            raise
        if not rounds:  # the controllers completed under the first seed
            rounds.append(_rows(first, scene.neck.control_period_s))
    seeds = tuple(range(scene.seed, scene.seed + len(rounds)))
    return Repeated(first, by_controller(seeds, rounds), survived, _seeds_note(seeds, reason), plans, interrupted)


def _replay_each(
    scene: Scene, settings: ReplaySettings, controllers: Sequence[str], progress: Progress
) -> Iterator[tuple[str, Replayed, list[PlanMoment]]]:
    """Replays and their plans by a unique name of each controller, each as soon as it is complete."""
    chosen, names = list(dict.fromkeys(controllers)), list[str]()
    for k, controller in enumerate(chosen):
        planned: list[PlanMoment] = []

        def of_all(share: float, before: int = k) -> None:
            progress.at((before + share) / len(chosen))

        def keep(moment: Moment, planned: list[PlanMoment] = planned) -> None:
            if isinstance(moment, PlanMoment):
                planned.append(moment)

        found = replay_scene(scene, controller, settings.predictor, settings, of_all, keep)
        # The controller's name, with a number appended to a duplicate.
        plain = "".join(c if c.isalnum() or c in "-_.+" else "_" for c in found.log.run.controller)
        same = sum(other == plain or other.startswith(f"{plain}_") for other in names)
        names.append(f"{plain}_{same + 1}" if same else plain)
        yield names[-1], found, planned


def _rows(replayed: dict[str, Replayed], control_period_s: float) -> list[Row]:
    return make_rows(
        [
            (name, log.run.predictor, measure(log), measure_compute(times, control_period_s))
            for name, (log, times) in replayed.items()
        ]
    )


def _figures(rows: Sequence[Row]) -> str:
    # As text: NaN compares equal.
    return repr([(row.controller, row.metrics) for row in rows])


def _seeds_note(seeds: Sequence[int], reason: str) -> str:
    why = f" ({reason})" if reason else ""
    if len(seeds) == 1:
        return f"one seed of the noise, {seeds[0]}{why}"
    return (
        f"mean ± standard deviation over {len(seeds)} seeds of the noise, {seeds[0]} to {seeds[-1]}{why}; "
        f"peaks: highest of all; logs and figures: seed {seeds[0]}"
    )
