"""The simulation of rivals, and step responses of a head, compared with closed forms."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.rivals.rival import View
from experiments.rivals.simulate import on_the_head, simulate
from experiments.rivals.trials import make_trial, overshoot_deg, response, reversals, settling_s
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.recordings.recording import Track
from gazempc.results.contact import time_to_return
from gazempc.results.metrics import gaze_error_deg, measure
from gazempc.sim.scene import Scene
from gazempc.sim.sensor import load_sensor

REFERENCE = load_neck("reference")
PERFECT = on_the_head(load_sensor("perfect"))
SENSOR = PERFECT.model_copy(update={"rate_hz": 30.0, "latency_s": 0.1})


class FixedRival:
    """A rival with a constant command that records its views."""

    name = "told"

    def __init__(self, command: str, answer: tuple[float, float], period_s: float = 0.02) -> None:
        self.command, self.answer, self.period_s = command, np.array(answer), period_s
        self.views: list[View] = []
        self.then_rad: list[float] = []

    def start(self, view: View) -> None:
        assert not view.detections

    def step(self, view: View) -> np.ndarray:
        self.views.append(view)
        self.then_rad += [view.joints_at(face.capture_time_s)[0] for face in view.detections]
        return self.answer


def run(rival, neck: NeckSpec = REFERENCE, trial: str = "still_seated_left", **scene):
    one = make_trial(trial, None)
    part = Track(**{name: values[:600] for name, values in vars(one.walk.truth).items()})
    walk = dataclasses.replace(one.walk, times_s=one.walk.times_s[:600], truth=part)
    return simulate(Scene(walk, neck, SENSOR, start_rad=one.start_rad, **scene), lambda *_: rival)


def test_a_rival_gets_faces_delayed_with_the_head_pose_at_capture() -> None:
    rival = FixedRival("velocity", (0.05, 0.0))
    run(rival)
    # The head rotates while the face is at 20 deg: absolute angle = head at the capture + angle in the image.
    half = math.radians(PERFECT.view.horizontal_deg / 2.0)
    seen = [(view, detection) for view in rival.views for detection in view.detections]
    assert len(seen) == pytest.approx(30.0 * 5.0, abs=5)
    assert seen[0][1].capture_time_s == pytest.approx(1.0)
    for (view, detection), then_rad in zip(seen, rival.then_rad, strict=True):
        assert detection.arrival_time_s == pytest.approx(detection.capture_time_s + SENSOR.latency_s)
        assert detection.arrival_time_s <= view.time_s + 1e-9 < detection.arrival_time_s + rival.period_s
        left_rad = -math.atan(detection.offset[0] * math.tan(half))
        assert then_rad + left_rad == pytest.approx(math.radians(20.0), abs=2e-3)


def test_a_law_that_commands_the_true_direction_is_in_contact() -> None:
    log = run(FixedRival("position", (math.radians(20.0), math.radians(8.0))))
    assert measure(log).gaze_error_rms_deg < 0.01


def test_steps_have_the_rivals_rate_and_the_plant_may_differ_from_its_model() -> None:
    """The device is idle only after the move, which starts after the dead time of the true neck."""
    rival, late = FixedRival("position", (0.5, 0.0), 1.0 / 30.0), {"dead_time_s": 1.0}
    log = run(rival, robot_neck=REFERENCE.model_copy(update={"pan": REFERENCE.pan.model_copy(update=late)}))
    times_s = np.array([view.time_s for view in rival.views])
    np.testing.assert_allclose(times_s, np.arange(times_s.size) / 30.0, atol=0.006)
    idle = np.array([view.idle for view in rival.views])
    assert not idle[(times_s > 0.01) & (times_s < 1.3)].any()
    assert idle[times_s > 3.0].all()
    assert log.time_s[np.flatnonzero(log.joint_position_rad[:, 0] > 1e-9)[0]] == pytest.approx(1.0, abs=0.011)


def test_a_nan_command_is_refused() -> None:
    with pytest.raises(ValueError, match="told"):
        run(FixedRival("position", (math.nan, 0.0)))


TIMES_S = np.arange(0.0, 15.0, 0.005)


def oscillation(zeta: float, wn: float = 4.0):
    wd = wn * np.sqrt(1.0 - zeta**2)
    ringing = np.cos(wd * TIMES_S) + zeta / np.sqrt(1.0 - zeta**2) * np.sin(wd * TIMES_S)
    return 20.0 * (1.0 - np.exp(-zeta * wn * TIMES_S) * ringing)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_second_order_step_has_the_closed_form_overshoot(sign: float) -> None:
    angle = sign * oscillation(0.3)
    expected = 20.0 * np.exp(-0.3 * np.pi / np.sqrt(1.0 - 0.3**2))
    assert overshoot_deg(angle, sign * 20.0) == pytest.approx(expected, abs=1e-3)
    # Peaks of 20 exp(-k pi zeta / sqrt(1 - zeta^2)); swings between them of 0.5 deg or more turn the joint back.
    peaks = 20.0 * np.exp(-0.3 / np.sqrt(1.0 - 0.09) * np.pi * np.arange(1, 20))
    swings = peaks[:-1] + peaks[1:]
    assert reversals(angle) == np.sum(swings >= 0.5)


def test_a_monotonic_motion_has_no_overshoot_and_no_reversal() -> None:
    angle = 20.0 * (1.0 - np.exp(-TIMES_S / 0.5))
    assert overshoot_deg(angle, 20.0) == pytest.approx(0.0, abs=1e-6)
    assert reversals(angle) == 0
    assert overshoot_deg(np.full(10, 3.0), 3.0) == 0.0


def test_settling_time_is_the_last_entry_into_the_band() -> None:
    # exp(-t / 0.5) 20 deg is 1 deg at 0.5 ln 20.
    assert settling_s(TIMES_S, -20.0 * np.exp(-TIMES_S / 0.5), 1.0) == pytest.approx(0.5 * np.log(20.0), abs=0.005)
    late = np.where((TIMES_S > 7.0) & (TIMES_S < 8.0), 3.0, 0.0)
    assert settling_s(TIMES_S, late, 2.6) == pytest.approx(8.0, abs=0.005)
    assert settling_s(TIMES_S, np.full(TIMES_S.size, 5.0), 2.6) == TIMES_S[-1]
    assert settling_s(TIMES_S, np.zeros(TIMES_S.size), 1.0) == 0.0


def log_of(pan_deg, truth_deg):
    angles = np.deg2rad(np.stack([pan_deg, np.zeros(pan_deg.size)], axis=1))
    truth_rad = np.deg2rad(truth_deg)
    head_m = 2.0 * np.stack([np.cos(truth_rad), np.sin(truth_rad), np.zeros(truth_rad.size)], axis=1)
    return SimpleNamespace(
        time_s=TIMES_S, joint_position_rad=angles, head_true_base_m=head_m, neck=load_neck("reference")
    )


def test_a_steady_state_offset_is_reported() -> None:
    pan_deg = np.full(TIMES_S.size, 12.0)
    assert response(log_of(pan_deg, pan_deg + 8.0), 0.0, 0)["rest_error_deg"] == pytest.approx(8.0)


def test_recovery_time_counts_from_the_return_to_lasting_contact() -> None:
    truth = np.zeros(TIMES_S.size)
    off = np.where((TIMES_S < 4.0) | ((TIMES_S > 4.3) & (TIMES_S < 6.0)), 10.0, 1.0)
    for pan_deg, expected_s in ((off, 3.0), (truth + 10.0, TIMES_S[-1] - 3.0)):
        log = log_of(pan_deg, truth)
        assert time_to_return(log, gaze_error_deg(log) <= 2.6, 3.0) == pytest.approx(expected_s, abs=0.006)
