"""Dead time and servo are found on plants whose truth is known, with honest intervals, or not at all."""

import dataclasses
import datetime
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from gazempc.errors import RobotError, SettingsError
from gazempc.identify import command as identify
from gazempc.identify.estimate import bandwidth_hz, estimate_axis
from gazempc.identify.excitation import ExcitationSettings, brake, excite
from gazempc.identify.fitting import robust_covariance
from gazempc.identify.latency import estimate_latency
from gazempc.identify.model import ServoModel
from gazempc.identify.record import IdentificationError, NeckRecord, load_record, record
from gazempc.identify.report import neck_toml
from gazempc.live.clock import SimulatedClock
from gazempc.neck.spec import Axis, NeckSpec, load_neck
from gazempc.results.log import load_log
from gazempc.run import main as run_main
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import JointState

REFERENCE = load_neck("reference")
SHORT = ExcitationSettings(duration_s=12.0)
AXIS_NAMES = ("pan", "tilt")


def plant(dead_times_s=(0.4, 0.4), wn=12.0, zeta=0.9, **changes):
    axes = {
        name: getattr(REFERENCE, name).model_copy(
            update={"dead_time_s": d, "natural_frequency_rad_s": wn, "damping_ratio": zeta, **changes}
        )
        for name, d in zip(AXIS_NAMES, dead_times_s, strict=True)
    }
    return REFERENCE.model_copy(update=axes)


def drive(robot, clock, how=SHORT, limits=REFERENCE, about=None):
    robot.connect()
    return record(robot, clock, excite(limits, limits.rest_rad, how), limits, about or {"from": "test"})


def simulate(neck, how=SHORT, clock=None, seed=0):
    clock = clock or SimulatedClock()
    return drive(SimulatedNeck(neck, REFERENCE.rest_rad, clock.now_s, seed), clock, how)


def altered(taken, **changes):
    return dataclasses.replace(taken, **changes)


def assert_close(estimate, dead_time_s, wn, zeta, *, dead_time_ms=5.0, bandwidth_share=0.05):
    assert estimate.doubts == ()
    assert 1e3 * abs(estimate.dead_time_s.value - dead_time_s) < dead_time_ms
    assert abs(estimate.bandwidth_hz.value / bandwidth_hz(wn, zeta) - 1.0) < bandwidth_share


@pytest.fixture(scope="module")
def clean():
    """A record of the reference neck without any noise."""
    return simulate(plant())


# ---------------------------------------------------------------- excitation

axes = st.builds(
    lambda low, span, v, a, j, wn, zeta: Axis(
        position_min_deg=low,
        position_max_deg=low + span,
        velocity_max_rad_s=v,
        acceleration_max_rad_s2=a,
        jerk_max_rad_s3=j,
        natural_frequency_rad_s=wn,
        damping_ratio=zeta,
        dead_time_s=0.1,
    ),
    low=st.floats(-90, 20),
    span=st.floats(5, 160),
    v=st.floats(0.05, 8),
    a=st.floats(0.2, 80),
    j=st.floats(5, 2000),
    wn=st.floats(4, 40),
    zeta=st.floats(0.3, 2),
)


@settings(max_examples=12)
@given(
    pan=axes,
    tilt=axes,
    rates=st.sampled_from([(50.0, 50.0), (50.0, 200.0), (100.0, 500.0)]),
    how=st.builds(
        ExcitationSettings,
        axes=st.sampled_from(["both", "in_turn", "pan"]),
        duration_s=st.just(8.0),
        amplitude_deg=st.floats(1, 90),
        seed=st.integers(0, 9),
    ),
)
def test_excitation_stays_within_limits(pan, tilt, rates, how):
    neck = NeckSpec(name="any", source="test", pan=pan, tilt=tilt, control_rate_hz=rates[0], servo_rate_hz=rates[1])
    limits, h = neck.command_limits, neck.servo_period_s
    start = neck.rest_rad
    motion = excite(neck, start, how)
    # At rest before and after: the differences there count as well.
    u = np.concatenate([np.tile(start, (3, 1)), motion.position_rad, np.tile(motion.position_rad[-1], (3, 1))])
    assert np.all(u >= limits.position_min_rad - 1e-9)
    assert np.all(u <= limits.position_max_rad + 1e-9)
    for order, bound in enumerate(
        (limits.velocity_max_rad_s, limits.acceleration_max_rad_s2, limits.jerk_max_rad_s3), start=1
    ):
        peak = np.abs(np.diff(u, order, axis=0)).max(axis=0) / h**order
        assert np.all(peak <= bound * (1 + 1e-6) + 1e-13 / h**order), order
    assert np.ptp(motion.position_rad[:, 0]) > 0
    assert (np.ptp(motion.position_rad[:, 1]) > 0) == (how.axes != "pan")


