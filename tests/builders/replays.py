"""Replays of recordings on the reference neck with the reference sensor, unless a test says otherwise."""

from gazempc.neck.spec import load_neck
from gazempc.settings import RunSettings
from gazempc.sim.replay import replay
from gazempc.sim.sensor import load_sensor


def replayed(placed, controller="mpc", *, settings=None, neck=None, sensor=None, instance=None):
    """The log of a replay of a recording in the base frame; `instance` is a controller to use again."""
    neck, sensor = neck or load_neck("reference"), sensor or load_sensor("reference")
    log, _ = replay(placed, neck, sensor, controller, settings or RunSettings(), instance)
    return log
