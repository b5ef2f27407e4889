"""Margins of the linear loop: against the simulated loop, python-control and independent measurements."""

import math

import control
import numpy as np
import pytest

from experiments import swing
from experiments.console import main as gazempc
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.files.documents import as_toml
from gazempc.margins.linear_loop import EXACT, LinearLoop, Mismatch
from gazempc.margins.margins import LEAST_DISTANCE, margins, too_small
from gazempc.neck.spec import load_neck, neck_names

START_RAD = math.radians(0.05)
ERRORS = [EXACT, Mismatch(gain=2.5), Mismatch(dead_time_s=0.0137), Mismatch(-1.0), Mismatch(1.2, -0.011, 0.6)]


def weak(neck="reference"):
    """A soft, weakly damped servo."""
    pan = load_neck(neck).pan.model_copy(update={"natural_frequency_rad_s": 2.0, "damping_ratio": 0.3})
    return load_neck(neck).model_copy(update={"name": "weak", "pan": pan})


def predicted(neck, error, ticks):
    """The pan at each control period by the linear loop, from an initial offset, target 0."""
    loop = LinearLoop(Mpc(neck), 0, error)
    x = np.zeros(loop.size)
    x[[0, 2, 5]] = START_RAD
    x[9:] = START_RAD
    found = []
    # A gain scales the joint's input from the start on: the joint is not at its command.
    for _ in range(ticks):
        found.append(x[0])
        x = loop.transition() @ x
    return np.array(found)


@pytest.mark.parametrize(
    # The linear loop has the mean of a held speed over the period.
    ("name", "tolerance_rad"),
    [("reachy_mini", 1e-12), ("ptz", 2e-3 * START_RAD)],
)
@pytest.mark.parametrize("error", [e for e in ERRORS if e.gain == 1.0])
def test_the_linear_loop_equals_the_simulated_loop(name, tolerance_rad, error):
    """Unmodified controller, observer, smoother and simulated neck, from 0.05 deg, without active limits."""
    neck = load_neck(name)
    periods = 50
    pan_rad = swing.simulate(neck, error, periods * neck.control_period_s)
    linear = predicted(neck, error, periods)
    assert pan_rad[:: neck.servo_ticks_per_plan] == pytest.approx(linear, abs=tolerance_rad)
    assert np.ptp(linear) > 0.5 * START_RAD


@pytest.mark.parametrize(
    ("name", "gain", "at_hz", "delay_s", "peak"),
    [("reference", 6.2, 0.52, 2.8, 1.23), ("reachy_mini", 4.2, 1.85, 0.36, 1.45)],
)
def test_margins_equal_an_independent_measurement(name, gain, at_hz, delay_s, peak):
    """Measured on the running loop by frequency response."""
    pan, tilt = margins(Mpc(load_neck(name), smoothing_time_s=0.12))
    assert (pan.joint, tilt.joint) == ("pan", "tilt")
    assert pan.gain == pytest.approx(gain, abs=0.05)
    assert pan.gain_hz == pytest.approx(at_hz, abs=0.01)
    assert pan.delay_s == pytest.approx(delay_s, rel=0.03)
    assert pan.peak_sensitivity == pytest.approx(peak, abs=0.01)


@pytest.mark.parametrize("name", ["reachy_mini", "pr2"])
def test_the_loop_is_unstable_beyond_its_margins(name):
    """By the eigenvalues of the periodic loop, independent of the frequency response."""
    mpc = Mpc(load_neck(name))
    pan = margins(mpc)[0]

    def radius(**error):
        return np.abs(np.linalg.eigvals(LinearLoop(mpc, 0, Mismatch(**error)).transition())).max()

    assert radius(gain=0.99 * pan.gain) < 1.0 < radius(gain=1.01 * pan.gain)
    assert radius(dead_time_s=pan.delay_s - 0.01) < 1.0 < radius(dead_time_s=pan.delay_s + 0.01)
    assert np.abs(pan.poles).max() == pytest.approx(radius(), abs=1e-9)
    slowest, fastest = pan.frequency_factors
    assert slowest < 1.0 < fastest
    if slowest:
        assert radius(frequency=1.02 * slowest) < 1.0 < radius(frequency=0.98 * slowest)


