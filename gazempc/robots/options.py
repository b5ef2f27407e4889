"""Options of the shipped robots, and the type of a robot's name."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field, field_validator

from gazempc.parts import ROBOT, check_choice
from gazempc.ros2.messages import PoseType
from gazempc.settings import Settings, on_command_line

# A shipped name, or module:Class for a user-defined robot.
RobotChoice = Annotated[str, AfterValidator(partial(check_choice, ROBOT)), on_command_line(ROBOT)]


_MotorId = Annotated[int, Field(ge=0, le=252)]
# Bounds within which no position contains the bytes of a packet header, which the library does not mask (-131,073).
_Ticks = Annotated[int, Field(ge=-65_536, le=65_536)]


class DynamixelOptions(Settings):
    """Robot `dynamixel`; see `gazempc.robots.dynamixel.DynamixelNeck`."""

    port: str = Field(default="/dev/ttyUSB0", description="Serial port")
    baud_rate_bps: int = Field(default=1_000_000, gt=0, description="As set in the motors")
    motor_ids: tuple[_MotorId, ...] = Field(default=(1, 2), description="Pan, tilt, then eyes and body if any")
    zero_ticks: tuple[_Ticks, ...] = Field(default=(2048, 2048), description="Position of angle 0, 4096 ticks a turn")
    directions: tuple[Literal[-1, 1], ...] = Field(
        default=(1, 1), description="1 if more ticks turn left or up, else -1"
    )
    reply_timeout_ms: float = Field(default=4.0, gt=0, le=5000, description="Timeout of a reply")
    approach_speed_rad_s: float = Field(default=0.5, gt=0, description="Speed of the motion to the first command")
    torque_off_on_close: bool = Field(default=False, description="Switch the torque off at the end")


class Ros2Options(Settings):
    """Robot and source `ros2`; see `gazempc.robots.ros2.Ros2Neck`."""

    use_sim_time: bool = Field(default=False, description="Use the topic /clock of a simulator or a bag for stamps")
    joint_names: tuple[str, ...] = Field(
        default=("head_pan_joint", "head_tilt_joint"), description="Pan and tilt, then eyes and body if any"
    )
    joint_signs: tuple[float, ...] = Field(
        default=(1.0, 1.0), description="Sign of each joint: -1 if positive to the right, or down"
    )
    command_topic: str = Field(default="/head_controller/joint_trajectory", description="Topic of the commands")
    command_type: Literal["trajectory_msgs/msg/JointTrajectory", "std_msgs/msg/Float64MultiArray"] = Field(
        default="trajectory_msgs/msg/JointTrajectory", description="Type of the commands"
    )
    command_values: Literal["position", "velocity"] = Field(
        default="position",
        description="Content of a Float64MultiArray: positions, or velocities for a forward velocity controller",
    )
    state_topic: str = Field(default="/joint_states", description="Topic of the joint states")
    time_from_start_s: float | None = Field(
        default=None, gt=0, description="Time to reach a trajectory's point; default: half a servo period"
    )
    silent_after_s: float = Field(default=0.5, gt=0, description="Timeout of joint states")
    base_frame: str | None = Field(
        default=None, description="tf frame for people and points; default: the sensor's frame"
    )
    point_topic: str | None = Field(
        default=None, description="Topic of points (geometry_msgs/msg/PointStamped) to glance at; needs base_frame"
    )
    point_lasts_s: float = Field(default=1.0, gt=0, description="Duration of a glance at a point")
    sound_topic: str | None = Field(
        default=None,
        description="Topic of directions of speech (std_msgs/msg/Int32, degrees to the left), for --attend speaker",
    )
    sound_frame: str | None = Field(
        default=None, description="tf frame of the directions of speech; default: the base frame of the neck"
    )
    pose_type: PoseType = Field(
        default="geometry_msgs/msg/PoseStamped", description="Message type of the source's heads"
    )


class ReachyMiniOptions(Settings):
    """Robot `reachy_mini`; see `gazempc.robots.reachy_mini.ReachyMiniNeck`."""

    host: str = Field(default="127.0.0.1", description="Host of the daemon")
    port: int = Field(default=8000, gt=0, lt=65536, description="Port of the daemon")
    approach_speed_rad_s: float = Field(default=0.5, gt=0, description="Speed to the first command")


_Directions = tuple[Literal[-1, 1], Literal[-1, 1]]


class ViscaOptions(Settings):
    """Robot `visca`; see `gazempc.robots.visca.ViscaCamera`."""

    counts_per_deg: float = Field(default=14.4, gt=0, le=1000, description="Scale of the camera's position replies")
    directions: _Directions = Field(
        default=(1, 1), description="Signs of pan and tilt: -1 for a reversed axis, as under a ceiling"
    )


class OnvifOptions(Settings):
    """Robot `onvif`; see `gazempc.robots.onvif.OnvifCamera`."""

    login: Path | None = Field(
        default=None,
        description="File with user and password, a line each; default: the environment's GAZEMPC_ONVIF_USER and "
        "GAZEMPC_ONVIF_PASSWORD",
    )
    profile: str | None = Field(default=None, description="Token of the media profile; default: the first with PTZ")
    timeout_s: float = Field(default=1.0, gt=0, le=30, description="Timeout of a reply")
    directions: _Directions = Field(
        default=(1, 1), description="Signs of the speeds of pan and tilt: -1 for a reversed axis"
    )
    range_deg: tuple[float, float, float, float] | None = Field(
        default=None,
        description="Pan at positions -1 and 1, then tilt; default: the camera's positions are not used. Most cameras "
        "count pan to the right: 170 -170 -30 90",
    )

    @field_validator("range_deg")
    @classmethod
    def _ends_differ(cls, range_deg: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if range_deg is not None and (range_deg[0] == range_deg[1] or range_deg[2] == range_deg[3]):
            raise ValueError("the two ends of pan, and of tilt, must differ")
        return range_deg


class RobotOptions(Settings):
    """Options of the shipped robots, one field each. All other fields are options of user-defined parts."""

    model_config = ConfigDict(extra="allow")

    dynamixel: DynamixelOptions = DynamixelOptions()
    ros2: Ros2Options = Ros2Options()
    reachy_mini: ReachyMiniOptions = ReachyMiniOptions()
    visca: ViscaOptions = ViscaOptions()
    onvif: OnvifOptions = OnvifOptions()

    @property
    def own(self) -> dict[str, Any]:
        """Options of user-defined parts, by key."""
        return dict(self.model_extra or {})

    def with_own(self, own: dict[str, Any]) -> RobotOptions:
        """A copy with options of user-defined parts.

        Args:
            own: Values by key, from `gazempc.part_options.take_options`.

        Returns:
            The options.
        """
        return RobotOptions.model_validate({**own, **{name: getattr(self, name) for name in type(self).model_fields}})
