"""The report: values of the metrics, self-containment, escaped text; the table."""

import dataclasses
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from bs4 import BeautifulSoup
from builders.browser import browser
from builders.recordings import reordered, synthetic
from builders.replays import QUICK, replayed
from PIL import Image

from gazempc.loop.events import MEANINGS
from gazempc.neck.spec import load_neck
from gazempc.results.log import Fault
from gazempc.results.metrics import Metrics, gaze_error_deg
from gazempc.results.page.content import Chart, Curve, Page, PageTable, Unusual
from gazempc.results.page.run_page import run_page
from gazempc.results.page.write import MAX_PAGE_BYTES, write_page
from gazempc.results.run_summary import ComputeMetrics, make_rows
from gazempc.results.table import by_controller, measured_again, sentence, table

EVIL = '</script><script>throw 1</script><img src="https://outside.example/x.png" onerror="throw 2">\'"&'


NECK = load_neck("reference")


@pytest.fixture(scope="module")
def logs():
    walk = reordered(synthetic("subject03_R1"), range(60))
    return {name: replayed(walk, name, settings=QUICK, neck=NECK) for name in ("reactive", "lookahead")}


def page_of(logs, **changes):
    given = {"notes": [], "meanings": MEANINGS, "pictures": [], "command": "python -m gazempc.run", "settings": {}}
    return run_page(logs, [measured_again(log) for log in logs.values()], **(given | changes))


def written(page, folder):
    assert write_page(page, folder) == "report.html"
    text = (folder / "report.html").read_text(encoding="utf-8")
    return text, BeautifulSoup(text, "html.parser")


def test_values_and_curves_equal_those_of_the_log(logs, tmp_path):
    _, soup = written(page_of(logs), tmp_path)
    cells = {row.th.text: [cell.text for cell in row.find_all("td")] for row in soup.tbody.find_all("tr")}
    metrics = [measured_again(log).first.metrics for log in logs.values()]
    assert cells["gaze error RMS [deg]"] == [f"{m.gaze_error_rms_deg:.2f}" for m in metrics]
    assert cells["eye contact within 2.6 deg"] == [f"{100 * m.eye_contact_2p6:.1f} %" for m in metrics]
    data = json.loads(soup.find("script", type="application/json").text)
    assert [curve["label"] for curve in data["curves"]] == ["reactive", "look-ahead"]
    for curve, log in zip(data["curves"], logs.values(), strict=True):
        assert curve["xs"] == pytest.approx(log.time_s - log.time_s[0], rel=1e-4)
        assert np.array(curve["ys"], float) == pytest.approx(gaze_error_deg(log), rel=1e-4, abs=1e-9, nan_ok=True)
    # Distinguishable in print without colours.
    assert len({path["stroke-dasharray"] for path in soup.select(".legend path")}) == len(logs)


def test_the_page_is_self_contained(logs, tmp_path):
    text, soup = written(page_of(logs), tmp_path)
    for tag in soup.find_all(True):
        for name in ("src", "href", "data", "action", "poster", "srcset"):
            assert tag.get(name, "data:").startswith("data:"), tag
        assert tag.name not in {"link", "iframe", "object", "embed", "base"}
    assert "http" not in text.replace("http-equiv", "")
    assert not re.search(r"url\((?!#)|@import", text)
    assert "default-src 'none'" in soup.find("meta", {"http-equiv": "Content-Security-Policy"})["content"]


def test_foreign_text_is_escaped(logs, tmp_path):
    log = logs["reactive"]
    run = log.run.model_copy(update={"recording": EVIL, "subject": EVIL, "controller": EVIL})
    fault = Fault("forecast_failed", 3, EVIL, EVIL)
    evil = replace(log, run=run, faults=(fault,))
    page = page_of({EVIL: evil}, notes=[EVIL], command=EVIL, settings={EVIL: EVIL})
    text, soup = written(page, tmp_path)
    assert soup.h1.text == f"Gaze on {EVIL}"
    assert len(soup.find_all("script")) == 2  # the data of the chart, and the page's own
    assert soup.find_all("img") == []
    assert "<img" not in text
    unusual = soup.find(id="unusual")
    assert MEANINGS["forecast_failed"] in unusual.text
    assert unusual.pre.text == EVIL
    assert soup.find(class_="command").text == EVIL


def test_events_are_listed_once_with_their_first_times(logs, tmp_path):
    log = logs["reactive"]
    times = log.time_s[0] + np.array([0.0, 0.5, 2.0, *[0.0] * 6])
    names = np.array(["no_observation_yet", "late_plan", "late_plan", *["target_lost"] * 6])
    named = replace(log, event_time_s=times, event_name=names)
    _, soup = written(page_of({"reactive": named}, notes=["a note"]), tmp_path)
    entries = [entry.strong.text for entry in soup.find(id="unusual").find_all("li")]
    assert entries == [
        "a note",
        "late_plan, 2 x at 0.50, 2.00 s",
        "target_lost, 6 x at 0.00, 0.00, 0.00, 0.00, 0.00, ... s",
    ]
    _, soup = written(page_of(logs), tmp_path)
    assert soup.find(id="unusual").p.text == "None."


