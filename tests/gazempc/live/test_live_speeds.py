"""Live runs of necks that take speeds: the gaze follows, and the end is a stop, whatever ends the run."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing, contextmanager

import numpy as np
import pytest
from builders.live import WALK, Faulty, make_live_run
from builders.robots import Spied
from builders.visca import camera, wait_until

import gazempc as gz
from gazempc.errors import SettingsError
from gazempc.identify.identify import main as identify
from gazempc.live.clock import SimulatedClock
from gazempc.live.session import main, parse
from gazempc.live.setup import build
from gazempc.live.sources.camera.capture import check_address
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.picture import FramedPicture, Framing
from gazempc.neck.spec import load_neck
from gazempc.neck.speed_steps import SpeedSteps
from gazempc.results.motion import readings
from gazempc.robots.mujoco import MujocoNeck
from gazempc.robots.ptz_emulator import picture_url
from gazempc.sim.simulated import SimulatedNeck

PTZ = load_neck("ptz")
# Of a cheap camera: of 24 speeds to 80 deg/s, twelve are below 6 deg/s.
_DEG_S = (0.3, 0.6, 1, 1.3, 1.7, 2.1, 2.6, 3.1, 3.7, 4.4, 5.2, 6, 9, 15, 19, 25, 32, 40, 48, 56, 62, 68, 74, 80.1)
_STEPS = SpeedSteps(positive_rad_s=tuple(np.deg2rad(_DEG_S)), negative_rad_s=tuple(np.deg2rad(_DEG_S)))
COARSE = PTZ.model_copy(update={"pan": PTZ.pan.model_copy(update={"speed_steps": _STEPS})})


def run_speeds(neck, robot_class=SimulatedNeck, on_poll=None, on_send=None, keep=None, log_s=300.0):
    """A run of 6 s on a simulated clock: its logs and its robot."""
    clock, logs = SimulatedClock(), []
    start_rad = look_at_rad(neck.geometry, WALK.truth.head_position_m[0])
    if robot_class is MujocoNeck:
        inner = MujocoNeck(neck, clock.now_s, start_rad)
    else:
        inner = SimulatedNeck(neck, start_rad, clock.now_s)
    robot = Spied(inner, clock, on_send=on_send)
    run = make_live_run(
        neck, robot, Faulty(clock, on_poll=on_poll), clock, keep or (lambda log, _: logs.append(log)), log_s=log_s
    )
    failure = None
    try:
        run.run(threading.Event(), 6.0)
    except BaseException as error:
        failure = error
    return logs, robot, failure


@pytest.mark.parametrize(("neck", "robot_class"), [(PTZ, MujocoNeck), (COARSE, SimulatedNeck)])
def test_the_gaze_follows_within_limits_and_ends_with_a_stop(neck, robot_class):
    if robot_class is MujocoNeck:
        pytest.importorskip("mujoco")
    angles = {axis: getattr(PTZ, axis).model_copy(update={"command": "position"}) for axis in ("pan", "tilt")}
    (oracle,), _, _ = run_speeds(PTZ.model_copy(update=angles))
    (log,), robot, failure = run_speeds(neck, robot_class)
    assert failure is None
    # As the same neck does that is sent angles.
    assert np.ptp(oracle.joint_position_rad[:, 0]) > np.deg2rad(30.0)
    off_deg = np.rad2deg(log.joint_position_rad - oracle.joint_position_rad)
    assert np.sqrt(np.mean(off_deg**2)) < 0.3
    sent = np.array([speeds for _, speeds in robot.received])
    assert np.abs(sent).max() > 0.1
    assert np.all(np.abs(sent) <= neck.velocity_max_rad_s * (1 + 1e-6))
    if neck is COARSE:
        levels = np.array(_STEPS.levels_rad_s)
        assert np.abs(sent[:, 0, None] - levels).min(axis=1).max() < 1e-12
    assert np.all(sent[-1] == 0.0)
    assert robot.calls[-1] == "close"


@pytest.mark.parametrize("why", ["sink", "interrupt"])
def test_whatever_ends_a_run_the_last_speed_is_zero(why):
    def on_send(now_s):
        if why == "interrupt" and 2.0 <= now_s < 2.01:
            raise KeyboardInterrupt

    def keep(*_):
        if why == "sink":
            raise OSError("no space left on device")

    _, robot, failure = run_speeds(PTZ, on_send=on_send, keep=keep, log_s=2.0)
    assert failure is not None
    assert np.all(robot.received[-1][1] == 0.0)
    assert robot.calls[-1] == "close"


@pytest.mark.slow
def test_a_camera_keeps_a_walker_in_its_zone_in_real_time_and_rests_before_one_who_sways():
    framing = gz.Framing(view_deg=(60.0, 34.0), headroom=0.5, lead_room=0.0)  # the zone: 9.9 deg to each side
    seen_deg = []
    with (
        camera(PTZ) as (server, plant),
        gz.Gaze(PTZ, f"visca:127.0.0.1:{server.address[1]}", framing=framing.model_dump()) as gaze,
    ):
        start_s = time.time()

        def aside_m(time_s):
            # From side to side by 55 deg in 6 s and there 4 deg of sway.
            since_s = time_s - start_s
            return 0.35 * min(since_s, 6.0) - 1.05 + (0.14 * math.sin(3.0 * since_s) if since_s > 6.0 else 0.0)

        while (now_s := time.time()) < start_s + 11.0:
            gaze.see(now_s - 0.1, [2.0, aside_m(now_s - 0.1), 0.0])
            pan_deg = math.degrees(float(plant.true_state().position_rad[0]))
            seen_deg.append((now_s - start_s, pan_deg, math.degrees(math.atan2(aside_m(now_s), 2.0))))
            time.sleep(1 / 30)
    since_s, pan_deg, person_deg = np.array(seen_deg).T
    assert np.ptp(person_deg) > 55.0
    in_zone = np.abs(pan_deg - person_deg) <= 9.9
    assert in_zone[since_s > 1.0].mean() > 0.85
    assert np.ptp(pan_deg[since_s > 9.0]) < 1.0 < np.ptp(person_deg[since_s > 9.0])


def test_settings_that_follow_from_the_emulated_camera():
    settings = parse(["--robot", "visca:emulator", "--source", "camera:emulator"])
    assert (settings.neck, settings.mount.on) == ("ptz", "head")
    assert settings.framing.view_deg == pytest.approx((60.0, 36.0), abs=0.1)
    assert (settings.loop.stale_after_s, settings.loop.lost_after_s) == (1.5, 2.0)
    assert (settings.camera.fov_deg, settings.camera.latency_ms) == (60.0, 200.0)
    settings = parse(["--robot", "visca:192.168.0.8", "--source", "camera:rtsp://192.168.0.8/1", "--neck", "ptz"])
    assert settings.mount.on == "head"
    assert settings.camera.fov_deg is None
    with pytest.raises(SettingsError, match="neck"):
        parse(["--robot", "visca:192.168.0.8", "--source", "camera"])
    # A lower top speed leaves the scale of the device as it is.
    words = ["--robot", "visca:h", "--source", "stdin", "--neck", "ptz", "--loop.speed-max-rad-s", "0.1"]
    slow = build(parse(words)).neck
    assert slow.pan.velocity_max_rad_s == 0.1
    assert slow.pan.full_rad_s == PTZ.pan.velocity_max_rad_s


@pytest.mark.parametrize("command", ["live", "identify"])
def test_a_password_in_the_address_of_a_stream_is_refused_and_shown_nowhere(command, capsys):
    run = {"live": main, "identify": identify}[command]
    words = ["--robot", "visca:h", "--neck", "ptz", "--source"]
    assert run([*words, "camera:rtsp://me:secret@192.0.2.1/x"]) == 2
    text = "".join(capsys.readouterr())
    assert "password" in text
    assert "secret" not in text
    check_address("camera:rtsp://me:$CAMERA_PASSWORD@192.0.2.1/x")


@pytest.mark.slow
def test_a_camera_that_does_not_answer_is_an_event_and_stands_at_the_end():
    with camera(PTZ) as (server, _):
        with gz.Gaze(PTZ, f"visca:127.0.0.1:{server.address[1]}") as gaze:
            start_s, back_s = time.time(), math.inf
            while (now_s := time.time()) < min(start_s + 240.0, back_s + 0.5):
                if server.silent and "robot_not_answering" in gaze.events:
                    server.silent, back_s = False, now_s
                elif now_s > start_s + 1.0 and back_s == math.inf:
                    server.silent = True
                gaze.see(now_s - 0.1, [2.0, 0.5 * math.sin(now_s - start_s), 0.0])
                time.sleep(1 / 30)
        assert "robot_not_answering" in gaze.events
        assert server.driven[-1][1:] == (0, 0)


def test_a_probe_on_the_command_line(capsys):
    with camera() as (server, _):
        assert main(["--robot", f"visca:127.0.0.1:{server.address[1]}", "--probe"]) == 0
        assert not server.driven
    said = capsys.readouterr().out
    for line in ("power           on", "position        0 and 0 counts", "fastest speeds  24 and 20"):
        assert line in said
    assert main(["--robot", f"visca:127.0.0.1:{server.address[1]}", "--probe"]) == 2
    assert main(["--robot", "simulated", "--probe"]) == 2


@pytest.mark.slow
def test_a_run_that_is_killed_in_a_move_leaves_a_camera_that_stands(tmp_path):
    with camera(PTZ) as (server, _):
        command = [
            *(sys.executable, "-m", "gazempc.live", "--source", "replay", "--neck", "ptz"),
            *(
                "--robot",
                f"visca:127.0.0.1:{server.address[1]}",
                "--out",
                str(tmp_path),
                "--no-figures",
                "--log",
                "npz",
            ),
            *("--controller", "lookahead", "--predictor", "constant_velocity"),
        ]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
        run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
        try:
            wait_until(lambda: bool(server.driven) and abs(server.driven[-1][1]) > 1, 120.0)
            run.kill()
            run.wait(60)
        finally:
            run.kill()
        wait_until(lambda: server.driven[-1][1:] == (0, 0))
        time.sleep(0.5)
        assert server.driven[-1][1:] == (0, 0)


@contextmanager
def emulated(protocol):
    """Robot and picture of the emulated camera by a protocol, as words of the command line."""
    for package in ("mujoco", "cv2", "skimage"):
        pytest.importorskip(package)
    if protocol == "visca":
        yield "--robot visca:emulator --source camera:emulator"
        return
    onvif = pytest.importorskip("builders.onvif")
    with closing(onvif.EmulatedCamera(PTZ)) as plant, onvif.onvif_camera(PTZ, plant=plant) as server:
        picture = f"--source camera:{picture_url()} --camera.fov-deg 60 --camera.latency-ms 200"
        view = "--framing.view-deg 60 36 --options.onvif.range-deg 100 -100 -25 25"
        yield f"--robot onvif:127.0.0.1:{server.port} --neck ptz {picture} {view}"


def in_zone(log):
    """Share of the observations, from 3 s on, within the zone of the picture when they were captured."""
    picture = FramedPicture.of(Framing.model_validate(log.run.settings["framing"]), log.neck)
    looks_rad = look_at_rad(log.neck.geometry, log.head_observed_base_m)
    seen_s, read = log.capture_time_s, readings(log)
    at_rad = np.stack([np.interp(seen_s, read.time_s, read.position_rad[:, k]) for k in range(2)], axis=1)
    turning_rad_s = np.gradient(looks_rad[:, 0], seen_s)
    inside = np.abs(picture.aim_rad(looks_rad, turning_rad_s) - at_rad) <= picture.zone_rad
    return float(np.all(inside, axis=1)[seen_s > 3.0].mean())


@pytest.mark.slow
@pytest.mark.usefixtures("real_time")
@pytest.mark.parametrize("protocol", ["visca", "onvif"])
def test_the_loop_closes_through_the_picture_of_the_emulated_camera(protocol, tmp_path):
    # A busy machine renders and searches late: the run ends when the camera has followed the person to both sides.
    limits = "--loop.stale-after-s 5 --loop.lost-after-s 8 --loop.rest-after-s 20 --duration-s 240"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with emulated(protocol) as camera_words:
        words = f"{camera_words} {limits} --framing.subject one --no-figures --log npz --out {tmp_path}"
        command = [sys.executable, "-m", "gazempc.live", *words.split()]
        with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as run:
            pans, ended = [], False
            for line in run.stdout:
                pans += [float(each) for each in re.findall(r"looks at pan ([+-][\d.]+)", line)]
                if len(pans) > 15 and not ended and min(pans) < -8.0 and max(pans) > 8.0:
                    run.send_signal(signal.SIGTERM)  # once: the third one ends the process
                    ended = True
    assert run.returncode == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["stopped_by"] == "signal"
    assert summary["limit_violations"] == 0
    share = in_zone(gz.load_log(tmp_path / summary["logs"][0]))
    print(f"{protocol}: {100 * share:.0f} % of the observations in the zone")
    # The person walks to and fro without a rest; 57 and 62 % on two idle cores. A busy machine renders late.
    latency_ms = summary["end_to_end_latency_ms"]["p50"]
    keeps_pace = latency_ms < 500.0 and not {"low_frame_rate", "stream_frozen", "part_slow"} & set(summary["events"])
    assert share > 0.4 or not keeps_pace, (share, latency_ms)
