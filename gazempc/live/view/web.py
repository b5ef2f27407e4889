"""The web page of a run: its state from the moments of the run, as server-sent events. Standard library only."""

from __future__ import annotations

import json
import math
import threading
import time
from collections import deque
from contextlib import suppress
from functools import partial
from http import HTTPStatus
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.errors import SettingsError
from gazempc.live.sources.wires import LOOPBACK, is_loopback, named
from gazempc.loop.events import MEANINGS
from gazempc.neck.kinematics import angle_between_rad, gaze_ray
from gazempc.results import moments
from gazempc.results.log import RunInfo
from gazempc.types import FloatArray, JointState

# Update rate that a phone can draw.
PERIOD_S = 0.05
_HISTORY_S = 30.0
_EVENTS = 20
# Ellipses of two standard deviations, as in the scene of Foxglove.
_SDS = 2.0
# Maximum age of an observation used as the person's position.
_LOST_S = 1.0


class Snapshots:
    """Keeps the newest state. One thread writes; any thread may read results of `state`.

    Args:
        run: Description of the run.

    Attributes:
        picture: The newest picture of the camera, JPEG; empty without one.
    """

    def __init__(self, run: RunInfo) -> None:
        self._neck, self._knows_true_head = run.neck, run.knows_true_head
        self._about = {name: getattr(run, name) for name in ("recording", "robot", "controller", "predictor")}
        self._about["neck"] = run.neck.name
        self._about["scored_against"] = "the true head" if run.knows_true_head else "the observed head"
        self.picture = b""
        self._history: deque[list[float | None]] = deque(maxlen=round(_HISTORY_S / PERIOD_S))
        self._events: deque[dict[str, Any]] = deque(maxlen=_EVENTS)
        self._begun = 0
        self._true_joints: JointState | None = None
        self._tick: moments.TickMoment | None = None
        self._seen: moments.SeenMoment | None = None
        self._latency_ms, self._late_ms, self._skipped = math.nan, 0.0, 0

    def take(self, moment: moments.Moment) -> bool:
        """Process a moment.

        Args:
            moment: The moment.

        Returns:
            Whether an update is due: 20 times a second of the run.
        """
        match moment:
            case moments.JointsMoment():
                self._true_joints = moment.joints
            case moments.LateMoment():
                self._late_ms = max(self._late_ms, moment.late_ms)
                self._skipped += moment.skipped
            case moments.SeenMoment():
                self._seen = moment
            case moments.PlanMoment():
                self._latency_ms = moment.latency_ms
            case moments.PictureMoment():
                self.picture = moment.jpeg
            case moments.EventMoment() | moments.AttendedMoment():
                self._begun += 1
                self._events.append({"id": self._begun, "time_s": moment.time_s, "text": _in_words(moment)})
            case moments.TickMoment():
                joints = self._true_joints or moment.joints
                self._true_joints = None
                before_s = -math.inf if self._tick is None else self._tick.time_s
                if joints is not None and moment.time_s - before_s >= PERIOD_S - 1e-6:
                    self._tick = moment._replace(joints=joints)
                    return True
        return False

    def hello(self) -> str:
        """Initial message of a new page: description of the run, and its last half minute."""
        return json.dumps({"about": self._about, "history": list(self._history)})

    def state(self) -> dict[str, Any]:
        """The state at the newest tick; also appended to the history.

        Returns:
            Values for JSON; angles in degrees, positions in metres, None if unknown.
        """
        tick, seen = self._tick, self._seen
        if tick is None or tick.joints is None:
            return {}
        eye_m, gaze = gaze_ray(self._neck.geometry, tick.joints.position_rad)
        seen_m = None if seen is None else seen.head_observed_base_m
        true_m = tick.head_true_base_m
        known_m = true_m if true_m is not None and np.isfinite(true_m).all() else None
        age_s = math.inf if seen is None else tick.time_s - seen.capture_time_s
        new_m = seen_m if age_s < _LOST_S else None
        target_m = known_m if self._knows_true_head else new_m
        forecast = seen if seen is not None and np.isfinite(seen.means_base_m).all() else None
        means_m, covariances_m2 = ((), ()) if forecast is None else (forecast.means_base_m, forecast.covariances_m2)
        state = {
            "time_s": tick.time_s,
            "age_s": _number(age_s),
            "distance_m": None if seen_m is None else float(np.linalg.norm(seen_m - eye_m)),
            "true_m": None if known_m is None else known_m.tolist(),
            "observed_m": None if seen_m is None else seen_m.tolist(),
            "forecast_m": [mean.tolist() for mean in means_m],
            "ellipses": [_ellipse(each) for each in covariances_m2],
            "eye_m": eye_m.tolist(),
            "gaze": gaze.tolist(),
            "in_view_deg": None if target_m is None else _in_view_deg(eye_m, gaze, target_m),
            "forecast_in_view_deg": [_in_view_deg(eye_m, gaze, mean) for mean in means_m],
            "error_deg": None if target_m is None else math.degrees(angle_between_rad(gaze, target_m - eye_m)),
            "late_ms": self._late_ms,
            "skipped_ticks": self._skipped,
            "latency_ms": _number(self._latency_ms),
            "joints_deg": dict(zip(self._neck.joint_names, np.rad2deg(tick.joints.position_rad).tolist(), strict=True)),
            "events": list(self._events),
            "has_picture": bool(self.picture),
        }
        self._history.append([tick.time_s, state["error_deg"], state["latency_ms"], self._late_ms])
        self._late_ms = 0.0
        return state


