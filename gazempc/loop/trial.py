"""One forecast and one plan before the run: validates user-defined parts, and warms up caches."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from gazempc.controllers.controller import CommandState, Controller, Situation
from gazempc.errors import SettingsError
from gazempc.loop.boundary import PartError, boundary, checked_forecast, checked_plan, checked_times
from gazempc.loop.observer import observer_gain
from gazempc.neck.ahead import joints_after_dead_time
from gazempc.neck.spec import NeckSpec
from gazempc.parts import CONTROLLER, PREDICTOR, Kind, check_members, name_of
from gazempc.types import FloatArray
from predictors import Forecast, HeadObservation, Predictor

# Test data: a person walks past at 2 m, five frames at 30 frames a second.
_TRIAL_FRAMES, _TRIAL_PERIOD_S = 5, 1.0 / 30.0
# Properties of the simulated neck outside of the controller's model, see `gazempc.neck.spec.Axis`.
_OF_SIMULATION = {"reports_joints", "encoder_noise_deg", "load_offset_deg"}


def check_predictor(predictor: Predictor) -> Predictor:
    """Try a predictor on a short walk, then reset it.

    Args:
        predictor: The predictor.

    Returns:
        The same.

    Raises:
        SettingsError: If a method is missing or raises, or a forecast is malformed; the message names the method.
    """
    check_members(PREDICTOR, predictor)
    times_s = 1.0 + np.array([0.0, 0.25, 1.0])
    tried = partial(_tried, PREDICTOR, predictor)
    tried("reset")
    for observation in _walk():
        tried("update", observation)
    tried("forecast", times_s, check=lambda forecast: checked_forecast(forecast, times_s.size))
    tried("reset")
    return predictor


def check_controller(controller: Controller, neck: NeckSpec) -> Controller:
    """Try a controller on one plan for a neck at rest, then reset it.

    Args:
        controller: The controller.
        neck: The neck.

    Returns:
        The same.

    Raises:
        SettingsError: If a method is missing or raises, or a plan is malformed; the message names the method.
    """
    check_members(CONTROLLER, controller)
    tried = partial(_tried, CONTROLLER, controller)
    tried("reset")
    times_s = tried("forecast_times_s", 1.0, 0.9, check=lambda wanted_s: checked_times(wanted_s, 1.0))
    tried("plan", _situation(neck, times_s), check=lambda plan: checked_plan(plan, neck.joints))
    tried("reset")
    return controller


def warm_up(predictor: Predictor, controller: Controller, neck: NeckSpec) -> None:
    """Compute one forecast and one plan, so that the first tick is not delayed by the setup of a model or a solver.

    Exceptions are suppressed: they recur in the run, as events.

    Args:
        predictor: The predictor; reset.
        controller: The controller; reset.
        neck: The neck.
    """
    with contextlib.suppress(SettingsError):
        check_predictor(predictor)
    with contextlib.suppress(SettingsError):
        check_controller(controller, neck)
    for part in (predictor, controller):  # also after a failure
        with contextlib.suppress(PartError), boundary(part, "reset"):
            part.reset()
    for axis in neck.axes:
        observer_gain(axis, neck.servo_period_s)


def check_same_neck(controller: object, neck: NeckSpec) -> None:
    """Check that a controller with an attribute ``neck`` was made for this neck.

    Args:
        controller: The controller.
        neck: The neck of the run.

    Raises:
        SettingsError: If it was made for another neck; the message lists the differences.
    """
    known = getattr(controller, "neck", None)
    if not isinstance(known, NeckSpec):
        return
    theirs, ours = _known_to_controllers(known), _known_to_controllers(neck)
    if differs := [f"{name} {theirs[name]} instead of {ours[name]}" for name in ours if theirs[name] != ours[name]]:
        raise SettingsError(
            f"controller {name_of(CONTROLLER, controller)} was made for the neck {known.name!r}, and is to steer the "
            f"neck {neck.name!r}; its own neck has {', '.join(differs)}; make it with the neck that it steers"
        )


def _known_to_controllers(neck: NeckSpec) -> dict[str, object]:
    values: dict[str, object] = {}
    for part, content in neck.model_dump(exclude={"name", "source", *_OF_SIMULATION}).items():
        if isinstance(content, dict):
            values |= {f"{part}.{name}": value for name, value in content.items() if name not in _OF_SIMULATION}
        else:
            values[part] = content
    return values


def _tried(kind: Kind, part: object, method: str, *given: object, check: Callable[[Any], Any] = lambda _: None) -> Any:
    """Call a method of a part, and check its result."""
    try:
        with boundary(part, method):
            return check(getattr(part, method)(*given))
    except PartError as error:
        raise SettingsError(f"{kind.name} {name_of(kind, part)}: {error}") from error.error


def _walk() -> list[HeadObservation]:
    facing = np.array([1.0, 0.0, 0.0, 0.0])
    return [
        HeadObservation(1.0 - (_TRIAL_FRAMES - 1 - i) * _TRIAL_PERIOD_S, np.array([2.0, 0.04 * i, 0.3]), facing, facing)
        for i in range(_TRIAL_FRAMES)
    ]


def _situation(neck: NeckSpec, times_s: FloatArray) -> Situation:
    rest_rad, still = neck.rest_rad, np.zeros(neck.joints)
    forecast = Forecast(
        times_s=times_s,
        # Far aside, so that limits of the command are active: also warms up the solver.
        means_base_m=np.tile([2.0, 1.0, 0.3], (times_s.size, 1)),
        covariances_m2=np.tile(1e-4 * np.eye(3), (times_s.size, 1, 1)),
        issued_at_s=0.9,
    )
    history = int(np.ceil(float(np.max(neck.dead_time_s)) / neck.servo_period_s)) + 2
    return Situation(
        joints_after_dead_time(neck, 0),
        start_s=1.0,
        forecast=forecast,
        command=CommandState(rest_rad, still, still),
        joint_position_rad=rest_rad,
        joint_velocity_rad_s=still,
        joint_offset_rad=still,
        sent_rad=np.tile(rest_rad, (history, 1)),
        committed_rad=np.empty((0, neck.joints)),
    )
