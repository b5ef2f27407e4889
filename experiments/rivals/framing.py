"""Compare framing of a person by pan-tilt cameras: this project's and other control laws on three devices.

Laws with free constants have the best ones on the evaluated clips (in-sample). Laws with angle output drive a device
with angle commands, at equal delay and top speed; most cameras lack them.
"""

from __future__ import annotations

if __name__ == "__main__":  # before the other imports, which are slow
    from gazempc.signals import end_during_imports

    end_during_imports("rivals.framing")

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import Field

import gazempc as gz
from experiments.aggregate import bootstrap_mean, grouped
from experiments.engine.command import Command, WorkSettings, check_fitted, exit_status, find_recordings, in_place
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.pages import markdown, with_ends, write_rows
from experiments.plots import Plot, draw, points
from experiments.rivals.jobs import RivalJob, check_names
from experiments.rivals.laws import RIVALS
from experiments.rivals.simulate import simulate
from experiments.rivals.trials import STAND, STOP, Trial, make_trial
from gazempc.files.whole import write_whole
from gazempc.neck.speed_steps import SpeedSteps
from gazempc.results.run_summary import without_nan
from gazempc.settings import DEFAULT_PREDICTOR, LoopSettings, WalkerSettings
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import Scene
from gazempc.sim.sensing.spec import FieldOfView

VIEW_DEG = (60.0, 34.0)
OURS, POINT = "gazempc", "gazempc, point"
LAWS = ("frigate", "autoptz", "pixel_pid", "op3")
# Centred zone: all laws aim at the centre of the image.
FRAMING = gz.Framing(headroom=0.5, lead_room=0.0)
FIGURES = ("time_in_zone", "rms_acceleration_rad_s2", "reversals_per_min", "travel_deg_per_min", "time_to_reacquire_s")
_LEVEL = 0.01  # of the time in zone
# Candidate constants: cameras are faster than necks, and a share of their top speed suffices.
_CANDIDATES: Mapping[str, tuple[dict[str, float], ...]] = {
    "autoptz": tuple({"speed_scale": scale} for scale in (0.125, 0.25, 0.5, 1.0)),
    "op3": tuple({"detection_period_s": period_s} for period_s in (1.0 / 30.0, 0.2, 0.4)),
}


@dataclass(frozen=True)
class Device:
    """A pan-tilt camera: speeds and delays.

    Attributes:
        pan_deg_s: Pan speeds, ascending.
        tilt_deg_s: Upward tilt speeds; downward they are 10 % lower.
        dead_time_s: From command to motion.
        latency_s: From scene to detection.
    """

    pan_deg_s: tuple[float, ...]
    tilt_deg_s: tuple[float, ...]
    dead_time_s: float
    latency_s: float

    def neck(self, name: str) -> gz.NeckSpec:
        """Neck model: range, servo and acceleration of `ptz`, without encoders."""
        neck = gz.load_neck("ptz")
        axes = {}
        for joint, speeds, share in (("pan", self.pan_deg_s, 1.0), ("tilt", self.tilt_deg_s, 0.9)):
            one_way = np.deg2rad(speeds)
            steps = SpeedSteps(positive_rad_s=tuple(one_way), negative_rad_s=tuple(share * one_way))
            taken = {"speed_steps": steps, "velocity_max_rad_s": steps.fastest_rad_s, "dead_time_s": self.dead_time_s}
            axes[joint] = getattr(neck, joint).model_copy(update=taken)
        return neck.model_copy(update={"name": name, "reports_joints": False, "head_view_deg": VIEW_DEG, **axes})

    def sensor(self) -> gz.SensorSpec:
        """The sensor `face_camera` on the head, with the latency of the images."""
        view = FieldOfView(on="head", horizontal_deg=VIEW_DEG[0], vertical_deg=VIEW_DEG[1])
        return gz.load_sensor("face_camera").model_copy(update={"latency_s": self.latency_s, "view": view})


