"""Names, types and stamps of ROS 2 messages, without imports of ROS."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, Literal

from gazempc.errors import SettingsError

# Message types of heads.
PoseType = Literal[
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PointStamped",
    "geometry_msgs/msg/PoseArray",
    "vision_msgs/msg/Detection3DArray",
]
_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")


class Ros2Error(ValueError):
    """An invalid message, or ROS 2 is unreachable; the message states the reason."""


class FrameError(Ros2Error):
    """The tree of tf lacks a frame at a time, possibly only for now."""


def topic_name(name: str) -> str:
    """The full name of a topic, with the optional leading slash.

    Raises:
        SettingsError: If the name is invalid in ROS 2.
    """
    full = "/" + name.removeprefix("/")
    if not _TOPIC.fullmatch(full):
        raise SettingsError(f"topic {name!r}: expected letters, digits and _ between slashes, such as '/head/command'")
    return full


def stamp_s(stamp: Any) -> float:
    """The time of a message's header, seconds of ROS time.

    Args:
        stamp: A ``builtin_interfaces/msg/Time``.

    Raises:
        Ros2Error: If it has no stamp.
    """
    if stamp.sec == 0 and stamp.nanosec == 0:
        raise Ros2Error("its header has no time stamp")
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def on_loop_clock(unix_s: float, to_loop_s: Callable[[float], float], now_s: float) -> float:
    """A stamp on the loop's clock, seconds.

    Args:
        unix_s: The stamp, seconds.
        to_loop_s: Converts Unix time to the loop's clock.
        now_s: Present time on the loop's clock, seconds.

    Raises:
        Ros2Error: If the clocks cannot agree.
    """
    time_s = to_loop_s(unix_s)
    off_s = time_s - now_s
    # Above any sensor's latency, far below the offset of simulated or unset clocks.
    if not abs(off_s) <= 5.0:
        raise Ros2Error(
            f"its time stamp is {off_s:+.1f} s from this computer's clock: set both clocks by NTP; with a simulator "
            "set options.ros2.use_sim_time"
        )
    return time_s
