"""Good data of many trackers: no word. The same data in other units and axes: the right word within a second."""

import numpy as np
import pytest

from gazempc.live.clock import SimulatedClock
from gazempc.live.hints import Frame, SetupHints
from gazempc.live.mount import Mount
from gazempc.live.watch import Watch
from gazempc.settings import LoopSettings
from gazempc.sim.scene import SceneSettings, make_scene
from gazempc.sim.sensor import observe, sensor_names

WALKS = ("subject01_R1", "subject04_R3", "subject08_R6", "subject12_R4")


def found(sightings, change=lambda head: head):
    """What is said, and how long after the first frame."""
    watch, said = Watch(SimulatedClock(), None, Mount(), LoopSettings(), SetupHints()), []
    for sighting in sightings:
        seen = sighting.observation
        said += [(sighting.arrival_s - sightings[0].arrival_s, *each) for each in watch.findings(sighting.arrival_s)]
        head = change(seen.head_position_base_m)
        watch.see(Frame(sighting.arrival_s, seen.capture_time_s, head, head, seen.person_id))
    return said


def seen(walk, sensor="reference", seed=0):
    scene = make_scene(walk, SceneSettings(sensor=sensor))
    return observe(scene.walk, scene.sensor, seed)


@pytest.mark.parametrize("sensor", sensor_names())
@pytest.mark.parametrize("walk", WALKS)
def test_good_data_are_not_complained_of(walk, sensor):
    assert found(seen(walk, sensor)) == []


OTHER = {
    "millimetres": lambda head: 1e3 * head,
    "centimetres": lambda head: 1e2 * head,
    "optical": lambda head: np.array([-head[1], -head[2], head[0]]),
    "opengl": lambda head: np.array([-head[1], head[2], -head[0]]),
    "unity": lambda head: np.array([-head[1], head[2], head[0]]),
}


@pytest.mark.parametrize(("name", "change"), OTHER.items(), ids=OTHER.keys())
@pytest.mark.parametrize("walk", WALKS)
def test_other_units_and_axes_are_named_within_a_second(walk, name, change):
    after_s, event, text = found(seen(walk), change)[0]
    assert after_s < 1.0
    assert event == ("wrong_unit" if "metres" in name else "wrong_axes")
    assert name in text
