"""Figures and animation: not blank, and consistent with the metrics."""

from dataclasses import replace

import numpy as np
import pytest
from builders.attention import attention_log, error_in
from builders.recordings import reordered, synthetic
from builders.replays import QUICK, replayed
from matplotlib import colors
from matplotlib.figure import Figure
from PIL import Image, ImageSequence
from scipy.spatial.transform import Rotation

from gazempc.loop.events import MEANINGS
from gazempc.neck.kinematics import gaze_ray
from gazempc.neck.spec import load_neck
from gazempc.results.figures.angles import angles
from gazempc.results.figures.animation import FRAME_MS, LAST_FRAME_MS, animate, frame_times, head_offset_deg
from gazempc.results.figures.birds_eye import draw_birds_eye
from gazempc.results.figures.known import known_title, parts, running_contact, shown_head
from gazempc.results.figures.overview import attended, draw_contact_bars, draw_gaze_error, overview
from gazempc.results.figures.people import person_colour
from gazempc.results.metrics import gaze_error_deg, measure
from gazempc.results.page.run_page import run_page
from gazempc.results.run_summary import LABELS
from gazempc.results.table import measured_again

EYES = load_neck("reference_eyes")
ALL = EYES.model_copy(update={"name": "all", "body": load_neck("reachy_mini_body").body})
ATTENDED = ((0.5, 1, "policy"), (4.0, 2, "left"), (8.0, 0, "no_person"))
AWAY = ((5.0, 6.5, "thinking"),)


@pytest.fixture(scope="module")
def logs():
    # Contact is lost and regained in the scored window.
    short = replayed(reordered(synthetic("subject03_R1"), range(72)), "reactive", settings=QUICK)
    others = {name: replace(short, run=short.run.model_copy(update={"controller": name})) for name in LABELS}
    return {**others, "mpc": replace(others["mpc"], joint_position_rad=0.9 * short.joint_position_rad)}


def _pixels(path):
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), dtype=float)


def test_head_offset_points_right_and_up(logs):
    # Seen along the gaze, a head turned to the right of it and above it.
    log = logs["mpc"]
    turned_rad = log.joint_position_rad + np.deg2rad([-3.0, 2.0])
    eye, direction = gaze_ray(log.neck.geometry, turned_rad)
    seen = replace(log, head_true_base_m=eye + 2.0 * direction)
    offset = head_offset_deg(seen)
    np.testing.assert_allclose(offset, np.broadcast_to([3.0, 2.0], offset.shape), atol=0.15)