def test_the_disk_margin_equals_that_of_python_control():
    """With one servo period per plan the loop is time-invariant, as python-control requires."""
    neck = load_neck("reachy_mini").model_copy(update={"servo_rate_hz": 50.0, "control_rate_hz": 50.0})
    mpc = Mpc(neck)
    pan = margins(mpc)[0]
    A, B, C, D = LinearLoop(mpc, 0).opened()
    system = -control.ss(A, B, C, D, neck.control_period_s)
    _, gain_db, phase_deg = control.disk_margins(system, pan.omega_rad_s)
    assert 20.0 * math.log10(pan.disk[0]) == pytest.approx(gain_db, rel=1e-6)
    assert pan.disk[1] == pytest.approx(phase_deg, rel=1e-6)


@pytest.mark.slow
def test_a_simulated_neck_oscillates_beyond_the_margin():
    """It oscillates at 1.07 times the margin, and settles at 0.93 times."""
    neck = load_neck("reachy_mini")
    pan = margins(Mpc(neck))[0]
    crossing_s = 2.0 * math.pi / (math.radians(pan.phase_deg) / pan.delay_s)
    for error, period_s in (
        (lambda share: Mismatch(gain=share * pan.gain), 1.0 / pan.gain_hz),
        (lambda share: Mismatch(dead_time_s=share * pan.delay_s), crossing_s),
    ):
        assert not swing.swings(neck, error(0.93), period_s)
        assert swing.swings(neck, error(1.07), period_s)


@pytest.mark.parametrize("name", neck_names())
def test_shipped_necks_have_sufficient_margins(name):
    mpc = Mpc(load_neck(name))
    assert too_small(mpc) == []
    loop = LinearLoop(mpc, 0)
    distance = np.abs(1.0 + loop.response(np.geomspace(0.05, 0.99 * math.pi / mpc.neck.servo_period_s, 200))).min()
    assert distance > LEAST_DISTANCE


def test_a_soft_servo_gives_a_warning():
    (warning,) = too_small(Mpc(weak()))
    assert warning.startswith("neck 'weak': pan: peak sensitivity")


def test_a_small_delay_margin_gives_a_warning():
    """A controller faster than the servo: a delay of less than two plans destabilises it."""
    neck = load_neck("reachy_mini")
    quick = neck.model_copy(update={"pan": neck.pan.model_copy(update={"dead_time_s": 0.0, "damping_ratio": 0.2})})
    assert any(too_small(Mpc(quick, smoothing_time_s=T)) for T in (0.12, 0.01))


def test_the_command_prints_margins_and_draws(tmp_path, capsys):
    assert gazempc(["margins", "--neck", "reachy_mini", "--figure", str(tmp_path / "m.png")]) == 0
    printed = capsys.readouterr().out
    assert " 3.67 " in printed
    assert "wrong by -30 to +323 ms" in printed
    assert (tmp_path / "m.png").stat().st_size > 10_000
    assert gazempc(["margins", "--neck", "nix"]) == 2


@pytest.mark.slow
def test_replay_and_live_warn_of_small_margins(tmp_path, capsys):
    neck = tmp_path / "weak.toml"
    neck.write_text(as_toml(weak().model_dump(exclude_none=True)), encoding="utf-8")
    common = ["--replay", "subject03_R4", "--predictor", "constant_velocity", "--no-figures", "--neck", str(neck)]
    common += ["--log", "npz", "--out", str(tmp_path / "out")]
    run = ["run", "--noise-seeds", "1", "--controllers"]
    live = ["live", "--source", "replay", "--robot", "simulated", "--duration-s", "1", "--simulated-clock"]
    for words, warned in (([*run, "mpc"], True), (live, True), ([*live, "--controller", "lookahead"], False)):
        assert gazempc([*words, *common]) == 0
        assert ("neck 'weak': pan: peak sensitivity" in capsys.readouterr().out) == warned


def test_a_velocity_commanded_pan_has_margins_of_its_own():
    neck = load_neck("reference")
    mixed = neck.model_copy(update={"pan": neck.pan.model_copy(update={"command": "velocity"})})
    tilt = margins(Mpc(mixed))[1]
    plain = margins(Mpc(neck))[1]
    assert (tilt.peak_sensitivity, tilt.disk) == (plain.peak_sensitivity, plain.disk)
