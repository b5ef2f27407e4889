"""Robots: what executes the commands."""

from gazempc.robots.robot import JointState, Robot
from gazempc.robots.simulated import SimulatedNeck

__all__ = ["JointState", "Robot", "SimulatedNeck"]
