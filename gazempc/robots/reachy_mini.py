"""Reachy Mini's head and body over the websocket of its daemon."""

from __future__ import annotations

import json
import math
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from gazempc.errors import RobotError, SettingsError, importing
from gazempc.neck.kinematics import head_angles_rad, pan_tilt_rad
from gazempc.neck.spec import NeckSpec
from gazempc.robots.options import ReachyMiniOptions
from gazempc.robots.robot import check_command
from gazempc.types import FloatArray, JointState

# Tolerances of the initial pose: from a lying head (asleep) or a turned body the first command would cause a jump.
_DISPLACED_M, _BODY_TURNED_RAD = 0.02, math.radians(10.0)
# Timeout of poses, which the daemon sends every 20 ms, and of a blocked send.
_SILENCE_S = 1.0
_OPEN_S = 1.0
_POLL_S = 0.1
# Poses have no velocity: linear regression over the last few.
_POSES = 4
# Types of messages that the daemon sends after a connection was established.
_KINDS = ("head_pose", "joint_positions", "daemon_status")
# Reach of the head without the body: the daemon's inverse kinematics (reachy-mini 1.13.0) with all motors 0.5 deg or
# more inside their limits. Beyond it a motor saturates and the head tilts sideways, or the pose is ignored. Also within
# the SDK's own limits (pitch 40 deg, yaw 65 deg from the body).
_TILT_RAD = np.deg2rad([-40.0, -36.0, -32.0, -28.0, -24.0, 31.0, 36.0, 40.0])
_PAN_MAX_RAD = np.deg2rad([38.0, 47.0, 54.0, 61.0, 65.0, 65.0, 59.0, 53.5])


