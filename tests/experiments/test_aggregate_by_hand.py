"""Means, intervals and differences over clips and people, by hand."""

import numpy as np
import pytest

from experiments.aggregate import add_gap_closed, bootstrap_mean, paired_differences, summarise


def test_the_interval_has_its_coverage():
    """20 people with one clip each, unit spread: the interval's half width is near 1.96 / sqrt(20)."""
    values = np.random.default_rng(1).standard_normal(20)
    _, low, high = bootstrap_mean(values, [str(i) for i in range(20)])
    assert (high - low) / 2 == pytest.approx(1.96 * values.std() / np.sqrt(20), rel=0.1)


def test_one_person_has_no_interval_and_nan_does_not_count():
    mean, low, high = bootstrap_mean([1.0, np.nan, 3.0], ["a", "a", "a"])
    assert mean == 2.0
    assert np.isnan(low)
    assert np.isnan(high)


def row(recording, controller, rms, subject="s", predictor="p", sensor="s", kind=None):
    labels = {
        "recording": recording,
        "source": recording,
        "data_kind": "synthetic",
        "subject": subject,
        "group": "turn",
    }
    return labels | {
        "controller": controller,
        "predictor": predictor,
        "neck": "n",
        "sensor": sensor,
        "kind": kind,
        "seed": 0,
        "gaze_error_rms_deg": rms,
    }


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


def test_sensors_and_kinds_have_rows_of_their_own_by_hand():
    """Rows by kind are of all groups and the other way round; a clip without a kind counts in `all` only."""
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
