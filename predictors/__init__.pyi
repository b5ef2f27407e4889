"""Names of the package `predictors`, each from its module: the only list of them."""

from predictors.baselines.constant_acceleration import ConstantAcceleration as ConstantAcceleration
from predictors.baselines.coordinated_turn import CoordinatedTurn as CoordinatedTurn
from predictors.baselines.interacting_models import InteractingModels as InteractingModels
from predictors.baselines.particle import ParticleFilter as ParticleFilter
from predictors.bounds import LastPosition as LastPosition
from predictors.bounds import Perfect as Perfect
from predictors.constant_velocity import ConstantVelocity as ConstantVelocity
from predictors.geometry import bearing_covariance as bearing_covariance
from predictors.head_pose import HeadPose as HeadPose
from predictors.pelvis_pursuit import PelvisPursuit as PelvisPursuit
from predictors.predictor import NotReadyError as NotReadyError
from predictors.predictor import OutOfOrderError as OutOfOrderError
from predictors.predictor import Predictor as Predictor
from predictors.types import Forecast as Forecast
from predictors.types import HeadObservation as HeadObservation
from predictors.walker.predictor import Walker as Walker
