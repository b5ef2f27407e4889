"""A person who stands before the robot and sways: looks away from them, and switches between two of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from ruckig import InputParameter, Ruckig, Trajectory

from gazempc.neck.spec import NeckSpec
from gazempc.people.company import Company
from gazempc.recordings.arrays import recording_from_arrays
from gazempc.results.contact import CONTACT_DEG
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg
from gazempc.settings import DEFAULT_PREDICTOR, AttentionSettings, LookAwayMode, LookAwaySettings
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import Scene, SceneSettings, make_scene

_RATE_HZ = 30.0
# Conversation is held at such a distance.
_AT_M = (2.5, 0.0, 0.3)
# Two people 20 to 77 deg apart; the second is wanted from this time on, and the run goes on for so long.
_TWO_M = (
    ((2.5, 0.45, 0.3), (2.5, -0.45, 0.3)),
    ((2.4, 1.0, 0.3), (2.6, -1.0, 0.3)),
    ((1.5, 1.2, 0.0), (1.5, -1.2, 0.5)),
)
_WANTED_FROM_S, _SWITCHING_S = 2.0, 6.0


class SecondLater:
    """A policy that wants the first person, and from a time on the second.

    Args:
        from_s: That time, seconds.
    """

    def __init__(self, from_s: float) -> None:
        self._from_s = from_s

    def reset(self) -> None:
        """See `gazempc.people.company.AttentionPolicy.reset`."""

    def scores(self, company: Company) -> list[float]:
        """See `gazempc.people.company.AttentionPolicy.scores`."""
        wanted = 1 + (company.time_s >= self._from_s)
        return [float(person.number == wanted) for person in company.people]


def talk(controller: str, rhythm: LookAwayMode, seconds: float, neck: str) -> Log:
    """A person stands, and the robot looks away now and then.

    Args:
        controller: Name of the controller.
        rhythm: When it looks away.
        seconds: For how long.
        neck: Name of the neck.

    Returns:
        The log.
    """
    settings = ReplaySettings(look_away=LookAwaySettings(rhythm=rhythm))
    return replay_scene(_scene(neck, seconds, _AT_M), controller, DEFAULT_PREDICTOR, settings).log


def switches(controller: str, seeds: int, neck: str) -> list[tuple[Log, float]]:
    """Two people stand, and the second is looked at later.

    Args:
        controller: Name of the controller.
        seeds: Of the sensor's errors; how many for each pair of places.
        neck: Name of the neck.

    Returns:
        For each run its log, and the least time in which its neck could be in contact after the switch, seconds.
    """
    settings = ReplaySettings(
        attend=f"{__name__}:{SecondLater.__name__}",
        options={"from_s": _WANTED_FROM_S},
        attention=AttentionSettings(dwell_s=1.0),
    )
    found = []
    for places_m in _TWO_M:
        scene = _scene(neck, _SWITCHING_S, *places_m)
        for seed in range(seeds):
            log = replay_scene(replace(scene, seed=seed), controller, DEFAULT_PREDICTOR, settings).log
            switched = int(np.searchsorted(log.time_s, log.attended_time_s[-1]))
            found.append((log, least_time_s(log.neck, float(gaze_error_deg(log)[switched]))))
    return found


def least_time_s(neck: NeckSpec, angle_deg: float) -> float:
    """The least time until a pan from rest is in contact: the fastest motion that the limits allow, dead time and lag.

    Args:
        neck: The neck.
        angle_deg: How far off the person is, degrees.

    Returns:
        Seconds.
    """
    asked, limits = InputParameter(1), neck.command_limits
    angle_rad = float(np.deg2rad(angle_deg))
    asked.current_position, asked.target_position = [0.0], [angle_rad]
    asked.max_velocity = [float(limits.velocity_max_rad_s[0])]
    asked.max_acceleration = [float(limits.acceleration_max_rad_s2[0])]
    asked.max_jerk = [float(limits.jerk_max_rad_s3[0])]
    motion = Trajectory(1)
    Ruckig(1).calculate(asked, motion)
    times_s = np.linspace(0.0, motion.duration, 1000)
    left_rad = np.array([angle_rad - motion.at_time(time_s)[0][0] for time_s in times_s])
    moving_s = float(times_s[left_rad <= np.deg2rad(CONTACT_DEG[0])][0])
    return moving_s + float(neck.dead_time_s[0] + neck.servo_lag_s[0])


def _scene(neck: str, seconds: float, *places_m: tuple[float, float, float]) -> Scene:
    times_s = np.arange(0.0, seconds, 1.0 / _RATE_HZ)
    sway_m = np.column_stack([0.02 * np.sin(0.8 * times_s), 0.03 * np.sin(1.3 * times_s), 0.01 * np.sin(1.1 * times_s)])
    settings = SceneSettings(neck=neck, sensor="reference", placement="recorded")
    walks = [
        recording_from_arrays(f"standing{k}", times_s, np.array(at_m) + sway_m, in_base_frame=True)
        for k, at_m in enumerate(places_m)
    ]
    people = [make_scene(walk, settings) for walk in walks]
    return replace(people[0], others=tuple(each.walk for each in people[1:]))
