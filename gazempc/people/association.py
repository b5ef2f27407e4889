"""Association of detections with tracks: constant-velocity filters, gating, optimal assignment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from gazempc.types import BoolArray, FloatArray
from predictors.gate import GATE_D2, allowance_m

# Of people who turn and stop. More than a forecast's own noise: people depart from straight lines.
_ACCELERATION_PSD = 0.5
# Of a new track: as fast as people walk.
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
        """A new track.

        Args:
            position_m: Shape (3,), metres.
            noise_m2: Covariance of its error, shape (3, 3).

        Returns:
            One person's motion.
        """
        nothing = np.zeros((1, 3, 3))
        vv = _INITIAL_SPEED_SD_M_S**2 * _EYE3[None]
        return Motion(position_m[None].copy(), np.zeros((1, 3)), noise_m2[None].copy(), nothing, vv)

    @staticmethod
    def stack(parts: Sequence[Motion]) -> Motion:
        """Join motions.

        Args:
            parts: Motions; at least one.

        Returns:
            All their people, in this order.
        """
        return Motion(
            *(np.concatenate(values) for values in zip(*(vars(part).values() for part in parts), strict=True))
        )

    def of(self, which: Sequence[int] | slice) -> Motion:
        """Some of the people.

        Args:
            which: Their numbers.

        Returns:
            Their motion.
        """
        return Motion(*(values[which] for values in vars(self).values()))

    def after(self, dt_s: FloatArray) -> Motion:
        """The motion a while later, at constant velocity.

        Args:
            dt_s: How much later each is, shape (N,), seconds.

        Returns:
            The motion.
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
        """Correct by measured positions.

        Args:
            measured_m: One of each person, shape (N, 3), metres.
            noise_m2: Covariances of their errors, shape (N, 3, 3).

        Returns:
            The motion.
        """
        inverse = np.linalg.inv(self.pp_m2 + noise_m2)
        gain_p, gain_v = self.pp_m2 @ inverse, np.swapaxes(self.pv, 1, 2) @ inverse
        innovation = (measured_m - self.position_m)[:, :, None]
        pp = self.pp_m2 - gain_p @ self.pp_m2
        vv = self.vv - gain_v @ self.pv
        return Motion(
            self.position_m + (gain_p @ innovation)[:, :, 0],
            self.velocity_m_s + (gain_v @ innovation)[:, :, 0],
            # Rounding makes them a little unsymmetric, and that grows.
            0.5 * (pp + np.swapaxes(pp, 1, 2)),
            self.pv - gain_p @ self.pv,
            0.5 * (vv + np.swapaxes(vv, 1, 2)),
        )


# What a tracker's names are worth beside distances in standard deviations, as twice the logarithm of the odds. A name
# that agrees is right 400 times as often as one that differs. People whose gates do not overlap never swap by it.
_OTHER_NAME_COST, _NO_NAME_COST = 12.0, 6.0
_NEVER = 1e9


def assign(
    expected: Motion,
    unseen_s: FloatArray,
    track_names: Sequence[str | None],
    measured_m: FloatArray,
    noise_m2: FloatArray,
    names: Sequence[str | None],
) -> list[tuple[int, int]]:
    """Assign detections of one instant to people.

    The cost is minus twice the log likelihood of the detection, and something for a name that differs.

    Args:
        expected: The people's motion at this instant.
        unseen_s: Time since each of them was seen, shape (N,), seconds.
        track_names: Last name that the tracker gave each of them; None without one.
        measured_m: Detections, shape (D, 3), metres.
        noise_m2: Covariances of their errors, shape (D, 3, 3).
        names: Names of the detections; None without one.

    Returns:
        Pairs of person and detection; each is in one pair at most.
    """
    spread = expected.pp_m2[:, None] + noise_m2
    spread = spread + (allowance_m(unseen_s) ** 2)[:, None, None, None] * np.eye(3)
    apart = measured_m - expected.position_m[:, None]
    d2 = (apart[:, :, None, :] @ np.linalg.inv(spread) @ apart[:, :, :, None])[:, :, 0, 0]
    near = d2 <= GATE_D2  # a NaN is not near
    cost = np.where(near, d2 + np.log(np.linalg.det(spread)) + _name_cost(track_names, names), _NEVER)
    rows, columns = linear_sum_assignment(cost)
    return [(row, column) for row, column in zip(rows.tolist(), columns.tolist(), strict=True) if near[row, column]]


def _name_cost(track_names: Sequence[str | None], names: Sequence[str | None]) -> FloatArray:
    ours, theirs = np.array(track_names, dtype=object), np.array(names, dtype=object)
    same: BoolArray = np.asarray(ours[:, None] == theirs, dtype=np.bool_)
    unknown: BoolArray = np.asarray(ours == None)[:, None] | np.asarray(theirs == None)  # noqa: E711  (elementwise)
    return np.where(unknown, _NO_NAME_COST, np.where(same, 0.0, _OTHER_NAME_COST))
