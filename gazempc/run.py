"""Replay a walk and measure the benefit of prediction: `python -m gazempc.run --replay subject03_R4`."""

from __future__ import annotations

if __name__ == "__main__":
    from gazempc.signals import end_during_imports

    end_during_imports("gazempc run")

import sys
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import tyro
import yaml

from gazempc.command import TYRO_CONFIG, Progress, command_line, run_interruptible
from gazempc.errors import GazempcError, LimitViolationError
from gazempc.files.whole import begin_folder, naming, write_whole
from gazempc.loop.build import make_controller
from gazempc.loop.events import MEANINGS
from gazempc.neck.spec import NeckSpec, load_neck, neck_names
from gazempc.part_options import check_options, take_options
from gazempc.parts import CONTROLLER, PREDICTOR, TRUE_FUTURE
from gazempc.recordings.readers.table import remember_columns, shipped_mappings
from gazempc.recordings.recording import truth_of
from gazempc.recordings.synthetic.everyday import ACTIVITIES, everyday_names
from gazempc.recordings.synthetic.walks import synthetic_names
from gazempc.results.attention import attention_lines, measure_attention
from gazempc.results.log import Log
from gazempc.results.log_files import has_log, load_log, write_mcap
from gazempc.results.run_summary import label, write_summary
from gazempc.results.table import Repeats, measured_again, sentence, table
from gazempc.run_settings import RunSettings, config_path, load_settings
from gazempc.signals import Interrupted
from gazempc.sim.repeat import replay_repeatedly
from gazempc.sim.scene import Scene, make_scene
from gazempc.sim.sensor import load_sensor, sensor_names

# Known share of the true head below which a note is printed.
_KNOWN_SHARE = 0.9
# Maximum time after a signal to write the results so far.
_WRITE_S = 10.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, or 1 on a limit violation, 2 on bad input, 130 if interrupted: complete results are kept.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    return run_interruptible("gazempc", lambda: _work(parse(words), command_line("gazempc.run", words)), "", _WRITE_S)


def _work(settings: RunSettings, command: str) -> int:
    if settings.list:
        print(_listing())
        return 0
    if settings.replay is None:
        raise GazempcError("nothing to replay: set --replay NAME_OR_PATH (see --list)")
    path = Path(settings.replay)
    if path.suffix == ".npz" or (path.suffix == ".mcap" and has_log(path)):
        _measure(path, settings, command)
    else:
        _run(settings, command)
    return 0


def _listing() -> str:
    """Names of recordings, necks and sensors, and accepted file formats."""
    walks, everyday = synthetic_names(), everyday_names()
    lines = [
        "Recordings (synthetic, generated from the name; 14 people):",
        f"  {walks[0]} ... {walks[-1]}  walks on 6 routes; all: --recordings synthetic",
        "  R1, R2 straight; R3, R4 turn left, right; R5, R6 turn sharply left, right",
        f"  {everyday[0]} ... {everyday[-1]}  5 activities; all: --recordings everyday",
        f"  {', '.join(f'{name} ({about.description})' for name, about in ACTIVITIES.items())}",
        "Your own recordings, by path:",
        "  .csv, .parquet  columns t, head_{x,y,z}; optional head_q{w,x,y,z}, pelvis_{x,y,z}, pelvis_q{w,x,y,z}",
        "  .csv, .tsv, .txt, .parquet  any other columns, by --reading.columns or --guess; recognised:",
        f"    {', '.join(shipped_mappings())}",
        "  .mvnx           Xsens MVN",
        "  a folder        ROS 2 bag, or OpenPose --3d --write_json",
        "  .json           Azure Kinect Body Tracking, offline_processor",
        "  .bvh            motion capture of any exporter",
        "Necks (or a .toml file):",
    ]
    lines += [f"  {name:<14}  {load_neck(name).source}" for name in neck_names()]
    lines.append("Sensors (or a .toml file):")
    lines += [f"  {name:<14}  {load_sensor(name).source}" for name in sensor_names()]
    return "\n".join(lines)


