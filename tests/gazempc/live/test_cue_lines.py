"""Cues among the lines of a tracker: read, refused with the field, and handed on."""

import json
import time

import pytest
from builders.lines import FOREVER_S

from gazempc.live.clock import RealClock
from gazempc.live.sources.json_lines import LineError, is_cue, parse_cue
from gazempc.live.sources.streams import LineSource
from gazempc.live.sources.wires import Chunk
from gazempc.people.company import Glance, Rhythm, Sound, Speech, Thinking


@pytest.mark.parametrize(
    ("line", "cue"),
    [
        ({"cue": "sound", "azimuth_rad": 0.3}, Sound(7.0, 0.3)),
        ({"cue": "thinking", "lasts_s": 1.5}, Thinking(1.5)),
        ({"cue": "speech", "in_s": 2}, Speech(2.0)),
        ({"cue": "rhythm", "mode": "speaking"}, Rhythm("speaking")),
    ],
)
def test_each_cue_is_read(line, cue):
    text = json.dumps(line)
    assert is_cue(text)
    assert parse_cue(text, 7.0) == cue
    glance = parse_cue('{"cue": "glance", "target_base_m": [1, 0.5, 0], "lasts_s": 1}', 7.0)
    assert (type(glance), glance.target_base_m.tolist(), glance.lasts_s) == (Glance, [1.0, 0.5, 0.0], 1.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"cue": "sond", "azimuth_rad": 0}', "sound"),
        ('{"cue": "sound"}', "azimuth_rad.*required"),
        ('{"cue": "sound", "azimuth_rad": "left"}', "azimuth_rad.*number"),
        ('{"cue": "sound", "azimuth_rad": 0, "volume": 3}', "volume"),
        ('{"cue": "glance", "target_base_m": [1, 2], "lasts_s": 1}', "target_base_m"),
        ('{"cue": "rhythm", "mode": "sleeping"}', "mode.*speaking"),
        ('{"cue": ', "JSON"),
    ],
)
def test_what_is_no_cue_is_refused_with_the_field(text, said):
    with pytest.raises(LineError, match=said):
        parse_cue(text, 0.0)


def test_a_source_gives_cues_beside_observations():
    class Wire:
        name = "a wire"
        lines = (
            b'{"age_s": 0.01, "head_position_m": [2, 0, 0.4], "person_id": "cue"}\n{"cue": "thinking", "lasts_s": 1}\n',
            b'{"cue": "thinking"}\n',
        )

        def open(self):
            self.left = list(self.lines)

        def read(self):
            return [Chunk(self.left.pop(0))] if self.left else None

        def close(self):
            pass

    source = LineSource(Wire(), RealClock())
    source.open()
    until_s, cues, sightings, problems = time.monotonic() + FOREVER_S, [], [], []
    while not (cues and problems and sightings):
        arrived = source.poll()
        cues, sightings = [*cues, *arrived.cues], [*sightings, *arrived.sightings]
        problems = [*problems, *arrived.problems]
        assert time.monotonic() < until_s
    source.close()
    assert cues == [Thinking(1.0)]
    assert sightings[0].observation.person_id == "cue"
    assert problems[0].startswith("a wire, line 3: thinking.lasts_s")
