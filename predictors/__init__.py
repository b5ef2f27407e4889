"""Forecasts of a walking person's head: one method a file, no knowledge of robots or gaze."""

from predictors.constant_velocity import ConstantVelocity
from predictors.head_pose import HeadPose
from predictors.last_position import LastPosition
from predictors.perfect import Perfect
from predictors.predictor import NotReadyError, OutOfOrderError, Predictor
from predictors.types import Forecast, HeadObservation

__all__ = [
    "ConstantVelocity",
    "Forecast",
    "HeadObservation",
    "HeadPose",
    "LastPosition",
    "NotReadyError",
    "OutOfOrderError",
    "Perfect",
    "Predictor",
]
