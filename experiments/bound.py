"""The least gaze error any controller could have on a neck: `python -m experiments.bound --recordings synthetic`.

For each recording the whole walk is known from the moment at which the gazes first know of the person. The command's
limits, the dead time and the servo count; the tilt is taken to be on the person. The motion with the least sum of
squared errors, over what is scored of the run, is a quadratic program. In it an error is the arc along the circle of
equal tilt, which for errors below 57 deg is at most 4 % longer than the angle: the true least error is lower by at most
that. Beside it stand look-ahead, the MPC and the MPC with the true future in the same place.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import tyro
from pydantic import BaseModel, ConfigDict, Field
from tqdm import tqdm

from experiments.engine.command import run_command
from experiments.engine.jobs import attempt
from experiments.engine.recordings import find_recordings
from gazempc.neck.kinematics import look_at
from gazempc.neck.servo import zero_order_hold
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.results.log import Log
from gazempc.results.metrics import SCORED_FROM_S, measure
from gazempc.results.report import versions
from gazempc.settings import ControllerName, RunSettings, WalkerSettings
from gazempc.sim.replay import replay, walker_model
from gazempc.sim.sensor import default_sensor, load_sensor

CONTROLLERS: tuple[ControllerName, ...] = ("lookahead", "mpc", "perfect")
COLUMNS = (*CONTROLLERS, "bound")
GROUPS = ("straight", "turn", "sharp", "all")


class BoundSettings(BaseModel):
    """Settings of `python -m experiments.bound`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    recordings: tuple[str, ...] = Field(min_length=1, description="'synthetic', folders, files or synthetic names")
    neck: str = Field(default="slow", description="Shipped neck or .toml file")
    distance_m: float = Field(default=1.0, gt=0, description="Distance of the robot from the walk")
    height_m: float = Field(default=1.2, description="Its height above the floor")
    seed: int = Field(default=0, ge=0, description="Seed of the sensor's noise")
    walker: WalkerSettings = WalkerSettings()
    out: Path = Field(default=Path("out/bound"), description="Where to write")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 1 if a run failed, 2 on bad input.
    """
    settings = tyro.cli(BoundSettings, args=arguments, prog="python -m experiments.bound", description=__doc__)
    return run_command("bound", lambda: bound(settings))


def bound(settings: BoundSettings) -> int:
    """Run, print a table, and write ``bound.json`` and ``bound.csv``.

    Args:
        settings: What to bound.

    Returns:
        Exit status: 1 if a run failed.
    """
    neck = load_neck(settings.neck)
    if settings.walker.fitted is not None:
        walker_model(settings.walker.fitted, "")  # before anything runs
    rows: list[dict[str, Any]] = []
    for recording in tqdm(find_recordings(settings.recordings), unit="walk"):
        row: dict[str, Any] = {"recording": Path(recording).stem, "left_out": None, "failed": None}
        rows.append(row | attempt(partial(_figures, recording, neck, settings)))
    done = [row for row in rows if not row["left_out"] and not row["failed"]]
    failed = [row for row in rows if row["failed"]]
    summary = summarise(done)
    settings.out.mkdir(parents=True, exist_ok=True)
    told = {"settings": settings.model_dump(mode="json", exclude={"out"}), "versions": versions(), "rows": summary}
    (settings.out / "bound.json").write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with (settings.out / "bound.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
    print(_table(settings, summary, len(rows) - len(done) - len(failed)))
    for row in failed:
        print(f"failed: {row['recording']}: {row['failed']}")
    print(f"Written to {settings.out}/: bound.json, bound.csv")
    return 1 if failed else 0


def least_error_deg(log: Log, told_s: float) -> float:
    """The least RMS gaze error of a neck with the log's limits, dead time, servo and start, scored as all runs are.

    See the module for what is left out.

    Args:
        log: A run; only where the person is, and where the joint starts, are taken from it.
        told_s: When the person is known of: the command stands still before, seconds.

    Returns:
        RMS gaze error, degrees.
    """
    neck, n = log.neck(), len(log.time_s)
    aims = look_at(neck.geometry, log.head_true_base_m).angles_rad
    pan, worth = np.unwrap(aims[:, 0]), np.cos(aims[:, 1])
    scored = log.time_s >= log.time_s[0] + SCORED_FROM_S - 1e-9
    start, h = float(log.joint_position_rad[0, 0]), neck.servo_period_s
    command, joint, speed = (ca.SX.sym(name, n) for name in ("command", "joint", "speed"))
    # Of a dead time that is no whole number of ticks the begun one is left out, too.
    dead = int(neck.dead_time_s[0] / h + 1e-9)
    acting = ca.vertcat(ca.DM(np.full(min(dead, n), start)), command[: max(n - dead, 0)])
    # Before the run, too, it stood.
    sent = ca.vertcat(ca.DM(np.full(3, start)), command)
    servo = ca.DM(zero_order_hold(neck.pan, h))
    following = (
        ca.horzcat(joint[1:] - start, speed[1:]).T - servo @ ca.horzcat(joint - start, speed, acting - start).T[:, :-1]
    )
    limits = neck.command_limits
    rows = ca.vertcat(ca.vec(following), *(ca.diff(sent, k) for k in (1, 2, 3)))
    motion = (limits.velocity_max_rad_s, limits.acceleration_max_rad_s2, limits.jerk_max_rad_s3)
    most_motion = [float(most[0]) * h**k for k, most in enumerate(motion, start=1)]
    most = np.repeat([0.0, *most_motion], [2 * (n - 1), n + 2, n + 1, n])
    low, high = np.full((3, n), -np.inf), np.full((3, n), np.inf)
    low[0], high[0] = limits.position_min_rad[0], limits.position_max_rad[0]
    before = log.time_s < told_s - 1e-9
    low[0, before] = high[0, before] = low[1, 0] = high[1, 0] = start
    low[2, 0] = high[2, 0] = 0.0
    # A bound has to allow for a gaze that gives up what is not scored; a thousandth of it keeps the program regular.
    counted = np.where(scored, 1.0, 1e-3)
    cost = ca.sum(counted * (worth * (joint - pan)) ** 2)
    problem = {"x": ca.vertcat(command, joint, speed), "f": cost, "g": rows}
    solver = ca.qpsol("least", "piqp", problem, {"print_time": 0, "error_on_fail": True})
    found = np.asarray(solver(lbx=low.ravel(), ubx=high.ravel(), lbg=-most, ubg=most)["x"]).ravel()[n : 2 * n]
    # The angle between two directions of equal tilt.
    arcs = 2.0 * np.arcsin(np.clip(worth * np.sin(np.abs(found - pan) / 2.0), 0.0, 1.0))
    return float(np.degrees(np.sqrt(np.mean(arcs[scored] ** 2))))


def summarise(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over clips, group by group.

    Args:
        rows: One for each recording: its group and the RMS errors in degrees of `COLUMNS`.

    Returns:
        A row for each group that has clips: number, mean errors, and the bound's share of look-ahead's error.
    """
    summary = []
    for group in GROUPS:
        chosen = [row for row in rows if group in (row["group"], "all")]
        if chosen:
            means = {name: float(np.mean([row[name] for row in chosen])) for name in COLUMNS}
            share = means["bound"] / means["lookahead"]
            summary.append({"group": group, "clips": len(chosen), **means, "bound_to_lookahead": share})
    return summary