def parse(words: Sequence[str]) -> RunSettings:
    """Settings from the command line, on top of those from `--config`.

    Args:
        words: Command line without the program's name.

    Returns:
        The settings.

    Raises:
        SettingsError: If the file of `--config` is wrong, or no chosen part takes an option.
        SystemExit: If the command line is wrong (status 2) or asks for help (status 0).
    """
    words, options = take_options(words)
    config = config_path(words)
    base = RunSettings() if config is None else load_settings(config)
    found = tyro.cli(
        RunSettings, config=TYRO_CONFIG, default=base, args=words, prog="python -m gazempc.run", description=__doc__
    )
    settings = found.model_copy(update={"options": {**base.options, **options}})
    choices = [(CONTROLLER, choice) for choice in settings.controllers]
    check_options([(PREDICTOR, settings.predictor), *choices], settings.options)
    return settings


def _run(settings: RunSettings, command: str) -> None:
    progress = Progress()
    scene = make_scene(settings.replay or "", settings, all_people=settings.attend is not None)
    out = settings.out or Path("out") / scene.name
    resolved = settings.model_copy(update={"placement": scene.placement, "sensor": scene.sensor.name, "out": out})
    with begin_folder(out):
        _replay(scene, resolved, out, command, progress)
    if remembered := remember_columns(Path(settings.replay or ""), settings.reading):
        print(remembered)


def _replay(scene: Scene, settings: RunSettings, out: Path, command: str, progress: Progress) -> None:
    walk, neck = scene.walk, scene.neck
    done = replay_repeatedly(scene, settings, settings.controllers, settings.noise_seeds, progress)
    repeats, seeds = done.repeats, list(done.repeats[0].seeds)
    logs = {name: log for name, (log, _) in done.first.items()}
    for name, (log, times) in done.first.items():
        log.save(out / f"{name}.npz")
        times.save(out / f"{name}_compute.npz")
        if settings.log == "mcap":
            write_mcap(log, out / f"{name}.mcap", done.plans[name])
    shown = settings.model_dump(mode="json") | {"noise_seeds": len(seeds)}
    write_whole(out / "settings.yaml", yaml.safe_dump(shown, sort_keys=False))
    against = truth_of(walk.kind)
    noted = _notes(next(iter(logs.values()))) + _margins(settings, neck)
    notes = [*walk.notes, *noted]
    about = {
        "recording": walk.name,
        "kind": walk.kind,
        "scored_against": against or "the true head",
        "notes": notes,
        "settings": shown,
        "faults": {name: [vars(fault) for fault in log.faults] for name, log in logs.items()},
        "noise": {"seeds": seeds, "rows": [r.as_dict() for r in repeats], "faults": done.faults},
    }
    if settings.several:
        about["attention"] = {name: asdict(measure_attention(log)) for name, log in logs.items()}
    write_summary(out / "summary.json", about, [r.first for r in repeats])

    print(f"{_heading(settings, scene)}\n{done.seeds_note}")
    for note in noted:
        print(f"Note: {note}")
    print(f"\n{table(repeats, neck, against)}\n\n{sentence(repeats)}\n")
    events = [f"{label(name)}: {line}" for name, log in logs.items() for line in _events(log)]
    other_seeds = [
        f"seed {seed}: exceptions of {', '.join(map(label, names))}: see summary.json"
        for seed, names in done.faults.items()
        if seed != seeds[0]
    ]
    for line in [*events, *other_seeds]:
        print(f"  {line}")
    try:
        if done.interrupted:
            raise done.interrupted
        progress.begin("writing the report")
        report, *drawn = _report(logs, repeats, [*notes, *other_seeds], settings.figures, out, command, shown)
    except Interrupted as stop:
        stop.add_note(f"{', '.join(logs)} with {len(seeds)} seed(s) of the noise are kept in {out}, without a report")
        raise
    of_each = f"a log (.npz{', .mcap' if settings.log == 'mcap' else ''}) and computing times of each controller"
    print(f"Written to {out}/: {', '.join([report, 'summary.json', 'settings.yaml', of_each, *drawn])}")
    if violations := sum(int(sum(r.values("limit_violations"))) for r in repeats):
        raise LimitViolationError(f"{violations} violations of the limits of neck {neck.name}: see {out}/summary.json")


def _measure(path: Path, settings: RunSettings, command: str) -> None:
    log = load_log(path)
    out = settings.out or Path("out") / path.stem
    logs, repeats = {log.run.controller: log}, measured_again(log)
    about = {"recording": log.run.recording, "kind": log.run.kind, "log": str(path), "settings": log.run.settings}
    # The folder of the log contains the other files of its run.
    with nullcontext() if path.resolve().parent == out.resolve() else begin_folder(out):
        write_summary(out / "summary.json", about, list(repeats.rows))
        print(f"{path}: log of {log.run.recording} ({log.run.mode}), evaluated again without a replay")
        print(f"\n{table([repeats], log.neck, truth_of(log.run.kind))}\n")
        for line in _events(log):
            print(f"  {line}")
        report, *drawn = _report(logs, [repeats], _notes(log), settings.figures, out, command, log.run.settings)
        print(f"Written to {out}/: {', '.join([report, 'summary.json', *drawn])}")


