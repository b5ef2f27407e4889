"""What the robot sees of a recording: rate, latency, noise, range, dropouts."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from gazempc.errors import SettingsError
from gazempc.recordings.recording import Recording, turned
from gazempc.specfiles import load_spec, shipped_names
from gazempc.types import FloatArray, Sighting
from predictors import HeadObservation


class SensorSpec(BaseModel):
    """A sensor that tracks people."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    source: str = Field(description="Where the figures are from; printed with results")
    measures: Literal["truth", "recorded"] = Field(
        default="truth",
        description="truth: the true motion plus the noise below; recorded: what the recording's tracker measured",
    )
    rate_hz: float = Field(gt=0, le=1000)
    latency_s: float = Field(ge=0, le=5, description="From capture to arrival")
    position_noise_m: float = Field(ge=0, le=1, description="Standard deviation on each axis")
    yaw_noise_deg: float = Field(ge=0, le=90, description="Standard deviation, head and pelvis independently")
    range_min_m: float = Field(default=0.0, ge=0)
    range_max_m: float = Field(default=float("inf"), gt=0)
    dropout_probability: float = Field(default=0.0, ge=0, lt=1, description="Share of frames without the person")

    @model_validator(mode="after")
    def _range_is_not_empty(self) -> SensorSpec:
        if self.range_min_m >= self.range_max_m:
            raise ValueError(f"range_min_m ({self.range_min_m}) must be less than range_max_m ({self.range_max_m})")
        return self


def sensor_names() -> tuple[str, ...]:
    """Names of the sensors that ship with the package."""
    return shipped_names("sim/sensors")


def load_sensor(name_or_path: str | Path) -> SensorSpec:
    """Load a sensor by name or path.

    Args:
        name_or_path: A shipped name (`sensor_names`) or the path of a TOML file.

    Returns:
        The checked sensor.

    Raises:
        SettingsError: If there is no such sensor or a field is wrong; the message names file and field.
    """
    return load_spec(SensorSpec, "sim/sensors", name_or_path)


def default_sensor(recording: Recording) -> str:
    """The sensor that fits a recording: its own where the true motion is not known, else `reference`."""
    return "recorded" if recording.kind == "body tracking" else "reference"


def observe(placed: Recording, sensor: SensorSpec, seed: int) -> tuple[Sighting, ...]:
    """See a recording through a sensor.

    Args:
        placed: The recording in the robot's base frame.
        sensor: The sensor.
        seed: Seed of noise and dropouts. The recording's name is mixed in, so that two recordings do not share
            noise; all controllers see the same.

    Returns:
        The sightings in order of capture; an orientation that the recording does not know is None.

    Raises:
        SettingsError: If the sensor is ``recorded`` but the recording has no measured track, or nothing is seen.
    """
    track = placed.truth
    if sensor.measures == "recorded":
        if placed.measured is None:
            raise SettingsError(
                f"sensor {sensor.name!r} replays what a body tracker measured, but {placed.name} ({placed.kind}) has "
                f"no such track; accepted: a sensor with measures = \"truth\", such as 'reference' or 'perfect'"
            )
        track = placed.measured
    rng = np.random.default_rng([seed, zlib.crc32(placed.name.encode())])
    # Drawn for every frame of the recording, so that a frame's noise does not depend on which frames are used.
    frames = placed.times_s.size
    jitter_m = sensor.position_noise_m * rng.standard_normal((frames, 3))
    turn_rad = np.deg2rad(sensor.yaw_noise_deg) * rng.standard_normal((frames, 2))
    missed = rng.random(frames) < sensor.dropout_probability
    positions_m = track.head_position_m + jitter_m
    seen = [
        i
        for i in _frames_used(placed.times_s, sensor.rate_hz)
        if track.valid[i]
        and not missed[i]
        and sensor.range_min_m <= float(np.linalg.norm(positions_m[i])) <= sensor.range_max_m
    ]
    if not seen:
        raise SettingsError(f"sensor {sensor.name!r} never sees the person in {placed.name}: check its range")
    # All frames at once: a rotation alone takes as long.
    heads = turned(track.head_quat_wxyz[seen], turn_rad[seen, 0])
    pelvises = turned(track.pelvis_quat_wxyz[seen], turn_rad[seen, 1])
    observations = [
        HeadObservation(float(placed.times_s[i]), positions_m[i], _if_known(head), _if_known(pelvis))
        for i, head, pelvis in zip(seen, heads, pelvises, strict=True)
    ]
    return tuple(Sighting(o.capture_time_s + sensor.latency_s, o) for o in observations)


def _frames_used(times_s: FloatArray, rate_hz: float) -> FloatArray | range:
    # A recording at (nearly) the sensor's rate or below is seen frame by frame; a faster one is thinned to the
    # frames nearest to the sensor's ticks.
    if float(np.median(np.diff(times_s))) * rate_hz > 0.9:
        return range(times_s.size)
    ticks = np.arange(times_s[0], times_s[-1] + 1e-9, 1.0 / rate_hz)
    after = np.clip(np.searchsorted(times_s, ticks), 1, times_s.size - 1)
    nearer_before = ticks - times_s[after - 1] < times_s[after] - ticks
    return np.unique(after - nearer_before)


def _if_known(quat_wxyz: FloatArray) -> FloatArray | None:
    return quat_wxyz if np.isfinite(quat_wxyz).all() else None
