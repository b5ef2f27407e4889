"""Factories of predictor, controller and target, from names or objects."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gazempc.controllers.controller import Controller
from gazempc.errors import SettingsError
from gazempc.files.bounds import MEGABYTE
from gazempc.files.npz import read_npz
from gazempc.loop.attended import AttendedPeople
from gazempc.loop.looking_away import LookingAway
from gazempc.loop.track import PersonTrack, Target
from gazempc.loop.trial import check_controller, check_predictor, check_same_neck
from gazempc.neck.spec import AXES, NeckSpec
from gazempc.part_options import make, options_for
from gazempc.parts import CONTROLLER, PREDICTOR, TERM, find, is_own, name_of
from gazempc.people.attention import Attention
from gazempc.people.company import Cues
from gazempc.people.policies import make_policy
from gazempc.people.schedule import LookAways
from gazempc.settings import GazeSettings, PredictorSettings
from gazempc.types import FloatArray
from predictors import Predictor
from predictors.walker.network import WalkerModel, WalkerModelError, load_walker_model, shipped_walker_model

# Names in a folder that `experiments.fit` writes: the model of all people, and the folder of those without one person.
MODEL_FILE, FOLDS = "walker.npz", "left_out"
# Ninety times the size of the shipped model.
_MOST_MODEL_BYTES = 50 * MEGABYTE


@dataclass(frozen=True)
class Person:
    """Data of the person, for the constructor of a predictor.

    Attributes:
        name: Name of the person; if `walker.fitted` is a folder, the model fitted without this person is chosen.
        true_position_base_m: Maps times, shape (H,), seconds, to true positions, shape (H, 3), metres; None if the
            future is unknown.
    """

    name: str = ""
    true_position_base_m: Callable[[FloatArray], FloatArray] | None = None


def make_predictor(
    choice: str | Predictor, settings: PredictorSettings, person: Person, options: dict[str, Any]
) -> Predictor:
    """Construct a predictor, or validate and reset a given one.

    Args:
        choice: A shipped name, ``module:Class`` or a predictor. A user's constructor may have the parameters ``person``
            (the name) and ``true_position_base_m``.
        settings: Parameters of shipped predictors.
        person: The person who is tracked.
        options: Parameters of user-defined predictors.

    Returns:
        The predictor.

    Raises:
        SettingsError: If construction fails, or the interface of a predictor is violated.
    """
    if not isinstance(choice, str):
        if name_of(PREDICTOR, choice) not in PREDICTOR.shipped:
            return check_predictor(choice)
        choice.reset()
        return choice
    future = person.true_position_base_m
    if choice == "perfect" and future is None:
        raise SettingsError("predictor perfect: the true future is unknown in a live run")
    given: dict[str, Any] = {"true_position_base_m": future, "person": person.name}
    if choice == "walker":
        model, threshold = walker_model(settings.walker.fitted, person.name), settings.walker.threshold
        if threshold is not None:
            model = replace(model, decision=(model.decision[0], threshold))
        given["model"] = model
    elif choice == "last_position":
        given["position_noise_m"] = settings.constant_velocity.position_noise_m
    elif hasattr(settings, choice):
        given |= getattr(settings, choice).model_dump()
    predictor: Predictor = make(PREDICTOR, choice, given, options_for(PREDICTOR, choice, options))
    return check_predictor(predictor) if is_own(choice) else predictor


def make_controller(
    choice: str | Controller, neck: NeckSpec, settings: GazeSettings, options: dict[str, Any]
) -> Controller:
    """Construct a controller, or validate and reset a given one.

    Args:
        choice: A shipped name, ``module:Class`` or a controller. A user's constructor may have the parameter ``neck``.
        neck: The neck.
        settings: Parameters of shipped controllers.
        options: Parameters of user-defined controllers.

    Returns:
        The controller.

    Raises:
        SettingsError: If construction fails, the interface of a controller is violated, or the neck differs.
    """
    if not isinstance(choice, str):
        check_same_neck(choice, neck)
        if name_of(CONTROLLER, choice) not in CONTROLLER.shipped:
            return check_controller(choice, neck)
        choice.reset()
        return choice
    given: dict[str, Any] = {"neck": neck}
    if hasattr(settings, choice):
        given |= getattr(settings, choice).model_dump()
    if choice == "mpc":
        given |= {"framing": settings.framing} | {kind: _by_joint(given[kind]) for kind in ("terms", "rows")}
    controller: Controller = make(CONTROLLER, choice, given, options_for(CONTROLLER, choice, options))
    return check_controller(controller, neck) if is_own(choice) else controller


def _by_joint(choices: tuple[str, ...]) -> dict[str, list[Callable[..., Any]]]:
    """Own functions of the MPC by the joint's name, from ``module:function`` or ``pan=module:function``."""
    parts = [choice.rpartition("=") for choice in choices]
    return {name: [find(TERM, place) for joint, _, place in parts if joint in ("", name)] for name in AXES}


def walker_model(fitted: Path | None, person: str) -> WalkerModel:
    """The model of the predictor `walker` for a person.

    Args:
        fitted: A model or a folder of models; None for the shipped one.
        person: Name of the person; from a folder, the model fitted without this person is chosen.

    Returns:
        The model.

    Raises:
        SettingsError: If the file is missing, too large, damaged, or not a model of the walker.
    """
    if fitted is None:
        return shipped_walker_model()
    path = fitted
    if fitted.is_dir():
        left_out = fitted / FOLDS / f"{person}.npz"
        path = left_out if left_out.is_file() else fitted / MODEL_FILE
    try:
        read_npz(path, _MOST_MODEL_BYTES)  # refuses oversized and damaged archives before numpy unpacks them
        return load_walker_model(path)
    except WalkerModelError as error:
        raise SettingsError(f"walker.fitted: {error}") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        accepted = "accepted: a model file, or a folder that `gazempc fit` wrote"
        raise SettingsError(f"walker.fitted: {path}: cannot be read: {reason}; {accepted}") from None


def make_target(
    choice: str | Predictor,
    ready: Predictor,
    neck: NeckSpec,
    settings: GazeSettings,
    options: dict[str, Any],
    cues: Cues | None = None,
    look_aways: LookAways | None = None,
) -> Target:
    """Make the target of a run: a single person or the attended one of several, with gaze aversion.

    Args:
        choice: The predictor of each of several people: an object is copied.
        ready: The predictor of a single person.
        neck: The neck.
        settings: Attention policy, and rhythm of gaze aversion.
        options: Parameters of user-defined parts.
        cues: Cues of a dialogue system.
        look_aways: Schedule of gaze aversion; default: from the settings.

    Returns:
        The target.

    Raises:
        SettingsError: If construction of the policy fails.
    """

    def another() -> Predictor:
        return make_predictor(choice, settings, Person(), options) if isinstance(choice, str) else copy.deepcopy(choice)

    target: Target = PersonTrack(ready, settings.loop)
    if settings.attend is not None:
        attention = Attention(make_policy(settings.attend, options), settings.attention)
        target = AttendedPeople(another, attention, settings.loop, settings.framing.subject == "all")
    if look_aways is None and settings.several:
        mode = "told" if settings.look_away.rhythm == "no" else settings.look_away.rhythm
        look_aways = LookAways(neck, mode, settings.look_away.seed)
    return target if look_aways is None else LookingAway(target, look_aways, cues)
