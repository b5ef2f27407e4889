"""Points and sounds of ROS 2 topics as cues, and what of them cannot be used."""

import math
import threading
from dataclasses import replace

import numpy as np
import pytest
from builders.ros2_graph import NOW_S, OPTICAL, header, make_message, polled, transform
from builders.ros2_graph import point as place
from scipy.spatial.transform import Rotation

from gazempc.errors import SettingsError
from gazempc.live.clock import RealClock
from gazempc.live.run import LiveRun
from gazempc.live.settings import LiveSettings
from gazempc.live.setup import setup_of_gaze
from gazempc.live.sources.ros2_cues import Ros2Cues, make_cue_source
from gazempc.neck.spec import load_neck
from gazempc.people.company import Glance, Sound
from gazempc.robots.options import RobotOptions, Ros2Options

POINT, INT, FLOAT = "geometry_msgs/msg/PointStamped", "std_msgs/msg/Int32", "std_msgs/msg/Float32"


def opened(stage, to_base=lambda place_m: place_m, **options):
    return stage.listening(Ros2Cues(stage.clock_s, stage.to_loop_s, Ros2Options(**options), to_base, stage.make_node))


def pointing(stage, **options):
    return opened(stage, point_topic="pointing", base_frame="base_link", **options)


def point(frame_id, place_m, at_s=None):
    return make_message(POINT, header=header(frame_id, at_s), point=place(place_m))


def test_a_point_in_the_frame_of_a_camera_is_glanced_at_where_it_was(stage):
    """The camera turns; the point is placed by where it was at its stamp, or by its newest place without one."""
    source = pointing(stage, point_lasts_s=1.5)
    stage.tf_static(transform(OPTICAL, [0.0, 0.0, 0.5], (0.5, -0.5, 0.5, -0.5), "head", at_s=None))
    left = [Rotation.from_euler("z", deg, degrees=True).as_quat(scalar_first=True) for deg in (30.0, 90.0)]
    for quat, at_s in zip(left, (NOW_S - 0.2, NOW_S - 0.1), strict=True):
        stage.tf(transform("head", [0.0, 0.0, 1.0], quat, "base_link", at_s))
    source.poll()
    for at_s, azimuth in ((NOW_S - 0.15, math.radians(60.0)), (None, math.radians(90.0))):
        stage.put("/pointing", POINT, point(OPTICAL, [0.0, 0.5, 2.0], at_s))
        (glance,), problems = polled(source, 1)
        assert problems == []
        assert (type(glance), glance.lasts_s) == (Glance, 1.5)
        expected_m = [2.0 * math.cos(azimuth), 2.0 * math.sin(azimuth), 1.0]
        np.testing.assert_allclose(glance.target_base_m, expected_m, atol=1e-5)


def test_a_point_in_an_unknown_frame_is_waited_for_and_then_a_problem(stage):
    source = pointing(stage)
    stage.put("/pointing", POINT, point("base_link", [np.nan, 0, 0]))
    found, (problem,) = polled(source, 1)
    assert found == []
    assert "/pointing" in problem
    assert "nan" in problem
    stage.put("/pointing", POINT, point("cup", [1, 0, 0]))
    assert source.poll().problems == ()
    stage.tf_static(transform("cup", [0, 1, 0], frame_id="base_link", at_s=None))
    (glance,), problems = polled(source, 1)
    assert problems == []
    np.testing.assert_allclose(glance.target_base_m, [1, 1, 0])
    stage.put("/pointing", POINT, point("bottle", [1, 0, 0]))
    assert source.poll().problems == ()
    stage.now_s += 0.25
    _, (problem,) = polled(source, 1)
    assert "'bottle' to 'base_link'" in problem


@pytest.mark.parametrize(("type_name", "value", "azimuth_rad"), [(INT, -90, -math.pi / 2), (FLOAT, 0.5, 0.5)])
def test_a_direction_of_speech_in_degrees_or_radians(stage, type_name, value, azimuth_rad):
    source = opened(stage, sound_topic="/sound_direction", sound_type=type_name)
    for data in (value, 1000):
        stage.put("/sound_direction", type_name, make_message(type_name, data=data))
    found, (problem,) = polled(source, 2)
    assert found == [Sound(NOW_S, azimuth_rad)]
    assert "is 1000" in problem


def test_speech_heard_by_a_head_that_is_turned(stage):
    def turned_left(place_m):
        return Rotation.from_euler("z", 10.0, degrees=True).apply(place_m) + 1.0

    source = opened(stage, turned_left, sound_topic="heard", sound_frame="microphones", base_frame="base_link")
    stage.put("/heard", INT, make_message(INT, data=20))
    _, (problem,) = polled(source, 1)
    assert "'microphones' to 'base_link'" in problem
    quat = Rotation.from_euler("z", -50.0, degrees=True).as_quat(scalar_first=True)
    stage.tf(transform("microphones", [0, 0, 1], quat, "base_link"))
    source.poll()
    stage.put("/heard", INT, make_message(INT, data=20))
    (sound,), _ = polled(source, 1)
    assert math.degrees(sound.azimuth_rad) == pytest.approx(20 - 50 + 10)


@pytest.mark.parametrize(
    ("ros2", "settings", "why"),
    [
        ({"point_topic": "p"}, {"attend": "nearest"}, "needs options.ros2.base_frame"),
        ({"point_topic": "p", "base_frame": "b"}, {}, "look_away.rhythm told"),
        ({"sound_topic": "s"}, {"look_away": {"rhythm": "told"}}, "accepted with attend, such as speaker"),
    ],
)
def test_topics_that_do_not_go_with_the_settings(ros2, settings, why):
    told = LiveSettings(source="ros4hri", options=RobotOptions(ros2=Ros2Options(**ros2)), **settings)
    with pytest.raises(SettingsError, match=why):
        make_cue_source(told, load_neck("reference"), RealClock(), mounted=True)


def test_a_gaze_from_python_hears_them_too(stage):
    settings = {"attend": "speaker"}
    setup, _, _ = setup_of_gaze("reference", "simulated", "lookahead", "constant_velocity", settings)
    cues = Ros2Cues(
        setup.clock.now_s, lambda unix_s: unix_s, Ros2Options(sound_topic="heard"), lambda at_m: at_m, stage.make_node
    )
    run = LiveRun(replace(setup, more_sources=(cues,)), lambda log, times: None)

    def heard():
        for degrees in (20, 1000):
            stage.put("/heard", INT, make_message(INT, data=degrees))

    run.run(threading.Event(), 0.3, heard)
    assert run.logs.events["bad_observation"] == 1
    (sound,) = setup.several.several.attention._sounds
    assert math.degrees(sound.azimuth_rad) == pytest.approx(20)
    assert "/heard" in run.report.problems[0]
