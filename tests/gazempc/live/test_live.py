"""The live loop with faults injected: always a command within limits, the event named, the gaze back after it."""

import contextlib
import dataclasses
import gc
import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.controller import ControllerError, SolverFailed, SolverTimedOut
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.errors import RobotError
from gazempc.live.clock import RealClock, SimulatedClock
from gazempc.live.command import main
from gazempc.live.lateness import Lateness
from gazempc.live.mount import Mount
from gazempc.live.run import LiveRun
from gazempc.live.sources.replay import ReplaySource
from gazempc.live.sources.source import Arrived, SourceError
from gazempc.loop.planner import Answer, BackgroundPlanner, ImmediatePlanner
from gazempc.loop.recorder import LoopRecorder
from gazempc.settings import LoopSettings
from gazempc.neck.kinematics import look_at
from gazempc.neck.servo import DeadTimeRoll
from gazempc.neck.spec import load_neck
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.truth import TrueHead
from gazempc.results.metrics import measure
from gazempc.robots.mujoco.robot import MujocoNeck
from gazempc.robots.start import way_in_rad
from gazempc.settings import RunSettings
from gazempc.sim.replay import make_controller, make_predictor, replay
from gazempc.sim.sensor import load_sensor, observe
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import JointState, Sighting
from predictors import ConstantVelocity

NECK = load_neck("reference")
SENSOR = load_sensor("reference")
TS = NECK.servo_period_s
START_RAD = np.array([0.5, -0.1])


def to_and_fro(name, legs):
    """A synthetic walk there and back again, as often as wanted."""
    placed = place(load(name), "recorded", 2.5, 1.2)
    n = placed.times_s.size
    order = np.concatenate([np.arange(n) if leg % 2 == 0 else np.arange(n)[::-1] for leg in range(legs)])
    truth = dataclasses.replace(
        placed.truth, **{f.name: getattr(placed.truth, f.name)[order] for f in dataclasses.fields(placed.truth)}
    )
    return dataclasses.replace(
        placed, name=f"{name} x {legs}", times_s=np.arange(order.size) / 30.0, truth=truth, measured=None
    )


WALK = to_and_fro("subject03_R4", 3)


class Faulty(ReplaySource):
    """A replay whose sightings a test may change: `change(now_s, sighting)` gives those that arrive in its place."""

    def __init__(self, clock, change=None, on_poll=None, walk=WALK):
        super().__init__(walk, SENSOR, 0, clock)
        self.change, self.on_poll = change, on_poll
        self.calls = []

    def open(self):
        self.calls.append("open")
        super().open()

    def poll(self):
        now_s = self._clock.now_s()
        if self.on_poll is not None:
            self.on_poll(now_s)
        arrived = super().poll()
        if self.change is None:
            return arrived
        found = [new for sighting in arrived.sightings for new in self.change(now_s, sighting)]
        return Arrived(
            tuple(f for f in found if isinstance(f, Sighting)), tuple(f for f in found if isinstance(f, str))
        )

    def close(self):
        self.calls.append("close")
        super().close()


class Spied:
    """A robot that keeps what it is sent and whose answers a test may change.

    `on_read(now_s, state)` and `on_send(now_s)` may raise, or give what is answered in place of the truth; what
    `on_send` does not answer reaches the neck.
    """

    def __init__(self, inner, clock, on_read=None, on_send=None):
        self.inner, self.clock, self.on_read, self.on_send = inner, clock, on_read, on_send
        self.received, self.calls = [], []
        self.true_state = inner.true_state

    def connect(self):
        self.calls.append("connect")
        self.inner.connect()

    def read_state(self):
        state = self.inner.read_state()
        return state if self.on_read is None else self.on_read(self.clock.now_s(), state)

    def send_command(self, position_rad):
        if self.on_send is not None:
            answered = self.on_send(self.clock.now_s())
            if answered is not None:
                return answered[0]
        sent = self.inner.send_command(position_rad)
        self.received.append((self.clock.now_s(), sent.copy()))
        return sent

    def close(self):
        self.calls.append("close")
        self.inner.close()


@dataclasses.dataclass
class Result:
    """What came of a run."""

    logs: list
    report: object
    robot: Spied
    source: Faulty
    duration_s: float | None

    def joined(self, name):
        return np.concatenate([getattr(log, name) for log, _ in self.logs])

    @property
    def events(self):
        return set(self.joined("event_name").tolist())

    @property
    def ended_s(self):
        """When the neck was told to stop."""
        return {"duration": self.duration_s, "end of the source": WALK.times_s[-1]}[self.report.stopped_by]

    def event_s(self, name):
        return self.joined("event_time_s")[self.joined("event_name") == name]

    @property
    def error_deg(self):
        """Gaze against the true head; the reference neck has both axes and the eye in the origin."""
        pan, tilt = self.joined("joint_position_rad").T
        gaze = np.stack([np.cos(pan) * np.cos(tilt), np.sin(pan) * np.cos(tilt), np.sin(tilt)], axis=1)
        head = self.joined("head_true_base_m")
        return np.rad2deg(np.arccos(np.clip(np.sum(gaze * head, axis=1) / np.linalg.norm(head, axis=1), -1, 1)))


def run_live(
    change=None,
    on_poll=None,
    on_read=None,
    on_send=None,
    controller=None,
    predictor=None,
    planner=ImmediatePlanner,
    clock=None,
    robot_class=SimulatedNeck,
    start_rad=None,
    walk=WALK,
    duration_s=6.0,
    stop=None,
    log_s=300.0,
    keep=None,
    loop=None,
    source=None,
):
    clock = clock or SimulatedClock()
    if start_rad is None:
        start_rad = look_at(NECK.geometry, walk.truth.head_position_m[0]).angles_rad
    if robot_class is MujocoNeck:
        inner = MujocoNeck(NECK, clock.now_s, start_rad)
    else:
        inner = robot_class(NECK, start_rad, clock.now_s)
    robot = Spied(inner, clock, on_read, on_send)
    source = source or Faulty(clock, change, on_poll, walk)
    controller = controller or Mpc(NECK, horizon_s=0.3)
    true_head = TrueHead(walk)
    logs = []

    def known(times_s):
        own_s = times_s - source.start_s
        return np.where(true_head.known(own_s)[:, None], true_head(own_s), np.nan)

    run = LiveRun(
        NECK,
        predictor or ConstantVelocity(),
        controller,
        planner(controller),
        robot,
        source,
        Mount(),
        clock,
        loop or LoopSettings(),
        {"neck": NECK.model_dump(), "joints": "true"},
        keep or (lambda log, times: logs.append((log, times))),
        log_s,
        known,
        robot.true_state,
    )
    result = Result(logs, run.report, robot, source, duration_s)
    try:
        run.run(stop or threading.Event(), duration_s)
    except Exception as error:
        error.result = result
        raise
    return result


