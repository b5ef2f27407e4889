"""ONVIF against the service of ipycam, which turns a simulated neck."""

import logging
import time
from contextlib import closing, contextmanager

import numpy as np
import pytest
from builders.robots import with_both
from builders.visca import QUICK, feed
from builders.waiting import wait_for

from gazempc.errors import RobotError, SettingsError
from gazempc.neck.speed_steps import SpeedSteps
from gazempc.robots.onvif import OnvifCamera
from gazempc.robots.options import OnvifOptions

pytest.importorskip("onveef")
pytest.importorskip("ipycam")
from builders.onvif import OnvifCameraServer, onvif_camera

USER, PASSWORD = "watcher", "correct-horse-battery"
BLIND = QUICK.model_copy(update={"reports_joints": False})


@pytest.fixture(autouse=True)
def _login(monkeypatch) -> None:
    monkeypatch.setenv("GAZEMPC_ONVIF_USER", USER)
    monkeypatch.setenv("GAZEMPC_ONVIF_PASSWORD", PASSWORD)


def robot_of(server: OnvifCameraServer, neck=BLIND, **options) -> OnvifCamera:
    return OnvifCamera(f"127.0.0.1:{server.port}", neck, time.monotonic, OnvifOptions(timeout_s=5.0, **options))


@contextmanager
def connected(neck=BLIND, **options):
    """A camera and a connected robot."""
    with onvif_camera(QUICK, USER, PASSWORD) as server, closing(robot_of(server, neck, **options)) as robot:
        robot.connect()
        yield server, robot


def test_the_camera_turns_as_commanded_and_moves_time_out() -> None:
    with connected() as (server, robot):
        feed(robot, (0.5, -0.2), lambda: server.plant.true_state().position_rad[0] > 0.1)
        position = server.plant.true_state().position_rad
        assert position[1] == pytest.approx(-0.4 * position[0], rel=0.3)
        _, x, y = next(move for move in server.moves if move[1])
        # Positive to the right; shares of the top speeds.
        assert (x, y) == pytest.approx((-0.5 / 1.396, -0.2 / 0.873), abs=1e-4)
        assert all("PT1S" in body for body in server.bodies if "ContinuousMove>" in body)
        # Renewed before the timeout of one second.
        before = len(server.moves)
        feed(robot, (0.5, -0.2), lambda: len(server.moves) > before + 1)
        times = [at for at, *_ in server.moves[before:]]
        assert np.diff(times).max() < 1.0
        robot.close()
        assert server.moves[-1][1:] == (0.0, 0.0)


def test_table_speeds_are_interpolated_to_shares() -> None:
    # Shares 0.5 and 1 are 0.2 and 0.3 rad/s to the left, 0.4 and 0.5 to the right.
    table = SpeedSteps(positive_rad_s=(0.2, 0.3), negative_rad_s=(0.4, 0.5))
    pan = BLIND.pan.model_copy(update={"speed_steps": table, "velocity_max_rad_s": 0.3})
    with connected(BLIND.model_copy(update={"pan": pan})) as (server, robot):
        for speed, share in ((0.1, 0.25), (0.2, 0.5), (0.25, 0.75), (-0.2, -0.25), (-0.3, -0.375)):
            feed(robot, (speed, 0.0), lambda share=share: server.moves[-1][1] == pytest.approx(-share, abs=1e-4))


def test_positions_are_scaled_by_their_stated_range() -> None:
    low, high = np.rad2deg(QUICK.position_min_rad), np.rad2deg(QUICK.position_max_rad)
    with connected(QUICK, range_deg=(high[0], low[0], low[1], high[1])) as (server, robot):
        feed(robot, (0.5, 0.1), lambda: server.plant.true_state().position_rad[0] > 0.1)
        feed(robot, (0.0, 0.0), lambda: np.abs(server.plant.true_state().velocity_rad_s).max() < 1e-4)
        while robot.read_state() is not None:
            pass
        seen: list = []
        feed(robot, (0.0, 0.0), lambda: (s := robot.read_state()) is not None and not seen.append(s.position_rad))
        np.testing.assert_allclose(seen[-1], server.plant.true_state().position_rad, atol=1e-3)


def test_angle_commands_are_absolute_moves() -> None:
    neck = with_both(BLIND, command="position")
    with pytest.raises(SettingsError, match="velocity"):
        OnvifCamera("127.0.0.1", neck, time.monotonic, OnvifOptions())
    with connected(neck, range_deg=(100.0, -100.0, -25.0, 25.0)) as (server, robot):
        targets: list = []
        server.absolute_move = lambda x, y, _: targets.append((x, y))  # type: ignore[method-assign]
        time.sleep(0.5)
        assert not targets  # no motion before a command
        feed(robot, tuple(np.deg2rad([20.0, -5.0])), lambda: bool(targets))
        assert targets[0] == pytest.approx((-0.2, -0.2), abs=1e-4)


def test_a_wrong_password_is_reported_and_never_shown(caplog, capfd, monkeypatch) -> None:
    caplog.set_level(logging.DEBUG)
    wrong = "not-the-password"
    monkeypatch.setenv("GAZEMPC_ONVIF_PASSWORD", wrong)
    with onvif_camera(QUICK, USER, PASSWORD) as server:
        robot = robot_of(server)
        with pytest.raises(RobotError, match="user or password refused") as caught:
            robot.connect()
    text = capfd.readouterr()
    everything = "".join([caplog.text, text.out, text.err, repr(caught.value), repr(vars(robot)), str(caught.value)])
    assert wrong not in everything
    assert caught.value.__cause__ is None
    assert caught.value.__suppress_context__


def test_the_login_is_read_from_a_file(tmp_path, monkeypatch) -> None:
    monkeypatch.delenv("GAZEMPC_ONVIF_PASSWORD")
    login = tmp_path / "login"
    login.write_text(f"{USER}\n{PASSWORD}\n")
    with onvif_camera(QUICK, USER, PASSWORD) as server:
        found = dict(robot_of(server, login=login).probe())
        assert found["model"] == "PythonCam VirtualCam-1 1.3.0"
        assert found["moves"] == "continuous, absolute, relative"
        assert not server.moves
        assert all(PASSWORD not in body for body in server.bodies)  # digest
    login.write_text(PASSWORD)
    with pytest.raises(SettingsError, match="two lines") as caught:
        robot_of(server, login=login)
    assert PASSWORD not in str(caught.value)


def test_a_camera_with_a_permanent_motion_status_is_driven() -> None:
    with connected(QUICK, range_deg=(100.0, -100.0, -25.0, 25.0)) as (server, robot):
        server.says_moving = True
        for speed in (0.5, -0.5, 0.5):
            feed(robot, (speed, 0.0), lambda speed=speed: server.moves[-1][1] * speed < 0)
        robot.close()
        assert server.moves[-1][1:] == (0.0, 0.0)


@pytest.mark.slow  # the thread is that of VISCA, which a fast test holds
def test_a_lost_camera_is_reported_and_stopped_on_reconnection() -> None:
    with connected() as (server, robot):
        feed(robot, (0.5, 0.0), lambda: bool(server.moves and server.moves[-1][1]))
        server.silent = True
        with pytest.raises(RobotError, match=f"onvif 127.0.0.1:{server.port}"):
            feed(robot, (0.4, 0.0), lambda: False)
        # Meanwhile the move has timed out.
        wait_for(lambda: np.abs(server.plant.true_state().velocity_rad_s).max() < 1e-4)
        before = len(server.moves)
        server.silent = False
        wait_for(lambda: len(server.moves) > before)
        assert server.moves[before][1:] == (0.0, 0.0)
