"""Forecasts of a walking person's head: one method a file. May import nothing of gazempc.

Each name below is imported when it is first used: SciPy, which most of them need, takes a third of a second.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from predictors.baselines.constant_acceleration import ConstantAcceleration
    from predictors.baselines.coordinated_turn import CoordinatedTurn
    from predictors.baselines.interacting_models import InteractingModels
    from predictors.baselines.particle import ParticleFilter
    from predictors.bearing import bearing_covariance
    from predictors.constant_velocity import ConstantVelocity
    from predictors.head_pose import HeadPose
    from predictors.last_position import LastPosition
    from predictors.pelvis_pursuit import PelvisPursuit
    from predictors.perfect import Perfect
    from predictors.predictor import NotReadyError, OutOfOrderError, Predictor
    from predictors.types import Forecast, HeadObservation
    from predictors.walker.predictor import Walker

_PLACES = {
    "ConstantAcceleration": "predictors.baselines.constant_acceleration",
    "ConstantVelocity": "predictors.constant_velocity",
    "CoordinatedTurn": "predictors.baselines.coordinated_turn",
    "Forecast": "predictors.types",
    "HeadObservation": "predictors.types",
    "HeadPose": "predictors.head_pose",
    "InteractingModels": "predictors.baselines.interacting_models",
    "LastPosition": "predictors.last_position",
    "NotReadyError": "predictors.predictor",
    "OutOfOrderError": "predictors.predictor",
    "ParticleFilter": "predictors.baselines.particle",
    "PelvisPursuit": "predictors.pelvis_pursuit",
    "Perfect": "predictors.perfect",
    "Predictor": "predictors.predictor",
    "Walker": "predictors.walker.predictor",
    "bearing_covariance": "predictors.bearing",
}

__all__ = [
    "ConstantAcceleration",
    "ConstantVelocity",
    "CoordinatedTurn",
    "Forecast",
    "HeadObservation",
    "HeadPose",
    "InteractingModels",
    "LastPosition",
    "NotReadyError",
    "OutOfOrderError",
    "ParticleFilter",
    "PelvisPursuit",
    "Perfect",
    "Predictor",
    "Walker",
    "bearing_covariance",
]


def __getattr__(name: str) -> Any:
    """Import a name when it is first used."""
    if name not in _PLACES:
        raise AttributeError(f"module 'predictors' has no attribute {name!r}; it offers {', '.join(__all__)}")
    value = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The names of the package."""
    return sorted(__all__)
