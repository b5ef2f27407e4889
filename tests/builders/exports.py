"""Small files of one walk in the formats of other programs."""

import json

import numpy as np
from scipy.spatial.transform import Rotation

FRAMES, RATE_HZ = 45, 30.0
# Rows that make a file's axes of x forward, y left, z up.
FILE_FROM_OURS = {
    "z-up": np.eye(3),
    "y-up": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "optical": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
}


class Walk:
    """A person who walks a curve and looks 0.3 rad to the left of the direction of travel; metres, z up, floor at 0."""

    times_s = np.arange(FRAMES) / RATE_HZ
    travel_rad = 0.3 * times_s
    head_m = np.column_stack([1.1 * times_s, 0.5 * times_s**2 / 3.0, 1.62 + 0.02 * np.sin(11.0 * times_s)])
    pelvis_m = head_m + np.array([-0.03, 0.0, -0.63])
    head = Rotation.from_euler("z", travel_rad[:, None] + 0.3)
    pelvis = Rotation.from_euler("z", travel_rad[:, None])

    @classmethod
    def quat_wxyz(cls, part):
        return getattr(cls, part).as_quat(scalar_first=True)

    @classmethod
    def point_m(cls, part, offset_m):
        """Position of a point with this offset (forward, left, up) from head or pelvis."""
        return getattr(cls, f"{part}_m") + getattr(cls, part).apply(offset_m)


def same_turns(quats_wxyz, turns, deg=0.1):
    away = Rotation.from_quat(quats_wxyz, scalar_first=True) * turns.inv()
    assert np.degrees(away.magnitude()).max() < deg


def in_axes(axes, positions_m):
    return positions_m @ FILE_FROM_OURS[axes].T


def quat_in_axes(axes, turns):
    """Quaternions w, x, y, z with the frame's and the body's own axes of a file."""
    turn = Rotation.from_matrix(FILE_FROM_OURS[axes])
    return (turn * turns * turn.inv()).as_quat(scalar_first=True)


def numbers(row):
    return ["" if np.isnan(value) else f"{value:.6f}" for value in row]


def motive(path, name="Head", skeleton=False, unit="Millimeters", blank=(), others=()):
    """OptiTrack Motive 2.3, format 1.23: y up; rigid bodies with a marker, or a skeleton's bones."""
    scale = {"Millimeters": 1000.0, "Meters": 1.0}[unit]
    bodies = [(name, "head")] if not skeleton else [(f"{name}:Hip", "pelvis"), (f"{name}:Head", "head")]
    kinds, names, ids, things, axes, columns = [], [], [], [], [], []
    for body, part in [*bodies, *((other, "pelvis") for other in others)]:
        kinds += ["Bone" if skeleton else "Rigid Body"] * 8
        names += [body] * 8
        ids += ["5D1B"] * 8
        things += ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"]
        axes += [*"XYZW", *"XYZ", ""]
        quats = quat_in_axes("y-up", getattr(Walk, part))[:, [1, 2, 3, 0]]
        columns += [quats, scale * in_axes("y-up", getattr(Walk, f"{part}_m")), np.full((FRAMES, 1), 0.0002)]
        kinds += ["Rigid Body Marker"] * 3
        names += [f"{body}:Marker1"] * 3
        ids += ["5D1C"] * 3
        things += ["Position"] * 3
        axes += [*"XYZ"]
        columns.append(scale * in_axes("y-up", Walk.point_m(part, [0.1, 0.0, 0.0])))
    values = np.column_stack(columns)
    values[list(blank)] = np.nan
    facts = ["Format Version", "1.23", "Take Name", "Walk", "Capture Frame Rate", "30.000000", "Export Frame Rate"]
    facts += ["30.000000", "Capture Start Time", "2024-05-01 11.02.03.123 AM", "Total Frames in Take", str(FRAMES)]
    facts += ["Rotation Type", "Quaternion", "Length Units", unit, "Coordinate Space", "Global"]
    lines = [facts, [], ["", "", *kinds], ["", "", *names], ["", "", *ids], ["", "", *things]]
    lines.append(["Frame", "Time (Seconds)", *axes])
    lines += [[str(k), f"{t:.6f}", *numbers(row)] for k, (t, row) in enumerate(zip(Walk.times_s, values, strict=True))]
    return _write(path, lines)


