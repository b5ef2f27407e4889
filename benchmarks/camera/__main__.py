"""How well the camera source sees: `python -m benchmarks.camera --json out/camera.json`.

On rendered pictures (MuJoCo, in software; 640 x 480 pixels, 60 degrees across) of a real face before clutter. Measured
are bearing, range, head yaw and detection by distance and by the turn of the head, false faces, and processor time.
Then the error of the time of capture, with pictures that a server sends at known times. Last a whole live run: a camera
on the head of MuJoCo's neck, and a person who walks past. It takes about two minutes.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from benchmarks.camera import live, stream
from benchmarks.camera.walks import Seen, across, watch, webcam
from gazempc.results.metrics import measure
from gazempc.results.run_summary import versions
from gazempc.robots.studio import Studio, StudioPerson
from gazempc.types import FloatArray

RANGES_M = (0.7, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
SPOILT_M = (1.0, 2.0, 3.5)
TURNS_DEG = (45.0, 60.0)
_FRAMES = 60
_LIVE = (
    ("reference", "reactive"),
    ("reference", "lookahead"),
    ("reference", "mpc"),
    ("fetch", "lookahead"),
    ("fetch", "mpc"),
)


@dataclass(frozen=True)
class Row:
    """Figures of one walk.

    Attributes:
        walk: What it was.
        found_percent: Pictures in which the person was found.
        bearing_rms_deg: Error of the direction.
        range_bias_percent: Mean error of the range.
        range_sd_percent: Standard deviation of the range's error.
        yaw_rms_deg: Error of the head's yaw.
        nees: Mean squared error of the position by its stated covariance; 3 for an exact one.
        others: Observations of what is no person.
        names: Names given to the one person.
        cpu_ms: Mean processor time a picture.
    """

    walk: str
    found_percent: float
    bearing_rms_deg: float
    range_bias_percent: float
    range_sd_percent: float
    yaw_rms_deg: float
    nees: float
    others: int
    names: int
    cpu_ms: float


def row(walk: str, seen: Seen) -> Row:
    """Figures of what was seen of a walk.

    Args:
        walk: What it was.
        seen: What was seen.

    Returns:
        The figures; NaN for what nothing was seen of.
    """
    return Row(
        walk,
        100 * seen.found,
        rms(seen.bearing_deg),
        100 * mean(seen.range_error),
        100 * (float(np.std(seen.range_error)) if seen.range_error.size else np.nan),
        rms(seen.yaw_error_deg),
        mean(seen.nees),
        seen.others,
        seen.names,
        mean(seen.cpu_ms),
    )


def mean(values: FloatArray) -> float:
    """Mean; NaN of nothing."""
    return float(np.mean(values)) if values.size else float("nan")


def rms(values: FloatArray) -> float:
    """Root of the mean square; NaN of nothing."""
    return float(np.sqrt(mean(np.square(values))))


def as_it_is(picture: Any) -> Any:
    """The picture itself."""
    return picture


def main(json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None) -> None:
    """Measure and print.

    Args:
        json_file: Where to save the numbers.
    """
    studio = Studio()
    walks: list[tuple[str, Callable[[float], StudioPerson | None], Callable[[Any], Any]]] = [
        (f"across at {range_m:g} m", across(range_m), as_it_is) for range_m in RANGES_M
    ]
    walks += [(f"across at {range_m:g} m, cheap webcam", across(range_m), webcam) for range_m in SPOILT_M]
    walks += [(f"across at 2 m, head turns by {turn:g} deg", across(2.0, yaw_deg=turn), as_it_is) for turn in TURNS_DEG]
    walks.append(("no person", lambda _: None, as_it_is))
    rows = []
    print(f"{'walk':<38} found  bearing  range: bias, sd   yaw  nees  others  names    cpu")
    print(f"{'':<38}   [%]    [deg]         [%]  [%] [deg]                       [ms]")
    for name, person_at, spoilt in walks:
        found = row(name, watch(studio, person_at, _FRAMES, spoilt))
        rows.append(found)
        print(
            f"{name:<38} {found.found_percent:5.0f} {found.bearing_rms_deg:8.2f} {found.range_bias_percent:11.1f} "
            f"{found.range_sd_percent:4.1f} {found.yaw_rms_deg:5.1f} {found.nees:5.1f} {found.others:7} "
            f"{found.names:6} {found.cpu_ms:6.1f}",
            flush=True,
        )
    capture_ms = stream.capture_errors_ms()
    print(
        f"time of capture, {capture_ms.size} pictures of a stream: late by {np.median(capture_ms):.1f} ms (median), "
        f"{np.percentile(capture_ms, 95):.1f} ms (95 %)"
    )
    runs: dict[str, Any] = {}
    for neck, controller in _LIVE:
        log, camera = live.run(studio, controller=controller, neck_name=neck)
        metrics = measure(log)
        runs[f"{neck} {controller}"] = metrics.as_dict()
        within = [100 * share for share in (metrics.eye_contact_2p6, metrics.eye_contact_4)]
        print(
            f"live, neck {neck}, {controller}: {camera.pictures} pictures, {log.capture_time_s.size} observations, "
            f"gaze error {metrics.gaze_error_rms_deg:.2f} deg RMS, eye contact {within[0]:.0f} % within 2.6 deg, "
            f"{within[1]:.0f} % within 4 deg",
            flush=True,
        )
    studio.close()
    if json_file is not None:
        found_all = {
            "rows": [vars(r) for r in rows],
            "capture_error_ms": capture_ms.tolist(),
            "live": runs,
            "versions": versions(),
        }
        json_file.parent.mkdir(parents=True, exist_ok=True)
        json_file.write_text(json.dumps(found_all, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.camera", description=__doc__)
