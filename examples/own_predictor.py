"""A custom predictor: extrapolation with the mean velocity of the last 0.3 s."""

import numpy as np

import gazempc as gz


class MeanVelocity:
    """A predictor has three methods: `reset`, `update` and `forecast`."""

    def __init__(self, window_s: float = 0.3):
        self.window_s = window_s
        self.reset()

    def reset(self):
        self.times_s, self.heads_m = [], []

    def update(self, observation):
        self.times_s.append(observation.capture_time_s)
        self.heads_m.append(observation.head_position_base_m)
        while self.times_s[0] < observation.capture_time_s - self.window_s:
            del self.times_s[0], self.heads_m[0]

    def forecast(self, times_s):
        ahead_s = np.asarray(times_s) - self.times_s[-1]
        velocity_m_s = np.zeros(3)
        if len(self.times_s) > 1:
            velocity_m_s = (self.heads_m[-1] - self.heads_m[0]) / (self.times_s[-1] - self.times_s[0])
        return gz.Forecast(
            times_s=times_s,
            means_base_m=self.heads_m[-1] + ahead_s[:, None] * velocity_m_s,
            # Standard deviation on each axis: 10 mm, plus 200 mm for each second ahead.
            covariances_m2=np.square(0.01 + 0.2 * np.abs(ahead_s))[:, None, None] * np.eye(3),
            issued_at_s=self.times_s[-1],
        )


if __name__ == "__main__":
    for predictor in (MeanVelocity(), "constant_velocity", "walker"):
        log = gz.replay("subject03_R4", predictor=predictor)
        metrics = gz.measure(log)
        print(
            f"{log.run.predictor:<18} forecast {metrics.forecast_error_500_mm:3.0f} mm off after 0.5 s, "
            f"gaze {metrics.gaze_error_rms_deg:.2f} deg"
        )

# It prints:
# MeanVelocity       forecast 122 mm off after 0.5 s, gaze 2.75 deg
# constant_velocity  forecast 118 mm off after 0.5 s, gaze 2.63 deg
# walker             forecast  56 mm off after 0.5 s, gaze 1.27 deg
