"""Figures and animation: they exist, are not blank, and say what the metrics say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders.replays import replayed
from matplotlib.figure import Figure
from PIL import Image

from gazempc.neck.kinematics import gaze_ray
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.recording import Recording, Track
from gazempc.results.figures.angles import angles
from gazempc.results.figures.animation import (
    FRAME_MS,
    LAST_FRAME_MS,
    animate,
    frame_times,
    head_offset_deg,
    running_contact,
)
from gazempc.results.figures.birds_eye import draw_birds_eye
from gazempc.results.figures.known import known_title, shown_head
from gazempc.results.figures.overview import draw_contact_bars, draw_gaze_error, overview
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg, measure

CONTROLLERS = ("reactive", "lookahead", "mpc", "mpc+perfect")
Logs = dict[str, Log]
Draw = Callable[[Logs, Path], None]


def _first_frames(recording: Recording, count: int, *, behind: bool = False) -> Recording:
    turn = np.diag([-1.0, -1.0, 1.0]) if behind else np.eye(3)
    track = recording.truth
    cut = Track(
        head_position_m=track.head_position_m[:count] @ turn,
        head_quat_wxyz=track.head_quat_wxyz[:count],
        pelvis_position_m=track.pelvis_position_m[:count] @ turn,
        pelvis_quat_wxyz=track.pelvis_quat_wxyz[:count],
        valid=track.valid[:count],
    )
    return replace(recording, times_s=recording.times_s[:count], truth=cut, measured=None)


def _replay(recording: Recording, controllers: tuple[str, ...]) -> Logs:
    placed = place(recording, "recorded", 2.5, 1.2)
    return {name: replayed(placed, name) for name in controllers}


@pytest.fixture(scope="module")
def logs() -> Logs:
    # 2.4 s: long enough to lose and regain eye contact in the scored window.
    return _replay(_first_frames(load("subject03_R1"), 73), CONTROLLERS)


def _pixels(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), dtype=float)


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize(
    ("draw", "smallest"),
    [(angles, (900, 700)), (overview, (1600, 900))],
)
def test_figure_is_a_picture_that_is_not_blank(
    logs: Logs, draw: Draw, smallest: tuple[int, int], count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures: list[Figure] = []
    save = Figure.savefig

    def remember(figure: Figure, *args: object, **kwargs: object) -> None:
        figures.append(figure)
        save(figure, *args, **kwargs)

    monkeypatch.setattr(Figure, "savefig", remember)
    path = tmp_path / "figure.png"
    draw(dict(list(logs.items())[-count:]), path)

    pixels = _pixels(path)
    height, width = pixels.shape[:2]
    assert width >= smallest[0]
    assert height >= smallest[1]
    assert path.stat().st_size < 300_000
    (figure,) = figures
    assert figure.axes
    for ax in figure.axes:
        box = ax.get_position()
        rows = slice(int((1 - box.y1) * height) + 5, int((1 - box.y0) * height) - 5)
        columns = slice(int(box.x0 * width) + 5, int(box.x1 * width) - 5)
        assert pixels[rows, columns].var() > 50


def test_birds_eye_is_to_scale_and_left_is_left(logs: Logs) -> None:
    ax = Figure().subplots()
    draw_birds_eye(ax, logs)
    assert ax.get_aspect() == 1.0
    left, right = ax.get_xlim()
    assert left > right


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 4])
def test_animation_runs_in_real_time(logs: Logs, count: int, tmp_path: Path) -> None:
    path = tmp_path / "gaze.gif"
    animate(dict(list(logs.items())[:count]), path)
    log = logs["reactive"]
    times_s = frame_times(float(log.time_s[-1]))
    with Image.open(path) as gif:
        assert gif.n_frames == len(times_s)
        durations_ms, frames = [], []
        for index in range(gif.n_frames):
            gif.seek(index)
            durations_ms.append(gif.info["duration"])
            frames.append(np.asarray(gif.convert("RGB"), dtype=float))
    assert durations_ms == [FRAME_MS] * (len(times_s) - 1) + [LAST_FRAME_MS]
    assert FRAME_MS % 10 == 0
    assert frames[0].shape == (300, 900 if count == 4 else 450, 3)
    assert path.stat().st_size < 1_500_000
    assert np.abs(frames[-1] - frames[0]).max() > 50
    # Compression keeps the unchanged: the corner is the background in the last frame, too.
    assert (frames[-1][-2:, -2:] == 255).all()


def test_head_offset_points_right_and_up(logs: Logs) -> None:
    # Seen along the gaze, a head turned to the right of it and above it.
    log = logs["mpc"]
    turned_rad = log.joint_position_rad + np.deg2rad([-3.0, 2.0])
    eye, direction = gaze_ray(log.neck.geometry, turned_rad)
    seen = replace(log, head_true_base_m=eye + 2.0 * direction)
    offset = head_offset_deg(seen)
    np.testing.assert_allclose(offset, np.broadcast_to([3.0, 2.0], offset.shape), atol=0.15)


def test_running_contact_ends_at_the_eye_contact(logs: Logs) -> None:
    for log in logs.values():
        share = running_contact(log)
        assert np.isnan(share[log.time_s < 0.99]).all()
        assert share[-1] == pytest.approx(measure(log).eye_contact_2p6)


def _known_at(logs: Logs, every: int) -> Logs:
    """The true head at every so-manieth tick only; 0 for never."""
    some = {}
    for name, log in logs.items():
        known = np.arange(log.time_s.size) % every == 0 if every else np.zeros(log.time_s.size, dtype=bool)
        some[name] = replace(log, head_true_base_m=np.where(known[:, None], log.head_true_base_m, np.nan))
    return some


def test_a_head_that_is_known_at_rare_frames_is_drawn_as_points_and_said(logs: Logs) -> None:
    rare = _known_at({"mpc": logs["mpc"]}, 24)
    head = shown_head(rare["mpc"])
    assert head.rare
    assert "0.12 s apart" in known_title(rare)
    # On a straight walk the line from frame to frame is near the head.
    inside = np.isfinite(head.log.head_true_base_m).all(axis=1)
    assert inside.sum() > 400
    off_m = np.linalg.norm(head.log.head_true_base_m - logs["mpc"].head_true_base_m, axis=1)[inside]
    assert off_m.max() < 0.05
    for draw in (draw_birds_eye, draw_gaze_error):
        ax = Figure().subplots()
        draw(ax, rare)
        points = [line for line in ax.lines if line.get_marker() == "o" and len(line.get_xdata()) == head.known.sum()]
        assert len(points) == 1
        assert np.isfinite(points[0].get_ydata()).all()
    error_deg = gaze_error_deg(rare["mpc"])
    assert np.nanmax(np.abs(running_contact(rare["mpc"])[-1] - measure(rare["mpc"]).eye_contact_2p6)) < 1e-12
    assert np.isfinite(error_deg).sum() == head.known.sum()


def test_a_head_that_nobody_knows_is_drawn_as_it_was_observed_and_said(logs: Logs, tmp_path: Path) -> None:
    log = logs["mpc"]
    live = {"mpc": replace(log, run=log.run.model_copy(update={"kind": "live"}))}
    unknown = _known_at(live, 0)
    head = shown_head(unknown["mpc"])
    assert head.label == "head as observed"
    at = np.searchsorted(log.time_s, log.capture_time_s)
    drawn_m = head.log.head_true_base_m[np.minimum(at, log.time_s.size - 1)]
    assert np.nanmedian(np.linalg.norm(drawn_m - log.head_observed_base_m, axis=1)) < 0.02
    assert "the true head is unknown" in known_title(unknown)
    ax = Figure().subplots()
    draw_gaze_error(ax, unknown)
    assert any("the true head is unknown" in text.get_text() for text in ax.texts)
    ax = Figure().subplots()
    draw_contact_bars(ax, unknown)
    assert [text.get_text() for text in ax.texts] == ["not known"]
    for draw in (angles, overview):
        draw(unknown, tmp_path / "live.png")
        assert np.ptp(_pixels(tmp_path / "live.png")) > 0