def test_in_turn_moves_one_axis_at_a_time_and_seeds_differ():
    turn = excite(REFERENCE, REFERENCE.rest_rad, ExcitationSettings(axes="in_turn", duration_s=10.0))
    moving = np.abs(np.diff(turn.position_rad, axis=0)) > 0
    assert moving.any(axis=0).all()
    assert not moving.all(axis=1).any()
    one, same, other = (
        excite(REFERENCE, REFERENCE.rest_rad, ExcitationSettings(seed=seed)).position_rad for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)


def test_excitation_begins_where_the_neck_stands():
    start = np.deg2rad([60.0, -20.0])
    motion = excite(REFERENCE, start, SHORT)
    assert np.all(np.abs(motion.position_rad[0] - start) < 1e-4)
    assert np.ptp(motion.position_rad[-200:], axis=0).max() == 0.0


# ---------------------------------------------------------------- model against scipy's


@pytest.mark.parametrize(("wn", "zeta"), [(6.0, 1.2), (12.0, 0.9), (25.0, 0.5), (10.0, 1.0)])
def test_model_is_the_transfer_function_that_scipy_simulates(wn, zeta):
    """lsim on a finer grid with its own delay, a whole number of that grid's steps."""
    motion = excite(REFERENCE, REFERENCE.rest_rad, ExcitationSettings(duration_s=8.0)).position_rad[:, 0]
    command_time = 0.005 * np.arange(motion.size)
    fine = 0.0005 * np.arange(10 * motion.size)
    delay_steps = 247  # 123.5 ms
    u = np.concatenate([np.full(delay_steps, motion[0]), np.repeat(motion, 10)])[: fine.size]
    _, q, _ = signal.lsim(signal.TransferFunction([wn**2], [1, 2 * zeta * wn, wn**2]), u, fine, interp=False)
    read = slice(1003, None, 37)
    model = ServoModel(command_time, motion, fine[read])
    np.testing.assert_allclose(model.delayed(model.motion(wn, zeta), 0.1235), q[read], atol=1e-7)


def test_free_motion_is_that_of_the_undriven_servo():
    wn, zeta, times = 12.0, 0.7, np.linspace(1.0, 4.0, 200)
    model = ServoModel(0.005 * np.arange(900), np.zeros(900), times)
    system = signal.StateSpace([[0, 1], [-(wn**2), -2 * zeta * wn]], [[0], [1]], [[1, 0]], [[0]])
    for column, initial in zip(model.free(wn, zeta).T, np.eye(2), strict=True):
        _, q, _ = signal.lsim(system, np.zeros(200), times - times[0], X0=initial)
        np.testing.assert_allclose(column, q, atol=1e-6)


@pytest.mark.parametrize(("wn", "zeta"), [(6.0, 0.5), (12.0, 0.9), (20.0, 3.0)])
def test_bandwidth_is_where_the_answer_is_3_db_down(wn, zeta):
    _, answer = signal.freqs([wn**2], [1, 2 * zeta * wn, wn**2], [2 * math.pi * bandwidth_hz(wn, zeta)])
    assert abs(answer[0]) == pytest.approx(1 / math.sqrt(2))


# ---------------------------------------------------------------- recovery