def assert_within_limits(positions_rad, starts_rad=None, breaks=(), ends=False):
    """Position and its differences against the figures of the neck, independently of the code under test.

    Where the robot did not answer (`breaks`: number of the first command after that) it stood still, which nobody can
    prevent: each part is judged from rest on. Where the run `ends` the robot stands by the last command for ever.
    """
    low = np.deg2rad([NECK.pan.position_min_deg, NECK.tilt.position_min_deg])
    high = np.deg2rad([NECK.pan.position_max_deg, NECK.tilt.position_max_deg])
    assert np.all(np.isfinite(positions_rad))
    assert np.all((positions_rad >= low - 1e-9) & (positions_rad <= high + 1e-9))
    parts = np.split(positions_rad, breaks)
    before = positions_rad[0] if starts_rad is None else starts_rad
    for part in parts:
        if not len(part):
            continue
        padded = np.vstack([np.tile(before, (3, 1)), part])
        before = part[-1]
        if ends and part is parts[-1]:
            padded = np.vstack([padded, np.tile(before, (3, 1))])
        for order, name in enumerate(("velocity_max_rad_s", "acceleration_max_rad_s2", "jerk_max_rad_s3"), 1):
            limit = np.array([getattr(NECK.pan, name), getattr(NECK.tilt, name)])
            worst = np.abs(np.diff(padded, order, axis=0)).max(axis=0) / TS**order
            assert np.all(worst <= limit * (1 + 1e-6)), f"{name}: {worst} > {limit}"


def assert_sound(result, start_rad=None):
    """At every tick a command; what was sent and what is logged are the same; all within limits, to the very stop."""
    sent = result.joined("command_position_rad")
    assert len(sent) == result.report.ticks
    received = np.array([position for _, position in result.robot.received])
    assert np.array_equal(received, sent)
    assert_within_limits(sent, start_rad, ends=True)
    assert result.robot.calls[-1] == "close"
    assert result.source.calls[-1] == "close"


_undisturbed = {}


def undisturbed(**options):
    key = tuple(sorted(options))
    if key not in _undisturbed:
        _undisturbed[key] = run_live(**options, duration_s=None)
    return _undisturbed[key]


def assert_recovered(result, from_s, within_deg=0.3, reference=None):
    """From then on the gaze error is what it is without the fault, and was not at some time before."""
    reference = reference or undisturbed()
    now = result.joined("time_s")
    until_s = min(result.ended_s, reference.ended_s)
    scored = (now >= from_s) & (now < until_s)
    usual_deg = np.interp(now[scored], reference.joined("time_s"), reference.error_deg)
    after = np.abs(result.error_deg[scored] - usual_deg)
    assert after.size > 1.0 / TS
    assert after.max() < within_deg


def assert_same_commands(result, within_rad):
    """Until it is told to stop, the commands are those without the fault."""
    sent = result.joined("command_position_rad")[result.joined("time_s") < result.ended_s]
    usual = undisturbed().joined("command_position_rad")[: len(sent)]
    assert len(sent) > 2.0 / TS
    np.testing.assert_allclose(sent, usual, atol=within_rad, rtol=0)


def between(start_s, stop_s):
    return lambda now_s: start_s <= now_s < stop_s


def test_undisturbed_the_loop_tracks_and_names_nothing_but_the_start():
    result = undisturbed()
    assert_sound(result)
    assert result.events == {"no_observation_yet"}
    assert result.report.stopped_by == "end of the source"
    assert result.report.skipped_ticks == 0
    assert result.report.observations >= WALK.times_s.size - 3
    assert np.nanmedian(result.error_deg) < 3.0


# --- faults of the source


def test_a_source_that_is_silent_for_five_seconds():
    """Stop 1 s after the last frame, at rest straight ahead slowly after 3 s, and the gaze back 2 s after the end.

    On the face, that is; to the last third of a degree when nobody is met any more.
    """
    silent = between(3.0, 8.0)
    result = run_live(change=lambda now, s: [] if silent(now) else [s], duration_s=None)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "target_lost", "return_to_rest"}
    last_capture_s = result.joined("capture_time_s")[result.joined("capture_time_s") < 5.0].max()
    assert result.event_s("target_lost") == pytest.approx([last_capture_s + 1.0], abs=2 * TS)
    assert result.event_s("return_to_rest") == pytest.approx([last_capture_s + 3.0], abs=2 * TS)
    now, sent = result.joined("time_s"), result.joined("command_position_rad")
    standing = sent[(now > last_capture_s + 1.6) & (now < last_capture_s + 3.0)]
    assert np.ptp(standing, axis=0) == pytest.approx([0, 0], abs=1e-9)
    assert np.abs(standing[0]).max() > 0.05
    returning = (now > last_capture_s + 3.0) & (now < 8.0)
    assert np.abs(np.diff(sent[returning], axis=0)).max() / TS <= 0.5 * (1 + 1e-9)
    assert sent[np.flatnonzero(returning)[-1]] == pytest.approx([0, 0], abs=1e-6)
    # Who was lost is looked for where they are, not where they would have gone.
    back = (now >= 8.0) & (now < 10.0)
    assert np.rad2deg(np.abs(result.joined("joint_position_rad")[back, 0])).max() < 25.0
    assert_recovered(result, 8.0 + 2.0, within_deg=1.0)
    assert_recovered(result, 8.0 + 3.0)
    assert measure(result.logs[0][0]).limit_violations == 0


def test_a_burst_of_stale_frames_is_dropped():
    """A tracker hangs for 1.2 s, then delivers all that it has kept."""
    held = []

    def hang(now_s, sighting):
        if 3.0 <= now_s < 4.2:
            held.append(sighting)
            return []
        burst, held[:] = [*held, sighting], []
        return burst

    result = run_live(change=hang, duration_s=7.5)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "target_lost", "stale_observation", "observations_dropped"}
    # The event is written once, when it begins, however many the frames.
    assert result.event_s("stale_observation").size == 1
    assert result.report.observations == run_live(duration_s=7.5).report.observations
    lag_s = result.joined("arrival_time_s") - result.joined("capture_time_s")
    assert lag_s.max() <= 0.5
    assert (lag_s > 0.1).sum() > 10  # what was not stale of it was used
    assert_recovered(result, 4.2 + 2.0)


def test_frames_out_of_order_are_dropped():
    kept = []

    def shuffled(now_s, sighting):
        if not 3.0 <= now_s < 4.0:
            return [sighting]
        kept.append(sighting)
        return [kept.pop(), kept.pop(0)] if len(kept) >= 2 else []

    result = run_live(change=shuffled, duration_s=7.5)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "out_of_order"}
    assert np.all(np.diff(result.joined("capture_time_s")) > 0)
    assert_recovered(result, 4.0 + 1.0)


@pytest.mark.parametrize(("jump_s", "event"), [(3.0, "future_observation"), (-3.0, "stale_observation")])
def test_the_sensor_s_clock_jumps_and_comes_back(jump_s, event):
    """Time stamps 3 s off for 1.5 s; taken in, those of the future would make all later ones out of order."""

    def jumped(now_s, sighting):
        seen = sighting.observation
        off_s = jump_s if 3.0 <= now_s < 4.5 else 0.0
        return [
            dataclasses.replace(
                sighting, observation=dataclasses.replace(seen, capture_time_s=seen.capture_time_s + off_s)
            )
        ]

    result = run_live(change=jumped, duration_s=7.5)
    assert_sound(result)
    assert result.events == {"no_observation_yet", event, "target_lost"}
    assert result.event_s(event)[0] == pytest.approx(3.0, abs=0.05)
    assert_recovered(result, 4.5 + 1.5)


