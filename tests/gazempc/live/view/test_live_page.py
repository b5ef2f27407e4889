"""The page of a live run in a real browser: what happens is shown, a lost connection comes back, no script fails."""

import http.client
import json
from contextlib import closing

import numpy as np
import pytest
from builders.browser import browser
from builders.live import NECK
from builders.ports import free_port
from builders.replays import run_info
from builders.waiting import wait_for

import gazempc as gz
from gazempc.live.view.orders import ViewOrders
from gazempc.live.view.viewers import Feed
from gazempc.live.view.web import Snapshots, WebPage
from gazempc.neck.kinematics import gaze_error_rad
from gazempc.results.mcap import moments_of
from gazempc.results.moments import EventMoment, LateMoment, PictureMoment, PlanMoment, SeenMoment, TickMoment

# The smallest JPEG that browsers show: one grey pixel.
JPEG = bytes.fromhex(
    "ffd8ffe000104a46494600010100000100010000ffdb004300030202020202030202020303030304060404040404080606050609080a0a09"
    "0809090a0c0f0c0a0b0e0b09090d110d0e0f101011100a0c12131210130f101010ffc9000b080001000101011100ffcc0006001010"
    "05ffda0008010100003f00d2cf20ffd9"
)


@pytest.fixture(scope="module")
def log():
    return gz.replay(
        "subject03_R4",
        neck="reference_eyes",
        controller="lookahead",
        predictor="constant_velocity",
        sensor="reference",
    )


@pytest.fixture(scope="module")
def moments(log):
    """What a live run would send in two seconds: with plans, lateness and pictures."""
    found = [PictureMoment(0.0, JPEG), PlanMoment(0.0, 0.0, 0.02, log.command_position_rad[:3], 87.0)]
    for moment in moments_of(log):
        if isinstance(moment, TickMoment) and moment.time_s > log.time_s[0] + 2.0:
            break
        if isinstance(moment, TickMoment):
            found.append(LateMoment(0.25, 0))
        found.append(moment)
    return found


@pytest.fixture
def started(log):
    """Starts the process that serves the page at a port; what is still running is ended."""
    running = []

    def start(port, host="127.0.0.1"):
        feed = Feed(ViewOrders(log.run, view="web", host=host, port=port))
        assert feed.notes == (f"view: open http://{host}:{port}/ in a browser",)
        running.append(feed)
        return feed

    yield start
    for feed in running:
        feed.close()


def send(feed, moments):
    for moment in moments:
        feed.take(moment)


def wait_for_text(driver, element, words):
    text = lambda: driver.find_element("id", element).text  # noqa: E731
    wait_for(lambda: words in text(), why=lambda: f"{element} has {text()!r}, not {words!r}")


def shown_at(log, moments):
    """The time on the page, once it shows all of them."""
    snapshots, last_s = Snapshots(log.run), None
    for moment in moments:
        if snapshots.take(moment):
            last_s = snapshots.state()["time_s"]
    return f"{last_s:.1f} s"


def drawn(driver, canvas):
    """How many pixels of a canvas are not empty."""
    return driver.execute_script(
        "const c = document.getElementById(arguments[0]);"
        "const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
        "let n = 0; for (let k = 3; k < d.length; k += 4) n += d[k] > 0; return n;",
        canvas,
    )


@pytest.mark.slow
def test_the_page_shows_the_run_and_comes_back_after_it_was_cut_off(log, moments, started):
    port = free_port()
    with browser() as driver:
        run = started(port)
        driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": True},
        )
        driver.get(f"http://127.0.0.1:{port}/")
        wait_for_text(driver, "connection", "waiting for the run")
        half = len(moments) // 2
        send(run, moments[:half])
        wait_for_text(driver, "time", shown_at(log, moments[:half]))
        assert driver.find_element("id", "connection").text == "live"
        first = {name: driver.find_element("id", name).text for name in ("person", "error", "time", "joints")}
        send(run, [*moments[half:], EventMoment(moments[-1].time_s, "limit_guard", "limit_guard")])
        send(run, [TickMoment(moments[-1].time_s + 0.1, moments[-1].joints, *moments[-1][2:])])
        wait_for_text(driver, "events", "limit_guard: the smoother refused")
        for name, before in first.items():
            assert driver.find_element("id", name).text != before, name
        at = moments[-1]
        error_rad = gaze_error_rad(log.neck.geometry, at.joints.position_rad, at.head_true_base_m)
        assert driver.find_element("id", "error").text == f"{np.rad2deg(error_rad):.2f} deg"
        assert driver.find_element("id", "latency").text == "87 ms"
        assert driver.find_element("id", "joints").text.count("°") == 4
        assert driver.find_element("id", "camera").is_displayed()
        # The browser decodes the picture beside the page.
        wait_for(lambda: driver.execute_script("return document.getElementById('picture').naturalWidth") == 1)
        for canvas in ("above", "eye", "errors", "times"):
            assert drawn(driver, canvas) > 500, canvas
        # It fits a phone.
        assert driver.execute_script("return document.documentElement.scrollWidth") <= 400

        run.process.kill()
        wait_for_text(driver, "connection", "connection lost")
        again = started(port)
        wait_for_text(driver, "connection", "waiting for the run")
        send(again, moments[:half])
        wait_for_text(driver, "time", first["time"])
        assert driver.find_element("id", "connection").text == "live"
        again.close()
        wait_for_text(driver, "connection", "the run is over")
        # A connection that is refused is no error of a script.
        wrong = [each for each in driver.get_log("browser") if each["source"] != "network"]
        assert wrong == []


def test_only_this_computer_and_only_its_own_files_are_asked():
    port, host = free_port(), "127.1"

    def asked(path, named):
        with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=120)) as connection:
            connection.request("GET", path, headers={"Host": named})
            answer = connection.getresponse()
            return answer.status, answer.getheader("Content-Security-Policy"), answer.read()

    with closing(WebPage(run_info(NECK), host, port)):
        status, policy, page = asked("/", f"localhost:{port}")
        assert status == 200
        # At port 80 a browser leaves the port out. A foreign page may resolve its own name to this computer.
        statuses = [asked("/", host)[0], asked("/", "evil.example:80")[0], asked("/../web.py", f"127.0.0.1:{port}")[0]]
        assert statuses == [200, 403, 404]
        with pytest.raises(gz.GazempcError, match=rf"--view-at 127\.0\.0\.1:{port}"):
            WebPage(run_info(NECK), "127.0.0.1", port)
    assert "default-src 'self'" in policy
    assert b"http://" not in page
    assert b"https://" not in page


def test_the_error_is_against_the_observed_head_while_it_is_new(moments, log):
    snapshots, states = Snapshots(log.run.model_copy(update={"kind": "live"})), []
    lost_from_s = moments[-1].time_s - 1.5
    for moment in moments:
        if moment[0] > lost_from_s and isinstance(moment, SeenMoment):
            continue
        if snapshots.take(moment):
            states.append(snapshots.state())
    json.dumps(states, allow_nan=False)
    assert states[0]["observed_m"] is None
    errors = [state["error_deg"] for state in states]
    assert [error is not None for error in errors] == [(state["age_s"] or 9.0) < 1.0 for state in states]
    assert errors[-1] is None
    k = next(k for k, error in enumerate(errors) if error is not None)
    assert errors[k] == pytest.approx(np.hypot(*states[k]["in_view_deg"]))
