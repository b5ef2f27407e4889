"""A tiny ideal plant for control laws: a direction far away, a pinhole without noise, joints in closed form."""

from dataclasses import dataclass

import numpy as np

from builders.robots import with_both
from experiments.rivals.rival import Detection, HeadCamera, View
from gazempc.neck.spec import Geometry, load_neck
from gazempc.types import JointState

# Axes and eye intersect in one point: the image depends on the direction alone.
NECK = load_neck("reference").model_copy(update={"geometry": Geometry()})
CAMERA = HeadCamera(
    half_width_rad=np.deg2rad(45.0),
    half_height_rad=np.deg2rad(29.36),
    width_px=1280,
    height_px=720,
    rate_hz=30.0,
    latency_s=0.1,
    pixel_noise_px=0.0,
)


def camera(**changes):
    """The usual camera with other values."""
    return HeadCamera(**{**vars(CAMERA), **changes})


def neck_with(**changes):
    """The reference neck, with other values for both axes."""
    return with_both(NECK, **changes)


@dataclass
class Plant:
    """Joints without limits: the command after a dead time, then a lag or a top speed.

    A velocity is integrated after its dead time.
    """

    dead_time_s: float = 0.0
    lag_s: float = 0.0
    top_speed_rad_s: float = np.inf


@dataclass
class Course:
    """Result: times (N,), pan and tilt of the head and of the person (N, 2), degrees, and the law's commands."""

    time_s: np.ndarray
    head_deg: np.ndarray
    person_deg: np.ndarray
    command: np.ndarray

    def lag_s(self, rate_deg_s, last_s):
        """Lag of the head's pan on a ramp: mean over the last `last_s` seconds."""
        end = self.time_s > self.time_s[-1] - last_s
        return float(np.mean(self.person_deg[end, 0] - self.head_deg[end, 0])) / rate_deg_s


def standing(pan_deg, tilt_deg=0.0):
    """A person who stands in that direction from the start."""
    return lambda time_s: (pan_deg, tilt_deg)


def ramp(rate_deg_s, start_deg=0.0):
    """A person who passes at that angular velocity."""
    return lambda time_s: (start_deg + rate_deg_s * time_s, 0.0)


def first_frame_only(time_s):
    """Face visibility: in the first frame only."""
    return time_s < 0.005


def offset_of(person_deg, head_rad, view):
    """Image position of a direction by rotation into the camera frame; None behind the camera."""
    pan, tilt = np.deg2rad(person_deg)
    direction = np.array([np.cos(tilt) * np.cos(pan), np.cos(tilt) * np.sin(pan), np.sin(tilt)])
    c, s = np.cos(head_rad), np.sin(head_rad)
    level = np.array([[c[0], s[0], 0.0], [-s[0], c[0], 0.0], [0.0, 0.0, 1.0]]) @ direction
    x, y, z = np.array([[c[1], 0.0, s[1]], [0.0, 1.0, 0.0], [-s[1], 0.0, c[1]]]) @ level
    if x <= 0.0:
        return None
    place = np.array([-y / x / np.tan(view.half_width_rad), -z / x / np.tan(view.half_height_rad)])
    return place if (np.abs(place) <= 1.0).all() else None


def run(law, person, duration_s, plant=None, camera=CAMERA, seen=lambda t: True, range_m=1.5, dt_s=0.001):
    """Run a law on a plant from pan = tilt = 0.

    Args:
        law: The law.
        person: Pan and tilt of the person at a time, degrees.
        duration_s: How long.
        plant: How the joints answer; at once if not given.
        camera: The plant's camera; the law's model may differ.
        seen: Whether a frame of that capture time shows the face.
        range_m: Distance of the person.
        dt_s: Step of the simulation.
    """
    plant = plant or Plant()
    count, delay = round(duration_s / dt_s), round(plant.dead_time_s / dt_s)
    head = np.zeros((count + 1, 2))
    command = np.zeros((count, 2))
    waiting, next_frame, next_step, stood = [], 0, 0, 0.0
    face_px = camera.face_height_m / range_m / (2.0 * np.tan(camera.half_height_rad)) * camera.height_px
    times = np.arange(count + 1) * dt_s
    for k in range(count):
        t = times[k]

        def joints_at(time_s, k=k):
            if time_s < -0.05 or time_s > times[k] + 0.05:
                return None
            return np.array([np.interp(time_s, times[: k + 1], head[: k + 1, axis]) for axis in (0, 1)])

        if t >= next_frame / camera.rate_hz - 1e-9:
            next_frame += 1
            place = offset_of(person(t), head[k], camera)
            if place is not None and seen(t):
                box = np.array([0.75 * face_px, face_px])
                waiting.append(Detection(t, t + camera.latency_s, place, range_m, box))
        if t >= next_step * law.period_s - 1e-9:
            next_step += 1
            due = tuple(d for d in waiting if d.arrival_time_s <= t + 1e-9)
            waiting = waiting[len(due) :]
            pending = command[max(k - delay - 1, 0) : k]
            stands = k == 0 or (np.ptp(np.vstack([pending, head[k]]), axis=0) < 1e-6).all()
            speed = np.zeros(2) if k == 0 else (head[k] - head[k - 1]) / dt_s
            view = View(t, due, JointState(t, head[k].copy(), speed), joints_at, bool(stands))
            if k == 0:
                law.start(view)
            stood = np.asarray(law.step(view), dtype=float)
        command[k] = stood
        acting = command[k - delay] if k >= delay else np.zeros(2)
        if law.command == "velocity":
            head[k + 1] = head[k] + dt_s * acting
        else:
            share = 1.0 if plant.lag_s == 0.0 else 1.0 - np.exp(-dt_s / plant.lag_s)
            most = plant.top_speed_rad_s * dt_s
            head[k + 1] = head[k] + np.clip(share * (acting - head[k]), -most, most)
    persons = np.array([person(t) for t in times[:-1]])
    return Course(times[:-1], np.rad2deg(head[:-1]), persons, command)
