"""Walks and rows for the paper's validation."""

import itertools
from types import SimpleNamespace

import numpy as np

from experiments.engine.job import carry_out, program_hash
from experiments.paper import frames
from experiments.paper.filters import TUNED_TIME_S
from experiments.paper.frames import FrameJob, labelled
from gazempc.recordings.recording import Labels, Recording, Track


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
    truth = Track(position_m, head, position_m - [0, 0, 0.6], waist)
    name = f"made{next(_COUNTER)}"  # unique, because results are cached by recording name
    labels = Labels("me", "straight")
    recording = Recording(name, "made", "body tracking", times_s, truth, Track(*seen), True, labels)
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