def vicon_markers(path, subject="Anna", lost=()):
    """Vicon Nexus: devices first, then trajectories of the markers of Plug-in Gait, mm, z up."""
    offsets = {"FHD": (0.09, 0.07), "BHD": (-0.09, 0.07), "ASI": (0.08, 0.12), "PSI": (-0.08, 0.12)}
    markers = [(f"{s}{n}", [x, y if s == "L" else -y, 0.0]) for n, (x, y) in offsets.items() for s in "LR"]
    parts = ["head" if name.endswith("HD") else "pelvis" for name, _ in markers]
    values = np.column_stack([1000.0 * Walk.point_m(p, offset) for p, (_, offset) in zip(parts, markers, strict=True)])
    values[list(lost), -3:] = np.nan
    lines = [["Devices"], ["1000"], ["", "", "Plate - Force"], ["Frame", "Sub Frame", "Fx"], ["", "", "N"]]
    lines += [["1", "0", "3.5"], ["1", "1", "3.6"], [], ["Trajectories"], ["30"]]
    lines.append(["", "", *(cell for name, _ in markers for cell in (f"{subject}:{name}", "", ""))])
    lines.append(["Frame", "Sub Frame", *[*"XYZ"] * len(markers)])
    lines.append(["", "", *["mm"] * 3 * len(markers)])
    for k, row in enumerate(values):
        cells = [str(k + 101), "0", *numbers(row)]
        while not cells[-1]:
            cells.pop()
        lines.append(cells)
    return _write(path, lines)


def vicon_object(path, name="Anna_Head"):
    """Vicon Tracker: an object with quaternions, mm."""
    lines = [["Objects"], ["30"], ["", "", f"Global Angle {name}:{name}", *[""] * 6]]
    lines += [["Frame", "Sub Frame", "RX", "RY", "RZ", "RW", "TX", "TY", "TZ"], ["", "", *[""] * 4, *["mm"] * 3]]
    quats = Walk.quat_wxyz("head")[:, [1, 2, 3, 0]]
    rows = np.hstack([quats, 1000.0 * Walk.head_m])
    return _write(path, lines + [[str(k + 1), "0", *numbers(row)] for k, row in enumerate(rows)])


def mvnx(path):
    """Xsens MVN's XML, with the calibration pose before the frames."""
    frames = ['<frame time="0" index="-2" type="tpose"><orientation>1 0 0 0 1 0 0 0</orientation></frame>']
    quats = np.hstack([Walk.quat_wxyz("pelvis"), Walk.quat_wxyz("head")])
    for k, row in enumerate(np.hstack([Walk.pelvis_m, Walk.head_m])):
        inside = f"<orientation>{' '.join(numbers(quats[k]))}</orientation>"
        inside += f"<position>{' '.join(numbers(row))}</position>"
        frames.append(f'<frame time="{1000 * Walk.times_s[k]:.4f}" index="{k}" type="normal">{inside}</frame>')
    segments = '<segment label="Pelvis" id="1"/><segment label="Head" id="2"/>'
    text = f"<segments>{segments}</segments><frames>{''.join(frames)}</frames>"
    subject = f'<subject label="Anna" frameRate="30" segmentCount="2">{text}</subject>'
    namespace = 'xmlns="http://www.xsens.com/mvn/mvnx"'
    path.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n<mvnx {namespace} version="4">{subject}</mvnx>')
    return path


BACK = Rotation.from_euler("z", np.pi)