TRUTHS = [
    ((0.0, 0.0025), 12.0, 0.9),
    ((0.4, 0.4012), 12.0, 0.9),
    ((0.0333, 0.5), 25.0, 0.5),
    ((0.2571, 0.12), 6.0, 1.2),
    ((0.35, 0.005), 8.0, 0.5),
    ((0.0137, 0.46), 25.0, 1.2),
]


@pytest.mark.parametrize(("dead_times_s", "wn", "zeta"), TRUTHS)
def test_dead_time_and_servo_are_told_apart(dead_times_s, wn, zeta):
    taken = simulate(plant(dead_times_s, wn, zeta, encoder_noise_deg=0.1, load_offset_deg=1.5), seed=3)
    for axis, dead_time_s in enumerate(dead_times_s):
        found = estimate_axis(taken, axis)
        assert_close(found, dead_time_s, wn, zeta)
        assert math.degrees(found.offset_rad) == pytest.approx(1.5, abs=0.05)
        assert found.residual_rms_deg == pytest.approx(0.1, rel=0.1)
        assert found.fit_percent > 95


def test_without_noise_the_truth_comes_back(clean):
    found = estimate_axis(clean, 0)
    assert_close(found, 0.4, 12.0, 0.9, dead_time_ms=1e-3, bandwidth_share=1e-5)
    assert found.damping_ratio.value == pytest.approx(0.9, abs=1e-5)
    assert found.servo_lag_s.value == pytest.approx(0.15, abs=1e-5)
    assert found.dead_time_s.half_width >= 0.99e-4, "no one knows a real neck to the nanosecond"


def test_intervals_hold_what_they_promise(clean):
    """95 % intervals of repeats with noise that is correlated in time, as of friction, hold the truth."""
    rng = np.random.default_rng(0)
    thin = altered(clean, joint_time_s=clean.joint_time_s[::4], joint_rad=clean.joint_rad[::4])
    truths = (0.4, 12.0, 0.9, bandwidth_hz(12.0, 0.9))
    repeats, rho, inside, narrow = 24, 0.8, np.zeros(4), np.zeros(4)
    for _ in range(repeats):
        white = rng.normal(0.0, math.radians(0.1) * math.sqrt(1 - rho**2), thin.joint_rad.shape)
        noise = signal.lfilter([1.0], [1.0, -rho], white, axis=0)
        found = estimate_axis(altered(thin, joint_rad=thin.joint_rad + noise), 0)
        intervals = (found.dead_time_s, found.natural_frequency_rad_s, found.damping_ratio, found.bandwidth_hz)
        for i, (interval, truth) in enumerate(zip(intervals, truths, strict=True)):
            inside[i] += interval.low <= truth <= interval.high
            # An interval that is too wide holds the truth too, but says nothing: a third of it must often miss.
            narrow[i] += abs(truth - interval.value) <= interval.half_width / 6
    assert np.all(inside >= 0.8 * repeats), inside / repeats
    assert np.all(narrow <= 0.75 * repeats), narrow / repeats


def test_covariance_of_correlated_errors_is_that_of_repeats():
    """A mean of first-order noise has a variance (1 + rho) / (1 - rho) times that of independent errors."""
    rng, rho, n = np.random.default_rng(5), 0.8, 4000
    stated = [
        robust_covariance(np.ones((n, 1)), signal.lfilter([1.0], [1.0, -rho], rng.normal(0, math.sqrt(1 - rho**2), n)))
        for _ in range(20)
    ]
    assert np.mean(stated) == pytest.approx((1 + rho) / (1 - rho) / n, rel=0.2)


class _Jittering(SimulatedClock):
    """Wakes up late, each time differently."""

    def __init__(self):
        super().__init__()
        self._rng = np.random.default_rng(7)

    def sleep_until_s(self, time_s):
        super().sleep_until_s(time_s + float(self._rng.exponential(0.002)))


