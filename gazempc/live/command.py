"""Look at a person who is there now: `python -m gazempc.live --source udp:5005 --robot mujoco --neck neck.toml`."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Any

import numpy as np
import tyro

from gazempc.errors import GazempcError, LimitViolationError
from gazempc.live.clock import Clock, RealClock, SimulatedClock
from gazempc.live.lateness import Lateness
from gazempc.live.settings import LiveSettings, check, make_source, placed_recording

if TYPE_CHECKING:
    from gazempc.live.run import LiveReport
    from gazempc.live.sources.source import Source
    from gazempc.neck.spec import NeckSpec
    from gazempc.recordings.recording import Recording
    from gazempc.results.log import ComputeTimes, Log
    from gazempc.types import FloatArray

_VIOLATION = 1
_BAD_INPUT = 2
_LATE_MS = 1.0
_SWITCH_S = 0.0005
_TIMES_TO_END = 2
_SHOWN_PROBLEMS = 5


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0 after a run that was stopped in order, by a signal, too; 1 on a limit violation; 2 on bad input,
        or a robot or source that cannot be opened.
    """
    stop = threading.Event()
    try:
        settings = tyro.cli(LiveSettings, args=arguments, prog="python -m gazempc.live", description=__doc__)
        check(settings)
        with _stopped_by_signals(stop):
            _run(settings, stop)
    except BrokenPipeError:
        # Whoever read the output has seen enough; nothing more can be said to them.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except LimitViolationError as error:
        print(f"gazempc.live: {error}", file=sys.stderr)
        return _VIOLATION
    except (GazempcError, OSError) as error:
        print(f"gazempc.live: {error}", file=sys.stderr)
        return _BAD_INPUT
    return 0


