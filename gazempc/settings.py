"""Typed and validated settings of the parts of a run, for files and command lines."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import AfterValidator, Field, model_validator
from tyro.constructors import PrimitiveConstructorSpec

from gazempc.neck.picture import Framing
from gazempc.parts import (
    BY_NAME,
    CONTROLLER,
    POLICY,
    PREDICTOR,
    TRUE_FUTURE,
    Kind,
    check_choice,
    check_function,
    check_gaze,
)
from gazempc.specfiles import Strict


def on_command_line(kind: Kind, check: Callable[[str], str] | None = None) -> PrimitiveConstructorSpec[str]:
    """Parser of a part's choice on the command line; lists shipped names, and refuses unknown ones.

    Args:
        kind: The kind of part.
        check: Validates the choice; default: `check_choice`.

    Returns:
        Annotation of the type for tyro.
    """
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"{{{','.join(kind.shipped)},module:Class}}",
        instance_from_str=lambda words: (check or partial(check_choice, kind))(words[0]),
        is_instance=lambda value: isinstance(value, str),
        str_from_instance=lambda value: [value],
    )


_AboveZero = Annotated[float, Field(gt=0)]
# A shipped name, or module:Class for a user-defined part; see `gazempc.parts`.
ControllerChoice = Annotated[str, AfterValidator(partial(check_choice, CONTROLLER)), on_command_line(CONTROLLER)]
PredictorChoice = Annotated[str, AfterValidator(partial(check_choice, PREDICTOR)), on_command_line(PREDICTOR)]
# In replays a controller may have its own predictor: mpc+perfect.
GazeChoice = Annotated[str, AfterValidator(check_gaze), on_command_line(CONTROLLER, check_gaze)]
GAZES = ("reactive", "lookahead", "mpc", TRUE_FUTURE)
# The predictor with the smallest measured error on real people.
DEFAULT_PREDICTOR = "walker"


class Settings(Strict):
    """Base of all settings."""


NoiseM = Annotated[float, Field(ge=1e-6, le=1e3, description="Measurement noise (s.d.) without a stated covariance")]


class ConstantVelocitySettings(Settings):
    """Predictor `constant_velocity`."""

    acceleration_psd: float = Field(
        default=0.05, gt=0, le=1e6, description="Noise density of the head's acceleration, m^2/s^3"
    )
    position_noise_m: NoiseM = 0.01


class HeadPoseSettings(ConstantVelocitySettings):
    """Predictor `head_pose` (Tamaru et al. 2021)."""

    weight: float = Field(default=0.5, ge=0, le=1, description="w in equation 4")
    yaw_noise_rad: float = Field(
        default=0.05, ge=1e-6, le=1e3, description="Measurement noise (s.d.) without a stated covariance"
    )
    yaw_from: Literal["waist", "travel"] = Field(
        default="waist", description="Reference of the head's yaw: the waist, or the direction of travel"
    )
    offset_removed: bool = Field(default=False, description="Subtract the mean yaw since the start of the track")


class WalkerSettings(Settings):
    """Predictor `walker`."""

    fitted: Path | None = Field(
        default=None,
        description="Model or folder of `python -m experiments.fit`; from a folder each person gets the "
        "model fitted without this person; default: the shipped model",
    )
    threshold: float | None = Field(
        default=None,
        ge=-20,
        le=20,
        description="Threshold of the walking logit for the forecast of a walk: higher gives fewer false starts and "
        "a later detection of starts; default: the model's",
    )


class CoordinatedTurnSettings(Settings):
    """Predictor `coordinated_turn`."""

    yaw_cues: Literal["none", "pelvis", "both"] = Field(
        default="none",
        description="Orientations that the filter uses as measurements of the heading; both: pelvis and head",
    )


class PredictorSettings(Settings):
    """Settings of predictors; others use the defaults of their constructors."""

    constant_velocity: ConstantVelocitySettings = ConstantVelocitySettings()
    coordinated_turn: CoordinatedTurnSettings = CoordinatedTurnSettings()
    head_pose: HeadPoseSettings = HeadPoseSettings()
    walker: WalkerSettings = WalkerSettings()


class LookAheadSettings(Settings):
    """Controller `lookahead`."""

    smoothing_time_s: float = Field(
        default=0.1, ge=0, le=1, description="Time constant of the low-pass on the command; 0 for none"
    )
    head_smoothing_time_s: float | None = Field(
        default=None,
        ge=0,
        le=2,
        description="The same for the head of a neck with eyes; default 0.6, or 0.1 if the head leaves a share "
        "to the eyes (--motion human)",
    )


OwnFunction = Annotated[str, AfterValidator(check_function)]


class MpcSettings(Settings):
    """Controller `mpc`."""

    horizon_s: float = Field(default=0.8, ge=0.1, le=5, description="Length of the plan after the dead time")
    smoothing_time_s: float | None = Field(
        default=None,
        gt=0,
        le=1,
        description="Smoothing time T; larger is smoother, less accurate; default 0.12, down to 0.07 for a neck whose "
        "dead time and lag are shorter than 0.2 s",
    )
    acquisition_time_s: float = Field(
        default=0.09, gt=0, le=1, description="T during acquisition from a large gaze error"
    )
    head_smoothing_time_s: float | None = Field(
        default=None,
        gt=0,
        le=1,
        description="smoothing_time_s for the head of a neck with eyes; default 0.35, or 0.1 if the head leaves "
        "a share to the eyes (--motion human)",
    )
    terms: tuple[OwnFunction, ...] = Field(
        default=(), description="Your own costs, module:function, of pan and tilt; pan=module:function of one joint"
    )
    rows: tuple[OwnFunction, ...] = Field(
        default=(), description="Your own limits, module:function: rows bounded by +-1; same syntax as the terms"
    )


COMPUTE_DELAY_MEANS = "Time from the start of planning to the plan's first command"


class LoopSettings(Settings):
    """Timeouts of the loop, and limits of a run in addition to the neck's."""

    compute_delay_s: float = Field(default=0.0, ge=0, le=0.1, description=COMPUTE_DELAY_MEANS)
    stale_after_s: float = Field(default=0.5, gt=0, description="An observation older than this is dropped")
    lost_after_s: float = Field(default=1.0, gt=0, description="After this time without an observation, the neck stops")
    rest_after_s: float = Field(
        default=3.0, gt=0, description="After this time without an observation, the neck returns to rest"
    )
    rest_speed_rad_s: float = Field(default=0.5, ge=0.01, description="Speed of the return to rest")

    gaze_region_deg: tuple[float, float, float, float] | None = Field(
        default=None, description="Allowed gaze: minimum and maximum pan, minimum and maximum tilt"
    )
    speed_max_rad_s: Annotated[float | None, tyro.conf.arg(aliases=["--loop.speed-max"])] = Field(
        default=None, ge=0.01, description="Maximum speed of each joint"
    )
    near_speed_max: tuple[_AboveZero, _AboveZero] | None = Field(
        default=None,
        description="Distance of a head from the pan axis, metres, and the maximum speed of each joint's command while "
        "any head is nearer, rad/s",
    )

    @model_validator(mode="after")
    def _lost_before_rest(self) -> LoopSettings:
        if self.rest_after_s < self.lost_after_s:
            raise ValueError(f"rest_after_s ({self.rest_after_s}) is less than lost_after_s ({self.lost_after_s})")
        return self


