"""The page of a live run in a real browser: displayed values, reconnection, no script error."""

import http.client
import json
from contextlib import closing

import cv2
import numpy as np
import pytest
from builders.browser import browser
from builders.live import NECK
from builders.ports import free_port
from builders.replays import at_100_hz, cut, run_info
from builders.waiting import wait_for

import gazempc as gz
from gazempc.live.view.serving import ViewOrders
from gazempc.live.view.viewers import Feed
from gazempc.live.view.web import Snapshots, WebPage
from gazempc.neck.kinematics import gaze_error_rad
from gazempc.results.moments import EventMoment, PictureMoment, PlanMoment, SeenMoment, TickMoment, moments_of


@pytest.fixture(scope="module")
def log():
    parts = {"controller": "lookahead", "predictor": "constant_velocity", "sensor": "reference"}
    return gz.replay("subject03_R4", neck=at_100_hz("reference_eyes"), **parts)


@pytest.fixture(scope="module")
def moments(log):
    """Messages of two seconds of a live run, with a plan and a picture."""
    jpeg = cv2.imencode(".jpg", np.zeros((1, 1, 3), np.uint8))[1].tobytes()
    plan = PlanMoment(0.0, 0.0, 0.02, log.command_position_rad[:3], 87.0)
    return [PictureMoment(0.0, jpeg), plan, *moments_of(cut(log, 0.0, 2.0))]


# Number of non-empty pixels of a canvas.
DRAWN = """
const c = document.getElementById(arguments[0]);
const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
let n = 0; for (let k = 3; k < d.length; k += 4) n += d[k] > 0; return n;
"""


@pytest.mark.slow
def test_the_page_shows_the_run_and_reconnects(log, moments):
    port, at = free_port(), next(each for each in reversed(moments) if isinstance(each, TickMoment))
    error_deg = np.rad2deg(gaze_error_rad(log.neck.geometry, at.joints.position_rad, at.head_true_base_m))
    orders = ViewOrders(log.run, view="web", port=port)
    with browser() as driver:

        def text(name):
            return driver.find_element("id", name).text

        def wait_for_text(name, words):
            wait_for(lambda: words in text(name), why=lambda: f"{name} has {text(name)!r}, not {words!r}")

        for ends, shown_s in (("connection lost", at.time_s + 0.1), ("the run is over", at.time_s + 0.3)):
            with closing(Feed(orders)) as feed:
                assert feed.notes == (f"view: open http://127.0.0.1:{port}/ in a browser",)
                if ends == "connection lost":
                    driver.get(f"http://127.0.0.1:{port}/")
                wait_for_text("connection", "waiting for the run")
                for moment in (*moments, EventMoment(at.time_s, "limit_guard", "limit_guard")):
                    feed.take(moment)
                feed.take(TickMoment(shown_s, at.joints, *at[2:]))
                wait_for_text("time", f"{shown_s:.1f} s")
                wait_for_text("events", "limit_guard: the smoother refused")
                assert (text("connection"), text("latency")) == ("live", "87 ms")
                assert text("error") == f"{error_deg:.2f} deg"
                assert text("joints").count("°") == 4
                # The browser decodes the picture asynchronously.
                wait_for(lambda: driver.execute_script("return document.getElementById('picture').naturalWidth") == 1)
                if ends == "connection lost":
                    for canvas in ("above", "eye", "errors", "times"):
                        assert driver.execute_script(DRAWN, canvas) > 500, canvas
                    feed.process.kill()
                    wait_for_text("connection", ends)
        wait_for_text("connection", ends)
        # A refused connection is no script error.
        assert [each for each in driver.get_log("browser") if each["source"] != "network"] == []


def test_the_page_accepts_local_hosts_and_loads_its_own_files_only():
    port, host = free_port(), "127.1"

    def get(path, named, method="GET"):
        with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=120)) as connection:
            connection.request(method, path, headers={"Host": named})
            answer = connection.getresponse()
            return answer.status, answer.getheader("Content-Security-Policy"), answer.read()

    with closing(WebPage(run_info(NECK), host, port)):
        status, policy, page = get("/", f"localhost:{port}")
        assert status == 200
        # At port 80 a browser omits the port. A foreign page may resolve its own name to this computer.
        statuses = [get("/", host)[0], get("/", "evil.example:80")[0], get("/../web.py", f"127.0.0.1:{port}")[0]]
        assert statuses == [200, 403, 404]
        assert get("/", "evil.example:80", "HEAD")[0] == 501
        with pytest.raises(gz.GazempcError, match=rf"--view-at 127\.0\.0\.1:{port}"):
            WebPage(run_info(NECK), "127.0.0.1", port)
    assert "default-src 'self'" in policy
    assert b"http://" not in page
    assert b"https://" not in page


def test_the_error_is_against_the_observed_head_while_it_is_recent(moments, log):
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
