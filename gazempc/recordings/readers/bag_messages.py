"""Messages of a ROS 2 bag, decoded without a ROS installation."""

from __future__ import annotations

import re
import sqlite3
import struct
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gazempc.errors import RecordingError, SettingsError, importing, shown
from gazempc.files.bounds import MEGABYTE, check_file, check_unpacked, read_limited
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
_MCAP, _ZSTD = b"\x89MCAP0\r\n", b"\x28\xb5\x2f\xfd"  # the first bytes of such files
# Records of MCAP: kind and length; of a chunk, its times and the size of its content.
_RECORD, _CHUNK_HEAD, _CHUNK = struct.Struct("<BQ"), struct.Struct("<QQQ"), 6
_MOST_METADATA_BYTES = 4 * MEGABYTE
_EXPECTED = f"the folder of a ROS 2 bag ({_METADATA}, and .db3 or .mcap files)"


@dataclass(frozen=True)
class BagMessage:
    """One message.

    Attributes:
        topic: Its topic.
        received_ns: Time of recording, nanoseconds since 1970.
        content: Its fields, with ROS's names.
    """

    topic: str
    received_ns: int
    content: Any


def stamp_ns(header: Any) -> int:
    """Stamp of a `std_msgs/Header`, nanoseconds; 0 if it is not set."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def person_of_topic(topic: str) -> str | None:
    """Person's id in a topic of face ids; None for any other topic."""
    found = _FACE_OF_PERSON.fullmatch(topic)
    return found[1] if found else None


def read_messages(path: Path) -> tuple[Mapping[str, str], list[BagMessage]]:
    """Read the messages of a bag with positions of people.

    Args:
        path: Folder of the bag, or a file of it.

    Returns:
        The type of each topic of the bag, by name; and frames, poses, points and lists of people, in the order of
        their recording.

    Raises:
        RecordingError: If this is not a bag, or it is damaged.
        MissingOptionalDependencyError: If rosbags is not installed.
    """
    with importing("Reading ROS 2 bags", "rosbags", "bags"):
        from rosbags.rosbag2 import Reader  # noqa: PLC0415 - optional
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - optional
    # These definitions are the same in all releases of ROS 2.
    store = get_typestore(Stores.ROS2_FOXY)
    # No standard type store has this one.
    store.register(get_types_from_msg("std_msgs/Header header\nstring[] ids", _IDS_TYPE))
    if path.suffix.lower() in FILE_ENDINGS and (path.parent / _METADATA).is_file():
        path = path.parent
    messages: list[BagMessage] = []
    try:
        _check(path)
        with Reader(path) as reader:
            topics = {connection.topic: connection.msgtype for connection in reader.connections}
            wanted = [c for c in reader.connections if _is_wanted(c.topic, c.msgtype)]
            # With an empty list of connections, the library reads all messages.
            for connection, received_ns, raw in reader.messages(wanted) if wanted else ():
                content = store.deserialize_cdr(raw, connection.msgtype)
                messages.append(BagMessage(connection.topic, received_ns, content))
    except (OSError, SettingsError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        place = Path(getattr(error, "filename", None) or "").name
        raise RecordingError(path, place, f"cannot be read: {reason}", _EXPECTED) from None
    except Exception as error:  # a damaged bag makes the library raise errors of many unrelated classes
        reason = (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")
        raise RecordingError(path, "", f"cannot be read ({reason})", _EXPECTED) from None
    return dict(sorted(topics.items())), messages


def _check(path: Path) -> None:
    """Check the files of a bag before the library reads them.

    Raises:
        OSError: If one is not a regular file, or its unpacked content is far larger than the file.
        SettingsError: If the metadata has YAML aliases.
        sqlite3.Error: If a database is damaged.
        ValueError: If a database has a view or a trigger.
    """
    files = [part for part in path.iterdir() if not part.is_dir()] if path.is_dir() else [path]
    for file in files:
        size_bytes = check_file(file)
        if file.name == _METADATA:
            check_yaml(read_limited(file, _MOST_METADATA_BYTES).decode(), str(file))
        elif file.suffix == ".db3":
            with closing(sqlite3.connect(f"{file.resolve().as_uri()}?immutable=1", uri=True)) as database:
                views = database.execute("SELECT name FROM sqlite_master WHERE type IN ('view', 'trigger')").fetchall()
            if views:
                raise ValueError(f"{file.name} has a view or trigger, {shown(str(views[0][0]))}, which no bag has")
        with file.open("rb") as opened:
            begin = opened.read(len(_MCAP))
        if begin == _MCAP:
            check_unpacked(_chunk_bytes(file), size_bytes)
        elif begin.startswith(_ZSTD):
            _check_zstd(file, size_bytes)


def _chunk_bytes(file: Path) -> int:
    """Unpacked size of an MCAP file, bytes, as stated by its chunks; the library checks it."""
    total, size_bytes = 0, file.stat().st_size
    with file.open("rb") as mcap:
        place = len(_MCAP)
        while place + _RECORD.size <= size_bytes:
            mcap.seek(place)
            kind, length = _RECORD.unpack(mcap.read(_RECORD.size))
            if kind == _CHUNK:
                stated = mcap.read(_CHUNK_HEAD.size)
                total += _CHUNK_HEAD.unpack(stated)[2] if len(stated) == _CHUNK_HEAD.size else 0
            place += _RECORD.size + length
    return total


def _check_zstd(file: Path, size_bytes: int) -> None:
    """Check the unpacked size of a Zstandard file, by unpacking it as far as its size is plausible."""
    # A dependency of rosbags, and part of Python from 3.14 on.
    from backports import zstd  # noqa: PLC0415

    total = 0
    with zstd.open(file, "rb") as content:
        while part := content.read(MEGABYTE):
            total += len(part)
            check_unpacked(total, size_bytes)


def _is_wanted(topic: str, kind: str) -> bool:
    named = {_TF_TYPE: topic in (TF, TF_STATIC), _IDS_TYPE: topic == FACES, _TEXT_TYPE: bool(person_of_topic(topic))}
    return kind in POSE_TYPES or named.get(kind, False)
