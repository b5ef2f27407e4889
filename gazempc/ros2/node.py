"""A node in the graph of ROS 2 over Zenoh, as rmw_zenoh has them, with its publications and subscriptions."""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import time
from collections.abc import Iterator
from typing import Any

from gazempc.errors import MissingOptionalDependencyError, SettingsError
from gazempc.ros2.wire import (
    Ros2Network,
    WireError,
    attachment,
    dds_name,
    decode,
    encode,
    ros_name,
    topic_key,
    type_hash,
    typestore,
)

# The newest count; a message that has waited for so many others to be read is out of date.
WAITING_MAX = 256


@contextlib.contextmanager
def wire_errors() -> Iterator[None]:
    """Whatever Zenoh raises becomes a WireError; the end of its text, where in its source it was raised, is cut off."""
    try:
        yield
    except Exception as error:
        raise WireError(str(error).split(" at /")[0].strip()) from None


class Publication:
    """A topic that is sent on; made by `Ros2Node`."""

    def __init__(self, publisher: Any, token: str) -> None:
        self._publisher = publisher
        # rmw_zenoh takes another hash of the token; to listeners it is only a unique name.
        self._gid = hashlib.blake2b(token.encode(), digest_size=16).digest()
        self._sequence = 0

    @property
    def has_listeners(self) -> bool:
        """Whether there is a subscriber of this type; only of a topic that is not latched."""
        return bool(self._publisher.matching_status.matching)

    def publish(self, message: Any) -> None:
        """Send a message; does not wait until it has arrived.

        Raises:
            WireError: If it cannot be sent.
        """
        self._sequence += 1
        with wire_errors():
            self._publisher.put(encode(message), attachment=attachment(self._sequence, time.time_ns(), self._gid))


class Subscription:
    """A topic that is listened to; made by `Ros2Node`.

    Args:
        subscriber: Of Zenoh.
        type_name: Of its messages.
        digest: Hash of this type.
        announced: Subscriber to the announcements of senders on this topic; None for several topics.

    Attributes:
        type_name: Of its messages.
    """

    def __init__(self, subscriber: Any, type_name: str, digest: str, announced: Any) -> None:
        self._subscriber = subscriber
        self.type_name = type_name
        self._digest = digest
        self._announced = announced
        # Type and its hash of each.
        self._senders: dict[str, tuple[str, str]] = {}
        self._heard = False

    def take(self) -> list[Any | WireError]:
        """The messages that have come since the last call, oldest first; for a broken one what is wrong with it.

        Raises:
            WireError: If the session is closed.
        """
        return [message for _, message in self.take_named()]

    def take_named(self) -> list[tuple[str, Any | WireError]]:
        """The same as `take`, each message with the name of its topic, for a subscription to several."""
        taken: list[tuple[str, Any | WireError]] = []
        for _ in range(WAITING_MAX):
            with wire_errors():
                sample = self._subscriber.try_recv()
            if sample is None:
                break
            # Between the domain, and type and hash.
            self._heard = True
            topic = "/" + "/".join(str(sample.key_expr).split("/")[1:-2])
            try:
                taken.append((topic, decode(sample.payload.to_bytes(), self.type_name)))
            except WireError as error:
                taken.append((topic, error))
        return taken

    @property
    def has_senders(self) -> bool:
        """Whether a node announces to send on this topic with this type, or did send without an announcement."""
        self._listen_to_senders()
        return self._heard or (self.type_name, self._digest) in self._senders.values()

    @property
    def described(self) -> str:
        """The type, and types with which others send on this topic, so that nothing arrives."""
        self._listen_to_senders()
        others = {sent for sent in self._senders.values() if sent != (self.type_name, self._digest)}
        names = sorted(name if name != self.type_name else f"another {name}" for name, _ in others)
        return self.type_name + (f", but others send {' and '.join(names)}" if names else "")

    def _listen_to_senders(self) -> None:
        with contextlib.suppress(Exception):
            while self._announced is not None and (sample := self._announced.try_recv()) is not None:
                # From now on only announcements count.
                self._heard = False
                entity = str(sample.key_expr)
                if sample.kind == sample.kind.PUT:
                    type_name, digest = entity.split("/")[10:12]
                    self._senders[entity] = ros_name(type_name), digest
                else:
                    self._senders.pop(entity, None)


