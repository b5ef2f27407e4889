"""Observations as lines of JSON: accepted lines, and errors that name the field."""

import contextlib
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gazempc.live.sources.json_lines import FIELDS, LineError, is_cue, parse_cue, parse_line
from gazempc.people.company import Glance, Rhythm, Sound, Speech, Thinking


def parse(data, arrival_s=10.0):
    text = data if isinstance(data, str) else json.dumps(data)
    return parse_line(text, arrival_s, lambda unix_s: unix_s - 1000.0)


finite = st.floats(-1e6, 1e6)


@given(
    position=st.lists(finite, min_size=3, max_size=3),
    stamp=st.tuples(st.just("capture_time_s"), finite) | st.tuples(st.just("age_s"), st.floats(0.0, 10.0)),
    turn=st.none() | st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)
def test_observations_survive_a_round_trip(position, stamp, turn):
    quat = None if turn is None else Rotation.from_rotvec(turn).as_quat(scalar_first=True).tolist()
    data = {stamp[0]: stamp[1], "head_position_m": position, "head_quat_wxyz": quat, "pelvis_quat_wxyz": [0, 0, 0, 1]}
    stated = {"head_yaw_sd_rad": 0.1, "pelvis_yaw_sd_rad": 3.0, "confidence": 1}
    more = stated | {"person_id": 7, "position_covariance_m2": COVARIANCE}
    found = parse(f"  {json.dumps(data | more)}\r")
    assert found.head_position_base_m.tolist() == position
    assert found.capture_time_s == (stamp[1] - 1000.0 if stamp[0] == "capture_time_s" else 10.0 - stamp[1])
    assert quat == (None if found.head_quat_wxyz is None else found.head_quat_wxyz.tolist())
    assert found.pelvis_quat_wxyz.tolist() == [0, 0, 0, 1]
    assert {name: getattr(found, name) for name in stated} == stated
    assert (found.person_id, found.position_covariance_m2.tolist()) == ("7", COVARIANCE)
    # Optional fields may be absent.
    assert parse({name: data[name] for name in (stamp[0], "head_position_m")}).head_position_base_m.tolist() == position


HEAD = [2.1, 0.3, 0.4]
GOOD = {"age_s": 0.05, "head_position_m": HEAD}
COVARIANCE = [[0.25, 0.005, 0.0], [0.005, 0.0004, 0.0], [0.0, 0.0, 0.0004]]


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("{", "JSON"),
        (GOOD | {"age_s": 66}, "age_s"),
        (GOOD | {"head_positon_m": HEAD}, "head_position_m"),
        ({"head_position_m": HEAD}, "capture_time_s"),
        ('{"age_s": 1e999, "head_position_m": [2, 0, 0]}', "age_s"),
        (GOOD | {"head_position_m": [1, 2]}, "head_position_m"),
        (GOOD | {"head_quat_wxyz": [0, 0, 0, 0]}, "head_quat_wxyz"),
        (GOOD | {"position_covariance_m2": [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]}, "position_covariance_m2"),
        (GOOD | {"confidence": 80}, "confidence"),
        ({"cue": "sond", "azimuth_rad": 0}, "sound"),
        ({"cue": "sound", "azimuth_rad": 0, "volume": 3}, "volume"),
        ({"cue": "rhythm", "mode": "sleeping"}, "mode"),
    ],
)
def test_every_error_names_the_field(line, named):
    with pytest.raises(LineError) as raised:
        parse_cue(json.dumps(line), 0.0) if "cue" in line else parse(line)
    message = str(raised.value)
    assert named in message
    assert "base_m" not in message  # a name from inside
    assert len(message) < 1000


@settings(max_examples=20)
@given(st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(), lambda inner: st.lists(inner)
       | st.dictionaries(st.sampled_from(FIELDS) | st.text(), inner), max_leaves=12))  # fmt: skip
def test_any_json_is_an_observation_or_an_error(data):
    fields = ("head_position_m", "head_quat_wxyz", "age_s", "position_covariance_m2", "person_id")
    for line in (data, *(GOOD | {field: data} for field in fields)):
        with contextlib.suppress(LineError):
            found = parse(json.dumps(line))
            assert np.all(np.isfinite(found.head_position_base_m))
            assert math.isfinite(found.capture_time_s)


@pytest.mark.parametrize(
    ("line", "cue"),
    [
        ({"cue": "sound", "azimuth_rad": 0.3}, Sound(7.0, 0.3)),
        ({"cue": "thinking", "lasts_s": 1.5}, Thinking(1.5)),
        ({"cue": "speech", "in_s": 2}, Speech(2.0)),
        ({"cue": "rhythm", "mode": "speaking"}, Rhythm("speaking")),
    ],
)
def test_every_cue_type_is_parsed(line, cue):
    assert is_cue(json.dumps(line))
    assert parse_cue(json.dumps(line), 7.0) == cue
    glance = parse_cue('{"cue": "glance", "target_base_m": [1, 0.5, 0], "lasts_s": 1}', 7.0)
    assert (type(glance), glance.target_base_m.tolist(), glance.lasts_s) == (Glance, [1.0, 0.5, 0.0], 1.0)
