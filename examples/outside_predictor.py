"""A predictor from another library in ten lines: the g-h filter of filterpy, with velocity decay (time constant 2 s)."""

import numpy as np
from filterpy.gh import GHFilter

import gazempc as gz


class FadingVelocity:
    name = "fading_velocity"

    def reset(self):
        self.filter, self.last_s = None, 0.0

    def update(self, seen):
        if self.filter is None:
            self.filter = GHFilter(seen.head_position_base_m, np.zeros(3), dt=1.0, g=0.4, h=0.06)
        elif seen.capture_time_s > self.last_s:
            self.filter.dt = seen.capture_time_s - self.last_s
            self.filter.update(seen.head_position_base_m)
        self.last_s = seen.capture_time_s

    def forecast(self, times_s):
        ahead_s = np.asarray(times_s)[:, None] - self.last_s
        means_m = self.filter.x + self.filter.dx * 2.0 * (1.0 - np.exp(-ahead_s / 2.0))
        spread_m2 = np.square(0.02 + 0.2 * np.abs(ahead_s))[..., None] * np.eye(3)
        return gz.Forecast(times_s, means_m, spread_m2, self.last_s)


if __name__ == "__main__":
    for person in ("subject03_R4", "subject03_gesture"):
        for predictor in (FadingVelocity(), "constant_velocity", "last_position"):
            log = gz.replay(person, predictor=predictor)
            metrics = gz.measure(log)
            contact = f"eye contact {100 * metrics.eye_contact_2p6:3.0f} %"
            print(
                f"{person:<18} {log.run.predictor:<18} {metrics.forecast_error_500_mm:4.0f} mm after 0.5 s, {contact}"
            )

# It prints:
# subject03_R4       fading_velocity     146 mm after 0.5 s, eye contact  52 %
# subject03_R4       constant_velocity   118 mm after 0.5 s, eye contact  65 %
# subject03_R4       last_position       510 mm after 0.5 s, eye contact  27 %
# subject03_gesture  fading_velocity      71 mm after 0.5 s, eye contact  99 %
# subject03_gesture  constant_velocity    85 mm after 0.5 s, eye contact  97 %
# subject03_gesture  last_position        45 mm after 0.5 s, eye contact 100 %
