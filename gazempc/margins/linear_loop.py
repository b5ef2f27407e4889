"""The closed loop of one joint without active limits: state feedback with preview, observer, dead time, servo.

While no limit binds, the MPC is affine state feedback with preview: j = K [z0; 1; r]. Between two plans the jerk is
held; at each servo period the observer corrects its state by the measured angle. With r = 0 the loop is linear and
periodic, with one control period of m servo periods. Its state before each measurement is

    x = [q, v, q^, v^, b^, u, du, ddu, j, l, c_-1 ... c_-L]

joint, observer (angle, velocity, steady-state error), command, jerk, and the commands sent before. For a joint that is
velocity-controlled, l is the integral of the speeds. Its steady-state error is not part of the plan: a position loop of
gain k (`gazempc.loop.drive`) adds k (u + du h / 2 - l - b^) to the speed du, which is held for h.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.mpc.problem import STATE
from gazempc.loop.drive import speed_loop_gain
from gazempc.loop.observer import observer_gain
from gazempc.neck.ahead import JointAhead
from gazempc.neck.servo import zero_order_hold
from gazempc.neck.spec import Axis
from gazempc.types import FloatArray

ComplexArray = NDArray[np.complex128]

_SAME_TIME_S = 1e-9
_JOINT, _SEEN, _OFFSET, _COMMAND, _JERK, _LED, _SENT = slice(0, 2), slice(2, 4), 4, slice(5, 8), 8, 9, 10


@dataclass(frozen=True)
class Mismatch:
    """Model mismatch of a joint.

    Attributes:
        gain: DC gain of the joint.
        dead_time_s: Excess of the dead time over the model's, seconds.
        frequency: Ratio of the natural frequency to the model's.
    """

    gain: float = 1.0
    dead_time_s: float = 0.0
    frequency: float = 1.0

    def of(self, axis: Axis) -> Axis:
        """The joint with this mismatch from its model, except for the gain."""
        late_s = max(axis.dead_time_s + self.dead_time_s, 0.0)
        frequency = axis.natural_frequency_rad_s * self.frequency
        return axis.model_copy(update={"dead_time_s": late_s, "natural_frequency_rad_s": frequency})


EXACT = Mismatch()


class LinearLoop:
    """The loop of one joint.

    Args:
        mpc: The controller.
        index: 0 for pan, 1 for tilt.
        error: Mismatch between the joint and the model of controller and observer.

    Attributes:
        period_s: Control period T_c, seconds.
        ticks: Servo periods of a control period, m.
    """

    def __init__(self, mpc: Mpc, index: int, error: Mismatch = EXACT) -> None:
        neck, axis = mpc.neck, mpc.neck.axes[index]
        self.period_s, self.ticks, h = neck.control_period_s, neck.servo_ticks_per_plan, neck.servo_period_s
        self._h, joint = h, error.of(axis)
        after_dead_time = JointAhead(axis, h, np.array([axis.dead_time_s]))
        # Number of past commands that can act within a servo period.
        history = 1 + max(math.floor(each.dead_time_s / h + _SAME_TIME_S) for each in (axis, joint))
        self.size = _SENT + history
        self._feedback = self._state_feedback(mpc, index, after_dead_time)
        # Measured and corrected at once: q^+ = q^ + (K_q - K_b) e, v^+ = v^ + K_v e, b^+ = b^ + K_b e.
        gain_q, gain_v, gain_b = observer_gain(axis, h)
        self._gain = np.zeros(self.size)
        self._gain[[2, 3, _OFFSET]] = gain_q - gain_b, gain_v, gain_b
        self._expected = np.zeros(self.size)
        self._expected[[2, _OFFSET]] = 1.0
        self._advance = self._advanced(axis, joint, error.gain)

    def _state_feedback(self, mpc: Mpc, index: int, after_dead_time: JointAhead) -> FloatArray:
        # The jerk of the first step from x, after the correction.
        ocp = mpc.ocps[index]
        gain = ocp.model.jerk_scale * ocp.program.gain[0]
        row, oldest_first = np.zeros(self.size), after_dead_time.maps[:, 0, 2:]
        row[_SEEN] = gain[:2] @ after_dead_time.maps[:, 0, :2]
        row[_SENT : _SENT + after_dead_time.sent_needed] = gain[:2] @ oldest_first[:, ::-1]
        row[_COMMAND] = gain[2 : len(STATE)]
        # The steady-state error is subtracted from the reference; for a velocity-controlled joint, added to its angle.
        row[_OFFSET] = gain[0] if mpc.neck.axes[index].takes_speed else -gain[len(STATE) + 1 :].sum()
        return row

    def _advanced(self, axis: Axis, joint: Axis, gain: float) -> FloatArray:
        # One servo period: propagate and send the command, then propagate joint and observer with the acting command.
        h, advance = self._h, np.zeros((self.size, self.size))
        command = np.zeros((3, self.size))
        command[:, _COMMAND] = [[1.0, h, h**2 / 2.0], [0.0, 1.0, h], [0.0, 0.0, 1.0]]
        command[:, _JERK] = h**3 / 6.0, h**2 / 2.0, h
        advance[_COMMAND], advance[_OFFSET, _OFFSET], advance[_JERK, _JERK] = command, 1.0, 1.0
        now = command[0]
        if axis.takes_speed:
            states = np.eye(self.size)
            u, du, _ = states[_COMMAND]
            speed = command[1] + speed_loop_gain(axis, h) * (u + 0.5 * h * du - states[_LED] - states[_OFFSET])
            advance[_LED] = states[_LED] + h * speed
            # Mean angle over a period in which the speed is held.
            now = states[_LED] + 0.5 * h * speed
        advance[_SENT] = now
        advance[_SENT + 1 :, _SENT:-1] = np.eye(self.size - _SENT - 1)
        for place, follower, scale in ((_JOINT, joint, gain), (_SEEN, axis, 1.0)):
            whole = math.floor(follower.dead_time_s / h + _SAME_TIME_S)
            rest_s = max(follower.dead_time_s - whole * h, 0.0)
            state = np.eye(2, self.size, place.start)
            # c_-k is the command sent k periods ago, preceded by the present one.
            sent = [now, *np.eye(self.size)[_SENT:]]
            for acting, lasts_s in ((whole + 1, rest_s), (whole, h - rest_s)):
                if lasts_s > _SAME_TIME_S:
                    step = zero_order_hold(follower, lasts_s)
                    state = step[:, :2] @ state + scale * np.outer(step[:, 2], sent[acting])
            advance[place] = state
        return advance

    def transition(self) -> FloatArray:
        """The closed loop over one control period, shape (S, S): x+ = Phi x."""
        A, B, C, D = self.opened()
        return np.asarray(A + B @ np.linalg.solve(np.eye(self.ticks) - D, C))  # y = q

    def opened(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The loop opened at the measurement, lifted over a control period: from m measured to m true angles.

        Returns:
            A, shape (S, S), B, shape (S, m), C, shape (m, S), D, shape (m, m).
        """
        A, B = np.eye(self.size), np.zeros((self.size, self.ticks))
        C, D = np.zeros((self.ticks, self.size)), np.zeros((self.ticks, self.ticks))
        plans = np.eye(self.size)
        plans[_JERK] = self._feedback
        # The first tick of a control period includes a plan.
        for k, tick in enumerate([self._advance @ plans, *[self._advance] * (self.ticks - 1)]):
            C[k], D[k] = A[0], B[0]
            A, B = (tick @ (x - np.outer(self._gain, self._expected @ x)) for x in (A, B))
            B[:, k] += tick @ self._gain
        return A, B, C, D

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Loop transfer function L at frequencies, shape (F,), rad/s, for negative feedback: sensitivity 1 / (1 + L).

        The loop is periodic; this is its fundamental response, at the frequency of the input.
        """
        A, B, C, D = self.opened()
        z = np.exp(1j * omega_rad_s * self.period_s)[:, None, None]
        lifted = C @ np.linalg.solve(z * np.eye(self.size) - A, np.broadcast_to(B, (z.size, *B.shape))) + D
        wave = np.exp(1j * np.outer(omega_rad_s, self._h * np.arange(self.ticks)))
        return np.asarray(-np.einsum("fi,fij,fj->f", wave.conj(), lifted, wave) / self.ticks)
