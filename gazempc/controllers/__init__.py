"""Gaze controllers: each turns a forecast of the head into a plan of commands for the neck."""

from gazempc.controllers.controller import CommandState, Controller, ControllerError, Plan, Situation
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc import Mpc
from gazempc.controllers.reactive import Reactive

__all__ = [
    "CommandState",
    "Controller",
    "ControllerError",
    "LookAhead",
    "Mpc",
    "Plan",
    "Reactive",
    "Situation",
]