def test_a_small_step_back_of_the_sensor_s_clock_is_out_of_order_until_it_is_made_up():
    def jumped(now_s, sighting):
        seen = sighting.observation
        off_s = -0.3 if now_s >= 3.0 else 0.0
        return [
            dataclasses.replace(
                sighting, observation=dataclasses.replace(seen, capture_time_s=seen.capture_time_s + off_s)
            )
        ]

    result = run_live(change=jumped)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "out_of_order"}


@pytest.mark.parametrize("field", ["head_position_base_m", "head_quat_wxyz", "pelvis_quat_wxyz"])
@pytest.mark.parametrize("value", [np.nan, 0.0])
def test_an_observation_with_nan_or_a_bad_quaternion_is_refused(field, value):
    """Forged past the check of `HeadObservation`, as a source in another language might."""
    if field == "head_position_base_m":
        value = np.nan

    def spoilt(now_s, sighting):
        if not 2.0 <= now_s < 2.5:
            return [sighting]
        seen = dataclasses.replace(sighting.observation)
        object.__setattr__(seen, field, np.full_like(getattr(seen, field), value))
        return [Sighting(sighting.arrival_s, seen)]

    result = run_live(change=spoilt)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "bad_observation"}
    assert result.report.n_problems == len(result.report.problems) > 10
    assert_recovered(result, 2.5 + 1.2)


def test_what_a_source_could_not_read_is_counted_and_the_first_are_kept():
    def unread(now_s, sighting):
        return [f"line {now_s}: head_position_m is not finite"] if 2.0 <= now_s < 2.8 else [sighting]

    result = run_live(change=unread, duration_s=4.0)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "bad_observation"}
    assert len(result.report.problems) == 20
    assert 22 <= result.report.n_problems <= 26


# --- faults of the robot


def answers_badly(kind, state):
    """One bad way to answer a reading."""
    position = np.array([0.1, 0.2])
    if isinstance(kind, type):
        raise kind("no answer")
    return {
        "none": None,
        "nan": JointState(state.time_s, position * np.nan, position * np.nan),
        "three joints": JointState(state.time_s, np.zeros(3), np.zeros(3)),
        "scalar": JointState(state.time_s, np.array(0.1), np.array(0.0)),
        "no position": JointState(state.time_s, None, None),
        "lists": JointState(state.time_s, [0.1, 0.2], [0.0, 0.0]),
        "no time": JointState(np.nan, state.position_rad, state.velocity_rad_s),
        "a year old": JointState(state.time_s - 3e7, state.position_rad, state.velocity_rad_s),
        "the same for ever": JointState(1.9, position, 0 * position),
        "far off": JointState(state.time_s, state.position_rad + 0.5, state.velocity_rad_s),
    }[kind]


@pytest.mark.parametrize(
    ("kind", "event"),
    [
        (RobotError, "robot_not_answering"),
        (OSError, "robot_not_answering"),
        (ValueError, "robot_not_answering"),
        (TimeoutError, "robot_not_answering"),
        ("none", None),
        ("nan", "joint_reading_refused"),
        ("three joints", "robot_not_answering"),
        ("scalar", "robot_not_answering"),
        ("no position", "robot_not_answering"),
        ("lists", None),
        ("no time", "joint_reading_refused"),
        ("a year old", "joint_reading_refused"),
        ("the same for ever", "joint_reading_refused"),
    ],
)
def test_joints_that_cannot_be_read_for_half_a_second_are_known_from_the_commands(kind, event):
    failing = between(2.0, 2.5)
    result = run_live(on_read=lambda now, state: answers_badly(kind, state) if failing(now) else state, duration_s=4.0)
    assert_sound(result)
    if kind != "lists":  # what is no array may be taken for one or be refused
        assert result.events == {"no_observation_yet", *([event] if event else [])}
    assert_same_commands(result, 1e-3 if kind == "lists" else 1e-9)


def test_readings_far_off_are_refused():
    def off(now_s, state):
        return answers_badly("far off", state) if 2.0 <= now_s < 2.05 else state

    result = run_live(on_read=off, duration_s=4.0)
    assert_sound(result)
    assert result.events == {"no_observation_yet", "joint_reading_refused"}
    assert_same_commands(result, 1e-9)


def assert_stands_by_the_last_command(result, start_s, stop_s):
    """While nothing gets through the log says so; the first command that does goes on from there, from rest."""
    now, sent = result.joined("time_s"), result.joined("command_position_rad")
    assert len(sent) == result.report.ticks
    silent = (now >= start_s) & (now < stop_s)
    first = np.flatnonzero(silent)[0]
    assert np.array_equal(sent[silent], np.tile(sent[first - 1], (silent.sum(), 1)))
    # One or two lost commands only hold the motion up; the third is a silence.
    velocity_rad_s = result.joined("command_velocity_rad_s")
    given_up = silent & (np.arange(len(sent)) >= first + 2)
    assert np.all(velocity_rad_s[given_up] == 0)
    assert np.array_equal(velocity_rad_s[silent & ~given_up], np.tile(velocity_rad_s[first - 1], (2, 1)))
    received = np.array([position for _, position in result.robot.received])
    assert np.array_equal(received, sent[~silent])
    assert_within_limits(received, breaks=[first])
    assert_within_limits(sent, breaks=[first])


def not_answering(kind):
    def send(now_s):
        if not 2.0 <= now_s < 2.5:
            return None
        if isinstance(kind, type):
            raise kind("no answer")
        return (
            {"none": None, "nan": np.full(2, np.nan), "three": np.zeros(3), "list": [0.0, None], "text": "ok"}[kind],
        )

    return send


@pytest.mark.parametrize(
    "kind", [RobotError, OSError, ValueError, TimeoutError, "none", "nan", "three", "list", "text"]
)
def test_commands_that_do_not_get_through_for_half_a_second(kind):
    result = run_live(on_send=not_answering(kind))
    assert result.events == {"no_observation_yet", "robot_not_answering"}
    assert result.event_s("robot_not_answering") == pytest.approx([2.0], abs=TS)
    assert_stands_by_the_last_command(result, 2.0, 2.5)
    assert_recovered(result, 2.5 + 1.5)
    assert result.robot.calls == ["connect", "close"]


@pytest.mark.parametrize("robot_class", [SimulatedNeck, MujocoNeck])
def test_a_robot_that_disconnects_and_comes_back(robot_class):
    def gone(now_s, state=None):
        if 2.0 <= now_s < 2.6:
            raise RobotError("unplugged")
        return state

    result = run_live(on_read=gone, on_send=gone, robot_class=robot_class)
    assert result.events == {"no_observation_yet", "robot_not_answering"}
    assert_stands_by_the_last_command(result, 2.0, 2.6)
    reference = undisturbed() if robot_class is SimulatedNeck else run_live(robot_class=MujocoNeck)
    assert_recovered(result, 2.6 + 1.5, reference=reference)


