"""Replay a scene to several controllers, under one seed of the noise after the other."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from gazempc.command import Progress
from gazempc.results.metrics import measure
from gazempc.results.moments import Moment, PlanMoment
from gazempc.results.run_summary import Row, faults, make_rows, measure_compute
from gazempc.results.table import Repeats, by_controller
from gazempc.signals import Interrupted
from gazempc.sim.replay import Replayed, ReplaySettings, replay_scene
from gazempc.sim.scene import Scene

DEFAULT_SEEDS = 8
# Longest wait for repetitions that were not requested.
PATIENCE_S = 10.0


@dataclass(frozen=True)
class Repeated:
    """Replays and figures of repeated replays.

    Attributes:
        first: The replays under the first seed, by a name of the controller that fits a file and is there once.
        repeats: The figures of each controller, in the same order.
        faults: Exceptions that runs survived, by seed, then by the same names; only where there are some.
        seeds_note: Number of noise seeds and the reason, as a sentence.
        interrupted: The signal that ended the repetitions before all were done.
        plans: The plans of the replays under the first seed, by the names of `first`; a log does not hold them.
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
    """Replay a scene under seeds from its own on.

    Args:
        scene: Walk, neck, sensor and first seed.
        settings: Predictor and parameters of the parts.
        controllers: Names of the controllers.
        count: Number of seeds; None for 8, or as many as fit into ten seconds, or one if the noise makes no difference.
        progress: Shows the replay under way.

    Returns:
        Replays and figures.

    Raises:
        Interrupted: By a signal before the first replay is complete; later what is complete is returned.
        LeftOutError: If the recording is too short to be scored.
        SettingsError: If a part cannot be made, or violates its interface.
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
            kept: dict[str, list[PlanMoment]] = {} if done else plans
            _replay_each(replace(scene, seed=seed), settings, controllers, progress, replayed, kept)
            if of_seed := {name: faults(log) for name, (log, _) in replayed.items() if log.faults}:
                survived[seed] = of_seed
            rounds.append(_rows(replayed, scene.neck.control_period_s))
    except Interrupted as stop:
        interrupted, reason = stop, "interrupted"
        if not first:
            raise
        if not rounds:  # the controllers that were complete under the first seed
            rounds.append(_rows(first, scene.neck.control_period_s))
    seeds = tuple(range(scene.seed, scene.seed + len(rounds)))
    return Repeated(first, by_controller(seeds, rounds), survived, _seeds_note(seeds, reason), plans, interrupted)


def _replay_each(
    scene: Scene,
    settings: ReplaySettings,
    controllers: Sequence[str],
    progress: Progress,
    replayed: dict[str, Replayed],
    plans: dict[str, list[PlanMoment]],
) -> None:
    """Replay to each controller, and keep each replay and its plans as soon as it is complete."""
    chosen = list(dict.fromkeys(controllers))
    for k, controller in enumerate(chosen):
        planned: list[PlanMoment] = []

        def of_all(share: float, before: int = k) -> None:
            progress.at((before + share) / len(chosen))

        def keep(moment: Moment, planned: list[PlanMoment] = planned) -> None:
            if isinstance(moment, PlanMoment):
                planned.append(moment)

        found = replay_scene(scene, controller, settings.predictor, settings, of_all, keep)
        # A controller's name, with a number after an earlier one of the same name.
        plain = "".join(c if c.isalnum() or c in "-_.+" else "_" for c in found.log.run.controller)
        same = sum(other == plain or other.startswith(f"{plain}_") for other in replayed)
        name = f"{plain}_{same + 1}" if same else plain
        replayed[name], plans[name] = found, planned


def _rows(replayed: dict[str, Replayed], control_period_s: float) -> list[Row]:
    return make_rows(
        [
            (name, log.run.predictor, measure(log), measure_compute(times, control_period_s))
            for name, (log, times) in replayed.items()
        ]
    )


def _figures(rows: Sequence[Row]) -> str:
    # As text, in which NaN is the same as NaN.
    return repr([(row.controller, row.metrics) for row in rows])


def _seeds_note(seeds: Sequence[int], reason: str) -> str:
    why = f" ({reason})" if reason else ""
    if len(seeds) == 1:
        return f"one seed of the noise, {seeds[0]}{why}"
    return (
        f"mean ± standard deviation over {len(seeds)} seeds of the noise, {seeds[0]} to {seeds[-1]}{why}; "
        f"peaks: highest of all; logs and figures: seed {seeds[0]}"
    )
