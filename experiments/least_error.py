"""The least gaze error any controller could have on a neck.

The whole walk is known from the first observation of the person on. The command's limits, the dead time
and the servo count; the tilt is taken to be on the person. The motion with the least sum of squared errors, over what
is scored of the run, is a quadratic program. In it an error is the arc along the circle of equal tilt, which for errors
below 57 deg is at most 4 % longer than the angle. The true least error is lower by at most that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from experiments.engine.job import Row, key_of, models_hash, recording_hash
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.servo import zero_order_hold
from gazempc.neck.spec import NeckSpec
from gazempc.parts import TRUE_FUTURE
from gazempc.results.log import Log
from gazempc.results.metrics import SCORED_FROM_S, measure
from gazempc.settings import WalkerSettings
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene
from gazempc.sim.sensor import SensorSpec

CONTROLLERS = ("lookahead", "mpc", TRUE_FUTURE)


@dataclass(frozen=True)
class BoundJob:
    """The bound on one recording, and what controllers reach.

    Attributes:
        recording: Synthetic name or path.
        scene: The robot's place and the seed.
        neck: The neck.
        sensor: The sensor; None for the one that fits the recording.
        walker: Model of the forecasts.
    """

    recording: str
    scene: SceneSettings
    neck: NeckSpec
    sensor: SensorSpec | None
    walker: WalkerSettings

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        return key_of(self, recording=recording_hash(self.recording), models=models_hash(self.walker.fitted))

    def run(self) -> Row:
        """Group, RMS gaze error of each of `CONTROLLERS`, and the least one (``bound``), degrees."""
        scene = make_scene(self.recording, self.scene, self.neck, self.sensor)
        row: Row = {"group": scene.walk.labels.group}
        first_observation_s = math.inf
        settings = ReplaySettings(walker=self.walker)
        for controller in CONTROLLERS:
            log, _ = replay_scene(scene, controller, settings.predictor, settings)
            row[controller] = measure(log).gaze_error_rms_deg
            moving = np.flatnonzero(np.any(log.command_position_rad != log.command_position_rad[0], axis=1))
            first_observation_s = (
                min(first_observation_s, float(log.time_s[moving[0]])) if moving.size else first_observation_s
            )
        return row | {"bound": least_error_deg(log, first_observation_s)}


def least_error_deg(log: Log, first_observation_s: float) -> float:
    """The least RMS gaze error of a neck with the log's limits, dead time, servo and start, scored as all runs are.

    See the module for what is left out.

    Args:
        log: A run; only where the person is, and where the joint starts, are taken from it.
        first_observation_s: Time of the first observation, seconds; before it the command is constant.

    Returns:
        RMS gaze error, degrees.
    """
    neck, n = log.neck, len(log.time_s)
    aims = look_at_rad(neck.geometry, log.head_true_base_m)
    pan, worth = np.unwrap(aims[:, 0]), np.cos(aims[:, 1])
    scored = log.time_s >= log.time_s[0] + SCORED_FROM_S - 1e-9
    start, h = float(log.joint_position_rad[0, 0]), neck.servo_period_s
    command, joint, speed = (ca.SX.sym(name, n) for name in ("command", "joint", "speed"))
    # Of a dead time that is no whole number of ticks the begun one is left out, too.
    dead = int(neck.dead_time_s[0] / h + 1e-9)
    acting = ca.vertcat(ca.DM(np.full(min(dead, n), start)), command[: max(n - dead, 0)])
    # Before the run, too, it stood.
    sent = ca.vertcat(ca.DM(np.full(3, start)), command)
    servo = ca.DM(zero_order_hold(neck.pan, h))
    following = (
        ca.horzcat(joint[1:] - start, speed[1:]).T - servo @ ca.horzcat(joint - start, speed, acting - start).T[:, :-1]
    )
    limits = neck.command_limits
    rows = ca.vertcat(ca.vec(following), *(ca.diff(sent, k) for k in (1, 2, 3)))
    motion = (limits.velocity_max_rad_s, limits.acceleration_max_rad_s2, limits.jerk_max_rad_s3)
    most_motion = [float(most[0]) * h**k for k, most in enumerate(motion, start=1)]
    most = np.repeat([0.0, *most_motion], [2 * (n - 1), n + 2, n + 1, n])
    low, high = np.full((3, n), -np.inf), np.full((3, n), np.inf)
    low[0], high[0] = limits.position_min_rad[0], limits.position_max_rad[0]
    before = log.time_s < first_observation_s - 1e-9
    low[0, before] = high[0, before] = low[1, 0] = high[1, 0] = start
    low[2, 0] = high[2, 0] = 0.0
    # A bound has to allow for a gaze that gives up what is not scored; a thousandth of it keeps the program regular.
    counted = np.where(scored, 1.0, 1e-3)
    cost = ca.sum(counted * (worth * (joint - pan)) ** 2)
    problem = {"x": ca.vertcat(command, joint, speed), "f": cost, "g": rows}
    solver = ca.qpsol("least", "piqp", problem, {"print_time": 0, "error_on_fail": True})
    found = np.asarray(solver(lbx=low.ravel(), ubx=high.ravel(), lbg=-most, ubg=most)["x"]).ravel()[n : 2 * n]
    # The angle between two directions of equal tilt.
    arcs = 2.0 * np.arcsin(np.clip(worth * np.sin(np.abs(found - pan) / 2.0), 0.0, 1.0))
    return float(np.degrees(np.sqrt(np.mean(arcs[scored] ** 2))))