def test_what_was_planned_before_a_command_was_lost_is_not_followed():
    """Plans under way, and plans made and waiting, start from a command that the robot never got."""

    def run(on_send):
        clock = SimulatedClock()
        return run_live(
            clock=clock,
            on_send=on_send,
            planner=lambda controller: Late(controller, clock, lambda now: 0.03),
            loop=LoopSettings(compute_delay_s=0.05),
        )

    def lost(now_s):
        if 2.0 - 1e-6 <= now_s < 2.0 + 2.5 * TS:
            raise RobotError("lost")

    result = run(lost)
    now, sent = result.joined("time_s"), result.joined("command_position_rad")
    before = np.flatnonzero(now < 2.0 - 1e-6)[-1]
    waiting = (now > 2.0 - 1e-6) & (now < 2.05)
    assert np.array_equal(sent[waiting], np.tile(sent[before], (waiting.sum(), 1)))
    assert_within_limits(np.array([p for _, p in result.robot.received]), breaks=[before + 1])
    assert result.event_s("robot_not_answering") == pytest.approx([2.0])
    assert_recovered(result, 2.0 + 1.5, reference=run(None))


@pytest.mark.parametrize("lost", [1, 2])
def test_one_or_two_lost_commands_only_hold_the_motion_up(lost):
    """To stop dead for a packet would be 366 rad/s^2 where 15 are allowed."""

    def on_send(now_s):
        if 2.0 - 1e-6 <= now_s < 2.0 + (lost - 0.5) * TS:
            raise RobotError("lost")

    result = run_live(on_send=on_send)
    now, sent = result.joined("time_s"), result.joined("command_position_rad")
    first = np.flatnonzero(now >= 2.0 - 1e-6)[0]
    assert np.array_equal(sent[first : first + lost], np.tile(sent[first - 1], (lost, 1)))
    # What the robot got, one after the other, is a motion within the limits, as if time had stood still.
    assert_within_limits(np.array([position for _, position in result.robot.received]))
    assert result.events == {"no_observation_yet", "robot_not_answering"}
    assert_recovered(result, 2.5)


# --- faults of predictor, controller and solver


class Sabotaged(Mpc):
    """An MPC that does something else for a while."""

    def __init__(self, instead, start_s, stop_s):
        super().__init__(NECK, horizon_s=0.3)
        self.instead, self.start_s, self.stop_s = instead, start_s, stop_s

    def plan(self, situation):
        plan = super().plan(situation)
        return self.instead(plan) if self.start_s <= situation.start_s < self.stop_s else plan


def raising(error):
    def instead(plan=None):
        raise error("made to fail")

    return instead


def nan_plan(plan):
    return dataclasses.replace(plan, position_rad=plan.position_rad * np.nan)


def wild_plan(plan):
    return dataclasses.replace(plan, position_rad=plan.position_rad + 50.0, velocity_rad_s=plan.velocity_rad_s + 99.0)


@pytest.mark.parametrize(
    ("instead", "event"),
    [
        (raising(ControllerError), "controller_failed"),
        (raising(ZeroDivisionError), "controller_failed"),
        (raising(SolverFailed), "solver_failed"),
        (raising(SolverTimedOut), "solver_timed_out"),
        (nan_plan, "plan_not_finite"),
        (lambda plan: None, "controller_failed"),
        (lambda plan: "no plan", "controller_failed"),
    ],
)
def test_a_solver_that_fails_for_a_second(instead, event):
    """The rest of the last plan (0.3 s), then a stop; the gaze is back 1.4 s after the end."""
    result = run_live(controller=Sabotaged(instead, 2.0, 3.0))
    assert_sound(result)
    assert result.events == {"no_observation_yet", event, "stale_plan"}
    now, sent = result.joined("time_s"), result.joined("command_position_rad")
    reference = undisturbed().joined("command_position_rad")[: now.size]
    bridged = (now >= 2.0) & (now < 2.06)
    assert sent[bridged] == pytest.approx(reference[bridged], abs=np.deg2rad(0.5))
    assert np.abs(np.diff(sent[(now >= 2.0) & (now < 2.2)], axis=0)).max(axis=1).min() > 1e-5
    standing = sent[(now >= 2.75) & (now < 3.0)]
    assert np.ptp(standing, axis=0) == pytest.approx([0, 0], abs=1e-9)
    assert_recovered(result, 3.0 + 1.4)


def test_a_plan_far_outside_of_all_limits_is_followed_within_them_only():
    result = run_live(controller=Sabotaged(wild_plan, 2.0, 2.5), duration_s=8.0)
    assert_sound(result)
    # As near as ever when nobody is met any more.
    assert_recovered(result, 2.5 + 2.0, within_deg=1.0)
    assert_recovered(result, 2.5 + 4.0)


def test_a_controller_that_cannot_say_what_it_needs_to_know_is_an_event():
    class Confused(Mpc):
        def forecast_times_s(self, start_s, newest_capture_s):
            if 2.0 <= start_s < 2.3:
                raise IndexError("made to fail")
            return super().forecast_times_s(start_s, newest_capture_s)

    result = run_live(controller=Confused(NECK, horizon_s=0.3))
    assert_sound(result)
    assert "controller_failed" in result.events
    assert_recovered(result, 2.3 + 1.2)


class Late:
    """A planner whose answers come some time after the request, on a simulated clock."""

    def __init__(self, controller, clock, delay_s):
        self._inner, self._clock, self._delay_s = ImmediatePlanner(controller), clock, delay_s
        self._pending = None

    def request(self, due_index, situation):
        if self._pending is not None:
            return False
        self._inner.request(due_index, situation)
        now_s = self._clock.now_s()
        self._pending = (now_s + self._delay_s(now_s), self._inner.answers())
        return True

    def answers(self):
        if self._pending is None or self._clock.now_s() < self._pending[0] - 1e-9:
            return []
        (_, answers), self._pending = self._pending, None
        return answers

    def close(self):
        pass


def test_a_solver_that_takes_100_ms_for_a_second():
    """What is left of each late plan is used; the gaze is hardly worse meanwhile, and as ever 1.2 s after."""
    clock = SimulatedClock()
    slow = between(2.0, 3.0)
    result = run_live(
        clock=clock, planner=lambda controller: Late(controller, clock, lambda now: 0.1 if slow(now) else 0.0)
    )
    assert_sound(result)
    assert result.events == {"no_observation_yet", "late_plan"}
    now = result.joined("time_s")
    during = (now >= 2.0) & (now < 4.0)
    assert np.max(np.abs(result.error_deg[during] - undisturbed().error_deg[: now.size][during])) < 5.0
    assert_recovered(result, 3.0 + 1.2)
    times = result.logs[0][1]
    assert times.latency_ms.max() > 150.0  # 66 ms of the sensor and 100 ms of planning
    assert np.median(times.latency_ms) < 110.0


@pytest.mark.parametrize(("takes_s", "compute_delay_s"), [(0.015, 0.0), (0.03, 0.05), (0.0, 0.0), (0.015, 0.05)])
def test_plans_are_late_that_come_after_their_tick_or_keep_the_next_one_waiting(takes_s, compute_delay_s):
    """Within a control period, but after the tick; before the tick, but longer than a control period; neither."""
    clock = SimulatedClock()
    result = run_live(
        clock=clock,
        planner=lambda controller: Late(controller, clock, lambda now: takes_s),
        loop=LoopSettings(compute_delay_s=compute_delay_s),
        duration_s=1.5,
    )
    assert_sound(result)
    late = takes_s > compute_delay_s or takes_s > NECK.control_period_s
    assert ("late_plan" in result.events) == late


