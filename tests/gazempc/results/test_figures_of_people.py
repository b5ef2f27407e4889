"""Figures of runs among several people: who is looked at and why stands in them as in the log."""

from dataclasses import replace

import numpy as np
import pytest
from builders.attention import attention_log, error_in
from matplotlib import colors
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from gazempc.loop.events import MEANINGS
from gazempc.results.figures.animation import animate, running_contact
from gazempc.results.figures.overview import attended
from gazempc.results.figures.people import are_alike, draw_turns, person_colour
from gazempc.results.metrics import measure
from gazempc.results.page.run_page import run_page
from gazempc.results.table import measured_again

ATTENDED = ((0.5, 1, "policy"), (4.0, 2, "left"), (8.0, 0, "nobody"))
AWAY = ((5.0, 6.5, "thinking"),)


@pytest.fixture(scope="module")
def log():
    made = attention_log(error_in(10.0, 15.0, (1.0, 5.0), (6.5, 8.0)), ATTENDED, AWAY)
    heads_m = made.head_true_base_m.copy()
    heads_m[made.time_s >= 4.0, 1] = 1.0
    heads_m[made.time_s >= 8.0] = np.nan
    return replace(made, head_true_base_m=heads_m)


def drawn(draw, log):
    ax = Figure().subplots()
    draw(ax, log)
    return ax


def test_each_turn_is_a_bar_in_the_colour_of_its_person_and_says_why(log):
    ax = drawn(lambda ax, log: draw_turns(ax, log, 0.0, 1.0, letters=200), log)
    bars = [patch for patch in ax.patches if isinstance(patch, Rectangle)]
    spans = [(bar.get_x(), bar.get_x() + bar.get_width()) for bar in bars]
    assert spans == [pytest.approx(span) for span in ((0.5, 4.0), (4.0, 8.0), (8.0, 10.0), (5.0, 6.5))]
    assert [colors.to_hex(bar.get_facecolor()) for bar in bars[:3]] == [
        colors.to_hex(person_colour(number)) for number in (1, 2, 0)
    ]
    assert bars[3].get_hatch()
    said = [text.get_text() for text in ax.texts]
    assert said == ["person 1: chosen", "person 2: the one before left", "no person", "thinking"]


def test_runs_with_the_same_turns_are_alike(log):
    other = replace(log, attended_time_s=log.attended_time_s + np.array([0.0, 0.1, 0.0]))
    assert are_alike({"a": log, "b": replace(log, attended_time_s=log.attended_time_s + 1e-6)})
    assert not are_alike({"a": log, "b": other})


def test_the_animations_last_share_is_the_metric(log):
    assert running_contact(log)[-1] == pytest.approx(measure(log).eye_contact_2p6)


def test_pictures_are_drawn(log, tmp_path):
    attended({"reactive": log, "mpc": log}, tmp_path / "attended.png")
    short = attention_log(error_in(1.3, 15.0), ((0.1, 1, "policy"), (0.8, 2, "policy")))
    animate({"mpc": short}, tmp_path / "gaze.gif")
    with Image.open(tmp_path / "attended.png") as image:
        hues = {colors.to_hex(np.array(pixel[:3]) / 255) for _, pixel in image.convert("RGB").getcolors(1 << 20)}
    assert {colors.to_hex(person_colour(number)) for number in (1, 2)} <= hues
    with Image.open(tmp_path / "gaze.gif") as image:
        assert image.size == (450, 318)


def test_the_report_says_whom_the_gaze_was_for(log):
    page = run_page({"mpc": log}, [measured_again(log)], [], MEANINGS, [], "command", {})
    _, metrics, line = page.tables
    [chart] = page.charts
    assert [(span.start, span.end, span.name) for span in chart.spans] == [
        (0.0, 1.0, "not scored"),
        (pytest.approx(5.0, abs=0.006), pytest.approx(6.5, abs=0.006), "looks away"),
        (0.5, 4.0, "person 1: chosen"),
        (4.0, 8.0, "person 2: the one before left"),
        (8.0, 10.0, "no person"),
    ]
    assert dict(metrics.rows)["switches a minute"] == "6"
    assert line.rows == (
        ("0.50", "4.00", "person 1: chosen"),
        ("4.00", "8.00", "person 2: the one before left"),
        ("5.00", "6.50", "looks away: thinking"),
        ("8.00", "10.00", "no person"),
    )
