"""The loop under failures of solver, controller, predictor or robot: events, limits, recovery of the gaze."""

import dataclasses

import numpy as np
import pytest
import ruckig
from builders.control import assert_within
from builders.loop import NECK, TS, LoopBench, ambling_head_m, error_deg, events, make_loop
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.controller import ControllerError, Plan
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.controllers.mpc.problem import Tuning
from gazempc.errors import RobotError
from gazempc.results.metrics import measure
from gazempc.sim.simulated import SimulatedNeck
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
        failed = ControllerError("made to fail", "solver_failed")
        errors = {"error": ControllerError("made to fail"), "failed": failed, "bug": ZeroDivisionError()}
        if self.how in errors:
            raise errors[self.how]
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
    """0.2 s without a plan: the last plan is continued with little error."""
    log = LoopBench(controller=FailingController(how, 2.0, 2.2)).run(3.3)
    assert events(log) == {"no_observation_yet", event}
    assert error_deg(log, from_s=2.5).max() < 1.4  # 1.21 as measured


def test_a_long_solver_failure_stops_the_neck_until_recovery():
    log = LoopBench(controller=FailingController("error", 2.0, 4.0)).run(7.0)
    assert {"controller_failed", "stale_plan"} <= events(log)
    standing = log.command_position_rad[int(3.0 / TS) : int(3.9 / TS)]
    assert np.ptp(standing, axis=0) == pytest.approx([0, 0], abs=1e-9)
    assert error_deg(log, from_s=5.5).mean() < 1.25  # 1.07 as measured


def test_a_failed_trajectory_stops_the_neck_and_is_an_event(monkeypatch):
    """Ruckig fails for half a second: the neck stops within its stopping time, and tracks again."""
    clock_s = [0.0]

    class NoWay(ruckig.Ruckig):
        def calculate(self, request, trajectory):
            if 2.0 <= clock_s[0] < 2.5 and request.control_interface == ruckig.ControlInterface.Position:
                raise ruckig.RuckigError("made to fail")
            return super().calculate(request, trajectory)

    monkeypatch.setattr(ruckig, "Ruckig", NoWay)
    bench = LoopBench(on_send=lambda now_s: clock_s.__setitem__(0, now_s))
    log = bench.run(4.0)
    assert events(log) == {"no_observation_yet", "limit_guard"}
    guarded_s = log.event_time_s[log.event_name == "limit_guard"]
    assert np.all((guarded_s > 2.0) & (guarded_s < 2.5 + 2 * TS))
    moved_rad = np.ptp(log.command_position_rad[[int(2.4 / TS), int(2.45 / TS)]], axis=0)
    assert moved_rad == pytest.approx([0.0, 0.0], abs=1e-9)
    assert np.ptp(log.command_position_rad[int(1.8 / TS) : int(2.0 / TS), 0]) > 0.01
    assert error_deg(log, from_s=3.2).mean() < 1.37


def test_after_a_solver_failure_the_smoother_keeps_the_limits():
    """A lateral jump, accepted after 0.75 s, activates limits while the solver may not iterate."""

    class Sabotaged(Mpc):
        def __init__(self, neck):
            super().__init__(neck, horizon_s=0.3)
            self.ocps = [AxisOcp(ocp.model, Tuning(0.12), iterations=1) for ocp in self.ocps]
            self.acquisition_ocps = [AxisOcp(ocp.model, Tuning(0.09, 0.85), True, iterations=1) for ocp in self.ocps]

    def jumping_head_m(t):
        return ambling_head_m(t) + np.array([0.0, 1.5 if t > 1.4 else 0.0, 0.0])

    log = LoopBench(controller=Sabotaged(NECK), head_m=jumping_head_m).run(6.0)
    assert "solver_gave_up" in events(log)
    assert measure(log).limit_violations == 0
    assert error_deg(log, from_s=4.5).mean() < 0.88  # 0.76 as measured


@pytest.mark.parametrize("how", ["raises", "NaN"])
def test_forecasts_of_a_failing_predictor_are_not_used_and_the_gaze_recovers(how):
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


def unplugged(start_s, stop_s):
    """A robot that raises at every call for a while."""

    def gone(now_s, state=None):
        if start_s <= now_s < stop_s:
            raise RobotError("no answer")
        return state

    return gone


