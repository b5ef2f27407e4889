"""Dotted names of the settings of a sweep: validation of values, and construction of the run."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, TypeVar, get_args

from pydantic import BaseModel, Field, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from experiments.engine.command import options_of, sensors_by_name
from experiments.engine.replays import ReplayJob
from gazempc.errors import SettingsError, suggest
from gazempc.neck.spec import Axis, Geometry, NeckSpec, load_neck
from gazempc.settings import GazeChoice
from gazempc.sim.replay import ReplaySettings
from gazempc.sim.sensor import SensorSpec, load_sensor

# Prefix of options of custom parts, which `experiments.engine.command` validates jointly.
OPTION = "options."
DEAD_TIME_SCALE = "model.dead_time_scale"


class _SweepOnly(BaseModel):
    controller: GazeChoice
    dead_time_scale: float = Field(default=1.0, ge=0, le=3, description="The model's dead time over the robot's")


@lru_cache(maxsize=1)
def setting_fields() -> dict[str, FieldInfo]:
    """Dotted names of all settings of a sweep, with type and range."""
    found = {name: field for name, field in _leaves(ReplaySettings).items() if name != "options"}
    found["controller"] = _SweepOnly.model_fields["controller"]
    found[DEAD_TIME_SCALE] = _SweepOnly.model_fields["dead_time_scale"]
    for axis in ("pan", "tilt", "both"):
        found |= {f"neck.{axis}.{name}": field for name, field in Axis.model_fields.items()}
    found |= {f"neck.geometry.{name}": field for name, field in Geometry.model_fields.items()}
    found |= {
        f"neck.{name}": NeckSpec.model_fields[name] for name in ("control_rate_hz", "servo_rate_hz", "reports_joints")
    }
    found |= {f"sensor.{n}": field for n, field in _leaves(SensorSpec).items() if n not in {"name", "source"}}
    return found


def check_name(name: str) -> str | None:
    """Check a dotted name.

    Args:
        name: The user's input.

    Returns:
        None if valid, else a message with suggestions and the accepted names.
    """
    names = setting_fields()
    if name in names or (name.startswith(OPTION) and name != OPTION):
        return None
    first, _, rest = name.partition(".")
    siblings = [n for n in names if n.startswith(f"{first}.")]
    if rest and siblings:
        return f"unknown setting; {suggest(name, siblings)}"
    # The name of a leaf without its prefix is a likely error.
    leaves = [n for n in names if n.split(".")[-1] == name.rpartition(".")[2]]
    near = leaves or difflib.get_close_matches(name, names, n=3)
    hint = f"perhaps you meant {' or '.join(map(repr, near))}; " if near else ""
    groups = dict.fromkeys(n.split(".")[0] + (".*" if "." in n else "") for n in sorted(names))
    return f"unknown setting; {hint}accepted: {', '.join(groups)}"


def check_value(name: str, value: Any) -> tuple[Any, str | None]:
    """Validate a single value of a setting.

    Args:
        name: A name that `check_name` accepts.
        value: The user's input.

    Returns:
        The value in the setting's type and None, or the given value and a message with the error and the accepted
        values.
    """
    if name.startswith(OPTION):
        return value, None
    field = setting_fields()[name]
    # bool is a subclass of int; infinity is valid only if it stands for "no limit".
    if isinstance(value, bool) != (field.annotation is bool) or (
        isinstance(value, float) and not math.isfinite(value) and value != field.default
    ):
        return value, f"{value!r} is not accepted; accepted: values of type {field.annotation}"
    try:
        checked = _field_adapter(name).dump_python(_field_adapter(name).validate_python(value))
        if name == "neck":
            load_neck(checked)
        elif name == "sensor" and checked is not None:
            load_sensor(checked)
    except ValidationError as error:
        return value, f"{error.errors()[0]['msg']} (given: {value!r})"
    except SettingsError as error:
        return value, str(error)
    return checked, None


def is_number(field: FieldInfo) -> bool:
    """Whether a setting can be varied over a continuous or integer range."""
    return bool({int, float} & {field.annotation, *get_args(field.annotation)})


def check_settings(values: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Validate names and values of settings.

    Args:
        values: Values by dotted name.

    Returns:
        The valid values, and one error message for each other one.
    """
    checked: dict[str, Any] = {}
    problems = []
    for name, value in values.items():
        problem = check_name(name)
        if problem is None:
            checked[name], problem = check_value(name, value)
        if problem:
            problems.append(f"{name}: {problem}")
    return checked, problems


