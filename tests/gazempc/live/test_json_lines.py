"""Observations as lines of JSON: what is accepted, and complaints that name the field."""

import contextlib
import json
import math

import numpy as np
import pytest
from builders.lines import HEAD
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gazempc.live.sources.json_lines import FIELDS, LineError, parse_line


def parse(data, arrival_s=10.0):
    text = data if isinstance(data, str) else json.dumps(data)
    return parse_line(text, arrival_s, lambda unix_s: unix_s - 1000.0)


finite = st.floats(-1e6, 1e6)


@given(
    position=st.lists(finite, min_size=3, max_size=3),
    stamp=st.one_of(
        st.tuples(st.just("capture_time_s"), finite),
        st.tuples(st.just("age_s"), st.floats(0.0, 10.0)),
    ),
    turns=st.tuples(*[st.none() | st.tuples(*[st.floats(-3.0, 3.0)] * 3)] * 2),
    indent=st.none() | st.just("\t"),
)
def test_what_is_written_is_read(position, stamp, turns, indent):
    quats = [None if t is None else Rotation.from_rotvec(t).as_quat(scalar_first=True).tolist() for t in turns]
    data = {stamp[0]: stamp[1], "head_position_m": position, "head_quat_wxyz": quats[0], "pelvis_quat_wxyz": quats[1]}
    text = json.dumps(data, separators=(",", ":") if indent is None else (" , ", " : "))
    for line in (text, f"  {text}\r"):
        found = parse(line)
        assert found.head_position_base_m.tolist() == position
        for quat, value in zip(quats, (found.head_quat_wxyz, found.pelvis_quat_wxyz), strict=True):
            assert quat == (None if value is None else value.tolist())
        expected_s = stamp[1] - 1000.0 if stamp[0] == "capture_time_s" else 10.0 - stamp[1]
        assert found.capture_time_s == expected_s
    # What may be left out may be left out.
    short = {k: v for k, v in data.items() if v is not None}
    assert parse(short).head_position_base_m.tolist() == position
    stated = {"head_yaw_sd_rad": 0.1, "pelvis_yaw_sd_rad": 3.0, "confidence": 1}
    found = parse(data | stated | {"person_id": 7, "position_covariance_m2": COVARIANCE})
    assert {name: getattr(found, name) for name in stated} == stated
    assert (found.person_id, found.position_covariance_m2.tolist()) == ("7", COVARIANCE)


GOOD = {"age_s": 0.05, "head_position_m": HEAD}
COVARIANCE = [[0.25, 0.005, 0.0], [0.005, 0.0004, 0.0], [0.0, 0.0, 0.0004]]


NAMED = "head_position_m"


@pytest.mark.parametrize(
    ("line", "named", "accepted"),
    [
        ("{", "Invalid JSON", ""),
        ("[" * 100_000, "Invalid JSON", "recursion"),
        ('{"age_s": 66, "head_position_m": [2.0, 0.0, 0.4]}', "age_s", "less than or equal to 10"),
        (GOOD | {"age_s": True}, "age_s", "number"),
        (GOOD | {"head_positon_m": HEAD}, "head_positon_m", NAMED),
        ({"age_s": 0.05}, NAMED, "required"),
        ({NAMED: HEAD}, "capture_time_s", "age_s"),
        ('{"age_s": 1e999, "head_position_m": [2, 0, 0]}', "age_s", "number"),
        ('{"capture_time_s": -Infinity, "head_position_m": [2, 0, 0]}', "capture_time_s", "finite"),
        (GOOD | {NAMED: [1, 2]}, NAMED, "required"),
        (GOOD | {NAMED: ["1", 2, 3]}, NAMED, "number"),
        (GOOD | {"head_quat_wxyz": [0, 0, 0, 0]}, "head_quat_wxyz", "unit length"),
        (GOOD | {"position_covariance_m2": [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]}, "position_covariance_m2", "symmetric"),
        (GOOD | {"head_yaw_sd_rad": 0}, "head_yaw_sd_rad", "positive"),
        (GOOD | {"confidence": 80}, "confidence", "0 to 1"),
        (GOOD | {"person_id": 1.5}, "person_id", ""),
    ],
)
def test_every_complaint_names_the_field_and_what_is_accepted(line, named, accepted):
    with pytest.raises(LineError) as raised:
        parse(line)
    message = str(raised.value)
    assert named in message
    assert accepted in message
    assert "base_m" not in message  # a name from inside
    assert len(message) < 1000


@given(st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(), lambda inner: st.lists(inner)
       | st.dictionaries(st.sampled_from(FIELDS) | st.text(), inner), max_leaves=12))  # fmt: skip
def test_whatever_json_comes_it_is_an_observation_or_a_complaint(data):
    for line in (
        data,
        GOOD | {"head_position_m": data},
        GOOD | {"head_quat_wxyz": data},
        GOOD | {"age_s": data},
        GOOD | {"position_covariance_m2": data},
        GOOD | {"person_id": data},
    ):
        with contextlib.suppress(LineError):
            found = parse(json.dumps(line))
            assert np.all(np.isfinite(found.head_position_base_m))
            assert math.isfinite(found.capture_time_s)