@pytest.mark.parametrize("method", ["update", "forecast"])
@pytest.mark.parametrize("error", [np.linalg.LinAlgError, RuntimeError])
def test_a_predictor_that_raises(method, error):
    class Raising(ConstantVelocity):
        now_s = 0.0

        def update(self, observation):
            self.now_s = observation.capture_time_s
            if method == "update" and 2.0 <= self.now_s < 2.5:
                raise error("made to fail")
            super().update(observation)

        def forecast(self, times_s):
            if method == "forecast" and 2.0 <= self.now_s < 2.5:
                raise error("made to fail")
            return super().forecast(times_s)

    result = run_live(predictor=Raising())
    assert_sound(result)
    assert "forecast_failed" in result.events
    assert_recovered(result, 2.5 + 1.2)


@pytest.mark.parametrize("how", ["nan", "shape", "none"])
def test_a_predictor_whose_forecast_is_no_good(how):
    class Broken(ConstantVelocity):
        now_s = 0.0

        def update(self, observation):
            self.now_s = observation.capture_time_s
            super().update(observation)

        def forecast(self, times_s):
            forecast = super().forecast(times_s)
            if not 2.0 <= self.now_s < 2.4:
                return forecast
            if how == "none":
                return None
            means = forecast.means_base_m
            return dataclasses.replace(forecast, means_base_m=means * np.nan if how == "nan" else means[:-1])

    result = run_live(predictor=Broken())
    assert_sound(result)
    assert "forecast_failed" in result.events
    assert_recovered(result, 2.4 + 1.5)


# --- ticks that are left out


class Jumping(SimulatedClock):
    """A clock on which some waits take much longer than they should: the loop was not woken."""

    def __init__(self, jumps=()):
        super().__init__()
        self.jumps = list(jumps)

    def sleep_until_s(self, time_s):
        super().sleep_until_s(time_s)
        self.jump_if_due()

    def jump_if_due(self):
        if self.jumps and self._now_s >= self.jumps[0][0] - 1e-9:
            self._now_s += self.jumps.pop(0)[1]


class Remembering(Mpc):
    """Keeps what it is told of the joints and the commands that were sent."""

    def __init__(self):
        super().__init__(NECK, horizon_s=0.3)
        self.seen = []

    def plan(self, situation):
        self.seen.append(situation)
        return super().plan(situation)


class HeldUp(SimulatedNeck):
    """A neck whose port is blocked once for some time, after a command has gone out."""

    jump_s = 0.0

    def send_command(self, position_rad):
        sent = super().send_command(position_rad)
        if self.jump_s and self._clock_s() >= 2.0 - 1e-9:
            self._clock_s.__self__._now_s += self.jump_s
            self.jump_s = 0.0
        return sent


@pytest.mark.parametrize("jump_s", [0.05, 0.052, 2.0])
@pytest.mark.parametrize("where", ["asleep", "at work"])
def test_ticks_that_are_over_are_left_out_and_nothing_bursts(jump_s, where):
    """The loop is woken late once, or a command takes long to send: as seen by the robot, and by the controller."""
    clock = Jumping([(2.0, jump_s)] if where == "asleep" else [])
    controller = Remembering()
    joints = {}

    def on_read(now_s, state):
        joints[round(now_s, 6)] = state.position_rad
        return state

    class Neck(HeldUp):
        pass

    Neck.jump_s = jump_s if where == "at work" else 0.0
    result = run_live(clock=clock, controller=controller, on_read=on_read, robot_class=Neck, duration_s=8.0)
    assert_sound(result)
    n = int(jump_s / TS + 1e-6)
    # A tick more may be done than there is time for, at the same instant.
    assert n - 2 <= result.report.skipped_ticks <= n
    assert result.report.lateness.max_ms == pytest.approx(1e3 * jump_s, abs=5.1)
    sent_s = np.array([now_s for now_s, _ in result.robot.received])
    assert max(np.searchsorted(sent_s, t + 10 * TS - 1e-9) - k for k, t in enumerate(sent_s)) <= 12
    # The grid of the ticks is kept.
    on_time = sent_s[sent_s > 2.0 + jump_s + 3 * TS]
    assert np.abs(on_time / TS - np.round(on_time / TS)).max() < 1e-6
    rolls = [DeadTimeRoll(axis, TS) for axis in NECK.axes]
    astray = [0.0]
    for situation in controller.seen[10:]:
        # Commands are made for when the tick was due; the joints were read when it was done.
        due_s = situation.start_s
        now_s = min((t for t in joints if t >= due_s - 1e-6), default=None)
        assert now_s is not None
        assert situation.joint_position_rad == pytest.approx(joints[now_s], abs=1e-6)
        later_rad = joints.get(round(now_s + NECK.pan.dead_time_s, 6))
        if later_rad is None:
            continue
        # What has been sent takes the joints to where they really are one dead time later.
        for i, roll in enumerate(rolls):
            position_rad, velocity_rad_s = situation.joint_position_rad[i], situation.joint_velocity_rad_s[i]
            state = roll(float(position_rad), float(velocity_rad_s), situation.sent_rad[:, i], np.zeros(0))
            astray.append(abs(state[0] - later_rad[i]))
    # A command that goes out up to two ticks late acts that much later.
    assert max(astray) < (1e-6 if where == "at work" and jump_s == 2.0 else 2.5 * 2 * TS)
    assert_recovered(result, 2.0 + jump_s + 2.0, within_deg=1.0)
    assert_recovered(result, 2.0 + jump_s + 2.5)


def test_where_every_send_takes_a_control_period_it_is_planned_all_the_same():
    """The numbers of the ticks that are left over may never be multiples of those between two plans."""
    clock = SimulatedClock()

    class Slow(SimulatedNeck):
        def send_command(self, position_rad):
            sent = super().send_command(position_rad)
            tick = round(clock.now_s() / TS)
            clock._now_s = (tick + (4 if tick else 3)) * TS + 1e-4
            return sent

    result = run_live(clock=clock, robot_class=Slow)
    assert_sound(result)
    numbers = np.round(result.joined("time_s") / TS).astype(int)
    assert np.all(np.diff(numbers)[1:] == 4)
    assert numbers[1] == 3
    assert result.report.skipped_ticks >= 3 * (result.report.ticks - 2)
    assert result.events <= {"no_observation_yet", "stale_plan", "limit_guard", "limits_softened"}
    # It moves by a servo period at a time, a quarter as fast as it may; but it follows.
    assert np.median(result.error_deg[result.joined("time_s") > 2.0]) < 12.0
    assert np.ptp(result.joined("command_position_rad")[:, 0]) > 0.3


# --- start and stop


def test_the_first_command_is_where_the_joints_stand():
    result = run_live(change=lambda now, s: [], start_rad=START_RAD, duration_s=0.5)
    assert_sound(result, START_RAD)
    assert np.array_equal(result.robot.received[0][1], START_RAD)
    assert np.allclose(result.joined("command_position_rad"), START_RAD, atol=1e-12)


