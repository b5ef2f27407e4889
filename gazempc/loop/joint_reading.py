"""Reads the joints of a robot, whatever its driver raises or returns."""

from __future__ import annotations

from gazempc.loop.events import Event
from gazempc.loop.recorder import LoopRecorder
from gazempc.robots.robot import Robot
from gazempc.types import JointState


def read_joints(robot: Robot, joints: int, time_s: float, recorder: LoopRecorder) -> JointState | None:
    """Read the joints.

    A driver is to raise `RobotError` only. The loop goes on with any exception, and with readings of wrong shapes.

    Args:
        robot: The robot.
        joints: Number of the neck's joints.
        time_s: The time, seconds.
        recorder: Records the event `robot_not_answering`.

    Returns:
        The reading; None if there is none, or none that can be used.
    """
    try:
        state = robot.read_state()
        if state is None:
            return None
        float(state.time_s)
        shapes = state.position_rad.shape, state.velocity_rad_s.shape
        needed = (joints,)
        if shapes != (needed, needed):
            raise ValueError(f"read_state() returned position and velocity of shapes {shapes}, needed is {needed} each")
    except Exception as error:
        recorder.event(time_s, Event.ROBOT_NOT_ANSWERING, error)
        return None
    return state
