"""Accuracy of the camera source: `python -m benchmarks.camera`.

Images of a real face in front of clutter are rendered (MuJoCo, in software; 640 x 480 pixels, 60 degrees horizontally).
It measures bearing, range, head yaw and detection rate by distance and head yaw, false faces, and processor time; the
error of the capture time, with images sent by a server at known times; and a complete live run: a camera on the head of
MuJoCo's neck, and a person who walks past. It takes about two minutes.
"""

from __future__ import annotations

import numpy as np
import tyro

from benchmarks.camera import live, stream
from benchmarks.camera.walks import Seen, across, watch, webcam
from gazempc.results.metrics import measure
from gazempc.robots.studio import Studio
from gazempc.types import FloatArray

RANGES_M = (0.7, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
SPOILT_M = (1.0, 2.0, 3.5)
TURNS_DEG = (45.0, 60.0)
_FRAMES = 60
_LIVE = (*(("reference", each) for each in ("reactive", "lookahead", "mpc")), ("fetch", "lookahead"), ("fetch", "mpc"))


def figures(seen: Seen) -> tuple[float, ...]:
    """Metrics of a walk.

    Args:
        seen: Detection errors.

    Returns:
        Detection rate, RMS bearing error, mean and standard deviation of the range error, RMS error of the head's yaw,
        mean NEES (3 for a consistent covariance), number of false observations, number of track identities, and
        processor time per image; NaN without observations.
    """

    def rms(values: FloatArray) -> float:
        return float(np.sqrt(np.mean(np.square(values)))) if values.size else np.nan

    off = seen.range_error if seen.range_error.size else np.array([np.nan])
    return (
        *(100 * seen.found, rms(seen.bearing_deg), 100 * float(np.mean(off)), 100 * float(np.std(off))),
        *(rms(seen.yaw_error_deg), rms(np.sqrt(seen.nees)) ** 2, seen.others, seen.names, float(np.mean(seen.cpu_ms))),
    )


def main() -> None:
    """Measure and print."""
    studio = Studio()
    walks = {f"across at {range_m:g} m": watch(studio, across(range_m), _FRAMES) for range_m in RANGES_M}
    for range_m in SPOILT_M:
        walks[f"across at {range_m:g} m, cheap webcam"] = watch(studio, across(range_m), _FRAMES, webcam)
    for turn in TURNS_DEG:
        walks[f"across at 2 m, head turns by {turn:g} deg"] = watch(studio, across(2.0, yaw_deg=turn), _FRAMES)
    walks["no person"] = watch(studio, lambda _: None, _FRAMES)
    print(f"{'walk':<38} found  bearing  range: bias, sd   yaw  nees  others  names    cpu")
    print(f"{'':<38}   [%]    [deg]         [%]  [%] [deg]                       [ms]")
    for name, seen in walks.items():
        form = "{:<38} {:5.0f} {:8.2f} {:11.1f} {:4.1f} {:5.1f} {:5.1f} {:7} {:6} {:6.1f}"
        print(form.format(name, *figures(seen)), flush=True)
    capture_ms = stream.capture_errors_ms()
    print(
        f"time of capture, {capture_ms.size} pictures of a stream: late by {np.median(capture_ms):.1f} ms (median), "
        f"{np.percentile(capture_ms, 95):.1f} ms (95 %)"
    )
    for neck, controller in _LIVE:
        log, camera = live.run(studio, controller=controller, neck_name=neck)
        metrics = measure(log)
        within = [100 * share for share in (metrics.eye_contact_2p6, metrics.eye_contact_4)]
        print(
            f"live, neck {neck}, {controller}: {camera.pictures} pictures, {log.capture_time_s.size} observations, "
            f"gaze error {metrics.gaze_error_rms_deg:.2f} deg RMS, eye contact {within[0]:.0f} % within 2.6 deg, "
            f"{within[1]:.0f} % within 4 deg",
            flush=True,
        )
    studio.close()


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.camera", description=__doc__)
