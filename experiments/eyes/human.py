"""Compare gaze shifts with published ones of people: `python -m experiments.eyes.human --neck furhat --out out/human`.

Prints every shift beside the published figures, with marks on significant differences, and draws them. The neck moves
with the limits and shares of `--motion human`. A shift is from straight ahead to a standing person.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from pydantic import Field

import gazempc as gz
from experiments.engine.command import Command
from experiments.pages import markdown
from gazempc.errors import SettingsError
from gazempc.neck import limits
from gazempc.neck.kinematics import gaze_error_rad, gaze_ray
from gazempc.results.figures.style import COLOURS, DPI, readable
from gazempc.settings import Settings
from gazempc.sim.replay import replay_scene
from gazempc.sim.scene import Scene
from gazempc.types import FloatArray

Direction = Literal["sideways", "up", "down"]

_DISTANCE_M = 2.5
_DURATION_S = 4.0
# Onset of a movement: share of the peak velocity.
_ONSET_SHARE = 0.05
# Tolerance of the arrival of the gaze; eye contact of people allows 2.6 deg.
_THERE_RAD = math.radians(1.0)
# Without errors, to isolate the motion.
_SENSOR = gz.SensorSpec(name="exact", source="no errors", rate_hz=30.0, latency_s=0.066)


@dataclass(frozen=True)
class Shift:
    """One gaze shift, from straight ahead with head and eyes at rest.

    Attributes:
        direction: Direction of the shift.
        amplitude_deg: Amplitude of the gaze.
        times_s: Times since the first observation of the person, shape (T,).
        head_deg: Angle of the head in the direction of the shift, shape (T,).
        eye_deg: Angle of the eyes in the head, shape (T,).
        there_s: Time of arrival of the gaze.
    """

    direction: Direction
    amplitude_deg: float
    times_s: FloatArray
    head_deg: FloatArray
    eye_deg: FloatArray
    there_s: float

    @property
    def head_share(self) -> float:
        """Final contribution of the head to the shift."""
        return float(self.head_deg[-1]) / self.amplitude_deg

    @property
    def lead_s(self) -> float:
        """Onset of the head minus onset of the eyes."""
        return self._onset_s(self.head_deg) - self._onset_s(self.eye_deg)

    @property
    def head_peak_deg_s(self) -> float:
        """Peak velocity of the head."""
        return float(self._speed(self.head_deg).max())

    @property
    def eye_peak_deg_s(self) -> float:
        """Peak velocity of the eyes in the head."""
        return float(self._speed(self.eye_deg).max())

    def _speed(self, angle_deg: FloatArray) -> FloatArray:
        return np.abs(np.gradient(angle_deg, self.times_s))

    def _onset_s(self, angle_deg: FloatArray) -> float:
        speed = self._speed(angle_deg)
        return float(self.times_s[np.flatnonzero(speed > _ONSET_SHARE * speed.max())[0]])


def make_shift(neck: gz.NeckSpec, controller: str, direction: Direction, amplitude_deg: float) -> Shift:
    """Simulate a shift.

    Args:
        neck: A neck with eyes and without a body.
        controller: Name of a controller.
        direction: Direction of the shift.
        amplitude_deg: Amplitude.

    Returns:
        The shift.
    """
    axis = 0 if direction == "sideways" else 1
    sign = -1.0 if direction == "down" else 1.0
    angle_rad = sign * math.radians(amplitude_deg)
    ahead, aside = math.cos(angle_rad), math.sin(angle_rad)
    towards = np.array([ahead, aside, 0.0] if axis == 0 else [ahead, 0.0, aside])
    eye_m, _ = gaze_ray(neck.geometry, np.zeros(neck.joints))
    times_s = np.arange(0.0, _DURATION_S, 1.0 / _SENSOR.rate_hz)
    heads_m = np.tile(eye_m + _DISTANCE_M * towards, (times_s.size, 1))
    walk = gz.recording_from_arrays("shift", times_s, heads_m, in_base_frame=True)
    scene = Scene(walk, neck, _SENSOR, start_rad=(0.0, 0.0))
    log = replay_scene(scene, controller, "perfect").log
    known = log.time_s >= _SENSOR.latency_s
    joints = log.joint_position_rad[known]
    since_s = log.time_s[known] - _SENSOR.latency_s
    there = gaze_error_rad(neck.geometry, joints, heads_m[0]) < _THERE_RAD
    head_deg, eye_deg = (sign * np.rad2deg(joints[:, i]) for i in (axis, 2 + axis))
    there_s = float(since_s[np.flatnonzero(there)[0]]) if there.any() else math.nan
    return Shift(direction, amplitude_deg, since_s, head_deg, eye_deg, there_s)


_HEAD, _EYE, _GAZE, _PEOPLE = COLOURS[0], COLOURS[1], "0.2", "0.45"
_SHOWN_DEG = (20.0, 60.0)
_SHOWN_S = 1.6
_WIDTH_INCHES = 10.5


def draw(shifts: Sequence[Shift], scale: float, title: str, path: Path) -> None:
    """Draw two shifts over time, and both main sequences.

    Args:
        shifts: Shifts of the neck.
        scale: Share of a person's head velocity that the motors reach.
        title: Title of the figure.
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
            panel.set(xlim=(0.0, _SHOWN_S), xlabel="time since the first observation (s)", ylabel="angle (deg)")
            panel.set_title(f"shift of {shift.amplitude_deg:.0f} deg sideways", fontsize="medium")
        panels[0, 1].legend(frameon=False)
        laws = (
            (panels[1, 0], "head", limits.head_velocity_rad_s, scale, _HEAD, f"people, x {scale:.2f}"),
            (panels[1, 1], "eyes", limits.eye_velocity_rad_s, 1.0, _EYE, "people"),
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


_SHARES = {"sideways": limits.HEAD_SHARE_PAN, "up": limits.HEAD_SHARE_UP, "down": limits.HEAD_SHARE_DOWN}
_AMPLITUDES_DEG: dict[Direction, tuple[float, ...]] = {
    "sideways": (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0),
    "up": (10.0, 20.0, 30.0),
    "down": (10.0, 20.0, 30.0),
}
# Published lead of the eyes over the head, at two amplitudes of sideways shifts.
_LEAD_AT_DEG, _LEAD_S = (10.0, 40.0), (0.140, 0.050)
# Variation among people, which is larger than this: absolute, and relative for peak velocities.
_SPREAD_SHARE, _SPREAD_S, _SPREAD_OF_PEAK = 0.03, 0.02, 0.1
_COLUMNS = ("head's share [%]", "eyes ahead [ms]", "head's peak [deg/s]", "eyes' peak [deg/s]")
# Least head amplitude for a main sequence.
_LEAST_HEAD_DEG = 3.0


class HumanSettings(Settings):
    """Settings of `python -m experiments.eyes.human`."""

    neck: str = Field(default="reference_eyes", description="Shipped neck or a .toml file, with eyes")
    controller: Literal["mpc", "lookahead"] = Field(default="mpc", description="Controller")
    out: Path = Field(default=Path("out/human"), description="Output folder")


class BesidePeople(NamedTuple):
    """A measured quantity of a shift and the published value.

    Attributes:
        ours: Measured on the neck.
        people: Published value; of a head velocity, scaled to the motors.
        spread: Variation among people; a smaller difference is not significant.
    """

    ours: float
    people: float
    spread: float


def compared(shift: Shift, scale: float) -> dict[str, BesidePeople]:
    """Quantities of a shift with published values.

    Args:
        shift: The shift.
        scale: Share of a person's head velocity that the motors reach.

    Returns:
        Quantities by `_COLUMNS`, those with a published value.
    """
    share, lead, head_peak, eye_peak = _COLUMNS
    found = {share: BesidePeople(100 * shift.head_share, 100 * _SHARES[shift.direction], 100 * _SPREAD_SHARE)}
    if shift.direction == "sideways" and _LEAD_AT_DEG[0] <= shift.amplitude_deg <= _LEAD_AT_DEG[1]:
        lead_s = float(np.interp(shift.amplitude_deg, _LEAD_AT_DEG, _LEAD_S))
        found[lead] = BesidePeople(1e3 * shift.lead_s, 1e3 * lead_s, 1e3 * _SPREAD_S)
    head_deg, eye_deg = abs(float(shift.head_deg[-1])), float(shift.eye_deg.max())
    if head_deg > _LEAST_HEAD_DEG:
        law = math.degrees(scale * limits.head_velocity_rad_s(math.radians(head_deg)))
        found[head_peak] = BesidePeople(shift.head_peak_deg_s, law, _SPREAD_OF_PEAK * law)
    law = math.degrees(limits.eye_velocity_rad_s(math.radians(eye_deg)))
    return found | {eye_peak: BesidePeople(shift.eye_peak_deg_s, law, _SPREAD_OF_PEAK * law)}


def make_shifts(neck: gz.NeckSpec, controller: str) -> list[Shift]:
    """All shifts of the comparison within the range of the neck.

    Args:
        neck: The neck, with its limits and shares.
        controller: Name of a controller.

    Returns:
        Sideways, up and down, each in order of amplitude.
    """
    low, high = neck.position_min_rad, neck.position_max_rad
    reach_rad = {"sideways": high[0] + high[2], "up": high[1] + high[3], "down": -(low[1] + low[3])}
    return [
        make_shift(neck, controller, direction, amplitude_deg)
        for direction, amplitudes_deg in _AMPLITUDES_DEG.items()
        for amplitude_deg in amplitudes_deg
        if math.radians(amplitude_deg) < reach_rad[direction]
    ]


def table(shifts: Sequence[Shift], scale: float) -> str:
    """Table of all shifts, one per line.

    Args:
        shifts: The shifts.
        scale: See `compared`.

    Returns:
        A table in Markdown, with its explanation.
    """
    rows = []
    for shift in shifts:
        row = {name: _cell(each) for name, each in compared(shift, scale).items()}
        label = f"{shift.direction} {shift.amplitude_deg:.0f}"
        rows.append((label, f"{shift.there_s:.2f}", *(row.get(name, "") for name in _COLUMNS)))
    text = "Figures of the neck, in brackets of people; * significant difference.\n\n"
    return text + markdown(("shift [deg]", "on target [s]", *_COLUMNS), rows)


def _cell(each: BesidePeople) -> str:
    fits = abs(each.ours - each.people) < each.spread
    return f"{each.ours:.0f} ({each.people:.0f}){'' if fits else ' *'}"


def _run(settings: HumanSettings, _: str) -> int:
    given = gz.load_neck(settings.neck)
    neck = limits.with_motion(given, "human")
    if neck.body is not None:
        raise SettingsError(f"--neck {settings.neck}: its body takes part in large shifts; accepted: eyes and no body")
    scale = min(limits.motor_scale(given.pan), limits.motor_scale(given.tilt))
    shifts = make_shifts(neck, settings.controller)
    print(f"Neck {neck.name}, {settings.controller}. The motors reach {scale:.2f} of the velocity of people's heads.")
    print(table(shifts, scale))

    settings.out.mkdir(parents=True, exist_ok=True)
    path = settings.out / f"{neck.name}_{settings.controller}.png"
    draw(shifts, scale, f"{neck.name}, {settings.controller}, --motion human", path)
    print(f"Written: {path}")
    return 0


main = Command("eyes.human", HumanSettings, __doc__, _run).main

if __name__ == "__main__":
    sys.exit(main())
