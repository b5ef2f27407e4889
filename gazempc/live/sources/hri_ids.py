"""Who is tracked, by the lists of ROS4HRI, and which face and body are whose."""

from __future__ import annotations

from typing import Literal

from gazempc.ros2.node import Ros2Node
from gazempc.ros2.wire import WireError

Kind = Literal["face", "head", "body"]
KINDS: tuple[Kind, ...] = ("face", "head", "body")
_LISTS = {"face": "/humans/faces/tracked", "body": "/humans/bodies/tracked", "person": "/humans/persons/tracked"}
_MATCHES = {"face": "/humans/persons/*/face_id", "body": "/humans/persons/*/body_id"}
# Heads of skeletons are named by the body.
_PART = {"face": "face", "head": "body", "body": "body"}


class HriIds:
    """Keeps the lists and matches of a ROS4HRI person manager and its trackers.

    Args:
        node: Listens.
    """

    def __init__(self, node: Ros2Node) -> None:
        self._lists = {
            part: node.subscription(topic, "hri_msgs/msg/IdsList", latched=True) for part, topic in _LISTS.items()
        }
        self._matches = {
            part: node.subscription(topic, "std_msgs/msg/String", latched=True) for part, topic in _MATCHES.items()
        }
        self._listed: dict[str, frozenset[str]] = {}
        # By part and person.
        self._part_of: dict[tuple[str, str], str] = {}

    def listen(self) -> list[str]:
        """Take in what has come.

        Returns:
            What could not be used, and why.

        Raises:
            WireError: If the session is closed.
        """
        problems: list[str] = []
        for part, listed in self._lists.items():
            for message in listed.take():
                if isinstance(message, WireError):
                    problems.append(f"{_LISTS[part]}: {message}")
                else:
                    self._list(part, frozenset(message.ids))
        for part, matches in self._matches.items():
            for topic, message in matches.take_named():
                if isinstance(message, WireError):
                    problems.append(f"{topic}: {message}")
                else:
                    # No name is how a person manager says that they have none any more.
                    self._part_of[part, topic.split("/")[3]] = message.data
        return problems

    def is_tracked(self, kind: Kind, part_id: str) -> bool:
        """Whether somebody is tracked. Some trackers go on sending the last pose of a face that they lost.

        Args:
            kind: What is seen of them.
            part_id: The tracker's name of that.

        Returns:
            Whether they are in the list. A face counts before the first list, too; a robot has heads and bodies itself.
        """
        part = _PART[kind]
        return (kind == "face" or part in self._listed) and self._is_listed(part, part_id)

    def person(self, kind: Kind, part_id: str) -> str | None:
        """Whose face or body something is.

        Args:
            kind: What is seen of them.
            part_id: The tracker's name of that.

        Returns:
            Name of the person; None while nobody has said, or that person is not tracked any more.
        """
        part = _PART[kind]
        found = (who for (of, who), its_id in self._part_of.items() if (of, its_id) == (part, part_id))
        return next((who for who in found if self._is_listed("person", who)), None)

    def _list(self, part: str, ids: frozenset[str]) -> None:
        if part == "person":
            # A match may come before the list that names the person, but not after one that does not any more.
            gone = self._listed.get(part, frozenset()) - ids
            self._part_of = {key: its_id for key, its_id in self._part_of.items() if key[1] not in gone}
        self._listed[part] = ids

    def _is_listed(self, part: str, its_id: str) -> bool:
        return part not in self._listed or its_id in self._listed[part]
