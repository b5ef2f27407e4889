"""Measure a neck or a tracker, and write its file.

A new neck's file, from range and top speed of its data sheet: python -m gazempc.identify --new my_neck.toml

A neck is excited within its limits; its dead time and servo go to a neck file.

Example: python -m gazempc.identify --robot simulated --out my_neck.toml

Without a robot, from a log already recorded: python -m gazempc.identify --from-log log.npz --out my_neck.toml

A camera with speed commands is measured by its own picture, without encoders.

Example: python -m gazempc.identify --robot visca:HOST --source camera:rtsp://HOST/1 --neck my_camera.toml

A tracker is measured from a recording, preferably of a person at rest for 30 s; its errors go to a sensor file.

Example: python -m gazempc.identify --tracker my_bag --out my_tracker.toml
"""

from __future__ import annotations

import datetime
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from gazempc.command import TYRO_CONFIG, Progress, run_command
from gazempc.errors import GazempcError, RobotError, SettingsError
from gazempc.files.whole import write_whole
from gazempc.identify.excitation import ExcitationSettings, excite, moving_joints
from gazempc.identify.new_neck import DataSheet, write_new_neck
from gazempc.identify.record import IdentificationError, NeckRecord, load_record, record
from gazempc.identify.urdf import read_urdf
from gazempc.live.clock import Clock, RealClock, SimulatedClock
from gazempc.live.robots import first_position_rad, go_in, keeps_any_clock, make_robot
from gazempc.live.sources.camera.capture import CameraOptions
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.part_options import check_options, take_options
from gazempc.parts import ROBOT, error_line
from gazempc.results.log_files import load_log
from gazempc.robots.options import RobotChoice, RobotOptions


