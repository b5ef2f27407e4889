"""Parts that misbehave in a live run on the real clock: what they return and raise, and how long they take."""

from __future__ import annotations

import itertools
import random
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gazempc.controllers.controller import ControllerError, Plan
from gazempc.errors import RobotError
from gazempc.live.isolated import IsolatedPredictor
from gazempc.live.process import fast_switching, without_collection
from gazempc.live.run import LiveRun
from gazempc.live.settings import LiveSettings
from gazempc.live.setup import LiveSetup, build
from gazempc.live.sources.source import Arrived
from gazempc.neck.spec import NeckSpec
from gazempc.results.log import Log, load_log
from gazempc.types import JointState
from predictors import ConstantVelocity, Forecast, HeadObservation

Change = Callable[[Any], Any]
_FROM_S, _BLOCKED_S, _SLOW_S = 0.5, 1.0, 0.015
_WALK = "subject03_R4"


def _with(value: Any, **fields: Any) -> Any:
    """A frozen value with other fields, past its own checks."""
    other = replace(value)
    for name, new in fields.items():
        object.__setattr__(other, name, new)
    return other


def _raise(error: BaseException) -> Change:
    def change(answer: Any) -> Any:
        raise error

    return change


def _return(value: Any) -> Change:
    return lambda answer: value


def _exit(answer: Any) -> Any:
    sys.exit("leaving")


def _each(seconds: float) -> Change:
    """Take so long at each call."""

    def change(answer: Any) -> Any:
        time.sleep(seconds)
        return answer

    return change


def _compute(answer: Any) -> Any:
    until_s = time.perf_counter() + 0.05
    while time.perf_counter() < until_s:
        pass
    return answer


def _hold_lock(answer: Any) -> Any:
    """One call in C that does not release the interpreter's lock."""
    sum(range(4_000_000))
    return answer


class Once:
    """Takes long once."""

    def __init__(self, take: Change) -> None:
        self._take: Change | None = take

    def __call__(self, answer: Any) -> Any:
        """Take long at the first call, then no more."""
        take, self._take = self._take, None
        return answer if take is None else take(answer)


def _plan(change: Callable[[Plan], dict[str, Any]]) -> Change:
    return lambda p: _with(p, **change(p))


def _joints(change: Callable[[JointState], dict[str, Any]]) -> Change:
    return lambda s: _with(s, **change(s))


# What any call may do. Each family below adds what only it may return.
_ANY: dict[str, Callable[[], Change]] = {
    "raises": lambda: _raise(ValueError("made to fail")),
    "raises BaseException": lambda: _raise(BaseException("made to fail")),
    "sys.exit": lambda: _exit,
    "blocks for 1 s": lambda: Once(_each(_BLOCKED_S)),
    "15 ms each": lambda: _each(_SLOW_S),
}
_ANSWERS: dict[str, Callable[[], Change]] = {"text": lambda: _return("text"), "None": lambda: _return(None)}
_ARRAYS: dict[str, Callable[[Any], Any]] = {
    "lists": lambda a: a.tolist(),
    "complex": lambda a: a + 1j,
    "objects": lambda a: a.astype(object),
    "text": lambda a: a.astype(str),
    "NaN": lambda a: a * np.nan,
    "infinite": lambda a: a + np.inf,
}


def _field(name: str) -> dict[str, Callable[[], Change]]:
    """Each bad array in a field of what is returned."""

    def make(bad: Change) -> Callable[[], Change]:
        return lambda: lambda v: _with(v, **{name: bad(getattr(v, name))})

    return {f"{name}: {kind}": make(bad) for kind, bad in _ARRAYS.items()}


def _arrays() -> dict[str, Callable[[], Change]]:
    """Each bad array in place of a good one; lists are accepted."""

    def make(bad: Change) -> Callable[[], Change]:
        return lambda: bad

    return {kind: make(bad) for kind, bad in _ARRAYS.items() if kind != "lists"}


_OF_PLAN = ("position_rad", "velocity_rad_s", "acceleration_rad_s2")
_random = random.Random(0)


