"""The robot's view with each controller, side by side, in real time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Ellipse
from matplotlib.transforms import Affine2D
from PIL import Image

from gazempc.neck.kinematics import gaze_ray
from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures.known import running_contact, shown_head
from gazempc.results.figures.style import CONTACT_COLOUR, Logs, Style, recording_title, styles
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg
from gazempc.types import FloatArray

# GIF counts time in hundredths of a second, so only a frame period of whole hundredths plays in real time.
FRAME_MS = 100
# Time to read the final figures before the animation starts again.
LAST_FRAME_MS = 1500
_HEAD_WIDTH_M, _HEAD_HEIGHT_M = 0.16, 0.23
_FIELD_DEG = 20.0
_DPI = 100
_PANEL_PX, _SIDE_PX, _BELOW_PX, _HEIGHT_PX = 225, 9, 46, 300
_COLOURS = 96
_NO_CONTACT_COLOUR = "0.6"


def head_offset_deg(log: Log) -> FloatArray:
    """Angular position of the head in the robot's view.

    Args:
        log: The run.

    Returns:
        Offset of the true head from the gaze axis at each tick, to the right and up as the robot sees it,
        shape (M, 2), degrees; its length is the gaze error.
    """
    eye, direction = gaze_ray(log.neck.geometry, log.joint_position_rad)
    to_head = log.head_true_base_m - eye
    pan = np.arctan2(direction[:, 1], direction[:, 0])
    right = np.stack([np.sin(pan), -np.cos(pan), np.zeros_like(pan)], axis=-1)
    across = np.stack(
        [np.sum(to_head * right, axis=-1), np.sum(to_head * np.cross(right, direction), axis=-1)], axis=-1
    )
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    # Length from the error angle, not its tangents: also valid for a head beside or behind the gaze.
    return np.asarray(gaze_error_deg(log)[:, None] * across / np.maximum(length, 1e-12))


def frame_times(length_s: float) -> FloatArray:
    """Times of the frames: every `FRAME_MS`, and the end.

    Args:
        length_s: Length of the recording, seconds.

    Returns:
        Times from the start, shape (K,), seconds.
    """
    period_s = 1e-3 * FRAME_MS
    # The last but one frame is at least half a period earlier: a nearer one would look the same.
    return np.append(np.arange(0.0, length_s - 0.5 * period_s, period_s), length_s)


class _Panel:
    """One controller's view. Its artists are reused, which is much faster."""

    def __init__(self, figure: Figure, left_px: float, look: Style, log: Log) -> None:
        width_px, height_px = figure.get_size_inches() * _DPI
        side_px, left = _PANEL_PX - 2 * _SIDE_PX, (left_px + _SIDE_PX) / width_px
        box = (left, _BELOW_PX / height_px, side_px / width_px, side_px / height_px)
        self._ax = ax = figure.add_axes(box, facecolor="#F4F6F8")
        ax.set(xlim=(-_FIELD_DEG, _FIELD_DEG), ylim=(-_FIELD_DEG, _FIELD_DEG), xticks=[], yticks=[])
        label_box = {"fc": look.colour, "alpha": 0.4, "ec": "none", "pad": 1.5}
        ax.set_title(look.label, fontsize=9.5, pad=6, bbox=label_box)
        self._time_s = log.time_s - log.time_s[0]
        self._share = running_contact(log)
        log = shown_head(log).log
        self._offset_deg = head_offset_deg(log)
        self._contact = gaze_error_deg(log) <= CONTACT_DEG[0]
        eye, _ = gaze_ray(log.neck.geometry, log.joint_position_rad)
        self._distance_m = np.linalg.norm(log.head_true_base_m - eye, axis=1)

        # The face is drawn once in a square of side 1; this transform gives it its angular size and place.
        self._place = Affine2D()
        to_field = self._place + ax.transData
        features = (
            Ellipse((0, 0), 1, 1, fc="#E8B48C", ec="#5A3A22", lw=1.0),
            Circle((-0.2, 0.08), 0.07, fc="#3A2413", lw=0),
            Circle((0.2, 0.08), 0.07, fc="#3A2413", lw=0),
            Arc((0, -0.15), 0.42, 0.3, theta1=200, theta2=340, ec="#3A2413", lw=1.0),
        )
        for zorder, patch in enumerate(features, start=2):
            patch.set(transform=to_field, zorder=zorder)
            ax.add_artist(patch)
        self._pointer = ax.plot([], [], color="#B0603A", lw=4, solid_capstyle="butt")[0]
        self._cone = ax.add_patch(Circle((0, 0), CONTACT_DEG[0], fill=False, lw=1.6, zorder=8))
        ax.plot(0, 0, "+", color="0.35", ms=6, mew=0.8, zorder=1)
        self._text = ax.text(0.5, -0.05, "", transform=ax.transAxes, ha="center", va="top", fontsize=9)

    def show(self, at_s: float) -> None:
        """Update the artists to a time, seconds from the start."""
        tick = min(int(np.searchsorted(self._time_s, at_s - 1e-6)), len(self._time_s) - 1)
        x, y = self._offset_deg[tick]
        size = 2.0 * np.rad2deg(np.arctan(np.array([_HEAD_WIDTH_M, _HEAD_HEIGHT_M]) / 2 / self._distance_m[tick]))
        self._place.clear().scale(*size).translate(x, y)
        # An arrow at the edge points to a head out of view.
        beyond = max(abs(x), abs(y)) / _FIELD_DEG
        ends = np.array([0.86, 0.97]) / beyond if beyond > 1.0 else np.array([])
        self._pointer.set_data(x * ends, y * ends)
        share = self._share[tick]
        self._text.set_text("not scored yet" if np.isnan(share) else f"eye contact {100 * share:.0f} %")
        self.frame(bool(self._contact[tick]))

    def frame(self, contact: bool) -> None:
        """Colour frame and cone."""
        colour = CONTACT_COLOUR if contact else _NO_CONTACT_COLOUR
        self._cone.set_edgecolor(colour)
        for spine in self._ax.spines.values():
            spine.set(color=colour, linewidth=4 if contact else 1.5)


