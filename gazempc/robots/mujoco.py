"""A neck simulated by MuJoCo, an independent plant model for validation, and its model (MJCF)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from gazempc.errors import RobotError, importing
from gazempc.neck.spec import BODY_AXIS, EYE_AXES, Axis, NeckSpec
from gazempc.robots.robot import check_command
from gazempc.types import FloatArray, JointState

# Tolerance for rounding of a clock, in steps.
_SAME_STEP = 1e-6

# A head on a geared motor. Gains are computed from the inertia, so these values do not change the servo; they set the
# ratio of the head's inertia, which depends on tilt if the eye is off the axes, to the armature.
_ARMATURE_KG_M2 = 0.1
_HEAD_KG = 1.0
_HEAD_RADIUS_M = 0.09
_HEAD_KG_M2 = 0.4 * _HEAD_KG * _HEAD_RADIUS_M**2
_YOKE_KG = 0.3
_YOKE_KG_M2 = 1e-3
# Small enough that eye motion does not turn the head; the mass of the eyes is part of the head's.
_EYE_ARMATURE_KG_M2 = 1e-4
_EYE_KG = 0.02
_EYE_RADIUS_M = 0.02
_EYE_KG_M2 = 0.4 * _EYE_KG * _EYE_RADIUS_M**2
# Large enough that head motion hardly turns the body.
_TORSO_KG = 10.0
_TORSO_KG_M2 = 0.5


class MujocoNeck:
    """Hinges with position or speed servos and MuJoCo's actuator delay, in lock-step with a clock.

    Each method call simulates up to the clock's time, in complete steps of `timestep_s`.
    Exact on the loop's simulated clock; on another clock the state is less than one step (1 ms) old, with its own time
    stamp.

    Args:
        neck: The simulated neck: geometry, ranges, servos, dead times, encoder noise and load.
        clock_s: Returns the present time, seconds; not decreasing.
        position_rad: Initial angles, at rest, shape (N,), radians; None for the rest angles.
        seed: Seed of encoder noise.
    """

    keeps_any_clock = True

    def __init__(
        self, neck: NeckSpec, clock_s: Callable[[], float], position_rad: FloatArray | None = None, seed: int = 0
    ) -> None:
        self._neck, self._clock_s, self._step_s = neck, clock_s, timestep_s(neck)
        self._start_rad = np.asarray(neck.rest_rad if position_rad is None else position_rad, dtype=np.float64)
        self._start_s, self._steps = 0.0, 0
        self._load_rad = np.deg2rad([axis.load_offset_deg for axis in neck.axes])
        self._noise_rad = np.deg2rad([axis.encoder_noise_deg for axis in neck.axes])
        ends_rad, most_rad_s = (neck.position_min_rad, neck.position_max_rad), neck.velocity_max_rad_s
        self._sendable = np.where(neck.speed_joints, (-most_rad_s, most_rad_s), ends_rad)
        self._rng = np.random.default_rng(seed)
        self._mujoco: Any = None
        self._data: Any = None
        # MuJoCo orders joints by parts: the body first.
        self._order: list[int] = []

    @property
    def mjcf(self) -> str:
        """The model as XML, which MuJoCo's viewer opens from a file."""
        return neck_mjcf(self._neck)

    @property
    def data(self) -> Any:
        """The ``mujoco.MjData`` of the simulation with its ``model``, for viewers; RobotError if not connected."""
        if self._data is None:
            raise RobotError("the MuJoCo neck is not connected: call connect() first")
        return self._data

    def connect(self) -> None:
        """Start the simulation at the clock's time; see `gazempc.robots.robot.Robot.connect`.

        Raises:
            MissingOptionalDependencyError: If MuJoCo is not installed.
            RobotError: If MuJoCo rejects the model, as do versions before 3.5.
        """
        if self._data is not None:
            return
        with importing("the MuJoCo neck", "mujoco", "mujoco"):
            import mujoco  # noqa: PLC0415
        try:
            model = mujoco.MjModel.from_xml_string(self.mjcf)
        except ValueError as error:
            which = f"MuJoCo {mujoco.__version__} (needed: 3.5)"
            raise RobotError(f"{which} refused the model of neck {self._neck.name!r}: {error}") from None
        data = mujoco.MjData(model)
        order = [int(model.joint(name).qposadr[0]) for name in self._neck.joint_names]
        data.qpos[order] = self._start_rad + self._load_rad
        # Velocity-controlled joints: zero speed, and the position as activation of their actuator.
        commands = np.where(self._neck.speed_joints, 0.0, self._start_rad)
        data.ctrl[:], data.act[:] = commands, self._start_rad[self._neck.speed_joints]
        for actuator, start in enumerate(commands):
            samples = int(model.actuator_history[actuator, 0])
            if samples:
                # Before the first command the set-point is the initial position.
                mujoco.mj_initCtrlHistory(model, data, actuator, None, np.full((samples, 1), start))
        mujoco.mj_forward(model, data)
        self._mujoco, self._data, self._order = mujoco, data, order
        self._start_s, self._steps = self._clock_s(), 0

    def read_state(self) -> JointState | None:
        """See `gazempc.robots.robot.Robot.read_state`; the velocity is without noise."""
        true = self.true_state()
        if not self._neck.reports_joints:
            return None
        return replace(true, position_rad=true.position_rad + self._rng.normal(0.0, self._noise_rad))

    def true_state(self) -> JointState:
        """True joint state; raises as `read_state`."""
        time_s = self._advance()
        return JointState(time_s, self._data.qpos[self._order], self._data.qvel[self._order])

    def send_command(self, command: FloatArray) -> FloatArray:
        """See `gazempc.robots.robot.Robot.send_command`."""
        check_command(command, self._neck.joints)
        self._advance()
        sent: FloatArray = np.clip(command, *self._sendable)
        self._data.ctrl[:] = sent
        return sent

    def close(self) -> None:
        """Stop the simulation; see `gazempc.robots.robot.Robot.close`."""
        self._data = None

    def _advance(self) -> float:
        data, now_s = self.data, self._clock_s()
        elapsed = (now_s - self._start_s) / self._step_s
        if not elapsed >= self._steps - _SAME_STEP:
            reached_s = self._start_s + self._steps * self._step_s
            raise RobotError(f"the clock of the MuJoCo neck cannot run backwards: {reached_s} s -> {now_s} s")
        todo = math.floor(elapsed + _SAME_STEP) - self._steps
        if todo > 0:
            self._mujoco.mj_step(data.model, data, todo)
            self._steps += todo
        # On a step the clock's value itself: with a rounding error it would count as an old measurement.
        on_step = abs(elapsed - self._steps) < _SAME_STEP
        return now_s if on_step else self._start_s + self._steps * self._step_s


