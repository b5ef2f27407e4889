"""A room with a person, rendered by MuJoCo: pictures with exactly known geometry for the camera source.

The face is the portrait of scikit-image (``skimage.data.astronaut``, NASA, in the public domain), laid over a relief
with the depth of a face. Behind it is clutter: walls with coarse patches, boxes, and balls with the colour of skin.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from gazempc.types import FloatArray

# In the portrait, pixels: the middle between the pupils, their distance, and the cut-out.
_EYES_PX = (224.8, 101.8)
_PUPILS_PX = 43.1
_HEAD_HALF_PX = (62.0, 82.0)
_HEAD_CENTRE_PX = (226.5, 96.5)
# Mean distance between the pupils of adults (Dodgson 2004). It converts pixels to metres.
PUPILS_M = 0.063
_M_PER_PX = PUPILS_M / _PUPILS_PX
_GRID = 48
# Relief of a face: ears are 85 mm behind the eyes and 73 mm beside their middle, the tip of the nose 20 mm in front.
_EAR_DEPTH_M, _EAR_ASIDE_M = 0.085, 0.073
_CROWN_DEPTH_M, _CROWN_UP_M = 0.07, 0.125
_NOSE_M, _NOSE_WIDTH_M, _NOSE_BELOW_M = 0.022, 0.014, 0.033


@dataclass(frozen=True)
class StudioPerson:
    """Pose of the person in the room.

    Attributes:
        eyes_m: The point between the eyes, shape (3,), metres, z up.
        yaw_rad: Yaw of the face, radians.
    """

    eyes_m: FloatArray
    yaw_rad: float


class Studio:
    """Renders a person in a cluttered room through a camera without distortion.

    Args:
        width: Width of the pictures, pixels.
        height: Height, pixels.
        fov_deg: Horizontal field of view, degrees.
        seed: Seed of the clutter.

    Raises:
        RuntimeError: If rendering is not possible; the message names the packages to install.
    """

    def __init__(self, width: int = 640, height: int = 480, fov_deg: float = 60.0, seed: int = 0) -> None:
        # Without a screen, Mesa renders in software.
        os.environ.setdefault("MUJOCO_GL", "egl")
        try:
            import mujoco  # noqa: PLC0415
            from skimage import data  # noqa: PLC0415

            fovy_deg = 2 * math.degrees(math.atan(math.tan(math.radians(fov_deg) / 2) * height / width))
            portrait: Any = data.astronaut()  # type: ignore[no-untyped-call]
            # Hair covers the back of the head.
            pictures = {"face": portrait, "hair": portrait[12:52, 172:212], "wall": _patches(seed)}
            textures = {f"{name}.png": _png(picture) for name, picture in pictures.items()}
            self._model = mujoco.MjModel.from_xml_string(_mjcf(width, height, fovy_deg, seed), textures)
            self._data = mujoco.MjData(self._model)
            self._renderer: Any = mujoco.Renderer(self._model, height, width)
        except Exception as error:
            needed = "mujoco, scikit-image and Mesa's libEGL (Debian: libegl1 libgl1-mesa-dri), with MUJOCO_GL=egl"
            raise RuntimeError(f"rendering failed ({error!r}): it needs {needed}") from error
        self._mujoco = mujoco
        self.width, self.height, self.fov_deg = width, height, fov_deg

    def picture(self, person: StudioPerson | None, camera_m: FloatArray, camera_turn: Rotation) -> Any:
        """Render one picture.

        Args:
            person: The person; None for an empty room.
            camera_m: Position of the camera, shape (3,), metres.
            camera_turn: Its orientation; the identity looks along +x, with +z up.

        Returns:
            RGB, shape (height, width, 3), uint8.
        """
        data = self._data
        data.mocap_pos[0], data.mocap_quat[0] = camera_m, camera_turn.as_quat(scalar_first=True)
        # Without a person the body is behind the walls.
        data.mocap_pos[1] = (-50.0, 0.0, 0.0) if person is None else person.eyes_m
        if person is not None:
            data.mocap_quat[1] = Rotation.from_euler("z", person.yaw_rad).as_quat(scalar_first=True)
        self._mujoco.mj_forward(self._model, data)
        self._renderer.update_scene(data, "camera")
        return self._renderer.render()

    def close(self) -> None:
        """Release the renderer."""
        self._renderer.close()


def _mjcf(width: int, height: int, fovy_deg: float, seed: int) -> str:
    vertices, texture, faces = _relief()
    rng = np.random.default_rng(seed)
    clutter = "\n".join(_obstacle(rng, k) for k in range(24))
    return f"""<mujoco>
  <visual>
    <global offwidth="{width}" offheight="{height}"/>
    <headlight ambient="0.45 0.45 0.45" diffuse="0.45 0.45 0.45" specular="0 0 0"/>
    <map znear="0.01"/>
    <quality offsamples="4"/>
  </visual>
  <asset>
    <texture name="face" type="2d" file="face.png"/>
    <texture name="wall" type="2d" file="wall.png"/>
    <material name="face" texture="face" emission="0.35" specular="0" shininess="0"/>
    <texture name="hair" type="2d" file="hair.png"/>
    <material name="hair" texture="hair" texrepeat="3 3" specular="0.1" shininess="0.2"/>
    <material name="wall" texture="wall" texrepeat="2 2" emission="0.3" specular="0"/>
    <mesh name="face" inertia="shell" vertex="{_numbers(vertices)}" texcoord="{_numbers(texture)}"
      face="{" ".join(map(str, faces.ravel().tolist()))}"/>
  </asset>
  <worldbody>
    <light directional="true" pos="0 0 3" dir="0.5 -0.3 -1" diffuse="0.3 0.3 0.3" castshadow="false"/>
    <geom type="box" pos="6 0 1" size="0.1 7 3" material="wall"/>
    <geom type="box" pos="0 6 1" size="7 0.1 3" material="wall"/>
    <geom type="box" pos="0 -6 1" size="7 0.1 3" material="wall"/>
    <geom type="plane" pos="0 0 -1.3" size="8 8 0.1" rgba="0.5 0.45 0.4 1"/>
    {clutter}
    <body name="camera" mocap="true"><camera name="camera" xyaxes="0 -1 0 0 0 1" fovy="{fovy_deg!r}"/></body>
    <body name="person" mocap="true">
      <geom type="mesh" mesh="face" material="face"/>
      <geom type="ellipsoid" pos="-0.13 0 0.01" size="0.08 0.08 0.1" material="hair"/>
      <geom type="ellipsoid" pos="-0.13 0.08 -0.02" size="0.02 0.008 0.03" rgba="0.85 0.65 0.53 1"/>
      <geom type="ellipsoid" pos="-0.13 -0.08 -0.02" size="0.02 0.008 0.03" rgba="0.85 0.65 0.53 1"/>
      <geom type="capsule" fromto="-0.1 0 -0.09 -0.1 0 -0.2" size="0.055" rgba="0.85 0.65 0.53 1"/>
      <geom type="ellipsoid" pos="-0.1 0 -0.45" size="0.13 0.23 0.3" rgba="0.2 0.3 0.5 1"/>
    </body>
  </worldbody>