def _leaves(model: type[BaseModel], prefix: str = "") -> dict[str, FieldInfo]:
    found: dict[str, FieldInfo] = {}
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            found |= _leaves(field.annotation, f"{prefix}{name}.")
        else:
            found[prefix + name] = field
    return found


@lru_cache(maxsize=256)
def _field_adapter(name: str) -> TypeAdapter[Any]:
    # The constraints belong to the field, not to its type; an adapter of one field reports its errors only.
    field = setting_fields()[name]
    return TypeAdapter(Annotated[field.annotation, field])  # type: ignore[arg-type]


Values = Mapping[str, Any]
Spec = TypeVar("Spec", bound=BaseModel)


def resolve(values: Values) -> ReplayJob:
    """Apply values to the default settings, neck and sensor.

    Args:
        values: Value by dotted name; ``neck.both.X`` applies to pan and tilt, unless one axis has its own value.

    Returns:
        The run, without its recording.

    Raises:
        SettingsError: With all errors, one line each; or if a custom part is missing.
    """
    checked, problems = check_settings(values)
    if "controller" not in values:
        problems.append("controller: missing")
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
    return ReplayJob("", checked["controller"], settings, model_neck, robot_neck, sensors)


def _under(prefix: str, values: Values) -> dict[str, Any]:
    return {name.removeprefix(prefix): value for name, value in values.items() if name.startswith(prefix)}


def _per_axis(values: Values) -> dict[str, Any]:
    both = _under("both.", values)
    spread = {f"{axis}.{name}": value for name, value in both.items() for axis in ("pan", "tilt")}
    return spread | {name: value for name, value in values.items() if not name.startswith("both.")}


def _changed(spec: Spec, values: Values) -> Spec:
    # Constructed anew, as `model_copy` does not validate.
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


# Endings of fields, longest first where one ends in another.
_UNITS = {
    "_rad_s3": "rad/s3", "_rad_s2": "rad/s2", "_rad_s": "rad/s", "_per_min": "1/min", "_per_minute": "1/min",
    "_deg": "deg", "_rad": "rad", "_mm": "mm", "_ms": "ms", "_hz": "Hz", "_m": "m", "_s": "s",
}  # fmt: skip
_WORDS = {"rms": "RMS", "mpc": "MPC", "sparc": "SPARC", "ldlj": "LDLJ", "nees": "NEES"}


def with_unit(name: str) -> str:
    """Readable name of a setting or metric.

    Args:
        name: Its field, such as ``gaze_error_p95_deg`` or ``mpc.smoothness``.

    Returns:
        Its name in words and its unit, such as ``gaze error, 95 % below (deg)``.
    """
    if contact := re.fullmatch(r"eye_contact_(\d+(?:p\d+)?)", name):
        return f"eye contact within {contact[1].replace('p', '.')} deg (share of the time)"
    if forecast := re.fullmatch(r"forecast_(error|nees|coverage)_(?:(68|95)_)?(\d+)(_mm)?", name):
        what = {"error": "error", "nees": "NEES", "coverage": f"coverage of {forecast[2]} %"}[forecast[1]]
        return f"forecast {what} at {int(forecast[3]) / 1000:g} s" + (" (mm)" if forecast[4] else "")
    stem, percentile = re.subn(r"_p(50|95|99)\b|_p(50|95|99)(?=_)", "", name)
    unit = next((ending for ending in _UNITS if stem.endswith(ending)), "")
    words = stem.removesuffix(unit).replace(".", ": ").replace("_", " ").split()
    text = " ".join(_WORDS.get(word.rstrip(":"), word.rstrip(":")) + ":" * word.endswith(":") for word in words)
    if percentile and (found := re.search(r"_p(\d\d)", name)):
        text += f", {found[1]} % below"
    return f"{text} ({_UNITS[unit]})" if unit else text