def _heading(settings: RunSettings, scene: Scene) -> str:
    walk = scene.walk
    known = "positions only" if walk.truth.positions_only else ""
    parts = (walk.kind, f"{walk.times_s[-1]:.1f} s", known, walk.labels.description)
    stands = (
        f"{settings.distance_m} m beside the walk"
        if scene.placement == "side"
        else "where the sensor stood"
        if scene.stands_at_sensor
        else "at the origin of the recording"
    )
    notes = "".join(f"  {note}\n" for note in walk.notes)
    view = scene.sensor.view
    sees = f", sees {view.horizontal_deg:g} x {view.vertical_deg:g} deg from its {view.on}" if view.limited else ""
    return (
        f"{walk.name}: {', '.join(filter(None, parts))}\n{notes}"
        f"neck {scene.neck.name}, sensor {scene.sensor.name} ({1e3 * scene.sensor.latency_s:.0f} ms late{sees}), robot "
        f"{stands}; scored from 1.0 s to the end"
    )


def _notes(log: Log) -> list[str]:
    """Notes on the whole table."""
    notes = []
    if "low_frame_rate" in log.event_name:
        rate_hz = 1.0 / float(np.median(np.diff(np.unique(log.capture_time_s))))
        notes.append(f"{rate_hz:.1f} frames a second: below 6 the gaze trails people who walk")
    known = np.isfinite(log.head_true_base_m).all(axis=1)
    if known.mean() < _KNOWN_SHARE:
        notes.append(
            f"the true head is known at {known.sum()} of {known.size} ticks, not in gaps of more than 0.2 s between "
            "frames: the gaze is scored there only"
        )
    return notes


def _margins(settings: RunSettings, neck: NeckSpec) -> list[str]:
    """Warnings about small stability margins of the MPC."""
    if not {"mpc", TRUE_FUTURE} & set(settings.controllers):
        return []
    # Local imports of slow libraries: --help and error messages without delay.
    from gazempc.controllers.mpc.mpc import Mpc  # noqa: PLC0415
    from gazempc.margins.margins import too_small  # noqa: PLC0415

    mpc = make_controller("mpc", neck, settings, {})
    return too_small(mpc) if isinstance(mpc, Mpc) else []


def _events(log: Log) -> list[str]:
    with_text = {fault.event for fault in log.faults}
    lines = [
        f"{event} {int((log.event_name == event).sum())} x"
        for event in dict.fromkeys(log.event_name.tolist())
        # Omitted: every run begins with no_observation_yet; the rate is a note on the whole run.
        if event not in ("no_observation_yet", "low_frame_rate", *with_text)
    ]
    return [*attention_lines(measure_attention(log)), *lines, *(fault.line for fault in log.faults)]


def _report(
    logs: dict[str, Log],
    repeats: list[Repeats],
    notes: list[str],
    figures: bool,
    out: Path,
    command: str,
    settings: dict[str, Any],
) -> list[str]:
    """Write the report and, if wanted, the figures; returns their names, the report's first."""
    from gazempc.results.figures.angles import angles  # noqa: PLC0415
    from gazempc.results.figures.animation import animate  # noqa: PLC0415
    from gazempc.results.figures.overview import attended, overview  # noqa: PLC0415
    from gazempc.results.figures.people import has_attention  # noqa: PLC0415
    from gazempc.results.page.run_page import run_page  # noqa: PLC0415
    from gazempc.results.page.write import write_page  # noqa: PLC0415

    draw = {"overview.png": overview, "angles.png": angles, "gaze.gif": animate} if figures else {}
    if figures and has_attention(logs):
        draw["attended.png"] = attended
    pictures = {out / name: draw_one for name, draw_one in draw.items()}
    for path, draw_one in pictures.items():
        with naming(path):
            draw_one(logs, path)
    return [write_page(run_page(logs, repeats, notes, MEANINGS, pictures, command, settings), out), *draw]


if __name__ == "__main__":
    sys.exit(main())
