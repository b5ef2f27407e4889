"""Replays of recordings, by default on the reference neck with the reference sensor."""

import dataclasses

from gazempc.identify.new_neck import as_toml
from gazempc.neck.spec import load_neck
from gazempc.results.log import RunInfo
from gazempc.results.log_files import SHAPES
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import Scene
from gazempc.sim.sensor import load_sensor


def at_100_hz(name):
    """A shipped neck, stepped at 100 Hz in place of 200: limits, dead time and lag are the same in half the time."""
    return load_neck(name).model_copy(update={"servo_rate_hz": 100.0})


NECK = at_100_hz("reference")


def quick_neck(folder, name="reference"):
    """Path of a shipped neck at 50 Hz, simulated in a fifth of the time."""
    rates, path = {"control_rate_hz": 50.0, "servo_rate_hz": 50.0}, folder / "quick.toml"
    path.write_text(as_toml(load_neck(name).model_copy(update=rates).model_dump(exclude_none=True)))
    return str(path)


def replayed(placed, controller="mpc", *, settings=None, neck=None, sensor=None):
    """The log of a replay of a recording in the base frame; the controller may be a name or an object."""
    settings = settings or ReplaySettings()
    scene = Scene(
        placed,
        neck or NECK,
        sensor or load_sensor("reference"),
        seed=settings.seed,
        start_offset_deg=settings.start_offset_deg,
    )
    return replay_scene(scene, controller, settings.predictor, settings).log


def run_info(neck=None, **fields):
    """Run metadata for a log made by hand."""
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
