"""The loop: order of stages, determinism, and a safe command whatever happens."""

import dataclasses
import sys

import numpy as np
import pytest

from gazempc.controllers.controller import ControllerError, Plan, SolverFailed, SolverTimedOut
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.controllers.mpc.qp import Daqp, Piqp, QpResult
from gazempc.errors import LeftOutError, RobotError
from gazempc.loop.gaze_loop import GazeLoop
from gazempc.loop.recorder import LoopRecorder
from gazempc.settings import LoopSettings
from gazempc.loop.smoother import Smoother
from gazempc.neck.spec import load_neck
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.results.metrics import limit_violations, measure
from gazempc.settings import RunSettings
from gazempc.sim.replay import replay
from gazempc.sim.sensor import load_sensor
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import Sighting
from predictors import ConstantVelocity, HeadObservation

NECK = load_neck("reference")
TS = NECK.servo_period_s
HEIGHT_M = 0.4


def head(time_s):
    """A person who ambles to and fro, 2.5 m away."""
    return np.array([2.5, 1.5 * np.sin(0.4 * time_s), HEIGHT_M])


class Scene:
    """A loop on a simulated clock whose parts a test can break."""

    def __init__(self, controller=None, predictor=None, robot=None, settings=None):
        self.now_s = 0.0
        self.recorder = LoopRecorder(NECK.control_period_s)
        self.smoother = Smoother(NECK, np.zeros(2))
        self.robot = robot or SimulatedNeck(NECK, np.zeros(2), lambda: self.now_s)
        self.robot.connect()
        self.loop = GazeLoop(
            NECK,
            predictor or ConstantVelocity(),
            controller or LookAhead(NECK),
            self.smoother,
            self.robot,
            self.recorder,
            settings or LoopSettings(),
        )

    def run(self, seconds, seen=lambda t: True, lead_s=0.066, extra=(), answering=True):
        """Run; frames at 30 fps whose capture time `seen` accepts arrive `lead_s` late.

        A robot that is not `answering` holds its command at once, which no limit can prevent.
        """
        frames = [k / 30 for k in range(int(seconds * 30)) if seen(k / 30)]
        sightings = [Sighting(t + lead_s, HeadObservation(t, head(t))) for t in frames]
        sightings = sorted([*sightings, *extra], key=lambda s: s.arrival_s)
        for index in range(int(seconds / TS)):
            self.now_s = index * TS
            due = [s for s in sightings if s.arrival_s <= self.now_s]
            sightings = sightings[len(due) :]
            self.loop.tick(index, self.now_s, due)
        log, _ = self.recorder.finish(
            {"neck": NECK.model_dump()},
            lambda t: np.where(t[:, None] <= seconds, np.array([head(x) for x in t]).reshape(-1, 3), np.nan),
        )
        assert len(log.time_s) == int(seconds / TS)
        if answering:
            commands_only = dataclasses.replace(log, joint_position_rad=log.command_position_rad)
            assert limit_violations(commands_only, NECK) == 0
        return log

    @staticmethod
    def error_deg(log):
        return np.rad2deg(np.abs(log.joint_position_rad[:, 0] - np.arctan2(log.head_true_base_m[:, 1], 2.5)))


def events(log):
    return set(log.event_name.tolist())


def test_undisturbed_it_tracks_and_names_nothing_but_the_start():
    log = Scene().run(5.0)
    assert events(log) == {"no_observation_yet"}
    assert Scene.error_deg(log)[300:].mean() < 3.0


def test_before_anybody_is_seen_the_neck_holds_still():
    log = Scene().run(1.0, seen=lambda t: False)
    assert events(log) == {"no_observation_yet"}
    assert np.all(log.command_position_rad == 0)


