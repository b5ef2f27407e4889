"""A point of a sweep: settings changed by dotted names, resolved to all that a run needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from experiments.engine.choices import options_of, sensors_by_name
from experiments.engine.replays import ReplayJob
from experiments.sweep.names import DEAD_TIME_SCALE, OPTION, accepted, check_settings, setting_fields
from gazempc.errors import SettingsError
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.sim.replay import ReplaySettings
from gazempc.sim.sensor import SensorSpec

Values = Mapping[str, Any]
Spec = TypeVar("Spec", bound=BaseModel)


@dataclass(frozen=True)
class Variant:
    """All that a run needs besides the recording; see `experiments.engine.replays.ReplayJob` for its parts."""

    controller: str
    settings: ReplaySettings
    neck: NeckSpec
    robot_neck: NeckSpec
    sensors: Mapping[str, SensorSpec]

    def on(self, recording: str) -> ReplayJob:
        """The run with a recording."""
        return ReplayJob(recording, self.controller, self.settings, self.neck, self.robot_neck, self.sensors)


def resolve(values: Values) -> Variant:
    """Apply values to the default settings, the neck and the sensor.

    Args:
        values: Value by dotted name; ``neck.both.X`` is set on pan and tilt, and a value that names its axis wins.

    Returns:
        What to run.

    Raises:
        SettingsError: With everything that is wrong, one line each; or if a part of the user's own is not there.
    """
    checked, problems = check_settings(values)
    if "controller" not in values:
        problems.append(f"controller: missing; accepted: {accepted(setting_fields()['controller'])}")
    if problems:
        raise SettingsError("\n".join(problems))

    own = {"controller", DEAD_TIME_SCALE}
    of_run = {n: v for n, v in checked.items() if n not in own and not n.startswith(("neck.", "sensor.", OPTION))}
    settings = _changed(ReplaySettings(), of_run)
    options = options_of(checked["controller"], settings.predictor, _under(OPTION, checked))
    settings = settings.model_copy(update={"options": options})
    robot_neck = _changed(load_neck(settings.neck), _per_axis(_under("neck.", checked)))
    scale = float(checked.get(DEAD_TIME_SCALE, 1.0))
    wrong = {f"{a}.dead_time_s": scale * getattr(robot_neck, a).dead_time_s for a in ("pan", "tilt")}
    model_neck = robot_neck if scale == 1.0 else _changed(robot_neck, wrong)
    changes = _under("sensor.", checked)
    sensors = {name: _changed(sensor, changes) for name, sensor in sensors_by_name(settings.sensor).items()}
    return Variant(checked["controller"], settings, model_neck, robot_neck, sensors)


def _under(prefix: str, values: Values) -> dict[str, Any]:
    return {name.removeprefix(prefix): value for name, value in values.items() if name.startswith(prefix)}


def _per_axis(values: Values) -> dict[str, Any]:
    both = _under("both.", values)
    spread = {f"{axis}.{name}": value for name, value in both.items() for axis in ("pan", "tilt")}
    return spread | {name: value for name, value in values.items() if not name.startswith("both.")}


def _changed(spec: Spec, values: Values) -> Spec:
    # Through validation: a copy with changed fields would not be checked.
    content = spec.model_dump()
    for name, value in values.items():
        *parents, leaf = name.split(".")
        place = content
        for parent in parents:
            place = place[parent]
        place[leaf] = value
    try:
        return type(spec).model_validate(content)
    except ValidationError as error:
        lines = [f"{'.'.join(map(str, e['loc'])) or type(spec).__name__}: {e['msg']}" for e in error.errors()]
        raise SettingsError("\n".join(lines)) from None