def timestep_s(neck: NeckSpec) -> float:
    """Time step of the simulation: 1 ms or a little less, so that a servo period is a whole number of steps.

    Args:
        neck: The neck.

    Returns:
        The step, seconds; smaller for a servo too fast for 1 ms.
    """
    fastest_rad_s = max(axis.natural_frequency_rad_s for axis in neck.axes)
    # Largest step times natural frequency, for accuracy and stability.
    largest_s = min(1e-3, 0.02 / fastest_rad_s)
    return neck.servo_period_s / math.ceil(neck.servo_period_s / largest_s - 1e-9)


def neck_mjcf(neck: NeckSpec) -> str:
    """Write a neck as an MJCF model, to be simulated or opened in MuJoCo's viewer.

    The world frame is the base frame (x forward, y left, z up, origin at the pan axis). Joints and actuators are named
    as in `NeckSpec.joint_names`, the actuators in that order; they take positions in radians. The camera is named
    ``eye``. Both eyes are drawn as one.

    An actuator models a geared position servo: spring and damper on the joint's inertia J with the head straight ahead.
    Stiffness kp = J wn^2, damping kv = 2 zeta wn J. Weight is compensated (a balanced head). A dead time shorter than
    one step acts as one step, the minimum delay of MuJoCo.

    Args:
        neck: The neck.

    Returns:
        The model, XML.
    """
    step_s = timestep_s(neck)
    tilt_axis, eye = neck.geometry.tilt_axis_in_pan_m, neck.geometry.eye_in_tilt_m
    # The head's mass is around the eye: without offsets it is on both axes, and the servos are exactly as specified.
    x, y, z = eye
    turned_kg_m2 = _YOKE_KG_M2 + _HEAD_KG_M2 + _HEAD_KG * ((tilt_axis[0] + x) ** 2 + (tilt_axis[1] + y) ** 2)
    kg_m2 = dict.fromkeys(EYE_AXES, _EYE_ARMATURE_KG_M2 + _EYE_KG_M2) | {
        "pan": _ARMATURE_KG_M2 + turned_kg_m2,
        "tilt": _ARMATURE_KG_M2 + _HEAD_KG_M2 + _HEAD_KG * (x**2 + z**2),
        BODY_AXIS: _ARMATURE_KG_M2 + _TORSO_KG_M2 + turned_kg_m2,
    }
    servos = "\n".join(
        f'    <general name="{name}" joint="{name}" {_servo(axis, kg_m2[name], step_s)}/>'
        for name, axis in zip(neck.joint_names, neck.axes, strict=True)
    )
    body = _body(neck)
    head_kg = _HEAD_KG - (0.0 if neck.eyes is None else _EYE_KG)
    return f"""<mujoco model={quoteattr(f"gazempc neck {neck.name}")}>
  <compiler angle="radian" autolimits="true"/>
  <!-- RK4: a first-order step leads by half a step and reduces the damping by zeta wn h -->
  <option timestep="{step_s!r}" integrator="RK4"/>
  <default>
    <!-- No contacts: parts of the neck overlap. -->
    <geom contype="0" conaffinity="0"/>
    <!-- Hard stops at the ends of the range. -->
    <joint type="hinge" solreflimit="0.003 1" solimplimit="0.99 0.9999 0.0001"/>
  </default>
  <visual>
    <global offwidth="1280" offheight="960"/>
    <map znear="0.005"/>
  </visual>
  <worldbody>
    <light directional="true" pos="0 0 3" dir="-0.3 -0.2 -1"/>
    <geom name="floor" type="plane" pos="0 0 -1.2" size="5 5 0.1" rgba="0.7 0.7 0.65 1"/>
    <geom name="column" type="cylinder" fromto="0 0 -1.2 0 0 -0.12" size="0.05" rgba="0.3 0.3 0.35 1"/>
    {body}
    <body name="yoke" gravcomp="1">
      <inertial pos="0 0 0" mass="{_YOKE_KG}" diaginertia="{_YOKE_KG_M2} {_YOKE_KG_M2} {_YOKE_KG_M2}"/>
      <joint name="pan" axis="0 0 1" {_joint(neck.pan)}/>
      <geom type="cylinder" fromto="0 0 -0.12 0 0 -0.08" size="0.04" rgba="0.8 0.5 0.2 1"/>
      <geom type="capsule" fromto="0 0 -0.1 {_vector(tilt_axis)}" size="0.02" rgba="0.8 0.5 0.2 1"/>
      <body name="head" pos="{_vector(tilt_axis)}" gravcomp="1">
        <inertial pos="{_vector(eye)}" mass="{head_kg}" diaginertia="{_HEAD_KG_M2} {_HEAD_KG_M2} {_HEAD_KG_M2}"/>
        <joint name="tilt" axis="0 -1 0" {_joint(neck.tilt)}/>
        <geom type="sphere" pos="{_vector((x - 0.08, y, z))}" size="{_HEAD_RADIUS_M}" rgba="0.9 0.9 0.9 1"/>
{_eyes(neck)}
      </body>
    </body>
    {"</body>" if body else ""}
  </worldbody>
  <actuator>
{servos}
  </actuator>
</mujoco>
"""


