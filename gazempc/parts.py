"""Predictors, controllers, robots and sources by name: a shipped name, or ``module:Class`` for a user-defined part."""

from __future__ import annotations

import importlib
import inspect
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gazempc.errors import SettingsError, suggest

_MARK = ":"


@dataclass(frozen=True)
class Kind:
    """One kind of part.

    Attributes:
        name: Name in messages and options.
        shipped: ``module:Class`` by shipped name.
        members: Signature and purpose of each required method or attribute, by name.
    """

    name: str
    shipped: Mapping[str, str]
    members: Mapping[str, str]


PREDICTOR = Kind(
    "predictor",
    {
        "last_position": "predictors.bounds:LastPosition",
        "constant_velocity": "predictors.constant_velocity:ConstantVelocity",
        "constant_acceleration": "predictors.baselines.constant_acceleration:ConstantAcceleration",
        "coordinated_turn": "predictors.baselines.coordinated_turn:CoordinatedTurn",
        "interacting_models": "predictors.baselines.interacting_models:InteractingModels",
        "particle": "predictors.baselines.particle:ParticleFilter",
        "head_pose": "predictors.head_pose:HeadPose",
        "pelvis_pursuit": "predictors.pelvis_pursuit:PelvisPursuit",
        "walker": "predictors.walker.predictor:Walker",
        "perfect": "predictors.bounds:Perfect",
    },
    {
        "reset": "reset(): discards the state of the person",
        "update": "update(observation: HeadObservation): updates the state by one observation",
        "forecast": "forecast(times_s: shape (H,)) -> Forecast: head positions at these times",
    },
)
CONTROLLER = Kind(
    "controller",
    {
        "reactive": "gazempc.controllers.reactive:Reactive",
        "lookahead": "gazempc.controllers.lookahead:LookAhead",
        "mpc": "gazempc.controllers.mpc.mpc:Mpc",
    },
    {
        "reset": "reset(): discards earlier plans",
        "forecast_times_s": "forecast_times_s(start_s, newest_capture_s) -> times to forecast, shape (H,), seconds",
        "plan": "plan(situation: Situation) -> Plan: the commands from situation.start_s on",
    },
)
ROBOT = Kind(
    "robot",
    {
        "simulated": "gazempc.sim.simulated:SimulatedNeck",
        "mujoco": "gazempc.robots.mujoco:MujocoNeck",
        "dynamixel": "gazempc.robots.dynamixel:DynamixelNeck",
        "ros2": "gazempc.robots.ros2:Ros2Neck",
        "reachy_mini": "gazempc.robots.reachy_mini:ReachyMiniNeck",
        "visca": "gazempc.robots.visca:ViscaCamera",
        "onvif": "gazempc.robots.onvif:OnvifCamera",
    },
    {
        "connect": "connect(): opens the connection",
        "read_state": "read_state() -> JointState, or None if the joints are not measured",
        "send_command": "send_command(position_rad: shape (N,)) -> the angles sent, shape (N,), radians",
        "close": "close(): closes the connection, never raises",
    },
)
SOURCE = Kind(
    "source",
    {
        "stdin": "gazempc.live.sources.streams:LineSource",
        "udp": "gazempc.live.sources.streams:LineSource",
        "tcp": "gazempc.live.sources.streams:LineSource",
        "replay": "gazempc.live.sources.replay:ReplaySource",
        "bag": "gazempc.live.sources.replay:BagSource",
        "ros2": "gazempc.live.sources.ros2:Ros2Person",
        "ros4hri": "gazempc.live.sources.ros4hri:Ros4HriPeople",
        "camera": "gazempc.live.sources.camera.source:CameraSource",
    },
    {
        "open": "open(): starts reception",
        "poll": "poll() -> Arrived: input since the last call; never blocks",
        "close": "close(): ends reception, never raises",
        "finished": "finished: True after the end of the source",
    },
)
POLICY = Kind(
    "policy",
    {
        "nearest": "gazempc.people.policies:Nearest",
        "engaged": "gazempc.people.policies:Engaged",
        "approaching": "gazempc.people.policies:Approaching",
        "speaker": "gazempc.people.policies:Speaker",
    },
    {
        "reset": "reset(): discards all people",
        "scores": "scores(company: Company) -> one number per person of company.people; NaN excludes the person",
    },
)
# A user-defined cost or limit of the MPC: a function of `gazempc.controllers.mpc.problem.Trajectory`.
TERM = Kind("term", {}, {})
# Shipped robots with the syntax NAME:ADDRESS.
ADDRESSED = ("visca", "onvif")
# A controller with its own predictor: the true future is the upper bound of any forecast.
TRUE_FUTURE = "mpc+perfect"
# A person by the tracker's name: ``id:anna``.
BY_NAME = "id:"


def split_address(choice: str) -> tuple[str, str]:
    """Name and address of a robot, such as of ``visca:192.168.0.8``; any other choice has the address ``""``."""
    name, _, address = choice.partition(_MARK)
    return (name, address) if name in ADDRESSED else (choice, "")


