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
from gazempc.results.figures import overview as overview_module
from gazempc.results.figures.animation import animate, running_contact
from gazempc.results.figures.overview import attended, draw_birds_eye, draw_gaze_error, overview
from gazempc.results.figures.people import are_alike, draw_turns, has_attention, person_colour, question, turns
from gazempc.results.figures.style import recording_title
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
    assert said == ["person 1: chosen", "person 2: the one before left", "nobody", "thinking"]


def test_words_that_have_no_room_are_shorter_or_left_out(log):
    ax = drawn(lambda ax, log: draw_turns(ax, log, 0.0, 1.0, letters=30), log)
    assert [text.get_text() for text in ax.texts] == ["person 1", "2"]


def test_no_two_of_six_people_share_a_colour():
    assert len({person_colour(number) for number in range(1, 7)}) == 6


def test_runs_with_the_same_turns_are_alike(log):
    other = replace(log, attended_time_s=log.attended_time_s + np.array([0.0, 0.1, 0.0]))
    assert are_alike({"a": log, "b": replace(log, attended_time_s=log.attended_time_s + 1e-6)})
    assert not are_alike({"a": log, "b": other})


def test_the_title_of_many_recordings_names_the_first(log):
    def title(name):
        return recording_title({"mpc": replace(log, run=log.run.model_copy(update={"recording": name}))})

    assert title("subject03_R4+subject05_R1").startswith("subject03_R4+subject05_R1,")
    assert title("+".join(f"subject{k:02d}_R4" for k in range(1, 9))).startswith("subject01_R4 and 7 more,")


def test_the_overview_has_one_time_line_or_one_a_run(log, tmp_path, monkeypatch):
    rows = []
    monkeypatch.setattr(overview_module, "draw_turns", lambda ax, log, at, *_: rows.append(at))
    overview({"reactive": log, "mpc": log}, tmp_path / "alike.png")
    assert rows == [0.0]
    later = replace(log, attended_time_s=log.attended_time_s + 0.2)
    overview({"reactive": log, "mpc": later}, tmp_path / "unlike.png")
    assert rows == [0.0, 0.0, 1.0]
    assert "the person it attends to" in question({"mpc": log})


def test_one_person_all_the_time_has_no_time_line(tmp_path):
    plain = attention_log(error_in(3.0, 15.0, (1.0, 3.0)))
    assert not has_attention({"mpc": plain})
    [turn] = turns(plain)
    assert (turn.from_s, turn.to_s, turn.number) == (0.0, 3.0, 1)
    assert "a walking person" in question({"mpc": plain})


def test_paths_of_two_people_are_not_joined(log):
    ax = drawn(lambda ax, log: draw_birds_eye(ax, {"mpc": log}, detailed=False), log)
    bands = {line.get_label(): line for line in ax.lines if line.get_label().startswith("person")}
    assert set(bands) == {"person 1", "person 2"}
    assert set(bands["person 2"].get_xdata()) == {1.0}
    path = next(line for line in ax.lines if line.get_label() == "true head")
    left_m = np.asarray(path.get_xdata())
    assert not np.any(np.abs(np.diff(left_m)) > 0.5)


def test_contact_that_is_not_due_is_grey(log):
    ax = drawn(lambda ax, log: draw_gaze_error(ax, {"mpc": log}, detailed=False), log)
    grey = [patch for patch in ax.patches if colors.to_hex(patch.get_facecolor()) == colors.to_hex("0.92")]
    assert [(p.get_x(), p.get_x() + p.get_width()) for p in grey] == [(0.0, 1.0), pytest.approx((5.0, 6.5), abs=0.006)]


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
        (8.0, 10.0, "nobody"),
    ]
    assert dict(metrics.rows)["switches a minute"] == "6"
    assert line.rows == (
        ("0.50", "4.00", "person 1: chosen"),
        ("4.00", "8.00", "person 2: the one before left"),
        ("5.00", "6.50", "looks away: thinking"),
        ("8.00", "10.00", "nobody"),
    )