class _Reporting(SimulatedNeck):
    """Reports as cheap hardware does: rarely, the same reading again in between, in whole encoder steps, wild ones."""

    stamped_late_s = 0.0

    def read_state(self):
        now = super().read_state()
        held = getattr(self, "_held", None)
        if held is None or now.time_s - held.time_s + self.stamped_late_s > 0.03:
            self._reads = getattr(self, "_reads", 0) + 1
            step = math.radians(0.088)
            angles = np.round(now.position_rad / step) * step
            if self._reads % 97 == 0:
                angles = np.full(2, -math.pi)
            self._held = JointState(now.time_s + self.stamped_late_s, angles, now.velocity_rad_s)
        return self._held


def test_cheap_hardware_is_identified_all_the_same():
    """A late computer; 33 readings a second, each reported many times, in 0.088 deg steps, some of them -180 deg."""
    clock, truth = _Jittering(), plant((0.2345, 0.08), 14.0, 0.7, encoder_noise_deg=0.1)
    taken = drive(_Reporting(truth, REFERENCE.rest_rad, clock.now_s), clock, ExcitationSettings(duration_s=16.0))
    for axis, dead_time_s in enumerate((0.2345, 0.08)):
        found = estimate_axis(taken, axis)
        assert_close(found, dead_time_s, 14.0, 0.7)
        assert 3 <= found.misread <= 10
        assert found.time_s.size < 1000


def test_a_known_delay_of_the_time_stamps_is_taken_off():
    clock, truth = SimulatedClock(), plant((0.2, 0.2))
    robot = _Reporting(truth, REFERENCE.rest_rad, clock.now_s)
    robot.stamped_late_s = 0.03
    taken = drive(robot, clock)
    assert_close(estimate_axis(taken, 0), 0.23, 12.0, 0.9)
    assert_close(estimate_axis(taken, 0, read_delay_s=0.03), 0.2, 12.0, 0.9)


def test_mujoco_is_identified():
    pytest.importorskip("mujoco")
    mujoco = pytest.importorskip("gazempc.robots.mujoco.robot")
    clock, truth = SimulatedClock(), plant((0.4, 0.1234), 12.0, 0.7, encoder_noise_deg=0.05)
    taken = drive(mujoco.MujocoNeck(truth, clock.now_s, REFERENCE.rest_rad), clock)
    for axis, dead_time_s in enumerate((0.4, 0.1234)):
        assert_close(estimate_axis(taken, axis), dead_time_s, 12.0, 0.7)


# ---------------------------------------------------------------- refusals


def refusal(taken, axis=0, **options):
    """Text with which it is refused, before or after the fit."""
    try:
        return "\n".join(estimate_axis(taken, axis, **options).doubts)
    except IdentificationError as error:
        return str(error)


def moving(clean, command):
    return altered(clean, command_rad=np.column_stack([command, command]))


def with_noise(taken, sigma_deg):
    return taken.joint_rad + np.random.default_rng(2).normal(0, math.radians(sigma_deg), taken.joint_rad.shape)


def friction(taken):
    """A joint that moves only in jumps of 40 degrees."""
    return np.round(taken.joint_rad / math.radians(40)) * math.radians(40)


SPOILT = {
    "were not reported once": lambda t: altered(t, joint_time_s=np.zeros(0), joint_rad=np.zeros((0, 2))),
    "1 different time stamps": lambda t: altered(t, joint_time_s=np.full_like(t.joint_time_s, 3.0)),
    "50 different time stamps": lambda t: altered(t, joint_time_s=t.joint_time_s[:50], joint_rad=t.joint_rad[:50]),
    "share 2.0 s": lambda t: altered(t, joint_time_s=t.joint_time_s[:400], joint_rad=t.joint_rad[:400]),
    "share 0.0 s": lambda t: altered(t, joint_time_s=t.joint_time_s + 1e9),
    "never changes": lambda t: moving(t, np.zeros(len(t.command_rad))),
    "moves over 0.40 deg": lambda t: moving(t, t.command_rad[:, 0] / 100),
    "at a limit of the neck": lambda t: moving(
        t, np.where(np.arange(len(t.command_rad)) % 200 < 190, math.radians(80), math.radians(60))
    ),
    "the joint over 0.0 deg": lambda t: altered(t, joint_rad=np.zeros_like(t.joint_rad)),
    "jump as no joint can": lambda t: altered(
        t, joint_rad=np.where(np.arange(len(t.joint_rad))[:, None] % 10 == 0, -math.pi, t.joint_rad)
    ),
    "of the motion; at least 80 %": lambda t: altered(t, joint_rad=friction(t)),
    "dead time is only known to": lambda t: altered(
        t, joint_time_s=t.joint_time_s[::40], joint_rad=with_noise(t, 3.0)[::40]
    ),
    "before its commands": lambda t: altered(t, joint_time_s=t.joint_time_s - 0.45),
    "at the end of what was looked for (-100 ms)": lambda t: altered(t, joint_time_s=t.joint_time_s - 0.6),
}


