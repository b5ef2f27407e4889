"""Detection of blocked joints, without false positives."""

import numpy as np
import pytest
from builders.live import run_live
from builders.loop import LoopBench, make_loop, make_recorder
from builders.replays import at_100_hz, run_info

from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.loop.joints import FollowingWatch
from gazempc.neck.kinematics import gaze_error_rad
from gazempc.neck.servo import DelayedServo
from gazempc.neck.spec import load_neck
from gazempc.settings import LoopSettings
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import JointState, Sighting
from predictors import HeadObservation
from predictors.bounds import LastPosition

NECK = at_100_hz("reference_eyes")
EYE_PAN = NECK.joint_names.index("eye_pan")


def watched(measured_of, seconds=4.0, frequency_hz=0.4, amplitude_rad=0.15):
    """Blocked joints at each tick under sine commands; `measured_of` maps servo angles to readings."""
    watch, held = FollowingWatch(NECK), []
    servos = [DelayedServo(axis, 0.0, 0.0) for axis in NECK.axes]
    for tick in range(round(seconds / NECK.servo_period_s)):
        now_s = tick * NECK.servo_period_s
        for servo in servos:
            servo.advance_to(now_s)
        angles = measured_of(now_s, np.array([servo.state[0] for servo in servos]))
        watch.measured(None if angles is None else JointState(now_s, angles, np.zeros(NECK.joints)))
        watch.judge()
        held.append(watch.held)
        command = np.full(NECK.joints, amplitude_rad * np.sin(2.0 * np.pi * frequency_hz * now_s))
        watch.sent(command)
        for servo, to in zip(servos, command.tolist(), strict=True):
            servo.send(to)
    return held


def frozen(angles, joint):
    changed = angles.copy()
    changed[joint] = 0.1
    return changed


@pytest.mark.parametrize("joint", [0, EYE_PAN])
def test_only_the_blocked_joint_is_detected(joint):
    assert watched(lambda _, angles: frozen(angles, joint))[-1] == (joint,)


def test_a_blocked_joint_is_detected_and_released_within_a_second():
    held = watched(lambda t, angles: frozen(angles, EYE_PAN) if 2.0 <= t < 3.5 else angles, seconds=6.0)
    at = [round(t / NECK.servo_period_s) for t in (1.9, 3.0, 5.0)]
    assert [held[tick] for tick in at] == [(), (EYE_PAN,), ()]


@pytest.mark.parametrize(
    "measured_of",
    [
        pytest.param(lambda _, angles: angles + 0.15, id="offset"),
        pytest.param(lambda _, angles: 0.5 * angles, id="half the motion"),
        pytest.param(lambda t, angles: angles + 0.003 * np.sin(1e4 * t), id="noise"),
        pytest.param(lambda _, angles: None, id="no encoders"),
        pytest.param(lambda _, angles: angles * np.nan, id="NaN"),
    ],
)
def test_moving_and_unmeasured_joints_are_not_blocked(measured_of):
    assert not any(watched(measured_of))


def test_a_command_pulse_within_the_lag_is_no_blocked_joint():
    """As at the end of a large shift: the command returns within the servo's lag."""
    watch, servo, dead = FollowingWatch(NECK), DelayedServo(NECK.pan, 0.0, 0.0), np.zeros(NECK.joints)
    for tick in range(300):
        now_s = tick * NECK.servo_period_s
        servo.advance_to(now_s)
        angles = np.array([servo.state[0], *dead[1:]])
        watch.measured(JointState(now_s, angles, dead))
        watch.judge()
        assert watch.held == ()
        pan_rad = np.radians(2.5) if 100 <= tick < 103 else 0.0
        watch.sent(np.array([pan_rad, *dead[1:]]))
        servo.send(pan_rad)


def test_the_event_names_the_joint():
    def reading(_, state):
        return JointState(state.time_s, frozen(state.position_rad, EYE_PAN), state.velocity_rad_s)

    log = LoopBench(LookAhead(NECK), neck=NECK, on_read=reading).run(4.0)
    assert log.event_name.tolist().count("joint_not_following") == 1
    (fault,) = [fault for fault in log.faults if fault.event == "joint_not_following"]
    assert "eye_pan" in fault.error


@pytest.mark.parametrize("still", [False, True])
def test_a_blocked_joint_with_speed_commands_is_detected(still):
    """Integrated speeds are compared with the camera's position answers."""

    def reading(_, state):
        return JointState(state.time_s, frozen(state.position_rad, 0), state.velocity_rad_s) if still else state

    result = run_live(neck=load_neck("ptz"), on_read=reading, duration_s=3.0)
    assert ("joint_not_following" in result.events) == still


@pytest.mark.parametrize("name", ["reference", "ptz"])
@pytest.mark.parametrize("pause_s", [0.6, 1.0, 2.5])
def test_after_a_pause_of_the_program_the_loop_continues_without_error(name, pause_s):
    """As of a suspended computer, in the middle of a turn: the neck keeps its last command."""
    neck, now = load_neck(name), [0.0]
    robot = SimulatedNeck(neck, neck.rest_rad, lambda: now[0])
    robot.connect()
    recorder = make_recorder(neck)
    loop = make_loop(robot, recorder, Mpc(neck), LastPosition(), LoopSettings(), neck)
    head_m = np.array([1.0, np.sqrt(3.0), 0.1])
    before = round(0.6 / neck.servo_period_s)
    after = before + round(pause_s / neck.servo_period_s)
    for tick in [*range(before), *range(after, after + round(8.0 / neck.servo_period_s))]:
        now[0] = tick * neck.servo_period_s
        loop.tick(tick, now[0], [Sighting(now[0], HeadObservation(now[0] - 0.03, head_m))])
    error_rad = gaze_error_rad(neck.geometry, robot.true_state().position_rad, head_m)
    assert float(np.rad2deg(error_rad)) < 0.1
    log, _ = recorder.finish(run_info(neck), lambda t: np.tile(head_m, (t.size, 1)))
    if not neck.takes_speeds:  # at constant speed the joint has reached its stop
        assert "joint_not_following" not in log.event_name
