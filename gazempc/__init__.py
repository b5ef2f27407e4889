"""Predictive gaze for robots: forecast a head, plan the neck over it, measure the gaze. May import predictors.

    import gazempc as gz

    log = gz.replay("subject03_R4", controller="mpc", predictor="walker")
    print(gz.measure(log).gaze_error_rms_deg)

Each name below is imported when it is first used, so that `import gazempc` is fast.
"""

from __future__ import annotations

import importlib
import logging
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gazempc.controllers.controller import Plan, Situation
    from gazempc.controllers.lookahead import LookAhead
    from gazempc.controllers.mpc.mpc import Mpc
    from gazempc.controllers.reactive import Reactive
    from gazempc.errors import GazempcError
    from gazempc.front import replay
    from gazempc.live.gaze import Gaze
    from gazempc.neck.spec import NeckSpec, load_neck
    from gazempc.recordings.arrays import recording_from_arrays
    from gazempc.recordings.load import load as load_recording
    from gazempc.recordings.recording import Recording
    from gazempc.results.log import Log, load_log
    from gazempc.results.metrics import Metrics, measure
    from gazempc.sim.sensing.spec import SensorSpec
    from gazempc.sim.sensor import load_sensor
    from gazempc.types import JointState
    from predictors import ConstantVelocity, Forecast, HeadObservation, Walker, bearing_covariance

_PLACES = {
    "ConstantVelocity": "predictors",
    "Forecast": "predictors",
    "Gaze": "gazempc.live.gaze",
    "GazempcError": "gazempc.errors",
    "HeadObservation": "predictors",
    "JointState": "gazempc.types",
    "Log": "gazempc.results.log",
    "LookAhead": "gazempc.controllers.lookahead",
    "Metrics": "gazempc.results.metrics",
    "Mpc": "gazempc.controllers.mpc.mpc",
    "NeckSpec": "gazempc.neck.spec",
    "Plan": "gazempc.controllers.controller",
    "Reactive": "gazempc.controllers.reactive",
    "Recording": "gazempc.recordings.recording",
    "SensorSpec": "gazempc.sim.sensing.spec",
    "Situation": "gazempc.controllers.controller",
    "Walker": "predictors",
    "bearing_covariance": "predictors",
    "load_log": "gazempc.results.log",
    "load_neck": "gazempc.neck.spec",
    "load_recording": "gazempc.recordings.load",
    "load_sensor": "gazempc.sim.sensor",
    "measure": "gazempc.results.metrics",
    "recording_from_arrays": "gazempc.recordings.arrays",
    "replay": "gazempc.front",
}
_NAMES_THERE = {"load_recording": "load"}

__all__ = [
    "ConstantVelocity",
    "Forecast",
    "Gaze",
    "GazempcError",
    "HeadObservation",
    "JointState",
    "Log",
    "LookAhead",
    "Metrics",
    "Mpc",
    "NeckSpec",
    "Plan",
    "Reactive",
    "Recording",
    "SensorSpec",
    "Situation",
    "Walker",
    "bearing_covariance",
    "load_log",
    "load_neck",
    "load_recording",
    "load_sensor",
    "measure",
    "recording_from_arrays",
    "replay",
]

# A library does not print: whoever wants the log lines configures logging.
logging.getLogger("gazempc").addHandler(logging.NullHandler())


def __getattr__(name: str) -> Any:
    """Import a name of the front door when it is first used."""
    if name not in _PLACES:
        raise AttributeError(f"module 'gazempc' has no attribute {name!r}; it offers {', '.join(__all__)}")
    value = getattr(importlib.import_module(_PLACES[name]), _NAMES_THERE.get(name, name))
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The names of the front door."""
    return sorted(__all__)
