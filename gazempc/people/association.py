"""Association of detections with tracks: constant-velocity filters, gating, optimal assignment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from gazempc.types import FloatArray, IntArray
from predictors import HeadObservation
from predictors.gate import GATE_D2, allowance_m
from predictors.predictor import noise_m2

# Process noise of people who turn and stop; larger than a predictor's, as constant velocity is a coarse model.
_ACCELERATION_PSD = 0.5
# Initial standard deviation of the velocity: walking speed.
_INITIAL_SPEED_SD_M_S = 1.0
_EYE3 = np.eye(3)


@dataclass(frozen=True)
class Motion:
    """Position and velocity of N people, with their covariances in blocks.

    Attributes:
        position_m: Shape (N, 3), metres, base frame.
        velocity_m_s: Shape (N, 3), m/s.
        pp_m2: Covariance of the positions, shape (N, 3, 3).
        pv: Covariance of positions with velocities, shape (N, 3, 3).
        vv: Covariance of the velocities, shape (N, 3, 3).
    """

    position_m: FloatArray
    velocity_m_s: FloatArray
    pp_m2: FloatArray
    pv: FloatArray
    vv: FloatArray

    @staticmethod
    def begin(position_m: FloatArray, noise_m2: FloatArray) -> Motion:
        """Initial estimate of a new track.

        Args:
            position_m: Measured position, shape (3,), metres.
            noise_m2: Covariance of its error, shape (3, 3).

        Returns:
            Motion of one person.
        """
        nothing = np.zeros((1, 3, 3))
        vv = _INITIAL_SPEED_SD_M_S**2 * _EYE3[None]
        return Motion(position_m[None].copy(), np.zeros((1, 3)), noise_m2[None].copy(), nothing, vv)

    @staticmethod
    def stack(parts: Sequence[Motion]) -> Motion:
        """Concatenate motions.

        Args:
            parts: Motions; at least one.

        Returns:
            All people, in this order.
        """
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return Motion(*map(np.concatenate, columns))

    def of(self, which: IntArray | slice) -> Motion:
        """Select people.

        Args:
            which: Indices.

        Returns:
            Motion of the selected people.
        """
        return Motion(*(values[which] for values in vars(self).values()))

    def after(self, dt_s: FloatArray) -> Motion:
        """Kalman prediction at constant velocity.

        Args:
            dt_s: Prediction time of each person, shape (N,), seconds.

        Returns:
            The predicted motion.
        """
        dt = dt_s[:, None, None]
        return Motion(
            self.position_m + dt_s[:, None] * self.velocity_m_s,
            self.velocity_m_s,
            self.pp_m2
            + dt * (self.pv + np.swapaxes(self.pv, 1, 2))
            + dt**2 * self.vv
            + (_ACCELERATION_PSD / 3.0) * dt**3 * _EYE3,
            self.pv + dt * self.vv + (_ACCELERATION_PSD / 2.0) * dt**2 * _EYE3,
            self.vv + _ACCELERATION_PSD * dt * _EYE3,
        )

    def corrected(self, measured_m: FloatArray, noise_m2: FloatArray) -> Motion:
        """Kalman update with measured positions.

        Args:
            measured_m: One position per person, shape (N, 3), metres.
            noise_m2: Covariances of their errors, shape (N, 3, 3).

        Returns:
            The updated motion.
        """
        inverse = np.linalg.inv(self.pp_m2 + noise_m2)
        gain_p, gain_v = self.pp_m2 @ inverse, np.swapaxes(self.pv, 1, 2) @ inverse
        innovation = (measured_m - self.position_m)[:, :, None]
        pp = self.pp_m2 - gain_p @ self.pp_m2
        vv = self.vv - gain_v @ self.pv
        return Motion(
            self.position_m + (gain_p @ innovation)[:, :, 0],
            self.velocity_m_s + (gain_v @ innovation)[:, :, 0],
            # Symmetrise: asymmetry from rounding would accumulate.
            0.5 * (pp + np.swapaxes(pp, 1, 2)),
            self.pv - gain_p @ self.pv,
            0.5 * (vv + np.swapaxes(vv, 1, 2)),
        )


# Cost of a tracker's names relative to squared Mahalanobis distances: twice the log odds. A matching name is correct
# 400 times as often as a different one. The gates still apply: distant people are never swapped.
_OTHER_NAME_COST, _NO_NAME_COST = 12.0, 6.0
_NEVER = 1e9
# Assumed covariance if a tracker states none; includes drift with posture.
_POSITION_NOISE_M2 = 0.03**2 * _EYE3


def assign(
    expected: Motion, unseen_s: FloatArray, track_names: Sequence[str | None], observations: Sequence[HeadObservation]
) -> list[tuple[int, int, Motion]]:
    """Optimal assignment of detections of one instant to tracks, and the Kalman update with them.

    Cost: minus twice the log-likelihood of the detection, plus a penalty for a different name.

    Args:
        expected: Predicted motion of the people at this instant.
        unseen_s: Time since the last detection of each person, shape (N,), seconds.
        track_names: Last tracker name of each person; None for no name.
        observations: Detections; at least one.

    Returns:
        Indices of person and detection, each at most once, and the person's updated motion.
    """
    measured_m = np.array([seen.head_position_base_m for seen in observations])
    noise = np.array([noise_of(seen) for seen in observations])
    spread = expected.pp_m2[:, None] + noise
    spread = spread + (allowance_m(unseen_s) ** 2)[:, None, None, None] * np.eye(3)
    apart = measured_m - expected.position_m[:, None]
    d2 = (apart[:, :, None, :] @ np.linalg.inv(spread) @ apart[:, :, :, None])[:, :, 0, 0]
    near = d2 <= GATE_D2  # False for NaN
    named = np.array([[_name_cost(name, seen.person_id) for seen in observations] for name in track_names])
    rows, columns = linear_sum_assignment(np.where(near, d2 + np.log(np.linalg.det(spread)) + named, _NEVER))
    accepted = near[rows, columns]
    rows, columns = rows[accepted], columns[accepted]
    corrected = expected.of(rows).corrected(measured_m[columns], noise[columns])
    pairs = enumerate(zip(rows.tolist(), columns.tolist(), strict=True))
    return [(row, column, corrected.of(slice(k, k + 1))) for k, (row, column) in pairs]


def noise_of(observation: HeadObservation) -> FloatArray:
    """Covariance of a position's error, stated or assumed, shape (3, 3), square metres."""
    return noise_m2(observation, _POSITION_NOISE_M2)


def _name_cost(name: str | None, other: str | None) -> float:
    return _NO_NAME_COST if None in (name, other) else _OTHER_NAME_COST * (name != other)