@pytest.mark.parametrize("kind", [RobotError, OSError, TimeoutError, ValueError, "none", "nan", "three joints"])
@pytest.mark.parametrize("until_s", [0.3, 1.5])
def test_joints_that_cannot_be_read_at_first_are_waited_for_or_given_up_but_nothing_jumps(kind, until_s):
    """A command at rest straight ahead would be a jump; a robot that never answers may be refused."""

    def on_read(now_s, state):
        return answers_badly(kind, state) if now_s < until_s else state

    try:
        result = run_live(on_read=on_read, change=lambda now, s: [], start_rad=START_RAD, duration_s=2.5)
    except RobotError as error:
        result = error.result
        assert until_s > 1.0
        assert result.robot.calls == ["connect", "close"]
    if result.robot.received:
        assert_within_limits(np.array([p for _, p in result.robot.received]), START_RAD)


def test_told_to_stop_before_it_began_the_neck_does_not_jump():
    stop = threading.Event()
    stop.set()
    result = run_live(stop=stop, start_rad=START_RAD)
    assert result.report.stopped_by == "signal"
    assert all(np.allclose(position, START_RAD) for _, position in result.robot.received)
    assert result.robot.calls[-1] == result.source.calls[-1] == "close"


@pytest.mark.parametrize("why", ["signal", "duration", "end of the source"])
def test_told_to_stop_the_neck_brakes_within_limits_and_everything_is_closed(why):
    stop = threading.Event()
    walk = WALK

    def on_poll(now_s):
        if why == "signal" and now_s >= 2.0:
            stop.set()

    if why == "end of the source":
        n = 61
        cut = {f.name: getattr(WALK.truth, f.name)[:n] for f in dataclasses.fields(WALK.truth)}
        walk = dataclasses.replace(WALK, times_s=WALK.times_s[:n], truth=dataclasses.replace(WALK.truth, **cut))
    closed = []

    class Closing(ImmediatePlanner):
        def close(self):
            closed.append(True)

    result = run_live(
        on_poll=on_poll,
        stop=stop,
        walk=walk,
        planner=Closing,
        duration_s=2.0 if why == "duration" else 5.0,
    )
    assert_sound(result)
    assert result.report.stopped_by == why
    now, velocity = result.joined("time_s"), result.joined("command_velocity_rad_s")
    speed_before = np.abs(velocity[np.searchsorted(now, 1.95)]).max()
    assert speed_before > 0.1  # it was moving
    assert np.all(velocity[-1] == pytest.approx([0, 0], abs=1e-9))
    assert 2.0 < now[-1] < 2.5
    speed = np.abs(velocity[now > 2.1]).max(axis=1)
    assert np.all(np.diff(speed) <= 1e-9)  # braking all the way
    assert closed


def test_on_the_way_to_a_stop_nothing_is_waited_for():
    """A planner that takes a second to end must not hold up the commands that brake the neck."""
    clock = SimulatedClock()

    class SlowToEnd(ImmediatePlanner):
        def close(self):
            clock._now_s += 1.0

    result = run_live(clock=clock, planner=SlowToEnd, duration_s=2.0)
    assert_sound(result)
    sent_s = np.array([now_s for now_s, _ in result.robot.received])
    assert np.diff(sent_s).max() < 2 * TS
    assert result.report.skipped_ticks == 0


@pytest.mark.parametrize("part", ["keep", "source"])
def test_whatever_ends_a_run_the_neck_is_braked_first(part):
    """A full disk, or a source with a bug, in the middle of a motion: the run goes on or ends, but never mid-motion."""
    kept = []

    def keep(log, times):
        if part == "keep" and not kept:
            kept.append(log)
            raise OSError("no space left on device")

    def on_poll(now_s):
        if part == "source" and now_s >= 2.0:
            raise RuntimeError("a bug")

    try:
        result = run_live(keep=keep, on_poll=on_poll, log_s=2.0, duration_s=4.0)
    except (OSError, RuntimeError) as error:
        result = error.result
    received = np.array([position for _, position in result.robot.received])
    assert_within_limits(received, ends=True)
    assert result.robot.calls[-1] == result.source.calls[-1] == "close"


@pytest.mark.parametrize("part", ["robot", "source"])
@pytest.mark.parametrize("error", [RobotError, SourceError, RuntimeError])
def test_what_cannot_be_opened_is_closed_all_the_same(part, error, monkeypatch):
    calls = []

    def fail(self):
        calls.append(self)
        raise error("cannot be opened")

    monkeypatch.setattr(Spied if part == "robot" else Faulty, "connect" if part == "robot" else "open", fail)
    with pytest.raises(error, match="cannot be opened") as raised:
        run_live()
    result = raised.value.result
    assert result.robot.calls[-1] == result.source.calls[-1] == "close"
    assert not result.robot.received
    assert not result.logs


# --- everything at once

KINDS = (
    "silent", "stale", "future", "past", "doubled", "nan observation", "read raises", "read nan", "send raises",
    "send nan", "solver fails", "nan plan", "wild plan", "late plan", "predictor raises", "asleep",
)  # fmt: skip


@settings(max_examples=10)
@given(
    faults=st.lists(
        st.tuples(st.sampled_from(KINDS), st.floats(0.0, 2.8), st.floats(0.01, 1.5)), min_size=1, max_size=6
    )
)
def test_any_sequence_of_faults_is_survived_within_limits(faults):
    def on(kind, now_s):
        return any(kind == k and start <= now_s < start + length for k, start, length in faults)

    clock = Jumping(sorted((start, length / 3) for kind, start, length in faults if kind == "asleep"))

    def change(now_s, sighting):
        seen = sighting.observation
        shift_s = 3.0 * (on("future", now_s) - on("past", now_s)) - 0.8 * on("stale", now_s)
        moved = Sighting(sighting.arrival_s, dataclasses.replace(seen, capture_time_s=seen.capture_time_s + shift_s))
        if on("nan observation", now_s):
            object.__setattr__(moved.observation, "head_position_base_m", np.full(3, np.nan))
        return [] if on("silent", now_s) else [moved] * (1 + on("doubled", now_s))

    def on_read(now_s, state):
        if on("read raises", now_s):
            raise TimeoutError
        return answers_badly("nan", state) if on("read nan", now_s) else state

    silent, got_through = [], []

    def on_send(now_s):
        if on("send raises", now_s):
            silent.append(len(got_through))
            raise OSError("no answer")
        if on("send nan", now_s):
            silent.append(len(got_through))
            return (np.full(2, np.nan),)
        got_through.append(now_s)
        return None

    class Controller(Mpc):
        def plan(self, situation):
            plan = super().plan(situation)
            if on("solver fails", situation.start_s):
                raise SolverFailed("made to fail")
            if on("nan plan", situation.start_s):
                return nan_plan(plan)
            return wild_plan(plan) if on("wild plan", situation.start_s) else plan

    class Predictor(ConstantVelocity):
        def forecast(self, times_s):
            if on("predictor raises", clock.now_s()):
                raise np.linalg.LinAlgError("made to fail")
            return super().forecast(times_s)

    result = run_live(
        clock=clock,
        change=change,
        on_read=on_read,
        on_send=on_send,
        controller=Controller(NECK, horizon_s=0.3),
        predictor=Predictor(),
        planner=lambda controller: Late(controller, clock, lambda now: 0.1 if on("late plan", now) else 0.0),
        duration_s=3.0,
    )
    received = np.array([p for _, p in result.robot.received])
    breaks = sorted({k for k in silent if k < len(received)})
    assert_within_limits(received, breaks=breaks, ends=len(received) not in silent)
    assert len(result.joined("command_position_rad")) == result.report.ticks
    assert result.robot.calls[-1] == result.source.calls[-1] == "close"


