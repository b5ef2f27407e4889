"""Look at a person in real time: `python -m gazempc.live --source udp:5005 --robot mujoco --neck neck.toml`."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from contextlib import closing, nullcontext, suppress

import tyro

from gazempc.command import TYRO_CONFIG, command_line, run_command
from gazempc.errors import LimitViolationError, SettingsError
from gazempc.files.whole import begin_folder
from gazempc.live.process import async_warnings, fast_switching, stopped_by_signals, without_collection
from gazempc.live.settings import LiveSettings, check, for_turning_camera
from gazempc.part_options import take_options
from gazempc.robots.options import RobotOptions


def main(arguments: Sequence[str] | None = None, stop: threading.Event | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.
        stop: Set by the caller's signal handler. Without it this function handles the signals.

    Returns:
        Exit status. 0: regular end, also by a signal. 1: a limit violation. 2: bad input, or a robot or source that
        cannot be opened.
    """
    words = sys.argv[1:] if arguments is None else arguments

    def work() -> int:
        settings, command = parse(words), command_line("gazempc.live", words)
        if settings.probe:
            _probe(settings)
            return 0
        event = stop or threading.Event()
        signals = stopped_by_signals(event) if stop is None else nullcontext()
        with signals, begin_folder(settings.out):
            _run(settings, event, command)
        return 0

    return run_command("gazempc.live", work)


def parse(words: Sequence[str]) -> LiveSettings:
    """Settings from the command line.

    Args:
        words: Command line without the program's name.

    Returns:
        The settings, checked.

    Raises:
        GazempcError: If settings are incompatible, or a user-defined part is not found.
        SystemExit: If the command line is wrong (status 2) or asks for help (status 0).
    """
    words, own = take_options(_with_view(words), RobotOptions.model_fields)
    found = tyro.cli(LiveSettings, config=TYRO_CONFIG, args=words, prog="python -m gazempc.live", description=__doc__)
    settings = for_turning_camera(found.model_copy(update={"options": found.options.with_own(own)}))
    check(settings)
    return settings


def _with_view(words: Sequence[str]) -> list[str]:
    """``--view`` alone is ``--view foxglove``."""
    found = list(words)
    for k, word in enumerate(words):
        if word == "--view" and (k + 1 == len(words) or words[k + 1].startswith("-")):
            found[k] = "--view=foxglove"
    if "--probe" in found and not any(word.startswith("--source") for word in found):
        # Nothing is read from it.
        found += ["--source", "stdin"]
    return found


def _probe(settings: LiveSettings) -> None:
    from gazempc.live.clock import RealClock  # noqa: PLC0415
    from gazempc.live.robots import make_robot  # noqa: PLC0415
    from gazempc.neck.spec import load_neck  # noqa: PLC0415
    from gazempc.robots.speed_camera import SpeedCamera  # noqa: PLC0415

    neck = load_neck(settings.scene.neck)
    robot = make_robot(settings.robot, settings.options, neck, RealClock(), neck.rest_rad)
    if not isinstance(robot, SpeedCamera):
        raise SettingsError(f"--probe: robot {settings.robot}; accepted: visca:HOST, onvif:HOST")
    for name, value in robot.probe():
        print(f"{name:<16}{value}")


def _run(settings: LiveSettings, stop: threading.Event, command: str) -> None:
    # Local imports of slow libraries: --help and error messages without delay.
    from gazempc.live.outlet import AttentionOutlet, make_sink  # noqa: PLC0415
    from gazempc.live.run import LiveRun  # noqa: PLC0415
    from gazempc.live.setup import build  # noqa: PLC0415
    from gazempc.live.status import StatusLine  # noqa: PLC0415
    from gazempc.live.summary import KeptLogs, last_line, text  # noqa: PLC0415
    from gazempc.live.view.viewers import start_viewers  # noqa: PLC0415

    sink = None if settings.attention_out is None else make_sink(settings.attention_out)
    setup = build(settings)
    if stop.is_set():
        print("gazempc.live: stopped before the robot was connected")
        return
    neck = setup.neck
    outlet = None if sink is None else AttentionOutlet(sink, setup.clock)
    status = StatusLine(neck, settings.loop.lost_after_s)
    feed = start_viewers(settings, setup)
    listeners = [status.take] if feed is None else [status.take, feed.take]
    kept = KeptLogs(settings, neck, None if feed is None else feed.kept)
    run = LiveRun(setup, kept.keep, listeners, None if outlet is None else outlet.report)
    print(f"gazempc.live: source {settings.source}, robot {settings.robot}, neck {neck.name}", flush=True)
    for note in (*setup.notes, *(() if feed is None else feed.notes)):
        print(f"  {note}", flush=True)
    with nullcontext() if feed is None else closing(feed):
        try:
            with fast_switching(), without_collection(), status, outlet or nullcontext(), async_warnings():
                run.run(stop, settings.duration_s, lambda: print("running; Ctrl-C stops", flush=True))
        except BaseException:
            # An exception of the summary must not mask that of the run.
            with suppress(Exception):
                kept.write(run)
            raise
        summary = kept.write(run)
    print(text(summary))
    for line in () if feed is None else feed.problems:
        print(f"WARNING {line}")
    mcap = sorted(path.name for name in kept.names if (path := (settings.out / name).with_suffix(".mcap")).exists())
    written = [*kept.report(summary, command), "summary.json", *kept.files, *mcap]
    print(f"Written to {settings.out}/: {', '.join([*written, *(() if feed is None else feed.files)])}")
    print(last_line(summary))
    if kept.violations:
        raise LimitViolationError(
            f"{kept.violations} violations of the limits of neck {neck.name}, see {settings.out}/summary.json"
        )
