"""Sensors by name or path; `gazempc.sim.sensing` has the fields of their files and the simulation."""

from __future__ import annotations

from pathlib import Path

from gazempc.recordings.recording import Recording, truth_of
from gazempc.sim.sensing.observe import observe
from gazempc.sim.sensing.spec import SensorSpec
from gazempc.specfiles import load_spec, shipped_names

__all__ = ["SensorSpec", "default_sensor", "load_sensor", "observe", "sensor_names"]


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
        SettingsError: If there is no such sensor or a field is invalid; the message names file and field.
    """
    return load_spec(SensorSpec, "sim/sensors", name_or_path)


def default_sensor(recording: Recording) -> str:
    """Default sensor of a recording: its own if the true motion is unknown, else `reference`."""
    return "recorded" if truth_of(recording.kind) else "reference"