@pytest.mark.parametrize("problem", SPOILT)
def test_refuses_what_the_data_cannot_tell(clean, problem):
    text = refusal(SPOILT[problem](clean))
    assert problem in text
    assert text.startswith("pan: ")


def test_refuses_a_dead_time_beyond_what_was_looked_for(clean):
    assert "--dead-time-max-s" in refusal(clean, dead_time_max_s=0.3)
    assert refusal(clean, dead_time_max_s=0.5) == ""


def test_refuses_a_servo_too_fast_for_the_readings():
    text = refusal(altered(simulate(plant((0.1, 0.1), 250.0, 1.0, encoder_noise_deg=0.5))))
    assert "bandwidth is only known to" in text


def test_play_in_the_gears_is_noted_and_noise_is_not(clean):
    """The intervals know noise only; what the model cannot be must be said."""
    slack, held, rows = math.radians(0.8), clean.joint_rad[0], []
    for angles in clean.joint_rad:
        held = np.clip(held, angles - slack / 2, angles + slack / 2)
        rows.append(held)
    with_play = estimate_axis(altered(clean, joint_rad=np.array(rows)), 0)
    assert "hang together in time" in with_play.note
    assert 0.1 < with_play.structured_rms_deg <= with_play.residual_rms_deg < 0.8
    noisy = estimate_axis(altered(clean, joint_rad=with_noise(clean, 0.3)), 0)
    assert noisy.note == ""
    assert noisy.structured_rms_deg < 0.1


# ---------------------------------------------------------------- recording


class _Failing(SimulatedNeck):
    """Fails to answer from one call on."""

    sends = reads = 10**9
    error: type[BaseException] = RobotError

    def read_state(self):
        self.reads -= 1
        if self.reads < 0:
            raise RobotError("no answer")
        return super().read_state()

    def send_command(self, position_rad):
        self.sends -= 1
        if self.sends == 0:
            raise self.error("no answer")
        self.sent = [*getattr(self, "sent", []), np.array(position_rad)]
        return super().send_command(position_rad)


@pytest.mark.parametrize("cause", ["interrupt", "command", "silence"])
def test_whatever_ends_a_run_the_neck_comes_to_rest_within_limits(cause):
    clock = SimulatedClock()
    robot = _Failing(plant(), REFERENCE.rest_rad, clock.now_s)
    expected = RobotError
    if cause == "interrupt":
        robot.sends, robot.error, expected = 250, KeyboardInterrupt, KeyboardInterrupt
    elif cause == "command":
        robot.sends = 250
    else:
        robot.reads = 150
    with pytest.raises(expected):
        drive(robot, clock)
    sent, h = np.array(robot.sent), REFERENCE.servo_period_s
    assert len(sent) < 400
    assert np.abs(np.diff(sent, axis=0)).max() / h > 0.5, "it should have been moving"
    assert np.abs(np.diff(sent[-2:], axis=0)).max() < 1e-12, "at rest in the end"
    assert np.all(np.abs(np.diff(sent, axis=0)) / h <= REFERENCE.velocity_max_rad_s)
    # One command is missing where it failed, which shows in the second difference there; after that all is smooth.
    braking = sent[250:] if cause != "silence" else sent
    assert np.all(np.abs(np.diff(braking, 2, axis=0)) / h**2 <= REFERENCE.acceleration_max_rad_s2 * 1.001)