def _in_words(event: moments.EventMoment | moments.AttendedMoment) -> str:
    if isinstance(event, moments.AttendedMoment):
        return f"looks at person {event.person} ({event.why})" if event.person else f"looks at no person ({event.why})"
    meaning = MEANINGS.get(event.name) if event.text == event.name else None
    return event.text if meaning is None else f"{event.name}: {meaning}"


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _in_view_deg(eye_m: FloatArray, gaze: FloatArray, target_m: FloatArray) -> list[float]:
    """Angular offset of a position from the gaze, to the left and up, degrees."""
    to_target = target_m - eye_m
    left = np.array([-gaze[1], gaze[0], 0.0])
    left /= max(float(np.linalg.norm(left)), 1e-9)
    up = np.cross(gaze, left)
    angle_deg = math.degrees(angle_between_rad(gaze, to_target))
    offset_m = np.array([left, up]) @ to_target
    offset_deg: list[float] = (angle_deg / max(float(np.linalg.norm(offset_m)), 1e-9) * offset_m).tolist()
    return offset_deg


def _ellipse(covariance_m2: FloatArray) -> list[float] | None:
    """Horizontal ellipse: half axes in metres and direction of the first one in radians; None if not finite."""
    level = covariance_m2[:2, :2]
    if not np.isfinite(level).all():
        return None
    variances, axes = np.linalg.eigh(level)
    long_m, short_m = (_SDS * np.sqrt(np.maximum(variances[::-1], 0.0))).tolist()
    return [long_m, short_m, math.atan2(axes[1, 1], axes[0, 1])]


_PAGE = Path(__file__).with_name("page")
# No content from other hosts, and no embedding in other pages. The icon is empty.
_POLICY = "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'"


class WebPage:
    """The page and its server, in separate threads.

    Args:
        run: Description of the run.
        host: Address.
        port: Port; 0 for any free one.

    Attributes:
        snapshots: Source of the states.
        url: Address of the page.
        host: Address of the server, as given.
        on_loopback: Whether the address is reachable from this computer only.
        state: The newest state, JSON; empty before the first one.
        over: Whether the run has ended.

    Raises:
        SettingsError: If the address cannot be used.
    """

    def __init__(self, run: RunInfo, host: str, port: int) -> None:
        self.snapshots, self.host = Snapshots(run), host
        self.state, self.over = "", False
        try:
            self._server = ThreadingHTTPServer((host, port), partial(_Handler, self))
        except OSError as error:
            why = error.strerror or error
            raise SettingsError(f"--view-at {host}:{port}: {why}; another port: --view-at {host}:PORT") from None
        bound, port = self._server.server_address[:2]
        self.on_loopback = is_loopback(str(bound))
        self.url = f"http://{named(host)}:{port}/"
        threading.Thread(target=self._server.serve_forever, args=(0.1,), name="page", daemon=True).start()

    def take(self, moment: moments.Moment) -> None:
        """Show a moment.

        Args:
            moment: The moment.
        """
        if self.snapshots.take(moment):
            self.state = json.dumps(self.snapshots.state())

    def close(self) -> None:
        """Notify pages of the end of the run, and stop."""
        self.over = True
        time.sleep(2 * PERIOD_S)  # until all pages are notified
        self._server.shutdown()
        self._server.server_close()


class _Handler(SimpleHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    timeout = 30.0

    def __init__(self, page: WebPage, *connection: Any) -> None:
        self._page = page
        # Not the types of the system, where scripts may be plain text.
        self.extensions_map = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", "": "text/plain"}
        super().__init__(*connection, directory=str(_PAGE))

    def do_GET(self) -> None:
        page, path = self._page, self.path.partition("?")[0]
        # DNS rebinding: a foreign page may resolve its own name to this computer, and then read this server's data.
        if page.on_loopback and self.headers.get("Host", "").partition(":")[0] not in {*LOOPBACK, page.host}:
            self.send_error(HTTPStatus.FORBIDDEN, "use the address printed by the run")
        elif path == "/state":
            self._stream(page)
        elif path == "/picture.jpg" and (picture := page.snapshots.picture):
            self._begin("image/jpeg", "Content-Length", str(len(picture)))
            self.wfile.write(picture)
        else:
            super().do_GET()

    def do_HEAD(self) -> None:
        """Respond with 501: the inherited response bypasses the host check."""
        self.send_error(HTTPStatus.NOT_IMPLEMENTED)

    def _stream(self, page: WebPage) -> None:
        self.close_connection = True
        self._begin("text/event-stream", "Connection", "close")
        with suppress(OSError):  # the page was closed
            # A page reconnects half a second after a loss.
            self._event("hello", page.snapshots.hello(), "retry: 500\n")
            shown = ""
            while not page.over:
                if page.state != shown:
                    shown = page.state
                    self._event("state", shown)
                else:
                    self.wfile.write(b": still there\n\n")  # raises if the page is closed
                time.sleep(PERIOD_S)
            if page.state != shown:
                self._event("state", page.state)
            self._event("end", "{}")

    def _event(self, name: str, text: str, before: str = "") -> None:
        self.wfile.write(f"{before}event: {name}\ndata: {text}\n\n".encode())
        self.wfile.flush()

    def _begin(self, kind: str, name: str, value: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header(name, value)
        self.end_headers()

    def end_headers(self) -> None:
        """Send the security headers with every response."""
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        super().end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Suppress the log of requests."""