def _run(settings: LiveSettings, stop: threading.Event) -> None:
    from gazempc.live.run import LiveRun  # noqa: PLC0415
    from gazempc.loop.planner import BackgroundPlanner, ImmediatePlanner  # noqa: PLC0415
    from gazempc.neck.kinematics import look_at  # noqa: PLC0415
    from gazempc.neck.spec import load_neck  # noqa: PLC0415
    from gazempc.recordings.truth import TrueHead  # noqa: PLC0415
    from gazempc.robots.factory import make_robot, true_state_of  # noqa: PLC0415
    from gazempc.sim.replay import make_controller, make_predictor  # noqa: PLC0415

    neck = load_neck(settings.neck or "reference")
    settings.out.mkdir(parents=True, exist_ok=True)
    clock: Clock = SimulatedClock() if settings.simulated_clock else RealClock()
    placed = placed_recording(settings) if settings.source.partition(":")[0] == "replay" else None
    source = make_source(settings, clock, placed)
    person = placed.labels.subject if placed is not None else ""
    predictor = make_predictor(settings.predictor, settings, None if placed is None else TrueHead(placed), person)
    controller = make_controller(settings.controller, neck, settings)
    start_rad = neck.rest_rad
    if placed is not None:
        first_m = placed.truth.head_position_m[placed.truth.valid][0]
        start_rad = neck.command_limits.clip_position(look_at(neck.geometry, first_m).angles_rad)
    robot = make_robot(settings.robot, settings.options, neck, clock, start_rad, settings.seed)
    planner = ImmediatePlanner(controller) if settings.simulated_clock else BackgroundPlanner(controller)
    true_state = true_state_of(robot)
    kept = _Kept(settings, neck)
    run = LiveRun(
        neck,
        predictor,
        controller,
        planner,
        robot,
        source,
        settings.mount,
        clock,
        settings.loop,
        _about(settings, placed, neck, "true" if settings.simulated_clock else "measured"),
        kept.keep,
        settings.log_s,
        None if placed is None else _truth(placed, source),
        true_state,
    )
    print(f"gazempc.live: source {settings.source}, robot {settings.robot}, neck {neck.name}; Ctrl-C stops", flush=True)
    # The planner's thread must not hold the interpreter for longer than a tick can wait.
    sys.setswitchinterval(_SWITCH_S)
    try:
        run.run(stop, settings.duration_s)
    finally:
        summary = kept.summary(run.report)
        (settings.out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    print(_text(summary))
    drawn = kept.draw() if settings.figures else []
    print(f"Written to {settings.out}/: {', '.join(['summary.json', *kept.names, *drawn])}")
    if summary["limit_violations"]:
        raise LimitViolationError(
            f"{summary['limit_violations']} violations of the limits of neck {neck.name}, see "
            f"{settings.out}/summary.json"
        )


class _Kept:
    """Writes each log of a run, and remembers of it what the summary needs."""

    def __init__(self, settings: LiveSettings, neck: NeckSpec) -> None:
        self._settings, self._neck = settings, neck
        self._last: Log | None = None
        self._compute: ComputeTimes | None = None
        self._events: Counter[str] = Counter()
        self._violations = 0
        self._latency = Lateness()
        self.names: list[str] = []

    def keep(self, log: Log, times: ComputeTimes) -> None:
        """Take a complete log."""
        from gazempc.results.metrics import limit_violations  # noqa: PLC0415

        name = f"log_{len(self.names):03}.npz"
        log.save(self._settings.out / name)
        times.save(self._settings.out / f"compute_{len(self.names):03}.npz")
        self.names.append(name)
        self._last, self._compute = log, times
        self._events.update(log.event_name.tolist())
        for latency_ms in times.latency_ms:
            self._latency.add(float(latency_ms))
        if log.time_s.size > 3:
            self._violations += limit_violations(log, self._neck)

    def summary(self, report: LiveReport) -> dict[str, Any]:
        """Everything that is saved of the run besides the logs."""
        from gazempc.errors import LeftOutError  # noqa: PLC0415
        from gazempc.results.metrics import measure, measure_compute  # noqa: PLC0415
        from gazempc.results.report import versions  # noqa: PLC0415

        metrics: dict[str, Any] | None = None
        compute: dict[str, Any] | None = None
        if self._last is not None and self._compute is not None:
            try:
                metrics = _without_nan(measure(self._last).as_dict())
            except LeftOutError:
                metrics = None  # too short to be scored
            compute = _without_nan(measure_compute(self._compute, self._neck.control_period_s).as_dict())
        late, latency = report.lateness, self._latency
        known = latency.count > 0
        return {
            "stopped_by": report.stopped_by,
            "ticks": report.ticks,
            "skipped_ticks": report.skipped_ticks,
            "lateness_ms": {"p50": late.percentile_ms(50), "p99": late.percentile_ms(99), "max": late.max_ms},
            "late_ticks": late.beyond(_LATE_MS),
            "end_to_end_latency_ms": {
                "p50": latency.percentile_ms(50) if known else None,
                "p99": latency.percentile_ms(99) if known else None,
            },
            "observations": report.observations,
            "bad_observations": report.n_problems,
            "problems": report.problems,
            "events": dict(sorted(self._events.items())),
            "limit_violations": self._violations,
            "metrics_of_last_log": metrics,
            "compute_of_last_log": compute,
            "logs": self.names,
            "settings": self._settings.model_dump(mode="json"),
            "versions": versions(),
        }

    def draw(self) -> list[str]:
        """Draw the last log; the names of the figures."""
        from gazempc.results.figures import plots  # noqa: PLC0415

        if self._last is None or self._last.time_s.size < 2:
            return []
        logs: dict[str, Log] = {self._settings.controller: self._last}
        plots.angles(logs, self._settings.out / "angles.png")
        return ["angles.png"]


def _about(settings: LiveSettings, placed: Recording | None, neck: NeckSpec, joints: str) -> dict[str, Any]:
    live = placed is None
    return {
        "recording": settings.source if placed is None else placed.name,
        "kind": "live" if placed is None else placed.kind,
        "subject": "unknown" if placed is None else placed.labels.subject,
        "group": None if placed is None else placed.labels.group,
        "controller": settings.controller,
        "predictor": settings.predictor,
        "neck": neck.model_dump(),
        "sensor": {"name": "live" if live else settings.sensor or "reference"},
        "seed": settings.seed,
        "robot": settings.robot,
        "joints": joints,
        "settings": settings.model_dump(mode="json", exclude={"out", "figures"}),
    }


def _truth(placed: Recording, source: Source) -> Callable[[FloatArray], FloatArray]:
    """The recording's true head on the loop's clock."""
    from gazempc.live.sources.replay import ReplaySource  # noqa: PLC0415
    from gazempc.recordings.truth import TrueHead  # noqa: PLC0415

    true_head = TrueHead(placed)

    def at(times_s: FloatArray) -> FloatArray:
        own_s = times_s - (source.start_s if isinstance(source, ReplaySource) else 0.0)
        return np.where(true_head.known(own_s)[:, None], true_head(own_s), np.nan)

    return at


@contextmanager
def _stopped_by_signals(stop: threading.Event) -> Iterator[None]:
    """SIGINT, SIGTERM and SIGHUP set the event instead of ending the process; the third ends it."""
    times = 0

    def told(number: int, frame: FrameType | None) -> None:
        nonlocal times
        times += 1
        stop.set()
        if times == _TIMES_TO_END:
            # A driver that hangs: what is left is to end at once.
            for each in before:
                signal.signal(each, signal.SIG_DFL)

    numbers = (
        (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if threading.current_thread() is threading.main_thread() else ()
    )
    before = {number: signal.signal(number, told) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _without_nan(figures: dict[str, Any]) -> dict[str, Any]:
    return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in figures.items()}


def _text(summary: dict[str, Any]) -> str:
    late, latency = summary["lateness_ms"], summary["end_to_end_latency_ms"]
    lines = [
        f"stopped by: {summary['stopped_by']}",
        f"{summary['ticks']} ticks, {summary['skipped_ticks']} skipped; later than due by {late['p50']:.2f} ms (p50), "
        f"{late['p99']:.2f} ms (p99), {late['max']:.2f} ms (max)",
        f"{summary['observations']} observations, {summary['bad_observations']} could not be used",
    ]
    if latency["p50"] is not None:
        lines.append(f"from capture to command: {latency['p50']:.0f} ms (p50), {latency['p99']:.0f} ms (p99)")
    metrics = summary["metrics_of_last_log"]
    if metrics is not None and metrics["gaze_error_rms_deg"] is not None:
        lines.append(
            f"gaze error {metrics['gaze_error_rms_deg']:.2f} deg RMS, eye contact (2.6 deg) "
            f"{100 * metrics['eye_contact_2p6']:.0f} %, against the recording's true head"
        )
    lines.append(f"limit violations: {summary['limit_violations']}")
    lines += [f"  {name} {count} x" for name, count in summary["events"].items()]
    lines += [f"  {problem}" for problem in summary["problems"][:_SHOWN_PROBLEMS]]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
