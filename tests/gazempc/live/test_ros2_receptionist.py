"""A run as a user starts it: people, a voice and a point from ROS 2, and whom the robot looks at into a file."""

import json
import math
import threading
import time

import pytest
from builders.checks import assert_within_limits
from builders.lines import FOREVER_S
from builders.ros2_tf import TF, Stage, frames, header, transform
from builders.ros2_wire import UNIX_START_S

from gazempc.live import session
from gazempc.loop.events import Event
from gazempc.results.log import load_log
from gazempc.ros2.wire import encode, make_message

POINT, DIRECTION = "geometry_msgs/msg/PointStamped", "std_msgs/msg/Int32"
CUP_M = (2.0, 0.4, 0.3)


def sends_in_turn(stage, over, where):
    """Two people at 30 frames a second; once somebody listens, bob speaks, and then somebody points at a cup.

    It is over once the file says that the robot has looked there and back.
    """
    cup = make_message("geometry_msgs/msg/Point", **dict(zip("xyz", CUP_M, strict=True)))
    told = [
        (0.4, stage.sends("/sound_direction", DIRECTION), make_message(DIRECTION, data=-14)),
        (0.7, stage.sends("/pointing", POINT), make_message(POINT, header=header("base_link", None), point=cup)),
    ]
    tf, start_s = stage.sends("/tf", TF), math.inf
    while not over.wait(1 / 30):
        if math.isinf(start_s) and tf.matching_status.matching:
            start_s = time.monotonic()
        at_s = time.time() - 0.03 - UNIX_START_S
        anna = transform("face_anna", [1.5, 0.7, 0.2], frame_id="base_link", at_s=at_s)
        tf.put(frames(anna, transform("face_bob", [2.0, -0.5, 0.3], frame_id="base_link", at_s=at_s)))
        while told and time.monotonic() - start_s > told[0][0]:
            _, sender, message = told.pop(0)
            sender.put(encode(message))
        if time.monotonic() - start_s > FOREVER_S or (where.exists() and len(where.read_text().splitlines()) > 4):
            over.set()


@pytest.mark.slow
def test_whoever_speaks_is_looked_at_and_what_is_pointed_at_is_glanced_at(tmp_path):
    stage, over, where = Stage(), threading.Event(), tmp_path / "attention.jsonl"
    words = ["--source", "ros4hri", "--attend", "speaker", "--attention-out", where]
    words += ["--attention.hysteresis-s", "0.2", "--attention.dwell-s", "0.2", "--predictor", "constant_velocity"]
    words += ["--controller", "lookahead", "--out", tmp_path / "run", "--no-figures", "--log", "npz"]
    for name, value in (
        ("endpoint", stage.network.endpoint),
        ("base-frame", "base_link"),
        ("sound-topic", "/sound_direction"),
        ("point-topic", "/pointing"),
    ):
        words += [f"--options.ros2.{name}", value]
    sender = threading.Thread(target=sends_in_turn, args=(stage, over, where))
    sender.start()
    try:
        assert session.main([str(word) for word in words], over) == 0
    finally:
        over.set()
        sender.join()
        stage.close()
    said = [json.loads(line) for line in where.read_text().splitlines()]
    assert [(each["person_id"], each["why"], each["away_why"]) for each in said] == [
        (None, "nobody", None),
        ("anna", "policy", None),
        ("bob", "policy", None),
        ("bob", "policy", "glance"),
        ("bob", "policy", None),
        (None, "ended", None),
    ]
    assert said[2]["stays_until_s"] - said[2]["since_s"] == pytest.approx(0.2)
    assert said[3]["away_until_s"] - said[3]["away_since_s"] == pytest.approx(1.0)
    assert said[3]["time_s"] == pytest.approx(said[3]["away_since_s"], abs=0.5)
    log = load_log(tmp_path / "run" / "log_000.npz")
    assert log.attended_person.tolist() == [1, 2]
    away = (log.time_s > log.away_start_s[0]) & (log.time_s < log.away_end_s[0])
    assert abs(log.joint_position_rad[away, 0] - math.atan2(CUP_M[1], CUP_M[0])).min() < math.radians(1.0)
    assert Event.NO_SENDER not in log.event_name
    assert Event.BAD_OBSERVATION not in log.event_name
    assert_within_limits(log.command_position_rad, log.command_position_rad[0], ends=True)
