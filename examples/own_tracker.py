"""A custom tracker drives a neck: your program calls `see`, and the package moves the neck."""

import math
import time

import gazempc as gz


def tracker(seconds):
    """Simulated camera: a person walks by, 30 frames a second, with a latency of 50 ms."""
    start_s = time.time()
    while (now_s := time.time()) < start_s + seconds:
        captured_s = now_s - 0.05
        yield captured_s, (2.0, 0.8 * math.sin(captured_s - start_s), 0.3)
        time.sleep(1 / 30)


# The robot is simulated here. Use your neck file, and the name of your robot or an object of a custom class.
with gz.Gaze("reference", "simulated") as gaze:
    for time_s, head_m in tracker(seconds=3.0):
        gaze.see(time_s, head_m)  # Unix time of the capture; metres, x forward, y left, z up

# At the end of the block the neck was braked within its limits, and the robot closed.
log = gaze.log()
metrics = gz.measure(log)
print(f"followed to the left: {log.joint_position_rad[:, 0].max() > 0.2}")
print(f"limit violations: {metrics.limit_violations}")

# It prints:
# followed to the left: True
# limit violations: 0
