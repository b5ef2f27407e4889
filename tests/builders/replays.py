"""Replays of recordings on the reference neck with the reference sensor, unless a test says otherwise."""

import dataclasses

from gazempc.neck.spec import load_neck
from gazempc.results.log import RunInfo
from gazempc.results.log_files import SHAPES
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import Scene
from gazempc.sim.sensor import load_sensor


def replayed(placed, controller="mpc", *, settings=None, neck=None, sensor=None):
    """The log of a replay of a recording in the base frame; the controller may be a name or an object."""
    settings = settings or ReplaySettings()
    scene = Scene(
        placed,
        neck or load_neck("reference"),
        sensor or load_sensor("reference"),
        seed=settings.seed,
        start_offset_deg=settings.start_offset_deg,
    )
    return replay_scene(scene, controller, settings.predictor, settings).log


def run_info(neck=None, **fields):
    """What a run was, for a log made by hand."""
    about = {"recording": "made by hand", "kind": "synthetic", "subject": "nobody", "controller": "mpc"}
    about |= {"predictor": "walker", "neck": neck or load_neck("reference"), "sensor": {"name": "reference"}}
    return RunInfo(**about | fields)


QUICK = ReplaySettings(predictor="constant_velocity")


def cut(log, from_s, to_s):
    """The part of a log between two times."""
    parts = {}
    for times, axis in (("time_s", "M"), ("capture_time_s", "F"), ("event_time_s", "E")):
        kept = (getattr(log, times) >= from_s) & (getattr(log, times) < to_s)
        parts |= {name: getattr(log, name)[kept] for name, axes in SHAPES.items() if axes[0] == axis}
    return dataclasses.replace(log, **parts)