class ReachyMiniNeck:
    """Reachy Mini's head (pan is yaw, tilt is pitch, roll 0) over the websocket of ``reachy-mini-daemon``.

    One thread receives (and reconnects four times a second after a loss), another one sends; so calls do not block on
    the network. An unsent command is replaced by the next one. The body is commanded if the neck has one, else it is
    kept straight. The antennas are not commanded. The daemon moves to a target at once: so after every connection, and
    after the motors were off, the first commands are approached at `approach_speed_rad_s` from the present pose.

    Poses of the daemon have no time stamp; the arrival time is used. After `close` the daemon holds the last target
    with the motors on.

    Args:
        neck: Limits and rates.
        clock_s: Returns the present time, seconds; at the rate of the wall clock.
        options: Address of the daemon, and speed to the first command.

    Raises:
        SettingsError: If straight ahead is not in the neck's range, or the neck has eyes.
    """

    def __init__(self, neck: NeckSpec, clock_s: Callable[[], float], options: ReachyMiniOptions) -> None:
        if np.any(neck.position_min_rad > 0.0) or np.any(neck.position_max_rad < 0.0):
            # Clamping to the head's reach is towards 0, so it stays within such a range.
            raise SettingsError(f"neck {neck.name!r}: the range for Reachy Mini must contain 0 of all joints")
        if neck.eyes is not None:
            raise SettingsError(f"neck {neck.name!r} has eyes, but those of Reachy Mini do not turn")
        self._neck = neck
        self._clock_s = clock_s
        self._host, self._port = host, port = options.host, options.port
        self._uri = f"ws://{f'[{host}]' if ':' in host else host}:{port}/ws/sdk"
        self._step_rad = options.approach_speed_rad_s * neck.servo_period_s
        self._threads: list[threading.Thread] = []
        # One event for every connect(): also ends a slow thread of an earlier connection.
        self._stop = threading.Event()
        # Guards all below; notified of every change.
        self._changed = threading.Condition()
        self._socket: Any = None
        self._lost = ""
        self._poses: deque[tuple[float, FloatArray]] = deque(maxlen=_POSES)
        self._fresh = False
        self._displaced_m = math.inf
        self._body_yaw_rad = 0.0
        self._no_motion = ""
        self._missing = list(_KINDS)
        self._goal_rad: FloatArray | None = None
        self._approaching = True
        self._message: str | None = None
        self._sending_since_s: float | None = None

    def connect(self) -> None:
        """Connect to the daemon and wait for its first state; see `gazempc.robots.robot.Robot.connect`.

        Raises:
            RobotError: If the daemon does not reply or send its state, motors are off, the head is not up or the body
                is turned; names address and remedy.
            MissingOptionalDependencyError: If websockets is not installed.
        """
        if self._threads:
            return
        with importing("Reachy Mini", "websockets", "reachy"):
            import websockets.sync.client  # noqa: PLC0415  (optional)
        self._lost = ""
        self._stop = stop = threading.Event()
        self._threads = [
            threading.Thread(target=self._listen, args=(websockets.sync.client.connect, stop), daemon=True),
            threading.Thread(target=self._send, args=(stop,), daemon=True),
        ]
        for thread in self._threads:
            thread.start()
        with self._changed:
            self._changed.wait_for(lambda: self._lost or (self._socket is not None and not self._missing), timeout=5.0)
            refusal = self._refusal()
        if refusal:
            self.close()
            raise RobotError(refusal)

    def read_state(self) -> JointState | None:
        """Newest pose of the head, without waiting; see `gazempc.robots.robot.Robot.read_state`.

        Returns:
            Angles of the head, and velocities from the last few poses; None without a new pose since the last call, if
            the newest is older than 0.2 s, or with too few poses for a velocity.

        Raises:
            RobotError: If there is no connection; reconnection continues.
        """
        with self._changed:
            if not self._threads or self._socket is None:
                raise RobotError(self._refusal())
            now_s, clock_s = time.monotonic(), self._clock_s()
            fresh, self._fresh = self._fresh, False
            if not fresh or len(self._poses) < _POSES or now_s - self._poses[-1][0] > 0.2:
                return None
            times_s = np.array([time_s for time_s, _ in self._poses])
            angles_rad = np.array([angles for _, angles in self._poses])
        if times_s[-1] - times_s[0] < 0.03:  # poses that arrived in one burst
            return None
        velocity_rad_s = np.polyfit(times_s - times_s[-1], angles_rad, 1)[0]
        return JointState(clock_s - (now_s - times_s[-1]), angles_rad[-1], velocity_rad_s)

    def send_command(self, position_rad: FloatArray) -> FloatArray:
        """Queue a target for the sending thread; see `gazempc.robots.robot.Robot.send_command`.

        Args:
            position_rad: Pan and tilt, and the yaw of a body that turns, shape (N,), radians.

        Returns:
            The angles sent, shape (N,), radians: clamped to the neck's range and to the reach of the head, and after a
            connection limited to the approach speed.

        Raises:
            RobotError: If the command is not finite, or the robot does not reply or cannot move.
        """
        check_command(position_rad, self._neck.joints)
        target = self._within_reach(position_rad)
        with self._changed:
            if refusal := self._refusal():
                self._goal_rad, self._approaching = None, True
                raise RobotError(refusal)
            if self._approaching:
                start = self._poses[-1][1] if self._goal_rad is None else self._goal_rad
                goal = self._within_reach(np.clip(target, start - self._step_rad, start + self._step_rad))
                self._approaching = bool(np.any(goal != target))
                target = goal
            self._goal_rad = target
            # The daemon's frame does not turn with the body.
            head = head_matrix(head_angles_rad(target)).ravel().tolist()
            body_yaw_rad = 0.0 if self._neck.body is None else float(target[-1])
            self._message = json.dumps({"type": "set_full_target", "head": head, "body_yaw": body_yaw_rad})
            self._changed.notify_all()
        return target.copy()

    def close(self) -> None:
        """End the connection and both threads; the robot holds the last target. Never raises."""
        with self._changed:
            self._stop.set()
            self._changed.notify_all()
        for thread in reversed(self._threads):
            # The sending thread may block on an unresponsive daemon; the receiving thread then closes the socket.
            thread.join(_POLL_S if thread is self._threads[-1] else 4.0 * _OPEN_S)
        self._threads = []

    def _within_reach(self, position_rad: FloatArray) -> FloatArray:
        within = np.clip(position_rad, self._neck.position_min_rad, self._neck.position_max_rad)
        return np.concatenate((clamp_to_head(within[:2]), within[2:]))

    def _refusal(self) -> str:
        """Reason why commands are refused at present; empty if they are accepted."""
        if not self._threads:
            return f"Reachy Mini at {self._uri} is not connected: call connect() first"
        if self._socket is None:
            return self._lost or f"Reachy Mini: no connection to the daemon at {self._uri}"
        if self._missing:
            trouble = f"the daemon replies, but sent no {' and no '.join(self._missing)} message: see its log"
        elif self._no_motion:
            trouble = self._no_motion
        elif self._sending_since_s is not None and time.monotonic() - self._sending_since_s > _SILENCE_S:
            trouble = "the daemon no longer accepts commands"
        elif self._goal_rad is None and self._displaced_m > _DISPLACED_M:
            trouble = "the head is not up; wake the robot first"
        elif self._neck.body is None and self._goal_rad is None and abs(self._body_yaw_rad) > _BODY_TURNED_RAD:
            trouble = f"the body is turned by {math.degrees(self._body_yaw_rad):.0f} deg; turn it forward first"
        else:
            return ""
        return f"Reachy Mini at {self._uri}: {trouble}"

    def _listen(self, open_websocket: Callable[..., Any], stop: threading.Event) -> None:
        """Receive until closed; connect again whenever the connection is lost."""
        while not stop.is_set():
            try:
                # An explicit socket bypasses a proxy of the environment.
                raw = socket.create_connection((self._host, self._port), timeout=_OPEN_S)
                raw.settimeout(None)
                with open_websocket(
                    self._uri, sock=raw, open_timeout=_OPEN_S, close_timeout=_OPEN_S, compression=None
                ) as connection:
                    try:
                        self._receive(connection, stop)
                    finally:
                        self._forget(connection)
            except Exception as error:  # retried after any exception of library or system
                with self._changed:
                    if stop.is_set():
                        return
                    why = f"no connection to the daemon at {self._uri} ({error or type(error).__name__})"
                    self._lost = f"Reachy Mini: {why}; start `reachy-mini-daemon` (--sim: its simulator)"
                    self._changed.notify_all()
                    self._changed.wait_for(stop.is_set, timeout=0.25)

    def _receive(self, connection: Any, stop: threading.Event) -> None:
        with self._changed:
            if stop.is_set():
                return
            self._socket = connection
            self._changed.notify_all()
        heard_s = time.monotonic()
        while not stop.is_set():
            with suppress(TimeoutError):
                heard_s = self._take(connection.recv(timeout=_POLL_S), heard_s)
            if time.monotonic() - heard_s > _SILENCE_S:
                raise TimeoutError(f"connected, but no head_pose message for {_SILENCE_S:g} s")

    def _forget(self, connection: Any) -> None:
        """Discard the state of this connection; old commands must not reach the next one."""
        with self._changed:
            if self._socket is not connection:
                return
            self._socket = self._message = self._goal_rad = None
            self._approaching, self._fresh = True, False
            self._missing = list(_KINDS)
            self._poses.clear()
        # The library's own close would block: on a send that waits for the network and holds a lock, and in some
        # versions on messages that are no longer received. Sent data are still delivered.
        with suppress(Exception):
            connection.socket.shutdown(socket.SHUT_RDWR)
            while True:
                connection.recv(timeout=_POLL_S)

    def _take(self, message: str | bytes, heard_s: float) -> float:
        """Process a message; returns the arrival time of the last pose, on the monotonic clock, seconds."""
        now_s = time.monotonic()
        with self._changed, suppress(Exception):  # unreadable messages are ignored
            content = json.loads(message)
            kind = content["type"]
            if kind == "head_pose":
                matrix = np.array(content["head_pose"], dtype=np.float64)
                angles_rad = head_angles(matrix)
                if self._neck.body is not None:
                    # The daemon's frame does not turn with the body.
                    pan_rad = math.remainder(angles_rad[0] - self._body_yaw_rad, math.tau)
                    angles_rad = np.array([pan_rad, angles_rad[1], self._body_yaw_rad])
                # The daemon sends the body's angle just before the pose of the same moment.
                if "joint_positions" not in self._missing or self._neck.body is None:
                    self._poses.append((now_s, angles_rad))
                self._displaced_m = float(np.linalg.norm(matrix[:3, 3]))
                self._fresh = True
                heard_s = now_s
            elif kind == "joint_positions":
                self._body_yaw_rad = float(content["head_joint_positions"][0])
            elif kind == "daemon_status":
                self._no_motion = _no_motion(content)
            if kind in self._missing and (kind != "head_pose" or self._poses):
                self._missing.remove(kind)
            self._changed.notify_all()
        return heard_s

    def _send(self, stop: threading.Event) -> None:
        """Send the newest message, until closed."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: stop.is_set() or self._message is not None)
                connection, message, self._message = self._socket, self._message, None
                if message is None:
                    return
                self._sending_since_s = time.monotonic()
            with suppress(Exception):  # the listening thread reports the loss
                connection.send(message)
            with self._changed:
                self._sending_since_s = None


def head_matrix(position_rad: FloatArray) -> FloatArray:
    """Pose of the head for pan and tilt, shape (2,), radians: yaw, then pitch, no roll, origin at rest.

    Returns:
        Homogeneous matrix, shape (4, 4), in the daemon's frame (x forward, y left, z up; its pitch is positive down).
    """
    (cp, ct), (sp, st) = np.cos(position_rad), np.sin(position_rad)
    return np.array(
        [[cp * ct, -sp, -cp * st, 0.0], [sp * ct, cp, -sp * st, 0.0], [st, 0.0, ct, 0.0], [0.0, 0.0, 0.0, 1.0]]
    )


def head_angles(matrix: FloatArray) -> FloatArray:
    """Pan and tilt of the head's forward axis, shape (2,), radians, at any roll; the inverse of `head_matrix`.

    Raises:
        ValueError: If it is not a pose: wrong shape, not finite, not a rotation.
    """
    turn = matrix[:3, :3] if matrix.shape == (4, 4) else np.full((3, 3), np.nan)
    # With a tolerance for the noise of the daemon; negated, to refuse NaN.
    if not (np.all(np.abs(turn @ turn.T - np.eye(3)) < 0.02) and np.linalg.det(turn) > 0):
        raise ValueError("not a pose")
    return pan_tilt_rad(turn[:, 0])


def clamp_to_head(position_rad: FloatArray) -> FloatArray:
    """Clamp pan and tilt, relative to the body, shape (2,), radians: tilt first, then pan to the reach at that tilt."""
    tilt = np.clip(position_rad[1], _TILT_RAD[0], _TILT_RAD[-1])
    pan_max = np.interp(tilt, _TILT_RAD, _PAN_MAX_RAD)
    return np.array([np.clip(position_rad[0], -pan_max, pan_max), tilt])


def _no_motion(status: dict[str, Any]) -> str:
    """Reason why the robot cannot move, from a daemon_status message; empty if it can."""
    backend = status["backend_status"] or {}
    mode = backend.get("motor_control_mode")
    if status["state"] != "running":
        return f"the daemon's state is {status['state']!r}, not 'running': {status.get('error')}"
    if backend.get("error"):
        return f"the daemon reports: {backend['error']}"
    return "" if mode == "enabled" else f"motors are {mode!r}, not 'enabled': wake the robot first"
