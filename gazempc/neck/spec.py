"""Specification of a neck: joints, geometry, limits, servo, dead time and rates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, Field, model_validator

from gazempc.neck.speed_steps import SpeedSteps
from gazempc.specfiles import Strict, load_spec, shipped_names
from gazempc.types import BoolArray, FloatArray

# The joints of every neck; optional joints of eyes and body follow.
AXES = ("pan", "tilt")
EYE_AXES = ("eye_pan", "eye_tilt")
BODY_AXIS = "body_yaw"
_Share = Annotated[float, Field(ge=0, le=1)]
# Replays of a whole walk are tested over the ranges below; beyond them the equations are ill-conditioned.
_View = Annotated[float, Field(gt=0, le=180)]
# Longer than any robot's arm or mast, metres.
_Offset = Annotated[float, Field(ge=-3, le=3)]
_Point = tuple[_Offset, _Offset, _Offset]

# Rules of thumb for parameters that are missing in a data sheet.
# Speed under load as a share of the no-load speed of the data sheet.
SPEED_SHARE = 0.8
# Acceleration to top speed within 0.2 s. The shipped necks have 3.3 to 6.
ACCELERATION_PER_SPEED_1_S = 5.0
# Full acceleration within 0.05 s, as in the shipped necks.
JERK_PER_ACCELERATION_1_S = 20.0
# Servo bandwidth of 1.9 Hz, as in the shipped necks `reference` and `fetch`.
NATURAL_FREQUENCY_RAD_S = 12.0
DAMPING_RATIO = 0.9
# Network plus the cycle of a robot's controller, as in `fetch` and `pr2`.
DEAD_TIME_S = 0.1
RULES: dict[str, str] = {
    "position_min_deg": "the end of the joint's range to the right, or down; straight ahead is 0",
    "position_max_deg": "the end of the joint's range to the left, or up; straight ahead is 0",
    "velocity_max_rad_s": f"{SPEED_SHARE:g} times the data sheet's top speed, in rad/s (1 rpm is 0.105)",
    "acceleration_max_rad_s2": f"{ACCELERATION_PER_SPEED_1_S:g} times velocity_max_rad_s",
    "jerk_max_rad_s3": f"{JERK_PER_ACCELERATION_1_S:g} times acceleration_max_rad_s2",
    "natural_frequency_rad_s": f"{NATURAL_FREQUENCY_RAD_S:g}, until it is measured",
    "damping_ratio": f"{DAMPING_RATIO:g}, until it is measured",
    "dead_time_s": f"{DEAD_TIME_S:g}, until it is measured",
}
_RULES = {field: f"rule of thumb: {rule}" for field, rule in RULES.items()}


class Geometry(Strict):
    """Positions of the axes and the eye. All zero: both axes intersect at the eye.

    At pan = tilt = 0 all frames are parallel to the base frame (x forward, y left, z up).
    """

    tilt_axis_in_pan_m: _Point = Field(default=(0.0, 0.0, 0.0), description="Tilt axis, seen from the pan axis, metres")
    eye_in_tilt_m: _Point = Field(
        default=(0.0, 0.0, 0.0), description="Eye, seen from the tilt axis, metres; it looks along +x"
    )


class Axis(Strict):
    """One joint: its limits and its servo ``x'' = wn^2 (c(t - dead time) - x) - 2 zeta wn x'``.

    x is the joint's angle q and c the commanded angle; with ``command = "velocity"`` x is its velocity and c the
    commanded speed. With c = u' a velocity-controlled joint moves as a position-controlled one with c = u: both satisfy
    ``q'' = wn^2 (u(t - dead time) - q) - 2 zeta wn q'``. So controllers need only one model.
    """

    command: Literal["position", "velocity"] = Field(
        default="position", description="What the joint is sent: an angle, or a speed that it holds"
    )
    speed_steps: SpeedSteps | None = Field(
        default=None, description="The speeds that a joint with speed commands has; None if it holds any speed"
    )
    full_speed_rad_s: float | None = Field(
        default=None, ge=0.01, le=1e3, description="Speed at the device's full command; None for velocity_max_rad_s"
    )
    position_min_deg: float = Field(ge=-360, le=360, description=_RULES["position_min_deg"])
    position_max_deg: float = Field(ge=-360, le=360, description=_RULES["position_max_deg"])
    velocity_max_rad_s: float = Field(ge=0.01, le=1e3, description=_RULES["velocity_max_rad_s"])
    acceleration_max_rad_s2: float = Field(ge=0.01, le=1e6, description=_RULES["acceleration_max_rad_s2"])
    jerk_max_rad_s3: float = Field(ge=0.1, le=1e9, description=_RULES["jerk_max_rad_s3"])
    natural_frequency_rad_s: float = Field(ge=0.01, le=1e3, description=_RULES["natural_frequency_rad_s"])
    damping_ratio: float = Field(gt=0.1, le=10, description=_RULES["damping_ratio"])
    dead_time_s: float = Field(ge=0, le=5, description=_RULES["dead_time_s"])
    rest_deg: float = Field(
        default=0.0, ge=-360, le=360, description="Where the joint stands without a person; it returns there slowly"
    )
    encoder_noise_deg: float = Field(
        default=0.0, ge=0, le=5, description="Standard deviation of the angle that a simulated joint reports"
    )
    load_offset_deg: float = Field(
        default=0.0,
        ge=-10,
        le=10,
        description="How far from its command a simulated joint settles under its load; unknown to controllers",
    )

    @model_validator(mode="after")
    def _values_fit_each_other(self) -> Axis:
        steps, low, high = self.speed_steps, self.position_min_deg, self.position_max_deg
        if low >= high:
            raise ValueError(f"position_min_deg ({low}) must be less than position_max_deg ({high})")
        if steps is not None and not self.takes_speed:
            raise ValueError('speed_steps need command = "velocity": angles have no speed steps')
        if steps is not None and self.velocity_max_rad_s > steps.fastest_rad_s * (1.0 + 1e-6):
            fastest = f"the last of speed_steps in both directions ({steps.fastest_rad_s})"
            raise ValueError(f"velocity_max_rad_s ({self.velocity_max_rad_s}) must be at most {fastest}")
        if self.takes_speed and self.load_offset_deg:
            raise ValueError(f'load_offset_deg ({self.load_offset_deg}) must be 0 with command = "velocity"')
        return self

    @property
    def takes_speed(self) -> bool:
        """Whether the joint is velocity-controlled."""
        return self.command == "velocity"

    @property
    def full_rad_s(self) -> float:
        """Speed at the full command, rad/s, for a device without a table of speeds."""
        return self.full_speed_rad_s or self.velocity_max_rad_s

    @property
    def servo_lag_s(self) -> float:
        """Lag of the ramp response, 2 zeta / wn, seconds."""
        return 2.0 * self.damping_ratio / self.natural_frequency_rad_s

    @property
    def servo_gain(self) -> float:
        """Peak-to-peak gain of the servo: the integral of |impulse response|.

        The joint's motion is ``u`` convolved with the impulse response h, so each derivative of it is bounded by the
        maximum of the same derivative of u times the integral of |h|. For a second-order servo with overshoot M the
        integral is (1 + M) / (1 - M); without overshoot it is 1.
        """
        if self.damping_ratio >= 1.0:
            return 1.0
        overshoot = math.exp(-math.pi * self.damping_ratio / math.sqrt(1.0 - self.damping_ratio**2))
        return (1.0 + overshoot) / (1.0 - overshoot)


class Eyes(Strict):
    """Eyes in the head, with conjugate motion (version) about `Geometry.eye_in_tilt_m`.

    At eye_pan = eye_tilt = 0 they look along +x of the head.
    """

    pan: Axis
    tilt: Axis
    head_share_pan: _Share = Field(
        default=1.0,
        description="Share of a sideways direction to which the head turns in the end; the eyes do the rest",
    )
    head_share_up: _Share = Field(default=1.0, description="The same of a direction above where the head rests")
    head_share_down: _Share = Field(default=1.0, description="The same of a direction below it")


def _of_joints(field: str, meaning: str) -> cached_property[FloatArray]:
    """Property with one value a joint, shape (N,)."""

    def values(neck: NeckSpec) -> FloatArray:
        return neck._per_axis(field)

    values.__doc__ = meaning
    return cached_property(values)


class NeckSpec(Strict):
    """A pan-tilt neck, optionally with eyes in the head and a body that turns under the neck.

    Arrays have shape (N,), one number a joint in the order of `joint_names`: pan, tilt, pan and tilt of the eyes, yaw
    of the body. N is 2, 3 (body), 4 (eyes) or 5.
    """

    name: str
    source: str = Field(description="Where the figures are from; printed with results")
    geometry: Geometry = Geometry()
    pan: Axis
    tilt: Axis
    eyes: Eyes | None = None
    body: Axis | None = Field(
        default=None, description="Yaw of the body under the neck, about the vertical through the base's origin"
    )
    reports_joints: bool = Field(default=True, description="False for a neck without encoders: it is driven open loop")
    head_view_deg: tuple[_View, _View] | None = Field(
        default=None,
        description="Field of view of the camera on the head that sees people, horizontal and vertical, full angles; "
        "None for a sensor elsewhere, or one that sees all around",
    )
    control_rate_hz: float = Field(default=50.0, ge=5, le=1000)
    servo_rate_hz: float = Field(default=200.0, gt=0, le=5000)

    @model_validator(mode="after")
    def _rates_divide(self) -> NeckSpec:
        ratio = self.servo_rate_hz / self.control_rate_hz
        if ratio < 1 or abs(ratio - round(ratio)) > 1e-9:
            rates = self.servo_rate_hz, self.control_rate_hz
            raise ValueError("servo_rate_hz ({}) must be a whole multiple of control_rate_hz ({})".format(*rates))
        return self

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> NeckSpec:
        """A copy with other values, checked like a new one, and without arrays computed from the old values."""
        plain = {k: v.model_dump() if isinstance(v, BaseModel) else v for k, v in (update or {}).items()}
        return NeckSpec.model_validate(self.model_dump() | plain)

    def __eq__(self, other: object) -> bool:
        # Compares fields only: cached arrays have no truth value.
        return isinstance(other, NeckSpec) and self.model_dump() == other.model_dump()

    def __hash__(self) -> int:
        return hash((self.name, self.geometry, self.axes, self.control_rate_hz, self.servo_rate_hz))

    def with_axes(self, axes: dict[str, Axis]) -> NeckSpec:
        """A copy with joints replaced by name."""
        joints = dict(zip(self.joint_names, self.axes, strict=True)) | axes
        update: dict[str, Any] = {name: joints[name] for name in AXES}
        if self.eyes is not None:
            update["eyes"] = self.eyes.model_copy(update={"pan": joints["eye_pan"], "tilt": joints["eye_tilt"]})
        return self.model_copy(update=update | ({} if self.body is None else {"body": joints[BODY_AXIS]}))

    @property
    def servo_period_s(self) -> float:
        """Time between two commands sent to the robot, seconds."""
        return 1.0 / self.servo_rate_hz

    @property
    def control_period_s(self) -> float:
        """Time between two plans, seconds."""
        return 1.0 / self.control_rate_hz

    @property
    def servo_ticks_per_plan(self) -> int:
        """Commands sent between two plans."""
        return round(self.servo_rate_hz / self.control_rate_hz)

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """All joints, in the order of `joint_names`."""
        eyes = () if self.eyes is None else (self.eyes.pan, self.eyes.tilt)
        return (self.pan, self.tilt, *eyes, *(() if self.body is None else (self.body,)))

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints: ``pan``, ``tilt``, then ``eye_pan``, ``eye_tilt`` and ``body_yaw`` if present."""
        return AXES + (() if self.eyes is None else EYE_AXES) + (() if self.body is None else (BODY_AXIS,))

    @property
    def joints(self) -> int:
        """N, the number of joints."""
        return len(self.axes)

    @cached_property
    def speed_joints(self) -> BoolArray:
        """Mask of the velocity-controlled joints, shape (N,)."""
        return np.array([axis.takes_speed for axis in self.axes])

    @property
    def takes_speeds(self) -> bool:
        """Whether any joint is velocity-controlled."""
        return bool(self.speed_joints.any())

    def _per_axis(self, name: str) -> FloatArray:
        """A field of all joints; degrees are converted to radians."""
        values = np.array([getattr(axis, name) for axis in self.axes], dtype=np.float64)
        return np.deg2rad(values) if name.endswith("_deg") else values

    velocity_max_rad_s = _of_joints("velocity_max_rad_s", "Velocity limits of the joints, rad/s.")
    acceleration_max_rad_s2 = _of_joints("acceleration_max_rad_s2", "Acceleration limits of the joints, rad/s^2.")
    jerk_max_rad_s3 = _of_joints("jerk_max_rad_s3", "Jerk limits of the joints, rad/s^3.")
    dead_time_s = _of_joints("dead_time_s", "Dead times, seconds.")
    servo_lag_s = _of_joints("servo_lag_s", "Servo lags, seconds.")
    position_min_rad = _of_joints("position_min_deg", "Lower position limits of the joints, radians.")
    position_max_rad = _of_joints("position_max_deg", "Upper position limits of the joints, radians.")

    @cached_property
    def command_limits(self) -> CommandLimits:
        """Limits of the command that guarantee the neck's limits for command and joint."""
        gain = self._per_axis("servo_gain")
        centre = 0.5 * (self.position_max_rad + self.position_min_rad)
        half = 0.5 * (self.position_max_rad - self.position_min_rad) / gain
        return CommandLimits(
            position_min_rad=centre - half,
            position_max_rad=centre + half,
            velocity_max_rad_s=self.velocity_max_rad_s / gain,
            acceleration_max_rad_s2=self.acceleration_max_rad_s2 / gain,
            jerk_max_rad_s3=self.jerk_max_rad_s3 / gain,
        )

    @cached_property
    def rest_rad(self) -> FloatArray:
        """Rest angles without a person: `Axis.rest_deg` clipped to the limits, radians."""
        return self.command_limits.clip_position(self._per_axis("rest_deg"))


