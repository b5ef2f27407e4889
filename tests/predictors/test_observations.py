"""Observations and orientations: what is refused, and headings."""

import ast
import subprocess
import sys
from dataclasses import FrozenInstanceError
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import predictors
from predictors import Forecast, HeadObservation
from predictors.geometry import wrap_rad, yaw_rad

GOOD = np.array([1.0, 2.0, 3.0])
QUAT = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.nan, GOOD), "capture_time_s is not finite"),
        ((np.inf, GOOD), "capture_time_s is not finite"),
        ((0.0, GOOD * np.nan), "head_position_base_m is not finite"),
        ((0.0, np.array([1.0, np.inf, 0.0])), "head_position_base_m is not finite"),
        ((0.0, np.ones(2)), r"head_position_base_m has shape \(2,\), expected \(3,\)"),
        ((0.0, np.ones((1, 3))), "head_position_base_m has shape"),
        ((0.0, GOOD, np.ones(3)), "head_quat_wxyz has shape"),
        ((0.0, GOOD, QUAT * np.nan), "head_quat_wxyz is not finite"),
        ((0.0, GOOD, QUAT, 1.01 * QUAT), "pelvis_quat_wxyz is not of unit length"),
        ((0.0, GOOD, np.zeros(4)), "head_quat_wxyz is not of unit length"),
    ],
)
def test_observation_refuses(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        HeadObservation(*arguments)  # type: ignore[arg-type]


def test_observation_takes_plain_lists_and_is_frozen() -> None:
    observation = HeadObservation(0.0, [1, 2, 3], [1, 0, 0, 0])  # type: ignore[arg-type]
    assert observation.head_position_base_m.dtype == np.float64
    assert observation.head_quat_wxyz is not None
    assert observation.pelvis_quat_wxyz is None
    with pytest.raises(FrozenInstanceError):
        observation.capture_time_s = 1.0  # type: ignore[misc]


@given(yaw=st.floats(-np.pi, np.pi), pitch=st.floats(-1.5, 1.5), roll=st.floats(-np.pi, np.pi))
def test_yaw_is_the_heading_of_the_forward_axis(yaw: float, pitch: float, roll: float) -> None:
    rotation = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    x, y, _ = rotation.apply([1.0, 0.0, 0.0])
    quat = rotation.as_quat(scalar_first=True)
    assert abs(wrap_rad(yaw_rad(quat) - np.arctan2(y, x))) < 1e-9
    assert abs(wrap_rad(yaw_rad(-quat) - yaw)) < 1e-9


@given(angle=st.floats(-50, 50))
def test_wrapped_angle_is_the_same_direction_within_half_a_turn(angle: float) -> None:
    wrapped = wrap_rad(angle)
    assert -np.pi < wrapped <= np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-12)


def test_wrap_keeps_plus_pi() -> None:
    assert wrap_rad(np.pi) == wrap_rad(-np.pi) == np.pi


def test_predictors_know_nothing_of_gaze() -> None:
    """Neither in an import statement anywhere in the package, nor by what an import pulls in."""
    folder = Path(predictors.__file__).parent
    for file in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not {"gazempc", "experiments"} & {name.split(".")[0] for name in names}, file.name
    code = "import sys, predictors; print([m for m in sys.modules if m.split('.')[0] in ('gazempc', 'filterpy')])"
    done = subprocess.run([sys.executable, "-c", code], cwd=folder.parent, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_forecast_may_be_made_of_lists():
    forecast = Forecast([1.0, 2.0], [[1, 2, 3], [4, 5, 6]], np.zeros((2, 3, 3)).tolist(), 0.5)
    for value, shape in (
        (forecast.times_s, (2,)),
        (forecast.means_base_m, (2, 3)),
        (forecast.covariances_m2, (2, 3, 3)),
    ):
        assert (value.shape, value.dtype) == (shape, np.float64)
    with pytest.raises(ValueError, match=r"covariances_m2 of a forecast for 2 times has shape \(2,\), expected"):
        Forecast([1.0, 2.0], np.zeros((2, 3)), [1e-4, 1e-4], 0.5)
