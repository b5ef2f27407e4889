"""The fields of a sensor file."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from gazempc.neck.kinematics import pan_tilt_rad
from gazempc.types import BoolArray, FloatArray


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class SightError(_Table):
    """White error and wander on an axis of the line of sight.

    The constant part and the part proportional to the range are one process: their variances add.
    """

    noise_m: float = Field(default=0.0, ge=0, le=5, description="White error, s.d., metres")
    wander_m: float = Field(default=0.0, ge=0, le=5, description="Wander, s.d., metres")
    wander_time_s: float = Field(default=1.0, gt=0, le=1000, description="Correlation time of the wander")

    @property
    @abstractmethod
    def _shares(self) -> tuple[float, float]:
        """White error and wander, s.d., as shares of the range."""

    @property
    def depends_on_sight(self) -> bool:
        """Whether the error is nonzero."""
        return any((self.noise_m, self.wander_m, *self._shares))

    def sds_m(self, range_m: FloatArray) -> FloatArray:
        """Standard deviations of white error and wander at ranges, shape (N,), metres; shape (2, N)."""
        noise_share, wander_share = self._shares
        sds_m = np.hypot(self.noise_m, noise_share * range_m), np.hypot(self.wander_m, wander_share * range_m)
        return np.array(sds_m)


class AlongError(SightError):
    """Error of the range."""

    noise_share: float = Field(default=0.0, ge=0, le=1, description="White error, s.d., share of the range")
    wander_share: float = Field(default=0.0, ge=0, le=1, description="Wander, s.d., share of the range")

    @property
    def _shares(self) -> tuple[float, float]:
        return self.noise_share, self.wander_share


class AcrossError(SightError):
    """Error on each of the two axes across the line of sight."""

    noise_deg: float = Field(default=0.0, ge=0, le=45, description="White error of the bearing, s.d., degrees")
    wander_deg: float = Field(default=0.0, ge=0, le=45, description="Wander of the bearing, s.d., degrees")

    @property
    def _shares(self) -> tuple[float, float]:
        return float(np.deg2rad(self.noise_deg)), float(np.deg2rad(self.wander_deg))


class Bouts(_Table):
    """Bouts of an error, with exponential intervals and uniform durations."""

    mean_interval_s: float = Field(
        default=math.inf,
        ge=0.001,  # a frame, at the highest rate of a sensor
        description="Mean time from the end of one bout to the start of the next; without it no bouts",
    )
    duration_min_s: float = Field(default=0.0, ge=0, le=1000, description="Shortest duration; 0: one frame")
    duration_max_s: float = Field(default=0.0, ge=0, le=1000, description="Longest duration")

    @model_validator(mode="after")
    def _durations_are_in_order(self) -> Bouts:
        _check_order("duration", "s", self.duration_min_s, self.duration_max_s)
        return self


class Jumps(Bouts):
    """Jumps of the track: random size, direction and duration."""

    size_min_m: float = Field(default=0.0, ge=0, le=10, description="Smallest jump, metres")
    size_max_m: float = Field(default=0.0, ge=0, le=10, description="Largest jump, metres")
    level: bool = Field(default=False, description="True: all jumps are horizontal")

    @model_validator(mode="after")
    def _sizes_are_in_order(self) -> Jumps:
        _check_order("size", "m", self.size_min_m, self.size_max_m)
        if self.size_max_m == 0 and self.mean_interval_s < math.inf:
            raise ValueError("size_max_m must be more than 0 where mean_interval_s is given")
        return self


class OtherPerson(_Table):
    """Periodic switches of the track to another person, at a constant offset to the left of the line of sight."""

    aside_m: float = Field(
        default=1.0, gt=0, le=10, description="Horizontal distance of the two, across the line of sight"
    )
    every_s: float = Field(
        default=math.inf,
        ge=0.001,
        description="Period; the end of it shows the other person. Without it there is no other person",
    )
    shown_s: float = Field(default=0.0, ge=0, le=1000, description="Time in each period that shows the other person")
    ids: bool = Field(default=False, description="Observations have the id of the person shown")

    @model_validator(mode="after")
    def _first_person_is_shown(self) -> OtherPerson:
        if self.shown_s >= self.every_s:
            raise ValueError(f"shown_s ({self.shown_s}) must be less than every_s ({self.every_s})")
        return self

    @property
    def is_there(self) -> bool:
        """Whether there are switches."""
        return self.shown_s > 0 and self.every_s < math.inf


class YawError(_Table):
    """Error of one yaw, with additional errors while this body part faces away from the sensor."""

    reported: bool = Field(default=True, description="False: the sensor does not see this orientation")
    noise_deg: float = Field(default=0.0, ge=0, le=90, description="White error, s.d., degrees")
    wander_deg: float = Field(default=0.0, ge=0, le=90, description="Wander, s.d., degrees")
    wander_time_s: float = Field(default=1.0, gt=0, le=1000, description="Correlation time of the wander")
    away_deg: float = Field(
        default=90.0, ge=0, le=180, description="Faces away: yaw off the direction to the sensor by more than this"
    )
    lost_share: float = Field(default=0.0, ge=0, le=1, description="Share of the time facing away without a yaw")
    flipped_share: float = Field(
        default=0.0, ge=0, le=1, description="Share of the time facing away with a yaw that is wrong by 180 degrees"
    )
    hold_s: float = Field(
        default=0.5, ge=0, le=1000, description="Mean time for which the yaw stays lost, flipped or right; 0: one frame"
    )

    @property
    def depends_on_sight(self) -> bool:
        """Whether the error depends on facing away."""
        return self.lost_share + self.flipped_share > 0

    @model_validator(mode="after")
    def _shares_are_of_one(self) -> YawError:
        if self.lost_share + self.flipped_share > 1:
            shares = f"lost_share ({self.lost_share}) and flipped_share ({self.flipped_share})"
            raise ValueError(f"{shares} must be 1 or less together")
        return self


class Timing(_Table):
    """Times of capture and arrival of frames, and errors of their stamps."""

    frame_jitter_s: float = Field(
        default=0.0, ge=0, le=10, description="Delay of each capture relative to the rate, uniform from 0 to this"
    )
    latency_jitter_s: float = Field(
        default=0.0, ge=0, le=10, description="Added to latency_s, uniform from 0 to this, independent per frame"
    )
    keeps_order: bool = Field(default=True, description="A frame waits for earlier frames; False: it may overtake them")
    stamp_offset_s: float = Field(
        default=0.0, ge=-1, le=1, description="Constant error of all stamps; positive: later than the capture"
    )
    stamp_noise_s: float = Field(default=0.0, ge=0, le=1, description="Error of each stamp, s.d., independent")


class FieldOfView(_Table):
    """Field of view, about the base's x axis or about the robot's gaze."""

    on: Literal["base", "head"] = Field(
        default="base", description="Mount of the sensor; head: the view turns with the neck in a replay"
    )
    horizontal_deg: float = Field(default=360.0, gt=0, le=360, description="Full angle, left to right")
    vertical_deg: float = Field(default=180.0, gt=0, le=180, description="Full angle, bottom to top")

    @property
    def limited(self) -> bool:
        """Whether the field of view is limited."""
        return self.horizontal_deg < 360.0 or self.vertical_deg < 180.0

    def contains(self, positions_m: FloatArray) -> BoolArray:
        """Mask of the heads in view.

        Args:
            positions_m: Heads in the sensor's frame: x forward, y left, z up; shape (N, 3), metres.

        Returns:
            Shape (N,).
        """
        azimuth_deg, elevation_deg = np.degrees(pan_tilt_rad(positions_m)).T
        in_width = np.abs(azimuth_deg) <= self.horizontal_deg / 2
        return np.asarray(in_width & (np.abs(elevation_deg) <= self.vertical_deg / 2))


def _check_order(what: str, unit: str, low: float, high: float) -> None:
    if low > high:
        raise ValueError(f"{what}_min_{unit} ({low}) must not be more than {what}_max_{unit} ({high})")


class SensorSpec(_Table):
    """A sensor that tracks people, at the origin of the base frame. Its errors are independent and additive."""

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
            missing = " and ".join(certain)
            raise ValueError(f"states_covariance needs an error {missing} the line of sight: no sensor is certain")
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