# A client of Zenoh waits so long before it tries the router again.
_RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2.0}
_ASK_S = 1.0
# In the notation of rmw_zenoh: reliable, volatile or transient local, the last 10 kept; what is empty is the default.
_QOS, _QOS_LATCHED = "::,10:,:,:,,", ":1:,10:,:,:,,"
# Stands for one part of a topic's name.
_ANY = "*"
_NODE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


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
            import zenoh.ext  # noqa: PLC0415
        except ImportError:
            raise MissingOptionalDependencyError("ROS 2", "eclipse-zenoh", "ros2") from None
        typestore()
        self._zenoh: Any = zenoh
        self._name, self._network = name, network
        config: Any = zenoh.Config()
        for key, value in {
            "mode": "client",
            "connect/endpoints": [network.endpoint],
            "connect/retry": _RETRY,
            "scouting/multicast/enabled": False,
            # What is kept for later listeners is told apart by it.
            "timestamping/enabled": True,
        }.items():
            with wire_errors():
                config.insert_json5(key, json.dumps(value))
        try:
            self._session: Any = zenoh.open(config)
        except Exception:
            raise WireError(
                f"no Zenoh router answers at {network.endpoint}: start one (ros2 run rmw_zenoh_cpp rmw_zenohd), and "
                "check address and firewall"
            ) from None
        self._was_connected = True
        self._tokens: list[Any] = []
        self._declare(f"NN/%/%/{name}")

    def lost_router(self) -> str:
        """What is to be said if the router has gone since the last call; empty if it has not."""
        before, self._was_connected = self._was_connected, self.connected
        if not before or self._was_connected:
            return ""
        return f"the Zenoh router at {self._network.endpoint} has gone; trying to reach it again"

    @property
    def connected(self) -> bool:
        """Whether there is a connection at present."""
        info = self._session.info
        return bool(info.routers_zid() or info.peers_zid())

    def publication(self, topic: str, type_name: str, latched: bool = False) -> Publication:
        """Announce a topic to send on.

        Args:
            topic: Its full name.
            type_name: Such as ``std_msgs/msg/String``.
            latched: Keep the last message for later subscribers (transient local).
        """
        key = topic_key(self._network.domain_id, topic, type_name, self._network.humble)
        # Late commands are worth nothing: no waiting for others in a batch; a network that is stuck loses them.
        sent: dict[str, Any] = {"congestion_control": self._zenoh.CongestionControl.DROP, "express": True}
        with wire_errors():
            if latched:
                cache = self._zenoh.ext.CacheConfig(1)
                publisher = self._zenoh.ext.declare_advanced_publisher(
                    self._session, key, cache=cache, publisher_detection=True, **sent
                )
            else:
                publisher = self._session.declare_publisher(key, **sent)
        return Publication(publisher, self._declare_topic("MP", topic, type_name, _QOS_LATCHED if latched else _QOS))

    def subscription(self, topic: str, type_name: str, latched: bool = False) -> Subscription:
        """Announce a topic to listen to.

        Args:
            topic: Its full name; with ``*`` for one part of it, all topics of such names.
            type_name: Such as ``std_msgs/msg/String``.
            latched: Ask senders for what they sent last before, where they keep it (transient local).
        """
        key = topic_key(self._network.domain_id, topic, type_name, self._network.humble)
        # A ring buffer inside Zenoh: no thread of Python's runs, and nothing is left but the newest messages.
        ring = self._zenoh.handlers.RingChannel
        with wire_errors():
            if latched:
                history = self._zenoh.ext.HistoryConfig(detect_late_publishers=True)
                subscriber = self._zenoh.ext.declare_advanced_subscriber(
                    self._session, key, ring(WAITING_MAX), history=history, subscriber_detection=True
                )
            else:
                subscriber = self._session.declare_subscriber(key, ring(WAITING_MAX))
            announced = None
            if _ANY not in topic:
                sent = f"@ros2_lv/{self._network.domain_id}/*/*/*/MP/*/*/*/{topic.replace('/', '%')}/*/*/*"
                announced = self._session.liveliness().declare_subscriber(sent, ring(WAITING_MAX), history=True)
        if _ANY not in topic:
            # Who listens to topics by a pattern has no entry in the graph.
            self._declare_topic("MS", topic, type_name, _QOS_LATCHED if latched else _QOS)
        return Subscription(subscriber, type_name, type_hash(type_name, self._network.humble), announced)

    def why_no_match(self, kind: str, topic: str, type_name: str) -> str:
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
                found.add((parts[1], ros_name(parts[10]), parts[11]))
        here = (str(self._network.domain_id), type_name, type_hash(type_name, self._network.humble))
        if not found or here in found:
            return f"no node {does} {topic} as {type_name} in ROS 2 domain {here[0]}: is it active?"
        others = "; ".join(f"{name} in domain {domain} ({digest[:14]})" for domain, name, digest in sorted(found))
        return (
            f"no node {does} {topic} as {type_name} in domain {here[0]} ({here[2][:14]}), but there is {others}: check "
            "type, domain and, for ROS 2 Humble, the option for it"
        )

    def close(self) -> None:
        """Leave the graph; never raises."""
        with contextlib.suppress(Exception):
            self._session.close()

    def _declare_topic(self, kind: str, topic: str, type_name: str, qos: str = _QOS) -> str:
        mangled = topic.replace("/", "%")
        digest = type_hash(type_name, self._network.humble)
        return self._declare(f"{kind}/%/%/{self._name}/{mangled}/{dds_name(type_name)}/{digest}/{qos}")

    def _declare(self, entity: str) -> str:
        token = f"@ros2_lv/{self._network.domain_id}/{self._session.zid()}/0/{len(self._tokens)}/{entity}"
        # It stands for as long as it is referred to.
        with wire_errors():
            self._tokens.append(self._session.liveliness().declare_token(token))
        return token
