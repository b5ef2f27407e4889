"""A neck simulated by MuJoCo: an independent plant model, for validation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from gazempc.errors import RobotError, importing
from gazempc.neck.spec import NeckSpec
from gazempc.robots.mujoco_model import neck_mjcf, timestep_s
from gazempc.robots.robot import check_command
from gazempc.types import FloatArray, JointState

# Tolerance for rounding of a clock, in steps.
_SAME_STEP = 1e-6


class MujocoNeck:
    """Hinges with position or speed servos and MuJoCo's actuator delay, in lock-step with a clock.

    Each method call simulates up to the clock's time, in complete steps of `gazempc.robots.mujoco_model.timestep_s`.
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
    def model(self) -> Any:
        """The ``mujoco.MjModel`` of the simulation, for viewers and renderers; RobotError if not connected."""
        return self.data.model

    @property
    def data(self) -> Any:
        """The ``mujoco.MjData`` of the simulation, for viewers (read-only); RobotError if not connected."""
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
