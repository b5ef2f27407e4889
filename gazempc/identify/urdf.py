"""A neck from a URDF: limits, joint axes, and offsets by the name of the eye's frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import SettingsError, suggest
from gazempc.files.bounds import read_limited
from gazempc.types import FloatArray

_LEVEL = 0.05  # rad; axes in robots' URDFs are exact
_MOST_BYTES = 64_000_000


@dataclass(frozen=True)
class UrdfNeck:
    """A pan-tilt neck of a URDF.

    Attributes:
        base_frame: Parent link of the pan joint.
        pan_in_base_m: Pan axis in that link, shape (3,), metres.
        base_roll_pitch_yaw_deg: Orientation of that link in the neck's base frame (x forward, y left, z up), degrees.
        joint_names: Pan and tilt.
        joint_signs: -1 for a joint that is positive to the right, or down.
        range_deg: Lowest and highest angle of pan and of tilt, in the sign convention of neck files, degrees.
        speed_rad_s: Speed limits, rad/s.
        tilt_axis_in_pan_m: Tilt axis from the pan axis, shape (3,), metres.
        eye_in_tilt_m: Eye from the tilt axis, shape (3,), metres.
    """

    base_frame: str
    pan_in_base_m: FloatArray
    base_roll_pitch_yaw_deg: FloatArray
    joint_names: tuple[str, str]
    joint_signs: tuple[int, int]
    range_deg: tuple[tuple[float, float], tuple[float, float]]
    speed_rad_s: tuple[float, float]
    tilt_axis_in_pan_m: FloatArray
    eye_in_tilt_m: FloatArray

    @property
    def options(self) -> tuple[str, ...]:
        """Words of the command line for a robot and people in tf."""
        rotation = Rotation.from_euler("xyz", self.base_roll_pitch_yaw_deg, degrees=True)
        at = [f"{-each:.5g}" for each in rotation.apply(self.pan_in_base_m)]
        turn = [f"{each:.5g}" for each in self.base_roll_pitch_yaw_deg]
        words = ["--options.ros2.joint-names", *self.joint_names]
        words += ["--options.ros2.joint-signs", *map(str, self.joint_signs)]
        words += ["--options.ros2.base-frame", self.base_frame, "--mount.position-m", *at]
        return (*words, *(["--mount.roll-pitch-yaw-deg", *turn] if any(map(float, turn)) else []))


def read_urdf(path: Path, eye_frame: str | None, pan: str | None = None, tilt: str | None = None) -> UrdfNeck:
    """Read the neck of a robot.

    Args:
        path: The URDF (for a xacro file, its expansion).
        eye_frame: Link at the eye, such as the camera's, required; its orientation is not used.
        pan: Name of the pan joint; default: the second revolute joint of the chain from the eye to the root.
        tilt: Name of the tilt joint; default: the first one.

    Returns:
        The neck.

    Raises:
        SettingsError: If the file is invalid, or has no such neck.
    """
    if eye_frame is None:
        raise SettingsError("--urdf: needs --eye-frame, the link at the eye")
    try:
        text = read_limited(path, _MOST_BYTES)
        if b"<!ENTITY" in text:
            raise SettingsError(f"--urdf {path}: entities are not accepted")
        root = ElementTree.fromstring(text)
    except OSError as error:
        raise SettingsError(f"--urdf {path}: {error.strerror or error}") from None
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise SettingsError(f"--urdf {path}: not valid XML: {error}; expand a xacro file with 'xacro' first") from None
    above = {_link(joint, "child", path): joint for joint in root.iter("joint") if joint.find("child") is not None}
    if eye_frame not in above:
        raise SettingsError(
            f"--eye-frame {eye_frame!r}: {path} has no such link below a joint; {suggest(eye_frame, above)}"
        )
    chain: list[Any] = []
    while eye_frame in above and above[eye_frame] not in chain:
        chain.append(above[eye_frame])
        eye_frame = _link(above[eye_frame], "parent", path)
    turning = [joint for joint in chain if joint.get("type") in ("revolute", "continuous")]
    names = [str(joint.get("name")) for joint in turning]
    for option, name in (("--pan-joint", pan), ("--tilt-joint", tilt)):
        if name is not None and name not in names:
            raise SettingsError(
                f"{option} {name!r}: revolute joints between root and eye frame: {', '.join(names) or 'none'}"
            )
    if len(turning) < 2:
        raise SettingsError(f"--eye-frame: {len(turning)} revolute joints between it and the root; two are needed")
    tilt_joint = turning[0 if tilt is None else names.index(tilt)]
    pan_joint = turning[min(turning.index(tilt_joint) + 1, len(turning) - 1) if pan is None else names.index(pan)]
    if chain.index(pan_joint) <= chain.index(tilt_joint):
        raise SettingsError("--pan-joint: it must be an ancestor of the tilt joint, and the tilt joint of the eye")
    return _neck(chain, pan_joint, tilt_joint, path)


def _neck(chain: list[Any], pan_joint: Any, tilt_joint: Any, path: Path) -> UrdfNeck:
    """The neck from its kinematic chain, at joint angles zero."""
    until_pan, until_tilt = chain.index(pan_joint), chain.index(tilt_joint)
    pan_pose = _origin(pan_joint)
    tilt_pose = reduce(np.matmul, map(_origin, reversed(chain[until_tilt:until_pan])), pan_pose)
    eye_pose = reduce(np.matmul, map(_origin, reversed(chain[:until_tilt])), tilt_pose)
    pan_axis, tilt_axis = pan_pose[:3, :3] @ _axis(pan_joint), tilt_pose[:3, :3] @ _axis(tilt_joint)
    up = np.array([0.0, 0.0, 1.0])
    if abs(abs(float(pan_axis @ up)) - 1.0) > _LEVEL:
        raise SettingsError(f"{path}: joint {pan_joint.get('name')} does not rotate about its parent link's vertical")
    if abs(float(tilt_axis @ up)) > _LEVEL:
        raise SettingsError(f"{path}: joint {tilt_joint.get('name')} does not rotate about a horizontal axis")
    # Left is along the tilt axis, in the direction for which the eye looks forward.
    left = tilt_axis / np.linalg.norm(tilt_axis)
    if np.cross(left, up) @ np.array([1.0, 0.0, 0.0]) < 0.0:
        left = -left
    axes = np.array([np.cross(left, up), left, up])
    pan_sign = 1 if pan_axis @ up > 0 else -1
    # Tilting up turns forward to up: about the axis to the right.
    tilt_sign = -1 if tilt_axis @ left > 0 else 1
    pan_deg, pan_rad_s = _limits(pan_joint, pan_sign, path)
    tilt_deg, tilt_rad_s = _limits(tilt_joint, tilt_sign, path)
    return UrdfNeck(
        base_frame=_link(pan_joint, "parent", path),
        pan_in_base_m=pan_pose[:3, 3],
        base_roll_pitch_yaw_deg=Rotation.from_matrix(axes).as_euler("xyz", degrees=True),
        joint_names=(str(pan_joint.get("name")), str(tilt_joint.get("name"))),
        joint_signs=(pan_sign, tilt_sign),
        range_deg=(pan_deg, tilt_deg),
        speed_rad_s=(pan_rad_s, tilt_rad_s),
        tilt_axis_in_pan_m=axes @ (tilt_pose[:3, 3] - pan_pose[:3, 3]),
        eye_in_tilt_m=axes @ (eye_pose[:3, 3] - tilt_pose[:3, 3]),
    )


def _limits(joint: Any, sign: int, path: Path) -> tuple[tuple[float, float], float]:
    name, limit = joint.get("name"), joint.find("limit")
    try:
        low, high = (-np.pi, np.pi) if joint.get("type") == "continuous" else (
            float(limit.get("lower")), float(limit.get("upper"))
        )  # fmt: skip
        speed = float(limit.get("velocity"))
    except (AttributeError, TypeError, ValueError):
        raise SettingsError(f"{path}: joint {name} needs a <limit> with lower, upper and velocity") from None
    low_deg, high_deg = np.rad2deg(sorted((sign * low, sign * high)))
    return (float(low_deg), float(high_deg)), speed


def _origin(joint: Any) -> FloatArray:
    """Pose of a joint's frame in its parent link at angle zero, shape (4, 4)."""
    pose, origin = np.eye(4), joint.find("origin")
    if origin is not None:
        pose[:3, 3] = _numbers(origin.get("xyz", "0 0 0"))
        pose[:3, :3] = Rotation.from_euler("xyz", _numbers(origin.get("rpy", "0 0 0"))).as_matrix()
    return pose


def _axis(joint: Any) -> FloatArray:
    axis = joint.find("axis")
    found = _numbers("1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
    return found / np.linalg.norm(found)


def _numbers(text: str) -> FloatArray:
    try:
        found = np.array(text.split(), dtype=np.float64)
    except ValueError:
        found = np.empty(0)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise SettingsError(f"--urdf: {text!r}: expected three numbers")
    return found


def _link(joint: Any, end: str, path: Path) -> str:
    found = joint.find(end)
    if found is None or not found.get("link"):
        raise SettingsError(f"{path}: joint {joint.get('name')} has no {end} link")
    return str(found.get("link"))
