"""Reachy Mini over its daemon's websocket: recorded frames, faults, and the real daemon where installed."""

import json
import math
import os
import shutil
import socket
import subprocess
import threading
import time
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest
from builders.ports import free_port
from builders.robots import with_both
from builders.waiting import tried, wait_for
from hypothesis import given
from hypothesis import strategies as st
from reachy_mini_server import daemon, recorded
from scipy.spatial.transform import Rotation

from gazempc.errors import RobotError, SettingsError
from gazempc.neck.spec import load_neck
from gazempc.robots.options import ReachyMiniOptions
from gazempc.robots.reachy_mini import ReachyMiniNeck, clamp_to_head, head_angles, head_matrix

NECK, BODY = load_neck("reachy_mini"), load_neck("reachy_mini_body")
WIDE = with_both(NECK, position_min_deg=-170, position_max_deg=170)
SIDEWAYS = NECK.with_axes({"pan": NECK.pan.model_copy(update={"position_min_deg": 10.0})})
AT_ONCE = {"approach_speed_rad_s": 1e9}
angles = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5)).map(np.array)


def works(neck, command=(0.0, 0.0)):
    sent = tried(neck.send_command, np.array(command))
    return None if isinstance(sent, RobotError) else sent.tolist()


def refusal(neck, call="send_command"):
    answer = tried(neck.send_command, np.zeros(2)) if call == "send_command" else tried(neck.read_state)
    return str(answer) if isinstance(answer, RobotError) else None


@pytest.fixture
def server():
    with daemon() as it:
        yield it


@pytest.fixture
def make(server):
    made = []

    def new(neck=NECK, **options):
        made.append(
            ReachyMiniNeck(neck, time.monotonic, ReachyMiniOptions(**({"port": server.port} | AT_ONCE | options)))
        )
        made[-1].connect()
        return made[-1]

    yield new
    for neck in made:
        neck.close()


def pose(pan_deg, tilt_deg, roll_deg=0.0, at_m=(0.0, 0.0, 0.0)):
    """A head_pose message made by scipy; the daemon's pitch is positive down."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("ZYX", [pan_deg, -tilt_deg, roll_deg], degrees=True).as_matrix()
    matrix[:3, 3] = at_m
    return {"type": "head_pose", "head_pose": matrix.tolist()}


# ---------------------------------------------------------------- angles and poses


@given(position=angles, roll_rad=st.floats(-0.5, 0.5))
def test_poses_equal_scipy_and_invert_to_their_angles(position, roll_rad):
    expected = Rotation.from_euler("ZYX", [position[0], -position[1], 0.0])
    matrix = head_matrix(position)
    np.testing.assert_allclose(matrix[:3, :3], expected.as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(matrix[:3, 3], 0.0)
    np.testing.assert_array_equal(matrix[3], [0, 0, 0, 1])
    np.testing.assert_allclose(head_angles(matrix), position, atol=1e-9)
    rolled = np.eye(4)
    rolled[:3, :3] = (expected * Rotation.from_euler("x", roll_rad)).as_matrix()
    np.testing.assert_allclose(head_angles(rolled), position, atol=1e-9)


# Reach of the daemon's inverse kinematics (reachy-mini 1.13.0) with all motors within the limits of its model: tilt and
# the largest pan to both sides, degrees.
MEASURED = [(-40, 38.5), (-36, 47.5), (-28, 61.5), (0, 102.25), (32, 64.75), (40, 54)]


@pytest.mark.parametrize(("tilt_deg", "pan_deg"), MEASURED)
def test_clamped_poses_are_reachable_by_the_daemon_kinematics(tilt_deg, pan_deg):
    pan, tilt = np.rad2deg(clamp_to_head(np.deg2rad([179.0, tilt_deg])))
    assert tilt == pytest.approx(tilt_deg)
    assert min(pan_deg, 65.0) - 2.0 < pan < pan_deg


# ---------------------------------------------------------------- commands


def test_messages_equal_the_recording_and_the_last_is_flushed_on_close(server, make):
    """Commands of the recording, made by other code: the daemon's head moved left and up."""
    neck = make()
    for _, message in recorded("sent", "set_full_target")[::10]:
        angles_rad = head_angles(np.array(message["head"]).reshape(4, 4))
        np.testing.assert_allclose(neck.send_command(angles_rad), angles_rad, atol=1e-12)
        wait_for(lambda m=message: server.received and np.allclose(server.received[-1]["head"], m["head"]))
        got = server.received[-1]
        assert set(got) == set(message)
        assert (got["type"], got["body_yaw"]) == (message["type"], message["body_yaw"])
    neck.send_command(np.array([0.25, 0.0]))
    neck.close()
    np.testing.assert_allclose(head_angles(head_of(server.commands()[-1])), [0.25, 0.0], atol=1e-9)


