"""The joint observer against a known plant."""

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.loop.observer import JointObserver, observer_gain
from gazempc.neck.servo import zero_order_hold
from gazempc.neck.spec import Axis, load_neck, neck_names
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import JointState

NECK = load_neck("reference")
TS = NECK.servo_period_s


def variant(**of_both_axes):
    content = NECK.model_dump()
    for axis in ("pan", "tilt"):
        content[axis] |= of_both_axes
    return NECK.model_validate(content)


def follow(plant, seconds, model=NECK, age_s=0.0, stamped=True, seen=lambda t: True, halfway=False):
    """Drive a neck to and fro; returns estimates and truth at each tick, and the final offset."""
    now = 0.0
    robot = SimulatedNeck(plant, np.zeros(2), lambda: now, seed=1)
    robot.connect()
    observer = JointObserver(model, np.zeros(2), 0.0)
    measured, estimates, truth = [], [], []
    for k in range(int(seconds / TS)):
        now = k * TS
        measured.append(robot.read_state())
        old = measured[max(0, k - round(age_s / TS))]
        if old is not None and not stamped:
            old = JointState(now, old.position_rad, old.velocity_rad_s)
        if halfway and k:  # stamped between two ticks
            both = [measured[-2].position_rad, measured[-1].position_rad]
            old = JointState(now - 0.5 * TS, np.mean(both, axis=0), old.velocity_rad_s)
        observer.update(now, old if seen(now) else None)
        estimate = observer.estimate
        estimates.append([estimate.position_rad, estimate.velocity_rad_s])
        true = robot.true_state()
        truth.append([true.position_rad, true.velocity_rad_s])
        command = np.array([0.6, 0.3]) * np.sin([2.0 * now, 3.0 * now])
        observer.sent(robot.send_command(command))
    return np.array(estimates), np.array(truth), estimate.offset_rad


@pytest.mark.parametrize("dead_time_s", [0.0, 0.0131, 0.4, 0.4023])
@pytest.mark.parametrize("reports", [True, False])
def test_with_an_exact_model_the_estimate_is_exact(dead_time_s, reports):
    neck = variant(dead_time_s=dead_time_s).model_copy(update={"reports_joints": reports})
    estimates, truth, offset = follow(neck, 2.0, model=neck)
    assert estimates == pytest.approx(truth, abs=1e-9)
    assert offset == pytest.approx([0, 0], abs=1e-9)


def test_a_load_is_estimated_within_a_few_response_times():
    estimates, truth, offset = follow(variant(load_offset_deg=2.0), 9.0)
    assert np.rad2deg(offset) == pytest.approx([2.0, 2.0], abs=0.05)
    assert np.rad2deg(np.abs(estimates - truth)[-200:, 0]).max() < 0.0047  # 0.0041 as measured


def test_encoder_noise_is_filtered():
    estimates, truth, _ = follow(variant(encoder_noise_deg=0.2), 10.0)
    error_deg = np.rad2deg(estimates - truth)[400:, 0]
    assert error_deg.std() < 0.05  # 0.0435 as measured, of 0.2
    assert np.abs(error_deg.mean()) < 0.01


def test_a_delayed_measurement_is_used_at_its_stamp():
    """With a delay of 40 ms and a load: used at its stamp it is exact; used as new it gives a spurious load."""
    plant = variant(load_offset_deg=1.0)
    estimates, truth, _ = follow(plant, 6.0, age_s=0.04)
    assert np.rad2deg(np.abs(estimates - truth)[-200:, 0]).max() < 0.1
    estimates, truth, _ = follow(plant, 6.0, age_s=0.04, stamped=False)
    assert np.rad2deg(np.abs(estimates - truth)[-200:, 0]).max() > 0.5


def test_a_reading_between_two_ticks_is_used_at_its_stamp():
    estimates, truth, offset = follow(NECK, 4.0, halfway=True)
    np.testing.assert_allclose(estimates[:, 0], truth[:, 0], atol=5e-5)  # of 3 mrad within half a tick
    assert offset == pytest.approx([0, 0], abs=1e-5)


@pytest.mark.parametrize("name", ["reference", "slow"])
@pytest.mark.parametrize(("age_s", "seconds"), [(0.0825, 7.0), (0.24, 12.0)])
def test_delayed_measurements_correct_an_error_once(name, age_s, seconds):
    """Corrected repeatedly by delayed measurements, the estimate would diverge."""
    neck = load_neck(name)
    content = neck.model_dump()
    for axis in ("pan", "tilt"):
        content[axis] |= {"load_offset_deg": 1.0, "encoder_noise_deg": 0.05}
    estimates, truth, _ = follow(type(neck).model_validate(content), seconds, model=neck, age_s=age_s)
    assert np.rad2deg(np.abs(estimates - truth)[-400:, 0]).max() < 0.09  # at most 0.077 as measured


