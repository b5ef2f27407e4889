"""The end: the neck is braked within its limits and everything is closed, whatever ends the run."""

import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
from builders.checks import assert_sound, assert_within_limits
from builders.live import NECK, WALK, run_live
from builders.recordings import reordered

from gazempc.loop.planner import ImmediatePlanner
from gazempc.neck.spec import load_neck


@pytest.mark.parametrize("why", ["signal", "duration", "end of the source"])
def test_told_to_stop_the_neck_brakes_within_limits_and_everything_is_closed(why):
    stop, closed = threading.Event(), []

    def on_poll(now_s):
        if why == "signal" and now_s >= 1.5:
            stop.set()

    class Closing(ImmediatePlanner):
        def close(self):
            closed.append(True)

    walk = reordered(WALK, range(46)) if why == "end of the source" else WALK
    duration_s = 1.5 if why == "duration" else 5.0
    result = run_live(on_poll=on_poll, stop=stop, walk=walk, planner=Closing, duration_s=duration_s)
    assert_sound(result)
    assert result.report.stopped_by == why
    now, velocity = result.joined("time_s"), result.joined("command_velocity_rad_s")
    speed_before = np.abs(velocity[np.searchsorted(now, 1.45)]).max()
    assert speed_before > 0.1  # it was moving
    assert np.all(velocity[-1] == pytest.approx([0, 0], abs=1e-9))
    assert 1.5 < now[-1] < 2.0
    speed = np.abs(velocity[now > 1.6]).max(axis=1)
    assert np.all(np.diff(speed) <= 1e-9)  # braking all the way
    assert closed


@pytest.mark.parametrize("neck", [NECK, load_neck("ptz")], ids=["angles", "speeds"])
@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_what_ends_a_run_in_mid_motion_brakes_the_neck_first(error, neck):
    """A log that cannot be written, and an interrupt, which takes the place of one command."""
    interrupted_s = []

    def on_send(now_s):
        if error is KeyboardInterrupt and now_s >= 1.5 and not interrupted_s:
            interrupted_s.append(now_s)
            raise error

    def keep(log, times):
        if error is OSError:
            raise error("no space left on device")

    with pytest.raises(error) as ended:
        run_live(neck=neck, on_send=on_send, keep=keep, log_s=1.5)
    result = ended.value.result
    times_s, received = map(np.array, zip(*result.robot.received, strict=True))
    assert 1.5 < times_s[-1] < 2.1
    if neck is NECK:
        gap = np.searchsorted(times_s, interrupted_s)
        assert_within_limits(received, ends=True, breaks=gap, rests=False)
    else:
        assert np.abs(received).max() > 0.1
        assert np.all(received[-1] == 0.0)
    assert result.robot.calls[-1] == result.source.calls[-1] == "close"


SIGNALLED = """
import signal, threading, time
from gazempc.live.process import stopped_by_signals
class Stop(threading.Event):
    lock = threading.Lock()
    def set(self):
        with self.lock:
            if not self.is_set():
                super().set()
                signal.raise_signal(signal.SIGTERM)
stop = Stop()
with stopped_by_signals(stop):
    signal.raise_signal(signal.SIGINT)
    print(stop.wait(60), flush=True)
    while signal.getsignal(signal.SIGHUP) is not signal.SIG_DFL:
        time.sleep(0.01)
    signal.raise_signal(signal.SIGHUP)
    print("alive", flush=True)
"""


def test_the_first_signal_asks_for_the_end_and_the_third_one_ends_the_process():
    """The second one is within the handling of the first: handlers run between any two instructions."""
    done = subprocess.run([sys.executable, "-c", SIGNALLED], capture_output=True, text=True, check=False, timeout=240)
    assert (done.stdout.split(), done.returncode) == (["True"], -signal.SIGHUP), done.stderr
