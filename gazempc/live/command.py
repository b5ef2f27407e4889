"""Look at a person who is there now: `python -m gazempc.live --source udp:5005 --robot mujoco --neck neck.toml`."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace

import tyro

from gazempc.command import TYRO_CONFIG, command_line, run_command
from gazempc.errors import LimitViolationError
from gazempc.files.whole import begin_folder
from gazempc.live.aside import said_aside
from gazempc.live.process import fast_switching, stopped_by_signals, without_collection
from gazempc.live.settings import LiveSettings, check
from gazempc.part_options import take_options
from gazempc.robots.options import RobotOptions


def main(arguments: Sequence[str] | None = None, stop: threading.Event | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.
        stop: Set by the caller's signal handler. Without it this function handles the signals.

    Returns:
        Exit status. 0: the run has stopped in order, also by a signal. 1: a limit violation. 2: bad input, or a robot
        or source that cannot be opened.
    """
    words = sys.argv[1:] if arguments is None else arguments
    return run_command("gazempc.live", lambda: _work(words, stop))


def _work(words: Sequence[str], stop: threading.Event | None) -> int:
    settings, command = parse(words), command_line("gazempc.live", words)
    if stop is not None:
        _run(settings, stop, command)
        return 0
    stop = threading.Event()
    with stopped_by_signals(stop):
        _run(settings, stop, command)
    return 0


def parse(words: Sequence[str]) -> LiveSettings:
    """Settings from the command line.

    Args:
        words: Command line without the program's name.

    Returns:
        The settings, checked.

    Raises:
        GazempcError: If settings do not go together, or a part of your own cannot be found.
        SystemExit: If the command line is wrong (status 2) or asks for help (status 0).
    """
    words, own = take_options(_with_view(words), RobotOptions.model_fields)
    found = tyro.cli(LiveSettings, config=TYRO_CONFIG, args=words, prog="python -m gazempc.live", description=__doc__)
    settings = found.model_copy(update={"options": found.options.with_own(own)})
    check(settings)
    return settings


def _with_view(words: Sequence[str]) -> list[str]:
    """``--view`` alone is ``--view foxglove``."""
    found = list(words)
    for k, word in enumerate(words):
        if word == "--view" and (k + 1 == len(words) or words[k + 1].startswith("-")):
            found[k] = "--view=foxglove"
    return found


def _run(settings: LiveSettings, stop: threading.Event, command: str) -> None:
    # Heavy libraries are imported only here, so that --help and bad input answer at once.
    from gazempc.live.build import build  # noqa: PLC0415
    from gazempc.live.outlet import AttentionOutlet, attention_sink  # noqa: PLC0415
    from gazempc.live.parts import Keeping  # noqa: PLC0415
    from gazempc.live.robots import true_state_of  # noqa: PLC0415
    from gazempc.live.run import LiveRun  # noqa: PLC0415
    from gazempc.live.status_line import StatusLine  # noqa: PLC0415
    from gazempc.live.summary import Kept, last_line, text  # noqa: PLC0415
    from gazempc.live.view.start import start_viewers  # noqa: PLC0415

    begin_folder(settings.out)
    sink = attention_sink(settings)
    built = build(settings)
    if stop.is_set():
        built.parts.planner.close()
        print("gazempc.live: stopped before the robot was connected")
        return
    parts, neck = built.parts, built.parts.neck
    outlet = None if sink is None else AttentionOutlet(sink, parts.clock)
    viewers = start_viewers(settings, built)
    kept = Kept(settings, neck, None if viewers is None else viewers.feed.kept)
    status = StatusLine(neck.joint_names)
    keeping = Keeping(
        built.about,
        kept.keep,
        settings.log_s,
        true_state=true_state_of(parts.robot),
        show=status.show,
        tell=None if outlet is None else outlet.tell,
        watch=None if viewers is None else viewers.feed.watch,
    )
    if built.true_head_base_m is not None:
        keeping = replace(keeping, true_head_base_m=built.true_head_base_m)
    run = LiveRun(parts, keeping)
    print(f"gazempc.live: source {settings.source}, robot {settings.robot}, neck {neck.name}", flush=True)
    for note in (*built.notes, *(() if viewers is None else viewers.said)):
        print(f"  {note}", flush=True)
    try:
        with fast_switching(), without_collection(), status, outlet or nullcontext(), said_aside():
            run.run(stop, settings.duration_s, lambda: print("running; Ctrl-C stops", flush=True))
    except BaseException:
        # Whatever ended the run is told, and not that the summary of it cannot be written either.
        with suppress(OSError):
            kept.write(run)
        raise
    else:
        summary = kept.write(run)
    finally:
        if viewers is not None:
            viewers.feed.close()
    print(text(summary))
    for line in () if viewers is None else viewers.trouble:
        print(f"WARNING {line}")
    shown = () if viewers is None else viewers.files
    mcap = sorted(path.name for name in kept.names if (path := (settings.out / name).with_suffix(".mcap")).exists())
    drawn = kept.draw() if settings.figures else []
    written = [*kept.report(summary, drawn, command), "summary.json", *kept.files, *mcap, *shown, *drawn]
    print(f"Written to {settings.out}/: {', '.join(written)}")
    print(last_line(summary))
    if kept.violations:
        raise LimitViolationError(
            f"{kept.violations} violations of the limits of neck {neck.name}, see {settings.out}/summary.json"
        )
