"""Sensor pose: observations in the base frame, also from a sensor on the moving head."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from builders.live import live_setup
from builders.mounts import about, sensor_in_base
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gazempc.live.arrivals import Arrivals
from gazempc.live.clock import SimulatedClock
from gazempc.live.logs import LiveReport
from gazempc.live.mount import JointHistory, Mount
from gazempc.live.sources.source import Arrived
from gazempc.loop.observer import JointEstimate
from gazempc.loop.recorder import LoopRecorder
from gazempc.neck.spec import Geometry, load_neck
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import Sighting
from predictors import HeadObservation

GEOMETRY = Geometry(tilt_axis_in_pan_m=(0.14, 0.01, 0.06), eye_in_tilt_m=(0.05, 0.0, 0.02))
metres = st.floats(-3.0, 3.0)
degrees = st.floats(-170.0, 170.0)
points = st.tuples(metres, metres, metres)
turns = st.tuples(degrees, st.floats(-85.0, 85.0), degrees)


def seen(point_m, quat_wxyz=None, time_s=1.0):
    return HeadObservation(time_s, np.array(point_m, dtype=float), quat_wxyz, quat_wxyz)


@given(
    st.sampled_from([("base", 2), *(("head", n) for n in (2, 3, 4, 5)), ("eye", 4), ("eye", 5)]), points, turns, points
)
def test_a_sensor_is_fixed_to_the_base_or_moves_with_the_whole_chain(moves, position_m, roll_pitch_yaw_deg, fixed_m):
    """A fixed point stays fixed in the base frame for any sensor pose; its covariance is rotated."""
    (on, joints), covariance = moves, np.diag([1.0, 0.1, 0.02])
    mount = Mount(on=on, position_m=position_m, roll_pitch_yaw_deg=roll_pitch_yaw_deg)
    for angles_rad in np.random.default_rng(0).uniform(-0.8, 0.8, (3, joints)):
        sensor = sensor_in_base(mount, GEOMETRY, angles_rad)
        given = seen((np.linalg.inv(sensor) @ [*fixed_m, 1.0])[:3])
        found = mount.to_base(dataclasses.replace(given, position_covariance_m2=covariance), GEOMETRY, angles_rad)
        np.testing.assert_allclose(found.head_position_base_m, fixed_m, atol=1e-11)
        turned_m2 = sensor[:3, :3] @ covariance @ sensor[:3, :3].T
        np.testing.assert_allclose(found.position_covariance_m2, turned_m2, atol=1e-12)


def test_the_history_of_the_joints_is_interpolated():
    history = JointHistory()
    rng = np.random.default_rng(0)
    times = 1.0 + np.cumsum(rng.uniform(0.002, 0.02, 100))
    positions = np.cumsum(rng.normal(0, 0.01, (100, 2)), axis=0)
    for t, position in zip(times, positions, strict=True):
        history.add(t, position, np.array([0.3, -0.2]))
    assert history.at(times[0] - 1e-6) is None
    for t in [*rng.uniform(times[0], times[-1], 200), *times]:
        expected = [np.interp(t, times, positions[:, i]) for i in range(2)]
        np.testing.assert_allclose(history.at(t), expected, atol=1e-12)
    np.testing.assert_allclose(history.at(times[-1] + 0.1), positions[-1] + [0.03, -0.02], atol=1e-12)


def arrived(captured_s, mount):
    """A frame that arrives at 0.5 s, with pan turning at 1 rad/s from 0.1 s on."""
    neck, clock = load_neck("reference").model_copy(update={"geometry": GEOMETRY}), SimulatedClock()
    sighting = Sighting(0.5, seen(POINT_M, time_s=captured_s))
    source = SimpleNamespace(poll=lambda: Arrived((sighting,)))
    robot = SimulatedNeck(neck, np.zeros(2), clock.now_s)
    report = LiveReport()
    arrivals = Arrivals(live_setup(neck, robot, source, clock, mount=mount), report)
    for time_s in 0.1 * np.arange(1, 6):
        arrivals.note_joints(time_s, JointEstimate(np.array([time_s, 0.0]), np.array([1.0, 0.0]), np.zeros(2)))
    return list(arrivals.take(0.5, LoopRecorder(neck.control_period_s, None))), report


POINT_M = [2.0, 0.1, 0.3]


def test_a_moving_sensor_is_placed_by_the_joints_at_capture():
    mount = Mount(on="head", position_m=(0.06, 0.02, 0.08), roll_pitch_yaw_deg=(2.0, -5.0, 3.0))
    (sighting,), _ = arrived(0.25, mount)
    expected_m = (sensor_in_base(mount, GEOMETRY, np.array([0.25, 0.0])) @ [*POINT_M, 1.0])[:3]
    np.testing.assert_allclose(sighting.observation.head_position_base_m, expected_m, atol=1e-12)
    # Joints before the first tick are unknown.
    found, report = arrived(0.05, mount)
    assert (found, len(report.problems)) == ([], 1)


# Unit vectors forward, left and up in each axis convention, from its documentation.
NAMED = {
    "flu": np.eye(3),
    "optical": np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
    "opengl": np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]]),
    "unity": np.array([[0, 0, 1], [-1, 0, 0], [0, 1, 0]]),
}


@pytest.mark.parametrize("axes", NAMED)
@given(point=points, yaw_deg=st.floats(-170.0, 170.0))
def test_other_axes_and_units_give_the_same_observation(axes, point, yaw_deg):
    """Position, covariance and facing direction, written by hand in other axes, millimetres."""
    forward, left, up = NAMED[axes]
    written = 1e3 * (point[0] * forward + point[1] * left + point[2] * up)
    yaw = np.deg2rad(yaw_deg)
    # A face turned to the left by the yaw; its axes have the convention of the sensor's.
    columns = np.stack([forward, left, up]).T
    turn = columns @ about("z", yaw) @ np.linalg.inv(columns)
    quat = Rotation.from_matrix(turn).as_quat(scalar_first=True)
    covariance = columns @ np.diag([4.0, 1.0, 0.25]) @ columns.T
    observation = HeadObservation(1.0, written, quat, None, position_covariance_m2=covariance)
    seen_so = Mount(unit_m=0.001, axes=axes).in_sensor(observation)
    assert seen_so.head_position_base_m == pytest.approx(point, abs=1e-9)
    face = Rotation.from_quat(seen_so.head_quat_wxyz, scalar_first=True).apply([1.0, 0.0, 0.0])
    assert face == pytest.approx([np.cos(yaw), np.sin(yaw), 0.0], abs=1e-9)
    assert seen_so.position_covariance_m2 == pytest.approx(1e-6 * np.diag([4.0, 1.0, 0.25]), abs=1e-15)
