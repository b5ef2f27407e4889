"""The sensor's pose, by matrices written out by hand."""

import numpy as np
from scipy.spatial.transform import Rotation


def about(axis, angle_rad):
    return Rotation.from_euler(axis, angle_rad).as_matrix()


def pose(rotation, shift):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, shift
    return matrix


def sensor_in_base(mount, geometry=None, angles_rad=None):
    """The sensor's pose as a product of matrices written out by hand."""
    roll, pitch, yaw = np.deg2rad(mount.roll_pitch_yaw_deg)
    sensor = pose(about("z", yaw) @ about("y", pitch) @ about("x", roll), mount.position_m)
    if mount.on == "base":
        return sensor
    pan, tilt, *others = angles_rad
    # Up is a turn from +x towards +z, against the right-handed turn about y. The body turns about the pan axis.
    body = others.pop() if len(others) in (1, 3) else 0.0
    head = pose(about("z", body + pan), np.zeros(3)) @ pose(about("y", -tilt), geometry.tilt_axis_in_pan_m)
    if mount.on == "eye":
        eye_pan, eye_tilt = others
        head = head @ pose(about("z", eye_pan) @ about("y", -eye_tilt), geometry.eye_in_tilt_m)
    return head @ sensor