def _figures(recording: str, neck: NeckSpec, settings: BoundSettings) -> dict[str, Any]:
    walk = load(recording)
    placed = place(walk, "side", settings.distance_m, settings.height_m)
    run = RunSettings(seed=settings.seed, walker=settings.walker)
    figures: dict[str, Any] = {"group": walk.labels.group}
    told_s = math.inf
    for controller in CONTROLLERS:
        log, _ = replay(placed, neck, load_sensor(default_sensor(walk)), controller, run)
        figures[controller] = measure(log).gaze_error_rms_deg
        moving = np.flatnonzero(np.any(log.command_position_rad != log.command_position_rad[0], axis=1))
        told_s = min(told_s, float(log.time_s[moving[0]])) if moving.size else told_s
    return figures | {"bound": least_error_deg(log, told_s)}


def _table(settings: BoundSettings, summary: Sequence[dict[str, Any]], left_out: int) -> str:
    lines = [
        f"# Least gaze error of the neck {settings.neck}, {settings.distance_m:g} m beside the walk",
        "",
        f"RMS gaze error in degrees, means over clips; {left_out} recordings left out (too near, or too short).",
        "",
        "| group | clips | look-ahead | MPC | MPC with perfect forecast | least possible | below look-ahead |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in summary:
        errors = " | ".join(f"{row[name]:.2f}" for name in COLUMNS)
        saved = 100.0 * (1.0 - row["bound_to_lookahead"])
        lines.append(f"| {row['group']} | {row['clips']} | {errors} | {saved:.1f} % |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    raise SystemExit(main())