# --- the same as a replay


def test_on_a_simulated_clock_a_live_run_is_the_replay():
    placed = place(load("subject05_R6"), "recorded", 2.5, 1.2)
    run_settings = RunSettings()
    replayed, _ = replay(placed, NECK, SENSOR, "mpc", run_settings)
    first_m = observe(placed, SENSOR, 0)[0].observation.head_position_base_m
    live = run_live(
        walk=placed,
        controller=make_controller("mpc", NECK, run_settings),
        predictor=make_predictor("walker", run_settings, None),
        start_rad=look_at(NECK.geometry, first_m).angles_rad,
        duration_s=None,
    )
    n = replayed.time_s.size
    for name in ("time_s", "command_position_rad", "joint_position_rad", "head_true_base_m"):
        np.testing.assert_allclose(live.joined(name)[:n], getattr(replayed, name), atol=1e-9, rtol=0)
    m = replayed.capture_time_s.size
    for name in ("capture_time_s", "arrival_time_s", "head_observed_base_m", "forecast_mean_base_m"):
        np.testing.assert_allclose(live.joined(name)[:m], getattr(replayed, name), atol=1e-9, rtol=0)
    assert live.joined("event_name").tolist() == replayed.event_name.tolist()
    # What follows is the stop.
    assert len(live.joined("time_s")) - n < 0.4 / TS


# --- logs