def head_of(message):
    return np.array(message["head"]).reshape(4, 4)


@pytest.mark.parametrize(
    ("neck", "asked_deg", "sent_deg"),
    [
        (NECK, (-100, 90), (-60, 35)),
        (WIDE, (-100, -40), (-38, -40)),
        (WIDE, (10, 80), (10, 40)),
        (BODY, (70, 10, 170), (60, 10, 160)),
    ],
)
def test_commands_are_clamped_to_the_neck_and_to_the_head(server, make, neck, asked_deg, sent_deg):
    """The daemon's head pose is in a frame that does not turn: its yaw is that of body and head together."""
    sent = make(neck).send_command(np.deg2rad(asked_deg))
    np.testing.assert_allclose(np.rad2deg(sent), sent_deg, atol=1e-9)
    message, (pan_deg, tilt_deg, body_deg) = server.commands()[-1], (*sent_deg, 0)[:3]
    assert message["body_yaw"] == pytest.approx(math.radians(body_deg))
    expected = Rotation.from_euler("ZYX", [pan_deg + body_deg, -tilt_deg, 0], degrees=True).as_matrix()
    np.testing.assert_allclose(head_of(message)[:3, :3], expected, atol=1e-9)


def test_the_first_commands_approach_from_the_measured_pose(server, make):
    server.frames["head_pose"] = pose(-20, 10)
    neck = make(approach_speed_rad_s=0.5)
    step = 0.5 * NECK.servo_period_s
    target = np.deg2rad([30.0, 10.0])
    sent = [neck.send_command(target) for _ in range(200)]
    assert sent[0] == pytest.approx([math.radians(-20.0) + step, math.radians(10.0)])
    assert np.max(np.abs(np.diff(sent, axis=0))) <= step + 1e-12
    np.testing.assert_array_equal(sent[-1], target)
    # After the approach, the smoother alone shapes the motion.
    np.testing.assert_array_equal(neck.send_command(np.zeros(2)), [0.0, 0.0])


# ---------------------------------------------------------------- state


