"""How late contact is back after a look away, of each controller, with people who walk."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gazempc.people.schedule import LookAways
from gazempc.recordings.synthetic.walks import synthetic_names
from gazempc.results.attention import measure_attention
from gazempc.settings import DEFAULT_PREDICTOR
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene

CONTROLLERS = ("reactive", "lookahead", "mpc", "perfect")
# The neck has acquired the person by then, and all walks last longer than the look away and a second.
_START_S, _LASTS_S = 1.6, 1.4


def return_late_s(controller: str, every: int, neck: str) -> list[float]:
    """Let each of the synthetic people walk by, and look away once.

    Args:
        controller: Name of the controller.
        every: One of so many walks.
        neck: Name of the neck.

    Returns:
        How much later than planned contact was back, seconds, a number a walk; infinite where it never was.
    """
    found = []
    for seed, name in enumerate(synthetic_names()[::every]):
        scene = make_scene(name, SceneSettings(neck=neck))
        look_aways = LookAways(scene.neck, seed=seed)
        look_aways.think(0.0, _LASTS_S, _START_S)
        log = replay_scene(scene, controller, DEFAULT_PREDICTOR, ReplaySettings(), look_aways=look_aways).log
        late_s = measure_attention(log).return_late_s
        found.append(late_s if np.isfinite(late_s) else float("inf"))
    return found


def row(controller: str, neck: str, late_s: Sequence[float]) -> list[str]:
    """A row of the table.

    Args:
        controller: Name of the controller.
        neck: Name of the neck.
        late_s: Of each walk.

    Returns:
        Controller, neck, median, 90 % within, number of walks, and of those after which contact was never back.
    """
    ms = 1e3 * np.array(late_s)
    return [
        controller,
        neck,
        _said(float(np.median(ms))),
        _said(float(np.percentile(ms, 90, method="inverted_cdf"))),
        str(ms.size),
        str(int(np.isinf(ms).sum())),
    ]


def _said(ms: float) -> str:
    return f"{ms:.0f}" if np.isfinite(ms) else "never"
