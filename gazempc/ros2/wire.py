"""ROS 2 topics without a ROS installation: what rmw_zenoh puts on the wire, through the packages zenoh and rosbags.

A topic is the Zenoh key ``<domain>/<topic>/<pkg>::<msg>::dds_::<Type>_/<type hash>``; both sides of a topic must agree
on all of it. Messages are CDR with an attachment (sequence number, time, sender). A liveliness token for the node, and
one for each of its topics, makes them visible to ``ros2 node`` and ``ros2 topic``. See docs/design.md of rmw_zenoh.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

from gazempc.errors import MissingOptionalDependencyError, SettingsError

# What a person's poses come as.
PoseType = Literal["geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped"]
# What a direction of sound comes as: whole degrees, as of respeaker_ros, or radians.
SoundType = Literal["std_msgs/msg/Int32", "std_msgs/msg/Float32"]
# Who stamps with the time of a simulation, or with a clock that was never set, is off by far more than this; a sensor
# is never so late.
_STAMP_OFF_MAX_S = 5.0
# How plain CDR begins, big-endian and little-endian; older rosbags take others for one of these.
_PLAIN_CDR = (b"\0\0", b"\0\1")
# A definition that no standard store has.
_IDS_LIST = "std_msgs/Header header\nstring[] ids"
_NO_HASH = "TypeHashNotSupported"
_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_DOMAIN_MAX = 232


class WireError(ValueError):
    """A message cannot be used, or the network cannot be reached; gives the reason."""


@dataclass(frozen=True)
class Ros2Network:
    """Where the ROS 2 nodes are.

    Args:
        endpoint: Of the Zenoh router that all nodes of rmw_zenoh connect to (``ros2 run rmw_zenoh_cpp rmw_zenohd``).
        domain_id: As in ROS_DOMAIN_ID.
        humble: The nodes run ROS 2 Humble, which has no hashes of message types; their topics have other keys.

    Raises:
        SettingsError: If there can be no such endpoint or domain.
    """

    endpoint: str = "tcp/localhost:7447"
    domain_id: int = 0
    humble: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.domain_id <= _DOMAIN_MAX:
            raise SettingsError(f"ROS 2 domain {self.domain_id}: accepted are 0 to {_DOMAIN_MAX}")
        if not re.fullmatch(r"\w+/.+:\d+", self.endpoint):
            raise SettingsError(f"Zenoh endpoint {self.endpoint!r}: expected for example 'tcp/localhost:7447'")


def topic_name(name: str) -> str:
    """The full name of a topic, with the slash in front that may be left out.

    Raises:
        SettingsError: If ROS 2 allows no such name.
    """
    full = "/" + name.removeprefix("/")
    if not _TOPIC.fullmatch(full):
        raise SettingsError(f"topic {name!r}: expected letters, digits and _ between slashes, as '/head/command'")
    return full


@cache
def typestore() -> Any:
    """The definitions of messages.

    Raises:
        MissingOptionalDependencyError: If the extra `ros2` is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415
    except ImportError:
        raise MissingOptionalDependencyError("ROS 2", "rosbags", "ros2") from None
    # The messages used here are the same in Humble and all later releases.
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_IDS_LIST, "hri_msgs/msg/IdsList"))
    return store


def make_message(type_name: str, **fields: Any) -> Any:
    """A message such as ``make_message("builtin_interfaces/msg/Time", sec=1, nanosec=0)``; all fields must be given."""
    return typestore().types[type_name](**fields)


def encode(message: Any) -> bytes:
    """A message as CDR, little-endian, with its four bytes of header."""
    return bytes(typestore().serialize_cdr(message, message.__msgtype__, little_endian=True))


def decode(data: bytes, type_name: str) -> Any:
    """A message from CDR.

    Raises:
        WireError: If it is not a whole message of this type.
    """
    if bytes(data[:2]) not in _PLAIN_CDR:
        raise WireError(f"not a {type_name} in CDR: it begins with {data[:4].hex(' ') or 'nothing'}")
    try:
        return typestore().deserialize_cdr(data, type_name)
    except Exception as error:
        # Anything can come from a network, and the decoder was not made for that.
        raise WireError(f"not a {type_name} in CDR: {error}") from None


def stamp_s(stamp: Any) -> float:
    """The time of a message's header, seconds of ROS time.

    Args:
        stamp: A ``builtin_interfaces/msg/Time``.

    Raises:
        WireError: If it is not stamped.
    """
    if stamp.sec == 0 and stamp.nanosec == 0:
        raise WireError("its header has no time stamp")
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def stamp_to_loop_s(stamp: Any, to_loop_s: Callable[[float], float], now_s: float) -> float:
    """The time of a message's header on the loop's clock, seconds.

    Args:
        stamp: A ``builtin_interfaces/msg/Time``.
        to_loop_s: Converts Unix time to the loop's clock.
        now_s: Present time on the loop's clock, seconds.

    Raises:
        WireError: If it is not stamped, or so that the clocks cannot agree.
    """
    return on_loop_clock(stamp_s(stamp), to_loop_s, now_s)


def on_loop_clock(unix_s: float, to_loop_s: Callable[[float], float], now_s: float) -> float:
    """A stamp on the loop's clock, seconds.

    Args:
        unix_s: The stamp, seconds.
        to_loop_s: Converts Unix time to the loop's clock.
        now_s: Present time on the loop's clock, seconds.

    Raises:
        WireError: If the clocks cannot agree.
    """
    time_s = to_loop_s(unix_s)
    off_s = time_s - now_s
    if not abs(off_s) <= _STAMP_OFF_MAX_S:
        raise WireError(
            f"its time stamp is {off_s:+.1f} s from this computer's clock: set both clocks by NTP, and use_sim_time to "
            "false"
        )
    return time_s


def topic_key(domain_id: int, topic: str, type_name: str, humble: bool = False) -> str:
    """The Zenoh key of a topic.

    Args:
        domain_id: As in ROS_DOMAIN_ID.
        topic: Its full name.
        type_name: Such as ``std_msgs/msg/String``.
        humble: For ROS 2 Humble.
    """
    return f"{domain_id}{topic}/{dds_name(type_name)}/{type_hash(type_name, humble)}"


def attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """What goes with every message.

    Args:
        sequence: Counts the sender's messages, from 1.
        time_ns: When it was sent, Unix time in nanoseconds.
        gid: The sender, 16 bytes.
    """
    return struct.pack("<qqB", sequence, time_ns, len(gid)) + gid


def dds_name(type_name: str) -> str:
    """``pkg::msg::dds_::Type_``, as types are called on the wire."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def ros_name(on_the_wire: str) -> str:
    """``pkg/msg/Type`` of a type that is called so on the wire."""
    return on_the_wire.replace("::dds_::", "::").removesuffix("_").replace("::", "/")


def type_hash(type_name: str, humble: bool) -> str:
    """Hash of a type's definition (REP-2016); Humble has none."""
    return _NO_HASH if humble else str(typestore().hash_rihs01(type_name))