def test_the_state_equals_the_recorded_head(server, make):
    """Played back in time; yaw and pitch by scipy, velocity by a parabola through the recording."""
    poses = recorded("received", "head_pose")
    matrices = np.array([message["head_pose"] for _, message in poses])
    angles_deg = Rotation.from_matrix(matrices[:, :3, :3]).as_euler("ZYX", degrees=True)
    assert angles_deg[-1, 0] > 15.0
    assert angles_deg[-1, 1] < -7.0
    neck = make()
    for k in (0, len(poses) // 2, len(poses) - 1):
        server.frames["head_pose"] = poses[k][1]
        expected = np.deg2rad([angles_deg[k, 0], -angles_deg[k, 1]])
        wait_for(lambda e=expected: (s := neck.read_state()) is not None and np.allclose(s.position_rad, e, atol=1e-6))


def test_velocity_and_time_of_a_turning_head(server, make):
    neck, speed, began_s = make(), np.array([0.4, -0.2]), time.monotonic()
    turned = lambda: json.dumps(pose(*np.rad2deg(speed * (time.monotonic() - began_s))))  # noqa: E731
    server.frames = SimpleNamespace(values=lambda: [turned()])

    def measured():
        state = neck.read_state()
        if state is not None and time.monotonic() - began_s > 0.5:
            # The position encodes its time: an arrival may be late, never early.
            late_s = state.time_s - began_s - state.position_rad[0] / speed[0]
            assert late_s > -1e-3
            return late_s < 0.05 and np.allclose(state.velocity_rad_s, speed, rtol=0.2)
        return None

    wait_for(measured, 5.0)


NO_POSES = ([1.0, 1.0, 1.0], [math.nan] * 4, [1.0, 1.0, -1.0, 1.0], [2.0, 2.0, 2.0, 1.0])


def test_unreadable_messages_are_skipped(server, make):
    server.extra = ["", "{", "[1]", '"x"', "null", b"\xff\x00", '{"type": "new"}', '{"type": "head_pose"}',
                    '{"type": "head_pose", "head_pose": "left"}', '{"type": "head_pose", "head_pose": [[1, 2], [3]]}',
                    *(json.dumps({"type": "head_pose", "head_pose": np.diag(each).tolist()}) for each in NO_POSES),
                    '{"type": "head_pose", "head_pose": [[' + "9" * 400 + "]]}", "[" * 50_000,
                    '{"type": "joint_positions"}', '{"type": "daemon_status"}']  # fmt: skip
    server.frames["head_pose"] = pose(12, -7)
    neck = make()
    for _ in range(5):
        state = wait_for(neck.read_state)
        np.testing.assert_allclose(np.rad2deg(state.position_rad), [12, -7], atol=1e-9)
    neck.send_command(np.array([0.1, 0.0]))
    assert len(server.commands()) == 1


# ---------------------------------------------------------------- faults


def test_a_missing_daemon_is_reported_with_address_and_start_command():
    port = free_port()
    neck = ReachyMiniNeck(NECK, time.monotonic, ReachyMiniOptions(port=port))
    with pytest.raises(RobotError, match=rf"ws://127.0.0.1:{port}/ws/sdk .*efused.*reachy-mini-daemon"):
        neck.connect()
    with pytest.raises(RobotError, match=r"call connect\(\) first"):
        neck.read_state()
    assert no_threads_left()


def test_a_command_on_a_lost_connection_raises_and_reconnects(server, make):
    neck = make(approach_speed_rad_s=0.5)
    while not np.array_equal(neck.send_command(np.array([0.3, 0.0])), [0.3, 0.0]):
        pass
    server.stop()
    for call in ("send_command", "read_state"):
        message = wait_for(lambda c=call: refusal(neck, c))
        assert f"ws://127.0.0.1:{server.port}/ws/sdk" in message
    before = len(server.commands())
    server.frames["head_pose"] = pose(-5, 0)
    server.start()
    sent = wait_for(lambda: works(neck, (0.3, 0.0)))
    # After a loss the pose is unknown: a new approach, without old commands.
    assert sent[0] == pytest.approx(math.radians(-5) + 0.5 * NECK.servo_period_s)
    assert wait_for(neck.read_state) is not None
    late = head_angles(head_of(server.commands()[before]))
    np.testing.assert_allclose(late, sent, atol=1e-9)


@pytest.mark.slow
def test_silence_gives_no_reading_then_raises_and_recovers(server, make):
    neck = make()
    wait_for(neck.read_state)
    time.sleep(0.1)
    server.silent = True
    time.sleep(0.4)
    with suppress(RobotError):  # after a pause of a busy machine
        # The last pose is unread, but stale.
        assert neck.read_state() is None
    wait_for(lambda: (m := refusal(neck)) and "head_pose" in m)
    server.silent = False
    wait_for(lambda: works(neck))


@pytest.mark.slow
def test_a_daemon_without_reception_does_not_block_the_loop(server, make, monkeypatch):
    """With a send buffer of 8 kB, which fills within a second."""
    connect = socket.create_connection

    def with_small_buffer(*arguments, **options):
        connection = connect(*arguments, **options)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
        return connection

    monkeypatch.setattr(socket, "create_connection", with_small_buffer)
    neck = make()
    server.deaf.set()
    longest_s = 0.0

    def refused():
        nonlocal longest_s
        began_s = time.monotonic()
        message = refusal(neck)
        longest_s = max(longest_s, time.monotonic() - began_s)
        return message

    assert f"ws://127.0.0.1:{server.port}" in wait_for(refused, step=lambda: None)
    # A blocking send would never return.
    assert longest_s < 20.0
    began_s = time.monotonic()
    neck.close()
    assert time.monotonic() - began_s < 60.0
    assert wait_for(no_threads_left)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"backend_status": {"motor_control_mode": "disabled", "error": None}}, "motors are 'disabled'.*wake"),
        ({"backend_status": {"motor_control_mode": "enabled", "error": "No response"}}, "reports: No response"),
        ({"state": "error", "error": "no serial port"}, "'error', not 'running': no serial port"),
    ],
)
def test_a_disabled_robot_raises_until_enabled(server, make, change, what):
    well = server.frames["daemon_status"]
    server.frames["daemon_status"] = well | change
    with pytest.raises(RobotError, match=what):
        make()
    server.frames["daemon_status"] = well
    neck = make()
    server.frames["daemon_status"] = well | change
    wait_for(lambda: refusal(neck))
    # It still reports its position.
    assert wait_for(neck.read_state) is not None
    server.frames["daemon_status"] = well
    wait_for(lambda: works(neck))