@given(seconds=st.floats(0.5, 11.0))
@settings(max_examples=10)
def test_braking_keeps_acceleration_and_jerk(seconds):
    motion = excite(REFERENCE, REFERENCE.rest_rad, SHORT).position_rad
    at = int(seconds * 200)
    u = np.concatenate([motion[:at], brake(REFERENCE, motion[at - 3 : at])])
    assert np.all(np.abs(np.diff(u, 2, axis=0)) * 200**2 <= REFERENCE.acceleration_max_rad_s2 * 1.02)
    assert np.abs(u[-1] - u[-2]).max() < 1e-9


def test_a_few_failed_reads_are_counted_and_do_no_harm():
    class Stuttering(SimulatedNeck):
        count = 0

        def read_state(self):
            self.count += 1
            if self.count % 7 == 0:
                raise RobotError("checksum")
            return super().read_state()

    clock = SimulatedClock()
    taken = drive(Stuttering(plant(), REFERENCE.rest_rad, clock.now_s), clock)
    assert taken.failed_reads == pytest.approx(len(taken.command_rad) / 7, abs=1)
    assert_close(estimate_axis(taken, 0), 0.4, 12.0, 0.9)


def test_record_survives_its_file(clean, tmp_path):
    clean.save(tmp_path / "r.npz")
    again = load_record(tmp_path / "r.npz")
    assert again.about == clean.about
    for field in ("command_time_s", "command_rad", "joint_time_s", "joint_rad"):
        np.testing.assert_array_equal(getattr(again, field), getattr(clean, field))
    assert again.neck() == REFERENCE


