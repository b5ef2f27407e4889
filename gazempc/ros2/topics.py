"""Topics of ROS 2 that are sent on or listened to."""

from __future__ import annotations

import contextlib
import hashlib
import time
from collections.abc import Iterator
from typing import Any

from gazempc.ros2.wire import WireError, attachment, decode, encode, ros_name

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
        # rmw_zenoh takes another hash of the token; to whoever listens it is only a name that no other sender has.
        self._gid = hashlib.blake2b(token.encode(), digest_size=16).digest()
        self._sequence = 0

    @property
    def has_listeners(self) -> bool:
        """Whether anybody subscribes to this topic with this type; only of one that is not latched."""
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
        announced: Subscriber to what senders on this topic say of themselves; None for several topics.

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
        """Whether any node says that it sends on this topic with this type, or did send without a word of that."""
        self._listen_to_senders()
        return self._heard or (self.type_name, self._digest) in self._senders.values()

    @property
    def other_types(self) -> tuple[str, ...]:
        """Types with which others send on this topic, so that nothing arrives."""
        self._listen_to_senders()
        others = {sent for sent in self._senders.values() if sent != (self.type_name, self._digest)}
        return tuple(sorted(name if name != self.type_name else f"another {name}" for name, _ in others))

    def _listen_to_senders(self) -> None:
        with contextlib.suppress(Exception):
            while self._announced is not None and (sample := self._announced.try_recv()) is not None:
                # From now on what senders say of themselves is all that counts.
                self._heard = False
                entity = str(sample.key_expr)
                if sample.kind == sample.kind.PUT:
                    type_name, digest = entity.split("/")[10:12]
                    self._senders[entity] = ros_name(type_name), digest
                else:
                    self._senders.pop(entity, None)
