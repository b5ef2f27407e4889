"""The fields of a sensor file."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from gazempc.sim.sensing.tables import (
    AcrossError,
    AlongError,
    Bouts,
    FieldOfView,
    Jumps,
    OtherPerson,
    SightError,
    Timing,
    YawError,
)


class SensorSpec(BaseModel):
    """A sensor that tracks people, at the origin of the base frame. Its errors are independent and additive."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    source: str = Field(description="Where the figures are from; printed with results")
    measures: Literal["truth", "recorded"] = Field(
        default="truth",
        description="truth: the true motion plus the errors below; recorded: the recording's measurements plus them",
    )
    rate_hz: float = Field(gt=0, le=1000)
    latency_s: float = Field(ge=0, le=5, description="From capture to arrival")
    position_noise_m: float = Field(default=0.0, ge=0, le=1, description="White error on each axis, s.d.")
    position_wander_m: float = Field(default=0.0, ge=0, le=1, description="Wander on each axis, s.d.")
    position_wander_time_s: float = Field(default=1.0, gt=0, le=1000, description="Its correlation time")
    yaw_noise_deg: float = Field(default=0.0, ge=0, le=90, description="White error of both yaws, independent, s.d.")
    range_min_m: float = Field(default=0.0, ge=0)
    range_max_m: float = Field(default=float("inf"), gt=0)
    dropout_probability: float = Field(default=0.0, ge=0, lt=1, description="Share of frames without the person")
    states_covariance: bool = Field(
        default=False, description="Observations state their covariance: white error plus wander, of position and yaws"
    )
    along: AlongError = AlongError()
    across: AcrossError = AcrossError()
    jumps: Jumps = Jumps()
    other_person: OtherPerson = OtherPerson()
    head_yaw: YawError = YawError()
    pelvis_yaw: YawError = YawError()
    loss: Bouts = Bouts()
    timing: Timing = Timing()
    view: FieldOfView = FieldOfView()

    @model_validator(mode="after")
    def _values_fit_each_other(self) -> SensorSpec:
        if self.range_min_m >= self.range_max_m:
            raise ValueError(f"range_min_m ({self.range_min_m}) must be less than range_max_m ({self.range_max_m})")
        errors: dict[str, SightError] = {"along": self.along, "across": self.across}
        certain = [name for name, error in errors.items() if not (self.each_axis_sd_m or error.depends_on_sight)]
        if self.states_covariance and certain:
            raise ValueError(
                f"states_covariance needs an error {' and '.join(certain)} the line of sight: no sensor is certain"
            )
        return self

    @property
    def each_axis_sd_m(self) -> float:
        """Standard deviation of isotropic white error and wander, without errors along and across, metres."""
        return math.hypot(self.position_noise_m, self.position_wander_m)

    @property
    def depends_on_place(self) -> bool:
        """Whether the observations depend on the position of the robot."""
        limited = self.view.limited or self.range_min_m > 0 or self.range_max_m < math.inf
        errors: tuple[SightError | YawError, ...] = (self.along, self.across, self.head_yaw, self.pelvis_yaw)
        return limited or self.other_person.is_there or any(error.depends_on_sight for error in errors)