# Speeds: sources in `docs/ptz.md`. Delays are assumptions: 0.6, 0.25 and 1.2 s in all.
_CHEAP = (*np.linspace(1.0, 6.0, 12), 9.0, 15.0, 19.0, 25.0, 32.0, 40.0, 50.0, 60.0, 72.0, 86.0, 102.0, 120.0)
_ONVIF = tuple(175.0 * np.interp(np.arange(1, 11) / 10.0, (0.1, 0.5, 1.0), (0.056, 0.146, 0.204)))
DEVICES = {
    "cheap": Device(_CHEAP, _CHEAP[:20], dead_time_s=0.25, latency_s=0.35),
    "good": Device(tuple(np.geomspace(2.0, 300.0, 24)), tuple(np.geomspace(2.0, 125.0, 20)), 0.15, 0.1),
    "onvif": Device(_ONVIF, _ONVIF, dead_time_s=0.2, latency_s=1.0),
}


class FramingSettings(WorkSettings):
    """Settings of `python -m experiments.rivals.framing`."""

    recordings: tuple[str, ...] = Field(
        default=(), description="Walks: 'synthetic' (default, without --standing), folders, files or names"
    )
    standing: tuple[str, ...] = Field(default=(), description="Standing people: as for recordings")
    laws: tuple[str, ...] = Field(default=(*LAWS, POINT, OURS), min_length=1, description="Control laws")
    devices: tuple[str, ...] = Field(default=tuple(DEVICES), min_length=1, description="Devices")
    framing: gz.Framing = FRAMING
    walker: WalkerSettings = WalkerSettings()
    out: Path = Field(default=Path("out/framing"), description="Output folder; an interrupted run resumes from it")


@dataclass(frozen=True)
class FramingJob(RivalJob):
    """One law with one person, who walks and then stands, or only stands.

    Attributes:
        framing: Zone of the image, a setting of this project's controllers, too.
    """

    framing: gz.Framing = FRAMING

    def run(self) -> Row:
        """Subject and `FIGURES`; None if undefined."""
        log = self.log(make_trial(self.trial, self.recording))
        metrics = gz.measure(log).as_dict()
        return {"subject": log.run.subject, **without_nan({name: metrics[name] for name in FIGURES})}

    def log(self, trial: Trial) -> gz.Log:
        """See `RivalJob.log`."""
        scene = Scene(trial.walk, self.neck, self.sensor, seed=self.seed)
        late_s = self.sensor.latency_s
        if self.rival in (OURS, POINT):
            settings = ReplaySettings(
                framing=self.framing if self.rival == OURS else gz.Framing(subject="no"),
                walker=self.walker,
                loop=LoopSettings(stale_after_s=0.5 + late_s, lost_after_s=1.5 + late_s, rest_after_s=10.0),
            )
            log = replay_scene(scene, "mpc", DEFAULT_PREDICTOR, settings).log
        else:
            log = simulate(scene, self._make)
        run = log.run.model_copy(update={"settings": {"framing": self.framing.model_dump(mode="json")}})
        return replace(log, run=run)


def _jobs(settings: FramingSettings) -> list[FramingJob]:
    check_names("law", settings.laws, (*RIVALS, POINT, OURS))
    check_names("device", settings.devices, tuple(DEVICES))
    check_fitted(settings.walker)
    walks = settings.recordings or (() if settings.standing else ("synthetic",))
    people = [(STOP, in_place(name)) for name in find_recordings(walks)]
    people += [(STAND, in_place(name)) for name in find_recordings(settings.standing)]
    return [
        FramingJob(
            law,
            trial,
            name,
            device.neck(label),
            device.sensor(),
            constants=constants,
            walker=settings.walker,
            framing=settings.framing,
        )
        for label, device in ((label, DEVICES[label]) for label in settings.devices)
        for law in settings.laws
        for constants in _CANDIDATES.get(law, ({},))
        for trial, name in people
    ]


def summarise(runs: Sequence[Row]) -> list[Row]:
    """Means over clips with intervals over people, for each law at its best constants.

    Args:
        runs: Runs with ``device``, ``law``, ``constants``, ``subject`` and `FIGURES`.

    Returns:
        One row per device and law: labels, ``n_clips``, `FIGURES` and their intervals under ``<name>_ci95``.
    """
    rows = []
    for here in grouped(runs, "device", "law").values():
        candidates = [_means(each) for each in grouped(here, "constants").values()]
        most = max(row["time_in_zone"] for row in candidates)
        level = [row for row in candidates if row["time_in_zone"] > most - _LEVEL]
        rows.append(min(level, key=lambda row: float(row["reversals_per_min"])))
    return rows


