"""Messages of a ROS 2 bag: those that say where people are, decoded without a ROS installation."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gazempc.errors import MissingOptionalDependencyError, RecordingError, SettingsError, shown
from gazempc.files.bounds import MEGABYTE, check_file, memory_for, read_limited
from gazempc.files.documents import check_yaml

TF, TF_STATIC, FACES = "/tf", "/tf_static", "/humans/faces/tracked"
POSE_TYPES = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PointStamped",
)
FILE_ENDINGS = (".mcap", ".db3")
_TF_TYPE, _IDS_TYPE, _TEXT_TYPE = "tf2_msgs/msg/TFMessage", "hri_msgs/msg/IdsList", "std_msgs/msg/String"
_FACE_OF_PERSON = re.compile(r"/humans/persons/([^/]+)/face_id")
_METADATA = "metadata.yaml"
_MOST_METADATA_BYTES = 4 * MEGABYTE
_EXPECTED = f"the folder of a ROS 2 bag ({_METADATA}, and .db3 or .mcap files)"
# Definitions that no standard type store has.
_OWN_TYPES = {_IDS_TYPE: "std_msgs/Header header\nstring[] ids"}


@dataclass(frozen=True)
class BagMessage:
    """One message.

    Attributes:
        topic: Its topic.
        received_ns: When it was recorded, nanoseconds since 1970.
        content: Its fields, by the names of ROS.
    """

    topic: str
    received_ns: int
    content: Any


def stamp_ns(header: Any) -> int:
    """Stamp of a `std_msgs/Header`, nanoseconds; 0 where nobody set it."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def person_of_topic(topic: str) -> str | None:
    """Person whose face a topic names; None for any other topic."""
    found = _FACE_OF_PERSON.fullmatch(topic)
    return found[1] if found else None


def read_messages(
    path: Path, tell: Callable[[float], None] = lambda share: None
) -> tuple[Mapping[str, str], list[BagMessage]]:
    """Read the messages of a bag that say where people are.

    Args:
        path: Folder of the bag, or a file of it.
        tell: Called with the share that is read, 0 to 1.

    Returns:
        The type of each topic of the bag, by name; and frames, poses, points and lists of people, in the order of
        their recording.

    Raises:
        RecordingError: If this is no bag, or it is damaged.
        MissingOptionalDependencyError: If rosbags is not installed.
    """
    try:
        from rosbags.rosbag2 import Reader  # noqa: PLC0415 - optional
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingOptionalDependencyError("Reading ROS 2 bags", "rosbags", "bags") from None
    # What is read here has been the same in all releases of ROS 2.
    store = get_typestore(Stores.ROS2_FOXY)
    for name, definition in _OWN_TYPES.items():
        store.register(get_types_from_msg(definition, name))
    if path.suffix.lower() in FILE_ENDINGS and (path.parent / _METADATA).is_file():
        path = path.parent
    messages: list[BagMessage] = []
    try:
        with memory_for(_checked(path)), Reader(path) as reader:
            topics = {connection.topic: connection.msgtype for connection in reader.connections}
            wanted = [c for c in reader.connections if _is_wanted(c.topic, c.msgtype)]
            total = max(1, sum(c.msgcount for c in wanted))
            # Without any connection, the library reads them all.
            for connection, received_ns, raw in reader.messages(wanted) if wanted else ():
                tell(len(messages) / total)
                content = store.deserialize_cdr(raw, connection.msgtype)
                messages.append(BagMessage(connection.topic, received_ns, content))
    except (OSError, SettingsError) as error:
        said = error.strerror or str(error) if isinstance(error, OSError) else str(error)
        place = Path(error.filename).name if isinstance(error, OSError) and error.filename else ""
        raise RecordingError(path, place, f"cannot be read: {said}", _EXPECTED) from None
    except Exception as error:  # a damaged bag makes the library raise errors of many unrelated classes
        raise RecordingError(path, "", f"cannot be read ({_first_line(error)})", _EXPECTED) from None
    return dict(sorted(topics.items())), messages


def _checked(path: Path) -> int:
    """Look at the files of a bag before the library does.

    Returns:
        Their size, bytes.

    Raises:
        OSError: If one is no regular file.
        SettingsError: If the description has aliases.
        sqlite3.Error: If a database is damaged.
        ValueError: If a database would compute something.
    """
    files = [path] if path.is_file() else [part for part in path.iterdir() if not part.is_dir()]
    size_bytes = sum(check_file(file) for file in files)
    for file in files:
        if file.name == _METADATA:
            check_yaml(read_limited(file, _MOST_METADATA_BYTES).decode(), str(file))
        elif file.suffix == ".db3":
            with closing(sqlite3.connect(f"{file.resolve().as_uri()}?immutable=1", uri=True)) as database:
                views = database.execute("SELECT name FROM sqlite_master WHERE type IN ('view', 'trigger')").fetchall()
            if views:
                raise ValueError(f"{file.name} has a view or trigger, {shown(str(views[0][0]))}, which no bag has")
    return size_bytes


def _is_wanted(topic: str, kind: str) -> bool:
    if kind == _TF_TYPE:
        return topic in (TF, TF_STATIC)
    if kind == _IDS_TYPE:
        return topic == FACES
    return kind in POSE_TYPES or (kind == _TEXT_TYPE and person_of_topic(topic) is not None)


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(".") if lines else type(error).__name__