class Failing:
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
            "timed out": SolverTimedOut,
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
        ("timed out", "solver_timed_out"),
        ("nan", "plan_not_finite"),
    ],
)
def test_a_short_solver_failure_is_bridged_by_the_last_plan(how, event):
    """0.2 s without a plan: the rest of the last one is followed, and the gaze hardly notices."""
    log = Scene(controller=Failing(how, 2.0, 2.2)).run(4.0)
    assert events(log) == {"no_observation_yet", event}
    assert Scene.error_deg(log)[int(2.5 / TS) :].max() < 6.0


def test_a_long_solver_failure_stops_the_neck_and_the_gaze_recovers():
    log = Scene(controller=Failing("error", 2.0, 4.0)).run(7.0)
    assert {"controller_failed", "stale_plan"} <= events(log)
    standing = log.command_position_rad[int(3.0 / TS) : int(3.9 / TS)]
    assert np.ptp(standing, axis=0) == pytest.approx([0, 0], abs=1e-9)
    assert Scene.error_deg(log)[int(5.5 / TS) :].mean() < 3.0


def gives_up(data):
    """A QP solver that never finds anything."""

    class GivesUp:
        name = "gives up"

        def solve(self, g, lower, upper):
            return QpResult(np.full(g.size, np.nan), "failed")

    return GivesUp()


@pytest.mark.parametrize(
    ("solvers", "event"),
    [
        ((gives_up, gives_up), "solver_failed"),
        ((gives_up, lambda data: Piqp(data, iteration_limit=1)), "solver_timed_out"),
        ((lambda data: Daqp(data, iteration_limit=1),), "solver_timed_out"),
        ((gives_up, Piqp), "second_solver"),
    ],
)
def test_real_solvers_that_fail_in_the_loop_are_named_and_the_gaze_recovers(solvers, event):
    """The person jumps aside, so that limits bind and the solver is asked; it is made to fail for half a second."""

    class Sabotaged(Mpc):
        def plan(self, situation):
            whole = self.ocps, self.meeting_ocps, self.catch_up_ocps
            if 2.0 <= situation.start_s < 2.5:
                self.ocps, self.meeting_ocps, self.catch_up_ocps = (
                    [[AxisOcp(o[0].model, 0.08, catching_up=bounded, solvers=solvers)] * len(o) for o in ocps]
                    for ocps, bounded in zip(whole, (False, False, True), strict=True)
                )
            try:
                return super().plan(situation)
            finally:
                self.ocps, self.meeting_ocps, self.catch_up_ocps = whole

    ambling = head

    def jump(t):
        return ambling(t) + np.array([0.0, 1.5 if t > 1.9 else 0.0, 0.0])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules[__name__], "head", jump)
        log = Scene(controller=Sabotaged(NECK, horizon_s=0.3)).run(6.0)
    assert event in events(log)
    error_deg = np.rad2deg(np.abs(log.joint_position_rad[:, 0] - np.arctan2(log.head_true_base_m[:, 1], 2.5)))
    assert error_deg[int(4.5 / TS) :].mean() < 3.0


def test_what_a_plan_has_to_say_is_in_the_log():
    class Speaking(LookAhead):
        def plan(self, situation):
            return dataclasses.replace(super().plan(situation), events=("limits_softened",))

    assert "limits_softened" in events(Scene(controller=Speaking(NECK)).run(1.0))


def test_a_neck_without_encoders_is_driven_open_loop():
    blind = NECK.model_copy(update={"reports_joints": False})
    scene = Scene(controller=Mpc(NECK, horizon_s=0.3))
    scene.loop._robot = SimulatedNeck(blind, np.zeros(2), lambda: scene.now_s)
    scene.loop._robot.connect()
    log = scene.run(4.0)
    assert events(log) == {"no_observation_yet"}
    with_encoders = Scene(controller=Mpc(NECK, horizon_s=0.3)).run(4.0)
    assert log.command_position_rad == pytest.approx(with_encoders.command_position_rad, abs=1e-9)


