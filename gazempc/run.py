"""Replay a walk and show what prediction is worth: `python -m gazempc.run --replay subject03_R4`."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import tyro
import yaml

from gazempc.errors import GazempcError, LimitViolationError
from gazempc.progress import Progress
from gazempc.settings import PlacementName, RunSettings, load_settings

if TYPE_CHECKING:
    from gazempc.results.log import Log

_VIOLATION = 1
_BAD_INPUT = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, or 1 on a limit violation, 2 on bad input.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        settings = parse(words)
        if settings.list:
            print(_listing())
            return 0
        if settings.replay is None:
            raise GazempcError("nothing to replay: give --replay NAME_OR_PATH (see --list)")
        _run(settings)
    except BrokenPipeError:
        # Whoever read the output has seen enough, as in "... --list | head"; nothing more can be said to them.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except LimitViolationError as error:
        print(f"gazempc: {error}", file=sys.stderr)
        return _VIOLATION
    except (GazempcError, OSError) as error:
        print(f"gazempc: {error}", file=sys.stderr)
        return _BAD_INPUT
    return 0


def parse(words: Sequence[str]) -> RunSettings:
    """Settings from the command line, on top of those from `--config`.

    Args:
        words: Command line without the program's name.

    Returns:
        The settings.

    Raises:
        SettingsError: If the file of `--config` is wrong.
        SystemExit: If the command line is wrong (status 2) or asks for help (status 0).
    """
    config = _config_path(words)
    base = RunSettings() if config is None else load_settings(config)
    return tyro.cli(RunSettings, default=base, args=list(words), prog="python -m gazempc.run", description=__doc__)


def _config_path(words: Sequence[str]) -> Path | None:
    for i, word in enumerate(words):
        if word == "--config" and i + 1 < len(words):
            return Path(words[i + 1])
        if word.startswith("--config="):
            return Path(word.removeprefix("--config="))
    return None


def _listing() -> str:
    from gazempc.neck.spec import load_neck, neck_names  # noqa: PLC0415
    from gazempc.recordings.synthetic.walks import synthetic_names  # noqa: PLC0415
    from gazempc.sim.sensor import load_sensor, sensor_names  # noqa: PLC0415

    names = synthetic_names()
    lines = [
        "Recordings (synthetic, generated from the name; 14 people x 6 routes):",
        f"  {names[0]} ... {names[-1]}",
        "  R1, R2 straight; R3, R4 turn left, right; R5, R6 turn sharply left, right",
        "Recordings of your own, by path:",
        "  .csv, .parquet  columns t, head_{x,y,z}, head_q{w,x,y,z}, pelvis_{x,y,z}, pelvis_q{w,x,y,z}",
        "  .json           Azure Kinect Body Tracking, offline_processor",
        "  .bvh            motion capture with head and hips joints",
        "Necks (or a .toml file):",
    ]
    lines += [f"  {name:<14}  {load_neck(name).source}" for name in neck_names()]
    lines.append("Sensors (or a .toml file):")
    lines += [f"  {name:<14}  {load_sensor(name).source}" for name in sensor_names()]
    return "\n".join(lines)


def _run(settings: RunSettings) -> None:
    progress = Progress()
    # Heavy libraries are imported only here, so that --help and bad input answer at once.
    from gazempc.neck.spec import load_neck  # noqa: PLC0415
    from gazempc.recordings.load import load  # noqa: PLC0415
    from gazempc.recordings.placement import place  # noqa: PLC0415
    from gazempc.results.log import ComputeTimes  # noqa: PLC0415
    from gazempc.results.metrics import measure, measure_compute  # noqa: PLC0415
    from gazempc.results.report import LABELS, make_rows, sentence, table, write_summary  # noqa: PLC0415
    from gazempc.sim.replay import replay  # noqa: PLC0415
    from gazempc.sim.sensor import default_sensor, load_sensor  # noqa: PLC0415

    recording = load(settings.replay or "", settings.reading)
    placement: PlacementName = settings.placement or ("recorded" if recording.has_robot else "side")
    neck = load_neck(settings.neck)
    sensor = load_sensor(settings.sensor or default_sensor(recording))
    placed = place(recording, placement, settings.distance_m, settings.height_m)
    out = settings.out or Path("out") / recording.name
    resolved = settings.model_copy(update={"placement": placement, "sensor": sensor.name, "out": out})

    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GazempcError(f"--out {out}: cannot make this folder: {error.strerror}") from None

    runs: dict[str, tuple[Log, ComputeTimes]] = {}
    for controller in dict.fromkeys(settings.controllers):
        progress.say(f"replaying {recording.name}: {LABELS[controller]}")
        runs[controller] = replay(placed, neck, sensor, controller, resolved, on_tick=progress.at)
    rows = make_rows(
        [
            (name, log.info()["predictor"], measure(log), measure_compute(times, neck.control_period_s))
            for name, (log, times) in runs.items()
        ]
    )

    for name, (log, times) in runs.items():
        log.save(out / f"{name}.npz")
        times.save(out / f"{name}_compute.npz")
    shown = resolved.model_dump(mode="json")
    (out / "settings.yaml").write_text(yaml.safe_dump(shown, sort_keys=False), encoding="utf-8")
    about = {"recording": recording.name, "kind": recording.kind, "settings": shown}
    write_summary(out / "summary.json", about, rows)

    heading = (recording.kind, f"{placed.times_s[-1]:.1f} s", recording.labels.description)
    print(f"{recording.name}: {', '.join(part for part in heading if part)}")
    print(
        f"neck {neck.name}, sensor {sensor.name} ({1e3 * sensor.latency_s:.0f} ms late), robot "
        + _standing(placement, recording.has_robot, settings.distance_m)
        + f"; scored from 1.0 s to the end\n\n{table(rows, neck)}\n\n{sentence(rows)}\n"
    )
    for name, (log, _) in runs.items():
        for event in dict.fromkeys(log.event_name.tolist()):
            if event != "no_observation_yet":  # every run begins with it
                print(f"  {LABELS[name]}: {event} {int((log.event_name == event).sum())} x")
    drawn = ""
    if settings.figures:
        progress.say("drawing")
        drawn = ", " + ", ".join(_draw({name: log for name, (log, _) in runs.items()}, out))
    print(f"Written to {out}/: summary.json, settings.yaml, a log (.npz) of each controller{drawn}")
    violations = sum(row.metrics.limit_violations for row in rows)
    if violations:
        raise LimitViolationError(f"{violations} violations of the limits of neck {neck.name}: see {out}/summary.json")


def _standing(placement: PlacementName, has_robot: bool, distance_m: float) -> str:
    if placement == "side":
        return f"{distance_m} m beside the walk"
    return "where the sensor stood" if has_robot else "at the origin of the recording"


def _draw(logs: dict[str, Log], out: Path) -> list[str]:
    from gazempc.results.figures import plots  # noqa: PLC0415
    from gazempc.results.figures.animation import animate  # noqa: PLC0415
    from gazempc.results.figures.overview import overview  # noqa: PLC0415

    figures = {
        "overview.png": overview,
        "birds_eye.png": plots.birds_eye,
        "angles.png": plots.angles,
        "gaze_error.png": plots.gaze_error,
        "gaze.gif": animate,
    }
    for name, draw in figures.items():
        draw(logs, out / name)
    return list(figures)


if __name__ == "__main__":
    sys.exit(main())
