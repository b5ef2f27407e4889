"""A walk in a moving frame, a controller with dead time, and the node between: against the run without ROS."""

from builders.ros2_real import rclpy_or_skip

rclpy_or_skip()

import json
import time

import numpy as np
import pytest

import gazempc as gz
from gazempc.live.clock import RealClock
from gazempc.live.sources.replay import ReplaySource
from gazempc.neck.kinematics import gaze_error_rad
from gazempc.recordings.recording import TrueHead
from gazempc.results.log_files import load_log
from gazempc.sim.scene import SceneSettings, make_scene

pytestmark = pytest.mark.slow
NECK = gz.load_neck("reference")
PASSES = 3
CONE_RAD = np.deg2rad(2.6)


def contacts(times_s, joints_rad, head_times_s, heads_m):
    """Per pass, share of the time from 1 s after the first head to the last in which the error is within the cone."""
    # A walk restarts after two seconds without a person.
    starts = np.flatnonzero(np.diff(head_times_s, prepend=-np.inf) > 1.0)
    ends = np.append(starts[1:], head_times_s.size) - 1
    heads = np.stack([np.interp(times_s, head_times_s, heads_m[:, k]) for k in range(3)], axis=1)
    within = gaze_error_rad(NECK.geometry, joints_rad, heads) <= CONE_RAD
    each = zip(head_times_s[starts] + 1.0, head_times_s[ends], strict=True)
    return np.array([np.mean(within[(times_s >= first) & (times_s <= last)]) for first, last in each])


def contacts_without_ros(passes):
    """Equal settings, including the node's computing time."""
    loop = {"compute_delay_s": 0.02}
    scene = make_scene("subject03_R4", SceneSettings(), NECK)
    clock, heads = RealClock(), []
    source, true_head = ReplaySource(scene.walk, scene.sensor, 0, clock, passes, ()), TrueHead(scene.walk)
    with gz.Gaze("reference", "simulated", loop=loop) as gaze:
        source.open()
        while not source.finished:
            for sighting in source.poll().sightings:
                seen = sighting.observation
                captured_s = time.time() - (clock.now_s() - seen.capture_time_s)
                gaze.see(captured_s, seen.head_position_base_m)
                heads.append(
                    [
                        gaze._setup.clock.from_unix_s(captured_s),
                        *true_head(source.own_s(np.array([seen.capture_time_s])))[0],
                    ]
                )
            time.sleep(0.001)
    log, heads = gaze.log(), np.array(heads)
    return contacts(log.time_s, log.joint_position_rad, heads[:, 0], heads[:, 1:]), log


def latencies_ms(log, tracker):
    """Time from sending a message to the tick that uses it."""
    log_age_s = log.arrival_time_s - log.capture_time_s
    offsets = tracker[:, 0][:, None] - log.capture_time_s[None]
    offset_s = np.median(offsets[np.abs(offsets - np.median(np.diag(offsets))) < 0.2])
    k = np.abs(tracker[:, 0][None] - (log.capture_time_s + offset_s)[:, None]).argmin(axis=1)
    return 1e3 * (log_age_s - (tracker[k, 1] - tracker[k, 0]))


def test_eye_contact_and_latency_equal_those_without_ros(stage):
    controller = stage.controller()
    gaze = stage.gaze()
    gaze.until("robot ros2")
    tracker = stage.tracker("--passes", str(PASSES))
    assert tracker.stop(how=0, timeout_s=120.0) == 0, tracker.text()
    assert gaze.stop() == 0, gaze.text()
    assert controller.stop() == 0, controller.text()
    times_s, _, joints_rad, speeds_rad_s, file = stage.rows()
    walked = np.load(stage.tracker_file)
    with_ros = contacts(times_s, joints_rad, walked[:, 0], walked[:, 2:])
    without, plain = contacts_without_ros(PASSES)
    log = load_log(stage.gaze_file)
    into_ms = latencies_ms(log, walked)
    out_ms = file["transports_ms"]
    plain_age_ms, age_ms = (1e3 * np.median(each.arrival_time_s - each.capture_time_s) for each in (plain, log))
    p = lambda values: "  ".join(f"{np.percentile(values, q):6.2f}" for q in (50, 99))  # noqa: E731
    print(f"\ncontact within 2.6 deg: {100 * with_ros.mean():.2f} % with ROS, {100 * without.mean():.2f} % without")
    print(f"message sent to the tick that uses it, ms (p50, p99): {p(into_ms)}")
    print(f"command sent to received, ms (p50, p99):              {p(out_ms)}")
    both_ms = np.random.default_rng(0).choice(into_ms, 9999) + np.random.default_rng(1).choice(out_ms, 9999)
    print(f"both, ms (p50, p99):                                  {p(both_ms)}")
    print(f"age of observations, ms (p50): {age_ms:.1f} with ROS, {plain_age_ms:.1f} without")
    assert list(file["refused"]) == []
    assert gz.measure(log).limit_violations == 0
    assert abs(speeds_rad_s).max() <= 1.03 * NECK.velocity_max_rad_s.max()
    assert with_ros.size == without.size == PASSES
    # On an idle computer the means differ by 0.01 and messages take 1 ms, see docs/ros2.md. On a busy one, messages can
    # wait for a third of a second in one pass: the pass with the smallest loss counts, and the tracker's period.
    assert (with_ros - without).max() > -0.05
    assert np.median(both_ms) < 33.0


def test_eye_contact_of_the_live_command_equals_that_without_ros(stage):
    """Source and robot `ros2` of the command line."""
    controller, tracker = stage.controller(), stage.tracker("--passes", "20")
    out = stage.folder / "live"
    words = ["-m", "gazempc.live", "--source", "ros2:/person/pose", "--robot", "ros2", "--out", str(out)]
    words += ["--neck", str(stage.neck_file), "--options.ros2.base-frame", "base_link", "--duration-s", "8"]
    live = stage.start("live", *words, "--no-figures")
    assert live.stop(how=0, timeout_s=120.0) == 0, live.text()
    tracker.stop()
    assert controller.stop() == 0, controller.text()
    summary = json.loads((out / "summary.json").read_text())
    assert summary["used"] > 60
    assert summary["limit_violations"] == 0
    assert list(stage.rows()[-1]["refused"]) == []