class IdentifySettings(ExcitationSettings):
    """Settings of `python -m gazempc.identify`."""

    robot: RobotChoice | None = Field(
        default=None, description="Robot to move and measure; module:Class for a user-defined robot"
    )
    options: RobotOptions = RobotOptions()
    source: str | None = Field(
        default=None, description="Picture of a camera with speed commands, camera:URL, by which it is measured"
    )
    camera: CameraOptions = CameraOptions()
    from_log: Path | None = Field(
        default=None,
        description="Instead of a robot: a record of this command, or a log of gazempc.run, with the axes that moved",
    )
    new: Annotated[Path | None, tyro.conf.arg(metavar="FILE.toml")] = Field(
        default=None,
        description="Instead of measuring: write a first neck file from --sheet.*; prompts for missing values",
    )
    sheet: DataSheet = DataSheet()
    urdf: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = Field(
        default=None, description="With --new: a URDF in place of the data sheet; needs --eye-frame"
    )
    eye_frame: str | None = Field(default=None, description="With --urdf: link at the eye, such as the camera's")
    pan_joint: str | None = Field(
        default=None, description="With --urdf: pan joint; default: the one below the tilt joint"
    )
    tilt_joint: str | None = Field(default=None, description="With --urdf: tilt joint; default: the nearest to the eye")
    tracker: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = Field(
        default=None,
        description="Measure a tracker instead, from a table, lines of JSON (.jsonl) or the folder of a ROS 2 bag",
    )
    person: str | None = Field(
        default=None, description="With --tracker: the tracker's id of the person; default: the longest track"
    )
    neck: str | None = Field(
        default=None,
        description="Neck (name or .toml file) with the limits to respect and copy; default: reference, or the log's",
    )
    out: Annotated[Path, tyro.conf.arg(metavar="FILE.toml")] = Field(
        default=Path("identified.toml"),
        description="File to write: a sensor with --tracker, else a neck, with a figure and the record beside it",
    )
    dead_time_max_s: float = Field(default=1.5, ge=0.1, le=5, description="Upper bound of the dead time")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 2 on bad input or insufficient data, 130 if interrupted.
    """
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            # As for Ctrl-C: brake the neck, then end the command.
            signal.signal(number, signal.default_int_handler)
    words = sys.argv[1:] if arguments is None else arguments
    try:
        return run_command("identify", lambda: _run(parse(words)))
    except KeyboardInterrupt:
        print("identify: interrupted; the neck was stopped, nothing was written", file=sys.stderr)
        return 130  # as a shell reports SIGINT


def parse(words: Sequence[str]) -> IdentifySettings:
    """Settings from the command line.

    Args:
        words: Command line without the program's name.

    Returns:
        The settings.

    Raises:
        SettingsError: If there is no such robot, or it does not have an option.
        SystemExit: If the command line is wrong (status 2) or requests help (status 0).
    """
    words, own = take_options(words, RobotOptions.model_fields)
    found = tyro.cli(
        IdentifySettings, config=TYRO_CONFIG, args=words, prog="python -m gazempc.identify", description=__doc__
    )
    settings = found.model_copy(update={"options": found.options.with_own(own)})
    check_options([(ROBOT, settings.robot or "simulated")], own)
    return settings


def _run(settings: IdentifySettings) -> int:
    _check(settings)
    progress = Progress()
    if settings.new is not None:
        frames = settings.eye_frame, settings.pan_joint, settings.tilt_joint
        urdf = None if settings.urdf is None else read_urdf(settings.urdf, *frames)
        write_new_neck(settings.new, settings.sheet, urdf)
    elif settings.tracker is not None:
        # Local import: other modes need neither readers nor the fit.
        from gazempc.identify.tracker.sensor_file import identify_tracker  # noqa: PLC0415

        identify_tracker(settings.tracker, settings.person, settings.out, progress)
    elif settings.source is not None:
        # Local import: other modes need no OpenCV.
        from gazempc.identify.from_picture import identify_from_picture  # noqa: PLC0415

        robot, neck = settings.robot or "", load_neck(settings.neck or "ptz")
        given = settings.options, settings.source, settings.camera
        identify_from_picture(robot, *given, neck, settings.out, settings.dead_time_max_s, progress)
    else:
        _identify_neck(settings, progress)
    return 0


def _identify_neck(settings: IdentifySettings, progress: Progress) -> None:
    taken, neck, origin = _record(settings, progress)
    # The record of a robot is kept even if the data are insufficient.
    written = [] if settings.from_log is not None else [settings.out.with_suffix(".npz")]
    failed = f", {taken.failed_reads} reads failed" if taken.failed_reads else ""
    print(f"{origin}: {taken.command_time_s.size} commands, {taken.joint_time_s.size} readings{failed}")
    progress.begin("fitting")
    # Local imports of SciPy and Matplotlib: --help and error messages without delay.
    from gazempc.identify.estimate import estimate_axis  # noqa: PLC0415
    from gazempc.identify.identified import draw, neck_toml, table  # noqa: PLC0415

    estimates, refusals = [], list[str]()
    names = taken.neck().joint_names
    for axis in moving_joints(taken.neck(), settings.axes):
        try:
            estimates.append(estimate_axis(taken, names.index(axis), settings.dead_time_max_s))
            refusals += estimates[-1].doubts
        except IdentificationError as error:
            refusals.append(str(error))
    if estimates:
        print(f"\n{table(estimates, neck)}\n\n± is half the 95 % confidence interval.")
        for note in (estimate.note for estimate in estimates if estimate.note and not estimate.doubts):
            print(f"Note: {note}.")
        progress.begin("drawing")
        draw(taken, estimates, f"Identified from {origin}: measured against model", settings.out.with_suffix(".png"))
        written.append(settings.out.with_suffix(".png"))
    if settings.from_log is not None:
        _print_latency(settings.from_log)
    if refusals:
        files = f"\nInspect: {', '.join(map(str, written))}" if written else ""
        reasons = "".join(f"\n  {refusal}" for refusal in refusals)
        raise IdentificationError(f"no neck file written; the data do not determine the neck:{reasons}{files}")
    text = neck_toml(neck, estimates, settings.out.stem, origin)
    write_whole(settings.out, text)
    _print_margins(load_neck(settings.out))
    print(f"\nWritten: {', '.join(map(str, [settings.out, *written]))}")
    print(f"Use it: python -m gazempc.run --replay subject03_R4 --neck {settings.out}")


def _record(settings: IdentifySettings, progress: Progress) -> tuple[NeckRecord, NeckSpec, str]:
    """Record, neck with the applied limits, and description of the origin."""
    if settings.from_log is not None:
        taken = load_record(settings.from_log)
        neck = taken.neck() if settings.neck is None else load_neck(settings.neck)
        if neck.joint_names != taken.neck().joint_names:
            joints, others = ", ".join(taken.neck().joint_names), ", ".join(neck.joint_names)
            raise SettingsError(f"--neck {settings.neck}: has {others}; {settings.from_log} has {joints}")
        return taken, neck, settings.from_log.name
    robot = settings.robot or ""
    simulated = keeps_any_clock(ROBOT, robot)
    if settings.neck is None and not simulated:
        raise SettingsError(f"--neck: a real robot ({robot}) needs its own neck file, with its limits")
    neck = load_neck(settings.neck or "reference")
    if neck.takes_speeds or not neck.reports_joints:
        accepted = 'command = "position" and reports_joints = true, or --source camera:URL'
        raise SettingsError(f"neck {neck.name!r}: needs position commands and encoders; accepted: {accepted}")
    # A simulated neck runs on a simulated clock, faster than real time.
    clock: Clock = SimulatedClock() if simulated else RealClock()
    with closing(make_robot(robot, settings.options, neck, clock, neck.rest_rad, settings.seed)) as moved:
        try:
            moved.connect()
        except (GazempcError, OSError):
            raise
        except Exception as error:
            raise RobotError(f"connect() raised {error_line(error)}") from error
        # Never set: only an exception ends the wait or the motion.
        never = threading.Event()
        start_rad = first_position_rad(moved, neck, clock, never)
        assert start_rad is not None
        go_in(moved, neck, clock, start_rad, never)
        excitation = excite(neck, neck.command_limits.clip_position(start_rad), settings)
        progress.begin(f"moving the neck for {len(excitation) * neck.servo_period_s:.0f} s")
        about = {
            "from": f"robot {robot}",
            "date": datetime.date.today().isoformat(),
            "settings": settings.model_dump(mode="json", exclude={"out", "from_log"}),
        }
        taken = record(moved, clock, excitation, neck, about, progress.at)
    taken.save(settings.out.with_suffix(".npz"))
    return taken, neck, f"robot {robot}, neck {neck.name}"


def _check(settings: IdentifySettings) -> None:
    option, path = ("--out", settings.out) if settings.new is None else ("--new", settings.new)
    if path.suffix != ".toml":
        raise SettingsError(f"{option} {path}: must end in .toml")
    if [settings.robot, settings.from_log, settings.tracker, settings.new].count(None) != 3:
        raise SettingsError("give one of --robot NAME, --from-log FILE, --tracker FILE and --new FILE")
    if settings.person is not None and settings.tracker is None:
        raise SettingsError("--person: requires --tracker FILE")
    if settings.sheet != DataSheet() and settings.new is None:
        raise SettingsError("--sheet: requires --new FILE")
    if settings.new is None:
        for name in ("urdf", "eye_frame", "pan_joint", "tilt_joint"):
            if getattr(settings, name) != IdentifySettings.model_fields[name].default:
                raise SettingsError(f"--{name.replace('_', '-')}: requires --new FILE")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GazempcError(f"{option} {path}: cannot create its folder: {error.strerror}") from None


def _print_margins(neck: NeckSpec) -> None:
    from gazempc.controllers.mpc.mpc import Mpc  # noqa: PLC0415
    from gazempc.margins.margins import margins, sentences, too_small  # noqa: PLC0415

    mpc = Mpc(neck)
    try:
        lines = sentences(neck, margins(mpc))
    except SettingsError as error:
        lines = [str(error)]
    print("", *(f"{line}." for line in lines), *(f"Warning: {line}." for line in too_small(mpc)), sep="\n")


def _print_latency(path: Path) -> None:
    from gazempc.identify.latency import log_latency  # noqa: PLC0415

    try:
        arrived, captured = log_latency(load_log(path))
    except SettingsError:
        return  # a record of this command has no observations
    except IdentificationError as error:
        print(f"\n{error}")
        return
    print(f"\nSensor latency, from the person's motion to the arrival of its observation: {arrived.shown(1e3, 1)} ms;")
    print(f"its capture times are {captured.shown(1e3, 1)} ms late (should be 0).")
