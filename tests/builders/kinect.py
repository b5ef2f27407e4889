"""A person as Azure Kinect body tracking saves one: JSON in microseconds, millimetres and the camera's axes."""

import numpy as np
from scipy.spatial.transform import Rotation

N = 40
START_USEC = 5_000_000_000
STEP_USEC = 33_333
LEFT, UP = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
# Not the SDK's order on purpose: joints are found by name.
NAMES = ["EAR_RIGHT", "NECK", "NOSE", "PELVIS", "HEAD", "EAR_LEFT"]


def camera_from_level(level, pitch_deg):
    """By hand: what a camera at the origin, looking up by the pitch, sees of a vector (forward, left, up)."""
    forward, left, up = level
    c, s = np.cos(np.radians(pitch_deg)), np.sin(np.radians(pitch_deg))
    along, above = c * forward + s * up, -s * forward + c * up
    return np.array([-left, -above, along])  # x right, y down, z forward


def joint_quat_wxyz(yaw_deg, pitch_deg):
    """Joint whose +X is up, +Y faces the yaw (from the camera's forward to the left), +Z is to that left."""
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    columns = [camera_from_level(np.array(v), pitch_deg) for v in ([0, 0, 1.0], [c, s, 0.0], [-s, c, 0.0])]
    x, y, z, w = Rotation.from_matrix(np.column_stack(columns)).as_quat()
    return [w, x, y, z]


def body(body_id, pelvis_m, pelvis_yaw, head_yaw, pitch):
    turn = Rotation.from_euler("z", head_yaw, degrees=True)
    head_m = pelvis_m + 0.6 * UP
    level = {
        "PELVIS": pelvis_m,
        "HEAD": head_m,
        "NOSE": head_m + turn.apply([0.12, 0.0, 0.02]),
        "EAR_LEFT": head_m + turn.apply([0.0, 0.08, 0.0]),
        "EAR_RIGHT": head_m + turn.apply([0.0, -0.08, 0.0]),
        "NECK": pelvis_m + 0.4 * UP,
    }
    yaw = {name: pelvis_yaw if name in ("PELVIS", "NECK") else head_yaw for name in NAMES}
    return {
        "body_id": body_id,
        "joint_positions": [(1000.0 * camera_from_level(level[name], pitch)).tolist() for name in NAMES],
        "joint_orientations": [joint_quat_wxyz(yaw[name], pitch) for name in NAMES],
    }


def pelvis_path_m():
    """From 4 m ahead to 3 m ahead, a metre to the left, a little under the camera."""
    t = np.arange(N) / 30.0
    return np.column_stack([4.0 - 0.75 * t, np.full(N, 1.0), np.full(N, -0.2)])


def document(pitch=0.0, pelvis_yaw=170.0, head_yaw=-150.0):
    frames = [
        {"timestamp_usec": START_USEC + k * STEP_USEC, "bodies": [body(7, place, pelvis_yaw, head_yaw, pitch)]}
        for k, place in enumerate(pelvis_path_m())
    ]
    return {"k4abt_sdk_version": "1.1.2", "joint_names": NAMES, "bone_list": [], "frames": frames}
