"""The camera source: rendered people at known positions, its process, files and streams, and refusals."""

import json
import os
import subprocess
import sys
import time
from contextlib import closing, suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from builders.cameras import Falling, Frozen, Silent, studio
from builders.mcap import decoded
from builders.own_modules import OPENS_AND_IS_KILLED, write_own_camera
from builders.waiting import FOREVER_S, wait_for

from benchmarks.camera import live
from benchmarks.camera.stream import PictureServer
from benchmarks.camera.walks import across, watch
from gazempc.errors import GazempcError
from gazempc.live.session import main
from gazempc.live.sources.camera import source as camera_source
from gazempc.live.sources.camera.capture import Camera, CameraOptions, Picture, StreamWatch, open_pictures
from gazempc.live.sources.camera.source import FaceRate
from gazempc.live.sources.source import Notice, SourceError
from gazempc.loop.events import Event
from gazempc.results.log_files import load_log
from gazempc.results.metrics import measure

# Detection is delayed on a busy machine.
PATIENT = ["--loop.stale-after-s", "5", "--loop.lost-after-s", "8", "--loop.rest-after-s", "20"]

WITH_HERE = os.environ | {"PYTHONPATH": os.pathsep.join(["", str(Path(__file__).parents[3])])}


@pytest.fixture
def own_camera(tmp_path, monkeypatch):
    write_own_camera(tmp_path, monkeypatch)


@pytest.mark.slow
@pytest.mark.usefixtures("own_camera", "real_time")
def test_faces_of_a_user_defined_camera_are_attended_until_it_fails(tmp_path, capsys):
    words = ["--source", "camera:portrait_camera:Row", "--options.people", "2", "--camera.latency-ms", "400"]
    words += ["--predictor", "constant_velocity", "--controller", "lookahead", "--no-figures"]
    assert main([*words, "--out", str(tmp_path), *PATIENT, "--attend", "id:1"]) == 0
    summary, log = json.loads((tmp_path / "summary.json").read_text()), load_log(tmp_path / "log_000.npz")
    assert summary["stopped_by"] == "end of the source"
    assert summary["problems"] == ["the process of the camera ended: OSError: the cable was pulled"]
    assert "540 x 384 pixels, 65 degrees across ASSUMED" in capsys.readouterr().err
    assert log.person_id[0] == "1"  # by default the other one, whose face is nearer; a busy machine may rename
    assert np.ptp(log.head_observed_base_m[:, 1]) < 0.2
    assert {"person_entered", "attention_switched"} <= set(log.event_name)
    assert np.all(np.diff(np.unique(log.capture_time_s)) > 0.04)
    # 50 ms of transfer, 400 ms by the option, and detection, 30 ms on an idle machine.
    assert 0.45 < np.min(log.arrival_time_s - log.capture_time_s) < 2.0
    pictures = decoded(tmp_path / "log_000.mcap", "/camera")
    assert 1 <= len(pictures) <= 5 * np.ptp(log.time_s) + 2


@pytest.mark.usefixtures("own_camera")
def test_pictures_of_another_shape_are_refused():
    address, options = "portrait_camera:Grey", CameraOptions()
    with pytest.raises(SourceError, match="is not RGB"):
        camera_source._work(open_pictures(address, options), address, options, None, False)


@pytest.mark.usefixtures("own_camera")
@pytest.mark.parametrize(("address", "complaint"), [("there_is_none.mp4", "OpenCV"), ("portrait_camera.py", "video")])
def test_an_invalid_camera_is_refused(address, complaint):
    with pytest.raises(GazempcError, match=complaint):
        open_pictures(address, CameraOptions())


@pytest.mark.slow
def test_a_lost_network_camera_is_reopened():
    with closing(PictureServer()) as server, closing(Camera(server.url, CameraOptions())) as camera:
        assert isinstance(camera.read(), Picture)
        server.hang_up()
        for there in (False, True):
            wait_for(lambda there=there: isinstance(camera.read(), Picture) == there, FOREVER_S)


def test_a_video_is_played_at_its_frame_rate(tmp_path):
    path, rate_hz, times_s = str(tmp_path / "walk.mp4"), 10, []
    video = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*"mp4v"), rate_hz, (64, 48))
    for k in range(8):
        video.write(np.full((48, 64, 3), 20 * k, np.uint8))
    video.release()
    with closing(open_pictures(path, CameraOptions())) as pictures:
        while (picture := pictures.read()) is not None:
            times_s.append((picture.captured_s, time.monotonic()))
    captured_s, given_s = np.transpose(times_s)
    frames = rate_hz * (captured_s - captured_s[0])  # a busy machine drops pictures without delaying them
    assert frames == pytest.approx(np.round(frames), abs=0.03)
    assert len(frames) > 1
    assert np.all(given_s >= captured_s)


@pytest.mark.slow
@pytest.mark.usefixtures("own_camera", "real_time")
def test_the_camera_process_ends_when_the_program_is_killed(tmp_path):
    """Without a person in view nothing is sent, so no broken pipe ends the process."""
    (tmp_path / "killed.py").write_text(OPENS_AND_IS_KILLED)
    done = subprocess.run(
        [sys.executable, "killed.py"], capture_output=True, text=True, check=False, timeout=FOREVER_S, env=WITH_HERE
    )
    process_id = int(done.stdout)
    stat = Path(f"/proc/{process_id}/stat")
    with suppress(OSError):  # ended; a zombie counts
        wait_for(lambda: stat.read_text().rpartition(")")[2].split()[0] == "Z", FOREVER_S)


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


