"""Excitation and recording: within limits, and at rest after any end of a run."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from builders.control import assert_within
from builders.identification import REFERENCE, SHORT, drive, plant, simulate
from builders.robots import Spied
from hypothesis import given, settings
from hypothesis import strategies as st

import gazempc as gz
from gazempc.errors import RobotError
from gazempc.identify.excitation import ExcitationSettings, brake, excite
from gazempc.identify.record import load_record
from gazempc.live.clock import SimulatedClock
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.sim.simulated import SimulatedNeck


@pytest.mark.parametrize("cause", ["interrupt", "command", "silence"])
def test_the_neck_brakes_within_limits_however_a_run_ends(cause):
    clock, calls = SimulatedClock(), itertools.count(1)
    expected = KeyboardInterrupt if cause == "interrupt" else RobotError

    def on_send(_):
        if cause != "silence" and next(calls) == 250:
            raise expected("no answer")

    def on_read(_, state):
        if cause == "silence" and next(calls) > 150:
            raise RobotError("no answer")
        return state

    robot = Spied(SimulatedNeck(plant(), REFERENCE.rest_rad, clock.now_s), clock, on_read, on_send)
    with pytest.raises(expected):
        drive(robot, clock)
    sent, h = np.array([command for _, command in robot.received]), REFERENCE.servo_period_s
    assert len(sent) < 400
    assert np.abs(np.diff(sent, axis=0)).max() / h > 0.5, "it should have been moving"
    assert np.abs(np.diff(sent[-2:], axis=0)).max() < 1e-12, "at rest in the end"
    assert np.all(np.abs(np.diff(sent, axis=0)) / h <= REFERENCE.velocity_max_rad_s)
    # The failed command is missing, which shows in the second difference; the rest is smooth.
    braking = sent[250:] if cause != "silence" else sent
    assert np.all(np.abs(np.diff(braking, 2, axis=0)) / h**2 <= REFERENCE.acceleration_max_rad_s2 * 1.001)


@given(seconds=st.floats(0.5, 11.0))
@settings(max_examples=10)
def test_braking_keeps_acceleration_and_jerk_limits(seconds):
    motion = excite(REFERENCE, REFERENCE.rest_rad, SHORT)
    at = int(seconds * 200)
    u = np.concatenate([motion[:at], brake(REFERENCE, motion[at - 3 : at])])
    assert np.all(np.abs(np.diff(u, 2, axis=0)) * 200**2 <= REFERENCE.acceleration_max_rad_s2 * 1.02)
    assert np.abs(u[-1] - u[-2]).max() < 1e-9


class HeldUp(SimulatedClock):
    """A clock with one late wake-up."""

    def __init__(self, late_s):
        super().__init__()
        self._late_s = late_s

    def sleep_until_s(self, time_s):
        if self._late_s and time_s > 3.0:
            time_s, self._late_s = time_s + self._late_s, 0.0
        super().sleep_until_s(time_s)


def test_a_late_tick_causes_no_jump():
    """The plan is delayed, not shortened; after a longer stall the neck is braked and the run aborted."""
    planned = np.abs(np.diff(excite(REFERENCE, REFERENCE.rest_rad, SHORT), axis=0)).max()
    taken = simulate(REFERENCE, clock=HeldUp(0.06))
    assert np.abs(np.diff(taken.command_rad, axis=0)).max() <= planned + 1e-12
    clock = HeldUp(0.5)
    robot = SimulatedNeck(REFERENCE, REFERENCE.rest_rad, clock.now_s)
    with pytest.raises(RobotError, match="a tick was 500 ms late"):
        drive(robot, clock)
    clock.sleep_until_s(clock.now_s() + 2.0)
    assert np.abs(robot.true_state().velocity_rad_s).max() < 1e-3


# ---------------------------------------------------------------- excitation


PAN = load_neck("reference").pan
axes = st.fixed_dictionaries(
    {
        "position_min_deg": st.floats(-90, 20),
        "position_max_deg": st.floats(25, 180),
        "velocity_max_rad_s": st.floats(0.05, 8),
        "acceleration_max_rad_s2": st.floats(0.2, 80),
        "jerk_max_rad_s3": st.floats(5, 2000),
        "natural_frequency_rad_s": st.floats(4, 40),
        "damping_ratio": st.floats(0.3, 2),
    }
).map(lambda values: PAN.model_copy(update=values))


@settings(max_examples=12)
@given(
    pan=axes,
    tilt=axes,
    rates=st.sampled_from([(50.0, 50.0), (50.0, 200.0), (100.0, 500.0)]),
    how=st.builds(
        ExcitationSettings,
        axes=st.sampled_from([("all",), ("pan",)]),
        duration_s=st.just(8.0),
        amplitude_deg=st.floats(1, 90),
        seed=st.integers(0, 9),
    ),
)
def test_excitation_stays_within_limits(pan, tilt, rates, how):
    neck = NeckSpec(name="any", source="test", pan=pan, tilt=tilt, control_rate_hz=rates[0], servo_rate_hz=rates[1])
    start = neck.rest_rad
    motion = excite(neck, start, how)
    # At rest before and after: differences across the ends are included.
    u = np.concatenate([start[None], motion, np.tile(motion[-1], (3, 1))])
    assert_within(neck.command_limits, u, neck.servo_period_s)
    assert np.ptp(motion[:, 0]) > 0
    assert (np.ptp(motion[:, 1]) > 0) == (how.axes != ("pan",))


def test_readings_of_a_live_log_have_their_own_times(tmp_path):
    """Not those of the ticks: the dead time would be too large by the age of the readings."""
    log = gz.replay("subject03_R4", controller="reactive")
    late_s = np.where(np.arange(log.time_s.size) % 8 < 4, 0.02, np.nan)
    replace(log, joint_time_s=log.time_s - late_s).save(tmp_path / "log.npz")
    record = load_record(tmp_path / "log.npz")
    expected_s = log.time_s - np.nan_to_num(late_s)
    np.testing.assert_allclose(record.joint_time_s, expected_s[np.isfinite(log.joint_position_rad).all(axis=1)])
