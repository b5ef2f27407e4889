"""Read a log: one array per field, with a common time array for each rate. `numpy.load` also reads the file."""

import numpy as np

import gazempc as gz

gz.replay("subject03_R4").save("walk.npz")

log = gz.load_log("walk.npz")
print(f"{log.run.recording}: {log.run.controller} with {log.run.predictor} on neck {log.neck.name}")
print(f"{log.time_s.size} ticks, {log.capture_time_s.size} observations, to {log.time_s[-1]:.2f} s")

pan_deg, tilt_deg = np.degrees(log.joint_position_rad).T
print(f"pan from {pan_deg.min():.1f} to {pan_deg.max():.1f} deg")
late_ms = 1e3 * np.median(log.arrival_time_s - log.capture_time_s)
print(f"observations are {late_ms:.0f} ms old when they arrive")
for time_s, name in zip(log.event_time_s, log.event_name, strict=True):
    print(f"{time_s:.2f} s: {name}")
for fault in log.faults:  # exceptions caught by the loop, with tracebacks
    print(fault.line)

# It prints:
# subject03_R4: mpc with walker on neck reference
# 934 ticks, 138 observations, to 4.67 s
# pan from -18.3 to 36.4 deg
# observations are 68 ms old when they arrive
# 0.00 s: no_observation_yet
