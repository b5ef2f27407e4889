"""All settings of a run, typed and checked; files and command line fill the same model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gazempc.errors import SettingsError
from gazempc.loop.settings import LoopSettings
from gazempc.recordings.readers.options import ReadOptions
from gazempc.specfiles import explain

ControllerName = Literal["reactive", "lookahead", "mpc", "perfect"]
PredictorName = Literal[
    "last_position",
    "constant_velocity",
    "constant_acceleration",
    "coordinated_turn",
    "interacting_models",
    "particle",
    "head_pose",
    "pelvis_pursuit",
    "walker",
    "perfect",
]
PlacementName = Literal["recorded", "side"]
# The predictor with the least error on real people, as far as measured.
DEFAULT_PREDICTOR: PredictorName = "walker"


class _Settings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ConstantVelocitySettings(_Settings):
    """Predictor `constant_velocity`."""

    acceleration_psd: float = Field(default=0.05, gt=0, description="Noise density of the head's acceleration, m^2/s^3")
    position_noise_m: float = Field(default=0.01, gt=0, description="Standard deviation of a measurement")


class HeadPoseSettings(ConstantVelocitySettings):
    """Predictor `head_pose` (Tamaru et al. 2021)."""

    weight: float = Field(default=0.5, ge=0, le=1, description="w in equation 4")
    yaw_noise_rad: float = Field(default=0.05, gt=0, description="Standard deviation of a measurement")
    yaw_from: Literal["waist", "travel"] = Field(
        default="waist", description="What the head's yaw is relative to: the waist, or the direction of travel"
    )
    offset_removed: bool = Field(default=False, description="Take away the mean yaw since the track began")


class WalkerSettings(_Settings):
    """Predictor `walker`."""

    fitted: Path | None = Field(
        default=None,
        description="Model or folder of `python -m experiments.fit`; from a folder each person is forecast by the "
        "model that has not seen them; without it the model that ships with the package",
    )


class PelvisPursuitSettings(_Settings):
    """Predictor `pelvis_pursuit`."""

    gain: float = Field(default=0.75, ge=0, le=1, description="Share of the angle to the pelvis that is turned")
    turn_time_s: float = Field(default=0.11, gt=0, description="Time constant of the turn")
    acceleration_psd: float = Field(default=0.02, gt=0, description="Noise density of the head's acceleration, m^2/s^3")
    position_noise_m: float = Field(default=0.01, gt=0, description="Standard deviation of a measurement")


class ConstantAccelerationSettings(_Settings):
    """Predictor `constant_acceleration`."""

    jerk_psd: float = Field(default=0.003, gt=0, description="Noise density of the head's jerk, m^2/s^5")
    position_noise_m: float = Field(default=0.01, gt=0, description="Standard deviation of a measurement")


class _TurningSettings(_Settings):
    """What the predictors `coordinated_turn` and `particle` have in common."""

    acceleration_psd: float = Field(default=0.05, gt=0, description="Noise density of the speed's change, m^2/s^3")
    heading_psd: float = Field(default=0.1, gt=0, description="Noise density of the heading's rate, rad^2/s")
    turn_psd: float = Field(default=0.1, gt=0, description="Noise density of the turn rate's change, rad^2/s^3")
    turn_time_s: float = Field(default=1.0, gt=0, description="Time constant with which a turn dies away")
    position_noise_m: float = Field(default=0.01, gt=0, description="Standard deviation of a measurement")


class CoordinatedTurnSettings(_TurningSettings):
    """Predictor `coordinated_turn`."""

    yaw_cues: Literal["none", "pelvis", "both"] = Field(
        default="none",
        description="Orientations that are measured as the heading plus an offset; both is with the head",
    )


class ParticleSettings(_TurningSettings):
    """Predictor `particle`."""

    particles: int = Field(default=400, ge=2, description="How many")


class InteractingModelsSettings(_Settings):
    """Predictor `interacting_models`."""

    turn_rate_rad_s: float = Field(default=0.5, gt=0, description="Rate of the turns to the left and to the right")
    mode_time_s: float = Field(default=10.0, gt=0, description="Mean time that straight or turning lasts")
    acceleration_psd: float = Field(default=0.05, gt=0, description="Noise density of the head's acceleration, m^2/s^3")
    position_noise_m: float = Field(default=0.01, gt=0, description="Standard deviation of a measurement")


class PredictorSettings(_Settings):
    """Settings of all predictors."""

    constant_velocity: ConstantVelocitySettings = ConstantVelocitySettings()
    constant_acceleration: ConstantAccelerationSettings = ConstantAccelerationSettings()
    coordinated_turn: CoordinatedTurnSettings = CoordinatedTurnSettings()
    interacting_models: InteractingModelsSettings = InteractingModelsSettings()
    particle: ParticleSettings = ParticleSettings()
    head_pose: HeadPoseSettings = HeadPoseSettings()
    pelvis_pursuit: PelvisPursuitSettings = PelvisPursuitSettings()
    walker: WalkerSettings = WalkerSettings()


class LookAheadSettings(_Settings):
    """Controller `lookahead`."""

    smoothing_time_s: float = Field(
        default=0.0, ge=0, le=1, description="Time constant of a low-pass on the command; 0 for none"
    )


class MpcSettings(_Settings):
    """Controller `mpc`."""

    horizon_s: float = Field(default=0.8, ge=0.1, le=5, description="Optimised motion after the dead time")
    smoothing_time_s: float = Field(
        default=0.08, gt=0, le=1, description="Gaze motion faster than 1/this (rad/s) is smoothed away"
    )
    doubt_deg: float = Field(
        default=2.0, gt=0, le=1000, description="Standard deviation of the forecast that calls for more smoothing"
    )


class GazeSettings(PredictorSettings):
    """Settings of predictors, controllers and the loop, in a replay and live."""

    lookahead: LookAheadSettings = LookAheadSettings()
    mpc: MpcSettings = MpcSettings()
    loop: LoopSettings = LoopSettings()


class RunSettings(GazeSettings):
    """Settings of `python -m gazempc.run`."""

    replay: Annotated[str | None, tyro.conf.arg(metavar="NAME|PATH")] = Field(
        default=None,
        description="Recording: subject03_R4 (synthetic) or a .csv, .parquet, .json or .bvh file",
    )
    list: bool = Field(default=False, description="Print what can be replayed, and the necks and sensors")
    controllers: tuple[ControllerName, ...] = Field(
        default=("reactive", "lookahead", "mpc", "perfect"),
        min_length=1,
        description="What to compare; perfect is the mpc with the true future",
    )
    predictor: PredictorName = Field(default=DEFAULT_PREDICTOR, description="Forecast of the head")
    neck: str = Field(default="reference", description="Shipped neck or a .toml file")
    sensor: str | None = Field(
        default=None,
        description="Shipped sensor or a .toml file; without it the recording's own for body tracking, else reference",
    )
    placement: PlacementName | None = Field(
        default=None,
        description="Where the robot stands; without it where the recording's sensor stood, "
        "or at the side if there was none",
    )
    distance_m: float = Field(default=2.5, gt=0, description="Distance from the walk, for placement side")
    height_m: float = Field(default=1.2, description="Height above the floor, for placement side")
    seed: int = Field(default=0, ge=0, description="Seed of the sensor's noise")
    out: Path | None = Field(default=None, description="Where to write; without it out/<recording>")
    figures: bool = Field(default=True, description="Draw figures and the animation")
    config: Path | None = Field(default=None, description="YAML file with any of these settings; the command line wins")
    start_offset_deg: float = Field(
        default=0.0, ge=-360, le=360, description="Pan at the start, from looking at the first observed head"
    )
    reading: ReadOptions = ReadOptions()


def load_settings(path: Path) -> RunSettings:
    """Read settings from a YAML file.

    Args:
        path: File with a mapping of settings; nested ones as nested mappings.

    Returns:
        The settings, defaults where the file says nothing.

    Raises:
        SettingsError: If the file cannot be read, or with every unknown key (and what it perhaps meant) and every wrong
            value in it.
    """
    try:
        data: Any = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SettingsError(f"{path}: not a text file") from None
    except yaml.YAMLError as error:
        raise SettingsError(f"{path}: not valid YAML: {error}") from None
    if data is None:
        data = {}
    if not isinstance(data, dict):
        raise SettingsError(f"{path}: expected a mapping of settings such as 'neck: slow', got {data!r}")
    try:
        return RunSettings.model_validate(data)
    except ValidationError as error:
        raise SettingsError(explain(error, str(path), RunSettings)) from None
