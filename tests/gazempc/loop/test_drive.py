"""The drive of speed-driven joints, alone and in a replay beside an angle-driven joint."""

import numpy as np
import pytest

from gazempc.loop.drive import Drive
from gazempc.loop.observer import JointObserver
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.results.metrics import measure
from gazempc.sim.replay import replay_scene
from gazempc.sim.scene import Scene, make_scene
from gazempc.sim.sensor import load_sensor
from gazempc.types import JointState

PTZ = load_neck("ptz")
H = PTZ.servo_period_s
STILL = (0.0, 0.0, 0.0)
SENSOR = load_sensor("reference")
WALK = make_scene("subject01_R3", neck=PTZ).walk


def taking(command: str, **changes: float) -> NeckSpec:
    axes = {n: getattr(PTZ, n).model_dump() | {"command": command} | changes for n in ("pan", "tilt")}
    return PTZ.model_copy(update=axes)


def test_the_speed_is_the_derivative_and_leads_to_the_angle() -> None:
    drive = Drive(PTZ, np.array([0.2, 0.0]))
    led = []
    for _ in range(10):
        out = drive.outgoing(((9.9, 0.5, 0.0), STILL), np.zeros(2), np.inf)
        np.testing.assert_allclose(out, [0.5, 0.0])
        led.append(drive.sent(out)[0])
    # The middle of each period's ramp.
    np.testing.assert_allclose(led, 0.2 + 0.5 * H * (np.arange(10) + 0.5))


def test_an_offset_is_removed_slowly_and_completely() -> None:
    drive, gone = Drive(PTZ, np.zeros(2)), 0.0
    for k in range(1000):
        out = drive.outgoing((STILL, STILL), np.array([0.3, 0.0]), np.inf)
        assert -0.1 * PTZ.pan.velocity_max_rad_s - 1e-12 <= out[0] <= 0.0, k
        drive.sent(out)
        gone += H * out[0]
    assert gone == pytest.approx(-0.3, abs=1e-6)


def test_lost_speed_commands_do_not_count_as_sent() -> None:
    drive = Drive(PTZ, np.zeros(2))
    drive.outgoing(((0.0, 1.0, 0.0), STILL), np.zeros(2), np.inf)
    drive.sent(np.array([0.7, 0.0]), got_through=False)  # an older speed stays in effect
    back = drive.outgoing((STILL, STILL), np.zeros(2), np.inf)
    assert back[0] < 0.0


def test_commands_given_to_a_controller_start_at_the_joint_position() -> None:
    sent, offset = np.ones((3, 2)), np.array([0.1, 0.2])
    mixed = PTZ.model_copy(update={"tilt": PTZ.tilt.model_dump() | {"command": "position"}})
    commands, left = Drive(mixed, np.zeros(2)).for_controllers(sent, offset)
    np.testing.assert_allclose(commands, np.tile([1.1, 1.0], (3, 1)))
    np.testing.assert_allclose(left, [0.0, 0.2])


def test_a_replay_with_speeds_equals_one_with_angles() -> None:
    speeds, angles = (
        replay_scene(Scene(WALK, taking(c), SENSOR), "mpc", "constant_velocity").log for c in ("velocity", "position")
    )
    # A twelfth of a degree: a speed is held for a period, and acquisition begins at a threshold.
    np.testing.assert_allclose(speeds.joint_position_rad, angles.joint_position_rad, atol=1.5e-3)
    assert measure(speeds).limit_violations == 0


def test_a_wrong_dead_time_causes_no_oscillation() -> None:
    wrong = taking("velocity", dead_time_s=1.3 * PTZ.pan.dead_time_s)
    right, off = (
        measure(replay_scene(Scene(WALK, PTZ, SENSOR, robot_neck=neck), "mpc", "constant_velocity").log)
        for neck in (taking("velocity"), wrong)
    )
    assert off.rms_acceleration_rad_s2 < 1.3 * right.rms_acceleration_rad_s2
    assert off.gaze_error_rms_deg < right.gaze_error_rms_deg + 3.0


def test_the_observer_accepts_a_pushed_joint() -> None:
    observer = JointObserver(PTZ, np.zeros(2), 0.0)
    for k in range(1, 100):
        pushed_rad = np.array([0.5 if k > 10 else 0.0, 0.0])
        observer.update(k * H, JointState(k * H, pushed_rad, np.zeros(2)))
        observer.sent(np.zeros(2))
    np.testing.assert_allclose(observer.estimate.position_rad, [0.5, 0.0], atol=1e-9)
    np.testing.assert_allclose(observer.estimate.offset_rad, [0.5, 0.0], atol=1e-9)


@pytest.mark.parametrize("reports", [True, False])
def test_skipped_periods_are_the_sum_of_single_ones(reports) -> None:
    neck, speed = PTZ.model_copy(update={"reports_joints": reports}), np.array([0.4, -0.1])
    drives = Drive(neck, np.zeros(2)), Drive(neck, np.zeros(2))
    for _ in range(60):
        drives[0].sent(speed, got_through=False)
    drives[1].skip(60, speed)
    np.testing.assert_allclose(*(drive.sent(np.zeros(2)) for drive in drives))
    drives[1].skip(10_000, speed)
    stops_deg = PTZ.pan.position_max_deg
    assert (np.rad2deg(drives[1].sent(np.zeros(2))[0]) > stops_deg + 1e-9) == reports


def test_the_position_loop_keeps_a_lower_speed_limit() -> None:
    drive = Drive(PTZ, np.zeros(2))
    motions = ((0.0, 0.08, 0.0), (0.0, -0.3, 0.0))  # tilt still brakes to the limit
    np.testing.assert_allclose(drive.outgoing(motions, np.array([-0.5, 0.5]), 0.1), [0.1, -0.3])
