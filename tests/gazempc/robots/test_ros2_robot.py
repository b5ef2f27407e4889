"""The robot ros2 against a neck that knows the wire only: commands, joint states, and what cannot be used."""

import struct
import time

import numpy as np
import pytest
import zenoh
from builders.ros2_network import NECK, quiet, wait_for, zenoh_listener
from builders.ros2_wire import (
    GOOD,
    POSITIONS,
    UNIX_START_S,
    joint_state,
    key,
    read_positions,
    read_trajectory,
)

from gazempc.errors import RobotError
from gazempc.neck.spec import load_neck


@pytest.mark.slow
def test_every_command_arrives_in_order_and_is_what_was_returned(scene):
    robot = scene.connected(time_from_start_s=1.25)
    began_ns = time.time_ns()
    rng = np.random.default_rng(1)
    asked = rng.uniform(-2.0, 2.0, (250, 2))  # most are beyond the limits
    returned, samples = [], []
    for rad in asked:
        # In step: of a burst that a busy computer cannot get rid of, Zenoh drops some, as no command may wait.
        returned.append(robot.send_command(rad))
        samples.append(wait_for(scene.commands.try_recv))
    assert np.array_equal(returned, np.clip(asked, NECK.position_min_rad, NECK.position_max_rad))
    for number, (sample, rad) in enumerate(zip(samples, returned, strict=True), start=1):
        found = read_trajectory(sample.payload.to_bytes())
        assert found == {
            "stamp": (0, 0),
            "frame_id": "",
            "names": ["pan", "tilt"],
            "positions": list(rad),
            "rest": [[], [], []],
            "time_from_start": (1, 250_000_000),
        }
        sequence, sent_ns, gid_size = struct.unpack_from("<qqB", sample.attachment.to_bytes())
        assert (sequence, gid_size, len(sample.attachment)) == (number, 16, 33)
        assert began_ns <= sent_ns <= time.time_ns()
    assert len({sample.attachment.to_bytes()[17:] for sample in samples}) == 1


def test_bare_positions_with_a_joint_that_turns_the_other_way(scene):
    scene.commands = scene.router.declare_subscriber(key(0, "head/command", POSITIONS), zenoh.handlers.FifoChannel(9))
    robot = scene.connected(command_type=POSITIONS, joint_signs=(1, -1))
    assert np.array_equal(robot.send_command(np.array([0.3, 0.2])), [0.3, 0.2])
    assert np.array_equal(robot.send_command(np.array([9.0, 9.0])), NECK.position_max_rad)
    first, second = (read_positions(sample.payload.to_bytes()) for sample in scene.sent(2))
    assert first == [0.3, -0.2]
    assert second == [NECK.position_max_rad[0], -NECK.position_max_rad[1]]
    scene.states.put(joint_state([0.1, 0.2], velocities=[1.0, 2.0]))
    state = wait_for(robot.read_state)
    assert (list(state.position_rad), list(state.velocity_rad_s)) == ([0.1, -0.2], [1.0, -2.0])


def test_joint_states_of_eyes_are_found_by_name(scene):
    names = ["pan", "tilt", "eyes_version", "eyes_tilt"]
    robot = scene.neck(load_neck("reference_eyes"), joint_names=tuple(names), joint_signs=(1, 1, -1, 1))
    with zenoh_listener(scene.states, joint_state([0.4, 0.1, 0.2, 0.3], ["eyes_tilt", *names[:3]])):
        robot.connect()
        state = wait_for(robot.read_state)
    assert list(state.position_rad) == [0.1, 0.2, -0.3, 0.4]
    assert np.isnan(state.velocity_rad_s).all()
    assert state.velocity_rad_s.shape == (4,)


@pytest.mark.parametrize("bad", [[np.nan, 0.0], [0.0, np.inf], [0.0], [0.0, 0.0, 0.0]])
def test_a_command_that_is_none_is_refused_and_not_sent(scene, bad):
    robot = scene.connected()
    with pytest.raises(RobotError, match="refused"):
        robot.send_command(np.array(bad))
    robot.send_command(np.array([0.1, 0.1]))
    scene.sent(1)


def test_joint_states_by_name_with_their_own_time(scene):
    robot = scene.connected()
    assert robot.read_state() is None
    names = ["wheel", "tilt", "arm", "pan"]
    scene.states.put(joint_state([9.0, 0.25, 8.0, -0.5], names, [9.0, 2.0, 8.0, 1.0]))
    state = wait_for(robot.read_state)
    assert state.time_s == 300.25
    assert list(state.position_rad) == [-0.5, 0.25]
    assert list(state.velocity_rad_s) == [1.0, 2.0]
    assert robot.read_state() is None
    assert robot.ignored == 0


UNUSABLE = {
    "no joint 'tilt', only pan, neck": joint_state([0.1, 0.2], names=["pan", "neck"]),
    "2 names and 1 positions": joint_state([0.1]),
    "not finite": joint_state([0.1, np.nan]),
    "no time stamp": joint_state([0.1, 0.2], stamp=(0, 0)),
    r"-300.3 s from this computer's clock": joint_state([0.1, 0.2], stamp=(UNIX_START_S, 0)),
    r"\+9.7 s from this computer's clock": joint_state([0.1, 0.2], stamp=(UNIX_START_S + 310, 0)),
    "not newer": joint_state([0.1, 0.2], stamp=(UNIX_START_S + 298, 0)),
    "not a sensor_msgs/msg/JointState in CDR": b"",
    "not a sensor_msgs/msg/JointState in CD": GOOD[:-9],
    "not a sensor_msgs/msg/JointState in C": b"\0\3" + GOOD[2:],  # another encapsulation
    "not a sensor_msgs/msg/JointState in": GOOD + bytes(8),
    # 2 billion names
    "not a sensor_msgs/msg/JointState": GOOD[:24] + b"\xff\xff\xff\x7f" + GOOD[28:],
}


@pytest.mark.parametrize("reason", UNUSABLE)
def test_what_cannot_be_used_is_counted_and_its_reason_named(scene, reason):
    robot = scene.connected()
    scene.states.put(UNUSABLE[reason])
    wait_for(lambda: robot.read_state() or robot.ignored)
    assert robot.ignored == 1
    assert robot.read_state() is None
    scene.now_s += 0.6
    with pytest.raises(RobotError, match=rf"no joint state on /joint_states .* not used: .*{reason}"):
        robot.read_state()
    scene.states.put(joint_state([0.1, 0.2], stamp=(UNIX_START_S + 300, 500_000_000)))
    assert wait_for(lambda: quiet(robot.read_state)).time_s == 300.5


def test_silence_is_an_error_until_the_robot_speaks_again(scene):
    robot = scene.connected(silent_after_s=0.4)
    scene.now_s += 0.39
    assert robot.read_state() is None
    scene.now_s += 0.02
    with pytest.raises(RobotError, match=r"no joint state on /joint_states for more than 0\.4 s"):
        robot.read_state()
    # It comes back with a clock that is behind: what it says now counts.
    scene.states.put(joint_state([0.1, 0.2], stamp=(UNIX_START_S + 297, 0)))
    assert wait_for(lambda: quiet(robot.read_state)).time_s == 297.0
    assert robot.read_state() is None


def test_a_neck_without_encoders_asks_for_no_joint_states(scene):
    neck = NECK.model_copy(update={"reports_joints": False})
    robot = scene.connected(neck)
    scene.now_s += 100.0
    assert robot.read_state() is None
    assert not scene.states.matching_status.matching
    robot.send_command(np.zeros(2))
    scene.sent(1)