def test_other_files_are_refused(tmp_path):
    with pytest.raises(SettingsError, match="not a log that can be read"):
        load_record(tmp_path / "none.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(SettingsError, match=r"neither a record of gazempc\.identify .*command_time_s"):
        load_record(tmp_path / "other.npz")


# ---------------------------------------------------------------- sensor latency


def walk(times_s):
    return np.stack([2.0 + 0.3 * np.sin(times_s), 1.3 * times_s - 3.0, 0.03 * np.sin(11 * times_s)], axis=-1)


@pytest.mark.parametrize("latency_s", [0.0, 0.066, 0.25, -0.05])
def test_latency_of_a_known_motion_is_found(latency_s):
    rng, known_s, seen_s = np.random.default_rng(1), np.arange(0, 6, 0.01), np.arange(0.0, 6.0, 1 / 30)
    observed = walk(seen_s - latency_s) + np.array([0.02, -0.05, 0.0]) + rng.normal(0, 0.01, (seen_s.size, 3))
    found = estimate_latency(known_s, walk(known_s), seen_s, observed)
    assert found.latency_s.value == pytest.approx(latency_s, abs=0.005)
    assert found.latency_s.low <= latency_s <= found.latency_s.high
    assert found.residual_rms == pytest.approx(0.01, rel=0.15)


def test_latency_of_a_camera_that_turns_before_a_fixed_target():
    """The encoders say where the target should be seen: one axis, in radians."""
    times_s = np.arange(0, 8, 0.005)
    pan = 0.3 * np.sin(2 * times_s) * np.sin(0.7 * times_s)
    seen_s = np.arange(0.5, 7.5, 0.04)
    bearing = 0.2 - np.interp(seen_s - 0.1, times_s, pan)
    assert estimate_latency(times_s, -pan, seen_s, bearing).latency_s.value == pytest.approx(0.1, abs=1e-3)


def test_latency_is_refused_where_nothing_tells_it():
    rng, known_s, seen_s = np.random.default_rng(1), np.arange(0, 6, 0.01), np.arange(0.0, 6.0, 1 / 30)
    noise = rng.normal(0, 0.01, (seen_s.size, 3))
    with pytest.raises(IdentificationError, match="sensor latency: "):
        estimate_latency(known_s, 0.001 * walk(known_s), seen_s, 0.001 * walk(seen_s) + noise)
    with pytest.raises(IdentificationError, match="10 observations"):
        estimate_latency(known_s, walk(known_s), seen_s[:10], walk(seen_s[:10]))
    with pytest.raises(IdentificationError, match="on one clock"):
        estimate_latency(known_s, walk(known_s), seen_s, walk(seen_s - 1.4))
    with pytest.raises(IdentificationError, match="0 times"):
        estimate_latency(known_s, np.full((600, 3), np.nan), seen_s, walk(seen_s))


# ---------------------------------------------------------------- files and command line


def test_neck_file_is_the_estimate_and_keeps_the_rest(clean, tmp_path):
    found = estimate_axis(clean, 0)
    text = neck_toml(load_neck("fetch"), [found], 'odd "name"', "a\\b\n\x7f", datetime.date(2030, 1, 2))
    (tmp_path / "n.toml").write_text(text, encoding="utf-8")
    neck, fetch = load_neck(tmp_path / "n.toml"), load_neck("fetch")
    assert neck.name == 'odd "name"'
    assert "2030-01-02 from a\\b\n\x7f" in neck.source
    assert "dead time 400.0 ± 0.1 ms" in neck.source
    assert "tilt not identified" in neck.source
    for name in ("dead_time_s", "natural_frequency_rad_s", "damping_ratio"):
        assert getattr(neck.pan, name) == pytest.approx(getattr(found, name).value, rel=1e-5)
    servo = {"dead_time_s", "natural_frequency_rad_s", "damping_ratio"}
    assert neck.pan.model_dump(exclude=servo) == fetch.pan.model_dump(exclude=servo)
    assert (neck.tilt, neck.geometry, neck.servo_rate_hz) == (fetch.tilt, fetch.geometry, fetch.servo_rate_hz)


def test_command_line_identifies_a_robot_and_its_record(tmp_path, capsys):
    out = tmp_path / "sub" / "mine.toml"
    assert identify.main(["--robot", "simulated", "--neck", "slow", "--out", str(out), "--duration-s", "12"]) == 0
    said = capsys.readouterr().out
    assert "400.0 ± 0.1" in said
    assert str(out) in said
    neck = load_neck(out)
    assert neck.name == "mine"
    assert neck.dead_time_s == pytest.approx([0.4, 0.4], abs=1e-4)
    assert neck.velocity_max_rad_s.tolist() == load_neck("slow").velocity_max_rad_s.tolist()
    assert out.with_suffix(".png").stat().st_size > 20_000
    again = tmp_path / "again.toml"
    words = ["--from-log", str(out.with_suffix(".npz")), "--out", str(again), "--axes", "pan"]
    assert identify.main(words) == 0
    assert load_neck(again).pan == neck.pan
    assert load_neck(again).tilt == load_neck("slow").tilt


def test_a_replay_tells_the_neck_and_the_sensor(tmp_path, capsys):
    words = ["--replay", "subject03_R4", "--controllers", "lookahead", "--no-figures", "--out", str(tmp_path)]
    assert run_main(words) == 0
    capsys.readouterr()
    path = tmp_path / "lookahead.npz"
    assert identify.main(["--from-log", str(path), "--out", str(tmp_path / "n.toml")]) == 0
    neck = load_neck(tmp_path / "n.toml")
    for axis in neck.axes:
        assert axis.dead_time_s == pytest.approx(0.4, abs=0.005)
        assert bandwidth_hz(axis.natural_frequency_rad_s, axis.damping_ratio) == pytest.approx(1.4251, rel=0.05)
    assert "Sensor latency" in capsys.readouterr().out
    from gazempc.identify.latency import log_latency

    log = load_log(path)
    arrived, captured = log_latency(log)
    late_s = float(np.mean(log.arrival_time_s - log.capture_time_s))
    assert arrived.latency_s.low <= late_s <= arrived.latency_s.high
    assert captured.latency_s.low <= 0 <= captured.latency_s.high


def test_command_line_refuses_and_says_why(clean, tmp_path, capsys):
    out = str(tmp_path / "n.toml")
    still = altered(clean, command_rad=np.column_stack([clean.command_rad[:, 0], np.zeros(len(clean.command_rad))]))
    still.save(tmp_path / "still.npz")
    for words, problem in (
        ([], "either --robot NAME or --from-log FILE"),
        (["--robot", "simulated", "--from-log", "x.npz"], "either --robot NAME or --from-log FILE"),
        (["--from-log", str(tmp_path / "none.npz")], "not a log that can be read"),
        (["--robot", "simulated", "--neck", "nock"], "no neck file 'nock'"),
        (["--from-log", str(tmp_path / "still.npz")], "tilt: its command never changes"),
    ):
        assert identify.main([*words, "--out", out]) == 2
        assert problem in capsys.readouterr().err
    assert identify.main(["--robot", "simulated", "--out", str(tmp_path / "n.yaml")]) == 2
    assert "must end in .toml" in capsys.readouterr().err
    assert not (tmp_path / "n.toml").exists()


def test_command_line_stops_when_interrupted(tmp_path, monkeypatch, capsys):
    def make(name, options, neck, clock, position_rad, seed=0):
        robot = _Failing(neck, position_rad, clock.now_s)
        robot.sends, robot.error = 250, KeyboardInterrupt
        return robot

    monkeypatch.setattr(identify, "make_robot", make)
    assert identify.main(["--robot", "simulated", "--out", str(tmp_path / "n.toml")]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_neck_without_encoders_is_not_moved(tmp_path, monkeypatch, capsys):
    moved = []

    def make(name, options, neck, clock, position_rad, seed=0):
        blind = SimulatedNeck(neck.model_copy(update={"reports_joints": False}), position_rad, clock.now_s)
        blind.send_command = moved.append
        return blind

    monkeypatch.setattr(identify, "make_robot", make)
    assert identify.main(["--robot", "simulated", "--out", str(tmp_path / "n.toml")]) == 2
    assert "not reported its joints within 2 s" in capsys.readouterr().err
    assert moved == []


def test_record_names_its_origin(clean):
    assert isinstance(clean, NeckRecord)
    assert json.loads(clean.about)["from"] == "test"


class HeldUp(SimulatedClock):
    """Wakes up late once."""

    def __init__(self, late_s):
        super().__init__()
        self._late_s = late_s

    def sleep_until_s(self, time_s):
        if self._late_s and time_s > 3.0:
            time_s, self._late_s = time_s + self._late_s, 0.0
        super().sleep_until_s(time_s)


def test_a_computer_that_is_held_up_makes_no_jump():
    """What was planned is done later, not left out; after a longer stall the neck is braked and the run is given up."""
    planned = np.abs(np.diff(excite(REFERENCE, REFERENCE.rest_rad, SHORT).position_rad, axis=0)).max()
    taken = simulate(REFERENCE, clock=HeldUp(0.06))
    assert np.abs(np.diff(taken.command_rad, axis=0)).max() <= planned + 1e-12
    clock = HeldUp(0.5)
    robot = SimulatedNeck(REFERENCE, REFERENCE.rest_rad, clock.now_s)
    with pytest.raises(RobotError, match="held up for 500 ms"):
        drive(robot, clock)
    clock.sleep_until_s(clock.now_s() + 2.0)
    assert np.abs(robot.true_state().velocity_rad_s).max() < 1e-3


def test_whatever_ends_an_identification_the_neck_is_braked_first():
    clock = SimulatedClock()
    robot = SimulatedNeck(REFERENCE, REFERENCE.rest_rad, clock.now_s)
    robot.connect()

    def on_tick(share):
        if share > 0.4:
            raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        record(robot, clock, excite(REFERENCE, REFERENCE.rest_rad, SHORT), REFERENCE, {"from": "test"}, on_tick)
    clock.sleep_until_s(clock.now_s() + 2.0)
    assert np.abs(robot.true_state().velocity_rad_s).max() < 1e-3
