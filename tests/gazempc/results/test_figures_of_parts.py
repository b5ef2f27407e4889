"""Figures of necks with eyes and body, and of runs in which there is little to show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders.recordings import synthetic
from builders.replays import replayed
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image
from scipy.spatial.transform import Rotation

from gazempc.neck.spec import load_neck
from gazempc.results.figures.angles import angles
from gazempc.results.figures.animation import animate, head_offset_deg, part_offsets_deg
from gazempc.results.figures.known import head_alone, head_error_deg, parts
from gazempc.results.figures.overview import (
    birds_eye,
    draw_birds_eye,
    draw_contact_bars,
    draw_gaze_error,
    gaze_error,
    overview,
)
from gazempc.results.figures.style import series_look, styles
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg, measure

Logs = dict[str, Log]
DRAWN: tuple[Callable[[Logs, Path], None], ...] = (angles, birds_eye, gaze_error, overview)
PLAIN, EYES = load_neck("reference"), load_neck("reference_eyes")
ALL = EYES.model_copy(update={"name": "all", "body": load_neck("reachy_mini_body").body})
README_PX = 830


@pytest.fixture(scope="module", params=[PLAIN, ALL], ids=["plain", "eyes and body"])
def log(request: pytest.FixtureRequest) -> Log:
    return replayed(synthetic("subject02_R4"), "reactive", neck=request.param)


def without_truth(log: Log) -> Log:
    nowhere = np.full_like(log.head_true_base_m, np.nan)
    return replace(log, run=log.run.model_copy(update={"kind": "live"}), head_true_base_m=nowhere)


def without_person(log: Log) -> Log:
    rows = ("capture_time_s", "arrival_time_s", "head_observed_base_m", "person_id")
    rows += ("forecast_mean_base_m", "forecast_covariance_m2", "forecast_degrees_of_freedom", "forecast_true_base_m")
    return replace(without_truth(log), **{name: getattr(log, name)[:0] for name in rows})


def without_joints(log: Log) -> Log:
    nothing = np.full_like(log.joint_position_rad, np.nan)
    unread = np.full_like(log.joint_time_s, np.nan)
    return replace(log, joint_time_s=unread, joint_position_rad=nothing, joint_velocity_rad_s=nothing)


CASES = {
    "all known": lambda log: log,
    "the true head is unknown": without_truth,
    "no person was seen": without_person,
    "joints not read": without_joints,
    "nothing": lambda log: without_joints(without_person(log)),
}


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that are saved, which are not written."""
    saved: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *args, **kwargs: saved.append(figure))
    return saved