def test_joints_that_cannot_be_read_for_two_seconds_are_known_from_the_commands():
    class Mute(SimulatedNeck):
        def read_state(self):
            if 1.5 <= self._clock_s() < 3.5:
                raise RobotError("no answer")
            return super().read_state()

    scene = Scene(controller=Mpc(NECK, horizon_s=0.3))
    scene.loop._robot = Mute(NECK, np.zeros(2), lambda: scene.now_s)
    scene.loop._robot.connect()
    log = scene.run(5.0)
    assert "robot_not_answering" in events(log)
    assert "stale_plan" not in events(log)
    undisturbed = Scene(controller=Mpc(NECK, horizon_s=0.3)).run(5.0)
    assert log.command_position_rad == pytest.approx(undisturbed.command_position_rad, abs=1e-9)


def test_a_lost_target_stops_then_returns_to_rest_slowly_then_is_found_again():
    settings = LoopSettings(lost_after_s=1.0, rest_after_s=2.0, rest_speed_rad_s=0.3)
    log = Scene(settings=settings).run(9.0, seen=lambda t: t < 1.5 or t > 7.0)
    assert {"target_lost", "return_to_rest"} <= events(log)
    lost_s = log.event_time_s[list(log.event_name).index("target_lost")]
    assert lost_s == pytest.approx(1.5 + 1.0, abs=0.05)
    stopped = log.command_position_rad[int(3.0 / TS) : int(3.4 / TS), 0]
    assert np.ptp(stopped) == pytest.approx(0, abs=1e-9)
    returning = log.command_position_rad[int(3.6 / TS) : int(7.0 / TS), 0]
    assert np.abs(np.diff(returning)).max() / TS <= 0.3 * (1 + 1e-9)
    assert returning[-1] == pytest.approx(0.0, abs=1e-6)
    assert Scene.error_deg(log)[int(8.3 / TS) :].mean() < 3.0


def test_stale_and_out_of_order_frames_are_dropped_and_named():
    late = Sighting(2.0, HeadObservation(1.0, np.array([2.5, -2.0, 0.4])))
    disordered = Sighting(2.5, HeadObservation(2.2, np.array([2.5, -2.0, 0.4])))
    with_faults = Scene().run(4.0, extra=(late, disordered))
    assert events(with_faults) == {"no_observation_yet", "stale_observation", "out_of_order"}
    assert np.array_equal(with_faults.command_position_rad, Scene().run(4.0).command_position_rad)


def test_a_predictor_that_raises_is_not_followed_and_the_gaze_recovers():
    class Raising(ConstantVelocity):
        def forecast(self, times_s):
            if 2.0 < np.max(times_s) < 2.8:
                raise np.linalg.LinAlgError("singular")
            return super().forecast(times_s)

    log = Scene(predictor=Raising()).run(5.0)
    assert "forecast_failed" in events(log)
    assert Scene.error_deg(log)[int(4.0 / TS) :].mean() < 3.0


def test_a_forecast_with_a_nan_is_not_followed():
    class Broken(ConstantVelocity):
        def forecast(self, times_s):
            forecast = super().forecast(times_s)
            bad = np.asarray(times_s).max() > 3.0
            return dataclasses.replace(forecast, means_base_m=forecast.means_base_m * (np.nan if bad else 1.0))

    log = Scene(predictor=Broken()).run(4.0)
    assert "forecast_failed" in events(log)
    assert np.all(np.isfinite(log.command_position_rad))


class Unplugged(SimulatedNeck):
    """A robot that does not answer for a while."""

    def __init__(self, *args, start_s, stop_s):
        super().__init__(*args)
        self._silent = (start_s, stop_s)

    def _check(self):
        if self._silent[0] <= self._clock_s() < self._silent[1]:
            raise RobotError("no answer")

    def read_state(self):
        self._check()
        return super().read_state()

    def send_command(self, position_rad):
        self._check()
        return super().send_command(position_rad)


def test_a_robot_that_does_not_answer_is_named_and_the_gaze_recovers():
    scene = Scene()
    robot = Unplugged(NECK, np.zeros(2), lambda: scene.now_s, start_s=2.0, stop_s=2.6)
    robot.connect()
    scene.loop._robot = robot
    log = scene.run(6.0, answering=False)
    assert "robot_not_answering" in events(log)
    assert np.isnan(log.joint_position_rad).any()
    assert Scene.error_deg(log)[int(4.5 / TS) :].mean() < 3.0


