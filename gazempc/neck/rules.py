"""Rules of thumb for figures that the data sheet of a neck lacks."""

from __future__ import annotations

# The data sheet's top speed is that of a motor without a load.
SPEED_SHARE = 0.8
# Top speed is reached within 0.2 s: 5 times the speed. The shipped necks have 3.3 to 6.
ACCELERATION_PER_SPEED_1_S = 5.0
# Full acceleration is reached within 0.05 s: 20 times it, as in the shipped necks.
JERK_PER_ACCELERATION_1_S = 20.0
# A servo that follows a 1.9 Hz sine, as those of the shipped necks `reference` and `fetch`.
NATURAL_FREQUENCY_RAD_S = 12.0
DAMPING_RATIO = 0.9
# Through a network and a controller's cycle, as in `fetch` and `pr2`.
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