def texts(figure: Figure) -> list[Text]:
    return [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("draw", DRAWN)
def test_a_legend_names_what_is_drawn_and_what_is_missing_is_said(
    log: Log, draw: Callable[[Logs, Path], None], case: str, figures: list[Figure]
) -> None:
    draw({"reactive": CASES[case](log)}, Path("unused.png"))
    (figure,) = figures
    words = " ".join(text.get_text() for text in texts(figure))
    legend = [text.get_text() for each in figure.legends for text in each.get_texts()]
    assert ("true head" in legend) == (case in {"all known", "joints not read"} and draw in {angles, birds_eye})
    assert ("observed head" in legend) == (
        case not in {"no person was seen", "nothing"} and draw in {angles, birds_eye}
    )
    joints_drawn = {"joint", "gaze", "robot's head", "robot's body", "gaze, reactive"} & set(legend)
    if case in {"joints not read", "nothing"}:
        assert not joints_drawn
        assert "the joints were not read" in words or "no person was seen" in words or "unknown" in words
    elif draw in {angles, birds_eye} and not (case == "no person was seen" and draw is birds_eye):
        assert {part.label for part in parts(log)} <= joints_drawn
    if case in {"no person was seen", "nothing"} and draw is not angles:
        assert "no person was seen" in words or "unknown" in words
    elif case == "the true head is unknown":
        assert "the true head is unknown" in words


@pytest.mark.parametrize("draw", DRAWN)
@pytest.mark.parametrize("count", [1, 4])
def test_letters_are_large_enough_at_the_width_of_a_readme(
    log: Log, draw: Callable[[Logs, Path], None], count: int, figures: list[Figure]
) -> None:
    names = ("reactive", "lookahead", "mpc", "perfect")[:count]
    draw(dict.fromkeys(names, log), Path("unused.png"))
    (figure,) = figures
    sizes = [text.get_fontsize() * README_PX / (72.0 * figure.get_figwidth()) for text in texts(figure)]
    assert min(sizes) > 9.0
    assert np.median(sizes) > 11.0


def test_parts_point_where_rotations_say(log: Log) -> None:
    k = log.time_s.size // 2
    joints = dict(zip(log.neck.joint_names, log.joint_position_rad[k], strict=True))
    body = Rotation.from_euler("z", joints.get("body_yaw", 0.0))
    head = body * Rotation.from_euler("z", joints["pan"]) * Rotation.from_euler("y", -joints["tilt"])
    wanted = {"robot's head": head.apply([1, 0, 0])} if "eye_pan" in joints else {}
    wanted |= {"robot's body": body.apply([1, 0, 0])} if "body_yaw" in joints else {}
    found = {part.label: part.direction[k] for part in parts(log)}
    assert found.keys() == wanted.keys()
    for label, direction in wanted.items():
        np.testing.assert_allclose(found[label], direction, atol=1e-12)


def test_the_error_of_the_head_alone_is_that_of_its_direction(log: Log) -> None:
    alone = head_error_deg(log)
    if log.neck.eyes is None:
        assert alone is None
        return
    to_head = log.head_true_base_m / np.linalg.norm(log.head_true_base_m, axis=1, keepdims=True)
    direction = next(part.direction for part in parts(log) if part.label == "robot's head")
    # The reference neck has all axes and the eye in one point.
    by_hand = np.degrees(np.arccos(np.clip(np.sum(to_head * direction, axis=1), -1, 1)))
    np.testing.assert_allclose(alone, by_hand, atol=1e-4)
    assert alone.max() > 2.0 * gaze_error_deg(log).max(), "the eyes must be worth showing"


def test_bars_and_curves_of_eyes_and_head_are_apart(log: Log) -> None:
    ax = Figure().subplots()
    draw_contact_bars(ax, {"reactive": log})
    alone = head_alone(log)
    wanted = [100 * measure(each).eye_contact_2p6 for each in (log, alone) if each is not None]
    assert [bar.get_width() for bar in ax.patches] == pytest.approx(wanted)
    ax = Figure().subplots()
    assert draw_gaze_error(ax, {"reactive": log}, detailed=False) == (alone is not None)
    dashed = [line for line in ax.lines if line.get_linestyle() == "--" and len(line.get_xdata())]
    assert len(dashed) == (alone is not None)


def lines_of(ax: Axes, style: str) -> int:
    return sum(line.get_linestyle() == style and len(line.get_xdata()) > 0 for line in ax.lines)


def test_birds_eye_shows_the_parts_beside_the_gaze(log: Log) -> None:
    ax = Figure().subplots()
    beside = draw_birds_eye(ax, {"reactive": log}, detailed=True)
    assert [part.label for part in beside] == [part.label for part in parts(log)]
    rays = sum(len(line.get_xdata()) == 2 and line.get_linestyle() == "-" for line in ax.lines)
    assert lines_of(ax, "--") == rays * len(beside)


def test_the_eye_sees_the_head_where_the_eyes_are_turned_away_from(log: Log) -> None:
    """Eyes turned left and up: the head points to the right of the gaze and below it."""
    offset = head_offset_deg(log)
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), gaze_error_deg(log), atol=1e-6)
    if log.neck.eyes is None:
        return
    joints = log.joint_position_rad.copy()
    joints[:, 2:4] = np.deg2rad([6.0, 3.0])
    marker, found = part_offsets_deg(replace(log, joint_position_rad=joints))["robot's head"]
    assert marker == "s"
    np.testing.assert_allclose(found, np.broadcast_to([6.0, -3.0], found.shape), atol=0.3)


def test_the_animation_says_which_shape_is_what(log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    write = Figure.text

    def remember(figure: Figure, x: float, y: float, text: str, **look: object) -> Text:
        said.append(text)
        return write(figure, x, y, text, **look)

    monkeypatch.setattr(Figure, "text", remember)
    short = log.time_s <= 1.3
    rows = [n for n in vars(log) if n.startswith(("time_s", "head_true", "joint_", "command_"))]
    animate({"reactive": replace(log, **{n: getattr(log, n)[short] for n in rows})}, tmp_path / "gaze.gif")
    shapes = " ".join(said)
    assert ("Square: robot's head" in shapes) == (log.neck.eyes is not None)
    assert ("Triangle: robot's body" in shapes) == (log.neck.body is not None)
    with Image.open(tmp_path / "gaze.gif") as gif:
        assert gif.n_frames > 10


def test_controllers_of_the_users_own_never_share_a_colour_in_a_picture() -> None:
    names = ["mpc", "a", "b", "c", "d", "e"]
    assert len({look.colour for look in styles(names).values()}) == len(names)
    assert styles(["mine"])["mine"] == styles(["mpc", "mine"])["mine"]


def test_lines_are_told_apart_without_colours() -> None:
    looks = [series_look(k) for k in range(6)]
    for name in ("line", "marker", "hatch"):
        assert len({str(getattr(look, name)) for look in looks}) == len(looks)