@pytest.mark.parametrize(
    ("kind", "frame", "what"),
    [
        ("head_pose", pose(0, -24, at_m=(-0.021, 0.001, -0.044)), "wake the robot"),
        ("joint_positions", {"head_joint_positions": [0.5] + [0.6] * 6}, "body is turned by 29 deg"),
    ],
)
def test_a_sleeping_head_and_a_turned_body_cause_no_jump(server, make, kind, frame, what):
    server.frames[kind] = server.frames[kind] | frame
    with pytest.raises(RobotError, match=what):
        make()
    assert server.commands() == []


@pytest.mark.parametrize(
    ("neck", "match"), [(load_neck("reference_eyes"), "do not turn"), (SIDEWAYS, "must contain 0")]
)
def test_a_neck_with_eyes_or_without_straight_ahead_is_refused(neck, match):
    with pytest.raises(SettingsError, match=match):
        ReachyMiniNeck(neck, time.monotonic, ReachyMiniOptions())


def no_threads_left():
    ours = [t for t in threading.enumerate() if t.name.endswith(("(_listen)", "(_send)"))]
    return ours == []


# ---------------------------------------------------------------- the daemon itself


@pytest.fixture(scope="module")
def real_port(tmp_path_factory):
    program = shutil.which("reachy-mini-daemon")
    if program is None:
        pytest.skip("reachy-mini-daemon is not installed (pip install 'reachy-mini[mujoco]'); needs no robot")
    port, home = free_port(), tmp_path_factory.mktemp("home")
    command = [program, "--sim", "--headless", "--no-media", "--fastapi-port", str(port)]
    quiet = os.environ | {"DO_NOT_TRACK": "1", "HF_HUB_OFFLINE": "1", "HOME": str(home)}
    with (home / "log").open("w") as log, subprocess.Popen(command, stdout=log, stderr=log, env=quiet) as process:
        yield port
        process.terminate()


def test_the_simulated_head_of_the_daemon_reaches_its_commands(real_port):
    neck = ReachyMiniNeck(NECK, time.monotonic, ReachyMiniOptions(port=real_port))
    wait_for(lambda: not isinstance(tried(neck.connect), RobotError), 90.0)
    # The daemon ignores targets during its wake-up motion.
    time.sleep(4.0)
    try:
        for target_deg in [(20, 0), (-20, 0), (0, 15), (0, -15), (50, 30), (-50, -25), (0, 0)]:
            target = np.deg2rad(target_deg)

            def near(target=target):
                neck.send_command(target)
                time.sleep(0.02)
                state = neck.read_state()
                # The simulated joints have dry friction: they stop short by up to a tenth.
                return state is not None and np.all(np.abs(state.position_rad - target) < 0.1 * np.abs(target) + 0.03)

            wait_for(near, why=f"{target_deg} deg")
    finally:
        neck.close()