def _means(runs: Sequence[Row]) -> Row:
    row: Row = {name: runs[0][name] for name in ("device", "law", "constants")} | {"n_clips": len(runs)}
    people = [run["subject"] for run in runs]
    for name in FIGURES:
        mean, *ends = bootstrap_mean([run[name] for run in runs], people)
        row |= {name: mean, f"{name}_ci95": ends}
    return row


def _verdicts(rows: Sequence[Row]) -> Iterator[str]:
    """Metrics in which a rival is better, then the goal for each device."""
    reached = []
    for ours in (row for row in rows if row["law"] == OURS):
        for other in (row for row in rows if row["device"] == ours["device"] and row["law"] in LAWS):
            for name, sign in zip(FIGURES, (1, -1, -1, -1, -1), strict=True):
                if sign * (ours[name] - other[name]) < 0:
                    yield f"Worse on {ours['device']}: {name} {ours[name]:.3g}, {other['law']} {other[name]:.3g}."
            above = ours["time_in_zone"] > other["time_in_zone"]
            calm = ours["reversals_per_min"] < 0.5 * other["reversals_per_min"]
            reached.append(f"{ours['device']}, {other['law']}: {'reached' if above and calm else 'missed'}")
    yield "Goal, more time in zone at less than half the reversals: " + "; ".join(reached) + "."


_HEADINGS = ("in zone [%]", "acceleration [rad/s²]", "reversals [1/min]", "travel [deg/min]", "back after [s]")


def table(rows: Sequence[Row]) -> str:
    """The table in Markdown."""
    lines = []
    for row in rows:
        cells = (f"{row[name]:{form}}" for name, form in zip(FIGURES[1:], (".2f", ".1f", ".0f", ".2f"), strict=True))
        zone = with_ends(row["time_in_zone"], row["time_in_zone_ci95"], ".1f", 100.0)
        lines.append((row["device"], row["law"], zone, *cells))
    return markdown(("device", "law", *_HEADINGS), lines)


def plots_of(rows: Sequence[Row]) -> list[Plot]:
    """Time in zone against acceleration, then against reversals, one plot per device."""
    plots = []
    axes = {"rms_acceleration_rad_s2": "RMS acceleration (rad/s$^2$)", "reversals_per_min": "reversals per minute"}
    for x, label in axes.items():
        for (device,), of_device in grouped(rows, "device").items():
            here = {row["law"]: row for row in of_device}
            late_s = DEVICES[device].dead_time_s + DEVICES[device].latency_s
            lines = points(here, x, "time_in_zone", 100.0, {})
            plots.append(Plot(f"{device}, {late_s:.2g} s late", label, "time in zone (%)", lines))
    return plots


def _run(settings: FramingSettings, command: str) -> int:
    jobs = _jobs(settings)
    with Engine(settings.out / "runs", settings.jobs, settings.dask, unit="run") as engine:
        results = engine.run(jobs)
    runs = [
        {"device": job.neck.name, "law": job.rival, "constants": str(job.constants), **result}
        for job, result in zip(jobs, results, strict=True)
    ]
    failed = [run for run in runs if run["failed"]]
    rows = summarise([run for run in runs if not run["failed"] and not run["left_out"]])
    text = "\n".join([*_verdicts(rows), "", table(rows), f"`{command}`", ""])
    write_whole(settings.out / "framing.md", text)
    write_rows(settings.out / "framing.json", settings.saved(), rows)
    draw(plots_of(rows), settings.out / "framing.png", "means over clips, 95 % intervals over people", rows=2)
    print(text)
    for run in failed:
        print(run["law"], run["device"], run["failed"])
    return exit_status(False, bool(failed))


main = Command("rivals.framing", FramingSettings, __doc__, _run).main

if __name__ == "__main__":
    raise SystemExit(main())
