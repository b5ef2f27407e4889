"""The report: it says what the metrics say, needs no other file, and shows what a stranger wrote as text."""

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
from gazempc.results.log import Fault
from gazempc.results.metrics import gaze_error_deg
from gazempc.results.page.content import Chart, Curve, Page, PageTable, Unusual
from gazempc.results.page.run_page import run_page
from gazempc.results.page.write import MAX_PAGE_BYTES, write_page
from gazempc.results.table import measured_again

EVIL = '</script><script>throw 1</script><img src="https://outside.example/x.png" onerror="throw 2">\'"&'


@pytest.fixture(scope="module")
def logs():
    walk = reordered(synthetic("subject03_R1"), range(60))
    return {name: replayed(walk, name, settings=QUICK) for name in ("reactive", "lookahead")}


def page_of(logs, **changes):
    given = {"notes": [], "meanings": MEANINGS, "pictures": [], "command": "python -m gazempc.run", "settings": {}}
    return run_page(logs, [measured_again(log) for log in logs.values()], **(given | changes))


def written(page, folder):
    assert write_page(page, folder) == "report.html"
    text = (folder / "report.html").read_text(encoding="utf-8")
    return text, BeautifulSoup(text, "html.parser")


def test_numbers_and_curves_are_those_of_the_log(logs, tmp_path):
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
    # A print without colours tells them apart.
    assert len({path["stroke-dasharray"] for path in soup.select(".legend path")}) == len(logs)


def test_the_page_needs_no_other_file(logs, tmp_path):
    text, soup = written(page_of(logs), tmp_path)
    for tag in soup.find_all(True):
        for name in ("src", "href", "data", "action", "poster", "srcset"):
            assert tag.get(name, "data:").startswith("data:"), tag
        assert tag.name not in {"link", "iframe", "object", "embed", "base"}
    assert "http" not in text.replace("http-equiv", "")
    assert not re.search(r"url\((?!#)|@import", text)
    assert "default-src 'none'" in soup.find("meta", {"http-equiv": "Content-Security-Policy"})["content"]


def test_what_others_wrote_is_shown_as_text(logs, tmp_path):
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


def test_what_was_out_of_the_ordinary_comes_once_with_its_first_times(logs, tmp_path):
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
    assert soup.find(id="unusual").p.text == "Nothing."


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
def test_curves_are_read_and_zoomed_in_a_browser(logs, tmp_path):
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

        # On paper nothing can be unfolded.
        for event, unfolded in (("beforeprint", 1), ("afterprint", 0)):
            driver.execute_script("dispatchEvent(new Event(arguments[0]))", event)
            assert len(driver.find_elements("css selector", "details[open]")) == unfolded
        assert driver.get_log("browser") == []