@pytest.mark.parametrize("silence_s", [0.05, 0.6])
def test_after_silence_the_robot_gets_no_jump(silence_s):
    """What the robot received, seen from the robot: every step within the limits, also over the silence."""
    received = []

    class Listening(Unplugged):
        def send_command(self, position_rad):
            sent = super().send_command(position_rad)
            received.append((self._clock_s(), sent))
            return sent

    scene = Scene()
    robot = Listening(NECK, np.zeros(2), lambda: scene.now_s, start_s=2.0, stop_s=2.0 + silence_s)
    robot.connect()
    scene.loop._robot = robot
    log = scene.run(5.0, answering=False)
    after = [sent for t, sent in received if t >= 2.0]
    held = [sent for t, sent in received if t < 2.0][-1]
    padded = np.vstack([np.tile(held, (3, 1)), after])
    for order, limit in enumerate((NECK.velocity_max_rad_s, NECK.acceleration_max_rad_s2, NECK.jerk_max_rad_s3), 1):
        assert np.all(np.abs(np.diff(padded, order, axis=0)) / TS**order <= limit * (1 + 1e-6))
    silent = (log.time_s >= 2.0) & (log.time_s < 2.0 + silence_s - 1e-9)
    assert np.all(log.command_position_rad[silent] == held)


def test_a_robot_that_raises_system_errors_or_answers_nonsense_is_a_robot_that_does_not_answer():
    class Flaky(SimulatedNeck):
        def send_command(self, position_rad):
            now = self._clock_s()
            if 1.0 <= now < 1.1:
                raise TimeoutError("serial line")
            if 1.2 <= now < 1.3:
                return np.array([np.nan, 0.0])
            return super().send_command(position_rad)

    scene = Scene()
    scene.loop._robot = Flaky(NECK, np.zeros(2), lambda: scene.now_s)
    scene.loop._robot.connect()
    log = scene.run(4.0, answering=False)
    assert list(log.event_name).count("robot_not_answering") == 2
    assert np.all(np.isfinite(log.command_position_rad))


def test_a_frame_from_the_future_is_dropped_and_does_not_blind():
    ahead = Sighting(1.5, HeadObservation(1e6, np.array([2.5, -2.0, 0.4])))
    log = Scene().run(4.0, extra=(ahead,))
    assert "future_observation" in events(log)
    assert np.array_equal(log.command_position_rad, Scene().run(4.0).command_position_rad)


def test_a_position_of_absurd_size_does_not_poison_the_filter():
    absurd = Sighting(1.5, HeadObservation(1.405, np.array([1e308, 1e308, 1e308])))
    log = Scene().run(4.0, extra=(absurd,))
    assert Scene.error_deg(log)[int(2.0 / TS) :].mean() < 3.0


def test_plan_shapes_are_checked():
    with pytest.raises(ValueError, match="shape"):
        Plan(0.0, 0.02, np.zeros((3, 1)), np.zeros((3, 1)), np.zeros((3, 1)))
    with pytest.raises(ValueError, match="differ"):
        Plan(0.0, 0.02, np.zeros((3, 2)), np.zeros((2, 2)), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="finite start"):
        Plan(np.nan, 0.02, np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="shape"):
        Plan(0.0, 0.02, np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((3, 2)), first_parts=4)


