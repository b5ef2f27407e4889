"""ROS 2 bags: who is in them, and each person's track in the frame of the sensor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from gazempc.errors import RecordingError
from gazempc.recordings.readers.bag_axes import forward
from gazempc.recordings.readers.bag_frames import FrameTree
from gazempc.recordings.readers.bag_messages import FACES, TF, read_messages
from gazempc.recordings.readers.bag_people import FIXED_FRAMES, PREFIXES, Sighted, people
from gazempc.types import FloatArray

_EXPECTED = (
    f"frames named {', '.join(f'{prefix}<id>' for prefix in PREFIXES)} in {TF}, as in ROS4HRI, or a topic of poses or "
    "points"
)


@dataclass(frozen=True)
class BagTrack:
    """One person over time, in the frame of the sensor.

    Attributes:
        frame_id: Name of the person's frame, such as ``face_23ed9``, or the topic.
        parent_id: Frame of the sensor that it is given in.
        optical: Whether that frame had optical axes, which were turned.
        times_s: Stamps, shape (N,), seconds, strictly increasing.
        delays_s: From the stamp to the message's arrival in the bag, shape (N,), seconds.
        position_m: Shape (N, 3), metres, in the sensor's frame, x forward, y left, z up.
        quat_wxyz: Orientation of the person's frame in that frame, shape (N, 4); NaN where not known.
        repeated: Messages with a stamp that had been there already; left out.
        unusable: Messages with a number that is not finite, or no orientation; left out.
    """

    frame_id: str
    parent_id: str
    optical: bool
    times_s: FloatArray
    delays_s: FloatArray
    position_m: FloatArray
    quat_wxyz: FloatArray
    repeated: int
    unusable: int


@dataclass(frozen=True)
class Bag:
    """What is in a bag.

    Attributes:
        path: Its folder.
        topics: Type of each topic.
        frames: FrameTree over time.
        people: What may be a person's head, the likeliest and longest first; at least one.
    """

    path: Path
    topics: Mapping[str, str]
    frames: FrameTree
    people: list[Sighted]


def read_bag_tracks(path: Path, tell: Callable[[float], None] = lambda share: None) -> tuple[BagTrack, ...]:
    """Read the tracks of people in a bag.

    Args:
        path: Folder of the bag.
        tell: Called with the share that is read, 0 to 1.

    Returns:
        A track for each person, the longest first. Where there are faces, heads, bodies and persons are not taken, and
        topics only where there are no such frames.

    Raises:
        RecordingError: If the folder is no bag, or has no person in it.
        MissingOptionalDependencyError: If rosbags is not installed.
    """
    bag = open_bag(path, tell)
    sensed = [seen for seen in bag.people if seen.frame not in FIXED_FRAMES]
    if not sensed:
        found = ", ".join(f"{seen.name} in {seen.frame}" for seen in bag.people)
        raise RecordingError(
            path,
            f"topic {TF}",
            f"no person is given in the frame of a sensor; found {found}",
            "face_<id> in a camera's frame",
        )
    return tuple(_track(seen) for seen in sensed if seen.rank[0] == sensed[0].rank[0])


def open_bag(path: Path, tell: Callable[[float], None] = lambda share: None) -> Bag:
    """Read a bag.

    Args:
        path: Folder of the bag, or a file of it.
        tell: Called with the share that is read, 0 to 1.

    Returns:
        What is in it.

    Raises:
        RecordingError: If this is no bag, or has no person in it.
        MissingOptionalDependencyError: If rosbags is not installed.
    """
    topics, messages = read_messages(path, tell)
    frames = FrameTree(messages)
    bag = Bag(path, topics, frames, people(frames, topics, messages))
    if bag.people:
        return bag
    tracked = sorted({name for message in messages if message.topic == FACES for name in message.content.ids})
    problem = f"no frame of a person; the bag's topics are {', '.join(topics) or 'none'}"
    if tracked and not any(name in frames.names for name in (f"face_{face}" for face in tracked)):
        problem += f". {FACES} lists {', '.join(tracked)}, but where they are was not recorded"
    raise RecordingError(path, f"topic {TF}", problem, _EXPECTED)


def _track(seen: Sighted) -> BagTrack:
    poses, optical = forward(seen.frame, seen.poses)
    return BagTrack(
        seen.name,
        seen.frame,
        optical,
        poses.times_s,
        poses.delays_s,
        poses.position_m,
        poses.quat_wxyz,
        seen.repeated,
        seen.unusable,
    )
