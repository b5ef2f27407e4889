"""iKinGazeCtrl's neck (iCub): a filter whose closed loop has a triple pole and comes close to minimum jerk.

The face's point in space is made with the encoders when the frame *arrives*. The filter's input is the difference of
target and neck, its output a velocity, which is integrated and sent as a position. On the robot the eyes do the rest,
and the neck is solved anew only where it is off by more than 2.5 deg; here the neck does everything and always.
"""

from __future__ import annotations

import numpy as np

from experiments.rivals.laws.sight import point_base_m
from experiments.rivals.rival import HeadCamera, Rival, View
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Of the filter -a / (s^2 - c s - b), for a duration of 1 s.
_A, _B, _C = -150.766, -84.981, -15.967


class IKinGazeCtrl(Rival):
    """Filters the way to the target.

    Args:
        neck: Its geometry and its range.
        camera: The camera on the head.
        neck_time_s: In which 90 % of a step are done, seconds.
    """

    name = "ikingazectrl"
    period_s = 0.01

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, neck_time_s: float = 0.75) -> None:
        import control  # noqa: PLC0415  (takes a second, and only this law needs it)

        self._neck, self._camera = neck, camera
        a, b, c = _A / neck_time_s**3, _B / neck_time_s**2, _C / neck_time_s
        continuous = control.ss([[0.0, 1.0], [b, c]], [[0.0], [-a]], [[1.0, 0.0]], [[0.0]])
        self._discrete = control.sample_system(continuous, self.period_s, method="bilinear")

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._position_rad = self._target_rad = view.joints.position_rad
        self._state = np.zeros((2, 2))
        self._velocity_rad_s = np.zeros(2)

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        for detection in view.detections:
            point_m = point_base_m(self._neck.geometry, self._camera, detection, view.joints.position_rad)
            target_rad = look_at_rad(self._neck.geometry, point_m)
            self._target_rad = np.clip(target_rad, self._neck.position_min_rad, self._neck.position_max_rad)
        difference_rad = (self._target_rad - self._position_rad)[None]
        velocity_rad_s = (self._discrete.C @ self._state + self._discrete.D @ difference_rad)[0]
        self._state = self._discrete.A @ self._state + self._discrete.B @ difference_rad
        # Trapezoids, as the filter's own discretisation.
        self._position_rad = self._position_rad + 0.5 * self.period_s * (velocity_rad_s + self._velocity_rad_s)
        self._velocity_rad_s = velocity_rad_s
        return self._position_rad
