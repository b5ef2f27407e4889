"""Vary a setting from Python; `python -m experiments.sweep` varies several over many walks, on all processors."""

import gazempc as gz

print("smoothing  gaze error  acceleration")
for smoothing_time_s in (0.04, 0.08, 0.16):
    log = gz.replay("subject03_R4", mpc={"smoothing_time_s": smoothing_time_s})
    metrics = gz.measure(log)
    print(
        f"{smoothing_time_s:7.2f} s  {metrics.gaze_error_rms_deg:6.2f} deg  "
        f"{metrics.rms_acceleration_rad_s2:5.2f} rad/s^2"
    )

# It prints:
# smoothing  gaze error  acceleration
#    0.04 s    1.09 deg   1.76 rad/s^2
#    0.08 s    1.16 deg   1.04 rad/s^2
#    0.16 s    1.48 deg   0.54 rad/s^2
