"""Rules of thumb for parameters missing in the data sheet of a neck."""

from __future__ import annotations

# Speed under load as a share of the no-load speed of the data sheet.
SPEED_SHARE = 0.8
# Acceleration to top speed within 0.2 s. The shipped necks have 3.3 to 6.
ACCELERATION_PER_SPEED_1_S = 5.0
# Full acceleration within 0.05 s, as in the shipped necks.
JERK_PER_ACCELERATION_1_S = 20.0
# Servo bandwidth of 1.9 Hz, as in the shipped necks `reference` and `fetch`.
NATURAL_FREQUENCY_RAD_S = 12.0
DAMPING_RATIO = 0.9
# Network plus the cycle of a robot's controller, as in `fetch` and `pr2`.
DEAD_TIME_S = 0.1

RULES: dict[str, str] = {
    "position_min_deg": "the end of the joint's range to the right, or down; straight ahead is 0",
    "position_max_deg": "the end of the joint's range to the left, or up; straight ahead is 0",
    "velocity_max_rad_s": f"{SPEED_SHARE:g} times the data sheet's top speed, in rad/s (1 rpm is 0.105)",
    "acceleration_max_rad_s2": f"{ACCELERATION_PER_SPEED_1_S:g} times velocity_max_rad_s",
    "jerk_max_rad_s3": f"{JERK_PER_ACCELERATION_1_S:g} times acceleration_max_rad_s2",
    "natural_frequency_rad_s": f"{NATURAL_FREQUENCY_RAD_S:g}, until it is measured",
    "damping_ratio": f"{DAMPING_RATIO:g}, until it is measured",
    "dead_time_s": f"{DEAD_TIME_S:g}, until it is measured",
}