def test_after_robot_silence_commands_have_no_jump_and_the_gaze_recovers():
    """Standing or moving meanwhile: the command brakes, and returns to the last acknowledged one."""
    gone = unplugged(2.0, 2.6)
    bench = LoopBench(on_read=gone, on_send=gone)
    log = bench.run(6.0, answering=False)
    assert "robot_not_answering" in events(log)
    assert np.isnan(log.joint_position_rad).any()
    assert error_deg(log, from_s=4.5).mean() < 1.4  # 1.21 as measured
    held = [sent for t, sent in bench.robot.received if t < 2.0][-1]
    after = [sent for t, sent in bench.robot.received if t >= 2.0]
    assert_within(NECK, np.vstack([held, after]), TS)
    assert_within(NECK, log.command_position_rad, TS)
    moved_rad = np.abs(log.command_position_rad - held)[(log.time_s >= 2.0) & (log.time_s < 2.6)]
    assert moved_rad.max() > 1e-3
    assert moved_rad[-1] == pytest.approx([0, 0], abs=1e-5)


class Losing:
    """A robot that does not acknowledge some commands: no answer, or an error before or after the motion."""

    def __init__(self, clock, lost, how):
        self.inner, self.lost, self.how, self.handed = SimulatedNeck(NECK, np.zeros(2), clock.now_s), lost, how, []
        self.inner.connect()
        self.read_state = self.inner.read_state

    def send_command(self, position_rad):
        tick = len(self.handed)
        self.handed.append(position_rad.copy())
        if tick >= len(self.lost) or not self.lost[tick]:
            return self.inner.send_command(position_rad)
        if self.how != "raises before":
            self.inner.send_command(position_rad)
        if self.how != "returns nothing":
            raise OSError("no acknowledgement")
        return None


def fast_walk_m(time_s):
    return np.array([2.0, 1.5 * np.sin(2.0 * time_s), 0.4])


@pytest.mark.slow
@settings(max_examples=8)
@given(
    runs=st.lists(st.tuples(st.integers(1, 60), st.integers(1, 40)), min_size=1, max_size=12),
    how=st.sampled_from(["returns nothing", "raises before", "raises after"]),
)
def test_possibly_executed_commands_form_one_motion_within_limits(runs, how):
    """Any pattern of lost acknowledgements: `runs` are alternating counts of acknowledged and lost ticks."""
    bench = LoopBench(head_m=fast_walk_m)
    lost = [False] * 100 + [gone for well, ill in runs for gone in [False] * well + [True] * ill]
    robot = Losing(bench.clock, lost, how)
    bench.loop = make_loop(robot, bench.recorder)
    log = bench.run(min(3.0, TS * (len(lost) + 40)), answering=False)
    assert_within(NECK, np.array(robot.handed), TS)
    assert np.array_equal(log.command_position_rad, robot.handed)
    assert np.abs(log.command_velocity_rad_s).max() > 0.3


def test_system_errors_and_invalid_readings_count_as_robot_silence():
    def flaky(now_s):
        if 1.0 <= now_s < 1.1:
            raise TimeoutError("serial line")
        return (np.array([np.nan, 0.0]),) if 1.2 <= now_s < 1.3 else None

    log = LoopBench(on_send=flaky).run(4.0, answering=False)
    assert list(log.event_name).count("robot_not_answering") == 2
    assert np.all(np.isfinite(log.command_position_rad))


def not_a_number(now_s, state):
    return dataclasses.replace(state, position_rad=state.position_rad * (np.nan if now_s > 1.5 else 1.0))


@pytest.mark.parametrize(
    ("on_read", "event"), [(unplugged(1.5, 2.3), "robot_not_answering"), (not_a_number, "joint_reading_refused")]
)
def test_joints_without_readings_are_predicted_from_commands(on_read, event):
    log, undisturbed = (
        LoopBench(controller=Mpc(NECK, horizon_s=0.3), **faults).run(2.6) for faults in ({"on_read": on_read}, {})
    )
    assert event in events(log)
    assert "stale_plan" not in events(log)
    assert log.command_position_rad == pytest.approx(undisturbed.command_position_rad, abs=1e-9)
