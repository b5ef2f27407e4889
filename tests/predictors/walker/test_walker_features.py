"""What the networks of `Walker` read: symmetric, bounded, and with the meaning that it is said to have."""

import numpy as np
import pytest
from builders.people import yaw_quat
from scipy.spatial.transform import Rotation

from predictors import HeadObservation
from predictors.walker.features import WalkerHistory
from predictors.walker.window import WINDOW

STATE = np.array([0.0, 0.0, 0.4, 1.2, 0.0, 0.0])


def test_positions_are_relative_to_the_line_in_its_own_frame():
    """A walk to the left whose head is 4 cm off to its own left, ten frames ago: one unit across."""
    history = WalkerHistory()
    velocity = np.array([0.0, 1.2, 0.0])
    for k in range(60):
        at = np.array([1.0, 1.2 * k / 30, 0.4])
        seen = at - [0.04 if k == 49 else 0.0, 0.0, 0.0]
        surely = 1e-8 * np.eye(3)
        inputs = history.add(HeadObservation(k / 30, seen), np.concatenate([at, velocity]), surely)
    assert inputs.line.heading_rad == pytest.approx(np.pi / 2)
    positions = inputs.network[: 3 * WINDOW].reshape(WINDOW, 3)
    expected = np.zeros((WINDOW, 3))
    expected[-11, 1] = 1.0
    np.testing.assert_allclose(positions, expected, atol=0.01)


def test_yaws_are_relative_to_the_line_and_zero_for_who_stands():
    def yaws(speed):
        history = WalkerHistory()
        for k in range(40):
            seen = HeadObservation(k / 30, [speed * k / 30, 0, 0.4], yaw_quat(0.2), yaw_quat(0.15))
            state = np.array([speed * k / 30, 0.0, 0.4, speed, 0.0, 0.0])
            inputs = history.add(seen, state, 1e-4 * np.eye(3))
        return inputs.network[3 * WINDOW : 5 * WINDOW].reshape(WINDOW, 2)

    np.testing.assert_allclose(yaws(1.2), 1.0)  # pelvis over 0.15, head over 0.2
    np.testing.assert_allclose(yaws(0.35), 0.5)
    np.testing.assert_array_equal(yaws(0.1), 0.0)


@pytest.mark.parametrize(
    ("offset_rad", "frames", "mounting"),
    [
        # Pelvis and head: a person's own offset; half of it a mounting; a mounting; half of one after 10 frames.
        ((0.2, 0.3), 60, (0.0, 0.0)),
        ((0.325, 0.425), 60, (0.1625, 0.2125)),
        ((-1.0, 2.0), 60, (-1.0, 2.0)),
        ((0.8, -0.9), 10, (0.4, -0.45)),
    ],
)
def test_a_constant_offset_is_a_mounting_by_its_size_and_its_time(offset_rad, frames, mounting):
    """Both yaws steady beside a straight walk: what is left of the offset is in the inputs, and is learned as such."""
    history = WalkerHistory()
    for k in range(frames):
        state = STATE + np.array([1.2 * k / 30, 0, 0, 0, 0, 0])
        pelvis, head = map(yaw_quat, offset_rad)
        inputs = history.add(HeadObservation(k / 30, state[:3], head, pelvis), state, 1e-4 * np.eye(3))
    left_rad = np.subtract(offset_rad, mounting)
    yaws = inputs.network[3 * WINDOW : 5 * WINDOW].reshape(WINDOW, 2)
    np.testing.assert_allclose(yaws[-1], left_rad / [0.15, 0.2], atol=1e-6)
    learned = inputs.network[5 * WINDOW : 5 * WINDOW + 2]
    np.testing.assert_allclose(learned, np.clip(left_rad * frames / (frames + 15.0) / 0.1, -4.0, 4.0), atol=1e-6)


@pytest.mark.parametrize("heading_rad", [0.0, 0.7, np.pi / 2])
def test_noise_is_told_along_across_and_up_and_as_it_is(heading_rad):
    """20 mm along, 10 across and 5 up, wherever the walk leads; so large noise is told in full, unlike the inputs'."""
    turn = Rotation.from_euler("z", heading_rad).as_matrix()
    for sds in (np.array([0.02, 0.01, 0.005]), np.array([30.0, 0.01, 1e-5])):
        covariance = turn @ np.diag(sds**2) @ turn.T
        state = np.concatenate([np.zeros(3), turn @ [1.2, 0.0, 0.0]])
        for stated, told in enumerate((None, covariance)):
            seen = HeadObservation(0.0, state[:3], position_covariance_m2=told)
            inputs = WalkerHistory().add(seen, state, covariance)
            np.testing.assert_allclose(inputs.stated_sd_m, stated * sds, rtol=1e-3, atol=1e-6)
            np.testing.assert_array_equal(inputs.stated_base_m2, stated * covariance)
            assert np.abs(inputs.network).max() <= 4.0