def test_a_page_of_large_content_stays_small(tmp_path):
    rng = np.random.default_rng(0)
    x = np.arange(100_000) / 200.0
    peak = rng.normal(size=x.size)
    peak[12_345] = 99.0
    curves = (Curve("one", "red", x, peak), Curve("none", "blue", x, np.full(x.size, np.nan)))
    Image.new("P", (10, 10)).save(tmp_path / "large.gif")
    with (tmp_path / "large.gif").open("ab") as file:
        file.write(bytes(2_000_000))
    page = Page(
        **{"title": "t", "question": "q", "answer": ("a",), "setup": {}, "command": "c", "settings": {}},
        tables=(PageTable("", ("a", "b"), tuple((f"row {i}", "1") for i in range(2000))),),
        charts=(Chart("c", "x", "y", curves),),
        unusual=tuple(Unusual(f"event {i}", "words " * 5000, "line\n" * 5000) for i in range(300)),
        pictures={tmp_path / "large.gif": "an animation"},
    )
    text, soup = written(page, tmp_path)
    assert len(text.encode()) < MAX_PAGE_BYTES
    assert "1500 more rows are not shown" in text
    assert "and 200 more" in text
    curve, empty = json.loads(soup.find("script", type="application/json").text)["curves"]
    assert max(curve["ys"]) == 99.0
    assert set(empty["ys"]) == {None}
    assert soup.find(id="pictures").find("img") is None
    assert soup.find(id="pictures").figcaption.text == "an animation: too large for this page, see the file large.gif"


@pytest.mark.slow
def test_curves_have_cursor_values_and_zoom_in_a_browser(logs, tmp_path):
    written(page_of(logs), tmp_path)
    with browser() as driver:
        from selenium.webdriver import ActionChains

        driver.get((tmp_path / "report.html").as_uri())
        chart = driver.find_element("css selector", "figure.chart > svg")
        driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", chart)
        figure = driver.find_element("css selector", "figure.chart")
        assert len(chart.find_elements("css selector", "path.curve")) == len(logs)

        ActionChains(driver).move_to_element(chart).perform()
        at_s = float(driver.find_element("css selector", ".at").text.removeprefix("at "))
        for output, log in zip(driver.find_elements("css selector", ".legend output"), logs.values(), strict=True):
            expected = np.interp(at_s, log.time_s - log.time_s[0], gaze_error_deg(log))
            assert float(output.text) == pytest.approx(expected, abs=0.05)

        whole = figure.get_attribute("data-from"), figure.get_attribute("data-to")
        ActionChains(driver).move_to_element(chart).click_and_hold().move_by_offset(100, 0).release().perform()
        zoomed = float(figure.get_attribute("data-from")), float(figure.get_attribute("data-to"))
        assert float(whole[0]) < zoomed[0] < zoomed[1] < float(whole[1])
        assert zoomed[0] == pytest.approx(at_s, abs=0.05)
        ActionChains(driver).double_click(chart).perform()
        assert (figure.get_attribute("data-from"), figure.get_attribute("data-to")) == whole

        driver.find_element("css selector", ".legend button").click()
        assert len(chart.find_elements("css selector", "path.curve")) == len(logs) - 1

        # Folded content is shown in print.
        for event, unfolded in (("beforeprint", 1), ("afterprint", 0)):
            driver.execute_script("dispatchEvent(new Event(arguments[0]))", event)
            assert len(driver.find_elements("css selector", "details[open]")) == unfolded
        assert driver.get_log("browser") == []


# ---------------------------------------------------------------- the table over seeds of the noise


ERRORS_DEG = {"reactive": (10.0, 12.0, 11.0), "mpc": (1.0, 2.0, 1.5), "mpc+perfect": (0.0, 0.0, 0.0)}


def metrics_of(**known):
    plain = dict.fromkeys((field.name for field in dataclasses.fields(Metrics)), 0.5)
    return Metrics(**{**plain, "limit_violations": 0, **known})


def repeats(errors_deg=ERRORS_DEG, **more):
    compute = ComputeMetrics(0.1, 0.2, 0.3, 0.1, 0.2, 0.3, 0)
    seeds = tuple(range(4, 4 + len(errors_deg["reactive"])))

    def row(name, k):
        others = {n: (v[name] if isinstance(v, dict) else v)[k] for n, v in more.items()}
        return name, "walker", metrics_of(gaze_error_rms_deg=errors_deg[name][k], **others), compute

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
    figures = mpc.as_dict()
    assert figures["per_seed"]["gaze_error_rms_deg"] == [1.0, 2.0, 1.5]
    assert (figures["controller"], figures["mean"]["gaze_error_rms_deg"]) == ("mpc", 1.5)


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
def test_a_forecast_that_increases_error_is_reported_with_a_remedy(mpc_deg, mpc_contact, costs):
    rows = repeats(
        {"reactive": (1.0, 1.1, 1.05), "mpc": mpc_deg}, eye_contact_2p6={"reactive": (0.8,) * 3, "mpc": mpc_contact}
    )
    text = sentence(rows)
    assert ("last_position" in text) == bool(costs)
    for cost in costs:
        assert cost in text
    assert ("deg more" in text) == any("deg more" in cost for cost in costs)
    assert ("points less" in text) == any("points less" in cost for cost in costs)