</mujoco>"""


def _relief() -> tuple[FloatArray, FloatArray, Any]:
    """Vertices (n, 3) in metres from between the eyes, x to the front; texture coordinates (n, 2); triangles (m, 3)."""
    radii, angles = np.meshgrid(np.linspace(0, 1, _GRID // 2), np.linspace(0, 2 * np.pi, _GRID, endpoint=False))
    u_px = _HEAD_CENTRE_PX[0] + _HEAD_HALF_PX[0] * radii * np.cos(angles)
    v_px = _HEAD_CENTRE_PX[1] + _HEAD_HALF_PX[1] * radii * np.sin(angles)
    # The view is not mirrored: the left of the portrait is the person's right.
    y_m, z_m = -(u_px - _EYES_PX[0]) * _M_PER_PX, -(v_px - _EYES_PX[1]) * _M_PER_PX
    x_m = -_EAR_DEPTH_M * (np.abs(y_m) / _EAR_ASIDE_M) ** 2.5
    x_m += _NOSE_M * np.exp(-0.5 * (y_m**2 + (z_m + _NOSE_BELOW_M) ** 2) / _NOSE_WIDTH_M**2)
    x_m -= _CROWN_DEPTH_M * (np.maximum(z_m, 0.0) / _CROWN_UP_M) ** 2
    x_m -= _NOSE_M * math.exp(-0.5 * (_NOSE_BELOW_M / _NOSE_WIDTH_M) ** 2)  # 0 between the eyes
    vertices = np.stack([x_m, y_m, z_m], axis=-1).reshape(-1, 3)
    texture = np.stack([u_px / 512, v_px / 512], axis=-1).reshape(-1, 2)
    index = np.arange(_GRID * (_GRID // 2)).reshape(_GRID, _GRID // 2)
    ahead = np.roll(index, -1, axis=0)
    a, b, c, d = (corner.ravel() for corner in (index[:, :-1], index[:, 1:], ahead[:, 1:], ahead[:, :-1]))
    return vertices, texture, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def _obstacle(rng: np.random.Generator, number: int) -> str:
    """A box, or a ball with the colour of skin, near a wall."""
    along_m, up_m = rng.uniform(-4.5, 4.5), rng.uniform(-1.2, 1.2)
    place = ((5.3, along_m), (along_m, 5.3), (along_m, -5.3))[number % 3]
    size = rng.uniform(0.08, 0.35, 3)
    position = _numbers(np.array([*place, up_m]))
    if number % 4 == 0:
        return f'<geom type="ellipsoid" pos="{position}" size="0.1 0.1 0.13" rgba="0.85 0.65 0.53 1"/>'
    red, green, blue = rng.uniform(0.1, 0.9, 3)
    return f'<geom type="box" pos="{position}" size="{_numbers(size)}" rgba="{red:.2f} {green:.2f} {blue:.2f} 1"/>'


def _patches(seed: int) -> Any:
    """Patches and stripes at several scales, shape (512, 512, 3), uint8."""
    rng = np.random.default_rng(seed)
    image = np.full((512, 512, 3), 150.0)
    for size in (128, 64, 32, 16):
        grey = rng.uniform(-1, 1, (512 // size, 512 // size, 1))
        patches = (grey + rng.uniform(-0.3, 0.3, (512 // size, 512 // size, 3))) * size / 2
        image += np.kron(patches, np.ones((size, size, 1)))
    return np.clip(image, 0, 255).astype(np.uint8)


def _png(image: Any) -> bytes:
    packed = BytesIO()
    Image.fromarray(image).save(packed, "PNG")
    return packed.getvalue()


def _numbers(values: Any) -> str:
    return " ".join(f"{value:.5f}" for value in np.ravel(values))
