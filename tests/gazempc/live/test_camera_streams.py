"""Pictures that are rare, late or stand still: the cause is named."""

import time
from contextlib import closing

import numpy as np
import pytest
from builders.waiting import wait_for

from gazempc.live.sources.camera.capture import Camera, CameraOptions, Picture, StreamWatch
from gazempc.live.sources.camera.worker import FaceRate
from gazempc.live.sources.source import Notice
from gazempc.loop.events import Event

cv2 = pytest.importorskip("cv2")
PICTURE = np.zeros((48, 64, 3), np.uint8)


def test_the_lag_is_that_behind_the_fastest_picture_of_a_minute() -> None:
    watch = StreamWatch()
    # Steady but for jitter: the lag is the jitter.
    jitter = np.random.default_rng(0).uniform(0.0, 0.05, 100)
    lags = [watch.lag_s(100.0 + 0.1 * k, 0.1 * k + jitter[k]) for k in range(100)]
    np.testing.assert_allclose(lags, jitter - np.minimum.accumulate(jitter), atol=1e-9)
    # Later by 20 ms each picture.
    assert watch.lag_s(110.0 + 10.0, 20.0 + 2.0) == pytest.approx(2.0, abs=0.05)
    # A camera's clock that is slow by 100 ppm is no lag, however long the run.
    watch = StreamWatch()
    assert max(watch.lag_s(0.9999 * t, t) for t in np.arange(0.0, 3600.0, 2.0)) < 0.01


class Falling:
    """Stands in for OpenCV's capture of an RTSP stream: real pictures, and stamps that fall behind after a while."""

    def __init__(self) -> None:
        self.opened, self._count, self._begin_s = 0, 0, 0.0

    def __call__(self, address: str, *_: object) -> "Falling":
        self.address = address
        self.opened += 1
        self._count, self._begin_s = 0, time.monotonic()
        return self

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def grab(self) -> bool:
        time.sleep(0.02)
        self._count += 1
        return True

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, PICTURE + self._count % 7

    def getBackendName(self) -> str:  # noqa: N802
        return "FFMPEG"

    def get(self, _: int) -> float:
        # From the tenth picture on the stream runs at half its pace.
        passed_s = time.monotonic() - self._begin_s
        return 1e3 * (passed_s if self._count < 10 else 0.5 * passed_s)

    def release(self) -> None:
        pass


def test_a_stream_that_falls_behind_is_stamped_so_named_and_opened_again(monkeypatch) -> None:
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
        assert max(ages_s) > 0.2  # stamped as old as it is
        wait_for(lambda: isinstance(camera.read(), Picture))
        assert falling.opened >= 2


class Frozen(Falling):
    """One and the same picture from the tenth on."""

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, PICTURE + min(self._count, 10) % 7


class Silent(Falling):
    """No picture for some seconds after the tenth, then again."""

    def grab(self) -> bool:
        time.sleep(2.2 if self._count == 10 else 0.0)
        return super().grab()


@pytest.mark.slow
@pytest.mark.parametrize(("stream", "why"), [(Frozen, "one picture for 1 s"), (Silent, "no picture for 2 s")])
def test_a_stream_that_freezes_or_falls_silent_is_one_event_and_no_picture(monkeypatch, stream, why) -> None:
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
def test_the_cause_of_rare_faces_is_named_once(rate_hz, found, search_s, cause):
    rate, times_s = FaceRate(), np.arange(0.0, 12.0, 1 / rate_hz)
    texts = [text for k, at_s in enumerate(times_s) if (text := rate.judge(at_s, found(k), search_s))]
    assert len(texts) == (cause is not None)
    assert cause is None or cause in texts[0]
