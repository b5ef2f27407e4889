"""Lower bound of the gaze error of any controller on a neck: `python -m experiments.bound --recordings synthetic`.

Printed beside look-ahead, the MPC and the MPC with the true future; RMS gaze error in degrees, means over clips.

The whole walk is known from the first observation of the person on. The bound includes the command's limits, the dead
time and the servo; the tilt is assumed to point at the person. The motion with the least sum of squared errors over the
scored samples solves a quadratic program. Its error is the arc along the circle of equal tilt, at most 4 % longer than
the angle for errors below 57 deg; the true bound is lower by at most this share.
"""

from __future__ import annotations

if __name__ == "__main__":  # before the other imports, which are slow
    from gazempc.signals import end_during_imports

    end_during_imports("bound")

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from pydantic import Field

import gazempc as gz
from experiments.aggregate import GROUP_ORDER
from experiments.engine.command import Command, WorkSettings, check_fitted, exit_status, find_recordings, in_place
from experiments.engine.engine import Engine
from experiments.engine.job import Row, key_of, models_hash, recording_hash
from experiments.pages import markdown, write_csv, write_rows
from gazempc.errors import SettingsError
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.servo import zero_order_hold
from gazempc.parts import TRUE_FUTURE
from gazempc.recordings.placement import Placement
from gazempc.results.metrics import SCORED_FROM_S
from gazempc.results.run_summary import label
from gazempc.settings import WalkerSettings
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene

CONTROLLERS = ("lookahead", "mpc", TRUE_FUTURE)


@dataclass(frozen=True)
class BoundJob:
    """The bound on one recording, and the errors of controllers.

    Attributes:
        recording: Synthetic name or path.
        scene: The robot's place and the seed.
        neck: The neck.
        sensor: The sensor; None for the recording's default.
        walker: Model of the predictor.
    """

    recording: str
    scene: SceneSettings
    neck: gz.NeckSpec
    sensor: gz.SensorSpec | None
    walker: WalkerSettings

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        return key_of(self, recording=recording_hash(self.recording), models=models_hash(self.walker.fitted))

    def run(self) -> Row:
        """Group, RMS gaze error of each of `CONTROLLERS`, and the lower bound (``bound``), degrees."""
        scene = make_scene(self.recording, self.scene, self.neck, self.sensor)
        row: Row = {"group": scene.walk.labels.group}
        first_observation_s = math.inf
        settings = ReplaySettings(walker=self.walker)
        for controller in CONTROLLERS:
            log, _ = replay_scene(scene, controller, settings.predictor, settings)
            row[controller] = gz.measure(log).gaze_error_rms_deg
            moving = np.flatnonzero(np.any(log.command_position_rad != log.command_position_rad[0], axis=1))
            first_observation_s = min([first_observation_s, *log.time_s[moving[:1]].tolist()])
        return row | {"bound": least_error_deg(log, first_observation_s)}


def least_error_deg(log: gz.Log, first_observation_s: float) -> float:
    """Lower bound of the RMS gaze error for the log's limits, dead time, servo and initial state.

    The module lists the simplifications.

    Args:
        log: A run, of which the neck, the times, the true head position and the initial joint angle are used.
        first_observation_s: Time of the first observation, seconds; before it the command is constant.

    Returns:
        RMS gaze error, degrees.
    """
    neck, n = log.neck, len(log.time_s)
    aims = look_at_rad(neck.geometry, log.head_true_base_m)
    pan, cos_tilt = np.unwrap(aims[:, 0]), np.cos(aims[:, 1])
    scored = log.time_s >= log.time_s[0] + SCORED_FROM_S - 1e-9
    start, h = float(log.joint_position_rad[0, 0]), neck.servo_period_s
    command, joint, speed = (ca.SX.sym(name, n) for name in ("command", "joint", "speed"))
    # Dead time rounded down to whole ticks, which keeps a lower bound.
    dead = int(neck.dead_time_s[0] / h + 1e-9)
    acting = ca.vertcat(ca.DM(np.full(min(dead, n), start)), command[: max(n - dead, 0)])
    # Constant command before the run, for the differences up to third order.
    sent = ca.vertcat(ca.DM(np.full(3, start)), command)
    servo = ca.DM(zero_order_hold(neck.pan, h))
    dynamics = (
        ca.horzcat(joint[1:] - start, speed[1:]).T - servo @ ca.horzcat(joint - start, speed, acting - start).T[:, :-1]
    )
    limits = neck.command_limits
    rows = ca.vertcat(ca.vec(dynamics), *(ca.diff(sent, k) for k in (1, 2, 3)))
    motion = (limits.velocity_max_rad_s, limits.acceleration_max_rad_s2, limits.jerk_max_rad_s3)
    most_motion = [float(most[0]) * h**k for k, most in enumerate(motion, start=1)]
    most = np.repeat([0.0, *most_motion], [2 * (n - 1), n + 2, n + 1, n])
    low, high = np.full((3, n), -np.inf), np.full((3, n), np.inf)
    low[0], high[0] = limits.position_min_rad[0], limits.position_max_rad[0]
    before = log.time_s < first_observation_s - 1e-9
    low[0, before] = high[0, before] = low[1, 0] = high[1, 0] = start
    low[2, 0] = high[2, 0] = 0.0
    # Unscored samples have a small weight only to regularise the program: a bound must leave them free.
    sample_weights = np.where(scored, 1.0, 1e-3)
    cost = ca.sum(sample_weights * (cos_tilt * (joint - pan)) ** 2)
    problem = {"x": ca.vertcat(command, joint, speed), "f": cost, "g": rows}
    solver = ca.qpsol("least", "piqp", problem, {"print_time": 0, "error_on_fail": True})
    found = np.asarray(solver(lbx=low.ravel(), ubx=high.ravel(), lbg=-most, ubg=most)["x"]).ravel()[n : 2 * n]
    # Angle between two directions of equal tilt.
    arcs = 2.0 * np.arcsin(np.clip(cos_tilt * np.sin(np.abs(found - pan) / 2.0), 0.0, 1.0))
    return float(np.degrees(np.sqrt(np.mean(arcs[scored] ** 2))))


