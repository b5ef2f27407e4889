"""A view that turns with the head of the robot."""

import numpy as np
import pytest
from builders.recordings import synthetic
from builders.replays import replayed
from builders.sensing import sensor

from gazempc.neck.kinematics import gaze_ray, look_at
from gazempc.neck.poses import seen_from_head
from gazempc.neck.spec import Geometry, load_neck
from gazempc.sim.replay import ReplaySettings

GEOMETRY = Geometry(tilt_axis_in_pan_m=(0.02, 0.01, 0.05), eye_in_tilt_m=(0.04, -0.02, 0.03))


def observed(on, width_deg, start_offset_deg=0.0):
    """Capture times of the frames of a walk past the robot that are used."""
    view = {"on": on, "horizontal_deg": width_deg, "vertical_deg": 60.0}
    settings = ReplaySettings(start_offset_deg=start_offset_deg)
    log = replayed(synthetic("subject03_R4"), "lookahead", settings=settings, sensor=sensor(latency_s=0.066, view=view))
    return log.capture_time_s


def test_what_the_neck_looks_at_is_straight_ahead():
    target_m = np.array([1.5, -0.8, 0.6])
    angles_rad = look_at(GEOMETRY, target_m).angles_rad
    distance_m = np.linalg.norm(target_m - gaze_ray(GEOMETRY, angles_rad)[0])
    assert seen_from_head(GEOMETRY, angles_rad, target_m) == pytest.approx([distance_m, 0.0, 0.0], abs=1e-12)


def test_a_view_that_turns_keeps_who_leaves_a_fixed_one():
    everything = observed("base", 360.0).size
    assert observed("head", 30.0).size == everything
    assert observed("base", 30.0).size < 0.5 * everything


def test_who_is_out_of_the_turned_view_at_the_start_is_seen_once_they_walk_into_it():
    """The neck holds still until then, so the view is where it was at the start."""
    walk, neck = synthetic("subject03_R4"), load_neck("reference")
    bearing_rad = look_at(neck.geometry, walk.truth.head_position_m).angles_rad[:, 0]
    start_rad = min(bearing_rad[0] + np.radians(45.0), neck.position_max_rad[0])
    inside = np.abs(bearing_rad - start_rad) <= np.radians(30.0)
    first_s = walk.times_s[np.argmax(inside)]
    assert first_s > 1.0
    # The head is tilted: the edge of its view is a frame off the vertical plane.
    assert observed("head", 60.0, start_offset_deg=45.0)[0] == pytest.approx(first_s, abs=1.5 / 30)
