"""A custom robot on the command line.

The equivalent shell command, in the folder of this file:

    python -m gazempc.live --source replay --robot own_robot:MyNeck --simulated-clock --options.offset_deg 1.5

The dead time is 0.4 s in the neck file `reference` but 0.1 s on this neck. Identify it, and pass the file by --neck:

    python -m gazempc.identify --robot own_robot:MyNeck --out my_neck.toml
"""

import sys
from collections import deque

import numpy as np

import gazempc as gz
from gazempc.live.session import main


class MyNeck:
    """A robot has four methods. Here two simulated servos with 0.1 s of dead time replace the driver.

    Arguments of the constructor are supplied by name: `neck`, `clock_s`, `clock`, `position_rad`, `seed`. Others come
    from --options.
    """

    # Uses the loop's clock, so a simulated clock is possible. Not for a real robot.
    keeps_any_clock = True

    def __init__(self, neck: gz.NeckSpec, clock_s, position_rad, offset_deg: float = 0.0):
        self.neck, self.clock_s, self.offset_rad = neck, clock_s, np.radians(offset_deg)
        self.joint_rad, self.joint_rad_s = np.array(position_rad), np.zeros(2)
        self.pending = deque([self.joint_rad] * round(0.1 * neck.servo_rate_hz))

    def connect(self):
        pass  # raise gazempc.errors.RobotError with advice if the robot does not respond

    def read_state(self):
        return gz.JointState(self.clock_s(), self.joint_rad + self.offset_rad, self.joint_rad_s)

    def send_command(self, position_rad):
        sent_rad = np.clip(position_rad, self.neck.position_min_rad, self.neck.position_max_rad)
        self.pending.append(sent_rad)
        error_rad = self.pending.popleft() - self.joint_rad
        self.joint_rad_s = self.joint_rad_s + self.neck.servo_period_s * (144.0 * error_rad - 21.6 * self.joint_rad_s)
        self.joint_rad = self.joint_rad + self.neck.servo_period_s * self.joint_rad_s
        return sent_rad  # the command actually sent

    def close(self):
        pass


if __name__ == "__main__":
    words = "--source replay --robot own_robot:MyNeck --simulated-clock --no-figures --log npz"
    words += " --options.offset_deg 1.5"
    sys.exit(main(words.split()))
# It prints:
# gazempc.live: source replay, robot own_robot:MyNeck, neck reference
# running; Ctrl-C stops
#    0.0 s  no_observation_yet: no person has been observed yet; the neck holds still
#    1.0 s  seen 0.08 s ago, 4.24 m away; 29 observations/s, 100 % used; looks at pan -16.4, tilt +7.1 deg; aims at -18.1, +6.0; plan 5 ms old; ticks at most 0.00 ms late; began: no_observation_yet 1 x
#    2.0 s  seen 0.08 s ago, 3.24 m away; 30 observations/s, 100 % used; looks at pan -15.0, tilt +8.7 deg; aims at -12.6, +7.6; plan 5 ms old; ticks at most 0.00 ms late
#    3.0 s  seen 0.08 s ago, 2.75 m away; 30 observations/s, 100 % used; looks at pan +5.3, tilt +8.9 deg; aims at +9.4, +7.2; plan 5 ms old; ticks at most 0.00 ms late
#    4.0 s  seen 0.08 s ago, 2.78 m away; 30 observations/s, 100 % used; looks at pan +25.8, tilt +8.3 deg; aims at +28.9, +6.6; plan 5 ms old; ticks at most 0.00 ms late
# stopped by: end of the source
# 945 ticks, 0 skipped; later than due by 0.00 ms (p50), 0.00 ms (p99), 0.00 ms (max)
# from capture to command: 90 ms (p50), 103 ms (p99)
# gaze error 3.17 deg RMS, eye contact (2.6 deg) 53 %, against the recording's true head
# limit violations: 0
#   no_observation_yet 1 x
# Written to out/live/: report.html, summary.json, log_000.npz, compute_000.npz
# 139 of 139 used