def ros2_echo(path, kind="pose", frame="camera_color_optical_frame"):
    """`ros2 topic echo --csv`: no header; Unix stamps as seconds and nanoseconds; quaternions x, y, z, w.

    The person walks backwards and faces the sensor.
    """
    axes = "optical" if "optical" in frame else "z-up"
    positions = in_axes(axes, Walk.head_m - [0.0, 0.0, 1.2] + [1.0, 0.0, 0.0])
    quats = quat_in_axes(axes, Walk.head * BACK)[:, [1, 2, 3, 0]]
    lines = []
    for k in range(FRAMES):
        nanoseconds = round(1e9 * Walk.times_s[k]) + 1_700_000_000_900_000_000
        stamp = [str(nanoseconds // 10**9), str(nanoseconds % 10**9), frame]
        quat = [] if kind == "point" else [repr(float(v)) for v in quats[k]]
        child = ["face_ab12"] if kind == "transform" else []
        covariance = ["0.0"] * 36 if kind == "covariance" else []
        lines.append([*stamp, *child, *(repr(float(v)) for v in positions[k]), *quat, *covariance])
        if kind == "transform" and k % 3 == 0:
            lines.append([*stamp, "gaze_ab12", "0.0", "0.0", "0.0", "0.0", "0.0", "0.0", "1.0"])
    return _write(path, lines)


def obsmat(path):
    """ETH's annotation: every sixth frame of a video, positions of several pedestrians, spaces between numbers."""
    lines = []
    for step in range(24):
        for person, shift in ((3, 0.0), (7, 5.0), (9, 9.0)):
            if person == 7 or step % 2 == 0 or step < 4:
                x, y = 0.5 * step + shift, 0.1 * step
                lines.append([780 + 6 * step, person, x, 0.0, y, 1.25, 0.0, 0.25])
    path.write_text("".join("".join(f"{value:16.7e}" for value in line) + "\n" for line in lines))
    return path


def tracks(path):
    """The four columns of trajectory forecasters, of the same people."""
    rows = np.loadtxt(obsmat(path))
    path.write_text("".join(f"{r[0]:.1f}\t{r[1]:.1f}\t{r[2]:.2f}\t{r[4]:.2f}\n" for r in rows))
    return path


LANDMARKS = {"NOSE": (0, "head", [0.1, 0.0, 0.0]), "LEFT_EAR": (7, "head", [0.0, 0.07, 0.0])}
LANDMARKS |= {"RIGHT_EAR": (8, "head", [0.0, -0.07, 0.0]), "LEFT_HIP": (23, "pelvis", [0.0, 0.12, 0.0])}
LANDMARKS |= {"RIGHT_HIP": (24, "pelvis", [0.0, -0.12, 0.0])}


def mediapipe(path, names="{name}_{axis}"):
    """World landmarks: metres from the middle of the hips, x right, y down, z away from the camera."""
    header, columns = ["timestamp_ms"], [1000.0 * Walk.times_s[:, None]]
    for name, (number, part, offset) in LANDMARKS.items():
        header += [names.format(name=name, number=number, axis=axis) for axis in "xyz"]
        columns.append(in_axes("optical", Walk.point_m(part, offset) - Walk.pelvis_m))
    return _write(path, [header, *(numbers(row) for row in np.hstack(columns))])


def mediapipe_long(path):
    """The same with a row for each landmark in each frame."""
    lines = [["timestamp_s", "landmark", "x_m", "y_m", "z_m", "visibility"]]
    points = {
        name: in_axes("optical", Walk.point_m(part, at) - Walk.pelvis_m) for name, (_, part, at) in LANDMARKS.items()
    }
    for k, t in enumerate(Walk.times_s):
        lines += [[f"{t:.6f}", name, *numbers(point_m[k]), "0.9"] for name, point_m in points.items()]
    return _write(path, lines)


def rostopic(path):
    """`rostopic echo -p` of ROS 1: stamps in nanoseconds."""
    header = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    header += [f"field.pose.position.{c}" for c in "xyz"] + [f"field.pose.orientation.{c}" for c in "xyzw"]
    rows = np.hstack([Walk.head_m, Walk.quat_wxyz("head")[:, [1, 2, 3, 0]]])
    stamps = [str(1_700_000_000_000_000_000 + round(1e9 * t)) for t in Walk.times_s]
    return _write(path, [header, *([s, str(k), s, "map", *numbers(rows[k])] for k, s in enumerate(stamps))])


def openpose(folder, lost=(), unit_m=0.001):
    """A folder with a file a frame: 25 key points with x, y, z and score; first camera's axes; lost ones are zeros."""
    folder.mkdir()
    indices = {"NOSE": 0, "RIGHT_EAR": 17, "LEFT_EAR": 18, "LEFT_HIP": 12, "RIGHT_HIP": 9}
    camera_m = np.array([-2.0, 0.0, 1.2])
    seen = {8: in_axes("optical", Walk.pelvis_m - camera_m)}
    for name, index in indices.items():
        _, part, offset = LANDMARKS[name]
        seen[index] = in_axes("optical", Walk.point_m(part, offset) - camera_m)
    for k in range(FRAMES):
        points = np.zeros((25, 4))
        if k not in lost:
            for index, point_m in seen.items():
                points[index] = [*point_m[k] / unit_m, 1.0]
        person = {"person_id": [-1], "pose_keypoints_2d": [], "pose_keypoints_3d": points.ravel().tolist()}
        file = folder / f"walk_{k:012d}_keypoints.json"
        file.write_text(json.dumps({"version": 1.3, "people": [person]}))
    return folder


# The order differs from the SDK's: joints are found by name.
KINECT = {"EAR_RIGHT": ("head", [0.0, -0.07, 0.0]), "NECK": ("pelvis", [0.0, 0.0, 0.4]), "NOSE": ("head", [0.1, 0, 0])}
KINECT |= {"PELVIS": ("pelvis", np.zeros(3)), "HEAD": ("head", np.zeros(3)), "EAR_LEFT": ("head", [0.0, 0.07, 0.0])}


def kinect(pitch_deg=0.0, body_id=7, shift_m=(0.0, 0.0, 0.0)):
    """Azure Kinect body tracking: microseconds, millimetres and the axes of a camera that looks up by the pitch.

    The joints' axes are +X up, +Y where the person faces, +Z to the left.
    """
    camera = Rotation.from_matrix(FILE_FROM_OURS["optical"]) * Rotation.from_euler("y", pitch_deg, degrees=True)
    person = Rotation.from_matrix([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    positions_mm = [1000.0 * camera.apply(Walk.point_m(part, offset) + shift_m) for part, offset in KINECT.values()]
    turns = [(camera * getattr(Walk, part) * person).as_quat(scalar_first=True) for part, _ in KINECT.values()]
    frames = []
    for k, t in enumerate(Walk.times_s):
        body = {"body_id": body_id, "joint_positions": [each[k].tolist() for each in positions_mm]}
        body["joint_orientations"] = [each[k].tolist() for each in turns]
        frames.append({"timestamp_usec": 5_000_000_000 + round(1e6 * t), "bodies": [body]})
    return {"k4abt_sdk_version": "1.1.2", "joint_names": list(KINECT), "bone_list": [], "frames": frames}


def _write(path, lines):
    path.write_text("".join(",".join(line) + "\n" for line in lines), encoding="utf-8")
    return path
