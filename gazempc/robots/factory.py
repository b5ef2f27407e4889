"""Robots by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from gazempc.errors import SettingsError
from gazempc.live.clock import Clock, RealClock
from gazempc.neck.spec import NeckSpec
from gazempc.robots.dynamixel.robot import DynamixelNeck
from gazempc.robots.mujoco.robot import MujocoNeck
from gazempc.robots.reachy_mini.robot import ReachyMiniNeck
from gazempc.robots.robot import Robot
from gazempc.robots.ros2 import Ros2Neck
from gazempc.ros2.wire import Ros2Network
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import FloatArray, JointState

RobotName = Literal["simulated", "mujoco", "dynamixel", "ros2", "reachy_mini"]
# These keep the loop's time: they can be run on a simulated clock, and their true state is known.
SIMULATED: tuple[RobotName, ...] = ("simulated", "mujoco")


class _Options(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class DynamixelOptions(_Options):
    """Robot `dynamixel`; see `gazempc.robots.dynamixel.robot.DynamixelNeck`."""

    port: str = Field(default="/dev/ttyUSB0", description="Serial port")
    baud_rate_bps: int = Field(default=1_000_000, gt=0, description="As set in the motors")
    motor_ids: tuple[int, int] = Field(default=(1, 2), description="Of pan and tilt")
    zero_ticks: tuple[int, int] = Field(default=(2048, 2048), description="Position of angle 0, 4096 ticks a turn")
    directions: tuple[int, int] = Field(default=(1, 1), description="1 if more ticks turn left or up, else -1")
    reply_timeout_ms: float = Field(default=4.0, gt=0, le=1000, description="How long one call waits for an answer")
    approach_speed_rad_s: float = Field(default=0.5, gt=0, description="Speed to the first command after power-up")
    torque_off_on_close: bool = Field(default=False, description="Let the head go limp at the end")


class Ros2Options(_Options):
    """Robot and source `ros2`; see `gazempc.robots.ros2.Ros2Neck`."""

    endpoint: str = Field(default="tcp/localhost:7447", description="Zenoh router")
    domain_id: int = Field(default=0, ge=0, description="ROS_DOMAIN_ID")
    humble: bool = Field(default=False, description="Whether the other nodes are of ROS 2 Humble")
    joint_names: tuple[str, str] = Field(default=("head_pan_joint", "head_tilt_joint"), description="Pan and tilt")
    joint_signs: tuple[float, float] = Field(
        default=(1.0, 1.0), description="-1 for a joint that is positive to the right, or down"
    )
    command_topic: str = Field(default="/head_controller/joint_trajectory", description="Where commands go")
    command_type: Literal["trajectory_msgs/msg/JointTrajectory", "std_msgs/msg/Float64MultiArray"] = Field(
        default="trajectory_msgs/msg/JointTrajectory", description="Of which type they are"
    )
    state_topic: str = Field(default="/joint_states", description="Where joint states come from")
    time_from_start_s: float | None = Field(
        default=None, gt=0, description="When a trajectory's point is to be reached; without it a servo period"
    )
    silent_after_s: float = Field(default=0.5, gt=0, description="Without a joint state for so long: not answering")


class ReachyMiniOptions(_Options):
    """Robot `reachy_mini`; see `gazempc.robots.reachy_mini.robot.ReachyMiniNeck`."""

    host: str = Field(default="127.0.0.1", description="Where its daemon runs")
    port: int = Field(default=8000, gt=0, lt=65536, description="Port of the daemon")
    approach_speed_rad_s: float = Field(default=0.5, gt=0, description="Speed to the first command")


class RobotOptions(_Options):
    """Options of all robots; each reads its own."""

    dynamixel: DynamixelOptions = DynamixelOptions()
    ros2: Ros2Options = Ros2Options()
    reachy_mini: ReachyMiniOptions = ReachyMiniOptions()


def make_robot(
    name: RobotName, options: RobotOptions, neck: NeckSpec, clock: Clock, position_rad: FloatArray, seed: int = 0
) -> Robot:
    """Make a robot; it is not connected yet.

    Args:
        name: Which one.
        options: Its options are in here.
        neck: Its limits; of a simulated one all that it is.
        clock: The loop's clock.
        position_rad: Where a simulated one stands in the beginning, shape (2,), radians.
        seed: Of a simulated one's encoder noise.

    Returns:
        The robot.

    Raises:
        SettingsError: If an option is wrong, or a robot that keeps real time is given another clock.
    """
    if name == "mujoco":
        return MujocoNeck(neck, clock.now_s, position_rad, seed)
    if name == "dynamixel":
        return DynamixelNeck(neck, clock.now_s, **options.dynamixel.model_dump())
    if name == "reachy_mini":
        return ReachyMiniNeck(neck, clock.now_s, **options.reachy_mini.model_dump())
    if name == "ros2":
        if not isinstance(clock, RealClock):
            raise SettingsError("robot ros2 keeps real time")
        own = options.ros2
        return Ros2Neck(
            neck,
            clock.now_s,
            clock.from_unix_s,
            network=ros2_network(own),
            **own.model_dump(exclude={"endpoint", "domain_id", "humble"}),
        )
    return SimulatedNeck(neck, position_rad, clock.now_s, seed)


def ros2_network(options: Ros2Options) -> Ros2Network:
    """How ROS 2 is reached."""
    return Ros2Network(options.endpoint, options.domain_id, options.humble)


def true_state_of(robot: Robot) -> Callable[[], JointState] | None:
    """How to ask a simulated robot where its joints really are; None for a robot that nobody can ask."""
    return robot.true_state if isinstance(robot, SimulatedNeck | MujocoNeck) else None
