"""Moments of a run for RViz and for diagnostics."""

from __future__ import annotations

import threading
from collections import Counter
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker, MarkerArray

from gazempc.neck.kinematics import gaze_ray
from gazempc.neck.spec import NeckSpec
from gazempc.results.moments import AttendedMoment, EventMoment, LateMoment, Moment, SeenMoment, StatusMoment

# Events that require action of the user: the loop cannot remove the cause.
_ERRORS = ("source_failed", "no_sender", "robot_not_answering", "several_senders", "controller_failed")
_LIFETIME = Duration(sec=1)
# Half axes of ellipsoids, in standard deviations.
_SIGMAS = 2.0


class Moments:
    """Keeps the latest moment of each kind, as the servo thread emits them.

    Attributes:
        latest: The newest moment of each kind.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.latest: dict[type, Any] = {}
        self._late_ms, self._skipped = 0.0, 0
        self._events: Counter[str] = Counter()
        self._texts: dict[str, str] = {}

    def take(self, moment: Moment) -> None:
        """Take a moment; returns at once."""
        with self._lock:
            self.latest[type(moment)] = moment
            if isinstance(moment, LateMoment):
                self._late_ms = max(self._late_ms, moment.late_ms)
                self._skipped += moment.skipped
            elif isinstance(moment, EventMoment):
                self._events[moment.name] += 1
                self._texts[moment.name] = moment.text

    def diagnostics(self, name: str, stamp: Time, counts: dict[str, int], warnings: tuple[str, ...]) -> DiagnosticArray:
        """The facts of the status line since the last call; skipped ticks since the start.

        Args:
            name: Name of the node.
            stamp: The time.
            counts: Number of used observations, and of refused ones by event.
            warnings: Probable errors of the data.
        """
        with self._lock:
            events, texts, late_ms, skipped = dict(self._events), dict(self._texts), self._late_ms, self._skipped
            state: StatusMoment | None = self.latest.get(StatusMoment)
            self._events.clear()
            self._texts.clear()
            self._late_ms = 0.0
        seen = None if state is None or state.capture_time_s is None else state.time_s - state.capture_time_s
        bad = [event for event in events if event in _ERRORS]
        level = DiagnosticStatus.ERROR if bad else DiagnosticStatus.WARN if events or warnings else DiagnosticStatus.OK
        message = texts[bad[0]] if bad else "no person seen yet" if seen is None else f"seen {seen:.2f} s ago"
        values: dict[str, object] = {"late_ms": round(late_ms, 2), "ticks_left_out": skipped, **counts}
        if state is not None:
            joints_deg, command_deg = np.rad2deg(state.joints_rad), np.rad2deg(state.command_rad)
            values |= {"joints_deg": joints_deg.round(2).tolist(), "command_deg": command_deg.round(2).tolist()}
            values["plan"] = "none" if state.plan_start_s is None else f"{state.time_s - state.plan_start_s:.3f} s old"
        values |= {f"event {event}": f"{count} x: {texts[event]}" for event, count in events.items()}
        values |= {f"warning {k + 1}": text for k, text in enumerate(warnings)}
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        status = DiagnosticStatus(level=level, name=name, message=message, hardware_id="neck", values=pairs)
        made = DiagnosticArray(status=[status])
        made.header.stamp = stamp
        return made

    def markers(self, neck: NeckSpec, frame: str, stamp: Time) -> MarkerArray:
        """Gaze ray, attended head, and its forecast with ellipsoids.

        Args:
            neck: The neck.
            frame: tf frame of the neck's base.
            stamp: The time.
        """
        made = MarkerArray()

        def add(name: str, kind: int, rgb: tuple[float, float, float]) -> Marker:
            marker = Marker(ns=name, id=len(made.markers), type=kind, action=Marker.ADD, lifetime=_LIFETIME)
            marker.header.frame_id, marker.header.stamp = frame, stamp
            marker.color.r, marker.color.g, marker.color.b, marker.color.a = *rgb, 0.6
            marker.pose.orientation.w = 1.0
            made.markers.append(marker)
            return marker

        with self._lock:
            state, seen = self.latest.get(StatusMoment), self.latest.get(SeenMoment)
            attended = self.latest.get(AttendedMoment)
        if state is not None:
            eye_m, direction = gaze_ray(neck.geometry, state.joints_rad)
            ray = add("gaze", Marker.ARROW, (0.1, 0.6, 1.0))
            ray.scale.x, ray.scale.y, ray.scale.z = 0.015, 0.04, 0.08
            ray.points = [_point(eye_m), _point(eye_m + 2.0 * direction)]
        if state is None or state.head_base_m is None or state.time_s - state.capture_time_s > 1.0:
            return made
        head = add("attended", Marker.SPHERE, (0.2, 1.0, 0.3))
        head.pose.position = _point(state.head_base_m)
        head.scale.x = head.scale.y = head.scale.z = 0.2
        if attended is not None and attended.person:
            label = add("name", Marker.TEXT_VIEW_FACING, (1.0, 1.0, 1.0))
            label.pose.position = _point(state.head_base_m + np.array([0.0, 0.0, 0.25]))
            label.scale.z, label.text = 0.12, f"person {attended.person} ({attended.why})"
        if seen is not None and np.isfinite(seen.means_base_m).all() and np.isfinite(seen.covariances_m2).all():
            for mean_m, covariance_m2 in zip(seen.means_base_m, seen.covariances_m2, strict=True):
                variances, axes = np.linalg.eigh(covariance_m2)
                axes = axes * np.sign(np.linalg.det(axes))
                ellipsoid = add("forecast", Marker.SPHERE, (1.0, 0.7, 0.1))
                ellipsoid.pose.position = _point(mean_m)
                size_m = 2.0 * _SIGMAS * np.sqrt(np.maximum(variances, 1e-6))
                ellipsoid.scale.x, ellipsoid.scale.y, ellipsoid.scale.z = map(float, size_m)
                x, y, z, w = map(float, Rotation.from_matrix(axes).as_quat())
                turn = ellipsoid.pose.orientation
                turn.x, turn.y, turn.z, turn.w = x, y, z, w
        return made


def _point(at_m: Any) -> Point:
    x, y, z = map(float, at_m)
    return Point(x=x, y=y, z=z)
