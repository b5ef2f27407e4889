"""Forecasts of a walking person's head: one method a file, no knowledge of robots or gaze."""

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