def test_an_initial_offset_is_not_estimated_as_load():
    observer = JointObserver(NECK, np.zeros(2), 0.0)
    for k in range(60):
        observer.update(k * TS, JointState(k * TS, np.full(2, 0.5), np.zeros(2)))
        estimate = observer.estimate
        observer.sent(np.full(2, 0.5))
    assert estimate.position_rad == pytest.approx([0.5, 0.5], abs=1e-9)
    assert estimate.offset_rad == pytest.approx([0, 0], abs=1e-9)


def test_an_outlier_is_refused_and_a_lasting_push_is_accepted():
    observer = JointObserver(NECK, np.zeros(2), 0.0)
    for k in range(100):
        observer.update(k * TS, JointState(k * TS, np.zeros(2), np.zeros(2)))
    observer.update(100 * TS, JointState(100 * TS, np.ones(2), np.zeros(2)))
    glitch = observer.estimate
    assert observer.refused
    assert glitch.position_rad == pytest.approx([0, 0], abs=1e-12)
    for k in range(101, 125):
        observer.update(k * TS, JointState(k * TS, np.ones(2), np.zeros(2)))
        pushed = observer.estimate
    assert pushed.position_rad == pytest.approx([1, 1], abs=0.15)


def test_the_load_estimate_of_a_blocked_joint_is_bounded():
    observer = JointObserver(NECK, np.zeros(2), 0.0)
    for k in range(4000):
        observer.update(k * TS, JointState(k * TS, np.zeros(2), np.zeros(2)))
        estimate = observer.estimate
        observer.sent(np.full(2, min(0.001 * k, 1.0)))
    assert np.rad2deg(np.abs(estimate.offset_rad)).max() <= 10.0 + 1e-9


@pytest.mark.parametrize(
    "bad",
    [
        JointState(0.5, np.array([np.nan, 0.0]), np.zeros(2)),
        JointState(0.5, np.array([1e300, 0.0]), np.zeros(2)),
        JointState(0.496, np.ones(2), np.zeros(2)),  # beyond its physical range
        JointState(0.7, np.ones(2), np.zeros(2)),  # from the future
    ],
)
def test_an_implausible_measurement_is_refused_and_changes_nothing(bad):
    observer, untouched = (JointObserver(NECK, np.zeros(2), 0.0) for _ in range(2))
    for k in range(100):
        observer.update(k * TS, JointState(k * TS, np.zeros(2), np.zeros(2)))
        untouched.update(k * TS, JointState(k * TS, np.zeros(2), np.zeros(2)))
    observer.update(0.5, bad)
    untouched.update(0.5, None)
    got, reference = observer.estimate, untouched.estimate
    assert observer.refused
    assert not untouched.refused
    assert np.array_equal(got.position_rad, reference.position_rad)
    assert np.array_equal(got.offset_rad, reference.offset_rad)


def test_a_repeated_measurement_counts_once():
    observer = JointObserver(NECK, np.zeros(2), 0.0)
    observer.update(0.0, JointState(0.0, np.zeros(2), np.zeros(2)))
    measured = JointState(TS, np.full(2, 0.1), np.zeros(2))
    observer.update(TS, measured)
    once = observer.estimate
    assert np.all(once.position_rad > 0)
    for k in range(2, 40):
        observer.update(k * TS, measured)
        again = observer.estimate
    assert np.array_equal(again.offset_rad, once.offset_rad)


@settings(max_examples=50)
@given(
    st.floats(0.5, 60.0),
    st.floats(0.2, 3.0),
    st.floats(0.0, 1.0),
    st.sampled_from([0.001, 0.005, 0.02]),
)
def test_the_observer_is_stable(natural_frequency_rad_s, damping_ratio, dead_time_s, period_s):
    """Eigenvalues of the error dynamics are inside the unit circle, for slow and fast joints."""
    axis = Axis.model_validate(
        NECK.pan.model_dump()
        | {
            "natural_frequency_rad_s": natural_frequency_rad_s,
            "damping_ratio": damping_ratio,
            "dead_time_s": dead_time_s,
        }
    )
    step = zero_order_hold(axis, period_s)
    model = np.vstack([step, [0.0, 0.0, 1.0]])
    gain = observer_gain(axis, period_s)
    # The measurement corrects after the prediction.
    error = (np.eye(3) - np.outer(gain, [1.0, 0.0, 0.0])) @ model
    assert np.abs(np.linalg.eigvals(error)).max() < 1.0


@pytest.mark.parametrize("name", neck_names())
def test_the_gain_equals_that_of_python_control(name: str) -> None:
    """The stationary Kalman gain as python-control computes it from the same noises."""
    neck = load_neck(name)
    for axis in neck.axes:
        period_s = neck.servo_period_s
        model = np.vstack([zero_order_hold(axis, period_s), [0.0, 0.0, 1.0]])
        deviations = [period_s / 0.05, period_s / 0.05**2, period_s / (0.7 * (axis.dead_time_s + axis.servo_lag_s))]
        C = np.array([[1.0, 0.0, 0.0]])
        expected, *_ = control.dlqe(model, np.eye(3), C, np.diag(np.square(deviations)), np.eye(1))
        assert observer_gain(axis, period_s) == pytest.approx(expected.ravel(), rel=1e-9)
