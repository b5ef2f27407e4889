"""Picture of shifts of gaze beside what is published of people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.eyes.shifts import Shift
from gazempc.neck.human import eye_velocity_rad_s, head_velocity_rad_s
from gazempc.results.figures.style import COLOURS, DPI, readable

_HEAD, _EYE, _GAZE, _PEOPLE = COLOURS[0], COLOURS[1], "0.2", "0.45"
_SHOWN_DEG = (20.0, 60.0)
_SHOWN_S = 1.6
_WIDTH_INCHES = 10.5


def draw(shifts: Sequence[Shift], scale: float, title: str, path: Path) -> None:
    """Draw two shifts over time, and both main sequences.

    Args:
        shifts: Shifts of the neck.
        scale: Share of a person's head velocity that the motors bear.
        title: Above the picture.
        path: PNG file to write.
    """
    with readable(_WIDTH_INCHES):
        figure = Figure(figsize=(_WIDTH_INCHES, 7.0), layout="constrained")
        panels = figure.subplots(2, 2)
        sideways = [shift for shift in shifts if shift.direction == "sideways"]
        for panel, amplitude_deg in zip(panels[0], _SHOWN_DEG, strict=True):
            shift = min(sideways, key=lambda each: abs(each.amplitude_deg - amplitude_deg))
            panel.plot(shift.times_s, shift.head_deg + shift.eye_deg, color=_GAZE, lw=2.4, label="gaze")
            panel.plot(shift.times_s, shift.head_deg, color=_HEAD, lw=1.8, label="head")
            panel.plot(shift.times_s, shift.eye_deg, color=_EYE, lw=1.8, label="eyes in the head")
            panel.set(xlim=(0.0, _SHOWN_S), xlabel="time since the person is known (s)", ylabel="angle (deg)")
            panel.set_title(f"shift of {shift.amplitude_deg:.0f} deg sideways", fontsize="medium")
        panels[0, 1].legend(frameon=False)
        laws = (
            (panels[1, 0], "head", head_velocity_rad_s, scale, _HEAD, f"people, x {scale:.2f}"),
            (panels[1, 1], "eyes", eye_velocity_rad_s, 1.0, _EYE, "people"),
        )
        for panel, name, law, share, colour, label in laws:
            points = [
                (abs(s.head_deg[-1]), s.head_peak_deg_s) if name == "head" else (s.eye_deg.max(), s.eye_peak_deg_s)
                for s in shifts
            ]
            amplitudes_deg = np.linspace(0.5, max(x for x, _ in points) * 1.05, 100)
            people = [np.rad2deg(share * law(float(np.deg2rad(each)))) for each in amplitudes_deg]
            panel.plot(amplitudes_deg, people, color=_PEOPLE, ls=(0, (5, 2)), lw=1.8, label=label)
            panel.plot(*zip(*points, strict=True), "o", color=colour, ms=6, label="this neck")
            panel.set(
                xlabel=f"amplitude of the {name} (deg)", ylabel="peak velocity (deg/s)", xlim=(0, None), ylim=(0, None)
            )
            panel.set_title(f"main sequence of the {name}", fontsize="medium")
            panel.legend(frameon=False, loc="lower right")
        for panel in panels.flat:
            panel.grid(color="0.9", lw=0.6)
            panel.spines[["top", "right"]].set_visible(False)
        figure.suptitle(title)
        figure.savefig(path, dpi=DPI)
