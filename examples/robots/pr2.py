"""PR2 in MuJoCo: the live program drives a physics model of the head, generated from the neck file.

On the robot, use `--robot ros2` with the options of `fetch.py` in place of `--robot mujoco`, and a tracker in place of
`--source replay`. Without `--simulated-clock` the same run takes real time.
"""

import gazempc as gz
from gazempc.live.session import main as live

words = "--source replay --replay subject09_R6 --robot mujoco --neck pr2 --simulated-clock"
live([*words.split(), "--no-figures", "--log", "npz"])

metrics = gz.measure(gz.load_log("out/live/log_000.npz"))
print(f"longest break of eye contact {metrics.longest_break_s:.2f} s, peak {metrics.peak_velocity_rad_s:.2f} rad/s")

# It prints:
# gazempc.live: source replay, robot mujoco, neck pr2
# running; Ctrl-C stops
#    0.0 s  no_observation_yet: no person has been observed yet; the neck holds still
#    1.0 s  seen 0.08 s ago, 4.03 m away; 29 observations/s, 100 % used; looks at pan -16.3, tilt +6.1 deg; aims at -16.6, +6.4; plan 5 ms old; ticks at most 0.00 ms late; began: no_observation_yet 1 x
#    2.0 s  seen 0.08 s ago, 2.87 m away; 30 observations/s, 100 % used; looks at pan -18.1, tilt +8.7 deg; aims at -16.5, +9.5; plan 5 ms old; ticks at most 0.00 ms late
#    3.0 s  seen 0.08 s ago, 2.36 m away; 30 observations/s, 100 % used; looks at pan -0.5, tilt +10.0 deg; aims at +4.5, +9.8; plan 5 ms old; ticks at most 0.00 ms late
#    4.0 s  seen 0.08 s ago, 2.83 m away; 30 observations/s, 100 % used; looks at pan +22.1, tilt +8.0 deg; aims at +25.9, +7.6; plan 5 ms old; ticks at most 0.00 ms late
# stopped by: end of the source
# 964 ticks, 0 skipped; later than due by 0.00 ms (p50), 0.00 ms (p99), 0.00 ms (max)
# from capture to command: 90 ms (p50), 103 ms (p99)
# gaze error 0.80 deg RMS, eye contact (2.6 deg) 100 %, against the recording's true head
# limit violations: 0
#   no_observation_yet 1 x
# Written to out/live/: report.html, summary.json, log_000.npz, compute_000.npz
# 142 of 142 used
# longest break of eye contact 0.00 s, peak 0.45 rad/s