def test_logs_of_one_second_join_to_the_log_of_the_whole_run_and_nothing_is_kept():
    alive = []

    def run_short():
        logs = []

        def keep(log, times):
            gc.collect()
            alive.append(sum(o.ticks for o in gc.get_objects() if isinstance(o, LoopRecorder)))
            logs.append((log, times))

        result = run_live(keep=keep, log_s=1.0, change=lambda now, s: [] if 3.0 <= now < 7.5 else [s])
        result.logs = logs
        return result

    short = run_short()
    whole = run_live(change=lambda now, s: [] if 3.0 <= now < 7.5 else [s])
    assert len(short.logs) == -(-short.report.ticks // 200)
    assert all(log.time_s.size == 200 for log, _ in short.logs[:-1])
    for field in dataclasses.fields(whole.logs[0][0]):
        if field.name not in ("about", "event_time_s", "event_name", "forecast_true_base_m", "forecast_horizon_s"):
            np.testing.assert_array_equal(short.joined(field.name), getattr(whole.logs[0][0], field.name))
    assert short.events == whole.events
    for name in ("update_ms", "step_ms", "latency_ms"):
        joined = np.concatenate([getattr(times, name) for _, times in short.logs])
        assert joined.size == getattr(whole.logs[0][1], name).size
    # While one log is being kept no more than its own ticks are in memory.
    assert max(alive) <= 200


# --- on the real clock


class Hampered(Mpc):
    """Plans slowly, or never, once it is under way."""

    def __init__(self, hamper):
        super().__init__(NECK, horizon_s=0.3)
        self.hamper, self.plans = hamper, 0

    def plan(self, situation):
        self.plans += 1
        if self.plans > 3:
            self.hamper()
        return super().plan(situation)


def compute_100_ms():
    until_s = time.perf_counter() + 0.1
    while time.perf_counter() < until_s:
        sum(range(100))


@pytest.mark.parametrize("hamper", [lambda: time.sleep(0.1), compute_100_ms])
def test_on_the_real_clock_a_slow_solver_holds_up_no_command(hamper):
    controller = Hampered(hamper)
    result = run_live(clock=RealClock(), controller=controller, planner=BackgroundPlanner, duration_s=1.5)
    assert_sound(result)
    assert "late_plan" in result.events
    assert not result.events & {"controller_failed", "solver_failed", "robot_not_answering", "forecast_failed"}
    assert controller.plans > 5
    # Asked within the tick, there would be one tick a plan.
    assert result.report.ticks > 2 * controller.plans
    assert result.report.lateness.count == result.report.ticks
    assert np.ptp(result.joined("command_position_rad")[:, 0]) > 0.01


def test_a_controller_that_never_returns_keeps_nobody_waiting():
    released = threading.Event()
    controller = Hampered(lambda: released.wait(30.0))
    try:
        result = run_live(clock=RealClock(), controller=controller, planner=BackgroundPlanner, duration_s=0.8)
        assert not released.is_set()
        assert controller.plans == 4
    finally:
        released.set()
    assert_sound(result)
    assert {"late_plan", "stale_plan"} <= result.events
    assert result.report.stopped_by == "duration"
    thread = next((t for t in threading.enumerate() if t.name == "planner"), None)
    if thread is not None:
        thread.join(10.0)
        assert not thread.is_alive()


def test_the_background_planner_takes_one_request_at_a_time_and_answers_all():
    gate = threading.Semaphore(0)

    class Gated:
        def plan(self, situation):
            gate.acquire()
            if situation == "fail":
                raise SolverFailed("made to fail")
            raise ZeroDivisionError

    planner = BackgroundPlanner(Gated())

    def answered():
        until_s = time.monotonic() + 20.0
        while time.monotonic() < until_s:
            if answers := planner.answers():
                return answers
            time.sleep(0.001)
        raise AssertionError("no answer")

    assert planner.answers() == []
    for index, (situation, event) in enumerate([("fail", "solver_failed"), ("bug", "controller_failed")]):
        assert planner.request(index, situation)
        assert not planner.request(99, situation)
        gate.release()
        (answer,) = answered()
        assert isinstance(answer, Answer)
        assert (answer.due_index, answer.plan, answer.event) == (index, None, event)
        assert answer.plan_ms >= 0
    planner.close()
    planner.close()


# --- clocks and lateness


@pytest.mark.parametrize("seed", range(5))
def test_percentiles_of_lateness_are_numpy_s_within_a_bin(seed):
    rng = np.random.default_rng(seed)
    values = rng.gamma(0.5, 2.0, size=int(rng.integers(1, 5000)))
    values[rng.random(values.size) < 0.2] *= -0.1
    lateness = Lateness()
    for value in values:
        lateness.add(float(value))
    assert lateness.count == values.size
    assert lateness.max_ms == max(values.max(), 0.0)
    clipped = np.maximum(values, 0.0)
    for percent in (0, 1, 25, 50, 90, 99, 99.9, 100):
        exact = float(np.percentile(clipped, percent, method="inverted_cdf"))
        found = lateness.percentile_ms(percent)
        assert -1e-9 <= found - exact <= 0.01 + 1e-9
    for limit_ms in (0.1, 1.0, 5.0, 150.0):
        expected = np.sum(clipped >= limit_ms)
        near = np.sum(np.abs(clipped - limit_ms) <= 0.011)
        assert abs(lateness.beyond(limit_ms) - expected) <= near


def test_lateness_of_nothing_and_beyond_its_range():
    lateness = Lateness()
    assert (lateness.count, lateness.max_ms, lateness.percentile_ms(99), lateness.beyond(1.0)) == (0, 0.0, 0.0, 0)
    for value in (0.5, 0.5, 300.0, 900.0):
        lateness.add(value)
    assert lateness.percentile_ms(50) == pytest.approx(0.5, abs=0.011)
    assert lateness.percentile_ms(99) == lateness.max_ms == 900.0
    assert lateness.beyond(1.0) == 2


def test_the_real_clock_never_wakes_early_and_does_not_wait_for_the_past():
    clock = RealClock()
    assert 0 <= clock.now_s() < 10
    for ahead_s in (0.0, 1e-5, 3e-4, 0.002, 0.01, -1.0):
        until_s = clock.now_s() + ahead_s
        clock.sleep_until_s(until_s)
        assert clock.now_s() >= until_s


class FakeTime:
    """The computer's two clocks, in the hands of a test."""

    def __init__(self, monkeypatch):
        self.monotonic_s, self.unix_s = 1000.0, 1.7e9
        monkeypatch.setattr(time, "monotonic", lambda: self.monotonic_s)
        monkeypatch.setattr(time, "time", lambda: self.unix_s)

    def pass_s(self, seconds):
        self.monotonic_s += seconds
        self.unix_s += seconds


def test_unix_stamps_are_converted_and_a_step_of_the_unix_clock_is_named_once(monkeypatch):
    fake = FakeTime(monkeypatch)
    clock = RealClock()
    fake.pass_s(5.0)
    assert clock.now_s() == pytest.approx(5.0)
    assert clock.from_unix_s(1.7e9 + 4.9) == pytest.approx(4.9, abs=1e-6)
    assert not clock.unix_clock_stepped()
    for step_s in (3600.0, -7200.0, 0.5):
        fake.unix_s += step_s
        fake.pass_s(0.1)
        assert clock.unix_clock_stepped()
        assert not clock.unix_clock_stepped()
        # The time of the loop goes on; stamps of the new clock are right again.
        assert clock.from_unix_s(fake.unix_s) == pytest.approx(clock.now_s(), abs=1e-6)
    fake.unix_s += 0.002  # the clock is slewed, not set
    assert not clock.unix_clock_stepped()
    assert clock.now_s() == pytest.approx(5.3)


def test_a_step_of_the_unix_clock_is_in_the_log(monkeypatch):
    clock = RealClock()
    stepped = []

    def once():
        stepped.append(clock.now_s())
        return len(stepped) == 20

    monkeypatch.setattr(clock, "unix_clock_stepped", once)
    result = run_live(clock=clock, duration_s=0.3)
    assert result.event_s("clock_stepped").size == 1
    assert_sound(result)


def test_the_simulated_clock_never_runs_backwards():
    clock = SimulatedClock()
    clock.sleep_until_s(2.0)
    clock.sleep_until_s(1.0)
    assert clock.now_s() == 2.0


def test_a_robot_that_raises_when_it_is_asked_to_close_twice_is_not(monkeypatch):
    """Each part is closed exactly when the run ends, also after a run that ended in order."""
    result = run_live(duration_s=0.2)
    assert result.robot.calls == ["connect", "close"]
    assert result.source.calls == ["open", "close"]
    with contextlib.suppress(RobotError):
        result.robot.inner.read_state()
        pytest.fail("the neck is still connected")


# --- what a fresh reader found


class Jittery(SimulatedClock):
    """Wakes up late by 0 to 2 ms, as a real computer does."""

    def __init__(self):
        super().__init__()
        self._rng = np.random.default_rng(0)

    def sleep_until_s(self, time_s):
        super().sleep_until_s(time_s + self._rng.uniform(0.0, 0.002))


def test_commands_do_not_jitter_with_the_clock():
    """Made for when ticks are due; made for when they are done, most would be a chase at the limit of jerk."""

    def hurried(result):
        acceleration = result.joined("command_acceleration_rad_s2")
        jerk = np.abs(np.diff(acceleration, axis=0)) / TS
        return float(np.mean(jerk > 0.9 * NECK.command_limits.jerk_max_rad_s3))

    steady, jittery = undisturbed(), run_live(clock=Jittery())
    assert jittery.report.lateness.max_ms > 1.5
    assert hurried(jittery) < hurried(steady) + 0.05
    commands = [r.joined("command_position_rad") for r in (steady, jittery)]
    n = min(map(len, commands))
    assert np.degrees(np.abs(commands[0][:n] - commands[1][:n]).max()) < 1.0


def test_with_a_plan_at_every_tick_no_plan_is_missed():
    """A plan that is there before the next tick leaves the planner free for it."""
    neck = NECK.model_copy(update={"servo_rate_hz": 50.0, "control_rate_hz": 50.0})
    clock = SimulatedClock()
    controller = Mpc(neck, horizon_s=0.3)
    source = Faulty(clock, None, None, WALK)
    robot = SimulatedNeck(neck, look_at(neck.geometry, WALK.truth.head_position_m[0]).angles_rad, clock.now_s)
    logs = []
    run = LiveRun(
        neck,
        ConstantVelocity(),
        controller,
        Late(controller, clock, lambda now: 0.015),
        robot,
        source,
        Mount(),
        clock,
        LoopSettings(compute_delay_s=0.02),
        {"neck": neck.model_dump()},
        lambda log, times: logs.append((log, times)),
    )
    report = run.run(threading.Event(), 3.0)
    (_, times), *_ = logs
    assert times.step_ms.size > 0.95 * (report.ticks - 10)


@pytest.mark.parametrize(("pan_deg", "tilt_deg"), [(75.0, 0.0), (-79.9, 40.0)])
def test_a_neck_in_the_last_bit_of_its_range_is_brought_in_slowly(pan_deg, tilt_deg):
    """An underdamped servo leaves commands less room than joints: clipped at once, the first one would be a jump."""
    axes = {name: getattr(NECK, name).model_copy(update={"damping_ratio": 0.4}) for name in ("pan", "tilt")}
    neck = NECK.model_copy(update=axes)
    start_rad = np.radians([pan_deg, tilt_deg])
    limits = neck.command_limits
    assert np.any(start_rad != limits.clip_position(start_rad))
    way = way_in_rad(neck, start_rad)
    motion = np.vstack([start_rad, way])
    assert np.abs(np.diff(motion, axis=0)).max() <= 0.3 * neck.servo_period_s + 1e-9
    assert np.all(np.abs(np.diff(motion, 2, axis=0)) / neck.servo_period_s**2 <= limits.acceleration_max_rad_s2 + 1e-6)
    np.testing.assert_allclose(way[-1], limits.clip_position(start_rad), atol=1e-9)
    assert way_in_rad(neck, np.zeros(2)).shape == (0, 2)


def test_a_neck_that_stands_outside_its_range_is_not_moved():
    outside = np.radians([120.0, 0.0])

    def on_read(now_s, state):
        return dataclasses.replace(state, position_rad=outside)

    commands = []
    with pytest.raises(RobotError, match=r"pan 120\.0, tilt 0\.0 deg, outside its range"):
        run_live(on_read=on_read, on_send=commands.append)
    assert commands == []


def test_an_interrupt_in_mid_motion_brakes_first():
    sent = []

    def on_send(now_s):
        if now_s >= 2.0 and not sent:
            sent.append(now_s)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_live(on_send=on_send)
    assert sent


def test_a_real_robot_needs_its_own_neck_file(tmp_path, capsys):
    assert main(["--source", "udp:5005", "--robot", "dynamixel", "--out", str(tmp_path)]) == 2
    assert "--neck" in capsys.readouterr().err
