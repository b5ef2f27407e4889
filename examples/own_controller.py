"""A custom controller: aim at the head position forecast for one second ahead."""

import numpy as np

import gazempc as gz
from gazempc.neck.kinematics import look_at_rad


class Early:
    """A controller has three methods: `reset`, `forecast_times_s` and `plan`."""

    def __init__(self, neck: gz.NeckSpec, ahead_s: float = 1.0):
        self.neck, self.ahead_s = neck, ahead_s
        self.name = f"early_{ahead_s}"  # in tables and logs; default: the class's name

    def reset(self):
        pass

    def forecast_times_s(self, start_s, newest_capture_s):
        """Times of the forecast that `plan` receives."""
        return np.array([start_s + self.ahead_s])

    def plan(self, situation):
        """Commands from `situation.start_s` on; the loop smooths them within the limits."""
        head_m = situation.forecast.means_base_m[0]
        angles_rad = look_at_rad(self.neck.geometry, head_m)
        position_rad = self.neck.command_limits.clip_position(angles_rad)[None]
        still = np.zeros((1, 2))
        return gz.Plan(situation.start_s, 0.4, position_rad, still, still)


if __name__ == "__main__":
    neck = gz.load_neck("reference")
    for controller in (Early(neck, 0.5), Early(neck, 1.0), "lookahead", "mpc"):
        log = gz.replay("subject03_R4", neck=neck, controller=controller)
        metrics = gz.measure(log)
        print(
            f"{log.run.controller:<9} gaze {metrics.gaze_error_rms_deg:5.2f} deg, "
            f"{metrics.rms_acceleration_rad_s2:.2f} rad/s^2, limit violations: {metrics.limit_violations}"
        )

# It prints:
# early_0.5 gaze  2.35 deg, 0.90 rad/s^2, limit violations: 0
# early_1.0 gaze  5.87 deg, 1.53 rad/s^2, limit violations: 0
# lookahead gaze  1.26 deg, 0.64 rad/s^2, limit violations: 0
# mpc       gaze  1.27 deg, 0.66 rad/s^2, limit violations: 0
