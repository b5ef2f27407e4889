"""Means, intervals, differences and Pareto fronts over clips and people, by hand."""

import csv
import json

import numpy as np
import pytest

from experiments import fronts
from experiments.aggregate import add_gap_closed, bootstrap_mean, paired_differences, summarise


def test_a_front_excludes_dominated_points():
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
    """At 1.0 the errors are 2.0 (rival) and 1.8 (MPC, interpolated); at 2.0 the MPC is 10 % worse."""
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


def test_intervals_are_over_people_and_use_paired_clips_only(tmp_path):
    """The MPC's error is 20 % smaller for ann, equal for bob; a third clip has only look-ahead's run."""
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
    ("rows", "message"),
    [
        ([("mpc", 0, "a", "ann", "sharp", "slow", 1.0, "x", 0.5)], "row 2: could not convert"),
        ([("mpc", 0, "a", "ann", "sharp", "slow", 1.0, 1.0, 0.5)], "no case 'lookahead'; accepted: mpc"),
        ([], "is empty"),
    ],
)
def test_a_table_without_comparable_rows_is_refused(tmp_path, capsys, rows, message):
    write_table(tmp_path, rows)
    assert fronts.main([str(tmp_path)]) == 2
    assert message in capsys.readouterr().err


def test_the_interval_has_nominal_coverage():
    """20 people with one clip each, unit spread: the interval's half width is near 1.96 / sqrt(20)."""
    values = np.random.default_rng(1).standard_normal(20)
    _, low, high = bootstrap_mean(values, [str(i) for i in range(20)])
    assert (high - low) / 2 == pytest.approx(1.96 * values.std() / np.sqrt(20), rel=0.1)


def test_one_person_has_no_interval_and_nan_is_ignored():
    mean, low, high = bootstrap_mean([1.0, np.nan, 3.0], ["a", "a", "a"])
    assert mean == 2.0
    assert np.isnan(low)
    assert np.isnan(high)


def row(recording, controller, rms, subject="s", predictor="p", sensor="s", kind=None):
    labels = {"recording": recording, "source": recording, "subject": subject, "group": "turn", "kind": kind}
    chosen = {"controller": controller, "predictor": predictor, "neck": "n", "sensor": sensor, "seed": 0}
    return labels | chosen | {"gaze_error_rms_deg": rms}


def test_gap_closed_summary_and_differences_by_hand():
    rows = [
        row("a", "reactive", 10.0, "x"),
        row("a", "lookahead", 4.0, "x"),
        row("a", "mpc", 3.0, "x"),
        row("a", "mpc+perfect", 1.0, "x", predictor="perfect"),
        row("b", "reactive", 20.0, "y"),
        row("b", "lookahead", 5.0, "y"),
        row("b", "mpc", 7.0, "y"),
        row("b", "mpc+perfect", 0.0, "y", predictor="perfect"),
    ]
    add_gap_closed(rows)
    gaps = {(r["recording"], r["controller"]): r["gap_closed"] for r in rows}
    assert gaps["a", "mpc"] == pytest.approx(7 / 9)
    assert gaps["b", "mpc"] == pytest.approx(13 / 20)
    assert gaps["a", "mpc+perfect"] == 1.0
    table = {(r["group"], r["controller"]): r for r in summarise(rows)}
    assert table["turn", "mpc"]["gaze_error_rms_deg"] == 5.0
    assert table["all", "mpc"]["n_people"] == 2
    assert table["all", "mpc"]["gap_closed"] == pytest.approx((7 / 9 + 13 / 20) / 2)
    differences = paired_differences(rows, "gaze_error_rms_deg", "mpc", "lookahead")
    assert [d["difference"] for d in differences] == [0.5, 0.5]
    assert differences[0]["ci95"] == pytest.approx([-1.0, 2.0])
    assert (differences[0]["n_clips"], differences[0]["n_less"], differences[0]["n_more"]) == (2, 1, 1)


def test_rows_by_sensor_and_by_kind_by_hand():
    """Rows by kind include all groups, and rows by group all kinds; a clip without a kind is in `all` only."""
    figures = {("near", "a"): 1.0, ("near", "b"): 2.0, ("near", "c"): 6.0, ("far", "a"): 10.0, ("far", "b"): 30.0}
    kinds = {"a": "waiting", "b": "moving", "c": None}
    rows = [row(clip, "mpc", rms, clip, sensor=s, kind=kinds[clip]) for (s, clip), rms in figures.items()]
    others = [{**r, "controller": "lookahead", "gaze_error_rms_deg": 0.0} for r in rows]
    expected = {
        ("near", "turn", "all"): 3.0,
        ("near", "all", "moving"): 2.0,
        ("near", "all", "waiting"): 1.0,
        ("near", "all", "all"): 3.0,
        ("far", "turn", "all"): 20.0,
        ("far", "all", "moving"): 30.0,
        ("far", "all", "waiting"): 10.0,
        ("far", "all", "all"): 20.0,
    }
    table = summarise(rows)
    assert {(r["sensor"], r["group"], r["kind"]): r["gaze_error_rms_deg"] for r in table} == expected
    assert [(r["sensor"], r["group"], r["kind"]) for r in table] == list(expected)
    pairs = paired_differences(rows + others, "gaze_error_rms_deg", "mpc", "lookahead")
    assert {(d["sensor"], d["group"], d["kind"]): d["difference"] for d in pairs} == expected
