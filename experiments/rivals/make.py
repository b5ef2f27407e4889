"""Rivals as trials run them: with the same detector for all, and Frigate calibrated."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from experiments.rivals.laws import RIVALS
from experiments.rivals.laws.frigate import Frigate, FrigateCalibration, MoveTime
from experiments.rivals.laws.reachy_mini import ReachyMini, ReachyMiniCaptureRaw
from experiments.rivals.motor import Motor, driven_by
from experiments.rivals.rival import HeadCamera, Rival, View
from gazempc.neck.spec import NeckSpec

_RATE_HZ = 200.0
# A neck that needs longer for its thirty moves is one that Frigate would not accept.
_PATIENCE_S = 600.0

# These leave out small faces. All are to see the same ones, so that laws are compared and not detectors.
_OWN_DETECTOR = (ReachyMini, ReachyMiniCaptureRaw)


def make_rival(name: str, robot_neck: NeckSpec, neck: NeckSpec, camera: HeadCamera, **constants: Any) -> Rival:
    """Make a rival for a trial.

    Args:
        name: One of `RIVALS`.
        robot_neck: What moves; a calibration is made on it.
        neck: What the rival takes it for.
        camera: The camera, as the rival takes it to be.
        constants: The rival's own, where they are to be others.

    Returns:
        The rival.
    """
    law: Callable[..., Rival] = RIVALS[name]
    if law in _OWN_DETECTOR:
        constants = {"least_share": 0.0} | constants
    if law is Frigate:
        constants = {"move_time": calibrate(robot_neck, camera)} | constants
    return law(neck, camera, **constants)


# A trial asks again for the same neck. Safe: what goes in and comes out does not change.
@lru_cache(maxsize=16)
def calibrate(neck: NeckSpec, camera: HeadCamera) -> MoveTime | None:
    """Let a camera make Frigate's thirty moves, and fit their times.

    Args:
        neck: What moves.
        camera: The camera on it; moves are in halves of its field of view.

    Returns:
        The fit; None if Frigate would not accept it.
    """
    law = FrigateCalibration(neck, camera)
    driven, now_s = driven_by(neck, law.command), 0.0
    motor = Motor(driven, np.zeros(2), lambda: now_s, seed=0)
    steps_per_answer = round(law.period_s * _RATE_HZ)
    for index in range(round(_PATIENCE_S * _RATE_HZ)):
        now_s = index / _RATE_HZ
        if index % steps_per_answer == 0:
            view = View(now_s, (), motor.reading(), lambda time_s: None, motor.idle)
            if index == 0:
                law.start(view)
            motor.ask(law.step(view))
            if law.finished:
                return law.move_time()
        motor.tick()
    return None