@pytest.mark.parametrize("whole_steps", [0, 1, 3])
def test_a_plan_with_its_first_step_in_parts_is_the_integral_of_its_jerks(whole_steps):
    lengths_s = np.array([0.005] * 4 + [0.02] * whole_steps)
    jerks = np.random.default_rng(0).uniform(-1.0, 1.0, (len(lengths_s), 2))
    knots = [(np.array([0.1, -0.2]), np.array([0.5, 0.3]), np.zeros(2))]

    def moved(knot, jerk, h):
        p, v, a = knot
        return p + h * v + h**2 / 2 * a + h**3 / 6 * jerk, v + h * a + h**2 / 2 * jerk, a + h * jerk

    for jerk, h in zip(jerks, lengths_s, strict=True):
        knots.append(moved(knots[-1], jerk, h))
    positions, velocities, accelerations = (np.array(part) for part in zip(*knots, strict=True))
    plan = Plan(1.0, 0.02, positions, velocities, accelerations, first_parts=4)
    times_s = np.concatenate([[0.0], np.cumsum(lengths_s)])
    assert plan.end_s == pytest.approx(1.0 + times_s[-1] + 0.02)
    for k, (jerk, h) in enumerate(zip(jerks, lengths_s, strict=True)):
        for share in (0.0, 0.3, 0.99):
            found = plan.at(1.0 + times_s[k] + share * h)
            wanted = moved(knots[k], jerk, share * h)
            assert found.position_rad == pytest.approx(wanted[0], abs=1e-12)
            assert found.velocity_rad_s == pytest.approx(wanted[1], abs=1e-9)
            assert found.acceleration_rad_s2 == pytest.approx(wanted[2], abs=1e-7)
    beyond = plan.at(plan.end_s)
    assert beyond.position_rad == pytest.approx(positions[-1] + 0.02 * velocities[-1])
    assert plan.at(0.9).position_rad == pytest.approx(positions[0])


def test_the_controller_sees_what_the_robot_received_and_its_plan_starts_when_said():
    """With a compute delay of 15 ms: history, committed commands and the tick from which a plan is followed."""
    seen, received = [], []

    class Spy(LookAhead):
        def plan(self, situation):
            seen.append((situation.start_s, situation.sent_rad.copy(), situation.committed_rad.copy()))
            plan = super().plan(situation)
            still = np.full_like(plan.position_rad, 1e-3 * len(seen))
            return Plan(plan.start_s, plan.step_s, still, 0 * still, 0 * still)

    class Listening(SimulatedNeck):
        def send_command(self, position_rad):
            received.append((self._clock_s(), super().send_command(position_rad)))
            return received[-1][1]

    scene = Scene(controller=Spy(NECK), settings=LoopSettings(compute_delay_s=0.015))
    scene.loop._robot = Listening(NECK, np.zeros(2), lambda: scene.now_s)
    scene.loop._robot.connect()
    scene.run(1.0)
    times = np.array([t for t, _ in received])
    commands = np.array([c for _, c in received])
    for start_s, sent, committed in seen[5:40]:
        now = round((start_s - 0.015) / TS)
        assert times[now] == pytest.approx(start_s - 0.015)
        np.testing.assert_array_equal(sent, commands[now - len(sent) : now] if now >= len(sent) else sent)
        np.testing.assert_allclose(sent[-1], commands[now - 1])
        # What is said to come until then is what the plan before asks for; the smoother is within one step of it.
        np.testing.assert_allclose(committed, commands[now : now + 3], atol=1.1e-3)
    # The first plan asks for 1 mrad; the command must begin to move on the very tick for which it was made.
    first = round(seen[0][0] / TS)
    assert np.all(commands[:first] == 0)
    assert commands[first, 0] > 0


def test_an_event_that_lasts_is_written_once():
    recorder = LoopRecorder(NECK.control_period_s)
    for k in range(100):
        recorder.event(k * NECK.control_period_s, "stale_plan")
    recorder.event(3.0, "stale_plan")
    log, _ = recorder.finish({}, lambda t: np.zeros((len(t), 3)))
    assert log.event_time_s.tolist() == [0.0, 3.0]