def _now_and_then(answer: Any) -> Any:
    if _random.random() < 0.4:
        raise OSError("no acknowledgement")
    return answer


FAMILIES: dict[str, dict[str, Callable[[], Change]]] = {
    "none": {"none": lambda: lambda answer: answer},
    "Controller.plan": {
        **_ANY, **_ANSWERS, **_field("position_rad"), **_field("velocity_rad_s"),
        "ControllerError": lambda: _raise(ControllerError("no plan")),
        "three joints": lambda: _plan(lambda p: {n: np.zeros((len(p.position_rad), 3)) for n in _OF_PLAN}),
        "events None": lambda: _plan(lambda p: {"events": None}),
        "faults None": lambda: _plan(lambda p: {"faults": None}),
        "50 rad outside": lambda: _plan(lambda p: {"position_rad": p.position_rad + 50.0}),
        "1e9 rad/s": lambda: _plan(lambda p: {"velocity_rad_s": p.velocity_rad_s + 1e9}),
        "leaps by 1 rad": lambda: _plan(lambda p: {"position_rad": p.position_rad + np.sign(np.sin(70 * p.start_s))}),
        "of the past": lambda: _plan(lambda p: {"start_s": p.start_s - 9.0}),
        "computes 50 ms each": lambda: _compute,
    },
    "Controller.forecast_times_s": {
        **_ANY, **_ANSWERS, **_arrays(),
        "none at all": lambda: _return(np.empty(0)),
        "100,000 times": lambda: lambda t: np.linspace(t[0], t[0] + 1.0, 100_000),
        "in a year": lambda: lambda t: t + 3e7,
    },
    "Predictor.update": _ANY,
    "Predictor.forecast": {
        **_ANY, **_ANSWERS, **_field("means_base_m"), **_field("covariances_m2"),
        "1e200 m away": lambda: lambda f: _with(f, means_base_m=f.means_base_m * 1e200),
        "one time less": lambda: lambda f: _with(f, times_s=f.times_s[:-1]),
    },
    "Robot.read_state": {
        **_ANY, **_ANSWERS, **_field("position_rad"),
        "RobotError": lambda: _raise(RobotError("unplugged")),
        "three joints": lambda: _joints(lambda s: {"position_rad": np.zeros(3)}),
        "time is text": lambda: _joints(lambda s: {"time_s": "now"}),
        "time is NaN": lambda: _joints(lambda s: {"time_s": np.nan}),
        "a year old": lambda: _joints(lambda s: {"time_s": s.time_s - 3e7}),
        "1e9 rad/s": lambda: _joints(lambda s: {"velocity_rad_s": s.velocity_rad_s + 1e9}),
        "1e9 rad": lambda: _joints(lambda s: {"position_rad": s.position_rad + 1e9}),
        "stand still": lambda: _joints(lambda s: {"position_rad": np.zeros(2)}),
        "drift by 0.5 rad/s": lambda: _joints(lambda s: {"position_rad": s.position_rad + 0.5 * (s.time_s - 1.0)}),
        "leap by 0.5 rad": lambda: _joints(lambda s: {"position_rad": s.position_rad + 0.5 * (s.time_s % 0.2 > 0.1)}),
    },
    "Robot.send_command": {
        **_ANY, **_ANSWERS, **_arrays(),
        "three joints": lambda: _return(np.zeros(3)),
        "1e9 rad": lambda: lambda sent: sent + 1e9,
        "raises now and then": lambda: _now_and_then,
    },
    "Robot.true_state": {**_ANY, **_ANSWERS, **_field("position_rad")},
    "Source.poll": {
        **_ANY, **_ANSWERS,
        "Arrived(None)": lambda: _return(Arrived(None)),  # type: ignore[arg-type]
        "sightings of text": lambda: _return(Arrived(("here",))),  # type: ignore[arg-type]
        "problems as bytes": lambda: _return(Arrived((), (b"raw",))),  # type: ignore[arg-type]
        "cues of text": lambda: _return(Arrived((), cues=("sound",))),  # type: ignore[arg-type]
        "each 100 times": lambda: lambda a: Arrived(a.sightings * 100),
    },
    "Source.finished": {**_ANY, "text": lambda: _return("")},
    "Robot.close": {k: v for k, v in _ANY.items() if "ms" not in k},
    "Source.close": {k: v for k, v in _ANY.items() if "ms" not in k},
}  # fmt: skip
_METHODS = (
    "reset", "update", "forecast", "forecast_times_s", "plan", "connect", "read_state", "true_state", "open", "poll",
    "close",
)  # fmt: skip
# These hold up commands whatever the loop does: the interpreter's lock is held, the command itself is not sent, or a
# simulator computes in the thread that sends.
_LOCKED = {"Controller.plan", "Predictor.update", "Predictor.forecast", "Robot.read_state", "Source.poll"}
HOLDS_UP = {(family, "holds the lock") for family in _LOCKED} | {
    (family, kind) for family in ("Robot.send_command", "Robot.true_state") for kind in ("blocks for 1 s", "15 ms each")
}
for _family in _LOCKED:
    FAMILIES[_family] = {**FAMILIES[_family], "holds the lock": lambda: Once(_hold_lock)}


