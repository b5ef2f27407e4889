"""Topics that nobody sends on."""

from __future__ import annotations

from collections.abc import Mapping

from gazempc.live.sources.source import Notice
from gazempc.loop.events import Event
from gazempc.ros2.topics import Subscription

# Nodes find each other within less.
_PATIENCE_S = 3.0


class DeadTopics:
    """Finds out on which topics nobody sends, from the start on or since their sender has gone.

    A topic on which nothing comes is not dead: somebody may be silent.

    Args:
        topics: What is listened to, by the name of the topic.
        now_s: The time, seconds.
    """

    def __init__(self, topics: Mapping[str, Subscription], now_s: float) -> None:
        self._topics = dict(topics)
        self._due_s = now_s + _PATIENCE_S
        self._dead: set[str] = set()

    def notices(self, now_s: float) -> tuple[Notice, ...]:
        """What is to be said now.

        Args:
            now_s: The time, seconds.

        Returns:
            A notice for the topics that are newly dead, if there are any.
        """
        if now_s < self._due_s:
            return ()
        self._due_s = now_s + _PATIENCE_S
        dead = {name for name, topic in self._topics.items() if not topic.has_senders}
        newly, self._dead = sorted(dead - self._dead), dead
        if not newly:
            return ()
        named = ", ".join(map(self._named, newly))
        return (Notice(Event.NO_SENDER, f"nobody sends on {named}: is that node active, in this domain?", 0),)

    def _named(self, name: str) -> str:
        others = self._topics[name].other_types
        but = f", but somebody does as {' and '.join(others)}" if others else ""
        return f"{name} as {self._topics[name].type_name}{but}"