def _body(neck: NeckSpec) -> str:
    """Opening elements of the body under the neck; empty without one."""
    if neck.body is None:
        return ""
    return f"""<body name="torso" gravcomp="1">
      <inertial pos="0 0 -0.5" mass="{_TORSO_KG}" diaginertia="{_TORSO_KG_M2} {_TORSO_KG_M2} {_TORSO_KG_M2}"/>
      <joint name="{BODY_AXIS}" axis="0 0 1" {_joint(neck.body)}/>
      <geom type="box" pos="0 0 -0.35" size="0.09 0.16 0.2" rgba="0.5 0.5 0.6 1"/>"""


def _eyes(neck: NeckSpec) -> str:
    """Eyes and camera, in the head's frame."""
    x, y, z = neck.geometry.eye_in_tilt_m
    # In the face, so that head and eyes do not occlude the view.
    camera = '<camera name="eye" pos="{}" xyaxes="0 -1 0 0 0 1" fovy="60"/>'
    if neck.eyes is None:
        return f"""        <geom type="sphere" pos="{_vector((x, y + 0.035, z + 0.01))}" size="0.012" rgba="0 0 0 1"/>
        <geom type="sphere" pos="{_vector((x, y - 0.035, z + 0.01))}" size="0.012" rgba="0 0 0 1"/>
        {camera.format(_vector((x, y, z)))}"""
    pan, tilt = EYE_AXES
    return f"""        <body name="eyes" pos="{_vector((x, y, z))}" gravcomp="1">
          <inertial pos="0 0 0" mass="{_EYE_KG}" diaginertia="{_EYE_KG_M2} {_EYE_KG_M2} {_EYE_KG_M2}"/>
          <joint name="{pan}" axis="0 0 1" {_joint(neck.eyes.pan, _EYE_ARMATURE_KG_M2)}/>
          <joint name="{tilt}" axis="0 -1 0" {_joint(neck.eyes.tilt, _EYE_ARMATURE_KG_M2)}/>
          <geom type="sphere" size="{_EYE_RADIUS_M}" rgba="1 1 1 1"/>
          <geom type="sphere" pos="0.012 0 0" size="0.011" rgba="0 0 0 1"/>
          {camera.format("0 0 0")}
        </body>"""