FAMILIES["Predictor in a process of its own"] = {"holds the lock": lambda: lambda answer: answer}


class Holding(ConstantVelocity):
    """A predictor that holds the lock for long now and then."""

    forecasts = 0

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """See `predictors.predictor.Predictor.forecast`."""
        self.forecasts += 1
        if self.forecasts % 50 == 0:
            _hold_lock(None)
        return super().forecast(times_s)


@dataclass(frozen=True)
class PartCount:
    """What came of one run.

    Attributes:
        family: Part and method.
        kind: What it does wrong, from 0.5 s on.
        ended: Whether that ended the run.
        log_lost: Whether a log is missing, does not load or has not a row for each tick.
        commands: Commands handed to the robot.
        outside_limits: Differences of these beyond a limit of the neck.
        gap_max_ms: Longest time between two commands.
        named: The event with the part's class and the method; empty if there is none.
    """

    family: str
    kind: str
    ended: bool
    log_lost: bool
    commands: int
    outside_limits: int
    gap_max_ms: float
    named: str


class Wrong:
    """A part whose one method does something else from a time on; it keeps the commands that it is sent."""

    def __init__(self, inner: Any, method: str, change: Change, now_s: Callable[[], float]) -> None:
        self._inner, self._method, self._change, self._now_s = inner, method, change, now_s
        self.sent: list[tuple[float, Any]] = []
        for name in _METHODS:
            if hasattr(inner, name):
                setattr(self, name, self._changed(name))

    def _changed(self, name: str) -> Callable[..., Any]:
        call = getattr(self._inner, name)
        if name != self._method:
            return call  # type: ignore[no-any-return]

        def changed(*args: Any) -> Any:
            answer = call(*args)
            # `close` comes after the end, and a part may do wrong only once it is under way.
            return self._change(answer) if self._now_s() > _FROM_S else answer

        return changed

    def send_command(self, position_rad: Any) -> Any:
        """See `gazempc.robots.robot.Robot.send_command`."""
        self.sent.append((time.monotonic(), position_rad.copy()))
        return self._changed("send_command")(position_rad)

    @property
    def finished(self) -> Any:
        """See `gazempc.live.sources.source.Source.finished`."""
        wrong = self._method == "finished" and self._now_s() > _FROM_S
        return self._change(self._inner.finished) if wrong else self._inner.finished


def cases(short: bool = False) -> Iterator[tuple[str, str]]:
    """All kinds, with an undisturbed run before each family; a few with `short`."""
    for family, kinds in FAMILIES.items():
        if short and family not in ("none", "Controller.plan"):
            continue
        if family != "none":
            yield "none", "none"
        yield from ((family, kind) for kind in itertools.islice(kinds, 3 if short else None))