def animate(logs: Logs, path: Path) -> None:
    """Write an animation of the robot's view with each controller.

    Args:
        logs: The runs: controller name -> log of the same recording.
        path: GIF to write.
    """
    # At least two panels wide, so that the title has room.
    width_px = _PANEL_PX * max(len(logs), 2)
    figure = Figure(figsize=(width_px / _DPI, _HEIGHT_PX / _DPI), dpi=_DPI)
    canvas = FigureCanvasAgg(figure)
    left_px = (width_px - _PANEL_PX * len(logs)) / 2
    looks = styles(logs)
    panels = [_Panel(figure, left_px + i * _PANEL_PX, looks[name], log) for i, (name, log) in enumerate(logs.items())]
    edge = _SIDE_PX / width_px
    figure.text(edge, 0.975, recording_title(logs), va="top", fontsize=9.5)
    clock = figure.text(1 - edge, 0.975, "", va="top", ha="right", fontsize=9.5)
    view = f"The robot's view, ±{_FIELD_DEG:g}°. Circle: eye contact, ±{CONTACT_DEG[0]:g}°."
    if any(shown_head(log).rare for log in logs.values()):
        view = f"View ±{_FIELD_DEG:g}°, circle ±{CONTACT_DEG[0]:g}°. Between sparse frames the head is interpolated."
    figure.text(0.5, 0.015, view, ha="center", va="bottom", fontsize=8.5, color="0.35")

    def picture() -> Image.Image:
        canvas.draw()  # type: ignore[no-untyped-call]
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])  # type: ignore[no-untyped-call]

    times_s = frame_times(max(float(log.time_s[-1] - log.time_s[0]) for log in logs.values()))

    # One palette for all frames, from a picture with all colours: separate palettes flicker and enlarge the file.
    for k, panel in enumerate(panels):
        panel.show(float(times_s[-1]))
        panel.frame(k % 2 == 0)
    palette = picture().quantize(_COLOURS, kmeans=2)
    colours = np.reshape(palette.getpalette() or [], (-1, 3))
    # The nearest colour is looked up in steps of a few levels, which makes white grey if a near white is there.
    colours[colours.min(axis=1) > 248] = 255
    palette.putpalette(colours.ravel().tolist())

    def frames() -> Iterator[Image.Image]:
        for at_s in times_s:
            for panel in panels:
                panel.show(float(at_s))
            clock.set_text(f"{at_s:.2f} s")
            yield picture().quantize(palette=palette, dither=Image.Dither.NONE)

    rest = frames()
    first = next(rest)
    durations_ms = [FRAME_MS] * (len(times_s) - 1) + [LAST_FRAME_MS]
    first.save(path, save_all=True, append_images=rest, duration=durations_ms, loop=0, disposal=1)