def is_own(choice: str) -> bool:
    """Whether a choice names a user-defined part, ``module:Class``."""
    module, mark, name = choice.partition(_MARK)
    return bool(mark) and module not in ADDRESSED and all(map(str.isidentifier, f"{module}.{name}".split(".")))


def check_choice(kind: Kind, choice: str) -> str:
    """Validate the name of a part, without importing it.

    Args:
        kind: The kind of part.
        choice: A shipped name or ``module:Class``.

    Returns:
        The choice.

    Raises:
        ValueError: If it is neither; the message lists the accepted values.
    """
    if split_address(choice)[0] in kind.shipped or is_own(choice):
        return choice
    raise ValueError(
        f"no {kind.name} {choice!r}: {suggest(choice, kind.shipped)}, or module:Class for a {kind.name} of your own"
    )


def gaze_of(choice: str) -> tuple[str, str]:
    """Controller and own predictor of a choice such as ``mpc+perfect``; ``mpc`` has the predictor ``""``."""
    if choice == "perfect":
        warnings.warn(f"the controller perfect is now {TRUE_FUTURE}", FutureWarning, stacklevel=2)
        choice = TRUE_FUTURE
    controller, _, predictor = choice.partition("+")
    return controller, predictor


def check_gaze(choice: str) -> str:
    """Validate a controller with its own predictor after ``+``, as `check_choice`; returns such as ``mpc+perfect``."""
    controller, predictor = gaze_of(choice)
    check_choice(CONTROLLER, controller)
    return f"{controller}+{check_choice(PREDICTOR, predictor)}" if predictor else controller


def check_function(choice: str) -> str:
    """Validate the name of a function of the MPC: ``module:function``, optionally after ``pan=`` or ``tilt=``.

    Args:
        choice: The text.

    Returns:
        The same.

    Raises:
        ValueError: If it has another form.
    """
    joint, _, place = choice.rpartition("=")
    if is_own(place) and joint in ("", "pan", "tilt"):
        return choice
    raise ValueError(f"{choice!r}: accepted: module:function, pan=module:function, tilt=module:function")


def find(kind: Kind, choice: str) -> Callable[..., Any]:
    """Import the class of a choice.

    The working directory is on the search path, as for ``python -m``.

    Args:
        kind: The kind of part.
        choice: A shipped name or ``module:Class``.

    Returns:
        The class, or a factory function.

    Raises:
        SettingsError: If it does not exist, or its module cannot be imported; the message states the reason.
    """
    try:
        module_name, _, name = kind.shipped.get(split_address(check_choice(kind, choice))[0], choice).partition(_MARK)
    except ValueError as error:
        raise SettingsError(str(error)) from None
    if is_own(choice) and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
    try:
        found: Any = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module_name}.".startswith(f"{error.name}."):
            raise SettingsError(f"{kind.name} {choice}: {module_name} needs the module {error.name!r}") from error
        raise SettingsError(
            f"{kind.name} {choice}: there is no module {error.name!r} in the working directory and "
            "the installed packages"
        ) from None
    except Exception as error:
        raise SettingsError(f"{kind.name} {choice}: importing {module_name} raised {error_line(error)}") from error
    for part in name.split("."):
        if not hasattr(found, part):
            ours = [(n, v) for n, v in vars(found).items() if getattr(v, "__module__", None) == module_name]
            names = [n for n, v in ours if inspect.isclass(v) or (kind is TERM and inspect.isfunction(v))]
            raise SettingsError(f"{kind.name} {choice}: {module_name} has no {name!r}; {suggest(name, names)}")
        found = getattr(found, part)
    if not callable(found):
        raise SettingsError(f"{kind.name} {choice}: {name} is neither class nor function, but {type(found).__name__}")
    factory: Callable[..., Any] = found
    return factory


def check_members(kind: Kind, part: object, called: str = "") -> None:
    """Check that a part has all methods and attributes of its kind.

    Args:
        kind: The kind of part.
        part: The part.
        called: Its name in messages; default: name of its class.

    Raises:
        SettingsError: If one is missing; the message states its signature.
    """
    called = called or type(part).__name__
    if inspect.isclass(part):
        raise SettingsError(f"{kind.name} {part.__name__} is a class: give an object, {part.__name__}(...)")
    for name, what in kind.members.items():
        is_method = what.startswith(f"{name}(")
        if not (callable(getattr(part, name, None)) if is_method else hasattr(part, name)):
            raise SettingsError(f"{kind.name} {called} lacks the {'method' if is_method else 'attribute'} {what}")


def name_of(kind: Kind, part: object) -> str:
    """Name of a part in tables, figures and logs.

    Args:
        kind: The kind of part.
        part: The part.

    Returns:
        The shipped name; for a user-defined part its attribute ``name`` if that is a text, else its class's name. If a
        shipped part has the same name, the module is prepended.
    """
    own = type(part)
    for name, place in kind.shipped.items():
        if place == f"{own.__module__}:{own.__qualname__}":
            return name
    called = getattr(part, "name", None)
    name = called if isinstance(called, str) and called else own.__name__
    # Shipped names are reserved for shipped parts.
    return f"{own.__module__}.{name}" if name in kind.shipped else name


def error_line(error: BaseException) -> str:
    """An exception in one line, such as ``TypeError: ...``."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