def run_part(family: str, kind: str, seconds: float = 1.8, neck: str = "reference") -> PartCount:
    """One run.

    Args:
        family: One of `FAMILIES`.
        kind: One of that family.
        seconds: How long.
        neck: The neck.

    Returns:
        What came of it.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        # Parts that are quick to make, a hundred times.
        settings = LiveSettings(source="replay", replay=_WALK, neck=neck, out=out)
        settings = settings.model_copy(update={"controller": "lookahead", "predictor": "constant_velocity"})
        setup = build(settings)
        begun_s = [np.inf]
        change = FAMILIES[family][kind]()
        isolated = IsolatedPredictor(Holding) if family == "Predictor in a process of its own" else None
        if isolated is not None:
            setup = replace(setup, predictor=isolated)
        setup, robot = _spoilt(setup, family, change, lambda: setup.clock.now_s() - begun_s[0])
        logs: list[Path] = []

        def keep(log: Log, times: object) -> None:
            logs.append(out / f"log_{len(logs)}.npz")
            log.save(logs[-1])

        run, ended = LiveRun(setup, keep), False
        with fast_switching(), without_collection():
            try:
                run.run(threading.Event(), seconds, lambda: begun_s.__setitem__(0, setup.clock.now_s()))
            except BaseException as error:
                if isinstance(error, KeyboardInterrupt):
                    raise
                ended = True
        rows = 0
        try:
            rows = sum(load_log(path).time_s.size for path in logs)
        except Exception as error:
            print(f"{family}, {kind}: {error}", file=sys.stderr)
    names = [f"{fault.event}: {fault.error}" for fault in run.logs.faults]
    return PartCount(
        family=family,
        kind=kind,
        ended=ended,
        log_lost=rows != run.report.ticks,
        commands=len(robot.sent),
        outside_limits=_outside(np.array([sent for _, sent in robot.sent]), setup.neck),
        gap_max_ms=round(1e3 * float(np.diff([at_s for at_s, _ in robot.sent]).max()), 1),
        named=next((name for name in names if "Wrong" in name), ""),
    )


def isolation_ms(calls: int = 2000) -> tuple[float, float]:
    """What a process of its own costs: time of a forecast there less the time of one here, milliseconds.

    Args:
        calls: How many.

    Returns:
        Median, and 99th percentile of the time there less the median here.
    """
    times_s = 0.1 + 0.02 * np.arange(25)
    isolated, took_ms = IsolatedPredictor(ConstantVelocity), []
    for predictor in (ConstantVelocity(), isolated):
        predictor.update(HeadObservation(0.0, np.array([2.0, 0.0, 0.4])))
        took_ms.append(np.empty(calls))
        for k in range(calls):
            began_s = time.perf_counter()
            predictor.forecast(times_s)
            took_ms[-1][k] = 1e3 * (time.perf_counter() - began_s)
    here, there = took_ms
    return tuple(round(float(np.percentile(there, p) - np.median(here)), 2) for p in (50, 99))  # type: ignore[return-value]


def _spoilt(setup: LiveSetup, family: str, change: Change, now_s: Callable[[], float]) -> tuple[LiveSetup, Wrong]:
    part, _, method = family.partition(".")

    def of(name: str, inner: object) -> Any:
        return Wrong(inner, method if part == name else "", change, now_s)

    robot = of("Robot", setup.robot)
    parts = {"controller": of("Controller", setup.controller), "predictor": of("Predictor", setup.predictor)}
    return replace(setup, robot=robot, source=of("Source", setup.source), **parts), robot


def _outside(sent_rad: Any, neck: NeckSpec) -> int:
    count = int(np.sum(~np.isfinite(sent_rad)))
    count += int(np.sum((sent_rad > neck.position_max_rad + 1e-9) | (sent_rad < neck.position_min_rad - 1e-9)))
    padded = np.vstack([np.tile(sent_rad[0], (3, 1)), sent_rad])
    limits = (neck.velocity_max_rad_s, neck.acceleration_max_rad_s2, neck.jerk_max_rad_s3)
    for order, limit in enumerate(limits, 1):
        moved = np.abs(np.diff(padded, order, axis=0)) / neck.servo_period_s**order
        count += int(np.sum(moved > limit * (1 + 1e-6)))
    return count
