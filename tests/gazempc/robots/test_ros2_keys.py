"""Keys and attachments of ROS 2 over Zenoh, as rmw_zenoh writes them."""

import pytest
import zenoh
from builders.ros2_wire import HASHES, key

from gazempc.ros2 import wire as ros2_wire


def test_key_is_the_example_of_rmw_zenoh():
    expected = "2/robot1/chatter/std_msgs::msg::dds_::String_/RIHS01_" + HASHES["std_msgs/msg/String"]
    assert ros2_wire.topic_key(2, ros2_wire.topic_name("robot1/chatter"), "std_msgs/msg/String") == expected


def test_attachment_is_that_of_rmw_zenoh():
    gid = bytes(range(16))
    assert ros2_wire.attachment(258, -2, gid).hex() == "0201000000000000" + "feffffffffffffff" + "10" + gid.hex()
    # Zenoh's own serialiser, which rmw_zenoh uses, agrees.
    by_zenoh = zenoh.ext.z_serialize((zenoh.ext.Int64(258), zenoh.ext.Int64(-2), gid))
    assert ros2_wire.attachment(258, -2, gid) == by_zenoh.to_bytes()


@pytest.mark.parametrize("type_name", HASHES)
def test_keys_are_those_of_ros(type_name):
    assert ros2_wire.topic_key(0, "/head/command", type_name) == key(0, "head/command", type_name)
    humble = ros2_wire.topic_key(7, "/head/command", type_name, humble=True)
    assert humble == key(7, "head/command", type_name, "TypeHashNotSupported")