def _checked_attend(choice: str) -> str:
    if choice == BY_NAME:
        raise ValueError("id: needs a name: id:NAME, the tracker's name of the person")
    return choice if choice.startswith(BY_NAME) else check_choice(POLICY, choice)


class AttentionSettings(Settings):
    """The choice among several people, see `--attend`."""

    hysteresis_s: float = Field(
        default=0.5, ge=0, description="Time for which another person must continuously be the better choice"
    )
    dwell_s: float = Field(default=1.5, ge=0, description="Minimum duration of attention to a person")
    enter_m: float | None = Field(
        default=None, gt=0, description="A person becomes a candidate within this distance; default: no limit"
    )
    leave_m: float | None = Field(
        default=None, gt=0, description="A candidate remains one up to this distance; default: enter_m"
    )
    most_people: int = Field(default=20, ge=1, description="Maximum number of candidates, the nearest ones")

    @model_validator(mode="after")
    def _leave_behind_enter(self) -> AttentionSettings:
        if self.leave_m is not None and (self.enter_m is None or self.leave_m < self.enter_m):
            raise ValueError(f"leave_m ({self.leave_m}) needs an enter_m of at most this distance ({self.enter_m})")
        return self


LookAwayMode = Literal["no", "told", "listening", "speaking"]


class LookAwaySettings(Settings):
    """Gaze aversion, see `--look-away.rhythm`."""

    rhythm: LookAwayMode = Field(
        default="no",
        description="Look away like a listener, like a speaker, or only after a cue (told); default: never",
    )
    seed: int = Field(default=0, ge=0, description="Seed of times and directions")


class GazeSettings(PredictorSettings):
    """Settings of predictors, controllers and the loop, in a replay and live."""

    attend: Annotated[str, AfterValidator(_checked_attend)] | None = Field(
        default=None,
        description="Person to look at among several: nearest, engaged, approaching, speaker, id:NAME (the "
        "tracker's name), module:Class for your own policy. Default: all observations are one person's",
    )
    attention: AttentionSettings = AttentionSettings()
    look_away: LookAwaySettings = LookAwaySettings()

    @model_validator(mode="after")
    def _all_are_tracked(self) -> GazeSettings:
        if self.framing.subject == "all" and self.attend is None:
            raise ValueError("framing.subject all: accepted with attend, such as nearest, which tracks each person")
        return self

    @property
    def several(self) -> bool:
        """Whether attention or gaze aversion is enabled."""
        return self.attend is not None or self.look_away.rhythm != "no"

    lookahead: LookAheadSettings = LookAheadSettings()
    mpc: MpcSettings = MpcSettings()
    framing: Framing = Framing(subject="no")
    loop: LoopSettings = LoopSettings()
