"""Means and spread over seeds of the noise, and the table that shows them: by hand."""

import dataclasses
import re

import numpy as np
import pytest

from gazempc.neck.spec import load_neck
from gazempc.results.metrics import Metrics
from gazempc.results.run_summary import ComputeMetrics, make_rows
from gazempc.results.table import by_controller, sentence, table

NECK = load_neck("reference")
ERRORS_DEG = {"reactive": (10.0, 12.0, 11.0), "mpc": (1.0, 2.0, 1.5), "mpc+perfect": (0.0, 0.0, 0.0)}


def metrics(**known):
    plain = dict.fromkeys((field.name for field in dataclasses.fields(Metrics)), 0.5)
    return Metrics(**{**plain, "limit_violations": 0, **known})


def repeats(errors_deg=ERRORS_DEG, **more):
    compute = ComputeMetrics(0.1, 0.2, 0.3, 0.1, 0.2, 0.3, 0)
    seeds = tuple(range(4, 4 + len(errors_deg["reactive"])))

    def row(name, k):
        others = {n: (v[name] if isinstance(v, dict) else v)[k] for n, v in more.items()}
        return name, "walker", metrics(gaze_error_rms_deg=errors_deg[name][k], **others), compute

    rounds = [make_rows([row(name, k) for name in errors_deg]) for k in range(len(seeds))]
    return by_controller(seeds, rounds)


def lines_of(text):
    cells = [re.split(r"\s{2,}", line.strip()) for line in text.splitlines()]
    return {name: values for name, *values in cells}


def test_mean_and_standard_deviation_over_the_seeds():
    reactive, mpc, perfect = repeats()
    assert mpc.seeds == (4, 5, 6)
    assert (reactive.mean("gaze_error_rms_deg"), reactive.sd("gaze_error_rms_deg")) == (11.0, 1.0)
    assert (mpc.mean("gaze_error_rms_deg"), mpc.sd("gaze_error_rms_deg")) == (1.5, 0.5)
    assert perfect.sd("gaze_error_rms_deg") == 0.0
    gaps = [0.9, 10 / 12, 9.5 / 11]
    assert mpc.mean("gap_closed") == pytest.approx(np.mean(gaps))
    assert mpc.sd("gap_closed") == pytest.approx(np.std(gaps, ddof=1))
    told = mpc.as_dict()
    assert told["per_seed"]["gaze_error_rms_deg"] == [1.0, 2.0, 1.5]
    assert (told["controller"], told["mean"]["gaze_error_rms_deg"]) == ("mpc", 1.5)


def test_the_table_shows_spread_highest_peaks_and_all_violations():
    rows = repeats(peak_velocity_rad_s=(0.5, 0.9, 0.7), limit_violations=(0, 2, 1), eye_contact_2p6=(0.8, 0.9, 1.0))
    lines = lines_of(table(rows, NECK))
    assert lines["gaze error RMS [deg]"] == ["11.00 ± 1.00", "1.50 ± 0.50", "0.00 ± 0.00"]
    assert lines["seed 4, as in the figures"] == ["10.00", "1.00", "0.00"]
    assert lines["eye contact within 2.6 deg"] == ["90.0 ± 10.0 %"] * 3
    assert lines["peak velocity [rad/s], limit 2.5"] == ["0.90"] * 3
    assert lines["limit violations"] == ["3"] * 3
    assert "MPC 90.0 % (RMS error 7.3 times smaller)" in sentence(rows)


@pytest.mark.parametrize(
    ("mpc_deg", "mpc_contact", "costs"),
    [
        ((1.3, 1.4, 1.35), (0.8, 0.8, 0.8), ["deg more"]),  # more than the reactive 1.0, 1.1, 1.05 under each seed
        ((0.9, 1.0, 0.95), (0.7, 0.72, 0.71), ["points less contact"]),
        ((1.3, 1.4, 1.35), (0.7, 0.72, 0.71), ["9.0 points less contact", "0.30 deg more"]),
        ((1.6, 0.9, 1.0), (0.8, 0.8, 0.8), []),  # more on average, but within the noise
        ((1.01, 1.11, 1.06), (0.799, 0.799, 0.799), []),  # beyond the noise, and too small to matter
        ((0.5, 0.6, 0.5), (0.9, 0.9, 0.9), []),
    ],
)
def test_a_forecast_that_costs_is_told_with_what_to_try(mpc_deg, mpc_contact, costs):
    rows = repeats(
        {"reactive": (1.0, 1.1, 1.05), "mpc": mpc_deg}, eye_contact_2p6={"reactive": (0.8,) * 3, "mpc": mpc_contact}
    )
    text = sentence(rows)
    assert ("last_position" in text) == bool(costs)
    for cost in costs:
        assert cost in text
    assert ("deg more" in text) == any("deg more" in cost for cost in costs)
    assert ("points less" in text) == any("points less" in cost for cost in costs)
