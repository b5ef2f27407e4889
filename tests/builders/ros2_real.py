"""The real rclpy: nodes on the loopback, in a domain of this test."""

import os

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