@pytest.mark.parametrize("delay_s", [0.015, 0.05])
@pytest.mark.parametrize("controller", [LookAhead, Mpc])
def test_compute_delay_is_planned_for(controller, delay_s):
    """A plan that takes effect late, by less or more than a control period, is made for that time."""
    prompt = Scene(controller=controller(NECK)).run(4.0)
    delayed = Scene(controller=controller(NECK), settings=LoopSettings(compute_delay_s=delay_s)).run(4.0)
    late = slice(int(1.5 / TS), None)
    assert Scene.error_deg(delayed)[late].mean() < Scene.error_deg(prompt)[late].mean() + 0.25
    assert not np.array_equal(prompt.command_position_rad, delayed.command_position_rad)


def test_a_controller_that_is_used_again_gives_the_same_log_to_the_last_bit():
    """What its solvers remember of another recording plays no part."""
    neck, sensor, settings = load_neck("slow"), load_sensor("reference"), RunSettings()
    placed = [place(load(name), "recorded", 2.5, 1.2) for name in ("subject03_R4", "subject01_R6")]
    controller = Mpc(neck)
    logs = [replay(placed[i], neck, sensor, "mpc", settings, controller)[0] for i in (0, 1, 0)]
    fresh = replay(placed[0], neck, sensor, "mpc", settings)[0]
    for log in (logs[2], fresh):
        assert np.array_equal(log.command_position_rad, logs[0].command_position_rad)


def test_joint_readings_that_are_nan_are_named_and_do_no_harm():
    class Broken(SimulatedNeck):
        def read_state(self):
            state = super().read_state()
            bad = np.nan if self._clock_s() > 2.0 else 1.0
            return dataclasses.replace(state, position_rad=bad * state.position_rad)

    scene = Scene(controller=Mpc(NECK, horizon_s=0.3))
    scene.loop._robot = Broken(NECK, np.zeros(2), lambda: scene.now_s)
    scene.loop._robot.connect()
    log = scene.run(4.0)
    assert "joint_reading_refused" in events(log)
    undisturbed = Scene(controller=Mpc(NECK, horizon_s=0.3)).run(4.0)
    assert log.command_position_rad == pytest.approx(undisturbed.command_position_rad, abs=1e-9)


def test_the_same_seed_gives_the_same_log_to_the_last_bit(tmp_path):
    placed = place(load("subject05_R6"), "recorded", 2.5, 1.2)
    sensor = load_sensor("reference")
    for name in ("a", "b", "c"):
        log, _ = replay(placed, NECK, sensor, "mpc", RunSettings(seed=3 if name == "c" else 2))
        log.save(tmp_path / f"{name}.npz")
    a, b, c = ((tmp_path / f"{name}.npz").read_bytes() for name in "abc")
    assert a == b
    assert a != c


def test_a_recording_too_short_to_be_scored_is_refused():
    recording = place(load("subject01_R1"), "recorded", 2.5, 1.2)
    n = 20
    cut = {f.name: getattr(recording.truth, f.name)[:n] for f in dataclasses.fields(recording.truth)}
    short = dataclasses.replace(
        recording, times_s=recording.times_s[:n], truth=dataclasses.replace(recording.truth, **cut)
    )
    with pytest.raises(LeftOutError, match=r"subject01_R1: 0\.63 s is too short"):
        replay(short, NECK, load_sensor("reference"), "lookahead", RunSettings())
    log, _ = replay(recording, NECK, load_sensor("reference"), "reactive", RunSettings())
    with pytest.raises(LeftOutError, match="too short"):
        measure(dataclasses.replace(log, head_true_base_m=np.full_like(log.head_true_base_m, np.nan)))


@pytest.mark.parametrize("delay_s", [0.0, 0.015, 0.05])
def test_with_the_true_future_a_compute_delay_costs_nothing(delay_s):
    """The commands that go out while the computer works are rolled through as exactly as those of the dead time."""
    placed = place(load("subject03_R4"), "recorded", 2.5, 1.2)
    settings = RunSettings(loop=LoopSettings(compute_delay_s=delay_s))
    log, _ = replay(placed, NECK, load_sensor("reference"), "perfect", settings)
    assert measure(log).gaze_error_rms_deg < 0.1
