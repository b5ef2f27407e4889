"""A complete live run on rendered images: a camera on the head of a MuJoCo neck, and a person who walks past.

Simulated time makes the run reproducible. Images are captured at 15 Hz; each observation arrives 60 ms later.
"""

from __future__ import annotations

import math
import threading
from collections import deque

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.camera.walks import FRAME_S
from gazempc.live.clock import SimulatedClock
from gazempc.live.mount import Mount
from gazempc.live.run import LiveRun
from gazempc.live.setup import LiveSetup
from gazempc.live.sources.camera.blazeface import BlazeFace
from gazempc.live.sources.camera.finder import FaceFinder
from gazempc.live.sources.camera.intrinsics import from_field_of_view
from gazempc.live.sources.source import Arrived
from gazempc.loop import build
from gazempc.loop.planner import ImmediatePlanner
from gazempc.neck.spec import load_neck
from gazempc.results.log import Log, RunInfo
from gazempc.robots.mujoco import MujocoNeck
from gazempc.robots.studio import Studio, StudioPerson
from gazempc.settings import GazeSettings
from gazempc.types import FloatArray, Sighting

# From the middle of the exposure to the observation: transfer and face detection.
LATENCY_S = 0.06
# Offset from the eye and rotated by 3 degrees, to test the compensation of the mount.
MOUNT = Mount(on="head", position_m=(0.03, 0.02, 0.05), roll_pitch_yaw_deg=(0.0, 0.0, 3.0))


class RenderedCamera:
    """Source of images rendered from the pose of the neck's head in MuJoCo.

    Args:
        studio: Renderer.
        robot: The neck.
        clock: The loop's clock.
    """

    keeps_any_clock = True

    def __init__(self, studio: Studio, robot: MujocoNeck, clock: SimulatedClock) -> None:
        self._studio, self._robot, self._clock = studio, robot, clock
        self._finder = FaceFinder(BlazeFace())
        self._intrinsics = from_field_of_view(studio.fov_deg, studio.width, studio.height)
        self._next_s = 0.0
        self._waiting: deque[Sighting] = deque()
        self.finished = False
        self.pictures = 0

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`."""
        self._next_s = self._clock.now_s()

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        now_s = self._clock.now_s()
        if now_s >= self._next_s - 1e-9:
            self._next_s += FRAME_S
            self.pictures += 1
            picture = self._studio.picture(passer_by(now_s), *self._pose())
            found = self._finder.heads(picture, now_s, self._intrinsics)
            self._waiting += (Sighting(now_s + LATENCY_S, observation) for observation in found)
        arrived = []
        while self._waiting and self._waiting[0].arrival_s <= now_s + 1e-9:
            arrived.append(self._waiting.popleft())
        return Arrived(tuple(arrived))

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""

    def _pose(self) -> tuple[FloatArray, Rotation]:
        """Pose of the camera in the base frame, by the kinematics of MuJoCo."""
        self._robot.true_state()  # advances the simulation to the current time
        head = self._robot.data.body("head")
        turn = Rotation.from_matrix(np.array(head.xmat).reshape(3, 3))
        askew = Rotation.from_euler("xyz", MOUNT.roll_pitch_yaw_deg, degrees=True)
        return np.array(head.xpos) + turn.apply(MOUNT.position_m), turn * askew


def passer_by(time_s: float) -> StudioPerson:
    """A person who walks past at 1.5 m with 0.8 m/s, and faces the robot or slightly ahead."""
    aside_m = 2.2 - 0.8 * time_s
    eyes_m = np.array([1.5, aside_m, 0.25 + 0.02 * math.sin(2 * math.tau * 0.9 * time_s)])
    towards_rad = math.atan2(eyes_m[1], eyes_m[0])
    return StudioPerson(eyes_m, math.pi + towards_rad + math.radians(15.0))


def run(
    studio: Studio, duration_s: float = 5.5, controller: str = "mpc", neck_name: str = "reference"
) -> tuple[Log, RenderedCamera]:
    """Execute the run.

    Args:
        studio: Renderer.
        duration_s: Duration.
        controller: Name of the controller.
        neck_name: Name of the neck, or its file.

    Returns:
        The log, and the camera.
    """
    neck, clock, settings = load_neck(neck_name), SimulatedClock(), GazeSettings()
    # Initial gaze in the direction from which the person appears.
    robot = MujocoNeck(neck, clock.now_s, np.deg2rad([45.0, 5.0]))
    camera = RenderedCamera(studio, robot, clock)
    predictor = build.make_predictor("walker", settings, build.Person(), {})
    about = RunInfo(
        recording="rendered person",
        kind="rendered",
        subject="astronaut",
        controller=controller,
        predictor="walker",
        neck=neck,
        sensor={"name": "camera"},
        mode="live",
        robot="mujoco",
    )
    logs: list[Log] = []

    def true_head_m(times_s: FloatArray) -> FloatArray:
        return np.array([passer_by(float(t)).eyes_m for t in times_s])

    setup = LiveSetup(
        about,
        neck,
        predictor,
        build.make_controller(controller, neck, settings, {}),
        robot,
        camera,
        clock,
        MOUNT,
        settings.loop,
        make_planner=ImmediatePlanner,
        true_head_base_m=true_head_m,
    )
    LiveRun(setup, lambda log, _: logs.append(log)).run(threading.Event(), duration_s)
    return logs[0], camera
