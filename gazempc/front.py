"""Public functions of `import gazempc` that combine several packages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gazempc.controllers.controller import Controller
from gazempc.neck.spec import NeckSpec
from gazempc.part_options import check_options
from gazempc.parts import CONTROLLER, PREDICTOR
from gazempc.recordings.placement import Placement
from gazempc.recordings.recording import Recording
from gazempc.results.log import Log
from gazempc.settings import DEFAULT_PREDICTOR
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import make_scene
from gazempc.sim.sensor import SensorSpec
from gazempc.specfiles import checked
from predictors import Predictor


def replay(
    recording: str | Path | Recording,
    *,
    neck: str | Path | NeckSpec = "reference",
    controller: str | Controller = "mpc",
    predictor: str | Predictor = DEFAULT_PREDICTOR,
    sensor: str | Path | SensorSpec | None = None,
    placement: Placement | None = None,
    seed: int = 0,
    **settings: Any,
) -> Log:
    """Replay a recording to one controller on a simulated neck.

    The same arguments give the same log to the last bit. A user-defined object is tested first: missing methods and
    wrong shapes are reported at once.

    Args:
        recording: Name of a synthetic recording, path of a file, or a recording.
        neck: Name of a shipped neck, path of a TOML file, or a neck.
        controller: Name (``reactive``, ``lookahead``, ``mpc``; ``mpc+perfect`` is the MPC with the true future),
            ``module:Class``, or a controller.
        predictor: Name, ``module:Class``, or a predictor.
        sensor: Name, path, or a sensor; None for the recording's default.
        placement: ``recorded`` or ``side``; None for the recording's default.
        seed: Seed of the sensor's noise.
        **settings: Any other setting of `gazempc.sim.replay.ReplaySettings`, such as ``distance_m=1.0``,
            ``mpc={"horizon_s": 0.6}``, ``attend="nearest"`` or ``options={"gain": 0.3}`` for a user-defined part.

    Returns:
        The log.

    Raises:
        GazempcError: If a name does not exist, a file or setting is wrong, or the recording is too short. Also if the
            robot would be too near to the person, or a user-defined part is invalid.
    """
    named = {
        "neck": neck.name if isinstance(neck, NeckSpec) else str(neck),
        "sensor": None if sensor is None or isinstance(sensor, SensorSpec) else str(sensor),
        "placement": placement,
        "seed": seed,
    }
    if isinstance(predictor, str):
        named["predictor"] = predictor
    chosen = checked(ReplaySettings, {**settings, **named}, "replay")
    parts = ((PREDICTOR, predictor), (CONTROLLER, controller))
    check_options([(kind, choice) for kind, choice in parts if isinstance(choice, str)], chosen.options)
    scene = make_scene(
        recording,
        chosen,
        neck if isinstance(neck, NeckSpec) else None,
        sensor if isinstance(sensor, SensorSpec) else None,
        all_people=chosen.attend is not None,
    )
    return replay_scene(scene, controller, predictor, chosen).log
