"""Makes what listens to cues besides the source of observations, from the settings."""

from __future__ import annotations

import numpy as np

from gazempc.errors import SettingsError
from gazempc.live.clock import Clock, RealClock
from gazempc.live.settings import MountedSettings
from gazempc.live.sources.ros2_cues import Ros2Cues
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray
from predictors import HeadObservation


def make_telling(settings: MountedSettings, neck: NeckSpec, clock: Clock, mounted: bool) -> Ros2Cues | None:
    """Make what listens to the topics of cues.

    Args:
        settings: The settings.
        neck: The neck.
        clock: The loop's clock.
        mounted: Whether the mount says where the base frame of tf is; else that is the neck's own base frame.

    Returns:
        What listens; None where no topic is named.

    Raises:
        SettingsError: If settings do not go together.
    """
    ros2 = settings.options.ros2
    if ros2.point_topic is None and ros2.sound_topic is None:
        return None
    named = "options.ros2.point_topic" if ros2.point_topic is not None else "options.ros2.sound_topic"
    if not isinstance(clock, RealClock):
        raise SettingsError(f"{named}: ROS 2 keeps real time; accepted without --simulated-clock")
    if ros2.point_topic is not None and not settings.several:
        raise SettingsError(f"{named}: nobody is looked away from; accepted with attend, or look_away.rhythm told")
    if ros2.sound_topic is not None and settings.attend is None:
        raise SettingsError("options.ros2.sound_topic: there is nobody to choose; accepted with attend, as speaker")
    if ros2.base_frame is None and (ros2.point_topic is not None or ros2.sound_frame is not None):
        raise SettingsError(f"{named}: needs options.ros2.base_frame, the frame of tf that is the neck's base frame")
    if mounted and settings.mount.moves and ros2.base_frame is not None:
        raise SettingsError(
            f"mount.on {settings.mount.on}: {named} needs a base_frame that does not move with the neck; accepted: base"
        )

    def to_base(place_m: FloatArray) -> FloatArray:
        if not mounted:
            return place_m
        seen = settings.mount.in_sensor(HeadObservation(0.0, np.array(place_m)))
        return settings.mount.to_base(seen, neck.geometry, None).head_position_base_m

    return Ros2Cues(clock.now_s, clock.from_unix_s, ros2, to_base)
