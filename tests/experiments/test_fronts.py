"""Fronts compared at equal smoothness, as a user would run them."""

import csv
import json

import pytest

from experiments import fronts


def test_a_front_leaves_out_what_is_beaten():
    points = [(2.0, 1.0), (1.0, 2.0), (1.5, 3.0), (3.0, 1.5), (2.5, 0.5)]
    assert fronts.front(points, 1.0) == [(1.0, 2.0), (2.0, 1.0), (2.5, 0.5)]
    assert fronts.front(points, -1.0) == [(1.0, 2.0), (1.5, 3.0)]


def write_table(path, rows):
    names = ("case", "point", "recording", "subject", "group", "neck")
    names += ("rms_acceleration_rad_s2", "gaze_error_rms_deg", "eye_contact_2p6")
    with (path / "results.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerows([names, *rows])


def test_margins_by_hand(tmp_path, capsys):
    """At 1.0 the rival errs 2.0 and the MPC, between its points, 1.8; at 2.0 the MPC is 10 % worse."""
    write_table(
        tmp_path,
        [
            ("lookahead", 0, "a", "ann", "sharp", "slow", 1.0, 2.0, 0.5),
            ("lookahead", 1, "a", "ann", "sharp", "slow", 2.0, 1.0, 0.9),
            ("mpc", 0, "a", "ann", "sharp", "slow", 0.5, 2.5, 0.4),
            ("mpc", 1, "a", "ann", "sharp", "slow", 1.5, 1.1, 0.8),
        ],
    )
    assert fronts.main([str(tmp_path)]) == 0
    margin, of_all = json.loads((tmp_path / "fronts.json").read_text())
    assert margin["error_ratio_worst"] == pytest.approx(1.1)
    assert margin["error_ratio"] == pytest.approx((0.9 * 1.1) ** 0.5)
    assert margin["contact_difference_worst"] == pytest.approx(-0.1)
    assert margin["contact_difference"] == pytest.approx(0.0)
    assert margin["error_ratio_low"] is None
    assert (margin["group"], of_all["group"]) == ("sharp", "all")
    assert margin["points"] == 2
    assert "+10.0" in capsys.readouterr().out


def test_intervals_are_over_people_and_clips_that_one_lacks_are_left_out(tmp_path):
    """With ann the MPC errs 20 % less, with bob as much; a third clip has only look-ahead's run."""
    rows = []
    for case, errors in (("lookahead", (1.0, 1.0, 9.0)), ("mpc", (0.8, 1.0))):
        for clip, person, error in zip("abc", ("ann", "bob", "cyd"), errors, strict=False):
            rows.append((case, 0, clip, person, "sharp", "slow", 1.0, error, 0.5))
    write_table(tmp_path, rows)
    assert fronts.main([str(tmp_path)]) == 0
    margin = json.loads((tmp_path / "fronts.json").read_text())[0]
    assert margin["error_ratio"] == pytest.approx(0.9)
    assert margin["error_ratio_low"] == pytest.approx(0.8)
    assert margin["error_ratio_high"] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([("mpc", 0, "a", "ann", "sharp", "slow", 1.0, "x", 0.5)], "row 2: could not convert"),
        ([("mpc", 0, "a", "ann", "sharp", "slow", 1.0, 1.0, 0.5)], "no case 'lookahead'; there are mpc"),
        ([], "is empty"),
    ],
)
def test_a_table_that_cannot_be_compared_is_refused(tmp_path, capsys, rows, said):
    write_table(tmp_path, rows)
    assert fronts.main([str(tmp_path)]) == 2
    assert said in capsys.readouterr().err
