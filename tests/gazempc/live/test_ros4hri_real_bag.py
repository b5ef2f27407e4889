"""What real ROS4HRI nodes sent, once more on the wire: the source sees what they meant."""

import numpy as np
from builders.ros2_graph import Stage, typestore
from rosbags.rosbag2 import Reader

from gazempc.live.sources.ros4hri import Ros4HriPeople
from gazempc.recordings.readers.bag import read_bag_tracks
from gazempc.robots.options import Ros2Options

NAME, PEOPLE = "2p_AA_FV_eng_1", {"eloek", "ghfbv"}
SHOWN_S = 1.8
# Of two people at 30 frames a second.
LEAST = 90
READ = ("tf2_msgs/msg/TFMessage", "hri_msgs/msg/IdsList", "std_msgs/msg/String")


def first_messages(path):
    """Topic, type, time of recording and bytes of what was sent in the first moments."""
    with Reader(path) as bag:
        found = [(c.topic, c.msgtype, 1e-9 * ns, raw) for c, ns, raw in bag.messages() if c.msgtype in READ]
    return [message for message in found if message[2] <= found[0][2] + SHOWN_S]


def seen_live(messages, base_frame):
    """Observations of all people, with times as recorded."""
    stage, start_s = Stage(), messages[0][2]
    stage.now_s = 0.0
    found, problems = [], []
    options = Ros2Options(base_frame=base_frame)
    source = stage.listening(Ros4HriPeople(stage.clock_s, lambda unix_s: unix_s - start_s, options, stage.make_node))
    for topic, type_name, at_s, raw in messages:
        stage.now_s = at_s - start_s
        stage.put(topic, type_name, decode(raw, type_name), latched=topic != "/tf")
        arrived = source.poll()
        found.extend(sighting.observation for sighting in arrived.sightings)
        problems.extend(arrived.problems)
    assert len(found) >= LEAST
    return found, problems, start_s


def decode(raw, type_name):
    return typestore().deserialize_cdr(raw, type_name)


def test_faces_are_where_the_recording_has_them(bags_dir):
    messages = first_messages(bags_dir / NAME)
    found, problems, start_s = seen_live(messages, None)
    assert problems == []
    tracks = [seen.poses for seen, _ in read_bag_tracks(bags_dir / NAME)]
    times_s = np.concatenate([track.times_s for track in tracks]) - start_s
    position_m = np.concatenate([track.position_m for track in tracks])
    for seen in found:
        at = abs(times_s - seen.capture_time_s) < 1e-4
        error_m = np.linalg.norm(position_m[at] - seen.head_position_base_m, axis=1)
        assert error_m.min() < 1e-9
    assert {seen.person_id for seen in found[len(found) // 2 :]} == PEOPLE
