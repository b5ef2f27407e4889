"""The loop when solver, controller or predictor fail: named, bridged, and the gaze back after it."""

import dataclasses

import numpy as np
import pytest
from builders.loop import NECK, TS, LoopBench, ambling_head_m, error_deg, events

from gazempc.controllers.controller import ControllerError, Plan, SolverFailed
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.results.metrics import measure
from predictors import ConstantVelocity


class FailingController:
    """A controller that fails for a while."""

    def __init__(self, how, start_s, stop_s):
        self.inner, self.how, self.start_s, self.stop_s = LookAhead(NECK), how, start_s, stop_s
        self.forecast_times_s = self.inner.forecast_times_s

    def reset(self):
        pass

    def plan(self, situation):
        if not self.start_s <= situation.start_s < self.stop_s:
            return self.inner.plan(situation)
        errors = {
            "error": ControllerError,
            "failed": SolverFailed,
            "bug": ZeroDivisionError,
        }
        if self.how in errors:
            raise errors[self.how]("made to fail")
        return Plan(situation.start_s, 0.02, np.full((3, 2), np.nan), np.zeros((3, 2)), np.zeros((3, 2)))


@pytest.mark.parametrize(
    ("how", "event"),
    [
        ("error", "controller_failed"),
        ("bug", "controller_failed"),
        ("failed", "solver_failed"),
        ("nan", "plan_not_finite"),
    ],
)
def test_a_short_solver_failure_is_bridged_by_the_last_plan(how, event):
    """0.2 s without a plan: the rest of the last one is followed, and the gaze hardly notices."""
    log = LoopBench(controller=FailingController(how, 2.0, 2.2)).run(4.0)
    assert events(log) == {"no_observation_yet", event}
    assert error_deg(log, from_s=2.5).max() < 1.4  # 1.21 as measured


def test_a_long_solver_failure_stops_the_neck_and_the_gaze_recovers():
    log = LoopBench(controller=FailingController("error", 2.0, 4.0)).run(7.0)
    assert {"controller_failed", "stale_plan"} <= events(log)
    standing = log.command_position_rad[int(3.0 / TS) : int(3.9 / TS)]
    assert np.ptp(standing, axis=0) == pytest.approx([0, 0], abs=1e-9)
    assert error_deg(log, from_s=5.5).mean() < 1.25  # 1.07 as measured


def test_where_the_solver_gives_up_the_smoother_keeps_the_limits():
    """The person jumps aside, which is believed after 0.75 s. Then limits bind, and the solver may not iterate."""

    class Sabotaged(Mpc):
        def __init__(self, neck):
            super().__init__(neck, horizon_s=0.3)
            self.ocps = [AxisOcp(ocp.model, 0.12, iterations=1) for ocp in self.ocps]
            self.acquisition_ocps = [AxisOcp(ocp.model, 0.09, 0.85, True, iterations=1) for ocp in self.ocps]

    def jumping_head_m(t):
        return ambling_head_m(t) + np.array([0.0, 1.5 if t > 1.4 else 0.0, 0.0])

    log = LoopBench(controller=Sabotaged(NECK), head_m=jumping_head_m).run(6.0)
    assert "solver_gave_up" in events(log)
    assert measure(log).limit_violations == 0
    assert error_deg(log, from_s=4.5).mean() < 0.88  # 0.76 as measured


@pytest.mark.parametrize("how", ["raises", "NaN"])
def test_a_predictor_that_fails_is_not_followed_and_the_gaze_recovers(how):
    class Failing(ConstantVelocity):
        def forecast(self, times_s):
            forecast = super().forecast(times_s)
            if not 2.0 < np.max(times_s) < 2.8:
                return forecast
            if how == "raises":
                raise np.linalg.LinAlgError("singular")
            return dataclasses.replace(forecast, means_base_m=np.nan * forecast.means_base_m)

    log = LoopBench(predictor=Failing()).run(5.0)
    assert "forecast_failed" in events(log)
    assert np.all(np.isfinite(log.command_position_rad))
    assert error_deg(log, from_s=4.0).mean() < 1.4  # 1.20 as measured
