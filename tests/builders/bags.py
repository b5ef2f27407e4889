"""Small ROS 2 bags with people: transforms, poses, points and ROS4HRI topics."""

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_FOXY)
STORE.register(get_types_from_msg("std_msgs/Header header\nstring[] ids", "hri_msgs/msg/IdsList"))
TYPES = STORE.types
OPTICAL = "camera_color_optical_frame"


def write_bag(
    folder, frames, storage="sqlite3", delay_s=0.0, stamped=True, static=(), topics=(), lists=((1.0, ("a",)),)
):
    """Write a bag with `/tf`: rows of (stamp in s, parent, child, position, quaternion wxyz).

    `static` are rows of `/tf_static`; `topics` are (name, type, rows of (stamp, frame, position, quaternion) or of
    text), `lists` are rows of (stamp, ids) in `/humans/faces/tracked`. Not `stamped`, the
    messages have a stamp of 0.
    """
    with Writer(folder, version=8, storage_plugin=StoragePlugin[storage.upper()]) as writer:

        def add(name, kind, messages):
            connection = writer.add_connection(name, kind, typestore=STORE)
            for stamp_s, message in messages:
                writer.write(connection, round((stamp_s + delay_s) * 1e9), STORE.serialize_cdr(message, kind))

        add("/tf", "tf2_msgs/msg/TFMessage", [_tf(row, stamped) for row in frames])
        add("/tf_static", "tf2_msgs/msg/TFMessage", [_tf(row) for row in static])
        ids = TYPES["hri_msgs/msg/IdsList"]
        add(
            "/humans/faces/tracked",
            "hri_msgs/msg/IdsList",
            [(t, ids(_header(t, ""), list(names))) for t, names in lists],
        )
        for name, kind, rows in topics:
            add(name, kind, [_message(kind, row, stamped) for row in rows])
    return folder


def face_rows(face, times_s, position_m, parent=OPTICAL, quat_wxyz=(1.0, 0.0, 0.0, 0.0)):
    """Rows for `write_bag` of a face at the same position in all frames, or at one a frame."""
    positions = np.broadcast_to(position_m, (len(times_s), 3))
    return [(float(t), parent, face, p, quat_wxyz) for t, p in zip(times_s, positions, strict=True)]


def pose_rows(times_s, positions_m, frame, quat_wxyz=(1.0, 0.0, 0.0, 0.0)):
    """Rows for a topic of `write_bag`."""
    return [(float(t), frame, p, quat_wxyz) for t, p in zip(times_s, positions_m, strict=True)]


def _message(kind, row, stamped):
    if kind.startswith("std_msgs/"):
        return row[0], TYPES[kind](row[1])
    stamp_s, frame, position_m, quat_wxyz = row
    header, point = _header(stamp_s * stamped, frame), TYPES["geometry_msgs/msg/Point"](*map(float, position_m))
    if kind == "geometry_msgs/msg/PointStamped":
        return stamp_s, TYPES[kind](header, point)
    pose = TYPES["geometry_msgs/msg/Pose"](point, _quaternion(quat_wxyz))
    if kind == "geometry_msgs/msg/PoseWithCovarianceStamped":
        pose = TYPES["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
    return stamp_s, TYPES[kind](header, pose)


def _tf(row, stamped=True):
    stamp_s, parent, child, position_m, quat_wxyz = row
    vector = TYPES["geometry_msgs/msg/Vector3"](*map(float, position_m))
    pose = TYPES["geometry_msgs/msg/Transform"](vector, _quaternion(quat_wxyz))
    transform = TYPES["geometry_msgs/msg/TransformStamped"](_header(stamp_s * stamped, parent), child, pose)
    return stamp_s, TYPES["tf2_msgs/msg/TFMessage"]([transform])


def _quaternion(quat_wxyz):
    w, x, y, z = map(float, quat_wxyz)
    return TYPES["geometry_msgs/msg/Quaternion"](x, y, z, w)


def _header(stamp_s, frame_id):
    stamp_ns = round(stamp_s * 1e9)
    stamp = TYPES["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    return TYPES["std_msgs/msg/Header"](stamp, frame_id)
