"""VISCA over IP against the bytes of the manuals, and over networks that lose, delay and reorder packets."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager

import numpy as np
import pytest
from builders.visca import PTZ, QUICK, BadNetwork, camera, connected, feed
from builders.waiting import tried, wait_for
from hypothesis import given
from hypothesis import strategies as st

from gazempc.errors import RobotError, SettingsError
from gazempc.neck.spec import load_neck
from gazempc.neck.speed_steps import SpeedSteps
from gazempc.robots.options import ViscaOptions
from gazempc.robots.visca import ViscaCamera, ViscaLink
from gazempc.robots.visca_packets import (
    COMMAND,
    POSITION,
    drive_of,
    drive_payload,
    pack,
    position_of,
    position_payload,
    unpack,
    visca_steps,
)

COUNTS = st.integers(-0x8000, 0x7FFF)


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        # Pan-tiltDrive in the command list of Sony's SRG and BRC cameras: up, down, left, right, up left, stop.
        ((0, 5), "81 01 06 01 01 05 03 01 FF"),
        ((0, -5), "81 01 06 01 01 05 03 02 FF"),
        ((24, 0), "81 01 06 01 18 01 01 03 FF"),
        ((-3, 0), "81 01 06 01 03 01 02 03 FF"),
        ((7, 20), "81 01 06 01 07 14 01 01 FF"),
        ((0, 0), "81 01 06 01 01 01 03 03 FF"),
    ],
)
def test_drive_commands_equal_those_of_the_manual(steps, words) -> None:
    payload = bytes.fromhex(words)
    assert drive_payload(*steps) == payload
    assert drive_of(payload) == steps


def test_a_packet_has_the_header_of_the_manual() -> None:
    assert pack(COMMAND, 0x01020304, b"\x81\xff") == bytes.fromhex("0100 0002 01020304 81ff")
    assert unpack(bytes.fromhex("0100 0003 01020304 81ff")) is None  # shorter than it states
    assert unpack(b"\x01") is None


@given(COUNTS, COUNTS)
def test_positions_are_decoded(pan: int, tilt: int) -> None:
    assert position_of(position_payload(pan, tilt)[2:-1]) == (pan, tilt)


def test_positions_of_five_digits_are_decoded() -> None:
    # BRC-X400: pan of five, tilt of four digits.
    assert position_of(bytes([0xF, 0xF, 0xF, 0xF, 0xE, 0, 0, 1, 0])) == (-2, 16)
    assert position_of(bytes([0xF, 0xF, 0xF, 0xF, 0xE, 0, 0, 0, 1, 0])) == (-2, 16)
    assert position_of(b"\x01\x02") is None


@pytest.mark.parametrize("pan_sign", [1, -1])
def test_the_camera_turns_as_commanded_and_reports_its_position(pan_sign) -> None:
    """Also with a reversed axis."""
    with camera() as (server, plant), connected(server.address, directions=(pan_sign, 1)) as robot:
        feed(robot, (0.5, -0.2), lambda: pan_sign * plant.true_state().position_rad[0] > 0.06)
        robot.send_command(np.zeros(2))
        wait_for(lambda: np.abs(plant.true_state().velocity_rad_s).max() < 1e-7)
        true_rad = plant.true_state().position_rad * [pan_sign, 1]
        assert true_rad[1] == pytest.approx(-0.4 * true_rad[0], rel=0.25)
        seen: list[np.ndarray] = []

        def has_read() -> bool:
            state = robot.read_state()
            if state is not None:
                seen.append(state.position_rad)
            return len(seen) > 1

        feed(robot, (0.0, 0.0), has_read)
        # A count is 1 / 14.4 deg.
        np.testing.assert_allclose(seen[-1], true_rad, atol=np.deg2rad(0.5 / 14.4) + 1e-6)


def test_speeds_between_steps_are_dithered() -> None:
    # Three steps only: 0.15 rad/s lies between 0.1 and 0.3.
    table = SpeedSteps(positive_rad_s=(0.1, 0.3, 1.4), negative_rad_s=(0.1, 0.3, 1.4))
    neck = QUICK.model_copy(update={"pan": QUICK.pan.model_copy(update={"speed_steps": table})})
    with camera(neck) as (server, _), connected(server.address, neck) as robot:
        accepted, times = [], [time.monotonic()]
        while times[-1] - times[0] < 0.7:
            accepted.append(robot.send_command(np.array([0.15, 0.0]))[0])
            times.append(time.monotonic())
            time.sleep(0.02)
        del times[0]
        assert {round(each, 9) for each in accepted} <= {0.1, 0.3}
        held_s = np.diff(times)
        assert np.sum(np.array(accepted)[:-1] * held_s) / held_s.sum() == pytest.approx(0.15, abs=0.02)
        assert {step for _, step, _ in server.driven} <= {0, 1, 2}


def test_a_slow_reply_delays_no_command() -> None:
    def late(_: int, packet: bytes) -> list[bytes]:
        time.sleep(0.05)
        return [packet]

    with (
        camera() as (server, _),
        closing(BadNetwork(server.address, to_robot=late)) as network,
        connected(network.address) as robot,
    ):
        longest_s, begin_s, k = 0.0, time.monotonic(), 0
        before = len(server.driven)
        while time.monotonic() - begin_s < 0.3:
            k += 1
            started_s = time.thread_time()
            robot.send_command(np.array([0.5 + 0.3 * (k % 2), 0.1]))
            longest_s = max(longest_s, time.thread_time() - started_s)
            time.sleep(0.005)
        # Many commands, few packets: one per 0.05 s, each with a reply.
        assert k > 10
        assert len(server.driven) - before <= 7
        assert longest_s < 0.05


@contextmanager
def link_through(network: BadNetwork) -> Iterator[ViscaLink]:
    """A link to the camera through a network; both are closed at the end."""
    with closing(network), closing(ViscaLink(*network.address)) as link:
        link.open()
        yield link


def test_a_lost_packet_is_resent_with_its_sequence_number_and_executed_once() -> None:
    """Of each two packets the first is lost, then two of each three replies."""
    with camera() as (server, _):
        network = BadNetwork(server.address, lambda k, packet: [packet] if k % 2 else [])
        with link_through(network) as link:
            for step in (1, 2, 3):
                link.command(drive_payload(step, 0))
        sent = [unpack(packet) for packet in network.seen[True]]
        numbers = [found[1] for found in sent if found[0] == COMMAND]
        assert len(numbers) >= len(set(numbers)) + 2
        answers = BadNetwork(server.address, to_robot=lambda k, packet: [packet] if k % 3 == 2 else [])
        with link_through(answers) as link:
            link.command(drive_payload(4, 0))
        assert [steps for _, *steps in server.driven] == [[1, 0], [2, 0], [3, 0], [4, 0]]


def test_late_and_reordered_replies_are_ignored() -> None:
    sent: list[bytes] = []

    def again(_: int, packet: bytes) -> list[bytes]:
        sent.append(packet)
        return sent[-2:]

    with camera() as (server, plant), link_through(BadNetwork(server.address, to_robot=again)) as link:
        assert position_of(link.inquire(POSITION)) == (0, 0)
        plant.send_command(np.array([1.0, 0.0]))
        wait_for(lambda: plant.true_state().position_rad[0] > 0.1)
        # 0.1 rad to the left are -82 counts.
        assert position_of(link.inquire(POSITION))[0] < -80


def test_a_lost_camera_is_reported_and_stopped_on_reconnection() -> None:
    with camera() as (server, plant), connected(server.address) as robot:
        feed(robot, (0.5, 0.0), lambda: plant.true_state().position_rad[0] > 0.05)
        server.silent = True
        with pytest.raises(RobotError, match=f"visca 127.0.0.1:{server.address[1]}: no reply"):
            feed(robot, (0.5, 0.0), lambda: False)
        before = len(server.driven)
        # Rebooted during the move: its sequence numbers restart.
        server.sequence = 0
        plant.send_command(np.zeros(2))
        server.silent = False
        wait_for(lambda: len(server.driven) > before)
        assert server.driven[before][1:] == (0, 0)
        wait_for(lambda: not isinstance(tried(robot.send_command, np.zeros(2)), RobotError))
        feed(robot, (-0.5, 0.0), lambda: server.driven[-1][1] < 0)


def test_a_camera_without_position_replies_gives_no_reading() -> None:
    blind = QUICK.model_copy(update={"reports_joints": False})
    with camera(blind) as (server, plant):
        robot = ViscaCamera(f"127.0.0.1:{server.address[1]}", QUICK, time.monotonic, ViscaOptions())
        with pytest.raises(RobotError, match="reports_joints = false"):
            robot.connect()
        with connected(server.address, blind) as robot:
            feed(robot, (0.5, 0.0), lambda: plant.true_state().position_rad[0] > 0.05)
            assert robot.read_state() is None


@pytest.mark.parametrize(("address", "neck"), [("", PTZ), ("host:port", PTZ), ("host:70000", PTZ), ("h", "reference")])
def test_invalid_addresses_and_a_position_controlled_neck_are_refused(address: str, neck) -> None:
    with pytest.raises(SettingsError, match=r"visca:HOST|velocity"):
        ViscaCamera(address, load_neck("reference") if neck == "reference" else neck, time.monotonic, ViscaOptions())


def test_moves_are_renewed_and_stop_on_loop_silence_or_close() -> None:
    with camera() as (server, _):
        with connected(server.address) as robot:
            feed(robot, (0.5, 0.0), lambda: server.driven[-1][1] > 0)
            wait_for(lambda: server.driven[-1][1:] == (0, 0))
            # Motion resumes with the loop, also with a camera whose sequence number is far higher.
            server.sequence = 1_000_000
            feed(robot, (0.5, 0.0), lambda: server.driven[-1][1] > 0)
            before = len(server.driven)
            feed(robot, (0.5, 0.0), lambda: len([d for d in server.driven[before:] if d[1] > 0]) > 2)
        assert server.driven[-1][1:] == (0, 0)
        robot.close()  # a second close has no effect


@pytest.mark.slow
def test_a_killed_program_leaves_the_camera_at_rest(tmp_path) -> None:
    with camera() as (server, _):
        robot = ["--robot", f"visca:127.0.0.1:{server.address[1]}", "--neck", "ptz", "--controller", "lookahead"]
        robot += ["--log", "npz", "--out", str(tmp_path)]
        words = [sys.executable, "-m", "gazempc.live", "--source", "replay", *robot]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, env=environment) as process:
            wait_for(lambda: server.driven and server.driven[-1][1] != 0)
            process.kill()
        wait_for(lambda: server.driven[-1][1:] == (0, 0))


def test_an_error_reply_is_named() -> None:
    with camera() as (server, _), link_through(BadNetwork(server.address)) as link:
        with pytest.raises(RobotError, match="syntax error"):
            link.command(bytes.fromhex("8101040003ff"))
        assert position_of(link.inquire(POSITION)) == (0, 0)


def test_a_reversed_axis_takes_the_speeds_of_its_own_direction() -> None:
    left, right = (tuple(unit * k for k in range(1, 25)) for unit in (0.06, 0.072))
    table = SpeedSteps(positive_rad_s=left, negative_rad_s=right)
    neck = QUICK.model_copy(update={"pan": QUICK.pan.model_copy(update={"speed_steps": table})})
    with camera(neck) as (server, _), connected(server.address, neck, directions=(-1, 1)) as robot:
        feed(robot, (0.72, 0.0), lambda: any(step == -12 for _, step, _ in server.driven))
        robot.send_command(np.zeros(2))
        feed(robot, (-0.72, 0.0), lambda: any(step == 10 for _, step, _ in server.driven))
        assert {step for _, step, _ in server.driven} <= {0, -12, 10}


def test_a_table_longer_than_that_of_the_protocol_is_refused() -> None:
    table = SpeedSteps.equal(1.5, 30)
    neck = QUICK.model_copy(update={"pan": QUICK.pan.model_copy(update={"speed_steps": table})})
    with pytest.raises(SettingsError, match=r"pan\.speed_steps.*24"):
        visca_steps(neck)


def test_a_second_connection_sends_the_speed_that_the_first_one_held() -> None:
    with camera() as (server, _), connected(server.address) as robot:
        feed(robot, (0.3, 0.0), lambda: any(step > 0 for _, step, _ in server.driven))
        robot.close()
        robot.connect()
        before = len(server.driven)
        feed(robot, (0.3, 0.0), lambda: any(step > 0 for _, step, _ in server.driven[before:]))