@pytest.mark.slow
def test_a_crossing_person_has_the_true_direction():
    """With head yaw up to 30 degrees; pictures before confirmation (0.3 s) count as missed."""
    seen = watch(studio(), across(2.0), 30)
    assert seen.found >= 0.8
    assert rms(seen.bearing_deg) <= 0.5
    assert abs(seen.range_error).max() < 0.2
    assert rms(seen.yaw_error_deg) < 8.0
    assert seen.names == 1
    assert seen.others == 0
    # Errors are no larger than stated, and not far smaller.
    assert 0.1 < seen.nees.mean() < 3.5


@pytest.mark.slow
def test_a_head_mounted_camera_keeps_contact_with_a_passing_person():
    """From pictures to commands with the MuJoCo neck; the mount is beside the eye and rotated."""
    log, camera = live.run(studio(), duration_s=3.3, neck_name="fetch")
    metrics = measure(log)
    assert log.capture_time_s.size >= 0.9 * camera.pictures - 2
    assert metrics.limit_violations == 0
    assert metrics.eye_contact_2p6 > 0.9
    assert metrics.gaze_error_rms_deg < 2.0
    true_m = np.array([live.passer_by(t).eyes_m for t in log.capture_time_s])
    bearing = [np.rad2deg(np.arctan2(p[:, 1], p[:, 0])) for p in (log.head_observed_base_m, true_m)]
    assert rms(bearing[0] - bearing[1]) < 0.5
    assert np.ptp(log.joint_position_rad[:, 0]) > np.deg2rad(60)


def test_the_lag_is_relative_to_the_minimum_delay_of_a_minute() -> None:
    watch = StreamWatch()
    # Constant delay plus jitter: the lag is the jitter.
    jitter = np.random.default_rng(0).uniform(0.0, 0.05, 100)
    lags = [watch.lag_s(100.0 + 0.1 * k, 0.1 * k + jitter[k]) for k in range(100)]
    np.testing.assert_allclose(lags, jitter - np.minimum.accumulate(jitter), atol=1e-9)
    # Delay grows by 20 ms per picture.
    assert watch.lag_s(110.0 + 10.0, 20.0 + 2.0) == pytest.approx(2.0, abs=0.05)
    # A camera clock slow by 100 ppm gives no lag, even in a long run.
    watch = StreamWatch()
    assert max(watch.lag_s(0.9999 * t, t) for t in np.arange(0.0, 3600.0, 2.0)) < 0.01


def test_a_lagging_stream_has_corrected_stamps_and_is_reopened(monkeypatch) -> None:
    falling = Falling()
    monkeypatch.setattr(cv2, "VideoCapture", falling)
    monkeypatch.setenv("CAMERA_PASSWORD", "correct-horse")
    with closing(Camera("rtsp://me:$CAMERA_PASSWORD@camera/stream", CameraOptions())) as camera:
        ages_s = []
        while isinstance(found := camera.read(), Picture):
            ages_s.append(time.monotonic() - found.captured_s)
        assert isinstance(found, Notice)
        assert found.event is Event.STREAM_LAGS
        assert falling.address == "rtsp://me:correct-horse@camera/stream"
        assert "correct-horse" not in found.text
        assert max(ages_s) > 0.2  # the stamp includes the lag
        wait_for(lambda: isinstance(camera.read(), Picture))
        assert falling.opened >= 2


@pytest.mark.slow
@pytest.mark.parametrize(("stream", "why"), [(Frozen, "one picture for 1 s"), (Silent, "no picture for 2 s")])
def test_a_frozen_or_silent_stream_is_one_event_without_pictures(monkeypatch, stream, why) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", stream())
    with closing(Camera("http://camera/stream", CameraOptions())) as camera:
        found = wait_for(lambda: not isinstance(read := camera.read(), Picture) and read)
        assert isinstance(found, Notice)
        assert found.event is Event.STREAM_FROZEN
        assert why in found.text
        if stream is Silent:
            assert isinstance(camera.read(), Picture)


@pytest.mark.parametrize(
    ("rate_hz", "found", "search_s", "cause"),
    [
        (3, lambda k: True, 0.03, "camera or video give 3.0 pictures a second"),
        (4, lambda k: True, 0.18, "the search takes 180 ms a picture"),  # a busy computer
        (30, lambda k: k % 10 == 0, 0.03, " % of 30 pictures a second"),
        (30, lambda k: k % 30 < 3, 0.03, None),  # three in a row, then none: their intervals are short
        (30, lambda k: True, 0.03, None),
        (30, lambda k: False, 0.03, None),
    ],
)
def test_the_cause_of_rare_faces_is_reported_once(rate_hz, found, search_s, cause):
    rate, times_s = FaceRate(), np.arange(0.0, 12.0, 1 / rate_hz)
    texts = [text for k, at_s in enumerate(times_s) if (text := rate.judge(at_s, found(k), search_s))]
    assert len(texts) == (cause is not None)
    assert cause is None or cause in texts[0]