def _joint(axis: Axis, armature_kg_m2: float = _ARMATURE_KG_M2) -> str:
    low, high = math.radians(axis.position_min_deg), math.radians(axis.position_max_deg)
    return f'range="{low!r} {high!r}" armature="{armature_kg_m2}"'


def _servo(axis: Axis, inertia_kg_m2: float, step_s: float) -> str:
    kp = inertia_kg_m2 * axis.natural_frequency_rad_s**2
    kv = inertia_kg_m2 * 2.0 * axis.damping_ratio * axis.natural_frequency_rad_s
    # A load is a constant torque, balanced by the servo's stiffness.
    load_n_m = kp * math.radians(axis.load_offset_deg)
    low, high = math.radians(axis.position_min_deg), math.radians(axis.position_max_deg)
    servo = f'biastype="affine" gainprm="{kp!r}" biasprm="{load_n_m!r} {-kp!r} {-kv!r}"'
    if axis.takes_speed:
        # The activation is the integral of the speed, and the servo follows it.
        most = axis.velocity_max_rad_s
        servo += f' dyntype="integrator" actrange="{low!r} {high!r}" ctrlrange="{-most!r} {most!r}"'
    else:
        servo += f' ctrlrange="{low!r} {high!r}"'
    if axis.dead_time_s == 0.0:
        return servo
    # Interpolated, because times are sums of steps: with hold, a rounding error would shift samples by a whole step,
    # and a dead time that is not an integer number of steps would be rounded up.
    samples = math.ceil(axis.dead_time_s / step_s) + 3
    # Linear interpolation leads zero-order hold by half a step.
    delay_s = axis.dead_time_s + 0.5 * step_s
    return f'{servo} delay="{delay_s!r}" nsample="{samples}" interp="linear"'


def _vector(vector: tuple[float, float, float]) -> str:
    return " ".join(repr(float(x)) for x in vector)
