"""The simulation of rivals against laws whose motion is known in closed form."""

import math

import numpy as np
import pytest

from experiments.rivals.rival import View
from experiments.rivals.simulate import on_the_head, simulate
from experiments.rivals.trials import make_trial
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.results.metrics import measure
from gazempc.sim.scene import Scene
from gazempc.sim.sensor import load_sensor

REFERENCE = load_neck("reference")
PERFECT = on_the_head(load_sensor("perfect"))
SENSOR = PERFECT.model_copy(update={"rate_hz": 30.0, "latency_s": 0.1})


class Told:
    """A rival that answers what it was told, and keeps what it saw."""

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
    return simulate(Scene(one.walk, neck, SENSOR, start_rad=one.start_rad, **scene), lambda *_: rival)


def test_a_rival_sees_faces_late_in_the_head_as_it_stood() -> None:
    rival = Told("velocity", (0.05, 0.0))
    run(rival)
    # The head turns while the face stands at 20 deg: absolute angle = head at the capture + angle in the image.
    half = math.radians(PERFECT.view.horizontal_deg / 2.0)
    seen = [(view, detection) for view in rival.views for detection in view.detections]
    assert len(seen) == pytest.approx(30.0 * 15.0, abs=5)
    assert seen[0][1].capture_time_s == pytest.approx(1.0)
    for (view, detection), then_rad in zip(seen, rival.then_rad, strict=True):
        assert detection.arrival_time_s == pytest.approx(detection.capture_time_s + SENSOR.latency_s)
        assert detection.arrival_time_s <= view.time_s + 1e-9 < detection.arrival_time_s + rival.period_s
        left_rad = -math.atan(detection.offset[0] * math.tan(half))
        assert then_rad + left_rad == pytest.approx(math.radians(20.0), abs=2e-3)


def test_a_law_that_commands_the_true_direction_is_in_contact() -> None:
    log = run(Told("position", (math.radians(20.0), math.radians(8.0))))
    assert measure(log).gaze_error_rms_deg < 0.01


def test_steps_come_at_the_rivals_own_rate_and_another_neck_moves_than_the_one_that_is_known() -> None:
    """The device is idle after the move only, which begins one dead time of the true neck late."""
    rival, late = Told("position", (0.5, 0.0), 1.0 / 30.0), {"dead_time_s": 1.0}
    log = run(rival, robot_neck=REFERENCE.model_copy(update={"pan": REFERENCE.pan.model_copy(update=late)}))
    times_s = np.array([view.time_s for view in rival.views])
    np.testing.assert_allclose(times_s, np.arange(times_s.size) / 30.0, atol=0.006)
    idle = np.array([view.idle for view in rival.views])
    assert not idle[(times_s > 0.01) & (times_s < 1.3)].any()
    assert idle[times_s > 3.0].all()
    assert log.time_s[np.flatnonzero(log.joint_position_rad[:, 0] > 1e-9)[0]] == pytest.approx(1.0, abs=0.011)


def test_an_answer_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="told"):
        run(Told("position", (math.nan, 0.0)))
