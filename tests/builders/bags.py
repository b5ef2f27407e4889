"""Small ROS 2 bags with people's frames in `/tf`."""

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_FOXY)
STORE.register(get_types_from_msg("std_msgs/Header header\nstring[] ids", "hri_msgs/msg/IdsList"))
TYPES = STORE.types


def write_bag(folder, frames, storage="sqlite3", delay_s=0.0):
    """A bag with `/tf` of frames: rows of (stamp in s, parent, child, position, quaternion wxyz); and `/people`."""
    with Writer(folder, version=8, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        tf = writer.add_connection("/tf", "tf2_msgs/msg/TFMessage", typestore=STORE)
        ids = writer.add_connection("/humans/faces/tracked", "hri_msgs/msg/IdsList", typestore=STORE)
        for stamp_s, parent, child, position_m, quat_wxyz in frames:
            header = _header(stamp_s, parent)
            vector = TYPES["geometry_msgs/msg/Vector3"](*map(float, position_m))
            w, x, y, z = map(float, quat_wxyz)
            pose = TYPES["geometry_msgs/msg/Transform"](vector, TYPES["geometry_msgs/msg/Quaternion"](x, y, z, w))
            transform = TYPES["geometry_msgs/msg/TransformStamped"](header, child, pose)
            message = TYPES["tf2_msgs/msg/TFMessage"]([transform])
            received_ns = round((stamp_s + delay_s) * 1e9)
            writer.write(tf, received_ns, STORE.serialize_cdr(message, "tf2_msgs/msg/TFMessage"))
        tracked = TYPES["hri_msgs/msg/IdsList"](_header(1.0, ""), ["a"])
        writer.write(ids, 10**9, STORE.serialize_cdr(tracked, "hri_msgs/msg/IdsList"))
    return folder


def face_rows(face, times_s, position_m, parent="camera_color_optical_frame", quat_wxyz=(1.0, 0.0, 0.0, 0.0)):
    """Rows for `write_bag` of a face at the same position in all frames, or at one a frame."""
    positions = np.broadcast_to(position_m, (len(times_s), 3))
    return [(float(t), parent, face, p, quat_wxyz) for t, p in zip(times_s, positions, strict=True)]


def _header(stamp_s, frame_id):
    stamp_ns = round(stamp_s * 1e9)
    stamp = TYPES["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    return TYPES["std_msgs/msg/Header"](stamp, frame_id)
