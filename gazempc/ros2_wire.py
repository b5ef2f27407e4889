"""ROS 2 topics without a ROS installation: what rmw_zenoh puts on the wire, through the packages zenoh and rosbags.

A topic is the Zenoh key ``<domain>/<topic>/<pkg>::<msg>::dds_::<Type>_/<type hash>``; both sides of a topic must agree
on all of it. Messages are CDR with an attachment (sequence number, time, sender). A liveliness token for the node, and
one for each of its topics, makes them visible to ``ros2 node`` and ``ros2 topic``. See docs/design.md of rmw_zenoh.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from gazempc.errors import MissingOptionalDependencyError, SettingsError

# Who stamps with the time of a simulation, or with a clock that was never set, is off by far more than this; a sensor
# is never so late.
_STAMP_OFF_MAX_S = 5.0
# The newest count; a message that has waited for so many others to be read is out of date.
_WAITING_MAX = 256
# A client of Zenoh waits so long before it tries the router again.
_RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2.0}
_ASK_S = 1.0
# In the notation of rmw_zenoh: reliable, volatile, the last 10 kept; what is empty is the default.
_QOS = "::,10:,:,:,,"
# How plain CDR begins, big-endian and little-endian; older rosbags take others for one of these.
_PLAIN_CDR = (b"\0\0", b"\0\1")
_NO_HASH = "TypeHashNotSupported"
_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_NODE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_DOMAIN_MAX = 232


class WireError(ValueError):
    """A message cannot be used, or the network cannot be reached; says why."""


@dataclass(frozen=True)
class Ros2Network:
    """Where the ROS 2 nodes are.

    Args:
        endpoint: Of the Zenoh router that all nodes of rmw_zenoh connect to (``ros2 run rmw_zenoh_cpp rmw_zenohd``).
        domain_id: As in ROS_DOMAIN_ID.
        humble: The nodes run ROS 2 Humble, which knows no hashes of message types; their topics have other keys.

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
def _typestore() -> Any:
    try:
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        raise MissingOptionalDependencyError("ROS 2", "rosbags", "ros2") from None
    # The messages used here are the same in Humble and all later releases.
    return get_typestore(Stores.ROS2_HUMBLE)


def make_message(type_name: str, **fields: Any) -> Any:
    """A message such as ``make_message("builtin_interfaces/msg/Time", sec=1, nanosec=0)``; all fields must be given."""
    return _typestore().types[type_name](**fields)


def encode(message: Any) -> bytes:
    """A message as CDR, little-endian, with its four bytes of header."""
    return bytes(_typestore().serialize_cdr(message, message.__msgtype__, little_endian=True))


def decode(data: bytes, type_name: str) -> Any:
    """A message from CDR.

    Raises:
        WireError: If it is not a whole message of this type.
    """
    if bytes(data[:2]) not in _PLAIN_CDR:
        raise WireError(f"not a {type_name} in CDR: it begins with {data[:4].hex(' ') or 'nothing'}")
    try:
        return _typestore().deserialize_cdr(data, type_name)
    except Exception as error:
        # Anything can come from a network, and the decoder was not made for that.
        raise WireError(f"not a {type_name} in CDR: {error}") from None


def stamp_to_loop_s(stamp: Any, to_loop_s: Callable[[float], float], now_s: float) -> float:
    """The time of a message's header on the loop's clock, seconds.

    Args:
        stamp: A ``builtin_interfaces/msg/Time``.
        to_loop_s: Converts Unix time to the loop's clock.
        now_s: Present time on the loop's clock, seconds.

    Raises:
        WireError: If it is not stamped, or so that the clocks cannot agree.
    """
    if stamp.sec == 0 and stamp.nanosec == 0:
        raise WireError("its header has no time stamp")
    time_s = to_loop_s(stamp.sec + 1e-9 * stamp.nanosec)
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
    return f"{domain_id}{topic}/{_dds_name(type_name)}/{_type_hash(type_name, humble)}"


def attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """What goes with every message.

    Args:
        sequence: Counts the sender's messages, from 1.
        time_ns: When it was sent, Unix time in nanoseconds.
        gid: The sender, 16 bytes.
    """
    return struct.pack("<qqB", sequence, time_ns, len(gid)) + gid


def _dds_name(type_name: str) -> str:
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def _ros_name(dds_name: str) -> str:
    return dds_name.replace("::dds_::", "::").removesuffix("_").replace("::", "/")


def _type_hash(type_name: str, humble: bool) -> str:
    return _NO_HASH if humble else str(_typestore().hash_rihs01(type_name))


@contextlib.contextmanager
def _wire_errors() -> Iterator[None]:
    """Whatever Zenoh raises becomes a WireError; the end of its text, where in its source it was raised, is cut off."""
    try:
        yield
    except Exception as error:
        raise WireError(str(error).split(" at /")[0].strip()) from None


class Publication:
    """A topic that is sent on; made by `Ros2Node`."""

    def __init__(self, publisher: Any, token: str) -> None:
        self._publisher = publisher
        # rmw_zenoh takes another hash of the token; to whoever listens it is only a name that no other sender has.
        self._gid = hashlib.blake2b(token.encode(), digest_size=16).digest()
        self._sequence = 0

    @property
    def has_listeners(self) -> bool:
        """Whether anybody subscribes to this topic with this type."""
        return bool(self._publisher.matching_status.matching)

    def publish(self, message: Any) -> None:
        """Send a message; does not wait until it has arrived.

        Raises:
            WireError: If it cannot be sent.
        """
        self._sequence += 1
        with _wire_errors():
            self._publisher.put(encode(message), attachment=attachment(self._sequence, time.time_ns(), self._gid))


