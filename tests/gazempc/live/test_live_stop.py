"""The end: the neck is braked within its limits and everything is closed, whatever ends the run."""

import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
from builders.checks import assert_sound, assert_within_limits
from builders.live import WALK, run_live
from builders.recordings import reordered

from gazempc.loop.planner import ImmediatePlanner


@pytest.mark.parametrize("why", ["signal", "duration", "end of the source"])
def test_told_to_stop_the_neck_brakes_within_limits_and_everything_is_closed(why):
    stop = threading.Event()
    walk = WALK

    def on_poll(now_s):
        if why == "signal" and now_s >= 2.0:
            stop.set()

    if why == "end of the source":
        walk = reordered(WALK, range(61))
    closed = []

    class Closing(ImmediatePlanner):
        def close(self):
            closed.append(True)

    result = run_live(
        on_poll=on_poll,
        stop=stop,
        walk=walk,
        planner=Closing,
        duration_s=2.0 if why == "duration" else 5.0,
    )
    assert_sound(result)
    assert result.report.stopped_by == why
    now, velocity = result.joined("time_s"), result.joined("command_velocity_rad_s")
    speed_before = np.abs(velocity[np.searchsorted(now, 1.95)]).max()
    assert speed_before > 0.1  # it was moving
    assert np.all(velocity[-1] == pytest.approx([0, 0], abs=1e-9))
    assert 2.0 < now[-1] < 2.5
    speed = np.abs(velocity[now > 2.1]).max(axis=1)
    assert np.all(np.diff(speed) <= 1e-9)  # braking all the way
    assert closed


def test_a_full_disk_in_mid_motion_ends_the_run_but_the_neck_is_braked_first():
    def keep(log, times):
        raise OSError("no space left on device")

    with pytest.raises(OSError, match="no space") as ended:
        run_live(keep=keep, log_s=2.0, duration_s=4.0)
    result = ended.value.result
    assert_within_limits(np.array([position for _, position in result.robot.received]), ends=True)
    assert result.robot.calls[-1] == result.source.calls[-1] == "close"


def test_an_interrupt_in_mid_motion_brakes_first():
    interrupted_s = []

    def on_send(now_s):
        if now_s >= 2.0 and not interrupted_s:
            interrupted_s.append(now_s)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as ended:
        run_live(on_send=on_send)
    times_s, received = map(np.array, zip(*ended.value.result.robot.received, strict=True))
    gap = int(np.searchsorted(times_s, interrupted_s[0]))
    assert 5 < gap < len(received) - 5
    assert_within_limits(received, ends=True, breaks=[gap], rests=False)


SIGNALLED = """
import signal, threading
from gazempc.live.process import stopped_by_signals

stop = threading.Event()
with stopped_by_signals(stop):
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        print(number != signal.SIGINT and stop.wait(60), flush=True)
        signal.raise_signal(number)
    print("alive", flush=True)
"""


HELD_UP = """
import signal, threading
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
    signal.raise_signal(signal.SIGHUP)
    print(stop.wait(60), flush=True)
"""


def test_a_signal_that_arrives_while_the_event_is_set_does_not_hang_the_process():
    """Handlers run between any two instructions of the main thread, so the second one within the first one's `set`."""
    done = subprocess.run([sys.executable, "-c", HELD_UP], capture_output=True, text=True, check=False, timeout=60)
    assert (done.stdout.split(), done.returncode) == (["True"], 0), done.stderr


def test_the_first_signal_asks_for_the_end_and_the_third_one_ends_the_process():
    done = subprocess.run([sys.executable, "-c", SIGNALLED], capture_output=True, text=True, check=False, timeout=240)
    assert (done.stdout.split(), done.returncode) == (["False", "True", "True"], -signal.SIGTERM), done.stderr
