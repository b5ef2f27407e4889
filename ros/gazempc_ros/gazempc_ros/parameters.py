"""Settings of `gazempc.Gaze` as parameters of a node: names with dots, descriptions, ranges."""

from __future__ import annotations

from collections.abc import Iterator
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from gazempc.live.settings import LiveLoopSettings
from gazempc.live.setup import LiveGazeSettings

# Parameters of the command line that are arguments of `Gaze`, and options of robots that no ROS 2 robot uses.
_ARGUMENTS = {
    "neck": ("reference", "Shipped neck, or path of a neck file; `gazempc identify --new --urdf` writes one"),
    "robot": ("ros2", "Robot that executes the commands: ros2, or mujoco or simulated without hardware"),
    "controller": ("mpc", "Controller that plans the commands: mpc, lookahead, reactive, module:Class"),
    "predictor": ("", "Forecast of the head; empty for the default, walker"),
}
# Messages are processed in Python concurrently with the plans: with 10 ms, as in a live run, 2 to 10 % are late.
_DEFAULTS = LiveGazeSettings(loop=LiveLoopSettings(compute_delay_s=0.02))
_BOUNDS, _FAR = ("ge", "gt", "le", "lt"), 1e15
_LEFT_OUT = ("options.dynamixel", "options.reachy_mini", "options.visca", "options.onvif", "options.ros2.use_sim_time")


def _fields(model: type[BaseModel], default: BaseModel, prefix: str = "") -> Iterator[tuple[str, FieldInfo, Any]]:
    """Names, fields and default values of all settings of a model and the models within it."""
    for name, field in model.model_fields.items():
        full, value = f"{prefix}{name}", getattr(default, name)
        if full in _LEFT_OUT:
            continue
        if isinstance(value, BaseModel):
            yield from _fields(type(value), value, f"{full}.")
        else:
            yield full, field, value


def _kind(annotation: Any) -> tuple[type, bool]:
    """The plain type behind an annotation, and whether it is a list of it."""
    arguments = [each for each in get_args(annotation) if each not in (type(None), Ellipsis)]
    origin = get_origin(annotation)
    if origin is Literal:
        return type(arguments[0]), False
    if origin in (tuple, list):
        return _kind(arguments[0])[0], True
    if origin in (Union, UnionType) or (arguments and origin is not None):
        return _kind(arguments[0])
    return annotation if annotation in (bool, int, float) else str, False


def _as_parameter(value: Any, kind: type, is_list: bool) -> Any:
    if value is None:
        return None
    return [kind(each) for each in value] if is_list else kind(value)


def _describe(field: FieldInfo, kind: type, is_list: bool, unset: bool) -> ParameterDescriptor:
    """Description, range and accepted words; a value without a default may have any type."""
    described = ParameterDescriptor(description=field.description or "", dynamic_typing=unset)
    choices = [each for each in (field.annotation, *get_args(field.annotation)) if get_origin(each) is Literal]
    words = [str(word) for each in choices for word in get_args(each)]
    described.additional_constraints = f"one of {', '.join(words)}" if words else ""
    bounds = {name: getattr(each, name) for each in field.metadata for name in _BOUNDS if hasattr(each, name)}
    if bounds and kind in (int, float) and not is_list and not unset:
        # Open ends of a range are checked by `configure`.
        low = kind(bounds.get("ge", bounds.get("gt", -_FAR)))
        high = kind(bounds.get("le", bounds.get("lt", _FAR)))
        if kind is int:
            described.integer_range = [IntegerRange(from_value=low, to_value=high)]
        else:
            described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return described


def declare(node: Node) -> None:
    """Declare all settings as parameters.

    Args:
        node: The node.
    """
    for name, (default, text) in _ARGUMENTS.items():
        node.declare_parameter(name, default, ParameterDescriptor(description=text))
    for name, field, value in _fields(LiveGazeSettings, _DEFAULTS):
        kind, is_list = _kind(field.annotation)
        unset = value is None
        node.declare_parameter(name, _as_parameter(value, kind, is_list), _describe(field, kind, is_list, unset))


def read(node: Node) -> tuple[dict[str, Any], dict[str, Any]]:
    """Settings from the parameters.

    Args:
        node: The node, with its parameters declared.

    Returns:
        Arguments of `gazempc.Gaze`, and its settings, nested.
    """
    arguments = {name: node.get_parameter(name).value for name in _ARGUMENTS}
    settings: dict[str, Any] = {}
    for full, _, _ in _fields(LiveGazeSettings, _DEFAULTS):
        value = node.get_parameter(full).value
        if value is not None:
            *groups, name = full.split(".")
            within = settings
            for group in groups:
                within = within.setdefault(group, {})
            within[name] = list(value) if not isinstance(value, str) and hasattr(value, "__iter__") else value
    use_sim_time = bool(node.get_parameter("use_sim_time").value)
    settings.setdefault("options", {}).setdefault("ros2", {})["use_sim_time"] = use_sim_time
    return {name: value for name, value in arguments.items() if value}, settings