class Subscription:
    """A topic that is listened to; made by `Ros2Node`."""

    def __init__(self, subscriber: Any, type_name: str) -> None:
        self._subscriber = subscriber
        self._type_name = type_name

    def take(self) -> list[Any | WireError]:
        """The messages that have come since the last call, oldest first; for a broken one what is wrong with it.

        Raises:
            WireError: If the session is closed.
        """
        taken: list[Any | WireError] = []
        for _ in range(_WAITING_MAX):
            with _wire_errors():
                sample = self._subscriber.try_recv()
            if sample is None:
                break
            try:
                taken.append(decode(sample.payload.to_bytes(), self._type_name))
            except WireError as error:
                taken.append(error)
        return taken


class Ros2Node:
    """A node in the graph of ROS 2, with a Zenoh session of its own.

    It is a client of the router, which passes everything on: that works from any computer that reaches the router.
    When the router goes, Zenoh's own threads try to reach it again, about once a second, and put everything back.

    Args:
        name: The node's name.
        network: Where the other nodes are.

    Raises:
        SettingsError: If ROS 2 allows no such name.
        MissingOptionalDependencyError: If the extra `ros2` is not installed.
        WireError: If no router answers.
    """

    def __init__(self, name: str, network: Ros2Network) -> None:
        if not _NODE.fullmatch(name):
            raise SettingsError(f"node {name!r}: expected letters, digits and _")
        try:
            import zenoh  # noqa: PLC0415
        except ImportError:
            raise MissingOptionalDependencyError("ROS 2", "eclipse-zenoh", "ros2") from None
        _typestore()
        self._zenoh: Any = zenoh
        self._name, self._network = name, network
        config: Any = zenoh.Config()
        for key, value in {
            "mode": "client",
            "connect/endpoints": [network.endpoint],
            "connect/retry": _RETRY,
            "scouting/multicast/enabled": False,
        }.items():
            with _wire_errors():
                config.insert_json5(key, json.dumps(value))
        try:
            self._session: Any = zenoh.open(config)
        except Exception:
            raise WireError(
                f"no Zenoh router answers at {network.endpoint}: start one (ros2 run rmw_zenoh_cpp rmw_zenohd), and "
                "check address and firewall"
            ) from None
        self._tokens: list[Any] = []
        self._declare(f"NN/%/%/{name}")

    @property
    def connected(self) -> bool:
        """Whether there is a connection at present."""
        info = self._session.info
        return bool(info.routers_zid() or info.peers_zid())

    def publication(self, topic: str, type_name: str) -> Publication:
        """Announce a topic to send on.

        Args:
            topic: Its full name.
            type_name: Such as ``std_msgs/msg/String``.
        """
        # Late commands are worth nothing: no waiting for others in a batch; a network that is stuck loses them.
        with _wire_errors():
            publisher = self._session.declare_publisher(
                topic_key(self._network.domain_id, topic, type_name, self._network.humble),
                congestion_control=self._zenoh.CongestionControl.DROP,
                express=True,
            )
        return Publication(publisher, self._declare_topic("MP", topic, type_name))

    def subscription(self, topic: str, type_name: str) -> Subscription:
        """Announce a topic to listen to; see `publication` for the arguments."""
        # A ring buffer inside Zenoh: no thread of Python's runs, and nothing is left but the newest messages.
        with _wire_errors():
            subscriber = self._session.declare_subscriber(
                topic_key(self._network.domain_id, topic, type_name, self._network.humble),
                self._zenoh.handlers.RingChannel(_WAITING_MAX),
            )
        self._declare_topic("MS", topic, type_name)
        return Subscription(subscriber, type_name)

    def why_nobody(self, kind: str, topic: str, type_name: str) -> str:
        """Why this topic finds no other side, for people to read; takes up to a second.

        Args:
            kind: Of the other side: "MS" if it should listen, "MP" if it should send.
            topic: Full name of the topic.
            type_name: What is sent or expected here.
        """
        does = "listens to" if kind == "MS" else "sends on"
        found = set()
        with contextlib.suppress(Exception):
            key = f"@ros2_lv/*/*/*/*/{kind}/*/*/*/{topic.replace('/', '%')}/*/*/*"
            for reply in self._session.liveliness().get(key, timeout=_ASK_S):
                parts = str(reply.ok.key_expr).split("/")
                found.add((parts[1], _ros_name(parts[10]), parts[11]))
        here = (str(self._network.domain_id), type_name, _type_hash(type_name, self._network.humble))
        if not found or here in found:
            return f"nobody {does} {topic} as {type_name} in ROS 2 domain {here[0]}: is that node or controller active?"
        others = "; ".join(f"{name} in domain {domain} ({digest[:14]})" for domain, name, digest in sorted(found))
        return (
            f"nobody {does} {topic} as {type_name} in domain {here[0]} ({here[2][:14]}), but there is {others}: check "
            "type, domain and, for ROS 2 Humble, the option for it"
        )

    def close(self) -> None:
        """Leave the graph; never raises."""
        with contextlib.suppress(Exception):
            self._session.close()

    def _declare_topic(self, kind: str, topic: str, type_name: str) -> str:
        mangled = topic.replace("/", "%")
        type_hash = _type_hash(type_name, self._network.humble)
        return self._declare(f"{kind}/%/%/{self._name}/{mangled}/{_dds_name(type_name)}/{type_hash}/{_QOS}")

    def _declare(self, entity: str) -> str:
        token = f"@ros2_lv/{self._network.domain_id}/{self._session.zid()}/0/{len(self._tokens)}/{entity}"
        # It stands for as long as it is referred to.
        with _wire_errors():
            self._tokens.append(self._session.liveliness().declare_token(token))
        return token
