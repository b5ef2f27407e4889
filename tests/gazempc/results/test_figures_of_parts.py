"""Figures of necks with eyes and body, and of runs in which there is little to show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders.recordings import synthetic
from builders.replays import replayed
from scipy.spatial.transform import Rotation

from gazempc.neck.spec import load_neck
from gazempc.results.figures.animation import head_offset_deg, part_offsets_deg
from gazempc.results.figures.known import parts
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg

PLAIN, EYES = load_neck("reference"), load_neck("reference_eyes")
ALL = EYES.model_copy(update={"name": "all", "body": load_neck("reachy_mini_body").body})


@pytest.fixture(scope="module", params=[PLAIN, ALL], ids=["plain", "eyes and body"])
def log(request: pytest.FixtureRequest) -> Log:
    return replayed(synthetic("subject02_R4"), "reactive", neck=request.param)


def test_parts_point_where_rotations_say(log: Log) -> None:
    k = log.time_s.size // 2
    joints = dict(zip(log.neck.joint_names, log.joint_position_rad[k], strict=True))
    body = Rotation.from_euler("z", joints.get("body_yaw", 0.0))
    head = body * Rotation.from_euler("z", joints["pan"]) * Rotation.from_euler("y", -joints["tilt"])
    wanted = {"robot's head": head.apply([1, 0, 0])} if "eye_pan" in joints else {}
    wanted |= {"robot's body": body.apply([1, 0, 0])} if "body_yaw" in joints else {}
    found = {part.label: part.direction[k] for part in parts(log)}
    assert found.keys() == wanted.keys()
    for label, direction in wanted.items():
        np.testing.assert_allclose(found[label], direction, atol=1e-12)


def test_the_eye_sees_the_head_where_the_eyes_are_turned_away_from(log: Log) -> None:
    """Eyes turned left and up: the head points to the right of the gaze and below it."""
    offset = head_offset_deg(log)
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), gaze_error_deg(log), atol=1e-6)
    if log.neck.eyes is None:
        return
    joints = log.joint_position_rad.copy()
    joints[:, 2:4] = np.deg2rad([6.0, 3.0])
    marker, found = part_offsets_deg(replace(log, joint_position_rad=joints))["robot's head"]
    assert marker == "s"
    np.testing.assert_allclose(found, np.broadcast_to([6.0, -3.0], found.shape), atol=0.3)
