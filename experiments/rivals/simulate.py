"""Simulation of a rival, which observes faces in a camera on the moving head, in place of this project's loop.

Rivals and this project's controllers observe the same people with the same errors, losses and delays. Observations of
the sensor are projected into the image of a camera at the head's pose of the capture. A rival commands joint angles or
velocities, limited to the motors' top speed. The log has the same format as others.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np

from experiments.rivals.rival import Detection, HeadCamera, Rival, View, half_sizes
from gazempc.loop.recorder import JointColumns, LoopRecorder
from gazempc.neck.kinematics import seen_from_head
from gazempc.neck.spec import Geometry, NeckSpec
from gazempc.recordings.recording import TrueHead
from gazempc.results.log import Log, RunInfo
from gazempc.sim.scene import Scene
from gazempc.sim.sensing.spec import FieldOfView
from gazempc.sim.sensor import SensorSpec, observe
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import FloatArray, JointState, Sighting

# Field of view and aspect of the Raspberry Pi Camera Module 3 Wide, as on Reachy Mini: 102 by 67 degrees.
HORIZONTAL_DEG, VERTICAL_DEG = 102.0, 67.0
WIDTH_PX, HEIGHT_PX = 1280, 720
# Standard deviation of the box's edges, as in the PTZ simulator of Frigate.
BOX_NOISE_PX = 2.0
# Aspect ratio of a face.
_WIDTH_TO_HEIGHT = 0.75


def on_the_head(sensor: SensorSpec) -> SensorSpec:
    """The sensor with the same errors, mounted on the head beside the eye.

    Args:
        sensor: The sensor; its field of view is kept if it is already on the head.

    Returns:
        The sensor on the head, with a limited field of view.
    """
    if sensor.view.on == "head" and sensor.view.horizontal_deg < 180.0 and sensor.view.vertical_deg < 180.0:
        return sensor
    view = FieldOfView(on="head", horizontal_deg=HORIZONTAL_DEG, vertical_deg=VERTICAL_DEG)
    return sensor.model_copy(update={"view": view})


def camera_of(sensor: SensorSpec) -> HeadCamera:
    """Camera model of a sensor on the head.

    Args:
        sensor: A sensor from `on_the_head`.

    Returns:
        The camera. Its noise is the box's only; the position of the face includes the sensor's errors.
    """
    return HeadCamera(
        half_width_rad=math.radians(sensor.view.horizontal_deg) / 2.0,
        half_height_rad=math.radians(sensor.view.vertical_deg) / 2.0,
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        rate_hz=sensor.rate_hz,
        latency_s=sensor.latency_s,
        pixel_noise_px=BOX_NOISE_PX,
    )


def detect(
    camera: HeadCamera, geometry: Geometry, joints_rad: FloatArray, sighting: Sighting, rng: np.random.Generator
) -> Detection | None:
    """Project an observation into the image of a camera on the head.

    Args:
        camera: The camera, at the eye.
        geometry: The neck's geometry.
        joints_rad: Pan and tilt at the capture, shape (2,), radians.
        sighting: Observation of the sensor.
        rng: Random generator of the box's noise.

    Returns:
        The face in the image; None outside the field of view.
    """
    seen_m = seen_from_head(geometry, joints_rad, sighting.observation.head_position_base_m)
    ahead_m, left_m, up_m = seen_m.tolist()
    if ahead_m <= 0.0:
        return None
    half_image = half_sizes(camera)
    offset = -np.array([left_m, up_m]) / ahead_m / half_image
    if np.any(np.abs(offset) > 1.0):
        return None
    range_m = float(np.linalg.norm(seen_m))
    height_px = camera.face_height_m / ahead_m / half_image[1] * camera.height_px / 2.0
    box_px = np.array([_WIDTH_TO_HEIGHT * height_px, height_px]) + rng.normal(0.0, camera.pixel_noise_px, 2)
    return Detection(
        capture_time_s=sighting.observation.capture_time_s,
        arrival_time_s=sighting.arrival_s,
        offset=offset,
        range_m=range_m,
        box_px=np.maximum(box_px, 1.0),
    )


# Bounds of velocity and position error of a device at rest.
_STILL_RAD_S, _THERE_RAD = np.deg2rad(0.5), np.deg2rad(0.25)


def driven_by(neck: NeckSpec, command: Literal["position", "velocity"]) -> NeckSpec:
    """The neck with a given command type.

    Args:
        neck: The neck.
        command: Command type of its joints.

    Returns:
        The neck with the same dead time, servo and limits.
    """
    given = {"command": command} if command == "velocity" else {"command": command, "speed_steps": None}
    axes = {name: axis.model_copy(update=given) for name, axis in (("pan", neck.pan), ("tilt", neck.tilt))}
    return neck.model_copy(update=axes)


class Motor:
    """Zero-order hold of a rival's command, sent at every tick.

    Angles are limited to the joint's range and, like those of a motor, rate limited to the top speed. Velocities are
    limited to the top speed.

    Args:
        neck: The neck, with the command type of the rival.
        start_rad: Initial angles, at rest, shape (2,), radians.
        clock_s: Function that returns the current time, seconds.
        seed: Seed of the encoder noise.
    """

    def __init__(self, neck: NeckSpec, start_rad: FloatArray, clock_s: Callable[[], float], seed: int) -> None:
        self._neck, self._clock_s, self._takes_speeds = neck, clock_s, neck.takes_speeds
        self.robot = SimulatedNeck(neck, start_rad, clock_s, seed)
        self.robot.connect()
        self.sent = np.zeros(2) if self._takes_speeds else np.array(start_rad)
        self._wanted = self.sent.copy()
        self._sent_s: float | None = None
        self._changed_s = -np.inf

    def reading(self) -> JointState:
        """Measured state of the joints."""
        return self.robot.read_state() or self.robot.true_state()

    def ask(self, command: FloatArray) -> None:
        """Set the command: angles or velocities, shape (2,), held until the next one."""
        neck = self._neck
        if self._takes_speeds:
            low, high = -neck.velocity_max_rad_s, neck.velocity_max_rad_s
        else:
            low, high = neck.position_min_rad, neck.position_max_rad
        self._wanted = np.minimum(np.maximum(command, low), high)

    def tick(self) -> None:
        """Send the current command."""
        now_s = self._clock_s()
        sent = self._wanted
        if not self._takes_speeds:
            passed_s = 0.0 if self._sent_s is None else now_s - self._sent_s
            most = self._neck.velocity_max_rad_s * passed_s
            sent = self.sent + np.minimum(np.maximum(self._wanted - self.sent, -most), most)
        if np.any(np.abs(sent - self.sent) > 1e-9):
            self._changed_s = now_s
        self.sent, self._sent_s = sent, now_s
        self.robot.send_command(sent)

    @property
    def idle(self) -> bool:
        """Whether the device is at rest without a pending move."""
        state = self.robot.true_state()
        if np.any(np.abs(state.velocity_rad_s) > _STILL_RAD_S) or np.any(np.abs(self._wanted - self.sent) > 1e-9):
            return False
        if self._takes_speeds and np.any(self.sent != 0.0):
            return False
        if self._clock_s() - self._changed_s <= float(np.max(self._neck.dead_time_s)):
            return False
        return self._takes_speeds or bool(np.all(np.abs(self.sent - state.position_rad) <= _THERE_RAD))


_KEPT_S = 3.0
# Tolerance of times before the first and after the last reading.
_NEAR_S = 0.05


class EncoderHistory:
    """Readings of the last 3 s."""

    def __init__(self) -> None:
        self._readings: deque[JointState] = deque()

    def note(self, reading: JointState) -> None:
        """Add a reading, later than all before."""
        self._readings.append(reading)
        while self._readings[0].time_s < reading.time_s - _KEPT_S:
            self._readings.popleft()

    def at(self, time_s: float) -> FloatArray | None:
        """Pan and tilt at a time: linear between readings, else the nearest end.

        Args:
            time_s: The time, seconds.

        Returns:
            Shape (2,), radians; None more than 0.05 s before the first or after the last reading.
        """
        times_s = [reading.time_s for reading in self._readings]
        if not times_s or not times_s[0] - _NEAR_S <= time_s <= times_s[-1] + _NEAR_S:
            return None
        angles_rad = np.array([reading.position_rad for reading in self._readings])
        return np.array([np.interp(time_s, times_s, angle_rad) for angle_rad in angles_rad.T])


# Minimum rate of the simulation; the neck's rate if higher.
RATE_HZ = 200.0
_SAME_TIME_S = 1e-9
_STILL = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

MakeRival = Callable[[NeckSpec, HeadCamera], Rival]


def simulate(scene: Scene, make_rival: MakeRival, latency_error_s: float = 0.0) -> Log:
    """Simulate a rival in a scene.

    Args:
        scene: Walk, neck, sensor on the head, and seed, as for a replay. `neck` is the rival's model; `robot_neck`, if
            different, is simulated.
        make_rival: Constructs the rival from the models of neck and camera.
        latency_error_s: Modelled minus true latency, seconds.

    Returns:
        The log, at the neck's servo rate, without forecasts and events.

    Raises:
        ValueError: If the rival's command is not two finite numbers.
    """
    return _Run(scene, make_rival, latency_error_s).log()


class _Run:
    """One rival in one scene, tick by tick."""

    def __init__(self, scene: Scene, make_rival: MakeRival, latency_error_s: float) -> None:
        self._scene, self._camera = scene, camera_of(scene.sensor)
        camera_model = replace(self._camera, latency_s=self._camera.latency_s + latency_error_s)
        self._rival = make_rival(scene.neck, camera_model)
        self._neck = neck = driven_by(scene.robot_neck or scene.neck, self._rival.command)
        sightings = deque(observe(scene.walk, scene.sensor, scene.seed))
        start_rad = scene.first_angles_rad(sightings[0].observation.head_position_base_m)
        self.now_s, self._next_step_s = 0.0, -math.inf
        self._motor = Motor(neck, neck.command_limits.clip_position(start_rad), lambda: self.now_s, scene.seed)
        self._encoders, self._recorder = EncoderHistory(), LoopRecorder(neck.control_period_s)
        self._rng = np.random.default_rng([scene.seed, 0])
        self._joints: list[FloatArray] = []
        self._true_joints: list[JointState] = []
        self._pending: list[Detection] = []
        per_row = max(round(RATE_HZ / neck.servo_rate_hz), 1)
        rate_hz = per_row * neck.servo_rate_hz
        for index in range(int(float(scene.walk.times_s[-1]) * rate_hz + 1e-6) + 1):
            arrived = []
            self.now_s = index / rate_hz
            while sightings and sightings[0].arrival_s <= self.now_s + _SAME_TIME_S:
                arrived.append(sightings.popleft())
            self._tick(arrived, rate_hz, index % per_row == 0)

    def _tick(self, arrived: list[Sighting], rate_hz: float, takes_row: bool) -> None:
        """One step of the simulation; detections are queued until the rival's next step."""
        state = self._motor.robot.true_state()
        self._joints.append(state.position_rad)
        self._encoders.note(self._motor.reading())
        for sighting in arrived:
            self._detect(sighting, rate_hz)
        if self._next_step_s == -math.inf:
            self._rival.start(self._view(()))
            self._next_step_s = self.now_s
        if self.now_s >= self._next_step_s - _SAME_TIME_S:
            self._step()
        self._motor.tick()
        if takes_row:
            self._true_joints.append(state)
            self._recorder.tick(self.now_s, None, self._motor.sent, _STILL)

    def _detect(self, sighting: Sighting, rate_hz: float) -> None:
        # The image is from the true capture time; time stamps may have an error.
        taken_s = sighting.observation.capture_time_s - self._scene.sensor.timing.stamp_offset_s
        captured = min(max(round(taken_s * rate_hz), 0), len(self._joints) - 1)
        seen = detect(self._camera, self._neck.geometry, self._joints[captured], sighting, self._rng)
        if seen is not None:
            self._pending.append(seen)
            self._recorder.observation(self.now_s, sighting.observation, None, 0.0)

    def _step(self) -> None:
        answer = np.asarray(self._rival.step(self._view(tuple(self._pending))), dtype=np.float64)
        if answer.shape != (2,) or not np.isfinite(answer).all():
            raise ValueError(f"rival {self._rival.name}: step() returned {answer!r}; expected: two finite numbers")
        self._motor.ask(answer)
        self._pending.clear()
        # Periodic sampling, independent of the simulation's step.
        self._next_step_s += self._rival.period_s

    def _view(self, detections: tuple[Detection, ...]) -> View:
        return View(self.now_s, detections, self._motor.reading(), self._encoders.at, self._motor.idle)

    def log(self) -> Log:
        """The log of the run."""
        scene, true_head = self._scene, TrueHead(self._scene.walk)

        def where_known(times_s: FloatArray) -> FloatArray:
            return np.where(true_head.known(times_s)[:, None], true_head(times_s), np.nan)

        run = RunInfo(
            recording=scene.walk.name,
            kind=scene.walk.kind,
            subject=scene.walk.labels.subject,
            group=scene.walk.labels.group,
            controller=self._rival.name,
            predictor="none",
            neck=self._neck,
            sensor=scene.sensor.model_dump(mode="json"),
            seed=scene.seed,
        )
        return self._recorder.finish(run, where_known, JointColumns(self._neck.joints, self._true_joints))[0]