COLUMNS = (*CONTROLLERS, "bound")


class BoundSettings(WorkSettings, SceneSettings):
    """Settings of `python -m experiments.bound`."""

    recordings: tuple[str, ...] = Field(min_length=1, description="'synthetic', folders, files or synthetic names")
    neck: str = Field(default="slow", description="Shipped neck or .toml file")
    placement: Placement | None = Field(default="side", description="Placement of the robot")
    distance_m: float = Field(default=1.0, gt=0, description="Distance of the robot from the walk, for placement side")
    walker: WalkerSettings = WalkerSettings()
    out: Path = Field(default=Path("out/bound"), description="Output folder; an interrupted run resumes from it")


def bound(**settings: Any) -> list[Row]:
    """Compute the lower bound on each recording.

    Args:
        **settings: Any of `BoundSettings`, such as ``recordings=["synthetic"], neck="slow"``.

    Returns:
        One row per recording: ``group``, RMS errors of `COLUMNS` in degrees, ``left_out`` and ``failed``.

    Raises:
        GazempcError: On invalid input, before any run.
    """
    return _bound(BoundSettings.of("bound", settings))


def _bound(settings: BoundSettings) -> list[Row]:
    neck = gz.load_neck(settings.neck)
    if neck.joints > 2:
        raise SettingsError(
            f"neck {neck.name!r}: a bound for {neck.joints} joints; accepted: necks of pan and tilt only"
        )
    sensor = None if settings.sensor is None else gz.load_sensor(settings.sensor)
    check_fitted(settings.walker)
    scene = SceneSettings(**{name: getattr(settings, name) for name in SceneSettings.model_fields})
    recordings = find_recordings(settings.recordings)
    jobs = [BoundJob(in_place(name), scene, neck, sensor, settings.walker) for name in recordings]
    with Engine(settings.out / "runs", settings.jobs, settings.dask, unit="walk") as engine:
        results = engine.run(jobs)
    return [{"recording": Path(name).stem, **row} for name, row in zip(recordings, results, strict=True)]


def _run(settings: BoundSettings, command: str) -> int:
    rows = _bound(settings)
    summary = summarise([row for row in rows if not row["left_out"] and not row["failed"]])
    write_csv(settings.out / "bound.csv", rows)
    write_rows(settings.out / "bound.json", settings.saved(), summary)
    print(_table(summary))
    for row in rows:
        if reason := row["left_out"] or row["failed"]:
            print(f"- {'left out' if row['left_out'] else 'failed'} {row['recording']}: {reason}")
    print(f"Written to {settings.out}/: bound.json, bound.csv")
    return exit_status(False, any(row["failed"] for row in rows))


def summarise(rows: Sequence[Row]) -> list[Row]:
    """Means over clips, group by group.

    Args:
        rows: One row per recording: group, and RMS errors of `COLUMNS` in degrees.

    Returns:
        One row per group with clips: number of clips, mean errors, and ratio of bound to look-ahead error.
    """
    summary = []
    for group in (*GROUP_ORDER, "all"):
        chosen = [row for row in rows if group in (row["group"], "all")]
        if chosen:
            means = {name: float(np.mean([row[name] for row in chosen])) for name in COLUMNS}
            share = means["bound"] / means["lookahead"]
            summary.append({"group": group, "clips": len(chosen), **means, "bound_to_lookahead": share})
    return summary


def _table(summary: Sequence[Row]) -> str:
    cells = []
    for row in summary:
        below = f"{100.0 * (1.0 - row['bound_to_lookahead']):.1f} %"
        cells.append((row["group"], str(row["clips"]), *(f"{row[name]:.2f}" for name in COLUMNS), below))
    return markdown(("group", "clips", *map(label, CONTROLLERS), "least possible", "below look-ahead"), cells)


main = Command("bound", BoundSettings, __doc__, _run).main

if __name__ == "__main__":
    raise SystemExit(main())