@dataclass(frozen=True)
class CommandLimits:
    """Limits of a command, inside those of the neck (see `Axis.servo_gain`); arrays of shape (N,)."""

    position_min_rad: FloatArray
    position_max_rad: FloatArray
    velocity_max_rad_s: FloatArray
    acceleration_max_rad_s2: FloatArray
    jerk_max_rad_s3: FloatArray

    @property
    def derivatives(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Limits of velocity, acceleration and jerk."""
        return self.velocity_max_rad_s, self.acceleration_max_rad_s2, self.jerk_max_rad_s3

    def clip_position(self, position_rad: FloatArray) -> FloatArray:
        """Nearest allowed position, shape (..., N), radians."""
        return np.minimum(np.maximum(position_rad, self.position_min_rad), self.position_max_rad)


def neck_names() -> tuple[str, ...]:
    """Names of the necks that ship with the package."""
    return shipped_names("neck")


def load_neck(name_or_path: str | Path) -> NeckSpec:
    """Load a neck by name or path.

    Args:
        name_or_path: A shipped name (`neck_names`) or the path of a TOML file.

    Returns:
        The checked neck.

    Raises:
        SettingsError: If there is no such neck or a field is invalid; the message names file and field.
    """
    return load_spec(NeckSpec, "neck", name_or_path)