@pytest.mark.parametrize(("draw", "count", "size"), [(angles, 4, (960, 900)), (overview, 1, (1600, 900))])
def test_the_figure_is_not_blank(logs, draw, count, size, tmp_path):
    draw(dict(list(logs.items())[-count:]), tmp_path / "figure.png")
    pixels = _pixels(tmp_path / "figure.png")
    assert pixels.shape[1] >= size[0]
    assert pixels.shape[0] == size[1]
    for half in (pixels[:, : size[0] // 2], pixels[:, size[0] // 2 :]):
        assert min(part.var() for part in np.array_split(half, 2)) > 50


@pytest.mark.slow
def test_the_animation_has_the_duration_of_the_run(logs, tmp_path):
    path = tmp_path / "gaze.gif"
    animate(dict(list(logs.items())[:2]), path)
    times_s = frame_times(float(logs["reactive"].time_s[-1]))
    durations_ms, frames = [], []
    with Image.open(path) as gif:
        for frame in ImageSequence.Iterator(gif):
            durations_ms.append(frame.info["duration"])
            frames.append(np.asarray(frame.convert("RGB"), dtype=float))
    assert durations_ms == [FRAME_MS] * (len(times_s) - 1) + [LAST_FRAME_MS]
    assert frames[0].shape == (300, 450, 3)
    assert np.abs(frames[-1] - frames[0]).max() > 50
    # Inter-frame compression: the corner is background in the last frame, too.
    assert (frames[-1][-2:, -2:] == 255).all()


def _known_at(logs, every):
    """The log of the MPC with the true head at some ticks only; 0 for never."""
    log = logs["mpc"]
    known = np.arange(log.time_s.size) % every == 0 if every else np.zeros(log.time_s.size, dtype=bool)
    return {"mpc": replace(log, head_true_base_m=np.where(known[:, None], log.head_true_base_m, np.nan))}


def test_a_sparse_true_head_is_drawn_as_points_with_a_note(logs):
    rare = _known_at(logs, 12)
    head = shown_head(rare["mpc"])
    assert head.rare
    assert "0.12 s apart" in known_title(rare)
    # On a straight walk the line from frame to frame is near the head.
    inside = np.isfinite(head.log.head_true_base_m).all(axis=1)
    assert inside.sum() > 200
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


def test_an_unknown_true_head_is_drawn_as_observed_with_a_note(logs, tmp_path):
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
    overview(unknown, tmp_path / "live.png")
    assert np.ptp(_pixels(tmp_path / "live.png")) > 0


def test_head_and_body_point_along_their_rotations():
    log = replayed(reordered(synthetic("subject03_R1"), range(45)), "reactive", settings=QUICK, neck=ALL)
    np.testing.assert_allclose(np.linalg.norm(head_offset_deg(log), axis=1), gaze_error_deg(log), atol=1e-6)
    k = log.time_s.size // 2
    joints = dict(zip(log.neck.joint_names, log.joint_position_rad[k], strict=True))
    body = Rotation.from_euler("z", joints["body_yaw"])
    head = body * Rotation.from_euler("z", joints["pan"]) * Rotation.from_euler("y", -joints["tilt"])
    expected = {"robot's head": head.apply([1, 0, 0]), "robot's body": body.apply([1, 0, 0])}
    found = {part.label: part.direction[k] for part in parts(log)}
    assert found.keys() == expected.keys()
    for label, direction in expected.items():
        np.testing.assert_allclose(found[label], direction, atol=1e-12)


@pytest.fixture(scope="module")
def attention():
    made = attention_log(error_in(10.0, 15.0, (1.0, 5.0), (6.5, 8.0)), ATTENDED, AWAY)
    heads_m = made.head_true_base_m.copy()
    heads_m[made.time_s >= 4.0, 1] = 1.0
    heads_m[made.time_s >= 8.0] = np.nan
    return replace(made, head_true_base_m=heads_m)


def test_time_lines_have_person_colours_and_the_share_of_the_metric(attention, tmp_path):
    attended({"reactive": attention, "mpc": attention}, tmp_path / "attended.png")
    with Image.open(tmp_path / "attended.png") as image:
        hues = {colors.to_hex(np.array(pixel[:3]) / 255) for _, pixel in image.convert("RGB").getcolors(1 << 20)}
    assert {colors.to_hex(person_colour(number)) for number in (1, 2)} <= hues
    share = running_contact(attention)
    assert np.isnan(share[attention.time_s < 0.99]).all()
    assert share[-1] == pytest.approx(measure(attention).eye_contact_2p6)


def test_the_report_lists_the_attended_people(attention):
    page = run_page({"mpc": attention}, [measured_again(attention)], [], MEANINGS, [], "command", {})
    _, metrics, line = page.tables
    [chart] = page.charts
    assert [(span.start, span.end, span.name) for span in chart.spans] == [
        (0.0, 1.0, "not scored"),
        (pytest.approx(5.0, abs=0.006), pytest.approx(6.5, abs=0.006), "looks away"),
        (0.5, 4.0, "person 1: chosen"),
        (4.0, 8.0, "person 2: previous person left"),
        (8.0, 10.0, "no person"),
    ]
    assert dict(metrics.rows)["switches a minute"] == "6"
    assert line.rows == (
        ("0.50", "4.00", "person 1: chosen"),
        ("4.00", "8.00", "person 2: previous person left"),
        ("5.00", "6.50", "looks away: thinking"),
        ("8.00", "10.00", "no person"),
    )
