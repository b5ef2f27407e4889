"""Standing people with sway."""

from dataclasses import replace

import numpy as np

from builders.replays import NECK
from gazempc.recordings.load import recording_from_arrays
from gazempc.sim.scene import SceneSettings, make_scene


def standing(name, at_m, seconds, from_s=0.0):
    """A recording of a standing person."""
    times_s = from_s + np.arange(0.0, seconds, 1.0 / 30.0)
    sway_m = [0.02 * np.sin(0.8 * times_s), 0.03 * np.sin(1.3 * times_s), 0.01 * np.sin(1.1 * times_s)]
    return recording_from_arrays(name, times_s, np.asarray(at_m) + np.column_stack(sway_m))


def standing_together(seconds, *places_m):
    """A scene of standing people, base frame."""
    settings = SceneSettings(sensor="reference", placement="recorded")
    first, *others = (make_scene(standing(f"p{k}", at_m, seconds), settings, NECK) for k, at_m in enumerate(places_m))
    return replace(first, others=tuple(other.walk for other in others))
