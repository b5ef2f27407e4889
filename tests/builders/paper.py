"""Walks and rows for the paper's validation."""

import dataclasses
import itertools
import json
from types import SimpleNamespace

import numpy as np

from experiments.engine.job import carry_out, program_hash
from experiments.paper import frames
from experiments.paper.filters import TUNED_TIME_S
from experiments.paper.frames import FrameJob, labelled
from gazempc.recordings.readers.tables.people import COLUMNS
from gazempc.recordings.recording import Labels, Recording, Track
from gazempc.recordings.synthetic.walks import generate


def execute(job):
    """The row of a job, done in this process."""
    return labelled(job.recording, carry_out(job, job.key(), program_hash()))


def made_errors(monkeypatch, position_m, time_s=TUNED_TIME_S, rules=("paper",), valid=None, head_deg=0.0):
    """A row made from a noise-free measured track in the sensor's own frame, body along x."""
    count = len(position_m)
    half = np.deg2rad(np.broadcast_to(head_deg, count)) / 2
    head = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    waist = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    valid = np.ones(count, dtype=bool) if valid is None else valid
    seen = [np.where(valid[:, None], x, np.nan) for x in (position_m, head, position_m - [0, 0, 0.6], waist)]
    times_s = np.arange(count) / 30
    truth = Track(position_m, head, position_m - [0, 0, 0.6], waist, np.ones(count, dtype=bool))
    name = f"made{next(_COUNTER)}"  # never the same, as what is made of a recording is kept by its name
    labels = Labels("me", "straight")
    recording = Recording(name, "made", "body tracking", times_s, truth, Track(*seen, valid), True, labels)
    scene = SimpleNamespace(walk=recording)
    monkeypatch.setattr(frames, "make_scene", lambda _: scene)
    row = execute(FrameJob(name, time_s, rules, 0))
    assert row["failed"] is None
    assert row["left_out"] is None
    return row


_COUNTER = itertools.count()


VELOCITY_M_S = np.array([0.9, -0.5, 0.0])


def line_m(count=120, start_m=(1.0, 1.0, 0.4), velocity_m_s=VELOCITY_M_S):
    return np.array(start_m) + np.arange(count)[:, None] / 30 * np.array(velocity_m_s)


WALKS = {
    "ann_1": "subject01_R1",
    "ann_2": "subject01_R4",
    "bob_1": "subject02_R2",
    "bob_2": "subject02_R6",
    "eve_1": "subject03_R3",
    "eve_2": "subject03_R5",
}


PEOPLE = {"ann": "A", "bob": "B", "eve": "E"}
GROUPS = {"R1": "straight", "R2": "straight", "R3": "turn", "R4": "turn", "R5": "sharp", "R6": "sharp"}


def write_walk(path, track, times_s):
    columns = (track.head_position_m, track.head_quat_wxyz, track.pelvis_position_m, track.pelvis_quat_wxyz)
    values = np.column_stack([times_s, *columns])
    np.savetxt(path, values, delimiter=",", header=",".join(COLUMNS), comments="", fmt="%.6f")


def write_walks(folder, walks=WALKS, frame_count=None, **changes):
    """Synthetic tracks as CSV files; who walks and the group stand in the index alone."""
    folder.mkdir()
    lines = ["clip,subject,group"]
    for clip, source in walks.items():
        recording = generate(source)
        part = slice(frame_count)
        parts = {f.name: getattr(recording.truth, f.name)[part] for f in dataclasses.fields(Track)}
        write_walk(folder / f"{clip}.csv", Track(**parts), recording.times_s[part])
        labels = {"subject": PEOPLE[clip[:3]], "group": GROUPS[source[-2:]]} | changes
        lines.append(f"{clip},{labels['subject']},{labels['group']}")
    (folder / "index.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def strict_json(text):
    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    return json.loads(text, parse_constant=refuse)
