"""A neck file from a data sheet: stated, assumed and asked values."""

import datetime
import math

import pytest

from gazempc.identify import identify
from gazempc.neck.spec import load_neck

SHEET = ["--sheet.pan-deg", "-70", "80", "--sheet.tilt-deg", "-30", "40", "--sheet.speed", "60 rpm"]


def test_options_alone_make_a_file_that_marks_assumed_values(tmp_path, capsys):
    path = tmp_path / "sub" / "mine.toml"
    words = [*SHEET, "--sheet.tilt-speed", "90 deg/s", "--sheet.head-view-deg", "69", "42"]
    assert identify.main(["--new", str(path), *words]) == 0
    said = capsys.readouterr().out
    assert str(path) in said
    neck = load_neck(path)
    assert neck.name == "mine"
    assert datetime.date.today().isoformat() in neck.source
    assert "assumed" in neck.source
    assert (neck.pan.position_min_deg, neck.pan.position_max_deg) == (-70.0, 80.0)
    assert (neck.tilt.position_min_deg, neck.tilt.position_max_deg) == (-30.0, 40.0)
    assert neck.head_view_deg == (69.0, 42.0)
    # The rules: 0.8 of the top speed, reached in 0.2 s, its acceleration in 0.05 s.
    for axis, top_rad_s in ((neck.pan, 2 * math.pi), (neck.tilt, math.pi / 2)):
        assert axis.velocity_max_rad_s == pytest.approx(0.8 * top_rad_s, rel=1e-3)
        assert axis.velocity_max_rad_s / axis.acceleration_max_rad_s2 == pytest.approx(0.2, rel=1e-3)
        assert axis.acceleration_max_rad_s2 / axis.jerk_max_rad_s3 == pytest.approx(0.05, rel=1e-3)
        assert (axis.natural_frequency_rad_s, axis.damping_ratio, axis.dead_time_s) == (12.0, 0.9, 0.1)
    text = path.read_text(encoding="utf-8")
    assert (text.count("# assumed"), text.count("# data sheet")) == (13, 5)


def test_a_speed_that_the_range_leaves_no_room_for_is_doubted(tmp_path, capsys):
    """By the rules of thumb reaching a speed and stopping takes 0.25 s of it: of 150 and 70 deg 10.5 and 4.9 rad/s."""
    sheet = ["--sheet.pan-deg", "-75", "75", *SHEET[3:-1], "11 rad/s"]
    assert identify.main(["--new", str(tmp_path / "mine.toml"), *sheet]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert [line.split(": ")[1] for line in printed if line.startswith("Warning: ")] == ["tilt"]


def test_missing_values_are_asked_for_until_one_can_be_read(tmp_path, monkeypatch, capsys):
    answers = iter(["-70, 80", "fast", "0.2 s/60deg", "10 50", "40 -30", "5.2 rad/s"])
    asked = []

    def answer(question):
        asked.append(question)
        return next(answers)

    monkeypatch.setattr("builtins.input", answer)
    assert identify.main(["--new", str(tmp_path / "asked.toml")]) == 0
    said = capsys.readouterr().out
    assert "'fast' is no speed" in said
    assert "'10 50' does not hold 0" in said
    assert len(asked) == 6
    neck = load_neck(tmp_path / "asked.toml")
    assert (neck.pan.position_min_deg, neck.pan.position_max_deg) == (-70.0, 80.0)
    assert (neck.tilt.position_min_deg, neck.tilt.position_max_deg) == (-30.0, 40.0)
    assert neck.velocity_max_rad_s == pytest.approx([0.8 * (math.pi / 3) / 0.2, 0.8 * 5.2], rel=1e-3)


def test_refused_data_sheets(tmp_path, monkeypatch, capsys):
    def no_answer(question):
        raise EOFError

    monkeypatch.setattr("builtins.input", no_answer)
    new = str(tmp_path / "n.toml")
    for words, problem in (
        (["--new", new], "give --sheet.pan-deg"),
        (["--new", new, *SHEET[:7], "60"], "--sheet.speed: '60' is no speed: needed is a number with its unit"),
        (["--new", new, "--sheet.pan-deg", "10", "80"], "--sheet.pan-deg: '10.0 80.0' does not hold 0"),
        (["--robot", "simulated", *SHEET, "--out", new], "--sheet"),
    ):
        assert identify.main(words) == 2
        assert problem in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert identify.main(["--new", new, *SHEET]) == 0
    before = (tmp_path / "n.toml").read_text()
    assert identify.main(["--new", new, *SHEET]) == 2
    assert "exists already" in capsys.readouterr().err
    assert (tmp_path / "n.toml").read_text() == before
