"""The real rclpy: other nodes on the loopback, in a domain of this test."""

import os
import time

import pytest

# Domains above 101 overlap with the ports that systems hand out.
DOMAIN = str(1 + os.getpid() % 100)
ENVIRONMENT = {
    "ROS_DOMAIN_ID": DOMAIN,
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
}
WHY = "no rclpy here: source ROS 2, or install ros/interfaces/kilted.txt and run ros/interfaces/build.py"


def rclpy_or_skip():
    """rclpy on the loopback; where CI asks for ROS (GAZEMPC_ROS), a missing one fails."""
    os.environ.update(ENVIRONMENT)
    try:
        import control_msgs.action
        import rclpy
    except ImportError:
        if os.environ.get("GAZEMPC_ROS"):
            raise
        pytest.skip(WHY, allow_module_level=True)
    assert control_msgs.action.PointHead
    return rclpy


def wait_for(condition, timeout_s=30.0, step=lambda: time.sleep(0.005), why="waited in vain"):
    """The value of a condition once it is true; `why` is the message of a failure, or returns it then."""
    until = time.monotonic() + timeout_s
    while not (found := condition()):
        assert time.monotonic() < until, why() if callable(why) else why
        step()
    return found
